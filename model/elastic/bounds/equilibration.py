"""Tractions where one function a side is too simple.

On the parts of the sides of such a box (halves; in solids quarters) the tractions run linearly. The
shear goes from corner to corner as everywhere, but on a free side it is the load's; a side with
smaller boxes before it takes over theirs. That leaves boxes round re-entrant corners, and beside
loads along the surface, out of balance; what is left over, they pass on to each other through the
sides between them: the smallest tractions, the stiffer neighbours bearing more, that bring every
box into balance. The stress within follows from them (`crossed`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from math import prod
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sl
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.bounds.bound_cells import BoundCells, corner_ends
from kaju.model.elastic.bounds.macroelement import balance_rows
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER

HOLD = 1e-6  # Share of its stiffness that keeps a box of a group without a wall from floating
FACTORED, MOST_STEPS = {2: 100_000, 3: 30_000}, 2_000
"""Up to how many unknowns leftovers are passed on by factors; beyond, iterations at most."""
ROUNDING = 1e-12  # Share of the leftovers that rounding leaves over
SMALLER = 0.1  # What an iteration leaves, as a share of what may be left over
WIDER = (1, 1, 2, 8, 32, 0)
"""So many more layers round unbalanced boxes are asked to pass on as well, time after time: those
that hang together are left with the sum of what rounding leaves on all their sides, until they
reach a wall."""


@dataclass(frozen=True, eq=False)
class EquilibratedTractions:
    """Boxes with tractions of their own."""

    box: Ints  # Which, in order; shape (n,)
    # By side and part of it, in the order of `corner_ends`: every component's mean, and its slopes
    # along the axes of the side, times the part's edge; shape (n, 2·d, 2^(d-1), d, d)
    traction: Floats
    left: Floats  # Largest force or moment left over, as a stress; shape (n,)

    @classmethod
    def none(cls, d: int) -> EquilibratedTractions:
        """Return no boxes."""
        empty = np.zeros((0, 2 * d, 1 << (d - 1), d, d))
        return cls(np.zeros(0, dtype=np.int64), empty, np.zeros(0))

    def at(self, box: Ints) -> Ints:
        """Return where boxes stand among these, -1 for those that do not."""
        if not len(self.box):
            return np.full(len(box), -1)
        place = np.minimum(np.searchsorted(self.box, box), len(self.box) - 1)
        return np.where(self.box[place] == box, place, -1)


def ragged_tractions(
    boxes: BoundCells, normal: Floats, pressed: Floats, springs: Floats, uneven: Flags, small: float
) -> EquilibratedTractions:
    """Return tractions of uneven boxes, and of those that help to balance them."""
    # By side and box are `normal` the normal tractions of all boxes by their own middles, `pressed`
    # the normal stress of the loads on bare sides, and `springs` that on beds by how far these have
    # given way; `small` is a stress that may be left over.
    if not uneven.any():
        return EquilibratedTractions.none(boxes.dimension)
    hanging = boxes.hanging
    # Smaller boxes before a side alone leave no box out of balance.
    helps = uneven.copy()
    helps[hanging.box] = False
    uneven = uneven.copy()
    uneven[hanging.box] = True
    for layers in WIDER:
        found = _taken(boxes, normal, pressed, springs, np.flatnonzero(uneven))
        off = _imbalance(boxes, found)
        group, left = np.arange(len(off)), np.abs(off).max(axis=1, initial=0.0)
        ended = True
        helps[found.box[left > small]] = True
        if left.max(initial=0.0) > small:
            group, ended = _pass_on(boxes, found, off, helps[found.box], small)
            left = np.abs(_imbalance(boxes, found)).max(axis=1, initial=0.0)
        found = replace(found, left=left)
        far = found.box[np.isin(group, group[left > small])]
        if not (len(far) and ended):
            break
        for _ in range(layers):
            around = boxes.beside[:, far].ravel()
            larger = hanging.box[np.isin(hanging.fine, far).any(axis=1)]
            smaller = hanging.fine[np.isin(hanging.box, far)].ravel()
            far = np.unique(np.concatenate([far, around[around >= 0], larger, smaller]))
        helps[far] = True
        uneven |= helps
    return found


@lru_cache(maxsize=2)
def _parted(d: int) -> Floats:
    """Return the modes on the parts of a side by those on the whole: shape (2^(d-1), d, d)."""
    split = np.zeros((1 << (d - 1), d, d))
    for one, end in zip(split, corner_ends(d - 1), strict=True):
        one[0] = [1.0, *(0.5 * end - 0.25)]
        one[range(1, d), range(1, d)] = 0.5
    return split


def _mode(side: int, component: int) -> int:
    """Return the mode that is the slope along a component's own axis."""
    return 1 + component - (component > side // 2)


def _whole(boxes: BoundCells, box: Ints, dragged: Floats) -> Floats:
    """Return shear stresses on whole sides of boxes, shape (n, 2·d, d, d)."""
    d = boxes.dimension
    whole = np.zeros((len(box), 2 * d, d, d))
    for pair, tau in boxes.shear.items():
        t = tau[..., box]
        for upper, (axis, other) in product((0, 1), (pair, pair[::-1])):
            low, high = t[upper] if axis < other else t[:, upper]
            side = 2 * axis + upper
            whole[:, side, other, 0] = 0.5 * (low + high)
            whole[:, side, other, _mode(side, other)] = high - low
    kind = boxes.kind[:, box].T
    slides = (kind < 0) & np.isin(kind, (AIR, ROLLER, FOUNDATION))
    whole[slides] = 0.0
    # A load on a side between two boxes parts their tractions.
    own = np.where((slides | (kind >= 0))[..., None], dragged[..., box].transpose(2, 0, 1), 0.0)
    whole[..., 0] += own
    return whole


def _dragged(boxes: BoundCells) -> Floats:
    """Return the shear stresses that loads put on sides, shape (2·d, d, boxes)."""
    d, (box, side, force) = boxes.dimension, boxes.loads
    dragged = np.zeros((2 * d, d, len(boxes.size)))
    outward = 2.0 * (side % 2) - 1.0
    for component in range(d):
        along = np.flatnonzero((side // 2 != component) & (force[:, component] != 0.0))
        stress = outward * force[:, component] / boxes.size[box] ** (d - 1)
        np.add.at(dragged[:, component], (side[along], box[along]), stress[along])
    return dragged


def _taken(
    boxes: BoundCells, normal: Floats, pressed: Floats, springs: Floats, box: Ints
) -> EquilibratedTractions:
    """Return the tractions that boxes have by their middles and corners, and by who is beside."""
    d, hanging = boxes.dimension, boxes.hanging
    dragged = _dragged(boxes)
    whole = _whole(boxes, box, dragged)
    traction = np.einsum("qml,nscl->nsqcm", _parted(d), whole)
    found = EquilibratedTractions(box, traction, np.zeros(len(box)))
    at = found.at(hanging.box)
    for part, fine in enumerate(hanging.fine.T):
        own = _whole(boxes, fine, dragged)[np.arange(len(at)), hanging.side ^ 1]
        between = dragged[hanging.side, :, hanging.box] - dragged[hanging.side ^ 1, :, fine]
        own[..., 0] += between
        traction[at, hanging.side, part] = own
    mine = np.empty((2 * d, len(box)))
    body = 0.5 * boxes.body[:, box] * boxes.size[box]
    for axis in range(d):
        middle = boxes.sigma[axis, box]
        low, high = middle + body[axis], middle - body[axis]
        for side in range(2 * d):
            if side // 2 != axis:
                sign = side % 2 - 0.5
                first, last = _through(found, whole, boxes, side, axis, at)
                low, high = low + sign * first, high - sign * last
        mine[2 * axis], mine[2 * axis + 1] = low, high
    for bed in boxes.beds:
        # What box and bed say of the traction between them, the softer one counting more.
        at_bed = found.at(bed.box)
        here = at_bed >= 0
        at_bed, own = at_bed[here], bed.box[here]
        share = boxes.law.stretch[own] / boxes.size[own]
        share = share / (share + bed.stiffness[here])
        mine[bed.side, at_bed] += share * (springs[bed.side, own] - mine[bed.side, at_bed])
    everyone = normal.copy()
    everyone[:, box] = mine
    ragged = np.zeros(len(boxes.size), dtype=np.bool_)
    ragged[box] = True
    for side in range(2 * d):
        other, kind = boxes.beside[side, box], boxes.kind[side, box]
        alike = (other >= 0) & (boxes.size[other] == boxes.size[box])
        # A load on a side between two boxes parts their tractions.
        theirs = everyone[side ^ 1, other] - pressed[side ^ 1, other] + pressed[side, box]
        mean = np.where(ragged[other], 0.5 * (mine[side] + theirs), theirs)
        free = (other < 0) & (kind == AIR)
        mine[side] = np.where(alike, mean, np.where(free, pressed[side, box], mine[side]))
        traction[:, side, :, side // 2, 0] = mine[side][:, None]
    everyone[:, box] = mine
    for part, small in enumerate(hanging.fine.T):
        theirs = everyone[hanging.side ^ 1, small] - pressed[hanging.side ^ 1, small]
        theirs = theirs + pressed[hanging.side, hanging.box]
        traction[at, hanging.side, part, hanging.side // 2, 0] = theirs
    traction += uneven_modes(boxes, found)
    return found


def uneven_modes(boxes: BoundCells, found: EquilibratedTractions) -> Floats:
    """Return the tractions that loads lying unevenly on sides add to their mean."""
    loads, added = boxes.uneven_loads, np.zeros_like(found.traction)
    at = found.at(loads.box)
    here = np.flatnonzero(at >= 0)
    slopes = np.einsum("qms,ncs->nqcm", _parted(boxes.dimension)[:, :, 1:], loads.modes(boxes.size))
    np.add.at(added, (at[here], loads.side[here]), slopes[here])
    return added


def _through(
    found: EquilibratedTractions,
    whole: Floats,
    boxes: BoundCells,
    side: int,
    component: int,
    at: Ints,
) -> tuple[Floats, Floats]:
    """Return a shear stress at both ends of a side along its component: what the equations take."""
    # Where smaller boxes hang it is the mean on either half.
    mode = _mode(side, component)
    mean, slope = whole[:, side, component, 0], 0.5 * whole[:, side, component, mode]
    low, high = mean - slope, mean + slope
    on = at[boxes.hanging.side == side]
    upper = corner_ends(boxes.dimension - 1)[:, mode - 1] == 1
    taken = found.traction[on, side, :, component, 0]
    low[on], high[on] = taken[:, ~upper].mean(axis=1), taken[:, upper].mean(axis=1)
    return low, high


def _imbalance(boxes: BoundCells, found: EquilibratedTractions) -> Floats:
    """Return forces and moments that boxes are left with, over powers of the edge."""
    return np.asarray(found_data(boxes, found) @ balance_rows(boxes.dimension, 2).T)


def found_data(
    boxes: BoundCells, found: EquilibratedTractions, some: Ints | slice = slice(None)
) -> Floats:
    """Return the tractions on ragged boxes, and the forces within: data of `crossed.Form`."""
    box, shape = found.box[some], found.traction.shape
    traction = found.traction[some].reshape(len(box), prod(shape[1:]))
    return np.concatenate([traction, (boxes.body[:, box] * boxes.size[box]).T], axis=1)


class _Joint(NamedTuple):
    """Sides between ragged boxes: who has it, which side, and which part of it (-1: all)."""

    box: Ints
    side: Ints
    part: Ints


@lru_cache(maxsize=2)
def _passing(d: int) -> Floats:
    """Return what sides and their parts pass on: stresses that move like a rigid body."""
    # By side and part (first all of it), forces along the axes and turns between pairs, as
    # tractions (`EquilibratedTractions`): shape (2·d, 1 + 2^(d-1), d (d + 1) / 2, 2^(d-1), d, d).
    pairs = list(combinations(range(d), 2))
    parts = 1 << (d - 1)
    modes = np.zeros((2 * d, 1 + parts, d + len(pairs), parts, d, d))
    for side in range(2 * d):
        whole = np.zeros((d + len(pairs), d, d))
        whole[range(d), range(d), 0] = 1.0
        for number, (i, j) in enumerate(pairs, start=d):
            for component, along, sign in ((j, i, 2.0), (i, j, -2.0)):
                if along != side // 2:
                    whole[number, component, _mode(side, along)] = sign
        modes[side, 0] = np.einsum("qml,kcl->kqcm", _parted(d), whole)
        for part in range(parts):
            modes[side, 1 + part, :, part] = whole
    return modes


@lru_cache(maxsize=2)
def _felt(d: int) -> Floats:
    """Return the forces and moments that boxes feel of what is passed on, shape (2·d, ., k, k)."""
    modes = _passing(d)
    rows = balance_rows(d, 2)[:, :-d].reshape(modes.shape[2], 2 * d, *modes.shape[3:])
    return np.asarray(np.einsum("fsqcm,spkqcm->spfk", rows, modes))


@lru_cache(maxsize=2)
def _slips(d: int) -> Flags:
    """Tell what a side without friction does not pass on, shape (2·d, d (d + 1) / 2)."""
    modes = _passing(d)[:, 0]
    return np.stack([np.delete(m, s // 2, axis=2).any(axis=(1, 2, 3)) for s, m in enumerate(modes)])


def _pass_on(
    boxes: BoundCells, found: EquilibratedTractions, off: Floats, helps: Flags, small: float
) -> tuple[Ints, bool]:
    """Let boxes pass on what they are left with, through the sides between them."""
    # Returns the groups of boxes that did so with each other, and whether the iteration came to its
    # end.
    d = boxes.dimension
    first, second, stiff, slides = _joints(boxes, found, helps)
    count, kinds = len(first.box), off.shape[1]
    two = np.flatnonzero(second.box >= 0)
    graph = (np.ones(len(two)), (first.box[two], second.box[two]))
    shape = (len(found.box), len(found.box))
    _, group = connected_components(sp.coo_array(graph, shape=shape), directed=False)
    if not count:
        return np.asarray(group), True
    row, column, value = [], [], []
    for joint in (first, second):
        there = np.flatnonzero(joint.box >= 0)
        felt = _felt(d)[joint.side[there], joint.part[there] + 1]
        slips = slides[there, None] & _slips(d)[joint.side[there]]
        shape = felt.shape
        value.append(np.where(slips[:, None], 0.0, felt).ravel())
        own = kinds * joint.box[there, None, None] + np.arange(kinds)[:, None]
        row.append(np.broadcast_to(own, shape).ravel())
        passed = kinds * there[:, None, None] + np.arange(kinds)
        column.append(np.broadcast_to(passed, shape).ravel())
    entries = [np.concatenate(part) for part in (value, row, column)]
    # Forces and moments as they are, so that boxes of all sizes move alike.
    size = boxes.size[found.box][:, None]
    real = np.concatenate([np.tile(size ** (d - 1), d), np.tile(size**d, kinds - d)], axis=1)
    real = real.ravel()
    entries[0] *= real[entries[1]]
    used, entries[1] = np.unique(entries[1], return_inverse=True)
    take = sp.csr_array((entries[0], (entries[1], entries[2])), shape=(len(used), kinds * count))
    take.eliminate_zeros()
    weight = sp.diags_array(np.repeat(stiff / size[first.box, 0] ** d, kinds))
    matrix = sp.csr_array(take @ weight @ take.T)
    diagonal = matrix.diagonal()
    diagonal[diagonal == 0.0] = 1.0
    # One box of every group that no wall holds is kept from floating where there are factors.
    _, start = np.unique(group, return_index=True)
    loose = start[~np.isin(group[start], group[first.box[(second.box < 0) & ~slides]])]
    holds = np.where(np.isin(used // kinds, loose), HOLD * diagonal, 0.0)
    left, flat = -(off.ravel() * real)[used], np.zeros(kinds * count)
    share = SMALLER * small / float(np.abs(off).max())
    exact, moved_by = _solver(matrix, holds, d, share)
    enough, ended = max(ROUNDING, 0.0 if exact else 5.0 * share), True
    for _ in range(5):
        # What rounding has left of the largest tractions is passed on once more.
        rest = left - take @ flat
        if not ended or np.abs(rest).max() <= enough * np.abs(left).max():
            break
        moved, came = moved_by(rest)
        if not came and flat.any():
            break  # what an iteration makes of rounding is no improvement
        flat += weight @ (take.T @ moved)
        ended = came
    passed = flat.reshape(-1, kinds)
    for joint in (first, second):
        there = np.flatnonzero(joint.box >= 0)
        modes = _passing(d)[joint.side[there], joint.part[there] + 1]
        change = np.einsum("nk,nkqcm->nqcm", passed[there], modes)
        np.add.at(found.traction, (joint.box[there], joint.side[there]), change)
    return np.asarray(group), ended


def _solver(
    matrix: sp.csr_array, holds: Floats, d: int, share: float
) -> tuple[bool, Callable[[Floats], tuple[Floats, bool]]]:
    """Return what solves a system: by factors, or by iteration where they would fill memory."""
    # An iteration leaves a share, and says whether it came to its end.
    diagonal = matrix.diagonal()
    if matrix.shape[0] <= FACTORED[d]:
        try:
            factor = factors_of(matrix + sp.diags_array(holds))
        except RuntimeError:
            # Forces that nobody passes on: what holding all adds is passed on once more.
            held = np.where(diagonal > 0.0, HOLD * diagonal, 1.0)
            factor = factors_of(matrix + sp.diags_array(held))
        return True, lambda right: (np.asarray(factor.solve(right)), True)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    firm = matrix + sp.diags_array(holds)
    alike = sp.csr_array(sp.diags_array(scale) @ firm @ sp.diags_array(scale))

    def solved(right: Floats) -> tuple[Floats, bool]:
        # What is left after so many steps is told as left over.
        found, steps = sl.cg(alike, scale * right, rtol=max(share, ROUNDING), maxiter=MOST_STEPS)
        return np.asarray(scale * found), steps == 0

    return False, solved


def _joints(
    boxes: BoundCells, found: EquilibratedTractions, helps: Flags
) -> tuple[_Joint, _Joint, Floats, Flags]:
    """Return sides with helping boxes on both sides, a wall or a bed; stiffness; who slides."""
    stretch, hanging = boxes.law.stretch, boxes.hanging
    bedding = np.full((2 * boxes.dimension, len(boxes.size)), np.inf)
    for bed in boxes.beds:
        bedding[bed.side, bed.box] = bed.stiffness * boxes.size[bed.box]
    own = np.flatnonzero(helps)
    mine: list[Ints] = []

    def helper(box: Ints) -> Ints:
        at = found.at(box)
        return np.where((at >= 0) & helps[at], at, -1)

    for side in range(2 * boxes.dimension):
        box = found.box[own]
        other, kind = boxes.beside[side, box], boxes.kind[side, box]
        alike = (other >= 0) & (boxes.size[other] == boxes.size[box])
        at = helper(other)
        if side % 2:
            here = alike & (at >= 0)
            mine.append(_joint_rows(own[here], side, at[here], side ^ 1, -1, 0))
        wall = (other < 0) & (np.isin(kind, (RIGID, ROLLER)) | np.isfinite(bedding[side, box]))
        slides = (kind[wall] != RIGID).astype(np.int64)
        mine.append(_joint_rows(own[wall], side, np.full(len(slides), -1), side ^ 1, -1, slides))
    large = helper(hanging.box)
    for part, small in enumerate(hanging.fine.T):
        fine = helper(small)
        here = np.flatnonzero((large >= 0) & (fine >= 0))
        coarse = hanging.side[here]
        mine.append(_joint_rows(fine[here], coarse ^ 1, large[here], coarse, part, 0))
    box, side, second, across, part, loose = np.concatenate(mine, axis=1)
    beyond = np.where(second >= 0, second, box)
    stiff = np.minimum(stretch[found.box[box]], stretch[found.box[beyond]])
    stiff = 1.0 / (1.0 / stiff + 1.0 / np.where(second < 0, bedding[side, found.box[box]], np.inf))
    first = _Joint(box, side, np.full_like(part, -1))
    return first, _Joint(second, across, part), stiff, loose.astype(np.bool_)


def _joint_rows(*columns: Ints | int) -> Ints:
    return np.stack(np.broadcast_arrays(*columns))
