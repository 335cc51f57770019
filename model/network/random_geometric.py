"""Networks between points thrown at random."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, KDTree

from kaju.errors import ParameterError

from .lattices import at_least, positive
from .springs import SpringNetwork


def random_geometric(
    nodes: int,
    *,
    dimension: int = 2,
    seed: int = 0,
    radius: float | None = None,
    stiffness: float = 1.0,
    force: float = 0.1,
) -> SpringNetwork:
    """Return points thrown into a box of edge 1 m, joined where they lie close.

    Points closer than `radius` are joined, and so are the neighbours of a Delaunay
    triangulation, without which chance would leave loose points. The lowest tenth of the
    points is held, and the force is shared by the highest tenth.

    Parameters
    ----------
    nodes : int
        Number of points, at least 20.
    dimension : int
        2 or 3.
    seed : int
        Start of the random numbers; the same seed gives the same network.
    radius : float, optional
        Distance (m) up to which points are joined; None: so that an inner point has about 10
        others within it.
    stiffness : float
        K of every spring (N/m).
    force : float
        Total force from above (N).

    Raises
    ------
    ParameterError
        If a number is outside its rule.
    """
    at_least(nodes, 20, "nodes")
    if dimension not in (2, 3):
        raise ParameterError(f"dimension: must be 2 or 3, got {dimension}")
    if radius is None:
        ball = np.pi if dimension == 2 else 4.0 * np.pi / 3.0
        radius = float((10.0 / (nodes * ball)) ** (1.0 / dimension))
    positive(radius, "radius")
    positions = np.random.default_rng(seed).random((nodes, dimension))
    close = KDTree(positions).query_pairs(radius, output_type="ndarray")
    corners = Delaunay(positions).simplices
    first, second = np.triu_indices(dimension + 1, 1)
    neighbours = np.stack([corners[:, first].ravel(), corners[:, second].ravel()], axis=1)
    springs = np.unique(np.sort(np.concatenate([close, neighbours]), axis=1), axis=0)
    by_height = np.argsort(positions[:, -1])
    tenth = max(nodes // 10, dimension)
    low, high = by_height[:tenth], by_height[-tenth:]
    held = np.zeros(nodes, dtype=bool)
    held[low] = True
    forces = np.zeros_like(positions)
    forces[high, -1] = -force / tenth
    return SpringNetwork.build(positions, springs, stiffness, held=held, forces=forces)
