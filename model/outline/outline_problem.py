"""What is solved on true outlines: body, law, supports and loads, in numbers near 1."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import rigid_motions

from .balanced_pieces import BalancedPieces
from .convex_pieces import NEAR
from .fitted_displacement import GAUSS, FittedDisplacement
from .laws import Law
from .square_leaves import SquareLeaves
from .true_shapes import HeldLeaves, TrueBody, TrueShape

SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}
"""Of each side of the array its axis, and whether it is the upper one."""
ON_BORDER = 1e-8
"""Middles of sides this near to an outline (in edges of the first agents) lie on it."""
LEVEL = 1e-9  # sine of the angle to a force below which a side is along it


@dataclass(frozen=True)
class LoadedOutline:
    """Tractions s n along the outline of a region, of one stress s and the outward normal n.

    The same stress in the band between both bodies is in balance and right on every curve.
    """

    name: str
    shape: TrueShape
    solid: bool
    stress: Floats  # shape (2, 2)
    facing: Floats | None = None  # a direction: traction acts where it points into the body

    @classmethod
    def pushed(
        cls, name: str, shape: TrueShape, solid: bool, force: Floats, extent: tuple[int, int]
    ) -> LoadedOutline:
        """Return a force, even across its direction, on all of the outline that faces it."""
        size = np.hypot(*force)
        direction = force / size
        shape.part_along((float(direction[0]), float(direction[1])))
        facing = cls(name, shape, solid, np.zeros((2, 2)), direction)
        width = -(facing.outward(facing.taking(extent)) @ direction).sum()
        if not width > 0.0:
            return facing
        return replace(facing, stress=-size / width * np.outer(direction, direction))

    def outward(self, border: Floats) -> Floats:
        """Return the outward normals of the body along its border, times lengths. Shape (n, 2)."""
        run = border[:, 1] - border[:, 0]
        return np.asarray(np.stack([run[:, 1], -run[:, 0]], axis=1) * (1.0 if self.solid else -1.0))

    def taking(self, extent: tuple[int, int], outer: bool = False) -> Floats:
        """Return the straight parts of the inner or outer body's border with a traction."""
        border = within_array(self.shape.border(self.solid is outer), extent)
        outward = self.outward(border)
        if self.facing is None:
            return border
        return np.asarray(border[outward @ self.facing < -LEVEL * np.hypot(*outward.T)])


