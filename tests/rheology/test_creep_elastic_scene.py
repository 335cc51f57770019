"""Elastic scenes in time: correspondence where it is exact, else step by step."""

import numpy as np
import pytest

from kaju.agents.materials import Material
from kaju.model.elastic.solve import solve
from kaju.model.rheology.creeping import creep
from kaju.model.rheology.creeping_elastic import SteppedBody
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene

SOFT = ThreeElement(K_f=2e5, D_f=3e5, D_d=4e6)
TIMES = np.array([0.2, 3.0, 5.2, 6.0, 10.0])
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)
DRAWN = "\n".join(["aaaaaaaaaaaa"] * 3 + ["aaabbbbbaaaa"] * 3 + ["aaaaaaaaaaaa"] * 2)
POINTS = np.array([[0.06, 0.08], [0.02, 0.03], [0.05, 0.035]])


def scene(a, b, top=None, modulus=2e5):
    """A soft block with an inclusion, pressed from above or squeezed by its top."""
    sides = {"bottom": "rigid"}
    if top is not None:
        sides["top"] = {"displacement": [0.0, top]}
    return Scene.from_drawing(
        DRAWN,
        legend={"a": "one", "b": "two"},
        cell_size=0.01,
        thickness=0.002,
        plane="stress",
        materials={
            "one": Material("one", 2e5, 0.3, rheology=a),
            "two": Material("two", modulus, 0.3, rheology=b),
        },
        sides=sides,
        loads=[{"cell": [5, 7], "force": [0.0, -2.0]}] if top is None else [],
        rule={"kind": "elastic"},
    )


def test_materials_that_take_the_same_time_follow_the_correspondence_principle():
    stiffer = ThreeElement(K_f=2e6, D_f=3e6, D_d=4e7)
    result = creep(scene(SOFT, stiffer, modulus=2e6), BITE, times=TIMES, tolerance=1e-5)
    assert result.body is None
    static = solve(scene(SOFT, stiffer, modulus=2e6))
    growth = 2e5 * SOFT.creep(force=BITE, times=TIMES, scheme="exact")
    np.testing.assert_allclose(result.growth, growth, atol=1e-5 * growth.max())
    moved = static.displacement_at(POINTS)
    np.testing.assert_allclose(
        result.displacement_at(POINTS, 2), growth[2] * moved, atol=1e-4 * np.abs(moved).max()
    )
    np.testing.assert_allclose(result.stress(1), result.static.cells().stress)
    left = result.work - result.stored - result.dissipated - result.numerical
    np.testing.assert_allclose(left, 0.0, atol=1e-12 * result.work.max())


def test_stepping_and_correspondence_agree(monkeypatch):
    times = TIMES[:3]
    short = creep(scene(SOFT, SOFT), BITE, times=times, step=0.1)
    monkeypatch.setattr("kaju.model.rheology.creeping.elastic_body", SteppedBody)
    stepped = creep(scene(SOFT, SOFT), BITE, times=times, step=0.1)
    assert short.growth is not None
    assert stepped.growth is None
    for record in range(3):
        scale = np.nanmax(np.abs(short.cell_displacement(record)))
        for query in ("displacement_at", "cell_displacement"):
            arguments = (POINTS, record) if query == "displacement_at" else (record,)
            np.testing.assert_allclose(
                getattr(stepped, query)(*arguments),
                getattr(short, query)(*arguments),
                atol=1e-8 * scale,
            )
        np.testing.assert_allclose(
            stepped.stress(record),
            short.stress(record),
            atol=1e-7 * np.nanmax(np.abs(short.stress(record))),
        )
    for name in ("work", "stored", "dissipated"):
        np.testing.assert_allclose(getattr(stepped, name), getattr(short, name), rtol=1e-6)


def test_a_squeezed_block_relaxes():
    squeezed = creep(scene(SOFT, SOFT, top=-0.001), BITE, times=TIMES, step=0.05)
    assert squeezed.growth is None
    # All materials are alike and the support leads: stresses fade as the element's force does.
    force = SOFT.relaxation(displacement=BITE, times=TIMES, scheme="exact")
    static = squeezed.static.cells().stress
    for record, fade in enumerate(force / SOFT.K_f):
        np.testing.assert_allclose(
            squeezed.stress(record), fade * static, atol=2e-4 * np.nanmax(np.abs(static))
        )
    np.testing.assert_allclose(
        squeezed.displacement_at(POINTS, 2),
        squeezed.static.displacement_at(POINTS),
        atol=1e-6 * 0.001,
    )


@pytest.mark.parametrize("scheme", ["backward_euler", "sdirk2"])
def test_elastic_materials_give_the_static_answer_at_once(scheme):
    body = scene(None, ThreeElement.spring(2e6), modulus=2e6)
    result = creep(body, BITE, times=[0.1, 0.2], step=0.05, scheme=scheme)
    static = solve(body, tolerance=1e-10).displacement_at(POINTS)
    np.testing.assert_allclose(result.displacement_at(POINTS, 1), static, rtol=1e-7)
    np.testing.assert_allclose(result.displacement_at(POINTS, 0), 0.5 * static, rtol=1e-7)
    assert np.all(result.dissipated == 0.0)
