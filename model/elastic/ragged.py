"""Tractions where one function a side is too simple, and the stress that they leave within.

On half sides of such a plane box the tractions run linearly. The shear goes from corner to corner
as everywhere, but on a free side it is the load's; a side with two smaller boxes before it takes
over theirs. That leaves boxes round re-entrant corners, and beside loads along the surface, out of
balance; what is left over, they pass on to each other through the sides between them: the
smallest tractions, the stiffer neighbours bearing more, that bring every box into balance.

Within a box the stress is linear on 16 triangles (four quarters, crossed) and has the least
energy of all such fields with these tractions: a fixed quadratic form per material.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sl

from kaju.model.scene.kinds import AIR, FOUNDATION, RIGID, ROLLER

from .boxes import Boxes, Flags, Index, Law
from .problem import Floats

LEFT, RIGHT, BOTTOM, TOP = range(4)
SHIFT = 1e-10
"""Share of the diagonal that keeps parts without a wall from floating."""
WIDER = 3
"""How often those beside unbalanced boxes are asked to pass on as well."""


@dataclass(frozen=True, eq=False)
class Ragged:
    """Boxes with tractions of their own.

    Attributes
    ----------
    box : int array, shape (n,)
        Which, in order.
    traction : array, shape (n, 4, 2, 4)
        By side (left, right, bottom, top) and half of it: the normal stress at its lower and its
        upper end, and the shear stress at both.
    left : array, shape (n,)
        Largest force or moment left over, as a stress.
    """

    box: Index
    traction: Floats
    left: Floats

    @classmethod
    def none(cls) -> Ragged:
        """Return no boxes."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2, 4)), np.zeros(0))

    def at(self, box: Index) -> Index:
        """Return where boxes stand among these, -1 for those that do not."""
        if not len(self.box):
            return np.full(len(box), -1)
        place = np.minimum(np.searchsorted(self.box, box), len(self.box) - 1)
        return np.where(self.box[place] == box, place, -1)


def ragged_tractions(
    boxes: Boxes, normal: Floats, pressed: Floats, uneven: Flags, small: float
) -> Ragged:
    """Return tractions of uneven boxes, and of those that help to balance them.

    Parameters
    ----------
    boxes : Boxes
    normal : array, shape (4, boxes)
        Normal tractions of all boxes by their own middles.
    pressed : array, shape (4, boxes)
        Normal stress of the loads on bare sides.
    uneven : bool array, shape (boxes,)
    small : float
        A stress that may be left over.
    """
    if not uneven.any():
        return Ragged.none()
    uneven = uneven.copy()
    uneven[boxes.hanging.box] = True
    for _ in range(WIDER):
        found = _taken(boxes, normal, pressed, np.flatnonzero(uneven))
        off = _imbalance(boxes, found)
        if np.abs(off).max(initial=0.0) > small:
            _pass_on(boxes, found, off)
            off = _imbalance(boxes, found)
        found = Ragged(found.box, found.traction, np.abs(off).max(axis=1, initial=0.0))
        far = found.box[found.left > small]
        if not len(far):
            break
        around = boxes.beside[:, far].ravel()
        uneven[around[around >= 0]] = True
        large = np.isin(boxes.hanging.fine, far).any(axis=1)
        uneven[boxes.hanging.box[large]] = True
        uneven[boxes.hanging.fine[np.isin(boxes.hanging.box, far)].ravel()] = True
    return found


def _shear_ends(boxes: Boxes, box: Index, dragged: Floats) -> Floats:
    """Return the shear stress at both ends of the sides of boxes, shape (n, 4, 2)."""
    tau = boxes.shear[0, 1][..., box]
    ends = np.stack([tau[0], tau[1], tau[:, 0], tau[:, 1]]).transpose(2, 0, 1)
    kind = boxes.kind[:, box].T
    slides = (kind < 0) & np.isin(kind, (AIR, ROLLER, FOUNDATION))
    own = dragged[:, box].T[:, :, None]
    # A load on a side between two boxes parts their tractions.
    return np.where(slides[:, :, None], own, np.where((kind >= 0)[:, :, None], ends + own, ends))


