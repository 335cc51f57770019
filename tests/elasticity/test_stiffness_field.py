"""A field of relative stiffness: as materials would be, scaled as it scales, its energies exact."""

import numpy as np
import pytest
from stored_files import rewritten

import kaju
from kaju.errors import ParameterError, ResultError, SceneError

LIME = {"youngs_modulus": 1e9, "poissons_ratio": 0.0}
HALF = LIME | {"youngs_modulus": 5e8}


def body(codes, **changes):
    parts = {
        "legend": {0: "air", 1: "lime", 2: "half"},
        "materials": {"lime": LIME, "half": HALF},
        "cell_size": 0.01,
        "thickness": 0.02,
        "sides": {"left": "rigid"},
        "loads": [{"side": "right", "force": [100.0, 0.0]}],
    }
    return kaju.Scene.from_array(codes, **parts | changes)


def codes_with_a_notch():
    codes = np.ones((8, 6), dtype=int)
    codes[5:, 5] = 0
    codes[2:4, 1:4] = 2
    return codes


FULL, NOTCHED = body(np.ones((8, 6), dtype=int)), body(np.minimum(codes_with_a_notch(), 1))


def test_a_bar_of_graded_stiffness_stretches_by_the_sum_of_its_compliances():
    stiffness = np.repeat(np.linspace(0.2, 2.0, 6)[:, None], 3, axis=1)
    bar = body(np.ones((6, 3), dtype=int), sides={"left": "roller", "bottom": "roller"})
    answer = kaju.solve(bar, stiffness=stiffness)
    stress = 100.0 / (0.03 * 0.02)
    stretched = np.cumsum(stress / (1e9 * stiffness[:, 0])) * 0.01
    ends = answer.displacement_at([(0.01 * k, 0.01) for k in range(1, 7)])[:, 0]
    np.testing.assert_allclose(ends, stretched, rtol=1e-9)
    energies = 0.5 * stress**2 / (1e9 * stiffness) * 0.01**2 * 0.02
    np.testing.assert_allclose(answer.energy, energies.ravel(), rtol=1e-9)
    np.testing.assert_allclose(answer.strain[:, 0, 0], stress / (1e9 * stiffness).ravel())


def test_a_field_is_as_two_materials():
    codes = codes_with_a_notch()
    two = kaju.solve(body(codes))
    one = kaju.solve(body(np.minimum(codes, 1)), stiffness=np.where(codes == 2, 0.5, 1.0))
    for name in ("displacement", "stress", "strain", "von_mises", "energy"):
        found, wanted = getattr(one, name), getattr(two, name)
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12 * np.abs(wanted).max())
    assert one.energy_bounds is None
    points = two.middle[two.material == 1] + 0.002
    np.testing.assert_allclose(one.strain_at(points), two.strain_at(points), atol=1e-12)
    assert set(one.material) == {0}
    np.testing.assert_array_equal(one.stiffness, np.where(two.material == 1, 0.5, 1.0))
    finer = kaju.solve(two.scene, resolution=2).strain_energy
    refined = kaju.solve(one.scene, resolution=2, stiffness=np.where(codes == 2, 0.5, 1.0))
    assert refined.strain_energy == pytest.approx(finer, rel=1e-9)


@pytest.mark.parametrize("cell", [(0, 0), (4, 4), (7, 3)])
def test_energies_are_the_derivative_by_the_stiffness(cell):
    stiffness = np.random.default_rng(1).uniform(0.05, 1.0, (8, 6))
    answer = kaju.solve(NOTCHED, stiffness=stiffness)
    assert answer.energy.sum() == pytest.approx(answer.strain_energy, rel=1e-12)
    place = np.flatnonzero((answer.found.cells == cell).all(axis=1))[0]
    energies = []
    for factor in (1.0 - 1e-4, 1.0 + 1e-4):
        changed = stiffness.copy()
        changed[cell] *= factor
        energies.append(kaju.solve(NOTCHED, stiffness=changed).strain_energy)
    slope = (energies[1] - energies[0]) / (2e-4 * stiffness[cell])
    assert slope == pytest.approx(-answer.energy[place] / stiffness[cell], rel=1e-5)


def test_a_loop_starts_from_the_answer_before():
    scene = body(np.ones((40, 24), dtype=int), loads=[{"side": "right", "force": [0.0, -100.0]}])
    stiffness = np.where(np.hypot(*(np.indices((40, 24)) - 12)) < 6, 0.01, 1.0)
    first = kaju.solve(scene, stiffness=stiffness)
    changed = stiffness * np.linspace(0.8, 1.0, 24)
    afresh = kaju.solve(scene, stiffness=changed)
    loose = kaju.solve(scene, 1e-2, stiffness=changed, previous=first)
    tight = kaju.solve(scene, 1e-10, stiffness=changed, previous=first)
    assert loose.found.solution.method == tight.found.solution.method == "Galerkin multigrid"
    assert len(loose.residuals) < len(tight.residuals)
    assert loose.strain_energy == pytest.approx(afresh.strain_energy, rel=2e-4)
    assert tight.strain_energy == pytest.approx(afresh.strain_energy, rel=1e-9)


def test_it_is_stored(tmp_path):
    codes = codes_with_a_notch()
    answer = kaju.solve(body(codes), stiffness=np.linspace(0.1, 1.0, 48).reshape(8, 6))
    again = kaju.load_result(answer.save(tmp_path / "answer"))
    np.testing.assert_array_equal(again.energy, answer.energy)
    np.testing.assert_array_equal(again.stiffness, answer.stiffness)
    rewritten(tmp_path / "answer.npz", lambda arrays, _: arrays["found.factor"].put(0, 0.0))
    with pytest.raises(ResultError, match="'factor' must be above 0"):
        _ = kaju.load_result(tmp_path / "answer.npz").grid


@pytest.mark.parametrize("wrong", [np.ones((6, 8)), np.ones(48), -np.ones((8, 6)), "soft", 1.0])
def test_a_field_that_breaks_a_rule_is_named(wrong):
    with pytest.raises(ParameterError, match=r"^stiffness: "):
        kaju.solve(FULL, stiffness=wrong)


def test_more_materials_than_kinds_are_refused_by_name():
    count = (1 << 15) + 1
    codes = np.arange(count).reshape(count, 1)
    names = {number: f"m{number}" for number in range(count)}
    with pytest.raises(SceneError, match=r"^materials: .*stiffness=array"):
        body(codes, legend=names)
