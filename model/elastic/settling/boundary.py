"""Where the body ends: which cells hold it, and which air gives shares back.

A face at a free surface has nobody ahead. Its forward share comes straight back, it yields
to it again, and again: P/k·(1 + c/k + c²/k² + ...) = P/(k − c), with c the stiffness that
is missing. So at a free surface an agent simply has the smaller stiffness k − c; each time
it yields by δ the boundary agent has given back cδ.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats, Ints, moved
from kaju.model.elastic.problem import ElasticProblem
from kaju.model.elastic.staggered import axis_pairs, edge_modulus
from kaju.model.scene.kinds import AIR, FOUNDATION, RIGID, ROLLER


class Boundary:
    """Cells that are not body, and what each is to the faces beside it.

    `cells` are counted from the arrays' first cell without the rim; `links` says how much of each
    column belongs to each cell.
    """

    def __init__(
        self,
        problem: ElasticProblem,
        cells: Ints,
        column: Ints,
        weight: Floats,
        columns: int,
    ) -> None:
        shape = problem.kinds.shape
        key = np.ravel_multi_index(tuple(cells.T), shape) if len(cells) else np.empty(0, np.int64)
        distinct, row = np.unique(key, return_inverse=True)
        self.cells = np.stack(np.unravel_index(distinct, shape), axis=1).astype(np.int64) - 1
        self.links = sp.csr_array((weight, (row, column)), shape=(len(distinct), columns))

    def first(self, step: Ints) -> Ints:
        """Return the earliest step among each cell's columns; 0 where none has one."""
        never = np.iinfo(np.int64).max
        first = np.full(len(self.cells), never)
        row = np.repeat(np.arange(len(self.cells)), np.diff(self.links.indptr))
        awake = np.where(step > 0, step, never)[self.links.indices]
        np.minimum.at(first, row, awake)
        return np.where(first == never, 0, first)


def supports(
    problem: ElasticProblem, fixed: tuple[Ints, Ints], bedded: tuple[Ints, Ints]
) -> Boundary:
    """Return the cells that hold the body; columns are held faces, then bedded ones."""
    # A held face between two rigid cells is shared by them.
    cells, column, weight = [], [], []
    start = 0
    for (axis, index), kinds in ((fixed, (RIGID, ROLLER)), (bedded, (FOUNDATION,))):
        low = index.copy()
        low[np.arange(len(axis)), axis] -= 1
        holds = [np.isin(problem.kinds[tuple(side.T)], kinds) for side in (low, index)]
        count = holds[0].astype(np.float64) + holds[1]
        for side, chosen in zip((low, index), holds, strict=True):
            cells.append(side[chosen])
            column.append(start + np.flatnonzero(chosen))
            weight.append(1.0 / count[chosen])
        start += len(axis)
    return Boundary(
        problem, np.concatenate(cells), np.concatenate(column), np.concatenate(weight), start
    )


def free_surfaces(problem: ElasticProblem, faces: tuple[Ints, Ints], stiffness: Floats) -> Boundary:
    """Return the air beside the body; columns are faces, entries the shares given back."""
    # `faces` are axis and index of those that can move, with their (scaled) stiffness.
    axis, index = faces
    cells, column, missing = [], [], []
    for at, beyond, modulus in (*_ahead(problem, axis, index), *_beside(problem, axis, index)):
        cells.append(beyond)
        column.append(at)
        missing.append(modulus / stiffness[at])
    return Boundary(
        problem, np.concatenate(cells), np.concatenate(column), np.concatenate(missing), len(axis)
    )


Missing = tuple[Ints, Ints, Floats]
"""Faces, the air cells beside them, and the stiffness that is missing there."""


def _ahead(problem: ElasticProblem, axis: Ints, index: Ints) -> list[Missing]:
    """Return the air ahead of faces: there C₁₁ of the cell behind is missing."""
    low = index.copy()
    low[np.arange(len(axis)), axis] -= 1
    found = []
    for here, beyond in ((low, index), (index, low)):
        kind = problem.kinds[tuple(here.T)]
        at = np.flatnonzero(problem.kinds[tuple(beyond.T)] == AIR)
        found.append((at, beyond[at], problem.moduli.stretch[kind[at]]))
    return found


def _beside(problem: ElasticProblem, axis: Ints, index: Ints) -> list[Missing]:
    """Return the air round the corners (edges) of faces, by which friction is lowered."""
    compliance = np.append(1.0 / problem.moduli.shear, 0.0)
    found = []
    for pair in axis_pairs(problem.dimension):
        modulus = edge_modulus(problem, pair)
        for along, across in (pair, pair[::-1]):
            faces = np.flatnonzero(axis == along)
            for upper in (0, 1):
                edge = moved(index[faces], across, upper)
                steps = product((0, -1), repeat=2)
                around = [moved(moved(edge, across, b), along, a) for b, a in steps]
                kinds = np.stack([problem.kinds[tuple(cell.T)] for cell in around])
                counted = (kinds >= 0) | (kinds == RIGID)
                total = np.where(kinds >= 0, compliance[np.maximum(kinds, -1)], 0.0).sum(axis=0)
                whole = counted.sum(axis=0) / total
                air = kinds == AIR
                share = (whole - modulus[tuple(edge.T)]) / np.maximum(air.sum(axis=0), 1)
                for cell, open_ in zip(around, air, strict=True):
                    found.append((faces[open_], cell[open_], share[open_]))
    return found
