"""A displacement field without gaps that changes the volume of every box as the answer does.

A bilinear displacement can hardly keep a volume (locking): in nearly incompressible bodies its
energy is far too high. So the sides of boxes bend: the normal displacement of a side is a quadratic
whose mean is the answer's displacement of that face. Within a box the field is quadratic on sixteen
triangles; of all fields with one constant divergence it is the one with the least energy, which is
the same for every material.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement, descend
from kaju.model.elastic.bounds.macroelement import inside_simplices, triangles

LOCKING = 0.8
"""Bodies with a larger C₁₂/C₁₁ (a Poisson's ratio of 0.45 in plane strain) call for the field."""
# Data of a box: displacements of its corners (0 to 7) and of the middles of its sides (8 to 15),
# then the mean of the normal displacement of both halves of every side (16 to 23).
DATA = 24
ENDS = ((0, 1), (2, 3), (0, 2), (1, 3))
"""Corners at the ends of the four sides, in the order of `corner_ends`."""
POINTS = np.eye(3) / 2 + 1 / 6  # Of a quadrature that is exact for quadratics, in shares of corners


class DivergenceExactField:
    """An admissible displacement whose sides bend, with the interface of `AdmissibleDisplacement`.

    It begins with that of the corners; for plane bodies without foundations.
    """

    def __init__(self, plain: AdmissibleDisplacement) -> None:
        self.boxes, self.mesh = plain.boxes, plain.mesh
        self._given = plain.given
        n, hanging = len(self.boxes.size), self.boxes.hanging
        self._flux = np.repeat(self.boxes.moved.T[:, :, None], 2, axis=2)
        self._flux[hanging.box, hanging.side] = self.boxes.moved[
            (hanging.side ^ 1)[:, None], hanging.fine
        ]
        # Nodes in the middle of sides exist where smaller boxes hang.
        middle = np.full((4, n), -1)
        for side in range(4):
            box = hanging.box[hanging.side == side]
            middle[side, box] = self.boxes.side_nodes(box, side)[1, 0]
        self._node = np.concatenate([self.mesh.corner, middle])
        straight = (middle < 0).T @ (1 << np.arange(4))
        self._groups = [(np.flatnonzero(straight == k), _form(k)) for k in np.unique(straight)]
        # The forces in the boxes go to the nodes, and work on the sides' bending.
        force, own = (self.boxes.body * self.boxes.size**2).T, self.boxes.loads
        by_data = np.empty((n, DATA))
        for box, form in self._groups:
            by_data[box] = force[box] @ form.mean
        self._load = plain.forces(across=False) + self._gathered(by_data)
        normal = own.force[np.arange(len(own.side)), own.side // 2]
        sides = float(np.vdot(normal, self._flux[own.box, own.side].mean(axis=1)))
        self._work_across = sides + float(np.vdot(by_data[:, 16:], self._flux.reshape(-1, 8)))
        start = self.mesh.start
        self.displacement = np.where(np.isnan(self._given), start, self._given)

    def _data(self, v: Floats, bent: bool = True) -> Floats:
        """Return the data of boxes, shape (boxes, 24), with or without their sides' bending."""
        data = np.zeros((len(self.boxes.size), DATA))
        nodes = np.where(self._node[..., None] >= 0, v[self._node], 0.0)
        data[:, :16] = nodes.transpose(1, 0, 2).reshape(-1, 16)
        if bent:
            data[:, 16:] = self._flux.reshape(-1, 8)
        return data

    def _derivative(self, data: Floats) -> Floats:
        """Return the derivatives of all boxes' energies by their data."""
        out = np.empty_like(data)
        for box, form in self._groups:
            out[box] = data[box] @ form.square
        return np.asarray(2.0 * self.boxes.law.shear[:, None] * out)

    def _gathered(self, by_data: Floats) -> Floats:
        """Add what belongs to nodes up at them."""
        parts = by_data[:, :16].reshape(len(by_data), 8, 2).transpose(1, 0, 2)
        there = self._node >= 0
        at, count = self._node[there], len(self.mesh.start)
        return np.stack([np.bincount(at, parts[there, a], count) for a in (0, 1)], axis=1)

    def settle(self, above: float) -> None:
        """Minimise by conjugate gradients; see `AdmissibleDisplacement.settle`."""
        own = np.empty((len(self.boxes.size), DATA))
        for box, form in self._groups:
            own[box] = form.square.diagonal()
        diagonal = self._gathered(2.0 * self.boxes.law.shear[:, None] * own)
        free = np.isnan(self._given) & (diagonal > 0.0)
        weight = np.where(free, 1.0 / np.where(free, diagonal, 1.0), 0.0)
        residual = self._load - self._gathered(self._derivative(self._data(self.displacement)))
        gap = above + self.whole_energy() - self.work()

        def force(v: Floats) -> Floats:
            return self._gathered(self._derivative(self._data(v, bent=False)))

        descend(self.displacement, residual, weight, gap, force)

    def scale(self, share: float) -> None:
        """Multiply the field by a number."""
        self.displacement *= share
        self._flux *= share
        self._work_across *= share

    def work(self) -> float:
        """Return the work of the loads."""
        return float(np.vdot(self._load, self.displacement)) + self._work_across

    def work_of_rest(self) -> float:
        """Return the work of what an iteration has left of the loads."""
        if self.boxes.rest is None:
            return 0.0
        outward = np.array([1.0, -1.0, 1.0, -1.0])
        moved = self._flux.mean(axis=2) * outward
        return float(np.vdot(self.boxes.rest.T * self.boxes.size[:, None], moved))

    def whole_energy(self) -> float:
        """Return the energy in the body."""
        return float(self.energies().sum())

    def energies(self) -> Floats:
        """Return the strain energy of every box, scaled."""
        data = self._data(self.displacement)
        side = self._flux.mean(axis=2)
        grown = side[:, 1] - side[:, 0] + side[:, 3] - side[:, 2]
        bent = np.einsum("nk,nk->n", data, self._derivative(data))
        return np.asarray(0.5 * (self.boxes.law.lateral * grown**2 + bent))

    def strain_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the strain tensors, shape (n, 2, 2), at a place in each of n boxes."""
        data = self._data(self.displacement)[box]
        triangle, share = inside_simplices(list(triangles()), inside)
        weight = share @ np.linalg.inv(POINTS)  # strains are linear in every triangle
        strain = np.empty((len(box), 3))
        for some, form in self._groups:
            here = np.flatnonzero(np.isin(box, some))
            own = form.strain[triangle[here]]
            strain[here] = np.einsum("nq,nqsk,nk->ns", weight[here], own, data[here])
        return self._tensors(strain, box)

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, 2, 2)."""
        data = self._data(self.displacement)
        strain = np.empty((len(data), 3))
        for box, form in self._groups:
            strain[box] = data[box] @ form.strain.mean(axis=(0, 1)).T
        return self._tensors(strain, slice(None))

    def _tensors(self, strain: Floats, box: Ints | slice) -> Floats:
        """Return strain tensors of boxes by ε_xx, ε_yy and √2 ε_xy of a unit edge."""
        found = strain[:, [0, 2, 2, 1]] * np.array([1.0, np.sqrt(0.5), np.sqrt(0.5), 1.0])
        return np.asarray((found / self.boxes.size[box, None]).reshape(-1, 2, 2))


class _Form(NamedTuple):
    """The field of least energy in a box of unit edge, by its data."""

    square: Floats  # ∫ε:ε, shape (24, 24)
    mean: Floats  # Displacement, shape (2, 24)
    # ε_xx, ε_yy and √2 ε_xy at the `POINTS` of every triangle, shape (16, 3, 3, 24)
    strain: Floats


@lru_cache(maxsize=16)
def _form(straight: int) -> _Form:
    """Return the field of least energy of all that have one divergence; some sides straight."""
    # `straight` has a bit for each side: such a side has one quadratic over both halves.
    number: dict[tuple[float, float], int] = {}  # of the corners of triangles and edges' middles
    strains, means = [], []
    for corners in triangles():
        ends = zip(corners, corners[1:] + corners[:1], strict=True)
        middles = [((a + c) / 2, (b + d) / 2) for (a, b), (c, d) in ends]
        node = [number.setdefault(point, len(number)) for point in (*corners, *middles)]
        slope = np.linalg.inv(np.c_[np.ones(3), np.array(corners)])[1:]
        strains += [(node, _slopes(slope, at)) for at in POINTS]
        means += node[3:]
    size = 2 * len(number)
    strain, mean = np.zeros((len(strains), 3, size)), np.zeros((2, size))
    for row, (node, by) in zip(strain, strains, strict=True):
        x, y = 2 * np.array(node), 2 * np.array(node) + 1
        row[0, x], row[1, y] = by
        row[2, x], row[2, y] = by[::-1] / np.sqrt(2)
    for axis in (0, 1):
        np.add.at(mean[axis], 2 * np.array(means) + axis, 1 / len(means))

    # Conditions `row @ displacement = row @ data` on all fields that are compared.
    rows: list[Floats] = []
    given: list[Floats] = []
    own, nothing = np.eye(DATA), np.zeros(DATA)

    def require(row: Floats, data: Floats) -> None:
        rows.append(np.atleast_2d(row))
        given.append(np.broadcast_to(data, (len(rows[-1]), DATA)))

    flux = np.concatenate([np.zeros(16), [-0.5, -0.5, 0.5, 0.5] * 2])
    require(strain[:, 0] + strain[:, 1], flux)
    for side, component in product(range(4), (0, 1)):
        axis, upper = divmod(side, 2)
        ticks = np.linspace(0.0, 1.0, 5)
        points = [(upper, y) if axis == 0 else (y, upper) for y in ticks]
        value = np.eye(size)[[2 * number[point] + component for point in points]]
        for corner, end in zip(ENDS[side], (0, -1), strict=True):
            require(value[end], own[2 * corner + component])
        halves, across = own[16 + 2 * side : 18 + 2 * side], component == axis
        parts = [(value, halves.mean(axis=0))]
        if not straight >> side & 1:
            require(value[2], own[8 + 2 * side + component])
            parts = [(value[:3], halves[0]), (value[2:], halves[1])]
        for part, mean_across in parts:
            # Across itself a part is a quadratic with a mean, along itself it is linear.
            powers = np.vander(np.linspace(0.0, 1.0, len(part)), 3 if across else 2)
            require(np.linalg.svd(powers)[0][:, powers.shape[1] :].T @ part, nothing)
            if across:
                simpson = np.array([1.0, 4.0, 1.0] if len(part) == 3 else [1.0, 4.0, 2.0, 4.0, 1.0])
                require(simpson @ part / simpson.sum(), mean_across)
    energy = np.tensordot(strain, strain, ((0, 1), (0, 1))) / len(strain)
    fixed, data = np.concatenate(rows), np.concatenate(given)
    system = np.block([[energy, fixed.T], [fixed, np.zeros((len(fixed), len(fixed)))]])
    solution = np.linalg.pinv(system, rcond=1e-10, hermitian=True)
    whole = solution[:size, size:] @ data
    by_points = (strain @ whole).reshape(-1, 3, 3, DATA)
    return _Form(whole.T @ energy @ whole, mean @ whole, by_points)


def _slopes(slope: Floats, at: Floats) -> Floats:
    """Return the slopes, shape (2, 6), of the quadratics of a triangle at a place."""
    # `slope` are those of the linear functions that are 1 at one corner, `at` their values there.
    ahead = np.roll(slope, -1, axis=1)
    middle = 4.0 * (at * ahead + np.roll(at, -1) * slope)
    return np.concatenate([slope * (4.0 * at - 1.0), middle], axis=1)
