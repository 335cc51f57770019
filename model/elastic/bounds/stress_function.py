"""Airy's stress function: what a plane stress may have besides, without any load.

The second derivatives of a function Φ with continuous slopes are a stress that balances nothing:
σ_xx = Φ_yy, σ_yy = Φ_xx, τ = -Φ_xy. Added to an admissible stress they leave it admissible, if on
free sides Φ and its slope vanish. Φ is cubic along both axes in every element (Bogner, Fox and
Schmit 1965), with four unknowns at each node: Φ, Φ_x, Φ_y and Φ_xy. Some steps of conjugate
gradients find the one of least complementary energy: it lets normal tractions vary along the sides,
for which the staggered grid's equations have no room.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement, descend
from kaju.model.elastic.bounds.bilinear_kernels import LawForms, node_displacements
from kaju.model.elastic.bounds.shape_functions import gauss_points, shape_slopes
from kaju.model.elastic.moduli import Moduli
from kaju.model.scene.cell_types import RIGID, ROLLER

UNKNOWNS = 16  # Of an element: Φ, Φ_x, Φ_y and Φ_xy at its corners
TWIST = 3  # Place of Φ_xy among those of a node; Φ_x and Φ_y are at 1 and 2


def _cubics(x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the cubics of the value and slope at both ends, and their two derivatives."""
    one, nothing = np.ones_like(x), np.zeros_like(x)
    by_powers = np.array([[1, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]], np.float64)
    powers = np.stack([one, x, x**2, x**3])
    slopes = np.stack([nothing, one, 2 * x, 3 * x**2])
    bends = np.stack([nothing, nothing, 2 * one, 6 * x])
    return by_powers @ powers, by_powers @ slopes, by_powers @ bends


def stresses_of_unknowns(inside: Floats) -> Floats:
    """Return σ_xx, σ_yy and τ by the unknowns of a unit element, shape (3, unknowns, n)."""
    (x, dx, ddx), (y, dy, ddy) = (_cubics(along) for along in inside.T)
    found = np.empty((3, UNKNOWNS, len(inside)))
    for (i, j), p, q in product(product((0, 1), repeat=2), (0, 1), (0, 1)):
        at, own, other = 4 * (2 * i + j) + p + 2 * q, 2 * i + p, 2 * j + q
        found[:, at] = x[own] * ddy[other], ddx[own] * y[other], -dx[own] * dy[other]
    return found


def strains_of_nodes(inside: Floats) -> Floats:
    """Return ε_xx, ε_yy and γ by the nodes of a unit element, shape (3, nodes · 2, n)."""
    slopes = shape_slopes(inside, quadratic=True)
    by_x, by_y, nothing = slopes[..., 0], slopes[..., 1], np.zeros_like(slopes[..., 0])
    parts = ((by_x, nothing), (nothing, by_y), (by_y, by_x))
    return np.stack([np.stack(part, axis=1).reshape(UNKNOWNS, -1) for part in parts])


def compliance(law: Moduli) -> Floats:
    """Return the factors of like and unlike normal stresses and of the shear in the strain."""
    # In factors: hardly compressible, the two are nearly alike.
    square = (law.stretch - law.lateral) * (law.stretch + law.lateral)
    return np.stack([law.stretch / square, -law.lateral / square, 1.0 / law.shear])


@lru_cache(maxsize=1)
def _forms() -> tuple[Floats, Floats, Floats]:
    """Return products of the unknowns' stresses, their work on nodes' strains, and their means."""
    points, weights = gauss_points(2, 4)
    stress, strain = stresses_of_unknowns(points), strains_of_nodes(points)
    by_pair = np.einsum("ain,bjn,n->abij", stress, stress, weights)
    unlike = by_pair[0, 1] + by_pair[1, 0]
    own = np.stack([by_pair[0, 0] + by_pair[1, 1], unlike, by_pair[2, 2]])
    return own, np.einsum("ain,ajn,n->ij", strain, stress, weights), stress @ weights


