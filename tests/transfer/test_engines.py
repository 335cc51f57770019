"""Objects and arrays are two tellings of one story."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from plates import plate as pressed
from strategies import scenes

from kaju import LoadModel, MaterialAgent, Scene, stability
from kaju.errors import ParameterError, StabilityError
from kaju.model.transfer import array_engine
from kaju.model.transfer.agent_engine import AgentEngine
from kaju.model.transfer.array_engine import ArrayEngine
from kaju.model.transfer.stage import Ledger


def assert_same(one, other):
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12, err_msg=field.name)
        elif isinstance(a, float):
            assert a == pytest.approx(b, rel=1e-12, abs=1e-12), field.name
        elif isinstance(a, (int, str)):
            assert a == b, field.name
        else:
            assert_same(a, b)


def run_both(scene):
    """Run a scene on both engines: same loads, balanced ledgers, a certificate that is right."""
    if not stability(scene).stable:
        with pytest.raises(StabilityError, match="lower"):
            LoadModel(scene)
        return
    models = [LoadModel(scene, engine=engine) for engine in ("agents", "arrays")]
    one, other = (model.run() for model in models)
    agents, ledger = one.last, one.last.ledger
    assert_same(agents, other.last)
    assert ledger.imbalance < 1e-12
    assert ledger.pending == 0.0
    assert ledger.taken == pytest.approx(agents.taken.sum(), rel=1e-12)
    assert ledger.returned == pytest.approx(agents.returned.sum(), rel=1e-12, abs=1e-12)
    assert np.isfinite(other.displacement).all()
    assert agents.generations <= models[0].certificate.generations


@settings(max_examples=30)
@given(scene=scenes())
def test_both_engines_give_the_same_loads_and_balanced_ledgers(scene):
    run_both(scene)


@pytest.mark.slow
@settings(max_examples=700)
@given(scene=scenes() | scenes(senses=st.just(True)))
def test_both_engines_agree_on_hundreds_of_scenes(scene):
    assume(stability(scene).stable)
    run_both(scene)


PLATE = {
    "body": {"cell_size": 0.01, "cells": [8, 8], "material": "steel"},
    "sides": {"bottom": "rigid"},
    "loads": [{"cell": [3, 7], "force": [0.0, -2.0]}],
}


class Quiet(MaterialAgent):
    """Keeps everything."""

    def pass_on(self, load):
        self.dropped += load.total


def test_an_agent_of_ones_own_switches_to_objects():
    body = {"cell_size": 0.01, "cells": [200, 200], "material": "steel"}
    scene = Scene(**{**PLATE, "body": body})
    assert isinstance(LoadModel(scene).engine, ArrayEngine)
    model = LoadModel(scene, material_agent=Quiet)
    assert isinstance(model.engine, AgentEngine)
    stage = model.run().last
    assert stage.cells.tolist() == [[3, 7]]
    assert stage.ledger == Ledger(2.0, 2.0, 1.0, 2.0, 0.0, 0.0, 2.0, 0.0)


def test_small_bodies_live_as_objects():
    assert isinstance(LoadModel(Scene(**PLATE)).engine, AgentEngine)
    assert isinstance(LoadModel(Scene(**PLATE), engine="arrays").engine, ArrayEngine)


def test_a_wrong_engine_is_refused():
    with pytest.raises(ParameterError, match=r"engine: 'auto', 'agents' or 'arrays', got 'gpu'"):
        LoadModel(Scene(**PLATE), engine="gpu")
    with pytest.raises(ParameterError, match="knows no Quiet"):
        LoadModel(Scene(**PLATE), engine="arrays", material_agent=Quiet)


@pytest.mark.parametrize("accumulate", [False, True])
def test_pieces_and_bisection_change_nothing(monkeypatch, accumulate):
    rule = {"threshold": 1e-3, "accumulate": accumulate, "alpha": [0.5, 0.4, 0.15]}
    scene = Scene(**{**PLATE, "rule": rule, "loads": [{"side": "top", "force": [0.3, -2.0]}]})
    usual = LoadModel(scene, engine="arrays").run().last
    monkeypatch.setattr(array_engine, "PIECE", 3)
    monkeypatch.setattr(array_engine, "MOST_INDEXED", 0)
    pieces = LoadModel(scene, engine="arrays").run().last
    for field in fields(usual):
        one, other = getattr(usual, field.name), getattr(pieces, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other, err_msg=field.name)
    np.testing.assert_array_equal(usual.history.load, pieces.history.load)
    assert pieces.ledger.imbalance < 1e-12


@pytest.mark.parametrize("accumulate", [False, True])
def test_cells_whose_numbers_no_integer_holds_are_named_anew(accumulate):
    """A corner of a body of 4·10¹⁸ cells does what the same corner of a small one does."""
    rule = {"threshold": 0.02, "accumulate": accumulate, "alpha": [0.5, 0.4, 0.15]}

    def corner(cells):
        scene = pressed(
            cells, [2, 1], [0.5, -2.0], sides={"bottom": "rigid", "left": "rigid"}, rule=rule
        )
        return LoadModel(scene, engine="arrays").run().last

    small, giant = corner([40, 40]), corner([10**9, 4 * 10**9])
    assert small.cells.max() < 39
    assert_same(small, giant)
