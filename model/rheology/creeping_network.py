"""A spring network whose springs creep, in true geometry at every time step, and its result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from kaju.arrays import Floats, first_largest
from kaju.errors import ConvergenceError, require
from kaju.model.network.assembler import Assembler, spring_forces, spring_geometry
from kaju.model.network.equilibrium import (
    DirectSolver,
    SingularTangentError,
    find_balance,
    tangent_error,
)
from kaju.model.network.network_result import NetworkResult
from kaju.model.network.springs import SpringNetwork
from kaju.model.results.result import Curves
from kaju.model.results.stored import Column

from .creep_result import TimeResult
from .creeping_step import Borne, Creeping, Fields
from .element import Laws, ThreeElement, laws_of


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NetworkCreepResult(TimeResult):
    """What became of a spring network in time."""

    kind: ClassVar[str] = "network in time"
    network: SpringNetwork
    displacement: Annotated[Floats, Column("times nodes dimension")]  # of the nodes (m)
    force: Annotated[Floats, Column("times springs")]  # tension of the springs (N)

    def largest_displacement(self) -> Floats:
        """Return how far the node that ever moves most has moved (m) at every time."""
        moved: Floats = np.linalg.norm(self.displacement, axis=2)
        return moved[:, first_largest(moved.max(axis=0))]

    def grip_force(self) -> Floats:
        """Return the force (N) of the supports that move, along their displacement, at every time.

        Multiplied by the largest given displacement's rate it is the power that goes in.
        """
        given = self.network.displacements[-1]
        along = given / (np.linalg.norm(given, axis=1).max() or 1.0)
        force = []
        for moved, tension in zip(self.displacement, self.force, strict=True):
            inner = spring_forces(self.network, spring_geometry(self.network, moved), tension)
            force.append(-float(np.vdot(inner, along)))
        return np.array(force)

    def largest_force(self) -> Curves:
        """Return the force of the grip over time, or else the largest tension and pressure."""
        time = ("time", "s", self.times)
        if self.network.displacements[-1].any():
            return Curves("Force", *time, {"force of the grip": self.grip_force()}, "N")
        lines = {"largest pull": self.force.max(axis=1), "largest push": self.force.min(axis=1)}
        return Curves("Tension", *time, lines, "N")

    def to_network_result(self) -> NetworkResult:
        """Return the moments as the records of a loaded network, whose energies mean nothing."""
        return NetworkResult(
            network=self.network,
            stage=self.factors,
            displacement=self.displacement,
            tension=self.force,
            residual=np.zeros(len(self.times)),
            corrections=np.zeros(len(self.times), dtype=np.int64),
            scheme="newton",
            seconds=0.0,
        )


class CreepingNetwork(Creeping):
    """A network that creeps; every implicit step is one balance of forces.

    Its state is the stretches of both parts of every spring, the tension of the springs, and the
    displacement of the nodes. At the start a spring that is longer than its rest length has
    stretched its Voigt part, as one that has long been so.
    """

    result = NetworkCreepResult

    def __init__(
        self, network: SpringNetwork, rheology: ThreeElement | Sequence[ThreeElement]
    ) -> None:
        self.network = network
        self.parts: dict[str, Any] = {"network": network}
        self.laws = _spring_laws(network, rheology)
        self.assembler = Assembler(network)
        self._solver = DirectSolver()

    def start(self) -> Fields:
        """Return the state at time 0."""
        none = np.zeros(len(self.network.springs))
        still = np.zeros_like(self.network.positions)
        stretched = self.network.prestretch.copy()
        return (stretched, none, self.laws.K_f * stretched, still)

    def solve(self, stiffness: Floats, rest: Floats, factor: float, before: Fields) -> Borne:
        """Return tensions and displacement at the end of an implicit step, in shares if need be.

        Springs turn within a step: work on the nodes and in the springs differ by what the time
        stepping makes of geometry.
        """
        assembler, network, displacement = self.assembler, self.network, before[-1]

        def law(elongation: Floats) -> tuple[Floats, Floats]:
            return stiffness * (elongation + network.prestretch - rest), stiffness

        load, given = factor * network.forces[-1], factor * network.displacements[-1]
        geometry = spring_geometry(network, displacement)
        carried = -spring_forces(network, geometry, law(geometry.elongation)[0])
        scale = self._force_scale(stiffness, rest)
        trouble: Exception | None = None
        for parts in (1, 2, 4, 8, 16):  # shares of the load, one after the other
            moved = displacement
            try:
                for share in np.arange(1, parts + 1) / parts:
                    moved, tension, *_ = find_balance(
                        assembler,
                        self._solver,
                        law,
                        moved,
                        (1.0 - share) * carried + share * load,
                        given=(1.0 - share) * displacement + share * given,
                        force_scale=scale,
                    )
            except (SingularTangentError, ConvergenceError) as error:
                trouble = error
                continue
            on_springs = -spring_forces(network, spring_geometry(network, moved), tension)
            work = float(np.vdot(on_springs, moved - displacement))
            return Borne(tension, (tension, moved), work)
        if isinstance(trouble, SingularTangentError):
            raise tangent_error(
                assembler, geometry, stiffness, trouble.direction, factor
            ) from trouble
        assert trouble is not None
        raise trouble

    def _force_scale(self, stiffness: Floats, rest: Floats) -> float:
        """Return the force (N) of which rounding leaves a share of 1e-12 unbalanced."""
        # In a very short step dampers are stiff, and digits of stretches times this stiffness are
        # all that a balance can reach; nor need a network that is let go come nearer to nothing
        # than the digits of its full load.
        force = np.max(stiffness, initial=0.0) * np.max(np.abs(rest), initial=0.0)
        return max(1e-2 * float(force), float(np.abs(self.network.forces[-1]).max(initial=0.0)))

    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return displacement (n, dimension) of the nodes and tension (m,) of the springs."""
        _, _, tension, displacement = fields
        return {"displacement": displacement, "force": tension}


def _spring_laws(network: SpringNetwork, rheology: ThreeElement | Sequence[ThreeElement]) -> Laws:
    """Return the law of every spring: K/K_f of a single element side by side, or its own."""
    if isinstance(rheology, ThreeElement):
        require(
            rheology.K_f > 0.0,
            "rheology: an element without a spring (K_f = 0) cannot be scaled to the stiffness of "
            "each spring; give a sequence with one element for each",
        )
        times = network.stiffness / rheology.K_f
        return Laws(network.stiffness, rheology.D_f * times, rheology.D_d * times)
    count, given = len(network.springs), len(rheology)
    require(given == count, f"rheology: {count} springs need as many elements, got {given}")
    return laws_of(rheology)
