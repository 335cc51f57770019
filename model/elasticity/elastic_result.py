"""The answer of the elastic solver: displacements, stresses, reactions, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.model.result import cells_of_points
from kaju.model.scene import Scene

from . import fields, sampling
from .engine import Solution
from .from_scene import problem_of_scene
from .problem import ABSENT, ElasticProblem, FaceFields, Floats, Scales
from .reactions import INSIDE, reactions
from .solid_result import SolidResult
from .staggered import Pair, Strains

if TYPE_CHECKING:
    import xarray

    from .export import Mesh


@dataclass(frozen=True, eq=False, repr=False)
class ElasticResult(SolidResult):
    """Linear elasticity of a scene on the staggered grid.

    Arrays over cells are indexed [x, y(, z)] over the box around the body; `origin` is the
    cell of the grid at which they begin.

    Attributes
    ----------
    scene : Scene
        What was asked.
    grid : Scene
        The same scene on the cells that were solved (`subdivision` smaller).
    stage : int or None
        Stage of loading; None is the last.
    subdivision : int
        Cells per cell of the scene along each axis.
    problem : ElasticProblem
        The scaled arrays that were solved.
    origin : tuple of int
        The grid's cell that is the arrays' first.
    solution : Solution
        Scaled displacements and the history of the iteration.
    seconds : float
    """

    kind: ClassVar[str] = "elasticity"
    scene: Scene
    grid: Scene
    stage: int | None
    subdivision: int
    problem: ElasticProblem
    origin: tuple[int, ...]
    solution: Solution
    seconds: float

    @property
    def cell_size(self) -> float:
        """Edge of the cells that were solved (m)."""
        return self.grid.lattice.cell_size

    @property
    def body(self) -> NDArray[np.bool_]:
        """Which cells are of a material, shape of the arrays over cells."""
        return self.problem.kinds[self.problem.inner] >= 0

    @property
    def _scales(self) -> Scales:
        return self.problem.scales

    @property
    def _energy(self) -> float:
        return self.solution.energy

    @cached_property
    def face_displacement(self) -> FaceFields:
        """Normal displacement (m) of the faces per axis; NaN where there is no body."""
        unit = self.problem.scales.displacement
        states = self.problem.face_states()
        return tuple(
            np.where(state == ABSENT, np.nan, unit * values)[self.problem.inner]
            for values, state in zip(self.solution.displacement, states, strict=True)
        )

    @cached_property
    def corner_displacement(self) -> Floats:
        """Displacement (m) of the cells' corners, shape (n + 1, ..., dimension), else NaN."""
        nodes = fields.node_displacement(self.problem, self.solution.displacement)
        return self.problem.scales.displacement * nodes

    @cached_property
    def cell_displacement(self) -> Floats:
        """Displacement (m) of the cells' middles, shape (n, ..., dimension); NaN off the body."""
        means = fields.cell_means(self.problem, self.solution.displacement)
        return self.problem.scales.displacement * means

    @cached_property
    def _parts(self) -> Strains:
        parts = fields.stress_parts(self.problem, self.solution.displacement)
        unit = self._stress_unit
        return Strains(
            tuple(unit * s for s in parts.cells), {p: unit * s for p, s in parts.edges.items()}
        )

    @property
    def edge_shear(self) -> dict[Pair, Floats]:
        """Shear stress (Pa) at the corners (edges) of the cells, per pair of axes."""
        return self._parts.edges

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the cells, shape (n, ..., dimension, dimension)."""
        return fields.cell_tensor(self.problem, self._parts)

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the cells, shape (n, ..., dimension, dimension)."""
        modulus = self.problem.scales.modulus
        return fields.strain_tensor(self.problem, self.stress / modulus)

    @cached_property
    def principal_stress(self) -> Floats:
        """Principal stresses (Pa) of the cells in the plane (space), smallest first."""
        filled = np.where(self.body[..., None, None], self.stress, 0.0)
        return np.where(self.body[..., None], np.linalg.eigvalsh(filled), np.nan)

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the cells."""
        across: Floats | float = 0.0
        if self.problem.plane == "strain":
            kinds = np.maximum(self.problem.kinds[self.problem.inner], 0)
            lateral, shear = self.problem.moduli.lateral[kinds], self.problem.moduli.shear[kinds]
            ratio = lateral / (2 * (lateral + shear))
            across = ratio * np.trace(self.stress, axis1=-2, axis2=-1)
        return fields.von_mises(self.stress, across)

    @cached_property
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body; "rigid" are rigid cells inside the array."""
        lattice, shape = self.grid.lattice, self.problem.shape
        names = []
        for index, name in enumerate(lattice.sides):
            axis, upper = divmod(index, 2)
            end = self.origin[axis] + shape[axis] == lattice.shape[axis]
            reached = end if upper else self.origin[axis] == 0
            names.append(name if reached else INSIDE)
        found = reactions(self.problem, self.solution.displacement, tuple(names))
        return {name: self.problem.scales.force * force for name, force in found.items()}

    @property
    def error_estimate(self) -> float:
        """Estimated error in the energy norm, relative to the solution.

        It is the difference to the answer of cells twice as large, together with what the
        iteration left. The displacements' own error is nearer to its square.
        """
        return self.solution.error_estimate

    @property
    def residuals(self) -> tuple[float, ...]:
        """Relative residual before every iteration."""
        return tuple(self.solution.residuals)

    @property
    def max_displacement(self) -> float:
        """Largest displacement of a cell's middle (m)."""
        return float(np.nanmax(np.linalg.norm(self.cell_displacement, axis=-1)))

    def _figures(self) -> dict[str, Any]:
        return {
            "agents": int(np.count_nonzero(self.body)),
            "levels": self.solution.levels,
            "method": self.solution.method,
            "subdivision": self.subdivision,
            "notes": list(self.solution.notes),
        }

    def displacement_at(self, points: NDArray[np.float64]) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        cells, local = self._locate(points)
        return sampling.at_nodes(self.corner_displacement, cells, local)

    def stress_at(self, points: NDArray[np.float64]) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""
        cells, local = self._locate(points)
        return sampling.stress_at(self._parts, self.problem.kinds[self.problem.inner], cells, local)

    def _locate(self, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], Floats]:
        points, cells = cells_of_points(self.grid, points)
        local = points / self.cell_size - cells
        return cells - np.asarray(self.origin), np.clip(local, 0.0, 1.0)

    def _columns(self) -> dict[str, NDArray[Any]]:
        from .export import columns

        return columns(self)

    def _mesh(self) -> Mesh:
        from .export import mesh

        return mesh(self)

    def to_xarray(self) -> xarray.Dataset:
        """Return cells, faces and corners with coordinates and units.

        Raises
        ------
        MissingExtraError
            If xarray is not installed.
        """
        from .export import dataset

        return dataset(self)

    def _archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        described = {
            name: value
            for name, value in vars(self.solution).items()
            if name not in ("displacement", "prepared")
        }
        faces = {f"face.{a}": values for a, values in enumerate(self.solution.displacement)}
        about = {"stage": self.stage, "subdivision": self.subdivision, "solution": described}
        return faces, about

    @classmethod
    def _from_archive(
        cls, scene: Scene, arrays: dict[str, NDArray[Any]], about: dict[str, Any]
    ) -> ElasticResult:
        division = about["subdivision"]
        grid = scene if division == 1 else scene.refine(division)
        problem, origin = problem_of_scene(grid, about["stage"])
        faces = tuple(arrays[f"face.{axis}"] for axis in range(problem.dimension))
        solution = Solution(displacement=faces, **about["solution"])
        return cls(
            scene, grid, about["stage"], division, problem, origin, solution, about["seconds"]
        )
