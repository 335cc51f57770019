"""Equations of blocks that share unknowns: squares of equal leaves first, then all at once."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of

from .square_leaves import SquareLeaves, along_curve

EDGES = 4, 2
"""Leaves along the edge of a square, the larger squares first."""
FEWEST = 16
"""So many squares are worth a table."""


class CondensedSquares:
    """Squares that are alike: what is within by what is on the rim.

    Parameters
    ----------
    dofs : array of int, shape (n, leaves, k)
        Unknowns of the leaves of each square, in one order throughout.
    matrix : array, shape (k, k)
        Of a leaf.
    """

    def __init__(self, dofs: Ints, matrix: Floats):
        _, place, own, count = np.unique(
            dofs[0], return_index=True, return_inverse=True, return_counts=True
        )
        own = own.reshape(dofs[0].shape)
        whole = np.zeros((len(place), len(place)))
        np.add.at(whole, (own[:, :, None], own[:, None]), matrix)
        inner, rim = np.flatnonzero(count == 2), np.flatnonzero(count == 1)
        self.inner, self.rim = (dofs.reshape(len(dofs), -1)[:, place[at]] for at in (inner, rim))
        self._inverse = np.linalg.inv(whole[np.ix_(inner, inner)])
        self._lift = -self._inverse @ whole[np.ix_(inner, rim)]
        self.matrix = whole[np.ix_(rim, rim)] + whole[np.ix_(rim, inner)] @ self._lift

    def load_rim(self, load: Floats) -> None:
        """Add what the load within does on the rim."""
        np.add.at(load, self.rim, load[self.inner] @ self._lift)

    def move_inner(self, load: Floats, moved: Floats) -> None:
        """Set what moves within, by the load there and by what the rim moves."""
        moved[self.inner] = load[self.inner] @ self._inverse + moved[self.rim] @ self._lift.T


def squares_of(leaves: SquareLeaves, edge: int) -> Ints:
    """Return the leaves of full squares of equal ones, shape (n, edge²), each in one order."""
    place, area = along_curve(leaves.x, leaves.y), leaves.size**2
    order = np.argsort(place)
    # no two squares of unlike leaves have the same: sizes are powers of 2
    square = (place - place % (edge**2 * area) + leaves.size)[order]
    _, which, count = np.unique(square, return_inverse=True, return_counts=True)
    held = np.flatnonzero(count[which] == edge**2)
    return order[held[np.argsort(which[held], kind="stable")]].reshape(-1, edge**2)


class JoinedBlocks:
    """Displacements of shared unknowns by the forces on them, by one sparse factorisation.

    Parameters
    ----------
    blocks : list of (array, array)
        Matrices of shape (n, k, k), and unknowns of shape (n, k).
    fixed : array of bool
        Unknowns that do not move.
    equal : (leaves, matrix of one, unknowns of each)
        Further blocks that are alike, of which squares are made.
    """

    def __init__(
        self,
        blocks: list[tuple[Floats, Ints]],
        fixed: Flags,
        equal: tuple[SquareLeaves, Floats, Ints],
    ):
        self._squares: list[CondensedSquares] = []
        leaves, matrix, dofs = equal
        for edge in EDGES:
            found = squares_of(leaves, edge)
            if len(found) >= FEWEST:
                square = CondensedSquares(dofs[found], matrix)
                self._squares.append(square)
                rest = np.setdiff1d(np.arange(len(leaves)), found)
                leaves, dofs = leaves.only(rest), dofs[rest]
        alike = [(matrix, dofs), *((square.matrix, square.rim) for square in self._squares)]
        blocks = blocks + [(np.broadcast_to(m, (len(at), *m.shape)), at) for m, at in alike]
        still = fixed.copy()
        for square in self._squares:
            still[square.inner] = True
        diagonal = np.zeros(len(fixed))
        for part, dofs in blocks:
            np.add.at(diagonal, dofs, np.einsum("nii->ni", part))
        self._scale = np.zeros(len(fixed))
        self._scale[~still] = diagonal[~still] ** -0.5
        alone = np.flatnonzero(still)
        rows, columns, values = [alone], [alone], [np.ones(len(alone))]
        for part, dofs in blocks:
            rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
            columns.append(np.tile(dofs, (1, dofs.shape[1])).ravel())
            scale = self._scale[dofs]
            values.append((part * scale[:, :, None] * scale[:, None]).ravel())
        places = [np.concatenate(at).astype(np.int32) for at in (rows, columns)]
        shape = (len(fixed), len(fixed))
        self._factors = factors_of(sp.csc_array((np.concatenate(values), tuple(places)), shape))

    def moved(self, load: Floats) -> Floats:
        """Return the displacements under a load that is 0 where these are fixed."""
        rim = load.copy()
        for square in self._squares:
            square.load_rim(rim)
        out = np.asarray(self._scale * self._factors.solve(self._scale * rim))
        for square in self._squares:
            square.move_inner(load, out)
        return out
