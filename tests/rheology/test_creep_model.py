"""Creep step by step, and where the work went."""

import numpy as np
import pytest

from kaju import CreepModel, History, Scene, ThreeElement, creep, export_page, plot
from kaju.errors import ParameterError, ResultError
from kaju.model.network.spring_lattices import triangular

DOUGH = ThreeElement(K_f=2.0, D_f=1.0, D_d=20.0)
TIMES = [0.0, 0.5, 1.0, 2.0, 4.0]
PUSH = History().ramp(1.0, 0.5).hold(1.5).release(0.5).hold(1.5)


def slab(**material):
    return Scene(
        body={"cell_size": 0.01, "cells": [3, 3], "material": "gel"},
        materials={"gel": {"youngs_modulus": 2e3, "poissons_ratio": 0.3, **material}},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, -1.0]}],
    )


CREEPING = {"K_f": 2e3, "D_f": 1e3, "D_d": 2e4}


@pytest.mark.parametrize(
    ("subject", "more"),
    [
        (DOUGH, {}),
        (slab(rheology=CREEPING), {}),
        (slab(rheology=CREEPING).replace(rule={"kind": "elastic"}), {}),
        (triangular(3, force=0.01), {"rheology": DOUGH}),
    ],
    ids=["element", "agents", "elastic", "network"],
)
def test_its_steps_are_those_of_creep(subject, more):
    model = CreepModel(subject, PUSH, times=TIMES, **more)
    course = creep(subject, PUSH, times=TIMES, **more)
    while model.running:
        model.step()
    assert model.steps == len(TIMES) - 1
    found = model.result()
    for name in ("times", "work", "stored", "dissipated", "at_jumps", "numerical"):
        np.testing.assert_array_equal(getattr(found, name), getattr(course, name))
    np.testing.assert_array_equal(found.largest_displacement(), course.largest_displacement())
    model.step()
    assert model.steps == len(TIMES) - 1, "nothing is left to step to"


def test_it_is_shown(tmp_path):
    model = CreepModel(slab(rheology=CREEPING), PUSH, times=TIMES)
    model.run(3)
    assert plot(model).axes
    assert export_page(model, tmp_path / "page.html").exists()


def test_half_the_work_of_a_sudden_load_on_springs_is_set_free_and_said():
    sudden = creep(slab(), History.step().hold(1.0))
    assert sudden.at_jumps[-1] == pytest.approx(0.5 * sudden.work[-1], rel=1e-9)
    assert sudden.stored[-1] == pytest.approx(0.5 * sudden.work[-1], rel=1e-9)
    assert sudden.numerical[-1] == pytest.approx(sudden.at_jumps[-1], rel=1e-9)
    assert "set free where the load jumps" in sudden.notes[-1]
    assert sudden.summary()["numerical_J"] == pytest.approx(0.0, abs=1e-12 * sudden.work[-1])
    slow = creep(slab(), History().ramp(1.0, 1.0).hold(1.0))
    assert slow.at_jumps[-1] == 0.0
    assert not any("jumps" in note for note in slow.notes)
    assert slow.stored[-1] == pytest.approx(slow.work[-1], rel=1e-2)


def test_a_damper_beside_the_spring_takes_up_a_jump():
    damped = creep(DOUGH, History.step().hold(4.0))
    assert abs(damped.at_jumps[-1]) < 1e-6 * damped.work[-1]
    assert not damped.notes


def test_what_cannot_creep_is_named():
    with pytest.raises(ParameterError, match="subject: a Scene, a SpringNetwork or a ThreeElement"):
        CreepModel("dough", PUSH)
    with pytest.raises(ParameterError, match="history: a History is needed"):
        CreepModel(DOUGH)
    late = CreepModel(DOUGH, PUSH, times=[1.0, 2.0])
    with pytest.raises(ResultError, match="take a step first"):
        late.result()
    late.step()
    assert late.result().times.tolist() == [1.0]


def test_the_prescribed_rule_in_time_says_that_it_keeps_no_equilibrium():
    by_rule = creep(slab(rheology=CREEPING), PUSH, times=TIMES)
    assert "no equilibrium" in by_rule.notes[0]
    body = slab(rheology=CREEPING).replace(rule={"kind": "elastic"})
    assert not creep(body, PUSH, times=TIMES).notes
