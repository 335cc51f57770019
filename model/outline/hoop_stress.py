"""Stress along an outline by both fields, agent by agent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, Ints

if TYPE_CHECKING:
    from kaju.model.elastic.pair.cut_pair import CutPair

_GAP = 0.2  # share of an outline that lies beyond the array where no agent is along it
_ON = 1e-7  # edges this near to an outline (in edges of the first agents) are on it
_AT_ONCE = 1_000_000  # distances
BESIDE = 2  # agents on either side over which both are compared


@dataclass(frozen=True)
class HoopStress:
    """Stresses by agents along an outline, in order, in units of the problem."""

    leaf: Ints
    place: Floats  # shape (n, 2)
    outward: Floats  # unit normals of the region, shape (n, 2)
    balanced: Floats  # hoop stress of the stress in balance: outside where two materials meet
    moved: Floats
    """The same of the displacement, with the tension of the stress in balance: the better one."""
    traction: Floats  # tension across and stress along it that act on the region, (n, 2)
    met: Flags  # where two materials meet

    def apart(self, at: int) -> float:
        """Return by how much the stress at a place may be off.

        How far the mean of both is off it, both over a few agents, for the stress in balance
        leaps at the corners of polygons; or how far it is off those beside it, should that be more.
        """
        near = slice(max(at - BESIDE, 0), at + BESIDE + 1)
        both = 0.5 * abs(self.balanced[near].mean() - self.moved[near].mean())
        beside = self.moved[max(at - 1, 0) : at + 2]
        return float(max(both, np.abs(self.moved[at] - beside).max()))

    @classmethod
    def along(cls, pair: CutPair, region: int) -> HoopStress:
        """Return the stresses by agents along the outline of a region."""
        line = pair.along[region]
        found = [_ends_of_body(pair, region, line), _between_materials(pair, line)]
        start, end, leaf, law = (np.concatenate([one[k] for one in found]) for k in range(4))
        met = np.repeat([False, True], [len(one[0]) for one in found])
        middle, run = 0.5 * (start + end), end - start
        long = np.hypot(*run.T)
        d = run / np.maximum(long, 1e-300)[:, None]
        n = np.stack([d[:, 1], -d[:, 0]], axis=1)
        stress = pair.stress_at(leaf, middle, law)
        strain = pair.strain_at(leaf, middle, law)

        def turned(tensor: Floats, one: Floats, other: Floats) -> Floats:
            xx, yy, xy = tensor.T
            mixed = one[:, 0] * other[:, 1] + one[:, 1] * other[:, 0]
            straight = one[:, 0] * other[:, 0] * xx + one[:, 1] * other[:, 1] * yy
            return np.asarray(straight + mixed * xy)

        tension, shear = turned(stress, n, n), turned(stress, d, n)
        stretch = turned(strain * [1.0, 1.0, 0.5], d, d)
        k, g = np.array(pair.laws[1]).reshape(-1, 2)[law].T
        moved = (4.0 * k * g * stretch + (k - g) * tension) / (k + g)
        values = np.column_stack([middle, d, turned(stress, d, d), moved, tension, shear, met])
        away, whole = _way_along(middle, line)
        order = np.argsort(away)
        if len(order):  # a part beyond the array lies after the end, wherever the line starts
            gaps = np.diff(away[order], append=away[order[0]] + whole)
            order = np.roll(order, -1 - gaps.argmax() if gaps.max() > _GAP * whole else 0)
        order = order[np.isfinite(values[order]).all(axis=1)]
        leaf, long, values = leaf[order], long[order], values[order]
        # one place for each agent that the outline comes through
        group = np.cumsum(np.diff(leaf, prepend=-1) != 0) - 1
        total = np.bincount(group, long) if len(group) else np.zeros(0)
        means = (
            np.stack([np.bincount(group, long * v, len(total)) / total for v in values.T], axis=1)
            if len(group)
            else np.zeros((0, values.shape[1]))
        )
        d = means[:, 2:4] / np.maximum(np.hypot(*means[:, 2:4].T), 1e-300)[:, None]
        first = np.unique(group, return_index=True)[1]
        return cls(
            leaf[first],
            means[:, :2],
            np.stack([d[:, 1], -d[:, 0]], axis=1),
            means[:, 4],
            means[:, 5],
            means[:, 6:8],
            means[:, 8] > 0.5,
        )


Edges = tuple[Floats, Floats, Ints, Ints]
"""Starts and ends, the region to the left, and leaf and law of what bears the stress."""


def _ends_of_body(pair: CutPair, region: int, line: Floats) -> Edges:
    """Return the edges along an outline at which the body ends."""
    mesh, border = pair.balancing.mesh, pair.borders[1]
    rows = np.flatnonzero(border.outline == region)
    leaf, law = mesh.owner
    start, end = (mesh.place[border.ends[rows, k]] for k in (0, 1))
    if not pair.problem.body.regions[region].solid:
        start, end = end, start
    edge = border.edge[rows]
    return start, end, leaf[edge], law[edge]


def _between_materials(pair: CutPair, line: Floats) -> Edges:
    """Return the edges along an outline at which two materials meet: of the one outside."""
    mesh, certain = pair.balancing.mesh, len(pair.problem.body.laws)
    parts = [
        (edges.ravel(), np.repeat(of, edges.shape[1]), np.repeat(kind, edges.shape[1]),
         np.repeat(middle, edges.shape[1], axis=0))
        for (edges, of, kind), middle in zip(
            _elements(pair),
            (mesh.place[mesh.square].mean(axis=1), mesh.place[mesh.triangle].mean(axis=1)),
            strict=True,
        )
    ]  # fmt: skip
    edge, leaf, law, middle = (np.concatenate([one[k] for one in parts]) for k in range(4))
    low, high = np.full(len(mesh.ends), certain), np.full(len(mesh.ends), -1)
    np.minimum.at(low, edge, law)
    np.maximum.at(high, edge, law)
    rows = np.flatnonzero((low[edge] < high[edge]) & (law < certain))
    at = mesh.place[mesh.ends[edge[rows]]]
    off, nearest = _nearest(at.mean(axis=1), line)
    rows, at, nearest = (one[off < _ON] for one in (rows, at, nearest))
    run = line[nearest, 1] - line[nearest, 0]
    # those to the right of the region's line
    away = middle[rows] - at[:, 0]
    outside = run[:, 0] * away[:, 1] - run[:, 1] * away[:, 0] < 0.0
    rows, at, run = rows[outside], at[outside], run[outside]
    back = ((at[:, 1] - at[:, 0]) * run).sum(axis=1) < 0.0
    at = np.where(back[:, None, None], at[:, ::-1], at)
    return at[:, 0], at[:, 1], leaf[rows], law[rows]


def _elements(pair: CutPair) -> tuple[tuple[Ints, Ints, Ints], tuple[Ints, Ints, Ints]]:
    mesh = pair.balancing.mesh
    return (
        (mesh.square_edge, mesh.square_leaf, mesh.square_law),
        (mesh.triangle_edge, mesh.triangle_leaf, mesh.triangle_law),
    )


def _nearest(points: Floats, line: Floats) -> tuple[Floats, Ints]:
    """Return how far points are from the straight pieces of a line, and which is nearest."""
    off, nearest = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    if not len(line):
        return off, nearest
    run = line[:, 1] - line[:, 0]
    square = (run**2).sum(axis=1)
    step = max(_AT_ONCE // len(line), 1)
    for k in range(0, len(points), step):
        away = points[k : k + step, None] - line[:, 0]
        t = np.clip((away * run).sum(axis=2) / square, 0.0, 1.0)
        far = ((away - t[..., None] * run) ** 2).sum(axis=2)
        nearest[k : k + step] = far.argmin(axis=1)
        off[k : k + step] = np.sqrt(far.min(axis=1))
    return off, nearest


def _way_along(points: Floats, line: Floats) -> tuple[Floats, float]:
    """Return how far along a line points lie, and how long it is."""
    nearest = _nearest(points, line)[1]
    run = line[:, 1] - line[:, 0]
    long = np.hypot(*run.T)
    begin = np.cumsum(long) - long
    t = ((points - line[nearest, 0]) * run[nearest]).sum(axis=1) / np.maximum(long[nearest], 1e-300)
    return begin[nearest] + t, float(long.sum())
