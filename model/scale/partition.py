"""Which process has which cells and faces, on every level of the hierarchy.

The cells of a level are half as many along every axis as those of the finer one, rounded up, and
every level has a layer of cells around the body, as kaju's arrays have. A process keeps the same
part of the body on all levels: parts are cut where cells of the coarsest level end, so no level
needs an even number of cells. PETSc's DMStag numbers the faces and knows the neighbours.

What a process poses of the whole problem is a *window*: an ordinary problem of equal cells, cut out
of the body with a halo, in the units of the whole. So the law, the loads and the supports are
stated where they always are; of a window's faces only those that are not near its border are
right, and only those are used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from kaju.arrays import Flags, Floats
from kaju.errors import ParameterError, SceneError
from kaju.model.elastic.equal.grid import problem_of
from kaju.model.elastic.equal.problem import (
    ACTIVE,
    CellLoads,
    ElasticProblem,
    FaceFields,
    Side,
)
from kaju.model.elastic.equal.staggered import Numbering, internal_force, stiffness_matrix
from kaju.model.elastic.equal.system import lift
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID
from kaju.model.scene.resolved_body import grid

Index = NDArray[np.int64]
Box = tuple[Index, Index]
"""Lower corner, included, and upper corner, not included, of cells; the rim begins at -1."""

HALO = 3
"""Layers of cells beyond its own that a process knows on the finest level."""
FEWEST_FACES = 1500
"""A level of fewer is factorised, on every process alike."""


@dataclass(frozen=True)
class PetscLevel:
    """The faces of one level."""

    dm: Any
    shape: tuple[int, ...]  # number of cells along each axis, without the rim
    own: Box  # cells of this process, with its part of the rim
    ghosts: Box  # cells that it knows, with the places of the faces behind the last
    size: int  # number of faces on all processes
    number: tuple[Index, ...]  # per axis PETSc's numbers of the faces below `ghosts`, or -1

    def owned(self, axis: int) -> Index:
        """Return the faces normal to an axis that belong to this process, by their cell above."""
        lower, upper = (corner.copy() for corner in self.own)
        upper[axis] += upper[axis] == self.shape[axis] + 1
        ranges = [np.arange(a, b) for a, b in zip(lower, upper, strict=True)]
        return np.stack([r.ravel() for r in np.meshgrid(*ranges, indexing="ij")], axis=1)

    def numbers(self, axis: int, faces: Index) -> Index:
        """Return PETSc's numbers of faces that this process knows."""
        return np.asarray(self.number[axis][tuple((faces - self.ghosts[0]).T)])


