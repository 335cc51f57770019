"""A spring network whose springs creep, in true geometry at every time step, and its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array, diags_array

from kaju.arrays import Floats, first_largest
from kaju.errors import ConvergenceError, ParameterError
from kaju.model.network.assembler import Assembler, Geometry, spring_forces, spring_geometry
from kaju.model.network.equilibrium import SpringLaw, find_balance, tangent_error
from kaju.model.network.linear import SingularTangentError, tangent_solver
from kaju.model.network.network_result import (
    NetworkResult,
    network_archive,
    network_from,
    sizes_of_network,
)
from kaju.model.network.springs import Method, SpringNetwork
from kaju.model.results.archive import Archive
from kaju.model.results.formats import NETWORK_IN_TIME
from kaju.model.results.result import Curves
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Fields, SubStep
from kaju.model.rheology.schemes import (
    Energy,
    Laws,
    Stretch,
    as_spring,
    rates,
    stage_energy,
    stored_energy,
)

from .creep_result import TimeResult, times_of


class HeavyAssembler(Assembler):
    """Sums up springs and, over one implicit step, the inertia of the nodes.

    Inertia pulls every node to where it would get without forces, as a spring of stiffness M/h² in
    every direction. `geometry` is always asked before `internal_force`, so it notes where the nodes
    are. `mass`, shape (n, 1): of the nodes (kg); `pull`, shape (n, dimension): M/h² (N/m).
    """

    def __init__(self, network: SpringNetwork, mass: ArrayLike) -> None:
        super().__init__(network)
        self.mass = _node_masses(mass, len(network.positions))
        self._aim = np.zeros_like(network.positions)
        self._at = self._aim
        self.pull = np.zeros_like(self._aim)

    def expect(self, aim: Floats, substep: float) -> None:
        """Set where the nodes would be (n, dimension) after a step of length `substep`."""
        self._aim = aim
        self.pull = np.broadcast_to(self.mass / substep**2, aim.shape)

    def geometry(self, displacement: Floats) -> Geometry:
        """Return the springs' geometry, and note where the nodes are."""
        self._at = displacement
        return super().geometry(displacement)

    def internal_force(self, geometry: Geometry, tension: Floats) -> Floats:
        """Return the force of springs and inertia on the nodes (N)."""
        return super().internal_force(geometry, tension) - self.pull * (self._at - self._aim)

    def tangent(self, geometry: Geometry, tension: Floats, stiffness: Floats) -> csc_array:
        """Return how the free nodes resist small displacements (N/m)."""
        springs = super().tangent(geometry, tension, stiffness)
        return csc_array(springs + diags_array(self.restrict(self.pull)))

    def force_change(
        self, geometry: Geometry, tension: Floats, stiffness: Floats, displacement: Floats
    ) -> Floats:
        """Return by how much the force on the nodes changes with a small displacement."""
        change = super().force_change(geometry, tension, stiffness, displacement)
        return change - self.pull * displacement


def _node_masses(mass: ArrayLike, nodes: int) -> Floats:
    """Return the masses as a column (n, 1)."""
    masses = np.broadcast_to(np.asarray(mass, dtype=np.float64), (nodes,))
    if not np.all(np.isfinite(masses) & (masses > 0.0)):
        raise ParameterError("mass: every node needs a mass above 0 kg; leave it out for none")
    return masses[:, None].copy()


_SHARES = (1, 2, 4, 8, 16)
"""Into how many shares a load is divided, one after the other, before Newton gives up."""


def spring_laws(network: SpringNetwork, rheology: ThreeElement | Sequence[ThreeElement]) -> Laws:
    """Return the law of every spring.

    A single element stands for a spring of stiffness K_f; a spring of stiffness K is K/K_f
    of them side by side, so that the times of the material are kept. A sequence gives every
    spring its own element, as it is.
    """
    if isinstance(rheology, ThreeElement):
        if rheology.K_f == 0.0:
            raise ParameterError(
                "rheology: an element without a spring (K_f = 0) cannot be scaled to the "
                "stiffness of each spring; give a sequence with one element for each"
            )
        times = network.stiffness / rheology.K_f
        return Laws(network.stiffness, rheology.D_f * times, rheology.D_d * times)
    if len(rheology) != len(network.springs):
        raise ParameterError(
            f"rheology: {len(network.springs)} springs need as many elements, got {len(rheology)}"
        )
    return Laws.of(rheology)


