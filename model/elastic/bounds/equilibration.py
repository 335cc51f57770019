"""Equilibrated tractions where one function a side is too simple.

On the parts of the sides of an irregular box (halves; in solids quarters) the tractions are linear.
The shear goes from corner to corner as everywhere, but on a free side it is the load's; a side with
smaller boxes before it takes over theirs. That leaves boxes round re-entrant corners, and beside
loads along the surface, out of balance. They equilibrate by tractions on the sides between them:
the smallest, stiffer neighbours bearing more, that bring every box into balance. The stress within
follows from them (`macroelement`).
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
"""Up to so many unknowns are solved for by factors; beyond, so many iterations at most."""
ROUNDING = 1e-12  # Share of the imbalance that rounding leaves over
SMALLER = 0.1  # What an iteration leaves, as a share of what may be left over
WIDER = (1, 1, 2, 8, 32, 0)
"""So many more layers round unbalanced boxes help as well, time after time: a group of boxes is
left with the sum of what rounding leaves on all their sides, until it reaches a wall."""


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


def equilibrate(
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
    helps, uneven = uneven.copy(), uneven.copy()
    helps[hanging.box] = False
    uneven[hanging.box] = True
    for layers in WIDER:
        found = _averaged(boxes, normal, pressed, springs, np.flatnonzero(uneven))
        off = _imbalance(boxes, found)
        group, left = np.arange(len(off)), np.abs(off).max(axis=1, initial=0.0)
        converged = True
        helps[found.box[left > small]] = True
        if left.max(initial=0.0) > small:
            group, converged = _exchange(boxes, found, off, helps[found.box], small)
            left = np.abs(_imbalance(boxes, found)).max(axis=1, initial=0.0)
        found = replace(found, left=left)
        far = found.box[np.isin(group, group[left > small])]
        if not (len(far) and converged):
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
def _split(d: int) -> Floats:
    """Return the modes on the parts of a side by those on the whole: shape (2^(d-1), d, d)."""
    split = np.zeros((1 << (d - 1), d, d))
    for one, end in zip(split, corner_ends(d - 1), strict=True):
        one[0] = [1.0, *(0.5 * end - 0.25)]
        one[range(1, d), range(1, d)] = 0.5
    return split


def _mode(side: int, axis: int) -> int:
    """Return the mode of a side that is the slope along an axis."""
    return 1 + axis - (axis > side // 2)


def _shear_on_sides(boxes: BoundCells, box: Ints, dragged: Floats) -> Floats:
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


def _shear_of_loads(boxes: BoundCells) -> Floats:
    """Return the shear stresses that loads put on sides, shape (2·d, d, boxes)."""
    d, (box, side, force) = boxes.dimension, boxes.loads
    dragged = np.zeros((2 * d, d, len(boxes.size)))
    outward = 2.0 * (side % 2) - 1.0
    for component in range(d):
        along = np.flatnonzero((side // 2 != component) & (force[:, component] != 0.0))
        stress = outward * force[:, component] / boxes.size[box] ** (d - 1)
        np.add.at(dragged[:, component], (side[along], box[along]), stress[along])
    return dragged


def _averaged(
    boxes: BoundCells, normal: Floats, pressed: Floats, springs: Floats, box: Ints
) -> EquilibratedTractions:
    """Return tractions by the stresses in boxes and in those beside, not yet in balance."""
    d, hanging = boxes.dimension, boxes.hanging
    dragged = _shear_of_loads(boxes)
    whole = _shear_on_sides(boxes, box, dragged)
    traction = np.einsum("qml,nscl->nsqcm", _split(d), whole)
    found = EquilibratedTractions(box, traction, np.zeros(len(box)))
    at = found.at(hanging.box)
    for part, fine in enumerate(hanging.fine.T):
        own = _shear_on_sides(boxes, fine, dragged)[np.arange(len(at)), hanging.side ^ 1]
        between = dragged[hanging.side, :, hanging.box] - dragged[hanging.side ^ 1, :, fine]
        own[..., 0] += between
        traction[at, hanging.side, part] = own
    mine = _normal_on_sides(boxes, found, whole, at)
    for bed in boxes.beds:
        # What box and bed say of the traction between them, the softer one counting more.
        at_bed = found.at(bed.box)
        here = at_bed >= 0
        at_bed, own = at_bed[here], bed.box[here]
        share = boxes.law.stretch[own] / boxes.size[own]
        share = share / (share + bed.stiffness[here])
        mine[bed.side, at_bed] += share * (springs[bed.side, own] - mine[bed.side, at_bed])
    everyone, irregular = normal.copy(), np.zeros(len(boxes.size), dtype=np.bool_)
    everyone[:, box], irregular[box] = mine, True
    for side in range(2 * d):
        other, kind = boxes.beside[side, box], boxes.kind[side, box]
        alike = (other >= 0) & (boxes.size[other] == boxes.size[box])
        # A load on a side between two boxes parts their tractions.
        theirs = everyone[side ^ 1, other] - pressed[side ^ 1, other] + pressed[side, box]
        mean = np.where(irregular[other], 0.5 * (mine[side] + theirs), theirs)
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


def _normal_on_sides(
    boxes: BoundCells, found: EquilibratedTractions, whole: Floats, at: Ints
) -> Floats:
    """Return the normal tractions that balance boxes by their middles, shape (2·d, n)."""
    # Those on both sides differ by the force within, and by what the shear on the other sides does.
    d, box = boxes.dimension, found.box
    body = 0.5 * boxes.body[:, box] * boxes.size[box]
    middle = boxes.sigma[:, box]
    normal: Floats = np.stack([middle + body, middle - body], axis=1).reshape(2 * d, len(box))
    for axis, side in product(range(d), range(2 * d)):
        if side // 2 == axis:
            continue
        mode, sign = _mode(side, axis), side % 2 - 0.5
        mean, slope = whole[:, side, axis, 0], 0.5 * whole[:, side, axis, mode]
        hung = at[boxes.hanging.side == side]
        for end, shear in enumerate((mean - slope, mean + slope)):
            # Where smaller boxes hang it is the mean on either half.
            half = corner_ends(d - 1)[:, mode - 1] == end
            shear[hung] = found.traction[hung, side, :, axis, 0][:, half].mean(axis=1)
            normal[2 * axis + end] += (1 - 2 * end) * sign * shear
    return normal


def uneven_modes(boxes: BoundCells, found: EquilibratedTractions) -> Floats:
    """Return the tractions that loads lying unevenly on sides add to their mean."""
    loads, added = boxes.uneven_loads, np.zeros_like(found.traction)
    at = found.at(loads.box)
    here = np.flatnonzero(at >= 0)
    slopes = np.einsum("qms,ncs->nqcm", _split(boxes.dimension)[:, :, 1:], loads.modes(boxes.size))
    np.add.at(added, (at[here], loads.side[here]), slopes[here])
    return added


def _imbalance(boxes: BoundCells, found: EquilibratedTractions) -> Floats:
    """Return forces and moments that boxes are left with, over powers of the edge."""
    return np.asarray(traction_data(boxes, found) @ balance_rows(boxes.dimension, 2).T)


def traction_data(
    boxes: BoundCells, found: EquilibratedTractions, some: Ints | slice = slice(None)
) -> Floats:
    """Return the tractions on irregular boxes, and the forces within: data of a `Macroelement`."""
    box, shape = found.box[some], found.traction.shape
    traction = found.traction[some].reshape(len(box), prod(shape[1:]))
    return np.concatenate([traction, (boxes.body[:, box] * boxes.size[box]).T], axis=1)


class _Joints(NamedTuple):
    """Sides between two boxes that help, or between one and a wall or bed; shape (2, n) or (n,)."""

    box: Ints  # Place of both boxes among those with tractions; -1: a wall or bed
    side: Ints  # Which side of theirs
    part: Ints  # Which part of it, counted from 1; 0: all of it
    stiffness: Floats
    slides: Ints  # 1 where no shear is passed on


@lru_cache(maxsize=2)
def _joint_modes(d: int) -> tuple[Floats, Floats]:
    """Return the tractions that joints pass on, and the forces and moments that boxes feel."""
    # Tractions that move like a rigid body: forces along the axes, turns between pairs of axes. By
    # whether the joint slides, side and part (first all of it) their shape is
    # (2, 2·d, 1 + 2^(d-1), d (d + 1) / 2, 2^(d-1), d, d).
    pairs = list(combinations(range(d), 2))
    parts, kinds = 1 << (d - 1), d + len(pairs)
    modes = np.zeros((2, 2 * d, 1 + parts, kinds, parts, d, d))
    for side in range(2 * d):
        whole = np.zeros((kinds, d, d))
        whole[range(d), range(d), 0] = 1.0
        for number, (i, j) in enumerate(pairs, start=d):
            for component, along, sign in ((j, i, 2.0), (i, j, -2.0)):
                if along != side // 2:
                    whole[number, component, _mode(side, along)] = sign
        shears = np.asarray(np.delete(whole, side // 2, axis=1).any(axis=(1, 2)))
        for slides, passed in enumerate((whole, np.where(shears[:, None, None], 0.0, whole))):
            modes[slides, side, 0] = np.einsum("qml,kcl->kqcm", _split(d), passed)
            for part in range(parts):
                modes[slides, side, 1 + part, :, part] = passed
    rows = balance_rows(d, 2)[:, :-d].reshape(kinds, 2 * d, parts, d, d)
    return modes, np.asarray(np.einsum("fsqcm,zspkqcm->zspfk", rows, modes))


def _exchange(
    boxes: BoundCells, found: EquilibratedTractions, off: Floats, helps: Flags, small: float
) -> tuple[Ints, bool]:
    """Bring boxes into balance by the least tractions on their joints."""
    # Returns the groups of boxes that are joined, and whether the iteration converged.
    d, many = boxes.dimension, len(found.box)
    joints = _joints(boxes, found, helps)
    count, kinds = len(joints.slides), off.shape[1]
    pairs = joints.box[:, joints.box[1] >= 0]
    graph = sp.coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(many, many))
    _, group = connected_components(graph, directed=False)
    if not count:
        return np.asarray(group), True
    modes, effect = _joint_modes(d)
    # Forces and moments as they are, so that boxes of all sizes move alike.
    size = boxes.size[found.box]
    real = np.stack([size ** (d - 1)] * d + [size**d] * (kinds - d), axis=1)
    # Rows are forces and moments of boxes, columns the modes of joints.
    end, joint = np.nonzero(joints.box >= 0)
    box, side, part = (values[end, joint] for values in joints[:3])
    which = joints.slides[joint], side, part
    value = effect[which] * real[box][..., None]
    row = np.broadcast_to(kinds * box[:, None, None] + np.arange(kinds)[:, None], value.shape)
    column = np.broadcast_to(kinds * joint[:, None, None] + np.arange(kinds), value.shape)
    used, row = np.unique(row, return_inverse=True)
    entries = value.ravel(), (row.ravel(), column.ravel())
    take = sp.csr_array(entries, shape=(len(used), kinds * count))
    take.eliminate_zeros()
    weight = sp.diags_array(np.repeat(joints.stiffness / size[joints.box[0]] ** d, kinds))
    matrix = sp.csr_array(take @ weight @ take.T)
    # One box of every group that no wall holds is kept from floating where there are factors.
    _, start = np.unique(group, return_index=True)
    walled = joints.box[0, (joints.box[1] < 0) & (joints.slides == 0)]
    loose = np.isin(used // kinds, start[~np.isin(group[start], group[walled])])
    imbalance, passed = -(off * real).ravel()[used], np.zeros(kinds * count)
    share = SMALLER * small / float(np.abs(off).max())
    exact, solve = _solver(matrix, loose, d, share)
    enough, converged = max(ROUNDING, 0.0 if exact else 5.0 * share), True
    for _ in range(5):
        # What rounding has left of the largest tractions is exchanged once more.
        rest = imbalance - take @ passed
        if not converged or np.abs(rest).max() <= enough * np.abs(imbalance).max():
            break
        moved, came = solve(rest)
        if not came and passed.any():
            break  # what an iteration makes of rounding is no improvement
        passed += weight @ (take.T @ moved)
        converged = came
    change = np.einsum("nk,nkqcm->nqcm", passed.reshape(-1, kinds)[joint], modes[which])
    np.add.at(found.traction, (box, side), change)
    return np.asarray(group), converged


def _solver(
    matrix: sp.csr_array, loose: Flags, d: int, share: float
) -> tuple[bool, Callable[[Floats], tuple[Floats, bool]]]:
    """Return what solves a system: by factors, or by iteration where they would fill memory."""
    # An iteration leaves a share, and says whether it converged.
    diagonal = matrix.diagonal()
    diagonal[diagonal == 0.0] = 1.0
    held = sp.csr_array(matrix + sp.diags_array(np.where(loose, HOLD * diagonal, 0.0)))
    if matrix.shape[0] <= FACTORED[d]:
        try:
            factor = factors_of(held)
        except RuntimeError:
            # Forces that no joint takes: what holding all adds is exchanged once more.
            everywhere = np.where(matrix.diagonal() > 0.0, HOLD * diagonal, 1.0)
            factor = factors_of(matrix + sp.diags_array(everywhere))
        return True, lambda right: (np.asarray(factor.solve(right)), True)
    scale = 1.0 / np.sqrt(diagonal)
    alike = sp.csr_array(sp.diags_array(scale) @ held @ sp.diags_array(scale))

    def solve(right: Floats) -> tuple[Floats, bool]:
        # What is left after so many steps is reported as left over.
        found, steps = sl.cg(alike, scale * right, rtol=max(share, ROUNDING), maxiter=MOST_STEPS)
        return np.asarray(scale * found), steps == 0

    return False, solve


def _joints(boxes: BoundCells, found: EquilibratedTractions, helps: Flags) -> _Joints:
    """Return the sides between helping boxes, and those of theirs on walls and beds."""
    hanging, own, none = boxes.hanging, np.flatnonzero(helps), np.full(1, -1)
    bedding = np.full((2 * boxes.dimension, len(boxes.size)), np.inf)
    for bed in boxes.beds:
        bedding[bed.side, bed.box] = bed.stiffness * boxes.size[bed.box]

    def helper(box: Ints) -> Ints:
        at = found.at(box)
        return np.where((at >= 0) & helps[at], at, -1)

    rows: list[Ints] = []  # boxes and sides on both ends, part of the second side, slides

    def join(*columns: Ints | int) -> None:
        rows.append(np.stack(np.broadcast_arrays(*columns)))

    for side in range(2 * boxes.dimension):
        box = found.box[own]
        other, kind = boxes.beside[side, box], boxes.kind[side, box]
        if side % 2:
            alike = (other >= 0) & (boxes.size[other] == boxes.size[box])
            at = helper(other)
            here = alike & (at >= 0)
            join(own[here], at[here], side, side ^ 1, 0, 0)
        wall = (other < 0) & (np.isin(kind, (RIGID, ROLLER)) | np.isfinite(bedding[side, box]))
        join(own[wall], none, side, side ^ 1, 0, (kind[wall] != RIGID).astype(np.int64))
    large = helper(hanging.box)
    for part, small in enumerate(hanging.fine.T, start=1):
        fine = helper(small)
        here = np.flatnonzero((large >= 0) & (fine >= 0))
        join(fine[here], large[here], hanging.side[here] ^ 1, hanging.side[here], part, 0)
    first, second, side, across, part, slides = np.concatenate(rows, axis=1)
    stretch = boxes.law.stretch[found.box]
    stiff = np.minimum(stretch[first], stretch[np.where(second >= 0, second, first)])
    beyond = np.where(second < 0, bedding[side, found.box[first]], np.inf)
    stiffness = 1.0 / (1.0 / stiff + 1.0 / beyond)
    ends = np.stack([first, second]), np.stack([side, across]), np.stack([0 * part, part])
    return _Joints(*ends, stiffness, slides)