@dataclass(frozen=True)
class OutlineProblem:
    """A body; lengths in edges of the first agents, its first material's Young's modulus is 1."""

    body: TrueBody
    shape: tuple[int, int]  # first agents along x and y
    held: dict[str, tuple[int, ...]]  # axes along which sides hold
    forces: dict[str, Floats]  # total force on sides, shape (2,)
    tractions: dict[str, Floats]  # further forces on a unit of length of sides
    outlines: tuple[LoadedOutline, ...]
    weight: Floats  # force on a unit of area, shape (2,)
    strain: float  # what loads of 1 stand for: stress over Young's modulus

    @property
    def band(self) -> float:
        """Largest energy (twice) of a unit of area between both bodies, under a load's stress."""
        stresses = [one.stress[[0, 1, 0], [0, 1, 1]] for one in self.outlines]
        return max((float(s @ self.softest.compliance @ s) for s in stresses), default=0.0)

    @property
    def softest(self) -> Law:
        """The stiffest law that is no stiffer than any of the body's."""
        return reduce(lambda one, other: one.with_other(other, stiffer=False), self.body.laws)

    @property
    def stiffest(self) -> Law:
        """The softest law that is no softer than any of the body's."""
        return reduce(lambda one, other: one.with_other(other, stiffer=True), self.body.laws)

    @property
    def held_whole(self) -> bool:
        """Whether the sides hold a body that touches them all against rigid motion."""
        corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], dtype=float) * self.shape
        corner, axis = np.nonzero(self.held_at(corners))
        return len(axis) > 2 and np.linalg.matrix_rank(rigid_motions(corners[corner], axis)) == 3

    def _on_side(self, name: str, points: Floats) -> Flags:
        axis, upper = SIDES[name]
        return np.asarray(points[..., axis] == (self.shape[axis] if upper else 0.0))

    def held_at(self, points: Floats) -> Flags:
        """Tell which components supports hold at points, shape (n, 2)."""
        held = np.zeros((len(points), 2), dtype=np.bool_)
        for name, axes in self.held.items():
            for axis in axes:
                held[:, axis] |= self._on_side(name, points)
        return held

    def held_of(self, field: FittedDisplacement, held: HeldLeaves) -> Flags:
        """Tell which components supports hold at the corners of leaves, shape (nodes, 2).

        Only those of leaves do of which a piece lies along the support.
        """
        fixed = np.zeros((field.nodes, 2), dtype=np.bool_)
        for name, axes in self.held.items():
            axis, upper = SIDES[name]
            wall = self.shape[axis] if upper else 0.0
            on = self._on_side(name, field.place)[field.corner]
            for leaf in np.flatnonzero(on.any(axis=1)).tolist():
                cut = held.cut[leaf].held.values() if held.whole[leaf] < 0 else ()
                pieces = [piece for of in cut for piece in of]
                along = [sum(abs(at[axis] - wall) < ON_BORDER for at in piece) for piece in pieces]
                if held.whole[leaf] >= 0 or max(along, default=0) > 1:
                    fixed[np.ix_(field.corner[leaf][on[leaf]], axes)] = True
        return fixed

    def on_balanced(
        self, pieces: BalancedPieces
    ) -> tuple[Floats, Flags, list[tuple[Floats, Floats]]]:
        """Return the forces on sides of pieces, the components held, and where sides are loaded.

        Raises UnlikeError if the pieces miss a part of an outline that is loaded.
        """
        if self.weight.any() and len(pieces.flat):
            raise UnlikeError("a piece too flat has weight")
        ends = pieces.ends
        force, held = np.zeros((len(ends), 2, 2)), np.zeros((len(ends), 2), dtype=np.bool_)
        run = ends[:, 1] - ends[:, 0]
        length = np.hypot(run[:, 0], run[:, 1])
        loaded = []
        for name in SIDES:
            at = pieces.alone & self._on_side(name, ends).all(axis=1)
            for axis in self.held.get(name, ()):
                held[at, axis] = True
            if name not in self.forces:
                continue
            flat = self._on_side(name, pieces.flat_ends).all(axis=1)
            if flat.any() or not at.any():
                raise UnlikeError(f"{name} has no body, or slivers of it, to be loaded")
            traction = self.forces[name] / length[at].sum() + self.tractions[name]
            if traction.any():
                force[at] += 0.5 * length[at, None, None] * traction
                loaded.append((ends[at], traction))
        for one in self.outlines:
            border = one.taking(self.shape)
            rows = np.flatnonzero(pieces.alone)
            rows = rows[place_on(ends[rows].mean(axis=1), border)[0] < ON_BORDER]
            found = length[rows].sum()
            beside, flat_length = self._beside_flat(pieces, border, one.stress)
            rows = np.union1d(rows, beside)
            outward = np.stack([run[rows, 1], -run[rows, 0]], axis=1)
            force[rows] += 0.5 * (outward @ one.stress)[:, None]
            whole = np.hypot(*(border[:, 1] - border[:, 0]).T).sum()
            if abs(found + flat_length - whole) > 1e-7 * whole:
                raise UnlikeError(one.name)
        return force, held, loaded

    def _beside_flat(
        self, pieces: BalancedPieces, border: Floats, stress: Floats
    ) -> tuple[Ints, float]:
        """Return the sides beside pieces that were left out at a loaded outline.

        The stress there is that of the load, which needs no support but the outline, other such
        pieces, the sides of the body beside them, or a side of the array that holds against it.
        """
        ends = pieces.flat_ends
        on = place_on(ends.mean(axis=1), border)[0] < ON_BORDER
        pressed = np.isin(pieces.flat, pieces.flat[on])
        rows = np.flatnonzero(pieces.alone & np.isin(pieces.side, pieces.flat_side[pressed & ~on]))
        borne = np.isin(pieces.flat_side, pieces.side[rows]) | on
        borne |= (
            np.bincount(pieces.flat_side[pressed], minlength=len(pieces.shared))[pieces.flat_side]
            > 1
        )
        for name, axes in self.held.items():
            if not np.delete(stress[SIDES[name][0]], axes).any():
                borne |= self._on_side(name, ends).all(axis=1)
        run = ends[:, 1] - ends[:, 0]
        length = np.hypot(run[:, 0], run[:, 1])
        if (pressed & ~borne & (length > NEAR)).any():
            raise UnlikeError("a piece too flat")
        return rows, float(length[on].sum())

    def on_fitted(self, field: FittedDisplacement, loaded: list[tuple[Floats, Floats]]) -> Floats:
        """Return the forces on the corners of leaves, shape (nodes, 2)."""
        out = field.weigh(self.weight)
        for ends, traction in loaded:
            run = ends[:, 1] - ends[:, 0]
            weight = 0.5 * np.hypot(run[:, 0], run[:, 1])[:, None] * traction
            inward = np.array([0.5, 0.5]) * self.shape - ends.mean(axis=1)
            for g in GAUSS:
                at = ends[:, 0] + g * run
                leaf = field.leaves.at(at + 1e-9 * inward)
                out += field.spread(leaf, at, weight)
        for one in self.outlines:
            ends = _on_lines(one.taking(self.shape, outer=True), field.leaves)
            run = ends[:, 1] - ends[:, 0]
            outward = one.outward(ends)
            inward = -ON_BORDER * outward / np.hypot(run[:, 0], run[:, 1])[:, None]
            leaf = field.leaves.at(ends.mean(axis=1) + inward)
            if (leaf < 0).any():
                raise UnlikeError(one.name)
            for g in GAUSS:
                out += field.spread(leaf, ends[:, 0] + g * run, 0.5 * outward @ one.stress)
        return out