def levels_of(shape: tuple[int, ...], comm: Any) -> list[PetscLevel]:
    """Return the levels of the hierarchy of a body of so many cells, the finest first."""
    size = comm.getSize()
    parts = _processes(shape, size)
    if any(n < (HALO * p if p > 1 else 1) for n, p in zip(shape, parts, strict=True)):
        raise ParameterError(
            f"solve_petsc: {' x '.join(map(str, shape))} cells cannot be cut for {size} processes: "
            f"each needs {HALO} or more along every axis; start fewer"
        )
    shapes = [shape]
    while True:
        coarser = tuple(-(-n // 2) for n in shapes[-1])
        enough = all(n >= p for n, p in zip(coarser, parts, strict=True))
        few = len(shape) * np.prod(np.array(shapes[-1]) + 2.0) <= FEWEST_FACES
        if coarser == shapes[-1] or (few and len(shapes) > 1) or not enough:
            break
        shapes.append(coarser)
    cuts = _cuts(shapes, parts)
    return [_level(s, c, parts, comm, HALO if k == 0 else 1) for k, (s, c) in enumerate(cuts)]


def _processes(shape: tuple[int, ...], size: int) -> tuple[int, ...]:
    """Return into how many parts each axis is cut, so that the cuts are small."""
    fits = [
        parts
        for parts in product(range(1, size + 1), repeat=len(shape))
        if int(np.prod(parts)) == size
    ]
    return min(
        fits, key=lambda parts: (sum(p / n for p, n in zip(parts, shape, strict=True)), parts)
    )


def _cuts(
    shapes: list[tuple[int, ...]], parts: tuple[int, ...]
) -> list[tuple[tuple[int, ...], list[Index]]]:
    """Return per level where the parts begin and end, HALO cells apart on the finest."""
    depth = len(shapes) - 1
    found = []
    for level, shape in enumerate(shapes):
        cuts = []
        for n, coarsest, p in zip(shape, shapes[-1], parts, strict=True):
            ends = np.linspace(0, coarsest, p + 1).round().astype(np.int64)
            cuts.append(np.minimum(ends << (depth - level), n))
        found.append((shape, cuts))
    if any((np.diff(c) < (HALO if len(c) > 2 else 1)).any() for c in found[0][1]) and depth:
        # The last part is too thin: cut on a finer level.
        return _cuts(shapes[:-1], parts)
    return found


def _level(
    shape: tuple[int, ...], cuts: list[Index], parts: tuple[int, ...], comm: Any, width: int
) -> PetscLevel:
    from petsc4py import PETSc

    dimension = len(shape)
    sizes = [c.copy() for c in cuts]
    for c in sizes:  # the rim belongs to whoever is beside it
        c[0] -= 1
        c[-1] += 1
    dm = PETSc.DMStag().create(
        dimension,
        dofs=(0, 1, 0) if dimension == 2 else (0, 0, 1, 0),
        sizes=tuple(n + 2 for n in shape),
        boundary_types=("none",) * dimension,
        stencil_type="box",
        stencil_width=width,
        proc_sizes=parts,
        comm=comm,
        setUp=False,
    )
    dm.setOwnershipRanges([np.diff(c).astype(PETSc.IntType) for c in sizes])
    dm.setUp()
    start, count = dm.getCorners()[:2]
    ghost_start, ghost_count = (np.array(part, dtype=np.int64) for part in dm.getGhostCorners())
    slots = [dm.getLocationSlot(name, 0) for name in ("left", "down", "back")[:dimension]]
    numbers = np.asarray(dm.getLGMap().getIndices(), dtype=np.int64)
    table = numbers.reshape(*ghost_count[::-1], dm.getEntriesPerElement())
    lower = np.array(start, dtype=np.int64) - 1
    return PetscLevel(
        dm,
        shape,
        (lower, lower + np.array(count, dtype=np.int64)),
        (ghost_start - 1, ghost_start - 1 + ghost_count),
        dm.createGlobalVec().getSize(),
        tuple(table[..., slot].T for slot in slots),
    )


@dataclass(frozen=True)
class PiecedBody:
    """A scene, cut to the box around its body, and its units."""

    scene: Scene  # on the cells that are solved
    stage: int | None
    lower: Index  # the scene's cell that is the box's first
    shape: tuple[int, ...]  # cells of the box along each axis
    scales: Scales
    loads: CellLoads  # the forces on the body's surface, counted from `lower`

    def kinds(self, box: Box) -> NDArray[np.int32]:
        """Return the kinds of the cells of a box, the rim's as kaju's arrays have them."""
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

    def lift(self, problem: ElasticProblem, origin: Index) -> FaceFields:
        """Return what leads from moved sides to those opposite, in a window's units."""
        lattice, d = self.scene.lattice, len(self.shape)
        moved = np.zeros((d, 2, d))
        for index, name in enumerate(lattice.sides):
            axis, high = divmod(index, 2)
            end = self.lower[axis] + (self.shape[axis] if high else 0)
            displacement = self.scene.side_condition(name).displacement
            if displacement is not None and end == (lattice.shape[axis] if high else 0):
                moved[axis, high] = np.array(displacement) / self.scales.displacement
        return lift(problem, moved, origin + 1, np.array(self.shape))

    def _loads_in(self, lower: Index, upper: Index) -> CellLoads:
        cells, direction, force, uneven = self.loads
        inside = np.all((cells >= lower) & (cells < upper), axis=1)
        uneven = uneven and uneven.within(inside)
        surface = CellLoads(cells[inside] - lower, direction[inside], force[inside], uneven)
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
            uneven,
        )


def body_of(scene: Scene, stage: int | None) -> PiecedBody:
    """Return the body of a scene of squares or cubes, with no units chosen yet."""
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    shape = tuple(int(n) for n in upper - lower)
    weightless = scene
    gravity = scene.body.gravity
    if gravity is not None and any(gravity):
        weightless = scene.replace(body=type(scene.body)(**dict(scene.body) | {"gravity": None}))
    applied = weightless.applied(scene.stages if stage is None else stage)
    loads = CellLoads.of(applied, lower, upper)
    return PiecedBody(scene, stage, lower, shape, Scales(1.0, 1.0, 1.0, 1.0), loads)


def materials_in(body: PiecedBody, cells: Box) -> Flags:
    """Return which of the scene's materials occur in some cells."""
    count = len(body.scene.cell_materials)
    present = np.zeros(count, dtype=np.bool_)
    mine = np.maximum(cells[0], 0), np.minimum(cells[1], np.array(body.shape))
    for part in slabs_of(mine):
        kinds = body.kinds(part)
        present |= np.bincount(kinds[kinds >= 0], minlength=count) > 0
    return present


def scaled(body: PiecedBody, present: Flags) -> PiecedBody:
    """Return a body in units in which its largest modulus and largest force are one."""
    if not present.any():
        raise SceneError("body: no cell is of a material, so there is nothing to solve")
    scene, lattice = body.scene, body.scene.lattice
    used = [m for m, there in zip(scene.cell_materials, present, strict=True) if there]
    modulus = max(material.youngs_modulus for material in used)
    stiffness = modulus * (scene.thickness if lattice.dimension == 2 else lattice.cell_size)
    forces = [float(np.abs(body.loads.force).max(initial=0.0))]
    if scene.body.gravity is not None:
        mass = max(m.density or 0.0 for m in used) * lattice.cell_volume(scene.thickness)
        forces.append(mass * float(np.abs(scene.body.gravity).max()))
    conditions = [scene.side_condition(name).displacement for name in lattice.sides]
    forces += [stiffness * float(np.abs(u).max()) for u in conditions if u is not None]
    return replace(body, scales=Scales.of(modulus, max(forces), lattice.cell_size, stiffness))


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
class PetscRows:
    """The rows of the stiffness matrix that belong to some faces, and what acts on them."""

    row: Index  # PETSc's numbers of the faces
    matrix: csr_array  # the rows, with PETSc's numbers as columns
    right: Floats  # load less what the lead from moved sides takes; 0 at faces that do not move
    active: Flags  # which faces move


def rows_of(body: PiecedBody, level: PetscLevel, cells: Box) -> PetscRows:
    """Return the rows of the faces below some cells of a process's own, behind its last too."""
    problem, origin = body.window(cells, halo=HALO)
    numbering = Numbering(problem.face_states)
    stiffness = stiffness_matrix(problem, numbering).tocsr()
    force = problem.force
    begin = body.lift(problem, origin)
    if any(values.any() for values in begin):
        pull = internal_force(problem, begin)
        force = tuple(f - p for f, p in zip(force, pull, strict=True))
    load = numbering.gather(force)
    names = np.empty(numbering.size, dtype=np.int64)
    picked: list[Index] = []
    row: list[Index] = []
    for axis in range(problem.dimension):
        moving = np.argwhere(problem.face_states[axis] == ACTIVE) + origin
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
    # The rows of faces that move, and ones on the diagonal for the others.
    chosen = stiffness[mine[moves]].tocoo()
    entry_row = np.concatenate([np.flatnonzero(moves)[chosen.row], np.flatnonzero(~moves)])
    column = np.concatenate([names[chosen.col], numbers[~moves]])
    assert (column >= 0).all()
    value = np.concatenate([chosen.data, np.ones(np.count_nonzero(~moves))])
    matrix = csr_array((value, (entry_row, column)), shape=(len(mine), level.size))
    right = np.zeros(len(mine))
    right[moves] = load[mine[moves]]
    return PetscRows(numbers, matrix, right, moves)
