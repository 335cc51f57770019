"""Load transfer by a prescribed rule in time: each agent creeps under its own load."""

from dataclasses import replace

import numpy as np
import pytest

from kaju.agents.materials import Material
from kaju.model.rheology.creeping import creep
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene

SOFT = ThreeElement(K_f=2e5, D_f=3e5, D_d=4e6)
TIMES = np.array([0.2, 3.0, 5.2, 6.0, 25.3])
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)

DRAWN = """
aaaaaaaa
aaaaaaaa
bbbbbbbb
bbbbbbbb
"""


def scene(a, b):
    """Two layers on rigid ground, pressed in the middle."""
    materials = {
        "one": Material("one", 2e5, 0.3, rheology=a),
        "two": Material("two", 1e6, 0.2, rheology=b),
    }
    return Scene.from_drawing(
        DRAWN.strip(),
        legend={"a": "one", "b": "two"},
        cell_size=0.01,
        thickness=0.002,
        materials=materials,
        sides={"bottom": "rigid"},
        loads=[{"cell": [4, 3], "force": [0.0, -2.0]}],
        rule={"kind": "prescribed", "threshold": 0.01},
    )


def test_one_material_follows_the_correspondence_principle():
    like_soft = replace(SOFT, K_f=1e6, D_f=1.5e6, D_d=2e7)
    result = creep(scene(SOFT, like_soft), BITE, times=TIMES, tolerance=1e-5)
    growth = 2e5 * SOFT.creep(force=BITE, times=TIMES, scheme="exact")
    points = np.array([[0.045, 0.035], [0.02, 0.01]])
    static = result.static.displacement_at(points)
    assert np.abs(static).max() > 0.0
    for record, grown in enumerate(growth):
        np.testing.assert_allclose(
            result.displacement_at(points, record), grown * static, atol=2e-5 * np.abs(static).max()
        )


def test_every_material_takes_its_own_time():
    result = creep(scene(SOFT, None), BITE, times=TIMES, tolerance=1e-5)
    of_soft = 2e5 * SOFT.creep(force=BITE, times=TIMES, scheme="exact")
    np.testing.assert_allclose(result.growth[:, 0], of_soft, atol=1e-5)
    np.testing.assert_allclose(result.growth[:, 1], BITE.at(TIMES), atol=1e-12)
    lower = result.static.last.material == 1
    np.testing.assert_allclose(result.strain(-1)[lower], 0.0, atol=1e-15)
    assert np.abs(result.strain(-1)[~lower]).max() > 0.0
    np.testing.assert_allclose(result.stress(1), result.static.stress)
    assert result.displacement(1).shape == result.static.displacement.shape


@pytest.mark.parametrize("scheme", ["sdirk2", "backward_euler"])
def test_work_is_stored_dissipated_or_the_schemes_own(scheme):
    result = creep(scene(SOFT, None), BITE, times=TIMES, step=0.05, scheme=scheme)
    left = result.work - result.stored - result.dissipated - result.numerical
    np.testing.assert_allclose(left, 0.0, atol=1e-12 * result.work.max())
    assert np.all(np.diff(result.dissipated) >= 0.0)


def test_elastic_agents_store_the_energy_of_their_own_squeeze():
    result = creep(scene(None, None), History.step(), 1.0, times=[1.0], step=1.0)
    modulus = np.array([2e5, 1e6])[result.static.last.material]
    squared = np.einsum("nij,nij->n", result.static.stress, result.static.stress)
    expected = np.sum(0.5 * squared / modulus * 0.01**2 * 0.002)
    assert result.stored[0] == pytest.approx(expected, rel=1e-12)


def test_a_run_taken_up_again_gives_the_same_numbers():
    unbroken = creep(scene(SOFT, None), BITE, times=TIMES)
    first = creep(scene(SOFT, None), BITE, 5.2, times=TIMES[:3])
    second = creep(scene(SOFT, None), BITE, times=TIMES[3:], resume=first.state)
    np.testing.assert_array_equal(second.growth, unbroken.growth[3:])


def test_a_scene_keeps_its_rheology_when_written():
    written = scene(SOFT, None)
    again = Scene.from_toml(written.to_toml())
    assert again.cell_materials[0].rheology == SOFT
    assert again.cell_materials[1].rheology is None
