"""What one process poses of the whole problem: the cells around its own, with their loads.

A window is an ordinary problem of equal cells, cut out of the body with a halo, in the units of
the whole. So the law, the loads and the supports are stated where they always are; of a window's
faces only those that are not near its border are right, and only those are used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError
from kaju.model.elastic.problem import (
    ACTIVE,
    CellLoads,
    ElasticProblem,
    FaceFields,
    Scales,
    Side,
    problem_of,
)
from kaju.model.elastic.staggered import (
    Numbering,
    internal_force,
    stiffness_matrix,
)
from kaju.model.elastic.system import lead
from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, DISPLACED, RIGID

from .partition import HALO, Box, Index, Level


@dataclass(frozen=True)
class Body:
    """A scene, cut to the box around its body, and its units.

    Attributes
    ----------
    scene : Scene
        On the cells that are solved.
    stage : int or None
    lower : array
        The scene's cell that is the box's first.
    shape : tuple of int
        Cells of the box along each axis.
    scales : Scales
    loads : CellLoads
        The forces on the body's surface, counted from `lower`.
    """

    scene: Scene
    stage: int | None
    lower: Index
    shape: tuple[int, ...]
    scales: Scales
    loads: CellLoads

    def kinds(self, box: Box) -> NDArray[np.int32]:
        """Return the kinds of the cells of a box, the rim's as kaju's arrays have them."""
        from kaju.model.scene.filling import grid

        cells = grid(*box) + self.lower
        kinds = self.scene.kinds(cells)
        beyond = (cells < 0) | (cells >= np.array(self.scene.lattice.shape))
        kinds[beyond.sum(axis=1) > 1] = AIR  # outside a corner
        kinds[kinds == DISPLACED] = RIGID
        return kinds.reshape([int(b - a) for a, b in zip(*box, strict=True)]).astype(np.int32)

    def window(self, cells: Box, halo: int = HALO) -> tuple[ElasticProblem, Index]:
        """Return the problem of some cells and those around them, and where its rim begins."""
        shape = np.array(self.shape)
        lower = np.clip(cells[0] - halo, 0, shape - 1)
        upper = np.clip(cells[1] + halo, 1, shape)
        sides: dict[str, Side] = {}
        for index, name in enumerate(self.scene.lattice.sides):
            axis, high = divmod(index, 2)
            end = (self.lower + upper)[axis] == self.scene.lattice.shape[axis]
            condition = self.scene.side_condition(name)
            if not (end if high else (self.lower + lower)[axis] == 0):
                continue
            if condition.stiffness is not None:
                sides[name] = ("foundation", condition.stiffness)
            elif condition.displacement is not None:
                sides[name] = ("displacement", condition.displacement)
        problem = problem_of(
            self.kinds((lower - 1, upper + 1)),
            [(m.youngs_modulus, m.poissons_ratio) for m in self.scene.cell_materials],
            self.scene.lattice.cell_size,
            plane=self.scene.plane,
            thickness=self.scene.thickness,
            sides=sides,
            loads=self._loads_in(lower, upper),
            scales=self.scales,
        )
        return problem, lower - 1

    def lead(self, problem: ElasticProblem, origin: Index) -> FaceFields:
        """Return what leads from moved sides to those opposite, in a window's units."""
        lattice, d = self.scene.lattice, len(self.shape)
        moved = np.zeros((d, 2, d))
        for index, name in enumerate(lattice.sides):
            axis, high = divmod(index, 2)
            end = self.lower[axis] + (self.shape[axis] if high else 0)
            displacement = self.scene.side_condition(name).displacement
            if displacement is not None and end == (lattice.shape[axis] if high else 0):
                moved[axis, high] = np.array(displacement) / self.scales.displacement
        return lead(problem, moved, origin + 1, np.array(self.shape))

    def _loads_in(self, lower: Index, upper: Index) -> CellLoads:
        cells, direction, force = self.loads
        inside = np.all((cells >= lower) & (cells < upper), axis=1)
        surface = CellLoads(cells[inside] - lower, direction[inside], force[inside])
        gravity = self.scene.body.gravity
        if gravity is None or not any(gravity):
            return surface
        kinds = self.kinds((lower, upper))
        mass = np.array([m.density or 0.0 for m in self.scene.cell_materials])
        mass = mass * self.scene.lattice.cell_volume(self.scene.thickness)
        heavy = np.argwhere(kinds >= 0)
        weight = np.outer(mass[kinds[kinds >= 0]], gravity)
        return CellLoads(
            np.concatenate([surface.cells, heavy]),
            np.concatenate([surface.direction, np.full(len(heavy), -1)]),
            np.concatenate([surface.force, weight]),
        )


def body_of(scene: Scene, stage: int | None) -> Body:
    """Return the body of a scene, with units in which nothing has been chosen yet.

    Parameters
    ----------
    scene : Scene
        Of squares or cubes.
    stage : int or None
    """
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    shape = tuple(int(n) for n in upper - lower)
    weightless = scene
    gravity = scene.body.gravity
    if gravity is not None and any(gravity):
        weightless = scene.replace(body=type(scene.body)(**dict(scene.body) | {"gravity": None}))
    applied = weightless.applied(scene.stages if stage is None else stage)
    inside = np.all((applied.cells >= lower) & (applied.cells < upper), axis=1)
    loads = CellLoads(
        applied.cells[inside] - lower, applied.direction[inside], applied.force[inside]
    )
    return Body(scene, stage, lower, shape, Scales(1.0, 1.0, 1.0, 1.0), loads)


