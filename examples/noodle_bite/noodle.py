"""A strip of cooked noodle between two teeth, as a lattice of three-element springs.

Run `run.py` for the pictures; MODEL.md tells what there is to see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kaju.model.network.spring_lattices import triangular
from kaju.model.network.springs import SpringNetwork
from kaju.model.rheology.creep_result import CreepState
from kaju.model.rheology.creeping import creep
from kaju.model.rheology.creeping_network import NetworkCreepResult
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.load_history import History

Floats = NDArray[np.float64]

HEIGHT = 2.5e-3
"""Thickness of the cooked strip (m): between 2.25 and 2.85 mm were measured by N. H. Oh et
al., Cereal Chemistry 60 (1983) 433."""
LENGTH = 10e-3
"""Length of the strip between the hands (m); chosen."""
BREADTH = 5e-3
"""Breadth of the strip along the teeth (m); chosen."""
TOOTH = 1.6e-3
"""Width of a tooth's edge along the strip (m); of the order of an incisor's."""


_STEP = 0.25
"""Longest time step (s). The moments looked at are closer wherever things go fast; against a
tolerance of 1e-4 forces differ by 0.1 %."""


@dataclass(frozen=True)
class Noodle:
    """A noodle's material."""

    name: str
    """What it is called in the pictures."""
    youngs_modulus: float
    """E (Pa)."""
    retardation_time: float
    """D_f/K_f (s): how long it takes to give."""
    flow_time: float
    """D_d/K_f (s): after this time it has flowed as far as it has given."""

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
    """What the teeth do: one slow bite, and then chewing."""

    closing: float = 0.25
    """Part of the height by which the teeth close."""
    press: float = 0.3
    hold: float = 3.0
    rest: float = 4.0
    """How long the first bite takes, is held, and the noodle is left alone after it (s)."""
    chews: int = 3
    """Number of bites that follow."""
    period: float = 0.6
    """How long each of them takes (s): as long to close as to open, free in between."""


@dataclass(frozen=True, eq=False)
class Bite:
    """What was seen while a noodle was eaten."""

    network: SpringNetwork
    """The strip, at rest."""
    times: Floats
    """Moments (s). Shape (k,)."""
    force: Floats
    """Force between the teeth (N), positive when they press. Shape (k,)."""
    displacement: Floats
    """Displacement of the nodes (m). Shape (k, n, 2)."""
    work: Floats
    stored: Floats
    dissipated: Floats
    numerical: Floats
    """Work of the teeth; what of it the springs can give back, what became heat, and what the time
    stepping itself made of it (J). ``work = stored + dissipated + numerical``. Shape (k,)."""
    released: int
    rested: int
    """Index of the first moment at which the noodle was left alone after the first bite, and of the
    last."""

    @property
    def dent(self) -> Floats:
        """Loss of height between the teeth (m), (k,)."""
        top, bottom = bitten(self.network)
        return self.displacement[:, bottom, 1].mean(axis=1) - self.displacement[:, top, 1].mean(
            axis=1
        )

    @property
    def peaks(self) -> list[float]:
        """Largest force of the first bite, and of every chew after it (N)."""
        pressing = np.flatnonzero(self.force > 0.0)
        bites = np.split(pressing, np.flatnonzero(np.diff(pressing) > 1) + 1)
        return [float(self.force[bite].max()) for bite in bites if len(bite)]


def strip(noodle: Noodle, rows: int, width: int | None = None) -> SpringNetwork:
    """Return the strip at rest, its ends held by the hands.

    Parameters
    ----------
    noodle : Noodle
        The material.
    rows : int
        Rows of nodes across the height, an odd number from 3; more rows lie closer together.
    width : int, optional
        Nodes along the strip, an odd number; None: as many as make up `LENGTH`.
    """
    spacing = HEIGHT / (0.5 * np.sqrt(3.0) * (rows - 1))
    if width is None:
        width = 2 * round(0.5 * LENGTH / spacing) + 1  # with a node in the very middle
    return triangular(width, rows, spacing=spacing, stiffness=noodle.spring().K_f, force=0.0)


