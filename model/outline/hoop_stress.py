"""Stress along an outline by both fields, agent by agent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.goals.quantities import HOOP
from kaju.model.elastic.moduli import Moduli, equivalent_stress
from kaju.model.elastic.pair.gap import tensors
from kaju.model.elastic.pair.leaves import LeafCells

from .arc_triangles import ArcFrames
from .true_shapes import UNIT, leaf_at, pieces_of

if TYPE_CHECKING:
    from kaju.model.elastic.pair.cut_mesh import CutMesh
    from kaju.model.elastic.pair.cut_pair import CutPair

BESIDE = 2  # agents on either side over which both are compared
LARGE = np.radians(30.0)
"""Angle by which an outline turns in agents that are too large to tell its largest stress.

Of 288 such stresses of 32 random bodies 36 were off by more than was estimated, none of the 141 in
smaller agents.
"""


@dataclass(frozen=True)
class HoopStress:
    """Stresses by agents along an outline, in order, in units of the problem."""

    leaf: Ints
    place: Floats  # shape (n, 2)
    balanced: Floats  # hoop stress of the stress in balance: outside where two materials meet
    hoop: Floats
    """The same of the displacement, with the tension of the stress in balance: the better one."""
    turn: Floats  # angle by which the outline turns in each agent
    von_mises: Floats  # that of von Mises, of this and the traction of the stress in balance
    counts: Flags
    """Which may be the largest; see `OutlinedBody.singular_on`."""

    def counted(self) -> HoopStress:
        """Return those that may be the largest."""
        return HoopStress(**{name: column[self.counts] for name, column in vars(self).items()})

    @property
    def largest(self) -> int | None:
        """Where the stress is largest by amount; None if nowhere, or agents there are too large."""
        at = int(np.abs(self.hoop).argmax()) if len(self.hoop) else -1
        near = np.arange(at - 1, at + 2) % max(len(self.turn), 1)
        return None if at < 0 or self.turn[near].max() > LARGE else at

    def apart(self, at: int, component: str = HOOP) -> float:
        """Return by how much the stress at a place may be off.

        How far both are apart over a few agents, for the stress in balance leaps at the corners of
        polygons; or how far it is off those beside it, should that be more.
        """
        near = slice(max(at - BESIDE, 0), at + BESIDE + 1)
        both = abs(self.balanced[near].mean() - self.hoop[near].mean())
        values: Floats = getattr(self, component)
        beside = values[max(at - 1, 0) : at + 2]
        return float(max(both, np.abs(values[at] - beside).max()))

    @classmethod
    def along(cls, pair: CutPair, region: int) -> HoopStress:
        """Return the stresses by agents along the outline of a region."""
        mesh = pair.balancing.mesh
        at, own, way, whole = _along(pair.along[region], mesh)
        leaf, law, middle, run = mesh.leaf[own], mesh.law[own], at.mean(axis=1), at[:, 1] - at[:, 0]
        long = np.hypot(*run.T)
        d = run / np.maximum(long, 1e-300)[:, None]
        n = np.stack([d[:, 1], -d[:, 0]], axis=1)
        stress = tensors(pair.balancing.stress_at(leaf, middle, law))
        strain = tensors(pair.fitting.strain_at(leaf, middle, law) * [1.0, 1.0, 0.5])
        turned = "na,nab,nb->n"
        tension = np.einsum(turned, n, stress, n)
        # along what is rigid or pinned nothing stretches
        held = region in pair.body.rigid
        stretch = 0.0 * tension if held else np.einsum(turned, d, strain, d)
        k, g = np.array(pair.laws[1]).reshape(-1, 2)[law].T
        moved = (4.0 * k * g * stretch + (k - g) * tension) / (k + g)
        local = tensors(np.stack([moved, tension, np.einsum(turned, d, stress, n)], axis=1))
        plane, own_law = pair.body.asked.plane, Moduli(k + g, k - g, g)
        equivalent = equivalent_stress(local, own_law, slice(None), plane)
        balanced = np.einsum(turned, d, stress, d)
        values = np.column_stack([middle, balanced, moved, equivalent])
        order = np.argsort(way)
        if len(order):  # a fifth or more beyond the array lies after the end, wherever it starts
            gaps = np.diff(way[order], append=way[order[0]] + whole)
            order = np.roll(order, -1 - gaps.argmax() if gaps.max() > 0.2 * whole else 0)
        # Shorter pieces run along sides of an agent, or anywhere, by rounding.
        known = np.isfinite(values).all(axis=1) & (long > 1e-3 * UNIT * pair.leaves.size[leaf])
        order = order[known[order]]
        leaf, long, values = leaf[order], long[order], values[order]
        # one place for each agent that the outline comes through
        group = np.cumsum(np.diff(leaf, prepend=-1) != 0) - 1
        total = np.bincount(group, long)
        means = np.zeros((len(total), values.shape[1]))
        np.add.at(means, group, (long / total[group])[:, None] * values)
        first = np.unique(group, return_index=True)[1]
        turn = turn_in(pair.leaves, pair.body.true.regions[region].arcs)[leaf[first]]
        places, peaked = pair.body.singular_on(region)
        counts = (turn > 0.0) & peaked if places else np.ones(len(turn), dtype=np.bool_)
        balanced, moved, equivalent = means[:, 2:].T
        return cls(leaf[first], means[:, :2], balanced, moved, turn, equivalent, counts)


def turn_in(leaves: LeafCells, arcs: Floats) -> Floats:
    """Return the angle by which arcs turn in each leaf."""
    frames, turn = ArcFrames(arcs), np.zeros(len(leaves))
    for points, share in ((frames.start, 0.25), (frames.tip, 0.5), (frames.end, 0.25)):
        leaf = leaf_at(leaves, points)
        turn += np.bincount(leaf + 1, share * np.abs(frames.turn), len(turn) + 1)[1:]
    return turn


def _along(line: Floats, mesh: CutMesh) -> tuple[Floats, Ints, Floats, float]:
    """Return the edges along a line where laws end, triangles there, their way, and the whole.

    Triangles are those outside, where there are any.
    """
    beside = mesh.beside[mesh.edge]
    other = beside.sum(axis=2) - np.arange(len(beside))[:, None]
    own, side = np.nonzero((other < 0) | (mesh.law[other] != mesh.law[:, None]))
    at = mesh.place[mesh.around[own, side]]
    piece, ahead = pieces_of(line, at)
    kept = (piece >= 0) & (~ahead | (other[own, side] < 0))
    at = np.where(ahead[:, None, None], at, at[:, ::-1])
    long = np.hypot(*(line[:, 1] - line[:, 0]).T)
    way = (np.cumsum(long) - long)[piece]
    return at[kept], own[kept], way[kept], float(long.sum())