def _taken(boxes: Boxes, normal: Floats, pressed: Floats, box: Index) -> Ragged:
    """Return the tractions that boxes have by their middles and corners, and by who is beside."""
    n, hanging = len(box), boxes.hanging
    dragged = np.zeros(boxes.beside.shape)
    load = boxes.loads
    along = load.force[np.arange(len(load.side)), 1 - load.side // 2]
    outward = 2.0 * (load.side % 2) - 1.0
    np.add.at(dragged, (load.side, load.box), outward * along / boxes.size[load.box])
    found = Ragged(box, np.zeros((n, 4, 2, 4)), np.zeros(n))
    ends = _shear_ends(boxes, box, dragged)
    shear = found.traction[..., 2:]
    shear[:, :, 0, 0], shear[:, :, 1, 1] = ends[:, :, 0], ends[:, :, 1]
    shear[:, :, 0, 1] = shear[:, :, 1, 0] = ends.mean(axis=2)
    through = ends.copy()
    at = found.at(hanging.box)
    for half in (0, 1):
        fine = _shear_ends(boxes, hanging.fine[:, half], dragged)
        own = fine[np.arange(len(at)), hanging.side ^ 1]
        parted = dragged[hanging.side, hanging.box]
        own = own + (parted - dragged[hanging.side ^ 1, hanging.fine[:, half]])[:, None]
        shear[at, hanging.side, half] = own
        through[at, hanging.side, half] = own.mean(axis=1)
    body = 0.5 * boxes.body[:, box] * boxes.size[box]
    mine = np.empty((4, n))
    for axis, (low, high) in enumerate(((BOTTOM, TOP), (LEFT, RIGHT))):
        middle = boxes.sigma[axis, box]
        rise = 0.5 * (through[:, high] - through[:, low])
        mine[2 * axis] = middle + rise[:, 0] + body[axis]
        mine[2 * axis + 1] = middle - rise[:, 1] - body[axis]
    everyone = normal.copy()
    everyone[:, box] = mine
    ragged = np.zeros(len(boxes.size), dtype=np.bool_)
    ragged[box] = True
    for side in range(4):
        other, kind = boxes.beside[side, box], boxes.kind[side, box]
        alike = (other >= 0) & (boxes.size[other] == boxes.size[box])
        # A load on a side between two boxes parts their tractions.
        theirs = everyone[side ^ 1, other] - pressed[side ^ 1, other] + pressed[side, box]
        mean = np.where(ragged[other], 0.5 * (mine[side] + theirs), theirs)
        free = (other < 0) & (kind == AIR)
        mine[side] = np.where(alike, mean, np.where(free, pressed[side, box], mine[side]))
    found.traction[..., :2] = mine.T[:, :, None, None]
    everyone[:, box] = mine
    for half in (0, 1):
        small = hanging.fine[:, half]
        theirs = everyone[hanging.side ^ 1, small] - pressed[hanging.side ^ 1, small]
        theirs = theirs + pressed[hanging.side, hanging.box]
        found.traction[at, hanging.side, half, :2] = theirs[:, None]
    return found


def _imbalance(boxes: Boxes, found: Ragged) -> Floats:
    """Return the forces, and the moment, that boxes are left with, over edge and its square."""
    traction = found.traction
    half = traction.reshape(*traction.shape[:3], 2, 2).mean(axis=4)  # side, half, normal or shear
    mean = half.mean(axis=2)
    normal, shear = mean[..., 0], mean[..., 1]
    body = (boxes.body * boxes.size)[:, found.box]
    x = normal[:, RIGHT] - normal[:, LEFT] + shear[:, TOP] - shear[:, BOTTOM] + body[0]
    y = normal[:, TOP] - normal[:, BOTTOM] + shear[:, RIGHT] - shear[:, LEFT] + body[1]
    n0, n1 = traction[..., 0], traction[..., 1]
    place = np.array([[-0.5, 0.0], [0.0, 0.5]])
    first = (2 * n0 + n1) * place[:, 0] + (n0 + 2 * n1) * place[:, 1]
    lever = first.sum(axis=2) / 12.0
    turn = 0.5 * (shear[:, RIGHT] + shear[:, LEFT] - shear[:, TOP] - shear[:, BOTTOM])
    turn += lever[:, TOP] - lever[:, BOTTOM] - lever[:, RIGHT] + lever[:, LEFT]
    return np.stack([x, y, turn], axis=1)


class _Joint(NamedTuple):
    """Sides between ragged boxes: who has it, which side, and which half of it (-1: all)."""

    box: Index
    side: Index
    half: Index


def _pass_on(boxes: Boxes, found: Ragged, off: Floats) -> None:
    """Let boxes pass on what they are left with, through the sides between them."""
    first, second, stiff, slides = _joints(boxes, found)
    count = len(first.box)
    if not count:
        return
    everything = [_shares(first), _shares(second)]
    row, column, value = (np.concatenate(part) for part in zip(*everything, strict=True))
    kept = row >= 0
    # Through a wall without friction no shear is passed on.
    kept &= ~((column % 3 == 1) & slides[column // 3])
    shape = (3 * len(found.box), 3 * count)
    take = sp.csr_array((value[kept], (row[kept], column[kept])), shape=shape)
    weight = sp.diags_array(np.repeat(stiff, 3))
    matrix = sp.csc_array(take @ weight @ take.T)
    diagonal = matrix.diagonal()
    shift = SHIFT * np.where(diagonal > 0.0, diagonal, 1.0)
    factor = sl.splu(sp.csc_array(matrix + sp.diags_array(shift)))
    right, x = -off.ravel(), np.zeros(shape[0])
    for _ in range(4):
        x += factor.solve(right - matrix @ x)
    passed = (weight @ (take.T @ x)).reshape(-1, 3)
    for joint in (first, second):
        there = joint.box >= 0
        n, q, couple = passed[there].T
        box, side, half = (part[there] for part in joint)
        for h in (0, 1):
            # A couple is a traction that runs from -couple to couple along the side.
            whole = half < 0
            on = whole | (half == h)
            low = np.where(whole, (h - 1.0) * couple, -couple)
            high = np.where(whole, h * couple, couple)
            for k, change in enumerate((n + low, n + high, q, q)):
                np.add.at(found.traction, (box[on], side[on], h, k), change[on])


def _joints(boxes: Boxes, found: Ragged) -> tuple[_Joint, _Joint, Floats, Flags]:
    """Return sides with ragged boxes on both sides, or a wall; their stiffness; who slides."""
    stretch, hanging = boxes.law.stretch, boxes.hanging
    mine: list[Index] = []
    for side in range(4):
        other, kind = boxes.beside[side, found.box], boxes.kind[side, found.box]
        alike = (other >= 0) & (boxes.size[other] == boxes.size[found.box])
        at = found.at(other)
        if side % 2:
            here = np.flatnonzero(alike & (at >= 0))
            mine.append(_joint_rows(here, side, at[here], side ^ 1, -1, 0))
        wall = np.flatnonzero((other < 0) & np.isin(kind, (RIGID, ROLLER)))
        slides = (kind[wall] == ROLLER).astype(np.int64)
        mine.append(_joint_rows(wall, side, np.full(len(wall), -1), side ^ 1, -1, slides))
    large = found.at(hanging.box)
    for half in (0, 1):
        fine = found.at(hanging.fine[:, half])
        here = np.flatnonzero((large >= 0) & (fine >= 0))
        coarse = hanging.side[here]
        mine.append(_joint_rows(fine[here], coarse ^ 1, large[here], coarse, half, 0))
    box, own, second, across, part, loose = np.concatenate(mine, axis=1)
    beyond = np.where(second >= 0, second, box)
    stiff = np.minimum(stretch[found.box[box]], stretch[found.box[beyond]])
    first = _Joint(box, own, np.full_like(part, -1))
    return first, _Joint(second, across, part), stiff, loose.astype(np.bool_)


def _joint_rows(*columns: Index | int) -> Index:
    return np.stack(np.broadcast_arrays(*columns))


def _shares(joint: _Joint) -> tuple[Index, Index, Floats]:
    """Return what boxes feel of a normal stress, a shear stress and a couple on their sides.

    Rows are the boxes' two forces and moments, columns the three of every side.
    """
    axis, sign = joint.side // 2, 2.0 * (joint.side % 2) - 1.0
    part = np.where(joint.half < 0, 1.0, 0.5)
    lever = np.where(joint.half < 0, 0.0, 0.5 * joint.half - 0.25)
    turned = np.where(axis == 1, 1.0, -1.0)
    rows, columns, values = [], [], []
    number = 3 * np.arange(len(joint.box))
    start = np.where(joint.box >= 0, 3 * joint.box, -3)
    for at, column, value in (
        (axis, 0, sign * part),
        (2, 0, sign * turned * part * lever),
        (1 - axis, 1, sign * part),
        (2, 1, -0.5 * turned * part),
        (2, 2, sign * turned * part**2 / 6.0),
    ):
        rows.append(np.where(start >= 0, start + at, -1))
        columns.append(number + column)
        values.append(value)
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


@dataclass(frozen=True, eq=False)
class Form:
    """Energy and mean stress within a box of unit edge by its tractions and the force within.

    Attributes
    ----------
    quadratic : array, shape (34, 34)
    linear : array, shape (3, 34)
        Mean σ_xx, σ_yy and τ.
    """

    quadratic: Floats
    linear: Floats

    @classmethod
    def of_laws(cls, law: Law, box: Index) -> list[tuple[Index, Form]]:
        """Return boxes of one material each, and their form."""
        if not len(box):
            return []
        rows = np.stack([modulus[box] for modulus in law], axis=1)
        laws, which = np.unique(rows, axis=0, return_inverse=True)
        return [(box[which.ravel() == k], _form(*map(float, one))) for k, one in enumerate(laws)]

    def energy(self, data: Floats) -> Floats:
        """Return the energies by data, shape (n, 34)."""
        return np.asarray(0.5 * np.einsum("ni,ni->n", data @ self.quadratic, data))

    def mean(self, data: Floats) -> Floats:
        """Return the mean stresses, shape (3, n)."""
        return np.asarray(self.linear @ data.T)


@lru_cache(maxsize=64)
def _form(stretch: float, lateral: float, shear: float) -> Form:
    """Work the form out: the least energy under balance, continuity and the tractions."""
    rows, data = _conditions()
    size = stretch**2 - lateral**2
    compliance = np.array(
        [
            [stretch / size, -lateral / size, 0.0],
            [-lateral / size, stretch / size, 0.0],
            [0.0, 0.0, 1.0 / shear],
        ]
    )
    mass = np.kron(np.eye(16), np.kron((np.ones((3, 3)) + np.eye(3)) / 12.0, compliance)) / 16.0
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    # Least squares in the norm of the energy.
    stress = inverse.T @ (np.linalg.pinv(rows @ inverse.T, rcond=1e-10) @ data)
    mean = np.kron(np.full((1, 48), 1.0 / 48.0), np.eye(3)) @ stress
    return Form(stress.T @ mass @ stress, mean)


@lru_cache(maxsize=1)
def _conditions() -> tuple[Floats, Floats]:
    """Return ``rows @ stress = data @ (tractions, force)`` of the 16 triangles' stresses.

    The stress is (σ_xx, σ_yy, τ) at the three corners of every triangle.
    """
    rows: list[Floats] = []
    data: list[Floats] = []
    shared: dict[tuple[tuple[float, float], ...], list[_Edge]] = {}
    for number, corners in enumerate(triangles()):
        slope = np.linalg.inv(np.c_[np.ones(3), np.array(corners)])[1:]
        for axis in (0, 1):
            row, given = np.zeros(144), np.zeros(34)
            for k in range(3):
                at = 9 * number + 3 * k
                row[at + axis] += slope[axis, k]
                row[at + 2] += slope[1 - axis, k]
            given[32 + axis] = -1.0
            rows.append(row)
            data.append(given)
        for k in range(3):
            a, b = corners[k], corners[(k + 1) % 3]
            edge = _Edge(9 * number, {a: k, b: (k + 1) % 3})
            shared.setdefault(tuple(sorted((a, b))), []).append(edge)
    for (a, b), edges in shared.items():
        along = np.array(b) - np.array(a)
        normal = np.array([along[1], -along[0]]) / np.hypot(*along)
        for point in (a, b):
            if len(edges) == 2:
                for component in (0, 1):
                    first, second = (edge.traction(point, normal, component) for edge in edges)
                    rows.append(first - second)
                    data.append(np.zeros(34))
                continue
            axis = 0 if abs(normal[0]) > 0.5 else 1
            low = min(a[1 - axis], b[1 - axis])
            start = 8 * (2 * axis + (a[axis] > 0.5)) + 4 * (low > 0.25) + (point[1 - axis] > low)
            for component, kind in ((axis, 0), (2, 2)):
                row, given = np.zeros(144), np.zeros(34)
                row[edges[0].start + 3 * edges[0].corner[point] + component] = 1.0
                given[start + kind] = 1.0
                rows.append(row)
                data.append(given)
    return np.array(rows), np.array(data)


class _Edge(NamedTuple):
    """An edge of a triangle: where its stresses begin, and which corners it joins."""

    start: int
    corner: dict[tuple[float, float], int]

    def traction(self, point: tuple[float, float], normal: Floats, component: int) -> Floats:
        """Return the row of a traction at an end."""
        row = np.zeros(144)
        at = self.start + 3 * self.corner[point]
        row[at + component] += normal[component]
        row[at + 2] += normal[1 - component]
        return row


def triangles() -> Iterator[list[tuple[float, float]]]:
    """Yield the corners of the 16 triangles: four quarters, crossed."""
    for x in (0.0, 0.5):
        for y in (0.0, 0.5):
            square = [(x, y), (x + 0.5, y), (x + 0.5, y + 0.5), (x, y + 0.5)]
            middle = (x + 0.25, y + 0.25)
            for k in range(4):
                yield [square[k], square[(k + 1) % 4], middle]