class CreepingNetwork:
    """A network as something that creeps; every implicit step is one balance of forces.

    Its state is the stretches of both parts of every spring, the tension of the springs, the
    displacement of the nodes, and their velocity (which stays 0 without mass). At the start a
    spring that is longer than its rest length has stretched its Voigt part, as one that has long
    been so. A held coordinate moves from where it is when the run begins, by its given displacement
    times the growth of the factor; so teeth may grip a network that is bent already.
    """

    def __init__(
        self,
        network: SpringNetwork,
        rheology: ThreeElement | Sequence[ThreeElement],
        method: Method = "auto",
        mass: ArrayLike | None = None,
    ) -> None:
        self.network = network
        self.laws = spring_laws(network, rheology)
        self.inertia = None if mass is None else HeavyAssembler(network, mass)
        self._load = float(np.max(np.abs(network.forces[-1]), initial=0.0))
        self.assembler = self.inertia or Assembler(network)
        self.solver = tangent_solver(self.assembler, method)
        self._grip = np.zeros_like(network.positions)

    def start(self) -> Fields:
        """Return the state at time 0."""
        none = np.zeros(len(self.network.springs))
        still = np.zeros_like(self.network.positions)
        stretched = self.network.prestretch.copy()
        return (stretched, none, self.laws.K_f * stretched, still, still.copy())

    def begin(self, fields: Fields, displacement_factor: float) -> None:
        """Note from where held coordinates move, and the factor of displacements there."""
        self._grip = fields[3] - displacement_factor * self.network.displacements[-1]

    def rates(self, fields: Fields, push: SubStep) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step, and what it adds to the balance."""
        q, d, tension, displacement, velocity = fields
        state, substep = Stretch(q, d), push.substep
        if self.inertia is not None:
            self.inertia.expect(displacement + substep * velocity, substep)
        after, found = self._balance(state, displacement, push)
        speed = (after - displacement) / substep
        acceleration = np.zeros_like(speed)
        if self.inertia is not None:
            acceleration = (speed - velocity) / substep
        rate = rates(self.laws, substep, state, found)
        energy = stage_energy(self.laws, push.method, push.step, push.weight, found, rate)
        energy = self._from_outside(energy, push, after, found, speed, acceleration)
        return (rate.q, rate.d, (found - tension) / substep, speed, acceleration), energy

    def _balance(
        self, state: Stretch, displacement: Floats, push: SubStep
    ) -> tuple[Floats, Floats]:
        """Return displacement and tensions at the end of an implicit step, in shares if need be."""
        stiffness, rest = as_spring(self.laws, push.substep, state)
        shift = self.network.prestretch - rest

        def law(elongation: Floats) -> tuple[Floats, Floats]:
            return stiffness * (elongation + shift), stiffness

        load = push.factor * self.network.forces[-1]
        given = self._grip + push.displacement_factor * self.network.displacements[-1]
        reachable = self._reachable(stiffness, rest, displacement)
        for parts in _SHARES:
            try:
                return self._led(law, displacement, load, given, reachable, parts)
            except SingularTangentError as weakness:
                if parts == _SHARES[-1]:
                    geometry = self.assembler.geometry(displacement)
                    raise tangent_error(
                        self.assembler, geometry, stiffness, weakness.direction, push.factor
                    ) from weakness
            except ConvergenceError:
                if parts == _SHARES[-1]:
                    raise
        raise AssertionError("the last share returns or raises")

    def _reachable(self, stiffness: Floats, rest: Floats, displacement: Floats) -> float:
        """Return the force (N) of which 1e-12 is what rounding leaves unbalanced.

        In a very short step dampers and inertia are stiff, and the digits of stretches and
        displacements times this stiffness are all that a balance can reach. A network that
        is let go need come no nearer to nothing than the digits of its full load.
        """
        force = np.max(stiffness, initial=0.0) * np.max(np.abs(rest), initial=0.0)
        if self.inertia is not None:
            force += np.max(self.inertia.pull) * np.max(np.abs(displacement))
        return max(1e-2 * float(force), self._load)

    def _led(
        self,
        law: SpringLaw,
        displacement: Floats,
        load: Floats,
        given: Floats,
        reachable: float,
        parts: int,
    ) -> tuple[Floats, Floats]:
        """Find the balance by moving load and supports over in `parts` equal shares."""
        geometry = self.assembler.geometry(displacement)
        carried = -self.assembler.internal_force(geometry, law(geometry.elongation)[0])
        tension = np.empty(0)
        first = displacement
        for part in range(1, parts + 1):
            share = part / parts
            balance = find_balance(
                self.assembler,
                self.solver,
                law,
                displacement,
                carried + share * (load - carried) if part < parts else load,
                given=first + share * (given - first) if part < parts else given,
                force_scale=reachable,
            )
            displacement, tension = balance.displacement, balance.tension
        return displacement, tension

    def _from_outside(
        self,
        energy: Energy,
        push: SubStep,
        displacement: Floats,
        tension: Floats,
        speed: Floats,
        acceleration: Floats,
    ) -> Energy:
        """Count the work of loads and supports rather than that of the springs.

        Springs turn within a step, so the two differ by what time stepping makes of geometry;
        it is booked as the scheme's own, with what the scheme takes from moving masses.
        """
        geometry = spring_geometry(self.network, displacement)
        outside = -spring_forces(self.network, geometry, tension)
        lost = 0.0
        if self.inertia is not None:
            mass = self.inertia.mass
            outside = outside + mass * acceleration
            own = 0.5 * push.weight * (2.0 * push.method.gamma - push.weight)
            lost = own * float(np.sum(mass * np.square(push.step * acceleration)))
        work = push.weight * push.step * float(np.vdot(outside, speed))
        kinetic = 0.0
        if self.inertia is not None:
            kinetic = (
                push.weight * push.step * float(np.vdot(self.inertia.mass * acceleration, speed))
            )
        gap = work - kinetic - energy.work
        return Energy(work, energy.dissipated, energy.numerical + gap + lost)

    def gauge(self, fields: Fields) -> Floats:
        """Return the stretches of both parts of all springs."""
        return np.stack(fields[:2])

    def stored(self, fields: Fields) -> float:
        """Return the energy of the springs and of the moving masses (J)."""
        energy = stored_energy(self.laws, Stretch(fields[0], fields[1]))
        if self.inertia is not None:
            energy += 0.5 * float(np.sum(self.inertia.mass * np.square(fields[4])))
        return energy

    def record(self, fields: Fields) -> tuple[Floats, ...]:
        """Return displacement (n, dimension) of the nodes and tension (m,) of the springs."""
        return fields[3], fields[2]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NetworkCreepResult(TimeResult):
    """What became of a spring network in time."""

    kind: ClassVar[str] = "network in time"
    network: SpringNetwork
    """What crept."""
    displacement: Floats
    """Displacement of the nodes (m). Shape (k, n, dimension)."""
    force: Floats
    """Tension of the springs (N). Shape (k, m)."""

    def largest_displacement(self) -> Floats:
        """Return how far the node that ever moves most has moved (m) at every time."""
        moved: Floats = np.linalg.norm(self.displacement, axis=2)
        return moved[:, first_largest(moved.max(axis=0))]

    def grip_force(self) -> Floats:
        """Return the force (N) of what moves held nodes, along their way, at every time.

        Multiplied by the largest given displacement's rate it is the power that goes in.
        """
        given = self.network.displacements[-1]
        way = given / (np.linalg.norm(given, axis=1).max() or 1.0)
        records = range(len(self.times))
        return np.array([float((self.outside_forces(k) * way).sum()) for k in records])

    def largest_force(self) -> Curves:
        """Return the force of the grip over time, or else the largest tension and pressure."""
        time = ("time", "s", self.times)
        if self.network.displacements[-1].any():
            return Curves("Force", *time, {"force of the grip": self.grip_force()}, "N")
        lines = {"largest pull": self.force.max(axis=1), "largest push": self.force.min(axis=1)}
        return Curves("Tension", *time, lines, "N")

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = network_archive(self.network)
        return {**arrays, "displacement": self.displacement, "force": self.force}, about

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        network = network_from(archive)
        sizes = sizes_of_network(network) | times_of(archive)
        return {"network": network, **archive.columns(NETWORK_IN_TIME, sizes)}

    def outside_forces(self, record: int = -1) -> Floats:
        """Return what acts on every node from outside (N), shape (n, dimension).

        Where a node is held, that is the force of its support; where it is free, its load
        (less mass times acceleration).
        """
        geometry = spring_geometry(self.network, self.displacement[record])
        return -spring_forces(self.network, geometry, self.force[record])

    def to_network_result(self) -> NetworkResult:
        """Return the moments as the records of a loaded network, for plots and animations.

        The factor of the history stands for the point of the load path. Energies of that
        result are those of elastic springs, and so mean nothing here.
        """
        return NetworkResult(
            network=self.network,
            stage=self.factors,
            displacement=self.displacement,
            tension=self.force,
            residual=np.zeros(len(self.times)),
            corrections=np.zeros(len(self.times), dtype=np.int64),
            scheme="newton",
            method="creep",
            seconds=0.0,
        )
