"""Displacement and stress at any point of a body."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from .problem import Floats
from .staggered import Pair, Strains

Index = NDArray[np.int64]


def at_nodes(nodes: Floats, cells: Index, local: Floats) -> Floats:
    """Interpolate linearly between the nodes of the cell that each point lies in.

    Parameters
    ----------
    nodes : array, shape (n + 1 along every axis, components)
    cells : int array, shape (points, dimension)
    local : array, shape (points, dimension)
        Place within the cell, 0 to 1 along every axis.
    """
    total: Floats = np.zeros((len(cells), nodes.shape[-1]))
    for corner in product((0, 1), repeat=cells.shape[1]):
        weight = np.prod(np.where(corner, local, 1.0 - local), axis=1)
        total += weight[:, None] * nodes[tuple((cells + corner).T)]
    return total


def stress_at(parts: Strains, kinds: NDArray[np.int32], cells: Index, local: Floats) -> Floats:
    """Return stress tensors at points, shape (points, dimension, dimension).

    Normal stresses run linearly from the cell's middle, by the differences to neighbours
    of the same material; shear stresses between the cell's edges.
    """
    d = cells.shape[1]
    tensor = np.zeros((len(cells), d, d))
    for axis in range(d):
        tensor[:, axis, axis] = _along_slopes(parts.cells[axis], kinds, cells, local)
    for (a, b), tau in parts.edges.items():
        tensor[:, a, b] = tensor[:, b, a] = _between_edges(tau, (a, b), cells, local)
    return tensor


def _between_edges(tau: Floats, pair: Pair, cells: Index, local: Floats) -> Floats:
    total: Floats = np.zeros(len(cells))
    for first, second in product((0, 1), repeat=2):
        at = cells.copy()
        at[:, pair[0]] += first
        at[:, pair[1]] += second
        a, b = local[:, pair[0]], local[:, pair[1]]
        total += np.where(first, a, 1 - a) * np.where(second, b, 1 - b) * tau[tuple(at.T)]
    return total


def _along_slopes(stress: Floats, kinds: NDArray[np.int32], cells: Index, local: Floats) -> Floats:
    own, kind = stress[tuple(cells.T)], kinds[tuple(cells.T)]
    total: Floats = own.copy()
    for axis in range(cells.shape[1]):
        rise, count = np.zeros(len(cells)), np.zeros(len(cells))
        for step in (-1, 1):
            at = cells.copy()
            at[:, axis] = np.clip(at[:, axis] + step, 0, kinds.shape[axis] - 1)
            there = tuple(at.T)
            alike = (kinds[there] == kind) & (at[:, axis] != cells[:, axis])
            rise += np.where(alike, step * (stress[there] - own), 0.0)
            count += alike
        total += (local[:, axis] - 0.5) * rise / np.maximum(count, 1)
    return total
