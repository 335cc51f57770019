"""Bounds of a quantity: the work of forces that ask for it, by two pairs of energies.

A mean displacement or stress J is the work of forces g: J = g·u. With z the displacement that
they cause, the potential energy of the loads f ± t g is

    Π± = Π(f) ∓ t J + t² Π(g),    so that    J = (Π₋ − Π₊) / 2t,

and both lie between bounds: those of u ± t z (`bracket`). With t the ratio of the errors of u and
z, J is known but for half the product of the distances that their two stresses have each
(Greenberg 1948, Prager & Synge 1947), and lies round the work of the mean fields.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.boxes import Boxes, Loads
from kaju.model.elastic.bracket import bracket_of

from .balance import Balance
from .composite import Composite
from .ground import Ground, LeafForces
from .leaves import Leaves

ROUNDING = 1e-13
"""Share of the energies that rounding may take."""
SMALL = 1e-12
"""Share of a displacement's square that stands for the energy of its error if there is none."""


class Between(NamedTuple):
    """A quantity that lies within `off` of `middle`; scaled."""

    middle: float
    off: float
    # How far off it is known by the bounds, over what the errors' estimated energies say
    blind: float
    shares: Floats  # shape (agents,): Every agent's part of `off`


def work_between(own: Boxes, asked: Boxes, error: float, rest: float) -> Between | str:
    """Hold the work of forces between two values that can be computed; or say why not."""
    # `own` are the agents under the loads, `asked` under the forces; with the estimated energies of
    # the errors of both.
    larger = error + SMALL * _square(own), rest + SMALL * _square(asked)
    share = sqrt(larger[0] / larger[1]) if min(larger) > 0.0 else 1.0
    more, less = (bracket_of(_sum(own, asked, sign * share)) for sign in (1.0, -1.0))
    if isinstance(more, str):
        return more
    if isinstance(less, str):
        return less
    (low, high), (least, most) = more.potential, less.potential
    middle, off = least + most - low - high, most - least + high - low
    off += ROUNDING * (abs(low) + abs(high) + abs(least) + abs(most))
    off *= 0.25 / share
    # What the agents do not take of the loads works on the displacement of the forces that ask.
    off += own.data_error * (sqrt(0.5 * more.upper) + sqrt(0.5 * less.upper)) / share
    shares = (more.shares + less.shares) / (8.0 * share)
    return Between(0.25 * middle / share, off, off / sqrt(larger[0] * larger[1] or 1.0), shares)


def _square(boxes: Boxes) -> float:
    return float(np.abs(boxes.mesh.start).max(initial=0.0)) ** 2


def _sum(first: Boxes, second: Boxes, share: float) -> Boxes:
    """Return boxes under the loads of the first, and a share of those of the second."""
    forces = zip(first.loads, second.loads._replace(force=share * second.loads.force), strict=True)
    held = [
        one._replace(value=one.value + share * two.value)
        for one, two in zip(first.held, second.held, strict=True)
    ]
    start = first.mesh.start + share * second.mesh.start
    return replace(
        first,
        sigma=first.sigma + share * second.sigma,
        shear={pair: tau + share * second.shear[pair] for pair, tau in first.shear.items()},
        body=first.body + share * second.body,
        uneven=first.uneven | second.uneven,
        loads=Loads(*(np.concatenate(columns) for columns in forces)),
        held=held,
        mesh=first.mesh._replace(start=start),
        moved=first.moved + share * second.moved,
        of=max(first.largest, abs(share) * second.largest),
    )


class _Asking(Ground):
    """The ground under some forces only; nothing that holds the body moves."""

    def __init__(self, ground: Ground, forces: LeafForces) -> None:
        self.__dict__.update(ground.__dict__)
        self._asked = forces

    def forces(self, leaves: Leaves) -> LeafForces:
        return self._asked

    def given(self, side: int) -> Floats:
        return np.zeros(self.dimension)


def asking(balance: Balance, forces: LeafForces) -> Balance:
    """Return the same agents under the forces that ask for a quantity."""
    ground = _Asking(balance.grid.ground, forces)
    if balance.grid.value.any() or balance.offset.any():
        return Balance(Composite(ground, balance.grid.leaves))
    return balance.loaded_by(ground)