def materials_in(body: Body, cells: Box) -> NDArray[np.bool_]:
    """Return which of the scene's materials occur in some cells."""
    count = len(body.scene.cell_materials)
    present = np.zeros(count, dtype=np.bool_)
    mine = np.maximum(cells[0], 0), np.minimum(cells[1], np.array(body.shape))
    for part in slabs_of(mine):
        kinds = body.kinds(part)
        present |= np.bincount(kinds[kinds >= 0], minlength=count) > 0
    return present


def scaled(body: Body, present: NDArray[np.bool_]) -> Body:
    """Return a body in units in which its largest modulus and largest force are one.

    Raises
    ------
    SceneError
        If no cell is of a material.
    """
    if not present.any():
        raise SceneError("body: no cell is of a material, so there is nothing to solve")
    used = [m for m, there in zip(body.scene.cell_materials, present, strict=True) if there]
    scales = _scales(body.scene, used, body.loads, body.scene.body.gravity)
    return replace(body, scales=scales)


def _scales(scene: Scene, used: list[Any], loads: CellLoads, gravity: Any) -> Scales:
    lattice = scene.lattice
    modulus = max(material.youngs_modulus for material in used)
    stiffness = modulus * (scene.thickness if lattice.dimension == 2 else lattice.cell_size)
    forces = [float(np.abs(loads.force).max())] if len(loads.force) else []
    if gravity is not None:
        mass = max(m.density or 0.0 for m in used) * lattice.cell_volume(scene.thickness)
        forces.append(mass * float(np.abs(gravity).max()))
    conditions = [scene.side_condition(name).displacement for name in lattice.sides]
    forces += [stiffness * float(np.abs(u).max()) for u in conditions if u is not None]
    return Scales.of(modulus, max(forces, default=0.0), lattice.cell_size, stiffness)


MOST_CELLS = 40_000
"""Rows are assembled for so many cells at a time, which bounds what that needs."""


def slabs_of(box: Box) -> list[Box]:
    """Return a box in pieces of about `MOST_CELLS` along its first axis."""
    lower, upper = box
    if (upper <= lower).any():
        return []
    layer = int(np.prod(upper[1:] - lower[1:]))
    step = max(1, MOST_CELLS // layer)
    pieces = []
    for start in range(int(lower[0]), int(upper[0]), step):
        first, last = lower.copy(), upper.copy()
        first[0], last[0] = start, min(start + step, int(upper[0]))
        pieces.append((first, last))
    return pieces


@dataclass(frozen=True)
class Rows:
    """The rows of the stiffness matrix that belong to some faces, and what acts on them.

    Attributes
    ----------
    row : array
        PETSc's numbers of the faces.
    start, column, value : arrays
        The rows, compressed, with PETSc's numbers as columns.
    right : array
        Load less what the lead from moved sides takes; 0 at faces that do not move.
    active : array of bool
        Which faces move.
    """

    row: Index
    start: Index
    column: Index
    value: NDArray[np.float64]
    right: NDArray[np.float64]
    active: NDArray[np.bool_]


def rows_of(body: Body, level: Level, cells: Box) -> Rows:
    """Return the rows of the faces below some cells of a process's own, behind its last too."""
    problem, origin = body.window(cells, halo=HALO)
    numbering = Numbering(problem.face_states())
    stiffness = stiffness_matrix(problem, numbering).tocsr()
    force = problem.force
    begin = body.lead(problem, origin)
    if any(values.any() for values in begin):
        pull = internal_force(problem, begin)
        force = tuple(f - p for f, p in zip(force, pull, strict=True))
    load = numbering.gather(force)
    names = np.empty(numbering.size, dtype=np.int64)
    picked: list[Index] = []
    row: list[Index] = []
    for axis in range(problem.dimension):
        moving = np.argwhere(problem.face_states()[axis] == ACTIVE) + origin
        known = np.all((moving >= level.ghosts[0]) & (moving < level.ghosts[1]), axis=1)
        number = numbering.number[axis][tuple((moving - origin).T)]
        names[number] = -1
        names[number[known]] = level.numbers(axis, moving[known])
        faces = level.owned(axis)
        last = np.where(cells[1] == level.own[1], cells[1] + 1, cells[1])
        faces = faces[np.all((faces >= cells[0]) & (faces < last), axis=1)]
        place = tuple((faces - origin).T)
        size = np.array(numbering.number[axis].shape, dtype=np.int64)
        there = np.all((faces >= origin) & (faces - origin < size), axis=1)
        those = np.full(len(faces), -1, dtype=np.int64)
        those[there] = numbering.number[axis][tuple(p[there] for p in place)]
        picked.append(those)
        row.append(level.numbers(axis, faces))
    mine, numbers = np.concatenate(picked), np.concatenate(row)
    moves = mine >= 0
    chosen = stiffness[mine[moves]]
    counts = np.ones(len(mine), dtype=np.int64)
    counts[moves] = np.diff(chosen.indptr)
    start = np.concatenate([[0], np.cumsum(counts)])
    column = np.empty(start[-1], dtype=np.int64)
    value = np.ones(start[-1])
    from_matrix = np.repeat(moves, counts)
    column[from_matrix] = names[chosen.indices]
    value[from_matrix] = chosen.data
    column[~from_matrix] = numbers[~moves]
    assert (column >= 0).all()
    right = np.zeros(len(mine))
    right[moves] = load[mine[moves]]
    return Rows(numbers, start, column, value, right, moves)
