"""What is solved on true outlines: body, law, supports and loads, in numbers near 1."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.scales import Scales

from .arc_triangles import ArcFrames
from .convex_pieces import ON_LINE
from .laws import Law
from .true_shapes import TrueBody, TrueRegion

SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}
"""Of each side of the array its axis, and whether it is the upper one."""
ROUNDING = 1e-7  # share by which the bounds are set wider, for coordinates are rounded
OF_LAW = 1e3 * np.finfo(np.float64).eps
"""The same for the law, times its condition: next to ν = 1/2 it leaves few digits of an energy."""
LEVEL = 1e-9  # sine of the angle to a force below which a side is along it


@dataclass(frozen=True)
class LoadedOutline:
    """Tractions s n along the outline of a region, of one stress s and the outward normal n.

    The same stress in the band between both bodies is in balance and right on every curve.
    """

    name: str
    region: int
    stress: Floats  # shape (2, 2)
    facing: Floats | None = None  # a direction: traction acts where it points into the body

    @classmethod
    def pushed(
        cls, name: str, number: int, region: TrueRegion, force: Floats, extent: tuple[int, int]
    ) -> LoadedOutline:
        """Return a force, even across its direction, on all of the outline that faces it."""
        size = np.hypot(*force)
        direction = force / size
        for line in region.lines:
            line.part_along((float(direction[0]), float(direction[1])))
        facing = cls(name, number, np.zeros((2, 2)), direction)
        run = np.diff(along(region, extent), axis=1)[:, 0]
        outward = np.stack([run[:, 1], -run[:, 0]], axis=1) * (1.0 if region.solid else -1.0)
        towards = outward @ direction
        width = -towards[towards < -LEVEL * np.hypot(*run.T)].sum()
        if not width > 0.0:
            return facing
        return replace(facing, stress=-size / width * np.outer(direction, direction))


def along(region: TrueRegion, extent: tuple[int, int]) -> Floats:
    """Return the chords or tangents of an outline within the array. Shape (n, 2, 2)."""
    rings = region.rings(not region.solid)
    return within_array(
        np.concatenate([np.stack([one, np.roll(one, -1, axis=0)], axis=1) for one in rings]), extent
    )


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
    scales: Scales

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
    def rounding(self) -> float:
        """Share by which bounds are set wider for rounding."""
        softest, stiffest = self.softest, self.stiffest
        contrast = max(stiff / soft for stiff, soft in zip(stiffest, softest, strict=True))
        law = np.linalg.eigvalsh(stiffest.stiffness).max()
        law /= np.linalg.eigvalsh(softest.stiffness).min()
        # a strip of the stiff material that lies on a line but for rounding counts as the soft one
        return float(ROUNDING + ON_LINE * (contrast - 1.0) + OF_LAW * law)

    @property
    def estimated(self) -> bool:
        """Whether nothing is proved: the weight between a curve and its polygons is left out."""
        curved = any(ArcFrames(region.arcs).turn.any() for region in self.body.regions)
        return bool(self.weight.any() and curved)


class UnlikeError(Exception):
    """The polygons do not have all of the body yet."""


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
