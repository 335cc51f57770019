"""A displacement without gaps: bilinear on whole leaves, its energy counted within the outline."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of

from .joined_blocks import MergedSquares, assembled
from .square_leaves import SquareLeaves
from .true_shapes import HeldLeaves

CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
_ROW = np.int64(1) << 31
# share of its stiffness that keeps a part from floating: any displacement bounds from below
HOLD = 1e-12
GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


def shapes_at(local: Floats) -> Floats:
    """Return the four bilinear functions at points of the unit square, shape (n, 4)."""
    x, y = local.T
    return np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)


def strain_rows(local: Floats) -> Floats:
    """Return strain (xx, yy, 2 xy) of a unit square's corner displacements, shape (n, 3, 8)."""
    x, y = local.T
    along = np.stack([y - 1, 1 - y, y, -y], axis=1)
    across = np.stack([x - 1, -x, x, 1 - x], axis=1)
    rows = np.zeros((len(local), 3, 8))
    rows[:, 0, 0::2] = rows[:, 2, 1::2] = along
    rows[:, 1, 1::2] = rows[:, 2, 0::2] = across
    return rows


class FittedDisplacement:
    """Bilinear displacements on leaves that hold a part of the body, with hanging nodes."""

    def __init__(self, leaves: SquareLeaves, held: HeldLeaves):
        self.leaves = leaves
        self._number_corners()
        points = np.array([(x, y) for x in GAUSS for y in GAUSS])
        rows = strain_rows(points)
        stiffness = np.array([law.stiffness for law in held.laws]).reshape(-1, 3, 3)
        whole = 0.25 * np.einsum("qai,lab,qbj->lij", rows, stiffness, rows)
        full = leaves.size.astype(float) ** 2 * leaves.unit**2
        # integrals of the four bilinear functions over what each leaf holds
        self.shares = np.repeat(0.25 * full[:, None], 4, axis=1)
        self._plain, self._whole = held.whole == 0, whole[0]
        self.elements = whole[held.whole]
        self.elements[held.whole < 0] = self.shares[held.whole < 0] = 0.0
        owner, corners, law = _fans(held)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
        each = (np.ones(len(owner)), (owner, np.arange(len(owner))))
        within = sp.csr_array(each, shape=(len(leaves), len(owner)))
        for weights in (np.ones((3, 3)) + 3.0 * np.eye(3)) / 6.0:
            places = self.local(owner, np.einsum("k,nkd->nd", weights, corners))
            self.shares += np.asarray(within @ (area[:, None] / 3.0 * shapes_at(places)))
            rows = strain_rows(places)
            local = rows.transpose(0, 2, 1) @ stiffness[law] @ rows
            local *= (area / full[owner] / 3.0)[:, None, None]
            self.elements += np.asarray(within @ local.reshape(-1, 64)).reshape(-1, 8, 8)
        self.area = self.shares.sum(axis=1)
        self.displacement = np.zeros((self.nodes, 2))

    def _number_corners(self) -> None:
        leaves = self.leaves
        px = leaves.x[:, None] + CORNERS[:, 0] * leaves.size[:, None]
        py = leaves.y[:, None] + CORNERS[:, 1] * leaves.size[:, None]
        keys, inverse = np.unique((px * _ROW + py).ravel(), return_inverse=True)
        self.corner: Ints = inverse.reshape(-1, 4)
        self.nodes = n = len(keys)
        self.place = np.stack([keys // _ROW, keys % _ROW], axis=1) * leaves.unit
        key = (px + np.roll(px, -1, axis=1)) // 2 * _ROW + (py + np.roll(py, -1, axis=1)) // 2
        at = np.minimum(np.searchsorted(keys, key), n - 1)
        hit = (keys[at] == key) & (leaves.size[:, None] > 1)
        # the corner in the middle of each side, -1 for none, shape (leaves, 4)
        self.middle = np.where(hit, at, -1)
        self.hanging = np.isin(np.arange(n), at[hit])
        own, tied = np.flatnonzero(~self.hanging), at[hit]
        first, last = self.corner[hit], np.roll(self.corner, -1, axis=1)[hit]
        rows, columns = np.concatenate([own, tied, tied]), np.concatenate([own, first, last])
        values = np.concatenate([np.ones(len(own)), np.full(2 * len(tied), 0.5)])
        tie = sp.csr_array((values, (rows, columns)), shape=(n, n))
        while tie[:, self.hanging].nnz:  # a corner may hang on one that hangs itself
            tie = tie @ tie
            tie.eliminate_zeros()
        self._tie = tie

    def local(self, leaf: Ints, points: Floats) -> Floats:
        """Return where in their leaves points lie, from 0 to 1."""
        low = np.stack([self.leaves.x[leaf], self.leaves.y[leaf]], axis=1) * self.leaves.unit
        return np.asarray((points - low) / (self.leaves.size[leaf] * self.leaves.unit)[:, None])

    def spread(self, leaf: Ints, points: Floats, forces: Floats) -> Floats:
        """Return the forces on corners that stand for forces at points of leaves, (nodes, 2)."""
        shares = shapes_at(self.local(leaf, points))
        out = np.zeros((self.nodes, 2))
        for k in range(4):
            np.add.at(out, self.corner[leaf, k], shares[:, k, None] * forces)
        return out

    def weigh(self, weight: Floats) -> Floats:
        """Return the forces on corners that stand for a force on a unit of area, (nodes, 2)."""
        total = np.bincount(self.corner.ravel(), self.shares.ravel(), self.nodes)
        return np.asarray(total[:, None] * weight)

    def settle(self, force: Floats, held: Flags) -> float:
        """Find the displacement under forces on the corners; return the lower bound of their work.

        Whatever the displacement, work² / (2 energy) is not above the work of the true one.
        """
        dofs = np.stack([2 * self.corner, 2 * self.corner + 1], axis=2).reshape(-1, 8)
        plain, rest = (np.flatnonzero(at) for at in (self._plain, ~self._plain))
        places = np.repeat(CORNERS, 2, axis=0)
        merged = MergedSquares(self.leaves.only(plain), self._whole, dofs[plain], places)
        blocks = [(self.elements[rest], dofs[rest]), *merged.blocks]
        free = merged.free((held | self.hanging[:, None]).ravel())
        tie = sp.kron(self._tie, sp.eye_array(2)).tocsr()[:, np.flatnonzero(free)]
        own = sp.csr_array(tie.T @ assembled(blocks, 2 * self.nodes) @ tie)
        diagonal = own.diagonal()
        kept = diagonal > 1e-14 * diagonal.max()  # corners of slivers: held still
        tie, own, diagonal = tie[:, kept], own[kept][:, kept], diagonal[kept]
        scale = 1.0 / np.sqrt(diagonal)
        scaled = sp.diags_array(scale) @ own @ sp.diags_array(scale)
        try:
            factors = factors_of(scaled)
        except RuntimeError:  # a part hangs on nothing, and no force moves it
            factors = factors_of(scaled + HOLD * sp.eye_array(scaled.shape[0]))
        rim = merged.on_rims(force.ravel())
        asked = scale * (tie.T @ rim)
        found = factors.solve(asked)
        found += factors.solve(asked - scaled @ found)
        moved = tie @ (scale * found)
        merged.move_inner(rim, moved)
        self.displacement = moved.reshape(-1, 2)
        work, stored = float(force.ravel() @ moved), float(self.energies().sum())
        self.displacement *= work / stored
        return work**2 / stored

    def energies(self) -> Floats:
        """Return the work of the stresses of each leaf within the outline: twice its energy."""
        moved = self.displacement[self.corner].reshape(-1, 8)
        return np.asarray(
            np.einsum("ni,ni->n", moved, (self.elements @ moved[:, :, None])[:, :, 0])
        )

    def strain_at(self, leaf: Ints, points: Floats) -> Floats:
        """Return the strain (xx, yy, 2 xy) at points of leaves, shape (n, 3)."""
        moved = self.displacement[self.corner[leaf]].reshape(-1, 8)
        strain = np.einsum("nai,ni->na", strain_rows(self.local(leaf, points)), moved)
        return np.asarray(strain / (self.leaves.size[leaf] * self.leaves.unit)[:, None])

    def at(self, leaf: Ints, points: Floats) -> Floats:
        """Return the displacement at points of leaves, shape (n, 2)."""
        shares = shapes_at(self.local(leaf, points))
        return np.asarray(np.einsum("nk,nkd->nd", shares, self.displacement[self.corner[leaf]]))


def _fans(held: HeldLeaves) -> tuple[Ints, Floats, Ints]:
    """Return triangles that fill convex pieces: leaf, corners of shape (n, 3, 2), and law."""
    found = [
        (leaf, held.laws.index(law), (piece[0], second, third))
        for leaf, cut in held.cut.items()
        for law, pieces in cut.held.items()
        for piece in pieces
        for second, third in pairwise(piece[1:])
    ]
    owner, law = np.array([at[:2] for at in found], dtype=np.int64).reshape(-1, 2).T
    return owner, np.array([at[2] for at in found], dtype=float).reshape(-1, 3, 2), law