class StressFunction:
    """An Airy function on the elements of a displacement: the one of least energy."""

    def __init__(
        self, field: AdmissibleDisplacement, felt: Floats, on_nodes: Floats, gap: float
    ) -> None:
        # Of the stress to which it is added are `felt` the products of its strain with the stresses
        # of the unknowns, and `on_nodes` its own with the strains of the field's nodes, both in
        # unit elements, shape (elements, 16); `gap` is how far its energy may be above the least.
        self.field, self.boxes, self.mesh = field, field.boxes, field.mesh
        self._on_nodes = on_nodes
        edge, corner = self.mesh.edge, self.mesh.element
        # Stresses are second derivatives.
        law = compliance(self.boxes.law)[:, self.mesh.owner]
        self._products = LawForms(law, _forms()[0], edge**-2.0)
        one = np.ones_like(edge)
        self._unit = np.tile(np.stack([one, edge, edge, edge**2]), (4, 1)).T
        self._at = (4 * corner.T[:, :, None] + np.arange(4)).reshape(-1, UNKNOWNS)
        self._moved = node_displacements(field.element, field.displacement) / edge[:, None]
        self._unknowns = np.zeros(4 * len(self.mesh.start))
        self._follow = self._straight(*field.halves())
        self._settle(felt, gap)
        # Of the elements, as if these were of unit size; shape (elements, unknowns)
        self.own = self._unknowns[self._at] * self._unit
        each = self.own * (felt + 0.5 * self._products.apply(self.own))
        self.energies = self._by_box(each.sum(axis=1))  # What it adds to every box's

    def _settle(self, felt: Floats, gap: float) -> None:
        """Lower the complementary energy by conjugate gradients; see `descend`."""
        residual = self._gathered(self._moved @ _forms()[1] - felt)
        diagonal = self._products.diagonal() * self._unit**2
        squares = np.bincount(self._at.ravel(), diagonal.ravel(), len(self._unknowns))
        whole = self._follow.power(2).T @ squares
        free = self._free() & (whole > 0.0)
        weight = np.where(free, 1.0 / np.where(free, whole, 1.0), 0.0)

        def force(search: Floats) -> Floats:
            search[:] = self._follow @ search
            return self._gathered(self._products.apply(search[self._at] * self._unit))

        descend(self._unknowns, residual, weight, gap, force)

    def _gathered(self, by_element: Floats) -> Floats:
        """Add up at the nodes what belongs to unknowns of elements, and hand on that of slaves."""
        values = (by_element * self._unit).ravel()
        found = np.bincount(self._at.ravel(), values, len(self._unknowns))
        return np.asarray(self._follow.T @ found)

    def _straight(self, axis: Ints, length: Floats) -> sp.csr_array:
        """Return all unknowns by those that are free: on straight sides one cubic runs through."""
        slave, (low, high) = self.mesh.slave, self.mesh.masters
        own = np.ones((len(self.mesh.start), 4), dtype=np.bool_)
        own[slave] = False
        rows, columns = [np.flatnonzero(own)], [np.flatnonzero(own)]
        values = [np.ones(len(rows[0]))]
        along, across = 1 + axis, 2 - axis
        for value, slope in ((np.zeros_like(axis), along), (across, np.full_like(axis, TWIST))):
            for master, sign in ((low, 1.0), (high, -1.0)):
                for row, column, weight in (
                    (value, value, np.full(len(slave), 0.5)),
                    (value, slope, sign * length / 8.0),
                    (slope, value, -sign * 1.5 / length),
                    (slope, slope, np.full(len(slave), -0.25)),
                ):
                    rows.append(4 * slave + row)
                    columns.append(4 * master + column)
                    values.append(weight)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        return sp.csr_array(entries, shape=(own.size, own.size))

    def _free(self) -> Flags:
        """Tell which unknowns may be chosen: none on free sides, and no shear along rollers."""
        free, boxes = np.ones((len(self.mesh.start), 4), dtype=np.bool_), self.boxes
        for side in range(4):
            kind = boxes.kind[side]
            bare = (boxes.beside[side] < 0) & (kind < 0)
            for some, unknowns in (
                (bare & ~np.isin(kind, (RIGID, ROLLER)), [0, 1, 2, TWIST]),
                (bare & (kind == ROLLER), [1 + side // 2, TWIST]),
            ):
                node = boxes.side_nodes(np.flatnonzero(some), side)
                for unknown in unknowns:
                    free[node, unknown] = False
        free[self.mesh.slave] = False
        return free.ravel()

    def works(self) -> Floats:
        """Return the work of the whole stress on the strain of the field, box by box."""
        on_nodes = self._on_nodes * self.mesh.edge[:, None] ** 2 + self.own @ _forms()[1].T
        return self._by_box(np.einsum("ni,ni->n", on_nodes, self._moved))

    def means(self) -> Floats:
        """Return its mean σ_xx, σ_yy and τ in every box, shape (3, boxes)."""
        share = self.mesh.edge / self.boxes.size[self.mesh.owner]
        stress = (_forms()[2] @ self.own.T) * (share / self.mesh.edge) ** 2
        return np.stack([self._by_box(one) for one in stress])

    def _by_box(self, by_element: Floats) -> Floats:
        return np.asarray(np.bincount(self.mesh.owner, by_element, len(self.boxes.size)))

    def at(self, element: Ints, inside: Floats) -> Floats:
        """Return its stresses, shape (3, n), at places from 0 to 1 in elements."""
        stress = np.einsum("ckn,nk->cn", stresses_of_unknowns(inside), self.own[element])
        return np.asarray(stress / self.mesh.edge[element] ** 2)

    def traction(self, side: int, box: Ints) -> Floats:
        """Return its mean tractions on a side of boxes, as stress components: shape (2, n)."""
        axis, upper = divmod(side, 2)
        corner = np.take(self.mesh.corner.reshape(2, 2, -1), upper, axis)[:, box]
        low, high = self._unknowns.reshape(-1, 4)[corner]
        change = (high - low).T / self.boxes.size[box]
        found = np.empty((2, len(box)))
        found[axis], found[1 - axis] = change[2 - axis], -change[1 + axis]
        return found
