"""Two wrong answers that know how wrong they are: the true energy between them.

A stress σ that balances the loads and a displacement v that fits the supports lie on opposite ends
of a diameter of a circle (in function space) on which the true stress lies (Prager and Synge 1947,
the hypercircle):

    ‖σ − Cε(v)‖² = ‖σ − σ_true‖² + ‖Cε(v) − σ_true‖²

in the energy norm, whatever the materials. So the mean of the two stresses is off by *exactly* half
of their distance, and the complementary energy of σ and the potential energy of v hold the true
energy between them. No constant is unknown, and no assumption is made about smoothness.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from math import inf, sqrt

import numpy as np

from kaju.model.scene.kinds import ROLLER

from .balanced import BALANCED, BalancedStress
from .boxes import Boxes, Law
from .compatible import CompatibleField
from .problem import Floats
from .volume_field import LOCKING, VolumeField

Means = tuple[Floats, dict[tuple[int, int], Floats]]
"""Normal stresses along every axis, and shear stresses by pair of axes."""

SETTLED_TREE = 1e-11
"""Algebraic error that is no part of the bounds any more."""
SETTLED = 0.015
"""Share of the estimated error that the iteration may leave, and that is added to the bound."""
MOST_PROVED = {2: 500_000, 3: 100_000}
"""Of more boxes bounds are worked out only when they are asked for."""
CROSSED = 1e-6
"""Share by which rounding may cross the bounds of an exact answer."""
MORE = 8
"""So many times more boxes than the estimate asks for may be spent on a proof."""
EXACT = 1e-6
"""Relative error below which no corner has to sink."""
ROUGH = 0.3
"""Relative error above which corners sink all over the body."""
FEW = 20_000
"""So many boxes may be spent in any case."""


def worth_proving(boxes: int, estimated: int) -> bool:
    """Tell whether to go on for a proof, of boxes of which so many do by the estimate."""
    return boxes <= max(MORE * estimated, FEW)


@dataclass(frozen=True, eq=False, repr=False)
class Bracket:
    """What is certain about an answer, scaled.

    Attributes
    ----------
    lower, upper : float
        Bounds of the true energy.
    error : float
        Error of the mean stress in the energy norm, relative to the true stress, at most.
    potential : tuple of float
        Bounds of the potential energy, which supports that move do not widen.
    parts : callable
        Works out `shares` and `stress`.
    """

    lower: float
    upper: float
    error: float
    potential: tuple[float, float]
    parts: Callable[[], tuple[Floats, Floats]]

    @cached_property
    def _parts(self) -> tuple[Floats, Floats]:
        return self.parts()

    @property
    def shares(self) -> Floats:
        """Every box's part of the squared distance: where smaller ones would serve."""
        return self._parts[0]

    @property
    def stress(self) -> Floats:
        """The mean stress, shape (boxes, dimension, dimension)."""
        return self._parts[1]


def bracket_of(boxes: Boxes, checked: bool = True) -> Bracket | str:
    """Hold the true energy between two that can be computed.

    Parameters
    ----------
    boxes : Boxes
        With the stresses of an answer.
    checked : bool
        Whether forces have to balance; those of agents that have not settled yet do not, and
        what they say is an estimate.

    Returns
    -------
    Bracket or str
        In words why there is none, where the theorem does not reach.
    """
    stress = BalancedStress(boxes)
    if checked and not stress.left <= BALANCED:
        return (
            f"the answer does not balance: {stress.left:.1e} of the largest stress is left on a "
            "face"
        )
    field = CompatibleField(boxes)
    if field.jumps:
        return "the supports give a corner two displacements at once"
    return _between(stress, field)


