"""Mesa's cell spaces of a body, whose cells are made when somebody asks for them.

Mesa lays all cells of a grid at once, which on a large body takes longer than the run. These
spaces are Mesa's own classes, so that its drawing and its neighbourhoods work, but a cell
is made when it is first looked up, and finds its neighbours when it is first asked for them.
Cells beside the body, in which boundary agents live, are kept apart from the array's.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from itertools import product
from random import Random
from typing import Any

import networkx
import numpy as np

from kaju._mesa import AgentSet, Cell, DiscreteSpace, HexGrid, Network, OrthogonalVonNeumannGrid
from kaju.model.scene.lattice import Lattice
from kaju.model.scene.lattices import BUILT_IN

Index = tuple[int, ...]


class BodyCell(Cell):
    """A cell that finds its neighbours when it is asked for them."""

    space: BodySpace
    found: dict[Index, Cell] | None = None

    @property
    def connections(self) -> dict[Index, Cell]:
        """The cells beside it, by the step that leads there."""
        if self.found is None:
            self.found = self.space.neighbours(self.coordinate)
        return self.found

    @connections.setter
    def connections(self, given: dict[Index, Cell]) -> None:
        self.found = given or None

    def __reduce__(self) -> Any:
        """Leave out the neighbours, each of which would drag along its own."""
        kept = {k: v for k, v in self.__dict__.items() if k not in ("found", "neighborhood")}
        start = partial(BodyCell, random=self.random)
        return start, (self.coordinate,), (kept, {"_agents": self._agents})


class CellsOnDemand(dict[Index, Cell]):
    """The array's cells by coordinate; asked for all of them it makes those that are missing."""

    def __init__(self, space: BodySpace) -> None:
        super().__init__()
        self.space = space

    def __missing__(self, at: Index) -> Cell:
        if not self.space.holds(at):
            raise KeyError(at)
        cell = self[at] = self.space.new_cell(at)
        return cell

    def values(self) -> Any:
        """Return all cells, made by now."""
        for at in product(*map(range, self.space.dimensions)):
            self[at]
        return super().values()


class BodySpace(DiscreteSpace):
    """What the spaces of all lattices share."""

    def __init__(self, lattice: Lattice, random: Random) -> None:
        DiscreteSpace.__init__(self, random=random, cell_klass=BodyCell)
        self.lattice, self.dimensions, self.torus = lattice, lattice.shape, False
        self._ndims, self._try_random = lattice.dimension, True
        self._cells = CellsOnDemand(self)
        self.beside: dict[Index, Cell] = {}
        self._mesa_property_layers: dict[str, Any] = {}  # Mesa 3 keeps layers of properties here
        if not hasattr(type(self), "property_layers"):
            self.property_layers: dict[str, Any] = {}  # and Mesa 4 here

    def holds(self, at: Index) -> bool:
        """Tell whether a cell belongs to the array."""
        shape = self.dimensions
        return len(at) == len(shape) and all(0 <= i < n for i, n in zip(at, shape, strict=True))

    def cell(self, at: Index) -> Cell:
        """Return the cell with that coordinate, also beside the array."""
        if self.holds(at):
            return self._cells[at]
        if at not in self.beside:
            self.beside[at] = self.new_cell(at)
        return self.beside[at]

    def new_cell(self, at: Index) -> BodyCell:
        """Make a cell."""
        cell = BodyCell(at, capacity=self.capacity, random=self.random)
        cell.space = self
        return cell

    def neighbours(self, at: Index) -> dict[Index, Cell]:
        """Return the array's cells beside a cell, by the step that leads there."""
        form = int(self.lattice.form(np.array([at]))[0])
        found = {}
        for arm in self.lattice.arms[form]:
            step = tuple(self.lattice.steps[form, arm].tolist())
            there = tuple(i + by for i, by in zip(at, step, strict=True))
            if self.holds(there):
                found[step] = self._cells[there]
        return found

    @property
    def agents(self) -> AgentSet:
        """The agents in the space and beside it."""
        cells: Iterable[Cell] = (*dict.values(self._cells), *self.beside.values())
        return AgentSet([agent for cell in cells for agent in cell.agents], random=self.random)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state

    def _connect_cells(self) -> None:
        """Do nothing: cells find their neighbours themselves."""

    @property
    def _celllist(self) -> list[Cell]:
        return list(self._cells.values())


class SquareSpace(BodySpace, OrthogonalVonNeumannGrid):
    """Squares and cubes."""


class HexagonSpace(BodySpace, HexGrid):
    """Hexagons."""


class GraphSpace(BodySpace, Network):
    """Cells of any other lattice."""

    @property
    def G(self) -> networkx.Graph:  # noqa: N802
        """Which cells are beside each other, as a graph of their coordinates."""
        graph = networkx.Graph()
        for cell in self._cells.values():
            graph.add_node(cell.coordinate)
            beside = [other.coordinate for other in cell.connections.values()]
            graph.add_edges_from((cell.coordinate, other) for other in beside)
        return graph


def space_of(lattice: Lattice, random: Random) -> BodySpace:
    """Return Mesa's space of a lattice, without cells yet."""
    if lattice.kind not in BUILT_IN:
        return GraphSpace(lattice, random)
    return (HexagonSpace if lattice.kind == "hexagon" else SquareSpace)(lattice, random)
