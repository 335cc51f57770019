"""The largest hoop stress along an outline as what a tolerance is about."""

from __future__ import annotations

from math import inf, radians

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Ints
from kaju.errors import ParameterError, SingularPlaceError
from kaju.model.elastic.goals.quantities import (
    HOOP,
    AskedFor,
    Stress,
    quantities_of,
)
from kaju.model.elastic.pair.cut_pair import CutPair
from kaju.model.scene import Scene

from .arc_triangles import ArcFrames, angle
from .hoop_stress import HoopStress
from .outline_loop import STRESSED, Aimed, coarse_along
from .outline_problem import SIDES, OutlineProblem, UnlikeError, along

STEP = 0.25  # share of its error that a generation aims at
OF_CHANGE = 1.0 / 3.0
"""Error after a generation, over what it changed: squares of edges are a fourth."""
NEAR = 1.5  # edges of the agent at a peak within which all agents are as near
LEAST = 0.01  # share of the largest stress below which a peak's error is relative to that share
KINK = radians(0.5)  # angle from which on a corner counts as one


def peak_asked(scene: Scene, tolerance_at: AskedFor | None) -> tuple[Stress, ...] | None:
    """Return the peak that `goal` asks for within true outlines.

    Raises
    ------
    ParameterError
        If that is not the hoop stress along one named outline.
    """
    if tolerance_at is None:
        return None
    named = [region.name for region in scene.body.regions if region.name is not None]
    one = tolerance_at[0] if isinstance(tolerance_at, list) and tolerance_at else tolerance_at
    if isinstance(one, str) and tolerance_at in (one, [one]):
        tolerance_at = Stress(one, HOOP)
    asked = quantities_of(tolerance_at)
    if len(asked) > 1 or not isinstance(asked[0], Stress) or asked[0].component != HOOP:
        raise ParameterError(
            "goal: within true outlines a tolerance is about the energy norm, or about the "
            f'largest hoop stress along one outline, such as Stress("bore", "{HOOP}"), got '
            f"{tolerance_at!r}; outlines are {', '.join(named) or 'without names'}"
        )
    at = asked[0].at
    if at not in named:
        near = suggestion(at, named) if isinstance(at, str) else ""
        raise ParameterError(
            f"goal: there is no true outline {at!r}{near}; there is "
            f"{', '.join(named) or 'none with a name'}"
        )
    return (asked[0],)


class OutlinePeak:
    """The largest hoop stress along an outline, generation by generation.

    Its estimated error is the larger of how far both fields differ there, and of a third of what
    the last generation changed. An agent's part in it is about √(its part of the gap) h² / r³ at
    a distance r from the peak: the influence of a stress falls off as 1/r², its error as h/r³.
    There is no estimate before agents where the stress is large are as small as the body is thin.
    """

    def __init__(
        self, which: int, name: str, problem: OutlineProblem, edge: float, tolerance: float
    ):
        self._which, self._region, self._problem = which, problem.body.regions[which], problem
        self._name, self._tolerance = name, tolerance
        self.value = self.off = self.error = inf
        """The stress, its estimated error (in units of the problem), and the same relative."""
        no_limit = f"goal: the stress along {name!r} has no limit, since it"
        for line, inward in zip(self._region.lines, self._region.inward, strict=True):
            frames = ArcFrames(line.arcs)
            kink = angle(frames.last, np.roll(frames.first, -1, axis=0))
            if inward == self._region.solid:
                kink = -kink
            if self._region.solid and len(problem.body.laws) > 1:
                kink = -np.abs(kink)
            within = ((frames.end > 0.0) & (frames.end < problem.shape)).all(axis=1)
            for x, y in edge * frames.end[within & (kink < -KINK)][:1]:
                raise SingularPlaceError(
                    f"{no_limit} has a sharp corner at ({x:g}, {y:g}) m; make it round"
                )
        ends = along(self._region, problem.shape)
        for side, axes in problem.held.items():
            axis, upper = SIDES[side]
            if len(axes) > 1 and (ends[..., axis] == upper * problem.shape[axis]).any():
                raise SingularPlaceError(
                    f"{no_limit} meets the rigid side {side!r}; a roller leaves it one"
                )

    def aim(self, pair: CutPair) -> Aimed:
        """Return the error, what each leaf adds to it, and the share of it to aim at."""
        before, along = self.value, HoopStress.along(pair, self._which)
        nothing = np.zeros(len(pair.leaves))
        if not len(along.place):
            often = coarse_along(pair, self._tolerance)
            if not often.any():
                raise UnlikeError(f"no agent lies along {self._name!r}")
            return Aimed(inf, nothing, STEP, often)
        at = int(np.abs(along.moved).argmax())
        self.value = float(along.moved[at])
        often = self._too_thick(pair, along)
        if often.any():
            self.off = self.error = inf
            return Aimed(inf, nothing, STEP, often)
        largest = max(abs(self.value), LEAST * float(np.abs(pair.mean_stress).max()))
        apart = along.apart(at)
        # where it was within the tolerance, the last agents spawned for something else
        kept = self.off if self.error <= self._tolerance else 0.0
        self.off = max(OF_CHANGE * abs(self.value - before), apart, kept)
        self.error = self.off / largest
        size = pair.leaves.size * pair.leaves.unit
        away = np.hypot(*(pair.leaves.lower() + 0.5 * size[:, None] - along.place[at]).T)
        away = np.maximum(away, NEAR * size[along.leaf[at]])
        part = np.sqrt(np.maximum(pair.share, 0.0)) * size**2 / away**3
        return Aimed(self.error, part, STEP, np.zeros(len(size), dtype=np.int64))

    def _too_thick(self, pair: CutPair, along: HoopStress) -> Ints:
        """Return how often to halve leaves larger than the stressed body there is thick."""
        stress = np.abs(along.moved)
        rows = np.flatnonzero(stress > STRESSED * stress.max())
        border = pair.borders[1]
        ends = pair.balancing.mesh.place[border.ends]
        ways_out = np.stack([border.run[:, 1], -border.run[:, 0]], axis=1)
        size = (pair.leaves.size * pair.leaves.unit)[along.leaf]
        inward = -along.outward if self._region.solid else along.outward
        often = np.zeros(len(pair.leaves), dtype=np.int64)
        for row in rows.tolist():
            # where a line across the body meets the border next
            away, n = ends - along.place[row], inward[row]
            depth, side = away @ n, away @ [-n[1], n[0]]
            meets = ((side[:, 0] > 0.0) != (side[:, 1] > 0.0)) & (ways_out @ n > 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                share = side[:, 0] / (side[:, 0] - side[:, 1])
            at = (depth[:, 0] + share * (depth[:, 1] - depth[:, 0]))[meets]
            at = at[at > 0.0]
            if len(at) and size[row] > at.min():
                often[along.leaf[row]] = min(int(np.ceil(np.log2(size[row] / at.min()))), 3)
        return often
