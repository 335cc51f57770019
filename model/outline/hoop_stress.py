"""Stress along an outline by both fields: means over agents near it, extrapolated to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from kaju.arrays import Flags, Floats, Ints

from .outline_bracket import SLIVER
from .outline_problem import ON_BORDER, place_on

if TYPE_CHECKING:
    from .balanced_pieces import BalancedPieces
    from .outline_bracket import OutlineBracket
    from .outline_problem import OutlineProblem
    from .true_shapes import TrueRegion

_GAP = 0.2  # share of an outline that lies beyond the array where no agent is along it
_CLOSED = 0.1
"""Share of its length by which an outline must go on within an agent to have a direction there."""
_REACH = 2.5  # agents' edges within which means make up the stress at a place of the outline
_BEYOND = 0.2
"""Share of the reach by which parts of one body may lie outside of a bent outline's tangent."""
_FLAT = 0.2  # spread of places, over the largest one, below which there is no slope that way


@dataclass(frozen=True)
class HoopStress:
    """Stresses by agents along an outline, in order, in units of the problem."""

    place: Floats  # shape (n, 2)
    balanced: Floats  # hoop stress of the stress in balance: outside where two materials meet
    moved: Floats  # the same of the displacement, with the tension of the stress in balance
    traction: Floats  # tension across and stress along it that act on the region, (n, 2)
    mean: Floats  # the hoop stress in balance as a mean over the agent there
    met: Flags  # where two materials meet
    reach: Floats  # distance within which means were taken

    @classmethod
    def along(
        cls, region: TrueRegion, problem: OutlineProblem, found: OutlineBracket
    ) -> HoopStress:
        """Return the stresses by agents along the outline of a region."""
        balanced, leaves = found.balanced, found.leaves
        area, middle, stress = balanced.by_law
        certain = balanced.law_of < len(problem.body.laws)
        rows, along, whole = _sides_along(region, balanced, certain)
        run = balanced.ends[rows, 1] - balanced.ends[rows, 0]
        length = np.hypot(run[:, 0], run[:, 1])
        part = np.stack([balanced.law_of[rows], balanced.leaf_of[rows]], axis=1)
        part, of = np.unique(part, axis=0, return_inverse=True)
        law, leaf = part.T

        def mean(values: Floats) -> Floats:
            return np.asarray(np.bincount(of, length * values, len(leaf)) / total)

        total = np.bincount(of, length, len(leaf))
        place = np.stack([mean(c) for c in balanced.ends[rows].mean(axis=1).T], axis=1)
        tx, ty = np.stack([np.bincount(of, c, len(leaf)) for c in run.T])
        onward = np.hypot(tx, ty)
        # tractions from outside: rows run clockwise there, the region's counter-clockwise
        direction = -run / length[:, None]
        across = np.stack([direction[:, 1], -direction[:, 0]], axis=1)
        acting = -balanced.moments[rows].reshape(-1, 2, 2).sum(axis=1) / length[:, None]
        tension, shear = (mean((acting * axis).sum(axis=1)) for axis in (across, direction))
        met = np.bincount(of, balanced.between[rows], len(leaf)) > 0.0

        valid = area[law, leaf] > SLIVER * (leaves.size[leaf] * leaves.unit) ** 2
        valid &= onward > _CLOSED * total
        first = np.unique(of, return_index=True)[1]  # a mean would tear the line's start
        order = np.argsort(along[first])
        if len(order):  # a part beyond the array lies after the end, wherever the line starts
            at = along[first][order]
            gaps = np.diff(at, append=at[0] + whole)
            order = np.roll(order, -1 - gaps.argmax() if gaps.max() > _GAP * whole else 0)
        order = order[valid[order]]
        law, leaf, place = law[order], leaf[order], place[order]
        tx, ty = np.stack([tx, ty])[:, order] / onward[order]
        turned = np.stack([tx * tx, ty * ty, 2.0 * tx * ty], axis=1)
        carried = np.zeros((len(order), 6))
        reach = _REACH * leaves.size[leaf] * leaves.unit
        for number in np.unique(law).tolist():
            one = np.flatnonzero(law == number)
            holds = np.flatnonzero(area[number] > 0.0)
            weight, at = area[number, holds], middle[number, holds]
            each = np.hstack([stress[number, holds], found.fitted.strain_at(holds, at)])
            outward = np.stack([ty, -tx], axis=1)[one]
            carried[one] = _carried(place[one], outward, reach[one], at, weight, each)
        hoop, mean_hoop = ((of * turned).sum(axis=1) for of in (carried[:, :3], stress[law, leaf]))
        stretch = (carried[:, 3:] * turned * [1.0, 1.0, 0.5]).sum(axis=1)
        k, g = np.array(balanced.laws).reshape(-1, 2)[law].T
        tension, shear = tension[order], shear[order]
        moved = (4.0 * k * g * stretch + (k - g) * tension) / (k + g)
        traction = np.stack([tension, shear], axis=1)
        return cls(place, hoop, moved, traction, mean_hoop, met[order], reach)


def _carried(
    at: Floats, outward: Floats, reach: Floats, places: Floats, weight: Floats, values: Floats
) -> Floats:
    """Return values at points, by planes through those within reach and inside (least squares)."""
    out = np.zeros((len(at), values.shape[1]))
    for k, near in enumerate(cKDTree(places).query_ball_point(at, reach)):
        away = (places[near] - at[k]) / reach[k]
        share = weight[near] * (1.0 - np.hypot(*away.T))
        beyond = away @ outward[k] > _BEYOND  # of another outline, across a gap
        if not beyond.all():
            share[beyond] = 0.0
        share /= share.sum()
        middle, mean, root = share @ away, share @ values[near], np.sqrt(share)[:, None]
        slope = np.linalg.lstsq(root * (away - middle), root * (values[near] - mean), _FLAT)[0]
        out[k] = mean - middle @ slope
    return out


def _sides_along(
    region: TrueRegion, balanced: BalancedPieces, certain: Flags
) -> tuple[Ints, Floats, float]:
    """Return the sides along an outline, how far along it they are, and how long it is.

    Those of the body where it ends there, and those outside where two materials meet; what lies
    between two of which neither is certain has none.
    """
    near = np.flatnonzero(balanced.alone | (balanced.between & certain))
    outer = [not region.solid] if balanced.alone[near].all() else [False, True]
    rows, places, long = [], [], 1.0
    for polygon in outer:
        border = region.shape.border(polygon)
        on, at = place_on(balanced.ends[near].mean(axis=1), border)
        long = np.hypot(*(border[:, 1] - border[:, 0]).T).sum()
        ends = [place_on(balanced.ends[near, k], border)[1] for k in (0, 1)]
        outside = (ends[1] - ends[0]) % long > 0.5 * long
        kept = (on < ON_BORDER) & (balanced.alone[near] | outside)
        rows.append(near[kept])
        places.append(at[kept] / long)
        near = near[~kept]
    return np.concatenate(rows), long * np.concatenate(places), float(long)
