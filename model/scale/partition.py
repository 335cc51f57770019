"""Which process has which cells and faces, on every level of the hierarchy.

The cells of a level are half as many along every axis as those of the finer one, rounded up, and
every level has a layer of cells around the body, as kaju's arrays have. A process keeps the same
part of the body on all levels: parts are cut where cells of the coarsest level end, so no level
needs an even number of cells. PETSc's DMStag numbers the faces and knows the neighbours.

What a process poses of the whole problem is a *window*: an ordinary problem of equal cells, cut out
of the body with a halo, in the units of the whole. So the law, the loads and the supports are
stated where they always are. Faces near a window's border are not right, and not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags
from kaju.errors import SceneError, require
from kaju.model.elastic.equal.grid import problem_of, sides_of
from kaju.model.elastic.equal.problem import ACTIVE, ElasticProblem, FaceFields
from kaju.model.elastic.equal.system import lift
from kaju.model.elastic.moduli import constants_of
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID
from kaju.model.scene.resolved_body import grid

Index = NDArray[np.int64]
Box = tuple[Index, Index]
"""Lower corner, included, and upper corner, not included, of cells; the rim begins at -1."""

HALO = 3
"""Layers of cells beyond its own that a process knows on the finest level."""


@dataclass(frozen=True)
class PetscLevel:
    """The faces of one level."""

    dm: Any
    shape: tuple[int, ...]  # number of cells along each axis, without the rim
    own: Box  # cells of this process, with its part of the rim
    ghosts: Box  # cells that it knows, with the places of the faces behind the last
    size: int  # number of faces on all processes
    number: tuple[Index, ...]  # per axis PETSc's numbers of the faces below `ghosts`, or -1
    slots: tuple[int, ...]  # per axis the place of these faces among an element's numbers

    def owned(self, axis: int) -> Index:
        """Return the faces normal to an axis that belong to this process, by their cell above."""
        lower, upper = (corner.copy() for corner in self.own)
        upper[axis] += upper[axis] == self.shape[axis] + 1
        return grid(lower, upper)

    def numbers(self, axis: int, faces: Index) -> Index:
        """Return PETSc's numbers of faces, -1 of those that this process does not know."""
        known, found = self.knows(faces), np.full(len(faces), -1, dtype=np.int64)
        found[known] = self.number[axis][tuple((faces[known] - self.ghosts[0]).T)]
        return found

    def knows(self, faces: Index) -> Flags:
        """Tell which faces this process knows."""
        return np.asarray(np.all((faces >= self.ghosts[0]) & (faces < self.ghosts[1]), axis=1))


def levels_of(shape: tuple[int, ...], comm: Any) -> list[PetscLevel]:
    """Return the levels of the hierarchy of a body of so many cells, the finest first."""
    size = comm.getSize()
    # Into how many parts each axis is cut, so that the cuts are small.
    every = product(range(1, size + 1), repeat=len(shape))
    fits = [parts for parts in every if int(np.prod(parts)) == size]
    parts = min(fits, key=lambda parts: (float(np.sum(np.divide(parts, shape))), parts))
    enough = all(n >= (HALO * p if p > 1 else 1) for n, p in zip(shape, parts, strict=True))
    told = f"{' x '.join(map(str, shape))} cells cannot be cut for {size} processes: each needs"
    require(enough, f"solve_petsc: {told} {HALO} or more along every axis; start fewer")
    shapes = [shape]
    while True:
        coarser = tuple(-(-n // 2) for n in shapes[-1])
        enough = all(n >= p for n, p in zip(coarser, parts, strict=True))
        few = len(shape) * np.prod(np.array(shapes[-1]) + 2.0) <= 1500
        if coarser == shapes[-1] or (few and len(shapes) > 1) or not enough:
            break
        shapes.append(coarser)
    cuts = _cuts(shapes, parts)
    return [_level(s, c, parts, comm, HALO if k == 0 else 1) for k, (s, c) in enumerate(cuts)]


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
        tuple(slots),
    )


@dataclass(frozen=True)
class Window:
    """A process's own cells and those around them, posed in the units of the whole body."""

    scene: Scene  # on the cells that are solved
    level: PetscLevel  # the finest
    problem: ElasticProblem
    first: Index  # the scene's cell that is the body's first
    origin: Index  # the body's cell at which the problem's rim begins
    lift: FaceFields  # what leads from moved sides to those opposite

    @property
    def cells(self) -> Box:
        """The process's own cells, without the rim."""
        lower, upper = self.level.own
        return np.maximum(lower, 0), np.minimum(upper, self.level.shape)

    def owned(self, axis: int) -> tuple[Index, ...]:
        """Return where in the problem's arrays the process's own faces normal to an axis lie."""
        return tuple((self.level.owned(axis) - self.origin).T)

    def faces(self, local: Any) -> FaceFields:
        """Return the displacement of all faces from PETSc's local vector."""
        level, fields = self.level, tuple(values.copy() for values in self.lift)
        size = (level.ghosts[1] - level.ghosts[0])[::-1]
        values = local.getArray(readonly=True).reshape(*size, level.dm.getEntriesPerElement())
        for field, slot, state in zip(fields, level.slots, self.problem.face_states, strict=True):
            faces = np.argwhere(state == ACTIVE) + self.origin
            faces = faces[level.knows(faces)]
            place = tuple((faces - level.ghosts[0]).T)
            field[tuple((faces - self.origin).T)] += values[..., slot].T[place]
        return fields


def body_box(scene: Scene) -> Box:
    """Return the box around the body of a scene."""
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    if not (upper > lower).all():
        raise SceneError("body: no cell is of a material, so there is nothing to solve")
    return lower, upper


def window_of(scene: Scene, stage: int | None, level: PetscLevel) -> Window:
    """Return what this process poses of a scene of squares or cubes."""
    body, shape = body_box(scene), np.array(level.shape)
    lower = np.clip(level.own[0] - HALO, 0, shape - 1)
    upper = np.clip(level.own[1] + HALO, 1, shape)
    box = body[0] + lower, body[0] + upper
    cells = grid(box[0] - 1, box[1] + 1)
    kinds = scene.kinds(cells)
    beyond = (cells < 0) | (cells >= np.array(scene.lattice.shape))
    kinds[beyond.sum(axis=1) > 1] = AIR  # outside a corner
    kinds[kinds == DISPLACED] = RIGID
    rim = kinds.reshape(upper - lower + 2).astype(np.int32)
    applied, constants = scene.applied(stage), constants_of(scene)
    modulus, sides = float(constants[:, 0].max()), sides_of(scene, *body).values()
    scales = Scales.of_cells(scene, modulus, applied.force, sides)
    loads = applied.within(*box)
    problem = problem_of(scene, rim, constants, box, loads, scales)
    return Window(scene, level, problem, body[0], lower - 1, lift(problem, lower, shape))
