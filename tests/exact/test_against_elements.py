"""Random pixel bodies lie between finite elements, which are too stiff, and cells.

At re-entrant corners both converge like h^2λ, λ about one half. Forces press squarely: a drag
along the surface has energy in a half cell that is not counted.
"""

from itertools import product

import numpy as np
import pytest

pytest.importorskip("skfem")

from scipy.ndimage import label
from spawning_bodies import drawn, laws

from kaju import finite_elements, solve

MATERIALS = laws((1.0, 0.3), (3.0, 0.2), (0.5, 0.4))


def random_body(seed, shape):
    """A body of pixels in one piece that stands on the ground and reaches the top."""
    rng = np.random.default_rng(seed)
    while True:
        kinds = rng.choice([0, 0, 0, 0, 1, 2, -1, -1], size=shape)
        solid = kinds >= 0
        parts, _ = label(solid)
        kinds[~np.isin(parts, np.setdiff1d(parts[..., 0], [0]))] = -1
        solid = kinds >= 0
        joined = label(solid)[1] == 1 and solid[..., -1].any()
        if joined and not touches_by_a_corner(solid):
            return kinds


def touches_by_a_corner(solid):
    """Whether cells meet at a corner or edge only: elements are joined there, cells are not."""
    for size in product((1, 2), repeat=solid.ndim):
        blocks = np.lib.stride_tricks.sliding_window_view(solid, size)
        if any(label(block)[1] > 1 for block in blocks.reshape(-1, *size)):
            return True
    return False


def as_scene(kinds, materials=MATERIALS, plane=None):
    """A scene of the body, pressed on the top face of the first cell that has one."""
    body = {} if plane is None else {"plane": plane, "thickness": 1.0}
    cell = [*np.argwhere(kinds[..., -1] >= 0)[0].tolist(), kinds.shape[-1] - 1]
    load = {"cell": cell, "side": "top", "force": [0.0] * (kinds.ndim - 1) + [-1.0]}
    return drawn(kinds + 1, materials, [load], cell_size=1.0, **body)


def limit(values):
    """Aitken's extrapolation of the last three of a sequence."""
    first, second, third = values[-3:]
    return third - (third - second) ** 2 / ((third - second) - (second - first))


def bracket(kinds, plane, splits, resolutions, close=None):
    """Answers of elements from below and of cells from above; return both rows of energies.

    If asked, displacements of cells come ever closer to those of the finest elements.
    """
    scene = as_scene(kinds, plane=plane)
    elements = [finite_elements(scene, split=k) for k in splits]
    cells = [solve(scene, resolution=k) for k in resolutions]
    below, above = ([answer.strain_energy for answer in row] for row in (elements, cells))
    assert np.all(np.diff(below) > 0)
    assert np.all(np.diff(above) < 0)
    if close is not None:
        points = np.argwhere(kinds >= 0) + 0.5
        finest = elements[-1].displacement_at(points)
        apart = [np.abs(answer.displacement_at(points) - finest).max() for answer in cells]
        assert np.all(np.diff(apart) < 0)
        assert apart[-1] < close * np.abs(finest).max()
    return below, above


@pytest.mark.parametrize(
    ("seed", "plane"),
    [(0, "strain"), (7, "stress")]
    + [pytest.param(seed, "strain", marks=pytest.mark.slow) for seed in range(8, 30)],
)
def test_plane_bodies_agree_with_elements(seed, plane):
    kinds = random_body(seed, (6, 5))
    below, above = bracket(kinds, plane, (2, 4, 8), (4, 8, 16, 32), close=0.02)
    assert above[-1] > limit(below)
    assert limit(above) == pytest.approx(limit(below), rel=3e-3)


@pytest.mark.parametrize(("seed", "plane"), [(0, "stress"), (1, "strain"), (2, "stress")])
def test_blocks_of_several_materials_are_bracketed(seed, plane):
    kinds = np.random.default_rng(seed).choice([0, 0, 1, 2], size=(5, 4))
    below, above = bracket(kinds, plane, (1, 2, 4), (2, 4, 8, 16))
    assert above[-1] > limit(below)
    assert limit(above) == pytest.approx(limit(below), rel=1e-3)


def test_rubber_does_not_lock():
    kinds = np.zeros((6, 5), int)
    kinds[2:5, 2] = kinds[0, 3:] = -1
    scene = as_scene(kinds, laws((1.0, 0.499)), "strain")
    truth = limit([finite_elements(scene, split=k).strain_energy for k in (4, 8, 16)])
    for split in (2, 4, 8, 16):
        locked = finite_elements(scene, split=split, order=1).strain_energy / truth - 1
        cells = solve(scene, resolution=split).strain_energy / truth - 1
        assert locked < -min(0.4, 1.2 / split)
        assert 0 < cells < 0.4 / split**1.6
