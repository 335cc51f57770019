"""Equal cells as agents: their places, laws, fields and solution."""

from __future__ import annotations

from dataclasses import InitVar, dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.moduli import Moduli, moduli_at
from kaju.model.results.result import OnCells
from kaju.model.results.stored import Column
from kaju.model.scene import Scene

from . import fields
from .grid import Grid, problem_of_scene, repeated
from .staggered import Strains, energy_of_cells
from .system import Solution

MOST_CELLS = 1_000_000  # of which the error is looked at by the energy of corners, too


@dataclass(eq=False)
class CellAgents(OnCells):
    """Agents of one size, as arrays over the box around the body; scaled.

    Lengths are in cells, and agents row by row. `body` tells which cells of the box they are,
    `origin` the cell of the grid that is its first.
    """

    name: ClassVar[str] = "elasticity"
    storage: ClassVar[Literal["cells", "solid"]] = "cells"
    films: ClassVar[tuple[str, ...]] = ("loading",)
    no_bound: ClassVar[str] = (
        "the error of equal cells is only estimated; with a tolerance agents spawn, and in the "
        "plane their error has a bound"
    )
    goals: ClassVar[tuple[()]] = ()
    generations: ClassVar[tuple[()]] = ()
    along: ClassVar[Any] = {}
    scene: Scene  # What was asked
    stage: int | None
    division: int
    solution: Solution  # Scaled displacements of the faces and the history of the iteration
    factor: Annotated[Floats, Column("...")] | None = None
    """Factor of the moduli for every cell of the scene; every agent has its own law then."""
    known: InitVar[Grid | None] = None

    def __post_init__(self, known: Grid | None) -> None:
        self.posed = posed = known or self._posed()
        self.problem, self.origin = posed.problem, posed.origin
        self.scales, self.moduli = posed.problem.scales, posed.problem.moduli
        self.body = np.asarray(posed.problem.kinds[posed.problem.inner] >= 0)
        self.count = int(np.count_nonzero(self.body))
        shapes = [values.shape for values in self.solution.displacement]
        needed = [values.shape for values in self.problem.force]
        if known is None and shapes != needed:
            raise ResultError(f"'displacement' must be of the shapes {needed}, and is of {shapes}")

    def _posed(self) -> Grid:
        """Return the grid of a stored answer."""
        finest = 1 << 20  # more would overflow the numbers of cells of a stored file
        if not 1 <= self.division <= finest:
            raise ResultError(f"'division' must be from 1 to {finest}, and is {self.division}")
        grid = self.scene if self.division == 1 else self.scene.refine(self.division)
        factor = self.factor
        if factor is not None and factor.shape != self.scene.lattice.shape:
            raise ResultError(f"'factor' must be of shape {self.scene.lattice.shape}")
        if factor is not None and not np.all(factor[self.scene.rasterise() >= 0] > 0.0):
            raise ResultError("'factor' must be above 0")
        problem, origin = problem_of_scene(grid, self.stage, repeated(factor, self.division))
        return Grid(grid, problem, origin, self.division)

    @property
    def grid(self) -> Scene:
        """The scene on the cells that were solved."""
        return self.posed.scene

    @property
    def _kinds(self) -> NDArray[np.int32]:
        return self.problem.kinds[self.problem.inner]

    @cached_property
    def cells(self) -> Ints:
        """The grid's cells that are agents, shape (agents, dimension)."""
        return np.asarray(np.argwhere(self.body) + np.asarray(self.origin), dtype=np.int64)

    @property
    def lower(self) -> Floats:
        """Lower corners of the agents."""
        return self.cells.astype(np.float64)

    @property
    def size(self) -> Floats:
        """Edges of the agents."""
        return np.ones(self.count)

    @property
    def law(self) -> Ints:
        """Index of each agent's moduli."""
        return np.asarray(self._kinds[self.body], dtype=np.int64)

    @property
    def material(self) -> Ints:
        """Index of each agent's material."""
        return self.law if self.factor is None else np.asarray(self.grid.kinds(self.cells))

    @property
    def stiffness(self) -> Floats | None:
        """Factor of the moduli of each agent's material."""
        if self.factor is None:
            return None
        division = self.grid.lattice.shape[0] // len(self.factor)
        return np.asarray(self.factor[tuple((self.cells // division).T)])

    @property
    def energies(self) -> Floats:
        """Energy stored in each agent, with its share of the edges round it."""
        return energy_of_cells(self.problem, self.solution.displacement)[self.body]

    @cached_property
    def error(self) -> float:
        """Estimated relative error in the energy norm.

        The solution's own estimate, the difference to cells twice as large, does not see a twist,
        which these tell, too. But these cells are too soft, and the same displacement, running from
        corner to corner, has too much energy: the true one lies about half-way.
        """
        own, energies, rubber = self.solution.error, self.energies, self.problem.needs_mixed_form
        stored = float(energies.sum())
        # Of slender rubber the solution's own estimate is ten times too large, of other is right.
        if (rubber and own < 1.0) or not stored > 0.0 or self.count > MOST_CELLS:
            return own
        stretch, lateral, shear = moduli_at(self.moduli, self.law)
        moduli = Moduli(stretch, np.minimum(lateral, 25.0 * shear), shear)  # stiffer ones lock
        stiff = fields.corner_energies(self.corner_displacement, self.body, moduli)
        twist = sqrt(max(0.5 * float(np.nansum(stiff - energies)) / stored, 0.0))
        return twist if rubber else max(own, twist)

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles."""
        return fields.cell_means(self.problem, self.solution.displacement)[self.body]

    @property
    def stress(self) -> Floats:
        """Stress tensors of the agents."""
        return fields.cell_tensor(self.problem, self.parts, self.body)

    balanced = stress

    @cached_property
    def parts(self) -> Strains:
        """Normal stresses of the box's cells, shear stresses of its edges."""
        return fields.stress_parts(self.problem, self.solution.displacement)

    @cached_property
    def corner_displacement(self) -> Floats:
        """Displacement of the corners of the box's cells; NaN where there is no body."""
        return fields.node_displacement(self.problem, self.solution.displacement)

    @cached_property
    def farthest(self) -> float:
        """Largest displacement, of corners and middles."""
        places = self.corner_displacement, self.moved
        return max(float(np.nanmax(np.linalg.norm(u, axis=-1))) for u in places)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of each support on the body."""
        u = self.solution.displacement
        return fields.reactions(self.problem, u, self.grid, self.origin)

    def displacement_at(self, points: Floats, cells: Ints) -> Floats:
        """Return the displacement at points (m) in or on cells of the grid."""
        return fields.at_nodes(self.corner_displacement, *self._within(points, cells))

    def stresses_at(self, points: Floats, cells: Ints) -> tuple[Floats, ...]:
        """Return stress tensors at points (m) in or on cells of the grid: the only ones."""
        return (fields.stress_at(self.parts, self._laws, *self._within(points, cells)),)

    @cached_property
    def _laws(self) -> NDArray[np.int32]:
        """Index of the law of each of the box's cells, equal for equal moduli; below 0 outside."""
        kinds = self._kinds.copy()
        if self.factor is not None:
            moduli = np.stack(self.moduli, axis=1)
            kinds[self.body] = np.unique(moduli, axis=0, return_inverse=True)[1].ravel()
        return kinds

    def law_at(self, points: Floats, cells: Ints) -> Ints:
        """Return the index of the moduli of the cells in or on which points lie."""
        return np.asarray(self._kinds[tuple((cells - np.asarray(self.origin)).T)], dtype=np.int64)

    def _within(self, points: Floats, cells: Ints) -> tuple[Ints, Floats]:
        local = points / self.grid.lattice.cell_size - cells
        return cells - np.asarray(self.origin), np.clip(local, 0.0, 1.0)
