"""A strip of cooked noodle between two teeth, as a lattice of three-element springs.

Run `run.py` for the pictures; MODEL.md tells what there is to see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju import History, SpringNetwork, ThreeElement, creep
from kaju.model.network import triangular
from kaju.model.rheology.creeping_network import NetworkCreepResult

Floats = NDArray[np.float64]

HEIGHT = 2.5e-3
"""Thickness of the cooked strip (m): between 2.25 and 2.85 mm were measured by N. H. Oh et
al., Cereal Chemistry 60 (1983) 433."""
LENGTH = 10e-3  # Length of the strip between the hands (m); chosen
BREADTH = 5e-3  # Breadth of the strip along the teeth (m); chosen
TOOTH = 1.6e-3  # Width of a tooth's edge along the strip (m); of the order of an incisor's


@dataclass(frozen=True)
class Noodle:
    """A noodle's material."""

    name: str  # in the pictures
    youngs_modulus: float  # E (Pa)
    retardation_time: float  # D_f/K_f (s): how long it takes to give
    flow_time: float  # D_d/K_f (s): after this time it has flowed as far as it has given

    def spring(self) -> ThreeElement:
        """Return the spring between two nodes.

        A triangular lattice of springs K is as stiff as a sheet with E t = 2K/√3, however
        far its nodes lie apart: so K is the same for every number of nodes.
        """
        stiffness = 0.5 * np.sqrt(3.0) * self.youngs_modulus * BREADTH
        return ThreeElement(
            stiffness, stiffness * self.retardation_time, stiffness * self.flow_time
        )


# E: creep tests of cooked strands, "Studies on the Rheological Property of Korean Noodles I",
# Korea 1983 (koreascience.or.kr, JAKO198303041889139): wheat flour noodles 7.0e5 dyn/cm²,
# noodles of wheat and sweet potato starch 3.9e5 dyn/cm². The times are chosen: fractions of
# a second to give, tens of seconds to flow are of the order of what such tests show.
FIRM = Noodle("firm (wheat flour)", 7.0e4, 0.15, 40.0)
SOFT = Noodle("soft (wheat and starch)", 3.9e4, 0.30, 12.0)


@dataclass(frozen=True)
class Meal:
    """What the teeth do: one slow bite, and then chewing, always with the same force."""

    force: float = 0.05  # by which each tooth presses (N)
    press: float = 0.3  # how long the first bite takes (s)
    hold: float = 3.0  # how long it is held (s)
    rest: float = 4.0  # how long the noodle is left alone after it (s), and in the end
    chews: int = 3  # bites that follow
    period: float = 0.6  # how long each of them takes (s): half to close, half to open

    @property
    def chewing(self) -> float:
        """When the first chew begins (s)."""
        return self.press + self.hold + self.rest

    def history(self) -> History:
        """Return the whole meal: the force over time, as a share of the largest."""
        meal = History().ramp(1.0, self.press).hold(self.hold).release().hold(self.rest)
        if self.chews:
            meal = meal.cycles(self.chews, self.period)
        return meal.hold(self.rest)

    def moments(self) -> Floats:
        """Return when to look (s): closer where things go fast, and whenever a chew is deepest."""
        later = np.linspace(0.1, 1.0, 24) ** 2
        parts = [self.press * np.linspace(0.0, 1.0, 9), self.press + self.hold * later]
        parts += [self.chewing - self.rest + self.rest * later]
        parts += [
            self.chewing + self.period * (chew + np.linspace(0.0, 1.0, 19)[1:])
            for chew in range(self.chews)
        ]
        over = self.chewing + self.period * self.chews
        every = np.unique(np.concatenate([*parts, over + self.rest * later]).round(9))
        return np.minimum(every, self.history().duration)  # which rounding may exceed


@dataclass(frozen=True, eq=False)
class Bite:
    """What was seen at k moments while a noodle was eaten."""

    meal: Meal
    course: NetworkCreepResult  # the strip in time

    @property
    def force(self) -> Floats:
        """By which each tooth presses (N), (k,)."""
        return self.meal.force * self.course.factors

    @property
    def dent(self) -> Floats:
        """Loss of height between the teeth (m), (k,)."""
        top, bottom = bitten(self.course.network)
        height = self.course.displacement[..., 1]
        return np.asarray(height[:, bottom].mean(axis=1) - height[:, top].mean(axis=1))

    @property
    def released(self) -> int:
        """The last moment of the first bite."""
        return self.course.record_at(self.meal.press + self.meal.hold)

    @property
    def rested(self) -> int:
        """The last moment before the noodle is chewed."""
        return self.course.record_at(self.meal.chewing)

    @property
    def deepest(self) -> list[float]:
        """Dent at the end of the first bite, and in the middle of every chew after it (m)."""
        middles = self.meal.chewing + self.meal.period * (0.5 + np.arange(self.meal.chews))
        records = [self.released, *(self.course.record_at(time) for time in middles.tolist())]
        return [float(self.dent[record]) for record in records]


def strip(noodle: Noodle, rows: int) -> SpringNetwork:
    """Return the strip at rest, its ends held by the hands; an odd number of rows of nodes."""
    spacing = HEIGHT / (0.5 * np.sqrt(3.0) * (rows - 1))
    width = 2 * round(0.5 * LENGTH / spacing) + 1  # with a node in the very middle
    return triangular(width, rows, spacing=spacing, stiffness=noodle.spring().K_f, force=0.0)


def bitten(network: SpringNetwork) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the nodes under the upper tooth, and those over the lower one."""
    x, y = network.positions.T
    between = np.abs(x - x.mean()) <= 0.5 * TOOTH * (1.0 + 1e-9)
    top = np.flatnonzero(between & np.isclose(y, y.max()))
    bottom = np.flatnonzero(between & np.isclose(y, y.min()))
    return top, bottom


def eat(noodle: Noodle, rows: int = 9, meal: Meal | None = None) -> Bite:
    """Bite a noodle, hold it, let it go, and chew it."""
    meal = meal or Meal()
    network = strip(noodle, rows)
    force = np.zeros_like(network.positions)
    for nodes, sense in zip(bitten(network), (-1.0, 1.0), strict=True):
        force[nodes, 1] = sense * meal.force / len(nodes)
    pressed = network.with_loads(force)
    return Bite(
        meal, creep(pressed, meal.history(), times=meal.moments(), rheology=noodle.spring())
    )
