"""Elements and bodies of cells in time: each creeps under its own load.

Loads travel through a body at once and grow with the history; what takes time is how the
agents give. Under the *prescribed rule* an agent keeps its loads whatever the others do, so
its strain is its elastic strain times the growth of its material, E · (creep under the
history of a unit stress). Displacements are summed up from the grown strains as ever.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import Material
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.results.archive import Archive
from kaju.model.results.formats import TRANSFER_IN_TIME, sizes_of
from kaju.model.results.result import BodyResult, cells_of_points
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Fields, SubStep
from kaju.model.rheology.schemes import (
    Energy,
    Laws,
    Stretch,
    force_at_rate,
    rates,
    stage_energy,
    stored_energy,
)
from kaju.model.transfer.deformation import AxialStrain, DisplacementField, axial_strain
from kaju.model.transfer.transfer_result import TransferResult

from .creep_result import BodyCourse, times_of


class Elements:
    """Any number of three-element materials that do not feel each other.

    Its state is the stretches of both parts, the force in each element, and the velocity of its end
    (which stays 0 without mass). `share` is the force (N) of each at a factor of 1, or, if
    `stretched`, its elongation (m).
    """

    def __init__(
        self, laws: Laws, share: Floats, *, stretched: bool = False, mass: Floats | None = None
    ) -> None:
        self.laws = laws
        self.share = share
        self.stretched = stretched
        self.mass = mass

    def start(self) -> Fields:
        """Return the state at time 0: nothing stretched, nothing moving."""
        return tuple(np.zeros((4, len(self.share))))

    def rates(self, fields: Fields, push: SubStep) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step, and what it adds to the balance."""
        q, d, force, velocity = fields
        state, substep = Stretch(q, d), push.substep
        applied = push.factor * self.share
        velocity_rate = np.zeros_like(velocity)
        if self.stretched:
            speed = (push.displacement_factor * self.share - q - d) / substep
            after = force_at_rate(self.laws, substep, state, speed)
            applied = after
        elif self.mass is None:
            after = applied
        else:
            after, velocity_rate = self._with_mass(state, velocity, applied, substep)
        rate = rates(self.laws, substep, state, after)
        energy = stage_energy(self.laws, push.method, push.step, push.weight, after, rate)
        energy = self._moving(energy, push, rate, applied, velocity_rate)
        return (rate.q, rate.d, (after - force) / substep, velocity_rate), energy

    def _with_mass(
        self, state: Stretch, velocity: Floats, applied: Floats, substep: float
    ) -> tuple[Floats, Floats]:
        """Solve (M/h + damping) v' = M v/h + loads for the force and the acceleration."""
        inertia = self.mass / substep  # type: ignore[operator]
        at_rest = force_at_rate(self.laws, substep, state, 0.0)
        damping = force_at_rate(self.laws, substep, Stretch(0.0 * state.q, state.d), 1.0)
        after = (inertia * velocity + applied - at_rest) / (inertia + damping)
        return at_rest + damping * after, (after - velocity) / substep

    def _moving(
        self, energy: Energy, push: SubStep, rate: Stretch, applied: Floats, acceleration: Floats
    ) -> Energy:
        """Count the work of the load rather than of the element, and the moving mass."""
        if self.mass is None:
            return energy
        work = push.weight * push.step * float(np.sum(applied * (rate.q + rate.d)))
        own = 0.5 * push.weight * (2.0 * push.method.gamma - push.weight)
        lost = own * float(np.sum(self.mass * np.square(push.step * acceleration)))
        return Energy(work, energy.dissipated, energy.numerical + lost)

    def gauge(self, fields: Fields) -> Floats:
        """Return the stretches of both parts."""
        return np.stack(fields[:2])

    def stored(self, fields: Fields) -> float:
        """Return the energy of the springs and of the moving mass (J)."""
        energy = stored_energy(self.laws, Stretch(fields[0], fields[1]))
        if self.mass is not None:
            energy += float(np.sum(0.5 * self.mass * np.square(fields[3])))
        return energy

    def record(self, fields: Fields) -> tuple[Floats, ...]:
        """Return elongation (m) and force (N) of each element."""
        return fields[0] + fields[1], fields[2]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TransferCreepResult(BodyCourse):
    """What became of load transfer by a prescribed rule in time.

    Its energies are of what every agent is squeezed by its own loads; the expansion across
    them does no work. In every query `record` is the index of a time asked for; the default
    -1 is the last.
    """

    kind: ClassVar[str] = "load transfer in time"
    _static: ClassVar[type[BodyResult]] = TransferResult
    static: TransferResult
    """The same scene without time, at a factor of 1."""
    growth: Floats
    """Strain of each of the scene's materials, as a multiple of its elastic strain at a factor of
    1. Shape (k, materials)."""

    def _sizes(self, record: int) -> Floats:
        if not len(self.static.last.cells):
            return np.zeros(1)
        return np.asarray(np.linalg.norm(self.displacement(record), axis=1))

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = super()._own()
        return {**arrays, "growth": self.growth}, about

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        own = super()._from_own(archive)
        sizes = sizes_of(own["static"].scene) | times_of(archive)
        return own | archive.columns(TRANSFER_IN_TIME, sizes)

    def squeezed(self, record: int = -1) -> AxialStrain:
        """Return how much the agents are squeezed, their pressures at a factor of 1."""
        static = axial_strain(self.static.scene, self.static.last)
        grown = self.growth[record, self.static.last.material][:, None]
        return replace(static, strain=static.strain * grown, widening=static.widening * grown)

    def strain(self, record: int = -1) -> Floats:
        """Return the strain of every agent, shape (agents, dimension, dimension)."""
        return self.squeezed(record).strains()

    def stress(self, record: int = -1) -> Floats:
        """Return the stress of every agent (Pa), shape (agents, dimension, dimension)."""
        return np.asarray(self.static.stress * self.factors[record])

    def displacement_at(self, points: Floats, record: int = -1) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        scene = self.static.scene
        points, cells = cells_of_points(scene, points)
        field = DisplacementField(scene, self.static.last, self.squeezed(record))
        return field.at(points, cells)

    def displacement(self, record: int = -1) -> Floats:
        """Return the displacement of the middle of every agent's cell (m)."""
        if not len(self.static.last.cells):
            raise ResultError("displacement: no agent spawned; lower the threshold or press more")
        return self.displacement_at(
            self.static.scene.lattice.centres(self.static.last.cells), record
        )


def law_of(material: Material) -> ThreeElement:
    """Return a material's rheology; without one it is an elastic spring."""
    return material.rheology or ThreeElement.spring(material.youngs_modulus)


class CreepingAgents(Elements):
    """The agents of a load-transfer run, all those of a material as one element.

    Its stretch is the growth of the material. It is as large as all those agents together,
    Σ V e² for a stretch of 1, e the squeeze along each axis, so that its energies are theirs.
    """

    def __init__(self, static: TransferResult) -> None:
        self.static = static
        scene = static.scene
        modulus = np.array([material.youngs_modulus for material in scene.cell_materials])
        volume = scene.lattice.cell_volume(scene.thickness)
        squeezed = np.square(axial_strain(scene, static.last).strain).sum(axis=1)
        size = volume * np.bincount(
            static.last.material, squeezed, minlength=len(scene.cell_materials)
        )
        laws = Laws.of([law_of(material) for material in scene.cell_materials])
        used = np.where(size > 0.0, size, 1.0)
        super().__init__(Laws(*(number * used for number in laws)), modulus * size)
