"""Bounds of the true energy, by two approximate answers that lie on either side of it.

A stress σ that balances the loads and a displacement v that fits the supports lie on opposite ends
of a diameter of a circle (in function space) on which the true stress lies (Prager and Synge 1947,
the hypercircle):

    ‖σ − Cε(v)‖² = ‖σ − σ_true‖² + ‖Cε(v) − σ_true‖²

in the energy norm, whatever the materials. So the mean of the two stresses is off by *exactly* half
of their distance, and the complementary energy of σ and the potential energy of v hold the true
energy between them. No constant is unknown, and no assumption is made about smoothness.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement
from kaju.model.elastic.bounds.admissible_stress import BALANCED, AdmissibleStress
from kaju.model.elastic.bounds.bound_cells import BoundCells
from kaju.model.elastic.moduli import Moduli, moduli_at, strain_of
from kaju.model.scene.cell_types import ROLLER

SETTLED = 0.002
"""Share of the estimated error that the iteration may leave, and that is added to the bound."""
MOST_PROVED = {2: 1_000_000, 3: 100_000}
"""Of more boxes bounds are worked out only when they are asked for."""
CROSSED = 1e-6  # Share by which rounding may cross the bounds of an exact answer
EATEN = "rounding has eaten the bounds: the lower one lies above the upper"
MORE = 8
"""So many times more boxes than the estimate asks for may be spent on a proof."""
FEW = {2: 20_000, 3: 4_000}  # So many boxes may be spent in any case: a second or two
PROVED_AT = {2: 0.65, 3: 0.9}  # Of the estimate: the first guess at what bounds will say


def worth_proving(boxes: int, estimated: float, dimension: int) -> bool:
    """Tell whether to go on for a proof, of boxes of which so many do by the estimate."""
    return boxes <= max(MORE * estimated, FEW[dimension])


@dataclass(frozen=True, eq=False, repr=False)
class EnergyBounds:
    """What is certain about an answer, scaled."""

    lower: float  # Bounds of the true energy
    upper: float
    # Error of the mean stress in the energy norm, relative to the true stress, at most
    error: float
    # Of the potential energy; what boxes do not take of loads, and moved supports, do not count
    potential: tuple[float, float]
    norm: float  # The least norm of the true stress, to which `error` is relative
    middle: MiddleStress  # The mean stress, of which `error` is the error

    @property
    def mean_error(self) -> float:
        """Error of the means of `middle` over every box, relative to the true stress."""
        return self.error + self.middle.variation / self.norm if self.norm > 0.0 else inf

    @property
    def balanced(self) -> bool:
        """Whether one of the two stresses balances the loads: else the bounds are an estimate."""
        return self.middle.balanced.left <= BALANCED

    @property
    def shares(self) -> Floats:
        """Every box's part of the squared distance: where smaller ones would serve."""
        return self.middle.shares


def bracket_of(boxes: BoundCells, checked: bool = True) -> EnergyBounds | str:
    """Hold the true energy between two that can be computed; or say why there are none."""
    # Unless `checked`, forces need not balance: those of agents that have not settled do not, and
    # the bounds are an estimate.
    stress = AdmissibleStress(boxes)
    if checked and not stress.left <= BALANCED:
        return (
            f"the answer does not balance: {stress.left:.1e} of the largest stress is left on a "
            "face"
        )
    field = AdmissibleDisplacement(boxes)
    if field.jumps:
        return "the supports give a corner two displacements at once"
    return _between(stress, field)


def _between(stress: AdmissibleStress, field: AdmissibleDisplacement) -> EnergyBounds | str:
    """Compare the two stresses: the hypercircle."""
    # With a residual the stress balances loads that differ a little from the true ones; the lower
    # bound holds for the true ones all the same.
    boxes = stress.boxes
    bed, wall_work = _at_supports(stress)
    complementary = float(stress.energies.sum()) + bed
    moved = any(held.value.any() for held in boxes.held)
    field.settle(complementary - wall_work)
    whole = 2.0 * field.whole_energy()
    if not moved and whole > 0.0:
        field.scale(field.work() / whole)  # to the least potential energy
    work, whole = field.work(), field.whole_energy()
    if field.quadratic and stress.equilibrated:
        stress.improve(field, complementary - wall_work + whole - work)
        bed, wall_work = _at_supports(stress)
        complementary = float(stress.energies.sum()) + bed
    rest = boxes.unsettled * sqrt(2.0 * complementary) + boxes.data_error
    balanced = work - field.work_of_rest()
    gap = complementary - wall_work - balanced + whole
    exact = not boxes.of  # differences of answers cross by rounding of their parts
    if exact and gap < -CROSSED * (complementary + whole):
        return EATEN
    distance = sqrt(max(2.0 * gap, 0.0))
    radius = 0.5 * distance + rest
    if moved and not (boxes.loads.force.any() or boxes.body.any()):
        # Without forces the energy is the least potential energy.
        lower, upper = max(whole - 0.5 * (distance + rest) ** 2, 0.0), whole
        smallest = sqrt(2.0 * lower)
    elif moved:
        # ‖(σ + Cε(v))/2‖, the product of the two being the work of loads and walls.
        both = complementary + whole + balanced + wall_work
        middle = sqrt(max(0.5 * both, 0.0))
        smallest = max(middle - radius, 0.0)
        lower, upper = 0.5 * smallest**2, 0.5 * (middle + radius) ** 2
    else:
        lower = max(sqrt(max(work - whole, 0.0)) - sqrt(0.5) * boxes.data_error, 0.0) ** 2
        upper = (sqrt(complementary) + sqrt(0.5) * rest) ** 2
        smallest = sqrt(2.0 * max(lower, 0.0))
    if exact and lower > (1.0 + CROSSED) * upper:
        return EATEN
    error = radius / smallest if smallest > 0.0 else (inf if radius > 0.0 else 0.0)
    potential = wall_work - complementary, whole - work
    return EnergyBounds(lower, upper, error, potential, smallest, MiddleStress(stress, field))


