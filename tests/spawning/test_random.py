"""Random bodies of three materials with holes, however they are held and loaded."""

import numpy as np
from scipy.ndimage import label
from spawning_bodies import drawn

from kaju import SpawningModel


def test_voxels_of_great_contrast_balance_though_far_from_the_tolerance():
    """Stiff voxels that touch along edges are nearly hinged: no agents are small enough."""
    rng = np.random.default_rng(0)
    codes = rng.choice([0, 1, 2], p=[0.1, 0.5, 0.4], size=[4, 4, 4]).repeat(2, 0).repeat(2, 1)
    codes = codes.repeat(2, axis=2)
    codes[..., 0] = 1
    parts, _ = label(codes > 0)
    codes[parts != parts[0, 0, 0]] = 0
    materials = [{"youngs_modulus": e, "poissons_ratio": 0.3} for e in (1e9, 1e4)]
    load = {"side": "top", "force": [0.0, 0.0, -1.0]}
    scene = drawn(codes, materials, [load], cell_size=1.0)
    result = SpawningModel(scene, tolerance=0.1, most_agents=1_000).run()
    assert result.tolerance_kept == "missed"
    np.testing.assert_allclose(result.reactions["bottom"], [0.0, 0.0, 1.0], atol=1e-3)
    energies = [generation.energy for generation in result.generations]
    assert np.all(np.diff(energies) > 0.0), "each is a lower bound"
