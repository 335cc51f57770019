"""A strip of cooked noodle between two teeth, as a lattice of three-element springs.

Run `run.py` for the pictures; MODEL.md tells what there is to see.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju import History, SpringNetwork, ThreeElement, creep
from kaju.model.network import triangular

Floats = NDArray[np.float64]

HEIGHT = 2.5e-3
"""Thickness of the cooked strip (m): between 2.25 and 2.85 mm were measured by N. H. Oh et
al., Cereal Chemistry 60 (1983) 433."""
LENGTH = 10e-3  # Length of the strip between the hands (m); chosen
BREADTH = 5e-3  # Breadth of the strip along the teeth (m); chosen
TOOTH = 1.6e-3  # Width of a tooth's edge along the strip (m); of the order of an incisor's
STEP = 0.25
"""Longest time step (s). The moments looked at are closer wherever things go fast; against a
tolerance of 1e-4 forces differ by 0.1 %."""


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
    """What the teeth do: one slow bite, and then chewing."""

    closing: float = 0.25  # part of the height by which the teeth close
    press: float = 0.3  # how long the first bite takes (s)
    hold: float = 3.0  # how long it is held (s)
    rest: float = 4.0  # how long the noodle is left alone after it (s)
    chews: int = 3  # bites that follow
    period: float = 0.6  # how long each of them takes (s): half to close, half to open


@dataclass(frozen=True, eq=False)
class Bite:
    """What was seen at k moments while a noodle was eaten."""

    network: SpringNetwork  # the strip at rest, of n nodes
    times: Floats  # (s), shape (k,)
    force: Floats  # between the teeth (N), positive when they press, shape (k,)
    displacement: Floats  # of the nodes (m), shape (k, n, 2)
    work: Floats  # of the teeth (J), shape (k,): stored + dissipated + numerical
    stored: Floats  # what the springs can give back (J)
    dissipated: Floats  # what became heat (J)
    numerical: Floats  # what the time stepping itself made of it (J)
    released: int  # the first moment at which the noodle is left alone after the first bite
    rested: int  # the last such moment

    @property
    def dent(self) -> Floats:
        """Loss of height between the teeth (m), (k,)."""
        return dent_of(self.network, self.displacement)

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


def dent_of(network: SpringNetwork, displacement: Floats) -> Floats:
    """Return the loss of height between the teeth (m), of displacements (..., n, 2)."""
    top, bottom = bitten(network)
    return displacement[..., bottom, 1].mean(axis=-1) - displacement[..., top, 1].mean(axis=-1)


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
    top, _ = bitten(network)
    # Of every part of the meal: times, forces, displacements and energies, as `Bite` has them.
    seen: list[tuple[Any, ...]] = []
    state, clock = None, 0.0

    def go(closing: float, history: History, times: Floats) -> None:
        """Let a part of the meal happen, its time from 0; the teeth grip if they close (m)."""
        nonlocal state, clock
        result = creep(
            grip(network, closing) if closing else network,
            history,
            times=np.unique(times),
            rheology=noodle.spring(),
            step=STEP,
            resume=state and replace(state, time=0.0, next_step=0.0),
        )
        pressed = [
            0.0 - result.outside_forces(record)[top, 1].sum() if closing else 0.0
            for record in range(len(result.times))
        ]
        energies = result.work, result.stored, result.dissipated, result.numerical
        seen.append((clock + result.times, pressed, result.displacement, *energies))
        state, clock = result.state, clock + history.duration

    def moments() -> int:
        return sum(len(times) for times, *_ in seen)

    gap, half, free = meal.closing * HEIGHT, 0.5 * meal.period, History().hold(meal.rest)
    resting, chewing = meal.rest * np.linspace(0.1, 1.0, 24) ** 2, half * np.linspace(0.1, 1.0, 9)
    pressing = meal.press * np.linspace(0.0, 1.0, 9)
    holding = meal.press + meal.hold * np.linspace(0.1, 1.0, 24) ** 2
    bite = History().ramp(1.0, meal.press).hold(meal.hold)
    go(gap, bite, np.concatenate([pressing, holding]))
    released = moments()
    go(0.0, free, resting)
    rested = moments() - 1
    for _ in range(meal.chews):
        # The tooth meets the dent later than it met the fresh strip, and closes as far.
        further = gap - float(dent_of(network, seen[-1][2][-1]))
        go(further, History().ramp(1.0, half), chewing)
        go(0.0, History().hold(half), chewing)
    go(0.0, free, resting)
    fields = [np.concatenate(parts) for parts in zip(*seen, strict=True)]
    return Bite(network, *fields, released, rested)
