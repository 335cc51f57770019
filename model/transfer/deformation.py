"""How the agents deform: strain, stress and displacement from the loads they took.

Along each axis a cell is squeezed by what it kept of the loads it took along that axis, and
widened by the free part of the expansion that the other axes cause:

    ε = Σₖ eₖ (-nₖnₖᵀ + βν (1 - nₖnₖᵀ)),   σ = -Σₖ Pₖ/A nₖnₖᵀ,   eₖ = Pₖ / (A E)

where Pₖ = α₁Σ(pushes - pulls) along axis k, of forces both ways. Without a sense all loads are
pushes, so a load that pulls squeezes too.

Displacements are summed along every line of cells from its rigid end. A line without one is
summed from its middle; with two, the misfit is spread evenly. Cells that no load reached stay
as they are, where they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.results.mesh import corner_order
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import RIGID, ROLLER
from kaju.model.scene.lattice import Lattice

from .stage import Stage, Totals


@dataclass(frozen=True, eq=False)
class AxialStrain:
    """How much the agents of a stage are squeezed along the axes of the lattice."""

    lattice: Lattice
    pressure: Floats  # Pₖ / A (Pa); below 0 where pulls prevail, shape (agents, axes)
    strain: Floats  # eₖ, of agents without a law of their own the pressure over Young's modulus
    widening: Floats  # βν eₖ, by which the other axes lengthen

    def strains(self) -> Floats:
        """Return the strain (1) of every agent, shape (agents, dim, dim)."""
        along, across = self._projections()
        strain: Floats = np.tensordot(self.widening, across, axes=1)
        strain -= np.tensordot(self.strain, along, axes=1)
        return strain

    def stresses(self) -> Floats:
        """Return the stress (Pa) of every agent, shape (agents, dim, dim)."""
        return -np.tensordot(self.pressure, self._projections()[0], axes=1)

    def elongation(self, axis: int) -> Floats:
        """Return by how much every agent lengthens along an axis (m), shape (agents,)."""
        along, across = self._projections()
        normal = self.lattice.normals[self.lattice.axes[axis]]
        length: Floats = self.widening @ (across @ normal @ normal)
        length -= self.strain @ (along @ normal @ normal)
        return length * self.lattice.cell_size

    def _projections(self) -> tuple[Floats, Floats]:
        """Return nₖnₖᵀ and 1 - nₖnₖᵀ, each (axes, dim, dim)."""
        normals = self.lattice.normals[self.lattice.axes]
        along = normals[:, :, None] * normals[:, None, :]
        return along, np.eye(self.lattice.dimension) - along


def axial_strain(scene: Scene, stage: Stage | Totals) -> AxialStrain:
    """Return how much the agents of a stage are squeezed by what they kept."""
    lattice = scene.lattice
    area = lattice.cell_volume(scene.thickness) / lattice.cell_size
    return AxialStrain(lattice, stage.kept / area, stage.shortened, stage.widened)


class LineDisplacement:
    """Displacement along one axis, on all lines of cells that agents lie on.

    Agents are sorted by line and position. A *run* is an unbroken row of body cells.
    """

    def __init__(self, scene: Scene, cells: Ints, elongation: Floats, axis: int) -> None:
        line, position = scene.lattice.line(cells, axis)
        order = np.lexsort((position, line))
        line, position, self.elongation = line[order], position[order], elongation[order]
        self.lines, index = np.unique(line, return_inverse=True)
        # One number for line and position, ascending from agent to agent.
        self.stride = int(sum(scene.lattice.extent) / scene.lattice.cell_size) + 8
        self.code = index * self.stride + position + 1
        held = self._find_runs(scene, cells[order], line, position, axis)

        summed = np.cumsum(self.elongation) - self.elongation
        self.before = summed - summed[np.searchsorted(line, line)]  # on its line
        first = np.flatnonzero(np.diff(self.run, prepend=-1))
        last = _last_of(first, len(self.run))
        total = self.before[last] + self.elongation[last] - self.before[first]
        self.offset = -self.before[first]  # added at the start of a run (m)
        self.offset -= np.where(~held[:, 0] & held[:, 1], total, 0.0)
        # Without a rigid end a run stays where its middle is.
        self.slope = np.zeros(len(first))  # taken away per cell (m)
        floating = ~held.any(axis=1)
        middle = 0.5 * (self.start + self.stop)[floating]
        cell = np.floor(middle).astype(np.int64)
        self.offset[floating] -= self.at(line[first[floating]], cell, middle - cell)
        count = np.maximum(self.stop - self.start, 1)
        self.slope = np.where(held.all(axis=1), total / count, 0.0)

    def _find_runs(self, scene: Scene, cells: Ints, line: Ints, position: Ints, axis: int) -> Flags:
        """Find each agent's run, and the ends of all runs; return which ends are held."""
        adjacent = np.zeros(len(line), dtype=np.bool_)
        adjacent[1:] = (line[1:] == line[:-1]) & (position[1:] == position[:-1] + 1)
        first = np.flatnonzero(~adjacent)
        last = _last_of(first, len(line))
        steps, held_above = _end_of_body(scene, cells[last], axis, +1)
        stop = position[last] + steps
        # Two blocks of agents are one run if the lower one's body reaches the upper one.
        joined = np.zeros(len(first), dtype=np.bool_)
        joined[1:] = (line[first[1:]] == line[first[:-1]]) & (stop[:-1] > position[first[1:]])
        lowest = np.flatnonzero(~joined)
        highest = _last_of(lowest, len(first))
        steps, held_below = _end_of_body(scene, cells[first[lowest]], axis, -1)
        self.start, self.stop = position[first[lowest]] - steps + 1, stop[highest]
        block = np.cumsum(~adjacent) - 1
        self.run = (np.cumsum(~joined) - 1)[block]
        return np.stack([held_below, held_above[highest]], axis=1)

    def at(self, line: Ints, position: Ints, fraction: Floats) -> Floats:
        """Return the displacement (m) at a fraction (0 to 1) of the way through cells."""
        value = np.zeros(len(line))
        if not len(self.code):
            return value
        index = np.minimum(np.searchsorted(self.lines, line), len(self.lines) - 1)
        unanswered = self.lines[index] == line
        code = index * self.stride + position + 1
        place = np.searchsorted(self.code, code, side="right")
        # The run is that of the agent before, or else of the agent after, on the same line.
        for neighbour in (place - 1, place):
            near = np.clip(neighbour, 0, len(self.code) - 1)
            run = self.run[near]
            inside = unanswered & (self.code[near] // self.stride == index)
            inside &= (position >= self.start[run]) & (position < self.stop[run])
            exact = self.code[near] == code
            passed = np.where(
                self.code[near] < code, self.before[near] + self.elongation[near], self.before[near]
            )
            passed = passed + np.where(exact, fraction * self.elongation[near], 0.0)
            cells = position + fraction - self.start[run]
            candidate = passed + self.offset[run] - self.slope[run] * cells
            value = np.where(inside, candidate, value)
            unanswered = unanswered & ~inside
        return value


class DisplacementField:
    """Displacement of a load-transfer stage, anywhere in the body."""

    def __init__(self, scene: Scene, stage: Stage, squeezed: AxialStrain) -> None:
        self.lattice: Lattice = scene.lattice
        normals = self.lattice.normals[self.lattice.axes]
        # The vector with these components along the axes, or nearest to having them.
        self.along = normals @ np.linalg.inv(normals.T @ normals)
        self.cells = stage.cells
        self.awake: Ints = scene.lattice.key(stage.cells)
        self.axes = [
            LineDisplacement(scene, stage.cells, squeezed.elongation(axis), axis)
            for axis in range(len(self.lattice.axes))
        ]

    def at(self, points: Floats, cells: Ints) -> Floats:
        """Return displacements (m) at points (m) in cells, all (n, dim); 0 off the load."""
        total = np.zeros_like(points)
        reached = np.isin(self.lattice.key(cells), self.awake)
        total[reached] = self._within(points[reached], cells[reached])
        return total

    def largest(self) -> float:
        """Return how far the corner of an agent's cell moves that moves most (m)."""
        lattice, most = self.lattice, 0.0
        form = lattice.form(self.cells)
        for each in range(lattice.forms):
            cells = self.cells[form == each]
            middles = lattice.centres(cells)
            for corner in self._corners(each):
                moved = self._within(middles + corner, cells)
                most = max(most, float(np.linalg.norm(moved, axis=1).max(initial=0.0)))
        return most

    def _corners(self, form: int) -> Floats:
        """Return the corners of a form about the cell's middle (m)."""
        if self.lattice.dimension == 2:
            return self.lattice.outline(form)
        return (corner_order(3) - 0.5) * self.lattice.cell_size

    def _within(self, points: Floats, cells: Ints) -> Floats:
        """Return displacements (m) at points (m) in cells that a load reached."""
        lattice = self.lattice
        inside_cell = (points - lattice.centres(cells)) / lattice.cell_size
        normals, form = lattice.normals[lattice.axes], lattice.form(cells)
        total = np.zeros_like(points)
        for axis, (normal, displacement) in enumerate(zip(normals, self.axes, strict=True)):
            line, position = lattice.line(cells, axis)
            fraction = inside_cell @ normal + lattice.within[form, axis]
            total += displacement.at(line, position, fraction)[:, None] * self.along[axis]
        return total


def _last_of(first: Ints, count: int) -> Ints:
    """Return the last of each group of so many rows, from the first ones."""
    return np.append(first[1:], count)[: len(first)] - 1


def _end_of_body(scene: Scene, cells: Ints, axis: int, sense: int) -> tuple[Ints, Flags]:
    """Return the distance along an axis to the first cell beyond the body, and if that holds.

    The stride of the walk doubles: long lines cost few calls, a full box of squares or cubes one.
    """
    lattice = scene.lattice
    if scene.uniform and lattice.boxes:
        place = cells[:, axis]
        steps = lattice.shape[axis] - place if sense > 0 else place + 1
        beyond = scene.kinds(lattice.along(cells, axis, sense * steps))
        return steps, (beyond == RIGID) | (beyond == ROLLER)
    steps, kind = np.zeros((2, len(cells)), dtype=np.int64)
    walking, reach = np.arange(len(cells)), 1
    while len(walking):
        count = steps[walking, None] + np.arange(1, reach + 1)
        reached = np.repeat(cells[walking], reach, axis=0)
        kinds = scene.kinds(lattice.along(reached, axis, sense * count.ravel()))
        kinds = kinds.reshape(count.shape)
        found = (kinds < 0).any(axis=1)
        first = np.arange(len(walking)), np.where(found, np.argmax(kinds < 0, axis=1), reach - 1)
        steps[walking], kind[walking] = count[first], kinds[first]
        walking = walking[~found]
        reach = min(2 * reach, max(1, 2**20 // max(len(walking), 1)))
    return steps, (kind == RIGID) | (kind == ROLLER)
