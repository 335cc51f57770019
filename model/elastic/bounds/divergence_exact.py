"""A displacement field without gaps that changes the volume of every box as the answer does.

Between four corners a displacement that is linear along every axis can hardly keep a volume: in
nearly incompressible bodies its energy is far too high. So the sides of boxes bend: across
itself a side moves by a quadratic whose mean is what the answer says of its face. Within a box
the field is quadratic on sixteen triangles; of all that have the box's change of volume
everywhere it is the one with the least energy, which is the same for every material.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement, sink
from kaju.model.elastic.bounds.macroelement import inside_simplices, triangles

LOCKING = 0.8
"""Bodies with a larger C₁₂/C₁₁ (a Poisson's ratio of 0.45 in plane strain) call for the field."""
ENDS = ((0, 1), (2, 3), (0, 2), (1, 3))
"""Corners at the ends of the four sides, in the order of `corner_ends`."""

# Data of a box: displacements of its corners (0 to 7) and of the middles of its sides (8 to 15),
# then the mean of the normal displacement of both halves of every side (16 to 23).


class DivergenceExactField:
    """Displacements of the corners of boxes, and of their sides across themselves.

    Has what bounds ask of an `AdmissibleDisplacement`, with which it begins; for plane bodies
    without beds.
    """

    def __init__(self, plain: AdmissibleDisplacement) -> None:
        self.boxes, self.mesh = plain.boxes, plain.mesh
        self._given = plain.given
        n, hanging = len(self.boxes.size), self.boxes.hanging
        self.displacement = plain.mesh.start.copy()
        self._flux = np.repeat(self.boxes.moved.T[:, :, None], 2, axis=2)
        self._flux[hanging.box, hanging.side] = self.boxes.moved[
            (hanging.side ^ 1)[:, None], hanging.fine
        ]
        every = np.arange(n)
        middle = np.stack([plain.middles(every, side) for side in range(4)])
        self._node = np.concatenate([self.mesh.corner, middle])
        straight = (middle < 0).T @ (1 << np.arange(4))
        self._groups = [(np.flatnonzero(straight == k), k) for k in np.unique(straight)]
        self._load = plain.forces(across=False)
        # The forces in the boxes go to the nodes, and work on the sides' bending.
        force, own = (self.boxes.body * self.boxes.size**2).T, self.boxes.loads
        by_data = np.empty((n, 24))
        for box, bits in self._groups:
            by_data[box] = force[box] @ _form(bits)[1]
        self._load += self._gathered(by_data)
        normal = own.force[np.arange(len(own.side)), own.side // 2]
        sides = float(np.vdot(normal, self._flux[own.box, own.side].mean(axis=1)))
        self._work_across = sides + float(np.vdot(by_data[:, 16:], self._flux.reshape(-1, 8)))
        self._shear = 2.0 * self.boxes.law.shear
        self.displacement = np.where(np.isnan(self._given), self.displacement, self._given)

    def _data(self, v: Floats, flux: Floats | float) -> Floats:
        """Return the data of boxes, shape (boxes, 24)."""
        n = len(self.boxes.size)
        data = np.empty((n, 24))
        nodes = np.where(self._node[..., None] >= 0, v[self._node], 0.0)
        data[:, :16] = nodes.transpose(1, 0, 2).reshape(n, 16)
        data[:, 16:] = flux if isinstance(flux, float) else flux.reshape(n, 8)
        return data

    def _bends(self, data: Floats) -> Floats:
        """Return the derivatives of all boxes' energies by their data."""
        out = np.empty_like(data)
        for box, straight in self._groups:
            out[box] = data[box] @ _form(straight)[0]
        return np.asarray(self._shear[:, None] * out)

    def _gathered(self, by_data: Floats) -> Floats:
        """Add what belongs to nodes up at them."""
        parts = by_data[:, :16].reshape(len(by_data), 8, 2).transpose(1, 0, 2)
        there = self._node >= 0
        at, count = self._node[there], len(self.displacement)
        return np.stack([np.bincount(at, parts[there, a], count) for a in (0, 1)], axis=1)

    def settle(self, above: float) -> None:
        """Let the corners sink by conjugate gradients; see `AdmissibleDisplacement.settle`."""
        own = np.empty((len(self.boxes.size), 24))
        for box, straight in self._groups:
            own[box] = _form(straight)[0].diagonal()
        diagonal = self._gathered(self._shear[:, None] * own)
        free = np.isnan(self._given) & (diagonal > 0.0)
        weight = np.where(free, 1.0 / np.where(free, diagonal, 1.0), 0.0)
        left = self._load - self._gathered(self._bends(self._data(self.displacement, self._flux)))
        gap = above + self.whole_energy() - self.work()
        sink(self.displacement, left, weight, gap, self._force)

    def _force(self, way: Floats) -> Floats:
        """Return what holds the nodes at a displacement, the sides' bending left out."""
        return self._gathered(self._bends(self._data(way, 0.0)))

    def stretch(self, share: float) -> None:
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
        data = self._data(self.displacement, self._flux)
        side = self._flux.mean(axis=2)
        grown = side[:, 1] - side[:, 0] + side[:, 3] - side[:, 2]
        bent = np.einsum("nk,nk->n", data, self._bends(data))
        return np.asarray(0.5 * (self.boxes.law.lateral * grown**2 + bent))

    def strain_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the strain tensors, shape (n, 2, 2), at a place in each of n boxes."""
        data = self._data(self.displacement, self._flux)
        for some, straight in self._groups:
            data[some] = data[some] @ _slaves(straight).T
        moved = (data[box] @ _least().whole.T).reshape(len(box), -1, 2)
        triangle, share = inside_simplices(list(triangles()), inside)
        slope = np.empty((len(box), 2, 2))
        for k, (corners, node) in enumerate(zip(triangles(), _least().node, strict=True)):
            here = np.flatnonzero(triangle == k)
            flat = np.linalg.inv(np.c_[np.ones(3), np.array(corners)])[1:]
            for n in here:
                slope[n] = (_slopes(flat, share[n]) @ moved[n, node]).T
        slope /= self.boxes.size[box, None, None]
        return np.asarray(0.5 * (slope + slope.transpose(0, 2, 1)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, 2, 2)."""
        data = self._data(self.displacement, self._flux)
        for box, straight in self._groups:
            data[box] = data[box] @ _slaves(straight).T
        along = np.empty((len(data), 4))
        for side, (low, high) in enumerate(ENDS):
            component = 1 - side // 2
            ends = data[:, 2 * low + component] + data[:, 2 * high + component]
            along[:, side] = 0.25 * ends + 0.5 * data[:, 8 + 2 * side + component]
        across = self._flux.mean(axis=2)
        mean = np.empty((len(data), 2, 2))
        mean[:, 0, 0], mean[:, 1, 1] = across[:, 1] - across[:, 0], across[:, 3] - across[:, 2]
        mean[:, 0, 1] = 0.5 * (along[:, 3] - along[:, 2] + along[:, 1] - along[:, 0])
        mean[:, 1, 0] = mean[:, 0, 1]
        return np.asarray(mean / self.boxes.size[:, None, None])


class _Least(NamedTuple):
    """The field of least energy in a box of unit edge, by its data."""

    shear: Floats  # of which the integral of ε:ε is made, shape (24, 24)
    mean: Floats  # displacement, shape (2, 24)
    whole: Floats  # displacement of all nodes, component by component, shape (2 nodes, 24)
    node: list[list[int]]  # of every triangle: its corners, then the middles of its edges


@lru_cache(maxsize=16)
def _form(straight: int) -> tuple[Floats, Floats]:
    """Return ∫ε:ε and the mean displacement of boxes with some sides straight, a bit for each."""
    least, slaves = _least(), _slaves(straight)
    return slaves.T @ least.shear @ slaves, least.mean @ slaves


@lru_cache(maxsize=16)
def _slaves(straight: int) -> Floats:
    """Return what the data are where sides are not cut: one quadratic over both halves."""
    found = np.eye(24)
    for side, (low, high) in enumerate(ENDS):
        if not straight >> side & 1:
            continue
        axis, half = side // 2, (16 + 2 * side, 17 + 2 * side)
        middle = 8 + 2 * side
        found[middle : middle + 2] = 0.0
        for end in (2 * low, 2 * high):
            found[middle + axis, end + axis] = -0.25
            found[middle + 1 - axis, end + 1 - axis] = 0.5
        found[middle + axis, half] = 0.75
        across = found[middle + axis].copy()
        for own, (near, far) in zip(half, ((low, high), (high, low)), strict=True):
            found[own] = across * 2.0 / 3.0
            found[own, 2 * near + axis] += 2.5 / 6.0
            found[own, 2 * far + axis] -= 0.5 / 6.0
    return found


@lru_cache(maxsize=1)
def _least() -> _Least:
    """Return the field of least energy of all that have one divergence."""
    number: dict[tuple[float, float], int] = {}
    corners = []
    for triangle in triangles():
        ends = zip(triangle, triangle[1:] + triangle[:1], strict=True)
        middles = [((a + c) / 2, (b + d) / 2) for (a, b), (c, d) in ends]
        corners.append([number.setdefault(p, len(number)) for p in (*triangle, *middles)])
    size = 2 * len(number)
    energy, mean = np.zeros((size, size)), np.zeros((2, size))
    rows = []
    for triangle, node in zip(triangles(), corners, strict=True):
        slope = np.linalg.inv(np.c_[np.ones(3), np.array(triangle)])[1:]
        for at in np.eye(3) * 2 / 3 + 1 / 6 * (1 - np.eye(3)):  # exact for squares of slopes
            by = _slopes(slope, at)
            strain = np.zeros((3, size))  # ε_xx, ε_yy, √2 ε_xy
            strain[0, 2 * np.array(node)] = by[0]
            strain[1, 2 * np.array(node) + 1] = by[1]
            strain[2, 2 * np.array(node)] = by[1] / np.sqrt(2)
            strain[2, 2 * np.array(node) + 1] = by[0] / np.sqrt(2)
            energy += strain.T @ strain / 48
        for axis in (0, 1):
            mean[axis, 2 * np.array(node[3:]) + axis] += 1 / 48
        for at in np.eye(3):
            by, row = _slopes(slope, at), np.zeros(size)
            row[2 * np.array(node)], row[2 * np.array(node) + 1] = by[0], by[1]
            rows.append(row)
    given, data = _at_the_rim(number)
    inner = np.setdiff1d(np.arange(size), given)
    divergence = np.zeros(24)
    for side in range(4):
        divergence[16 + 2 * side : 18 + 2 * side] = 0.5 if side % 2 else -0.5
    fixed = np.array(rows)
    wanted = divergence - fixed[:, given] @ data
    u, s, vt = np.linalg.svd(fixed[:, inner])
    rank = int((s > 1e-10 * s[0]).sum())
    whole = np.zeros((size, 24))
    whole[given] = data
    whole[inner] = vt[:rank].T @ (u[:, :rank].T @ wanted / s[:rank, None])
    loose = np.zeros((size, len(inner) - rank))
    loose[inner] = vt[rank:].T
    whole -= loose @ np.linalg.solve(loose.T @ energy @ loose, loose.T @ energy @ whole)
    return _Least(whole.T @ energy @ whole, mean @ whole, whole, corners)


def _slopes(slope: Floats, at: Floats) -> Floats:
    """Return the slopes, shape (2, 6), of the quadratics of a triangle at a place."""
    # `slope` are those of the linear functions that are 1 at one corner, `at` their values there.
    corner = slope * (4.0 * at - 1.0)
    middle = [
        4.0 * (at[k] * slope[:, (k + 1) % 3] + at[(k + 1) % 3] * slope[:, k]) for k in range(3)
    ]
    return np.concatenate([corner, np.stack(middle, axis=1)], axis=1)


def _at_the_rim(number: dict[tuple[float, float], int]) -> tuple[Ints, Floats]:
    """Return the unknowns at the rim of a box, and what they are by the data."""
    place = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)]
    place += [(0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0)]
    given = [2 * number[p] + axis for p in place for axis in (0, 1)]
    rows = [np.eye(24)[k] for k in range(16)]
    for side, (low, high) in enumerate(ENDS):
        axis = side // 2
        for half, end in enumerate((low, high)):
            a, b = np.array(place[end]), np.array(place[4 + side])
            at = 2 * number[tuple(((a + b) / 2).tolist())]
            own = {k: np.zeros(24) for k in (0, 1)}
            for k in (2 * end, 8 + 2 * side):
                own[axis][k + axis] = -0.25
                own[1 - axis][k + 1 - axis] = 0.5
            own[axis][16 + 2 * side + half] = 1.5
            given += [at, at + 1]
            rows += [own[0], own[1]]
    return np.array(given), np.array(rows)
