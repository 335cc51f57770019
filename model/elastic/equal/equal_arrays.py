"""An elastic answer as arrays over equal cells, whatever agents it was found with."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.moduli import equivalent_stress, strain_of

from . import fields
from .staggered import ends

if TYPE_CHECKING:
    from kaju.model.elastic.pair.answer import PairAgents

    from .cell_agents import CellAgents

MOST_CELLS = 40_000_000  # More cells than this are not laid out as arrays


class EqualArrays:
    """Arrays over the box around the body, indexed [x, y(, z)]; NaN where there is no body.

    The first cell's lower corner lies at ``origin × cell_size`` (m).
    """

    def __init__(self, found: CellAgents | PairAgents, own: int, division: int) -> None:
        """Lay out cells by their number per cell of the scene; the agents' grid has its `own`."""
        lower, upper = found.grid.bounds()
        # Cells of the grid that are not whole cells of the arrays round the box up.
        first = np.floor_divide(lower * division, own)
        last = -np.floor_divide(-upper * division, own)
        self.origin, self.shape = tuple(first.tolist()), tuple((last - first).tolist())
        count = float(np.prod(np.asarray(self.shape, dtype=np.float64)))
        if count > MOST_CELLS:
            raise ResultError(
                f"cells: {count:.2g} cells are more than the {MOST_CELLS:.0e} that fit into "
                "arrays; take a smaller resolution, or the arrays of the agents"
            )
        self.cell_size = found.grid.lattice.cell_size * (own / division)
        self._found, self._grid = found, found.grid
        # Where the agents are these very cells, their arrays need no interpolation.
        self._agents = None if found.storage == "tree" or division != own else found

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @cached_property
    def body(self) -> Flags:
        """Which cells have their middle in the body."""
        if self._agents is not None:
            return self._agents.body
        middles = self._middles(np.ones(self.shape, np.bool_))
        return self._found.holds(middles).reshape(self.shape)

    @cached_property
    def middle(self) -> Floats:
        """Middles (m) of the cells of the body, shape (cells, dimension), row by row."""
        return self._middles(self.body)

    @cached_property
    def material(self) -> Ints:
        """Index into `scene.cell_materials` of each cell, -1 where there is no body."""
        material = np.full(self.shape, -1, dtype=np.int64)
        material[self.body] = self._found.material_at(self.middle)
        return material

    @cached_property
    def displacement(self) -> Floats:
        """Displacement (m) of the cells' middles, shape (n, ..., dimension)."""
        if self._agents is None:
            return self._spread(self._displacement_at(self.middle))
        return self._spread(self._agents.scales.displacement * self._agents.moved)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the cells, shape (n, ..., dimension, dimension)."""
        if self._agents is None:
            return self._spread(self._stress_at(self.middle))
        return self._spread(self._agents.scales.stress * self._agents.stress)

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the cells, shape (n, ..., dimension, dimension)."""
        scaled = self.stress[self.body] / self._found.scales.modulus
        return self._spread(strain_of(scaled, self._found.moduli, self._law))

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the cells."""
        stress, moduli = self.stress[self.body], self._found.moduli
        return self._spread(equivalent_stress(stress, moduli, self._law, self._grid.plane))

    @cached_property
    def corner_displacement(self) -> Floats:
        """Displacement (m) of the cells' corners, shape (n + 1, ..., dimension)."""
        if self._agents is not None:
            problem, u = self._agents.problem, self._agents.solution.displacement
            return problem.scales.displacement * fields.node_displacement(problem, u)
        nodes, points = self._corners()
        field = np.full((*nodes.shape, self.dimension), np.nan)
        field[nodes] = self._displacement_at(points)
        return field

    @cached_property
    def _law(self) -> Ints:
        """Index of the moduli of each cell of the body."""
        return self._found.law_at(*self._found.located(self.middle))

    def _displacement_at(self, points: Floats) -> Floats:
        unit = self._found.scales.displacement
        return unit * self._found.displacement_at(*self._found.located(points))

    def _stress_at(self, points: Floats) -> Floats:
        unit = self._found.scales.stress
        return unit * self._found.stress_at(*self._found.located(points))

    def _spread(self, values: Floats) -> Floats:
        """Return values of the body's cells as an array over all cells."""
        field = np.full((*self.shape, *values.shape[1:]), np.nan)
        field[self.body] = values
        return field

    def _middles(self, chosen: Flags) -> Floats:
        return np.asarray((np.argwhere(chosen) + np.asarray(self.origin) + 0.5) * self.cell_size)

    def _corners(self) -> tuple[Flags, Floats]:
        """Return which corners of cells, one more along each axis, touch the body, and where."""
        touched = np.pad(self.body, 1)
        for axis in range(self.dimension):
            touched = np.logical_or(*ends(touched, axis))
        points = np.asarray((np.argwhere(touched) + self.origin) * self.cell_size)
        inside = self._found.holds(points)  # of cells that true outlines cut some are not
        touched[touched] = inside
        return touched, points[inside]
