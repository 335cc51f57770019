"""A triangular lattice of springs between two points: nodes, supports and matrix.

Run `run.py` for the pictures; MODEL.md tells what there is to see.
"""

from __future__ import annotations

import numpy as np

from kaju import NetworkResult, SpringNetwork
from kaju.errors import SupportError
from kaju.model.network import solve, triangular

FORCE = 0.1  # From above and from below (N), for springs of 1 N/m and 1 m

SHAPES = ((5, 9), (9, 5), (17, 17))  # Nodes in a long row, and rows: tall, wide, and large

NODES = (3, 5, 9, 17, 33)  # Rows of nodes that make up the same body, ever closer together


def pressed(width: int, rows: int) -> NetworkResult:
    """Return a lattice pressed between two points."""
    return solve(triangular(width, rows, force=FORCE))


def same_body(rows: int, force: float = 0.02) -> NetworkResult:
    """Return a body of 4 m by 3.46 m made of some rows of nodes, pressed lightly.

    A triangular lattice is as stiff as a sheet with E t = 2K/√3, however far its nodes lie
    apart: so the springs stay the same, and only the nodes come closer.
    """
    return solve(triangular(rows, rows, spacing=4.0 / (rows - 1), force=force))


def free_motions(network: SpringNetwork) -> int:
    """Return in how many ways the nodes can move, all held ones let go, at no force.

    By the rank of the compatibility matrix, which has a row for each spring: how its length
    grows with small displacements of its two nodes.
    """
    first, second = network.springs.T
    along = network.positions[second] - network.positions[first]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    growth = np.zeros((len(along), *network.positions.shape))
    growth[np.arange(len(along)), first] = -along
    growth[np.arange(len(along)), second] = along
    rank = np.linalg.matrix_rank(growth.reshape(len(along), -1))
    return int(network.positions.size - rank)


def without_supports(width: int = 5) -> str:
    """Return what is said of a lattice that nothing holds."""
    held = triangular(width, force=FORCE)
    try:
        SpringNetwork.build(held.positions, held.springs, held.stiffness, forces=held.forces[-1])
    except SupportError as error:
        return str(error)
    raise AssertionError("a lattice that nothing holds has no unique answer")
