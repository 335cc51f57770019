"""The largest hoop stress along an outline as what a tolerance is about."""

from __future__ import annotations

from math import inf, radians

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Floats
from kaju.errors import ParameterError, SingularPlaceError
from kaju.model.elastic.goals.quantities import (
    HOOP,
    AskedFor,
    Stress,
    quantities_of,
)
from kaju.model.scene import Scene

from .arc_triangles import ArcFrames, angle
from .hoop_stress import HoopStress
from .outline_bracket import OutlineBracket
from .outline_problem import SIDES, OutlineProblem, UnlikeError, within_array

STEP = 0.25  # share of its error that a generation aims at
OF_CHANGE = 1.0 / 3.0
"""Error after a generation, over what it changed: squares of edges are a fourth."""
NEAR = 0.6  # share of the reach of a peak's agents below which all are as near
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
    """

    def __init__(
        self, which: int, name: str, problem: OutlineProblem, edge: float, tolerance: float
    ):
        self._region, self._problem = problem.body.regions[which], problem
        self._name, self._tolerance = name, tolerance
        self.value = self.off = self.error = inf
        """The stress, its estimated error (in units of the problem), and the same relative."""
        no_limit = f"goal: the stress along {name!r} has no limit, since it"
        frames = ArcFrames(self._region.shape.arcs)
        kink = angle(frames.last, np.roll(frames.first, -1, axis=0))
        if not self._region.solid:
            kink = -kink
        elif len(problem.body.laws) > 1:
            kink = -np.abs(kink)
        within = ((frames.end > 0.0) & (frames.end < problem.shape)).all(axis=1)
        for x, y in edge * frames.end[within & (kink < -KINK)][:1]:
            raise SingularPlaceError(
                f"{no_limit} has a sharp corner at ({x:g}, {y:g}) m; make it round"
            )
        ends = within_array(self._region.shape.border(False), problem.shape)
        for side, axes in problem.held.items():
            axis, upper = SIDES[side]
            if len(axes) > 1 and (ends[..., axis] == upper * problem.shape[axis]).any():
                raise SingularPlaceError(
                    f"{no_limit} meets the rigid side {side!r}; a roller leaves it one"
                )

    def aim(self, found: OutlineBracket) -> tuple[float, Floats, float]:
        """Return the error, what each leaf adds to it, and the share of it to aim at."""
        before, along = self.value, HoopStress.along(self._region, self._problem, found)
        if not len(along.place):
            if not found.coarse(self._problem.body, self._tolerance).any():
                raise UnlikeError(f"no agent lies along {self._name!r}")
            return inf, np.zeros(len(found.leaves)), STEP
        at = np.abs(along.balanced).argmax()
        self.value = float(along.balanced[at])
        largest = max(abs(self.value), LEAST * float(np.abs(found.balanced.mean_stress).max()))
        apart = abs(float(along.moved[at]) - self.value)
        # where it was within the tolerance, the last agents spawned for something else
        kept = self.off if self.error <= self._tolerance else 0.0
        self.off = max(OF_CHANGE * abs(self.value - before), apart, kept)
        self.error = self.off / largest
        size = found.leaves.size * found.leaves.unit
        away = np.hypot(*(found.leaves.lower() + 0.5 * size[:, None] - along.place[at]).T)
        away = np.maximum(away, NEAR * along.reach[at])
        part = np.sqrt(np.maximum(found.share, 0.0)) * size**2 / away**3
        return self.error, part, STEP
