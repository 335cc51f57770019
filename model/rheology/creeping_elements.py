"""Elements that creep each under its own load: alone, or one for all agents of a material.

Loads travel through a body at once and grow with the history; what takes time is how the
agents give. Under the *prescribed rule* an agent keeps its loads whatever the others do, so
its strain is its elastic strain times the growth of its material, E · (creep under the
history of a unit stress). Displacements are summed up from the grown strains as ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np

from kaju.agents.materials import Material
from kaju.arrays import Floats
from kaju.model.results.result import BodyResult
from kaju.model.results.stored import Column
from kaju.model.transfer.deformation import AxialStrain, DisplacementField, axial_strain
from kaju.model.transfer.transfer_result import TransferResult

from .creep_result import BodyTimeResult, CreepResult, TimeResult
from .creeping_step import Borne, Creeping, Fields
from .element import Laws, ThreeElement, laws_of


class Elements(Creeping):
    """Any number of three-element materials that do not feel each other; by itself, one.

    `share` is the force (N) of each at a factor of 1.
    """

    result: type[TimeResult] = CreepResult

    def __init__(self, laws: Laws, share: Floats) -> None:
        self.laws, self.share = laws, share
        self.parts: dict[str, Any] = {}

    def start(self) -> Fields:
        """Return the state at time 0: nothing stretched, and no force."""
        return tuple(np.zeros((3, len(self.share))))

    def solve(self, stiffness: Floats, rest: Floats, factor: float, before: Fields) -> Borne:
        """Return the force in each element."""
        force = factor * self.share
        return Borne(force, (force,))

    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return elongation (m) and force (N) of the element."""
        q, d, force = fields
        return {"displacement": (q + d)[0], "force": force[0]}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TransferCreepResult(BodyTimeResult):
    """What became of load transfer by a prescribed rule in time.

    Its energies are of what every agent is squeezed by its own loads; the expansion across
    them does no work. In every query `record` is the index of a time asked for; the default
    -1 is the last.
    """

    kind: ClassVar[str] = "load transfer in time"
    static: TransferResult
    """The same scene without time, at a factor of 1."""
    growth: Annotated[Floats, Column("times materials")]
    """Strain of each of the scene's materials, as a multiple of its elastic strain at a factor of
    1. Shape (k, materials)."""

    def max_displacement(self, record: int = -1) -> float:
        """Return how far the corner of an agent's cell has moved that has moved most (m)."""
        return self._field(record).largest()

    def squeezed(self, record: int = -1) -> AxialStrain:
        """Return how much the agents are squeezed, their pressures at a factor of 1."""
        static = axial_strain(self.static.scene, self.static.last)
        grown = self.growth[record, self.static.last.material][:, None]
        return replace(static, strain=static.strain * grown, widening=static.widening * grown)

    def stress(self, record: int = -1) -> Floats:
        """Return the stress of every agent (Pa), shape (agents, dimension, dimension)."""
        return np.asarray(self.static.stress * self.factors[record])

    def displacement_at(self, points: Floats, record: int = -1) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        return self._field(record).at(*self.static.located(points))

    def _field(self, record: int) -> DisplacementField:
        return DisplacementField(self.static.scene, self.static.last, self.squeezed(record))


class GrowingElements(Elements):
    """What grows alike of a static answer, as one element: its stretch is 1 without time.

    `size`: twice the elastic energy of each over its modulus (m³ of unit strain).
    """

    def __init__(
        self, static: BodyResult, result: type[TimeResult], made: Sequence[Material], size: Floats
    ) -> None:
        used = np.where(size > 0.0, size, 1.0)
        laws = laws_of([law_of(material) for material in made])
        modulus = np.array([material.youngs_modulus for material in made])
        super().__init__(Laws(*(number * used for number in laws)), modulus * size)
        self.result, self.parts = result, {"static": static}

    def record(self, fields: Fields) -> dict[str, Floats]:
        """Return how far each has grown."""
        return {"growth": fields[0] + fields[1]}


def creeping_agents(static: TransferResult) -> GrowingElements:
    """Return the agents of a load-transfer run, all those of a material as one element."""
    scene, stage = static.scene, static.last
    volume = scene.lattice.cell_volume(scene.thickness)
    squeezed = np.square(axial_strain(scene, stage).strain).sum(axis=1)
    size = volume * np.bincount(stage.material, squeezed, len(scene.cell_materials))
    return GrowingElements(static, TransferCreepResult, scene.cell_materials, np.asarray(size))


def law_of(material: Material) -> ThreeElement:
    """Return a material's rheology; without one it is an elastic spring."""
    return material.rheology or ThreeElement.spring(material.youngs_modulus)
