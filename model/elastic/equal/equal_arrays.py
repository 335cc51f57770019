"""An elastic answer as arrays over equal cells, whatever agents it was found with."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, Ints, spread
from kaju.errors import ResultError
from kaju.model.elastic.moduli import equivalent_stress

from .cell_agents import CellAgents

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult


class EqualArrays:
    """Arrays over the box around the body, indexed [x, y(, z)]; NaN where there is no body.

    The first cell's lower corner lies at ``origin × cell_size`` (m).
    """

    def __init__(self, result: ElasticResult, division: int) -> None:
        """Lay out cells by their number per cell of the scene, along each axis."""
        (lower, upper), own = result.grid.bounds(), result.subdivision
        # Cells of the grid that are not whole cells of the arrays round the box up.
        first = np.floor_divide(lower * division, own)
        last = -np.floor_divide(-upper * division, own)
        self.origin, self.shape = tuple(first.tolist()), tuple((last - first).tolist())
        count = float(np.prod(np.asarray(self.shape, dtype=np.float64)))
        most = 4e7  # In space stress alone takes 72 bytes of each: 3 GB.
        if count > most:
            raise ResultError(
                f"cells: {count:.2g} cells are more than the {most:.0e} that fit into "
                "arrays; take a smaller resolution, or the arrays of the agents"
            )
        self.cell_size = result.grid.lattice.cell_size * (own / division)
        self._result = result
        # Where the agents are these very cells, row by row, nothing is interpolated.
        self._own = division == own and not result.spawned

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @cached_property
    def body(self) -> Flags:
        """Which cells have their middle in the body."""
        found = self._result.found
        if self._own and isinstance(found, CellAgents):
            return found.body
        return found.holds(self._middles(np.ones(self.shape, np.bool_))).reshape(self.shape)

    @cached_property
    def middle(self) -> Floats:
        """Middles (m) of the cells of the body, shape (cells, dimension), row by row."""
        return self._middles(self.body)

    @cached_property
    def material(self) -> Ints:
        """Index into `scene.cell_materials` of each cell, -1 where there is no body."""
        return spread(self._result.material_at(self.middle), self.body, -1)

    @cached_property
    def displacement(self) -> Floats:
        """Displacement (m) of the cells' middles, shape (n, ..., dimension)."""
        found = self._result
        return self._spread(found.displacement if self._own else found.displacement_at(self.middle))

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the cells, shape (n, ..., dimension, dimension)."""
        found = self._result
        return self._spread(found.stress if self._own else found.stress_at(self.middle))

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the cells, shape (n, ..., dimension, dimension)."""
        found = self._result
        return self._spread(found.strain if self._own else found.strain_at(self.middle))

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the cells."""
        found, stress = self._result.found, self.stress[self.body]
        law = found.law_at(*found.located(self.middle))
        return self._spread(equivalent_stress(stress, found.moduli, law, found.grid.plane))

    def _spread(self, values: Floats) -> Floats:
        """Return values of the body's cells as an array over all cells."""
        return spread(values, self.body, np.nan)

    def _middles(self, chosen: Flags) -> Floats:
        return np.asarray((np.argwhere(chosen) + np.asarray(self.origin) + 0.5) * self.cell_size)
