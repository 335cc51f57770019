"""Equations of blocks that share unknowns; squares of equal leaves are condensed first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of

from .square_leaves import SquareLeaves

FEWEST = 4  # so many squares are worth a table
Blocks = list[tuple[Floats, Ints]]  # matrices, shape (n, k, k), and unknowns of each, shape (n, k)
_FOURTHS = 0.5 * np.array([(0, 0), (1, 0), (0, 1), (1, 1)])


class MergedSquares:
    """Static condensation of leaves with one matrix: fours are merged, again and again.

    `dofs` are the unknowns of each leaf, shape (leaves, k), `places` theirs in a unit square.
    """

    def __init__(self, leaves: SquareLeaves, matrix: Floats, dofs: Ints, places: Floats):
        self.blocks: Blocks = []  # of leaves and squares that are in no larger one
        self._steps: list[tuple[Ints, Ints, Floats, Floats]] = []
        while len(four := _four_in_one(leaves)) >= FEWEST:
            rest = np.setdiff1d(np.arange(len(leaves)), four)
            self.blocks.append((np.broadcast_to(matrix, (len(rest), *matrix.shape)), dofs[rest]))
            dofs, leaves = dofs[four], leaves.only(four[:, 0])
            leaves = SquareLeaves(leaves.x, leaves.y, 2 * leaves.size, leaves.shape)
            _, first, own = np.unique(dofs[0], return_index=True, return_inverse=True)
            own = own.reshape(dofs[0].shape)
            whole = np.zeros((len(first), len(first)))
            np.add.at(whole, (own[:, :, None], own[:, None]), matrix)
            places = (_FOURTHS[:, None] + 0.5 * places).reshape(-1, 2)[first]
            within = ((places > 0.0) & (places < 1.0)).all(axis=1)
            inner, rim = np.flatnonzero(within), np.flatnonzero(~within)
            dofs = dofs.reshape(len(dofs), -1)[:, first]
            inverse: Floats = np.asarray(np.linalg.inv(whole[np.ix_(inner, inner)]))
            lift = -inverse @ whole[np.ix_(inner, rim)]
            self._steps.append((dofs[:, inner], dofs[:, rim], inverse, lift))
            matrix = whole[np.ix_(rim, rim)] + whole[np.ix_(rim, inner)] @ lift
            dofs, places = dofs[:, rim], places[rim]
        self.blocks.append((np.broadcast_to(matrix, (len(dofs), *matrix.shape)), dofs))

    def free(self, fixed: Flags) -> Flags:
        """Tell which unknowns are neither fixed nor within a square."""
        free = ~fixed
        for inner, *_ in self._steps:
            free[inner] = False
        return free

    def on_rims(self, load: Floats) -> Floats:
        """Return the load with that inside of squares added to their rims."""
        load = load.copy()
        for inner, rim, _, lift in self._steps:
            np.add.at(load, rim, load[inner] @ lift)
        return load

    def move_inner(self, load: Floats, moved: Floats) -> None:
        """Set the displacement inside of squares by that of their rims and the load inside."""
        for inner, rim, inverse, lift in reversed(self._steps):
            moved[inner] = load[inner] @ inverse + moved[rim] @ lift.T


def _four_in_one(leaves: SquareLeaves) -> Ints:
    """Return fours of equal leaves that fill a square, in one order. Shape (n, 4)."""
    code, area = leaves.code, leaves.size**2
    order = np.argsort(code)
    # a square by its own Morton code and the size of its leaves, a power of two
    square = (code - code % (4 * area) + leaves.size)[order]
    alike = square[1:] == square[:-1]
    first = np.flatnonzero(alike[2:] & alike[1:-1] & alike[:-2])
    return np.asarray(order[first[:, None] + np.arange(4)])


def assembled(blocks: Blocks, count: int) -> sp.csc_array:
    """Return the matrix of all blocks."""
    small = [(part, dofs.astype(np.int32)) for part, dofs in blocks]
    rows = [np.broadcast_to(at[:, :, None], part.shape).ravel() for part, at in small]
    columns = [np.broadcast_to(at[:, None], part.shape).ravel() for part, at in small]
    values = np.concatenate([part.ravel() for part, _ in blocks])
    places = np.concatenate(rows), np.concatenate(columns)
    return sp.csc_array((values, places), shape=(count, count))


def joined(blocks: Blocks, fixed: Flags, merged: MergedSquares) -> Callable[[Floats], Floats]:
    """Return a function from loads to displacements of blocks and merged squares together."""
    free = merged.free(fixed)
    still = np.flatnonzero(~free)[:, None]
    blocks = [*blocks, *merged.blocks, (np.ones((len(still), 1, 1)), still)]
    matrix = assembled(blocks, len(fixed))
    scale = np.where(free, matrix.diagonal(), np.inf) ** -0.5
    matrix.data *= scale[matrix.indices] * np.repeat(scale, np.diff(matrix.indptr))
    matrix.setdiag(1.0)
    factors = factors_of(matrix)

    def moved(load: Floats) -> Floats:
        rim = merged.on_rims(load)
        out = np.asarray(scale * factors.solve(scale * rim))
        merged.move_inner(rim, out)
        return out

    return moved
