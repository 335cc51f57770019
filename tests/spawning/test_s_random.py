"""Random bodies of three materials with holes, however they are held and loaded."""

import numpy as np
import pytest
from scipy.ndimage import label
from spawning_bodies import spawned_by

from kaju import Scene
from kaju.errors import ConvergenceError, SupportError


def random_scene(seed):
    rng = np.random.default_rng(seed)
    d = 2 if seed % 3 else 3
    codes = rng.choice([0, 1, 1, 1, 1, 2, 3], size=rng.integers(4, 9 if d == 2 else 5, size=d))
    codes[..., 0] = 1
    parts, _ = label(codes > 0)
    codes[~np.isin(parts, np.unique(parts[..., 0][codes[..., 0] > 0]))] = 0
    for axis in range(d):
        codes = codes.repeat(2, axis=axis)
    sides = {"bottom": "rigid"}
    if rng.random() < 0.5:
        sides["left"] = "roller"
    if rng.random() < 0.5:
        sides["right"] = {"stiffness": 1e9}
    body = np.argwhere(codes > 0)
    chosen = body[rng.integers(len(body), size=3)]
    forces = rng.normal(size=(3, d))
    stiff, ratio = 10.0 ** rng.uniform(7, 11, size=3), rng.uniform(-0.4, 0.45, size=3)
    return Scene.from_array(
        codes,
        legend={0: "air", 1: "a", 2: "b", 3: "c"},
        cell_size=1.0,
        materials={
            name: {"youngs_modulus": float(e), "poissons_ratio": float(v)}
            for name, e, v in zip("abc", stiff, ratio, strict=True)
        },
        sides=sides,
        loads=[
            {"cell": list(map(int, cell)), "force": list(map(float, force))}
            for cell, force in zip(chosen, forces, strict=True)
        ],
    )


@pytest.mark.parametrize("seed", range(12))
def test_forces_balance_and_work_is_energy(seed):
    scene = random_scene(seed)
    try:
        result = spawned_by(scene, tolerance=0.3 if seed % 3 else 0.5, most_agents=20_000)
    except SupportError:
        pytest.fail("a body that stands on the ground was refused")
    force = scene.applied().force
    total = force.sum(axis=0) + sum(result.reactions.values())
    assert np.abs(total).max() < 1e-9 * np.abs(force).sum()
    balance = result.found.spawning.balance
    work = balance.load @ result.found.spawning.displacement
    assert result.found.spawning.energy == pytest.approx(0.5 * work, rel=1e-7)


@pytest.mark.parametrize("most_agents", [1_000, 8_000])
def test_voxels_of_great_contrast_balance_though_far_from_the_tolerance(most_agents):
    """Stiff voxels that touch along edges are nearly hinged: no agents are small enough."""
    rng = np.random.default_rng(0)
    codes = rng.choice([0, 1, 2], p=[0.1, 0.5, 0.4], size=[4, 4, 4]).repeat(2, 0).repeat(2, 1)
    codes = codes.repeat(2, axis=2)
    codes[..., 0] = 1
    parts, _ = label(codes > 0)
    codes[parts != parts[0, 0, 0]] = 0
    scene = Scene.from_array(
        codes,
        legend={0: "air", 1: "a", 2: "b"},
        cell_size=1.0,
        materials={
            "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
            "b": {"youngs_modulus": 1e4, "poissons_ratio": 0.3},
        },
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, 0.0, -1.0]}],
    )
    with pytest.raises(ConvergenceError, match="most_agents") as caught:
        spawned_by(scene, tolerance=0.1, most_agents=most_agents)
    result = caught.value.best
    np.testing.assert_allclose(result.reactions["bottom"], [0.0, 0.0, 1.0], atol=1e-7)
    energies = [generation.energy for generation in result.generations]
    assert np.all(np.diff(energies) < 0.02 * energies[0])