def _between(stress: BalancedStress, plain: CompatibleField) -> Bracket | str:
    """Compare the two stresses: the hypercircle.

    What an iteration has left balances loads that differ a little from the true ones; the
    lower bound is that of the true ones all the same.
    """
    bed, wall_work = _at_supports(stress)
    complementary = float(stress.energies.sum()) + bed
    if stress.boxes.others:
        complementary += stress.boxes.others.complementary
    rest = stress.boxes.unsettled * sqrt(2.0 * complementary)
    moved = any(held.value.any() for held in stress.boxes.held)
    fields: list[CompatibleField | VolumeField] = [plain]
    if _locks(stress.boxes):
        fields.append(VolumeField(plain))
    for v in fields:
        v.settle(complementary - wall_work)
        if not moved:
            v.stretch(_best_share(v))
    v = max(fields, key=lambda v: v.work() - v.whole_energy())
    work, whole = v.work(), v.whole_energy()
    balanced = work - v.work_of_rest()
    gap = complementary - wall_work - balanced + whole
    radius = 0.5 * sqrt(max(2.0 * gap, 0.0)) + rest
    if moved:
        # ‖(σ + Cε(v))/2‖, the product of the two being the work of loads and walls.
        both = complementary + whole + balanced + wall_work
        middle = sqrt(max(0.5 * both, 0.0))
        smallest = max(middle - radius, 0.0)
        lower, upper = 0.5 * smallest**2, 0.5 * (middle + radius) ** 2
    else:
        lower, upper = work - whole, (sqrt(complementary) + sqrt(0.5) * rest) ** 2
        smallest = sqrt(2.0 * max(lower, 0.0))
    if lower > (1.0 + CROSSED) * upper:
        return "rounding has eaten the bounds: the lower one lies above the upper"
    error = radius / smallest if smallest > 0.0 else (inf if radius > 0.0 else 0.0)
    potential = wall_work - complementary, whole - work
    return Bracket(lower, upper, error, potential, partial(_parts, stress, v))


def _parts(stress: BalancedStress, field: CompatibleField | VolumeField) -> tuple[Floats, Floats]:
    """Return every box's part of the squared distance, and the mean stress."""
    others = stress.boxes.others
    if others and isinstance(field, CompatibleField):
        boxes = others.tell(field.displacement, field.scale)
        stress, field = BalancedStress(boxes), CompatibleField(boxes)
    means, strain = stress.means(), field.mean_strains()
    volume = stress.boxes.size**stress.boxes.dimension
    shares = _shares(stress.energies + field.energies(), means, strain, volume)
    return shares, _mean_stress(stress.boxes.law, means, strain)


def _locks(boxes: Boxes) -> bool:
    """Tell whether bodies are so nearly incompressible that sides have to bend."""
    stiff = boxes.law.lateral > LOCKING * boxes.law.stretch
    return boxes.dimension == 2 and not boxes.beds and bool(stiff.any())


def _best_share(field: CompatibleField | VolumeField) -> float:
    """Return by what to multiply a field so that its potential energy is least."""
    whole = 2.0 * field.whole_energy()
    return field.work() / whole if whole > 0.0 else 1.0


def _at_supports(stress: BalancedStress) -> tuple[float, float]:
    """Return the complementary energy of the beds, and the work of the tractions at moved walls."""
    boxes, power = stress.boxes, stress.boxes.dimension - 1
    bed = work = 0.0
    for side, box, stiffness in boxes.beds:
        square = stress.normal_square(side, box) * boxes.size[box] ** power
        bed += float((0.5 * square / stiffness).sum())
    for held in boxes.held:
        # A side that slides is moved across itself alone.
        acts = stress.traction(held.side, held.box) * boxes.size[held.box] ** power
        if held.kind == ROLLER:
            acts[np.arange(boxes.dimension) != held.side // 2] = 0.0
        work += (2.0 * (held.side % 2) - 1.0) * float(np.vdot(acts.T, held.value))
    return bed, work


def _mean_stress(law: Law, means: Means, strain: Floats) -> Floats:
    """Return the mean of the balanced and the compatible stress in every box."""
    normal, shear = means
    volume = np.trace(strain, axis1=1, axis2=2)
    found = np.empty_like(strain)
    for axis, own in enumerate(normal):
        along = law.lateral * volume + (law.stretch - law.lateral) * strain[:, axis, axis]
        found[:, axis, axis] = 0.5 * (own + along)
    for (a, b), tau in shear.items():
        found[:, a, b] = found[:, b, a] = 0.5 * (tau + 2.0 * law.shear * strain[:, a, b])
    return found


def _shares(energies: Floats, means: Means, strain: Floats, volume: Floats) -> Floats:
    """Return every box's part of the squared distance, but for what balances out between boxes.

    In a box the product of the two stresses is by their means but for terms that are small where
    the box is small.
    """
    normal, shear = means
    product = sum(own * strain[:, a, a] for a, own in enumerate(normal))
    product = product + sum(2.0 * tau * strain[:, a, b] for (a, b), tau in shear.items())
    return np.asarray(np.maximum(2.0 * (energies - volume * product), 0.0))
