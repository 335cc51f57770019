"""Networks of points thrown into a box, which no builder of kaju's makes."""

import numpy as np
from scipy.spatial import Delaunay, KDTree

from kaju import SpringNetwork


def scattered(nodes, dimension=2, seed=0, force=0.1):
    """Points in a box of 1 m, joined where they lie close; held below, pressed from above."""
    ball = np.pi if dimension == 2 else 4.0 * np.pi / 3.0
    radius = float((10.0 / (nodes * ball)) ** (1.0 / dimension))
    positions = np.random.default_rng(seed).random((nodes, dimension))
    close = KDTree(positions).query_pairs(radius, output_type="ndarray")
    corners = Delaunay(positions).simplices.astype(np.int64)
    first, second = np.triu_indices(dimension + 1, 1)
    edges = np.stack([corners[:, first].ravel(), corners[:, second].ravel()], axis=1)
    springs = np.unique(np.sort(np.concatenate([close, edges]), axis=1), axis=0)
    by_height = np.argsort(positions[:, -1])
    tenth = max(nodes // 10, dimension)
    held = np.zeros(nodes, dtype=bool)
    held[by_height[:tenth]] = True
    forces = np.zeros_like(positions)
    forces[by_height[-tenth:], -1] = -force / tenth
    return SpringNetwork.build(positions, springs, held=held, forces=forces)