class UnlikeError(Exception):
    """The pieces do not have all of an outline yet."""


def within_array(border: Floats, extent: tuple[int, int]) -> Floats:
    """Return the parts of straight lines within the array, shape (n, 2, 2)."""
    ends = border
    run = ends[:, 1] - ends[:, 0]
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    for axis in (0, 1):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.array([0.0, extent[axis]]) - ends[:, 0, axis, None]) / run[:, axis, None]
        level = run[:, axis] == 0.0
        outside = level & ((ends[:, 0, axis] < 0) | (ends[:, 0, axis] > extent[axis]))
        low = np.maximum(low, np.where(level, 0.0, t.min(axis=1)))
        high = np.where(outside, -1.0, np.minimum(high, np.where(level, 1.0, t.max(axis=1))))
    kept = high - low > 1e-12
    at = np.stack([low, high], axis=1)[kept]
    return ends[kept, :1] + at[:, :, None] * run[kept, None]


def place_on(points: Floats, border: Floats) -> tuple[Floats, Floats]:
    """Return the distance of points to straight lines, and how far along them the nearest is."""
    best, place, sofar = np.full(len(points), np.inf), np.zeros(len(points)), 0.0
    for start, end in border:
        run = end - start
        length = np.hypot(*run)
        t = np.clip((points - start) @ run / (run @ run), 0.0, 1.0)
        away = np.hypot(*(points - start - t[:, None] * run).T)
        nearer = away < best
        best[nearer], place[nearer] = away[nearer], sofar + t[nearer] * length
        sofar += length
    return best, place


def _on_lines(border: Floats, leaves: SquareLeaves) -> Floats:
    """Return straight lines split where they cross sides of the smallest leaves."""
    edge = leaves.size.min() * leaves.unit
    out = [np.empty((0, 2, 2))]
    for start, end in border:
        cuts = [0.0, 1.0]
        for axis in (0, 1):
            low, high = sorted((start[axis], end[axis]))
            lines = np.arange(np.ceil(low / edge), np.floor(high / edge) + 1) * edge
            if high > low:
                cuts += ((lines - start[axis]) / (end[axis] - start[axis])).tolist()
        at = np.unique(np.clip(cuts, 0.0, 1.0))
        at = start + at[:, None] * (end - start)
        keep = np.hypot(*(at[1:] - at[:-1]).T) > 1e-13
        out.append(np.stack([at[:-1], at[1:]], axis=1)[keep])
    return np.concatenate(out)
