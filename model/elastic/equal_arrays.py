"""An elastic answer as arrays over equal cells, whatever agents it was found with."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.scene import body_cells

from .arguments import check_numbers
from .cell_agents import CellAgents
from .staggered import Pair, axis_pairs

if TYPE_CHECKING:
    from .elastic_result import ElasticResult


MOST_CELLS = 40_000_000  # More cells than this are not laid out as arrays


class EqualArrays:
    """Arrays over the box around the body, indexed [x, y(, z)]; NaN where there is no body.

    The first cell's lower corner lies at ``origin × cell_size`` (m).
    """

    def __init__(
        self,
        result: ElasticResult,
        cell_size: float,
        origin: tuple[int, ...],
        shape: tuple[int, ...],
    ) -> None:
        self.cell_size, self.origin, self.shape = cell_size, origin, shape
        self._result = result
        found = result.found
        own = isinstance(found, CellAgents) and found.grid.lattice.cell_size == cell_size
        # Where the agents are these very cells, their arrays need no interpolation.
        self._agents = found if own and isinstance(found, CellAgents) else None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @cached_property
    def body(self) -> Flags:
        """Which cells have their middle in the body."""
        if self._agents is not None:
            return self._agents.body
        return body_cells(self._result.grid, self._middles(np.ones(self.shape, np.bool_)))[
            1
        ].reshape(self.shape)

    @cached_property
    def middle(self) -> Floats:
        """Middles (m) of the cells of the body, shape (cells, dimension), row by row."""
        return self._middles(self.body)

    @cached_property
    def material(self) -> Ints:
        """Index into `scene.cell_materials` of each cell, -1 where there is no body."""
        material = np.full(self.shape, -1, dtype=np.int64)
        material[self.body] = self._result.found.materials_of(self._moduli)
        return material

    @cached_property
    def _moduli(self) -> Ints:
        """Index of the moduli of each cell of the body."""
        return self._result.found.material_at(*self._result._located(self.middle))

    @cached_property
    def displacement(self) -> Floats:
        """Displacement (m) of the cells' middles, shape (n, ..., dimension)."""
        result, own = self._result, self._agents is not None
        return self._spread(result.displacement if own else result.displacement_at(self.middle))

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the cells, shape (n, ..., dimension, dimension)."""
        result, own = self._result, self._agents is not None
        return self._spread(result.stress if own else result.stress_at(self.middle))

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the cells, shape (n, ..., dimension, dimension)."""
        return self._spread(self._result._strain_of(self.stress[self.body], self._moduli))

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the cells."""
        return self._spread(self._result._von_mises_of(self.stress[self.body], self._moduli))

    @cached_property
    def principal_stress(self) -> Floats:
        """Principal stresses (Pa) of the cells in the plane (space), smallest first."""
        return self._spread(np.asarray(np.linalg.eigvalsh(self.stress[self.body])))

    @cached_property
    def corner_displacement(self) -> Floats:
        """Displacement (m) of the cells' corners, shape (n + 1, ..., dimension)."""
        if self._agents is not None:
            return self._result.found.scales.displacement * self._agents.corners
        nodes, points = self._round(tuple(range(self.dimension)))
        field = np.full((*nodes.shape, self.dimension), np.nan)
        field[nodes] = self._result.displacement_at(points)
        return field

    @cached_property
    def face_displacement(self) -> tuple[Floats, ...]:
        """Normal displacement (m) of the faces' middles per axis, one more along that axis."""
        if self._agents is not None:
            unit = self._result.found.scales.displacement
            return tuple(unit * values for values in self._agents.faces)
        fields = []
        for axis in range(self.dimension):
            faces, points = self._round((axis,))
            field = np.full(faces.shape, np.nan)
            field[faces] = self._result.displacement_at(points)[:, axis]
            fields.append(field)
        return tuple(fields)

    @cached_property
    def edge_shear(self) -> dict[Pair, Floats]:
        """Shear stress (Pa) at the corners (edges) of the cells, per pair of axes."""
        if self._agents is not None:
            unit = self._result.found.scales.stress
            return {pair: unit * shear for pair, shear in self._agents.parts.edges.items()}
        fields = {}
        for pair in axis_pairs(self.dimension):
            edges, points = self._round(pair)
            fields[pair] = np.zeros(edges.shape)
            fields[pair][edges] = self._result.stress_at(points)[:, pair[0], pair[1]]
        return fields

    def _spread(self, values: Floats) -> Floats:
        """Return values of the body's cells as an array over all cells."""
        field = np.full((*self.shape, *values.shape[1:]), np.nan)
        field[self.body] = values
        return field

    def _middles(self, chosen: Flags) -> Floats:
        return np.asarray((np.argwhere(chosen) + np.asarray(self.origin) + 0.5) * self.cell_size)

    def _round(self, axes: tuple[int, ...]) -> tuple[Flags, Floats]:
        """Return which faces (one axis), edges (two) or corners touch the body, and their middles.

        Along these axes there is one more of them than there are cells.
        """
        touched = self.body
        for axis in axes:
            width = [(1, 1) if a == axis else (0, 0) for a in range(self.dimension)]
            padded = np.moveaxis(np.pad(touched, width), axis, 0)
            touched = np.moveaxis(padded[:-1] | padded[1:], 0, axis)
        offset = np.array([0.0 if a in axes else 0.5 for a in range(self.dimension)])
        points = (np.argwhere(touched) + np.asarray(self.origin) + offset) * self.cell_size
        return touched, np.asarray(points)


def arrays_of(result: ElasticResult, resolution: int | None) -> EqualArrays:
    """Return an answer as arrays; see `ElasticResult.cells`."""
    check_numbers(None, resolution)
    division = result.subdivision if resolution is None else int(resolution)
    lower, upper = result.grid.bounds()
    # Cells of the grid that are not whole cells of the arrays round the box up.
    first = np.floor_divide(lower * division, result.subdivision)
    last = -np.floor_divide(-upper * division, result.subdivision)
    shape = tuple(int(n) for n in last - first)
    count = float(np.prod(np.asarray(shape, dtype=np.float64)))
    if count > MOST_CELLS:
        raise ResultError(
            f"cells: {count:.2g} cells are more than the {MOST_CELLS:.0e} that are laid out as "
            "arrays; take a smaller resolution, or the agents' own arrays"
        )
    size = result.scene.lattice.cell_size / division
    if division == result.subdivision:
        size = result.grid.lattice.cell_size
    return EqualArrays(result, size, tuple(int(n) for n in first), shape)
