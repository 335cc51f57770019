"""Bodies of cells in time: every agent creeps under the load it has taken.

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
from kaju.agents.rheology import ThreeElement
from kaju.agents.rheology_steps import Laws
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.archive import Archive
from kaju.model.formats import TRANSFER_IN_TIME, sizes_of
from kaju.model.propagation.deformation import DisplacementField, Squeeze, squeeze
from kaju.model.propagation.transfer_result import TransferResult
from kaju.model.result import BodyResult, cells_of_points

from .elements import Elements
from .state import BodyCourse, times_of


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TransferCreepResult(BodyCourse):
    """What became of load transfer by a prescribed rule in time.

    Its energies are of what every agent is squeezed by its own loads; the expansion across
    them does no work. In every query `record` is the index of a time asked for; the default
    -1 is the last.

    Attributes
    ----------
    static : TransferResult
        The same scene without time, at a factor of 1.
    growth : (k, materials) floats
        Strain of each of the scene's materials, as a multiple of its elastic strain at a
        factor of 1.
    """

    kind: ClassVar[str] = "load transfer in time"
    _static: ClassVar[type[BodyResult]] = TransferResult
    static: TransferResult
    growth: Floats

    def _sizes(self, record: int) -> Floats:
        if not len(self.static.last.cells):
            return np.zeros(1)
        sizes: Floats = np.linalg.norm(self.displacement(record), axis=1)
        return sizes

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = super()._own()
        return {**arrays, "growth": self.growth}, about

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        own = super()._from_own(archive)
        sizes = sizes_of(own["static"].scene) | times_of(archive)
        return own | archive.columns(TRANSFER_IN_TIME, sizes)

    def squeezed(self, record: int = -1) -> Squeeze:
        """Return how much the agents are squeezed, their pressures at a factor of 1."""
        static = squeeze(self.static.scene, self.static.last)
        grown = self.growth[record, self.static.last.material][:, None]
        return replace(static, strain=static.strain * grown, widening=static.widening * grown)

    def strain(self, record: int = -1) -> Floats:
        """Return the strain of every agent, shape (agents, dimension, dimension)."""
        return self.squeezed(record).strains()

    def stress(self, record: int = -1) -> Floats:
        """Return the stress of every agent (Pa), shape (agents, dimension, dimension)."""
        return np.asarray(self.static.stress * self.factors[record])

    def displacement_at(self, points: NDArray[np.float64], record: int = -1) -> Floats:
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
        squeezed = np.square(squeeze(scene, static.last).strain).sum(axis=1)
        size = volume * np.bincount(
            static.last.material, squeezed, minlength=len(scene.cell_materials)
        )
        laws = Laws.of([law_of(material) for material in scene.cell_materials])
        used = np.where(size > 0.0, size, 1.0)
        super().__init__(Laws(*(number * used for number in laws)), modulus * size)