@dataclass(frozen=True, eq=False)
class MiddleStress:
    """The middle of the circle: the mean of a stress that balances and that of a displacement."""

    balanced: AdmissibleStress
    field: AdmissibleDisplacement

    def at(self, box: Ints, inside: Floats) -> Floats:
        """Return the stress tensors, shape (n, d, d), at places from 0 to 1 in n boxes."""
        strain = self.field.strain_at(box, inside)
        law = moduli_at(self.balanced.boxes.law, box)
        return 0.5 * (self.balanced.at(box, inside) + stress_of(law, strain))

    @cached_property
    def means(self) -> Floats:
        """The mean in every box, shape (boxes, d, d)."""
        return 0.5 * (self._means[0] + stress_of(self.balanced.boxes.law, self._means[1]))

    @cached_property
    def _means(self) -> tuple[Floats, Floats]:
        return self.balanced.means(), self.field.mean_strains()

    @property
    def _volume(self) -> Floats:
        boxes = self.balanced.boxes
        return np.asarray(boxes.size**boxes.dimension)

    @cached_property
    def shares(self) -> Floats:
        """Every box's part of the squared distance of the two, to leading order."""
        # In a box the product of the two stresses is that of their means but for terms that are
        # small where the box is small.
        own = self.balanced.energies + self.field.energies()
        if self.balanced.function is not None:
            return np.asarray(np.maximum(2.0 * (own - self.balanced.function.works()), 0.0))
        product = np.einsum("nab,nab->n", *self._means)
        return np.asarray(np.maximum(2.0 * (own - self._volume * product), 0.0))

    @property
    def variation(self) -> float:
        """The norm of what `means` leaves out."""
        boxes, v = self.balanced.boxes, self.field
        # The product of the two stresses is the work of the tractions of the one on the other.
        product = v.work() - v.work_of_rest() + _at_supports(self.balanced)[1]
        product += v.work_on_beds(self.balanced.borne)
        whole = 0.5 * (float(self.balanced.energies.sum() + v.energies().sum()) + product)
        balanced, strain = self._means
        strain = 0.5 * (strain + strain_of(balanced, boxes.law, slice(None)))
        square = np.einsum("nab,nab->n", self.means, strain)
        return sqrt(max(whole - float(self._volume @ square), 0.0))


def _at_supports(stress: AdmissibleStress) -> tuple[float, float]:
    """Return the complementary energy of the beds, and the work of the tractions at moved walls."""
    boxes, power = stress.boxes, stress.boxes.dimension - 1
    bed = work = 0.0
    for side, box, stiffness in boxes.beds:
        modes = stress.borne(side, box) ** 2
        square = (modes[..., 0] + modes[..., 1:].sum(axis=-1) / 12.0).mean(axis=1)
        square *= boxes.size[box] ** power
        bed += float((0.5 * square / stiffness).sum())
    for held in boxes.held:
        # A side that slides is moved across itself alone.
        acts = stress.traction(held.side, held.box) * boxes.size[held.box] ** power
        if held.kind == ROLLER:
            acts[np.arange(boxes.dimension) != held.side // 2] = 0.0
        work += (2.0 * (held.side % 2) - 1.0) * float(np.vdot(acts.T, held.value))
        # A load on the side itself is the wall's at once, and none of what it feels of the body.
        own = boxes.loads.side == held.side
        at = np.searchsorted(held.box, boxes.loads.box[own]) % max(len(held.box), 1)
        there = held.box[at] == boxes.loads.box[own]
        force = boxes.loads.force[own][there]
        if held.kind == ROLLER:
            force = np.where(np.arange(boxes.dimension) == held.side // 2, force, 0.0)
        work -= float(np.vdot(force, held.value[at[there]]))
    return bed, work


def stress_of(law: Moduli, strain: Floats) -> Floats:
    """Return stress tensors by strain tensors, shape (n, d, d)."""
    volume = law.lateral * np.trace(strain, axis1=1, axis2=2)
    found = (2.0 * law.shear)[:, None, None] * strain
    for axis in range(strain.shape[1]):
        found[:, axis, axis] = (law.stretch - law.lateral) * strain[:, axis, axis] + volume
    return np.asarray(found)