def bitten(network: SpringNetwork) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the nodes under the upper tooth, and those over the lower one."""
    x, y = network.positions.T
    between = np.abs(x - x.mean()) <= 0.5 * TOOTH * (1.0 + 1e-9)
    top = np.flatnonzero(between & np.isclose(y, y.max()))
    bottom = np.flatnonzero(between & np.isclose(y, y.min()))
    return top, bottom


def grip(network: SpringNetwork, closing: float) -> SpringNetwork:
    """Let the teeth grip the strip, to move by half of `closing` (m) each."""
    held, shift = network.held.copy(), np.zeros_like(network.positions)
    for nodes, sense in zip(bitten(network), (-1.0, 1.0), strict=True):
        held[nodes] = True
        shift[nodes, 1] = sense * 0.5 * closing
    return replace(network, held=held, displacements=shift[None])


def eat(noodle: Noodle, rows: int = 9, meal: Meal | None = None, width: int | None = None) -> Bite:
    """Bite a noodle, hold it, let it go, and chew it.

    Parameters
    ----------
    noodle : Noodle
        The material.
    rows, width : int
        Nodes across and along the strip, as in `strip`.
    meal : Meal, optional
        What the teeth do.
    """
    meal = meal or Meal()
    network = strip(noodle, rows, width)
    gap = meal.closing * HEIGHT
    bite = History().ramp(1.0, meal.press).hold(meal.hold)
    free = History().hold(meal.rest)
    seen = _Seen(network, noodle)
    closing = meal.press * np.linspace(0.0, 1.0, 9)
    held = meal.press + meal.hold * np.linspace(0.1, 1.0, 24) ** 2
    seen.go(grip(network, gap), bite, np.concatenate([closing, held]))
    released = len(seen.times)
    seen.go(network, free, meal.rest * np.linspace(0.1, 1.0, 24) ** 2)
    rested = len(seen.times) - 1
    half = 0.5 * meal.period
    for _ in range(meal.chews):
        # The tooth meets the dent later than it met the fresh strip, and closes as far.
        further = gap - seen.dent()
        seen.go(grip(network, further), History().ramp(1.0, half), half * np.linspace(0.1, 1.0, 9))
        seen.go(network, History().hold(half), half * np.linspace(0.1, 1.0, 9))
    seen.go(network, free, meal.rest * np.linspace(0.1, 1.0, 24) ** 2)
    return seen.bite(released, rested)


class _Seen:
    """A noodle on its way through a meal, and what has been seen of it."""

    def __init__(self, network: SpringNetwork, noodle: Noodle) -> None:
        self.network, self.noodle = network, noodle
        self.state: CreepState | None = None
        self.clock = 0.0
        self.times: list[float] = []
        self.rows: list[tuple[float, Floats, float, float, float, float]] = []

    def go(self, network: SpringNetwork, history: History, times: Sequence[float] | Floats) -> None:
        """Let a part of the meal happen; its time counts from 0."""
        before = None if self.state is None else replace(self.state, time=0.0, next_step=0.0)
        result = creep(
            network, history, times=np.unique(times), rheology=self.noodle.spring(),
            step=_STEP, resume=before,
        )  # fmt: skip
        gripped = bool(network.displacements.any())
        for record, time in enumerate(result.times):
            moved = result.displacement[record]
            pushed = result.outside_forces(record)[bitten(network)[0], 1]
            force = 0.0 - float(pushed.sum()) if gripped else 0.0
            self.times.append(self.clock + float(time))
            self.rows.append((force, moved, *_energies(result, record)))
        self.clock += history.duration
        self.state = result.state

    def dent(self) -> float:
        """Return the loss of height between the teeth by now (m)."""
        top, bottom = bitten(self.network)
        moved = self.rows[-1][1][:, 1]
        return float(moved[bottom].mean() - moved[top].mean())

    def bite(self, released: int, rested: int) -> Bite:
        """Return what was seen."""
        force, moved, *energies = (np.array(column) for column in zip(*self.rows, strict=True))
        times = np.array(self.times)
        return Bite(self.network, times, force, moved, *energies, released, rested)


def _energies(result: NetworkCreepResult, record: int) -> tuple[float, float, float, float]:
    """Return work, what is stored, what became heat, and the time stepping's own (J)."""
    columns = (result.work, result.stored, result.dissipated, result.numerical)
    work, stored, heat, own = (float(column[record]) for column in columns)
    return work, stored, heat, own
