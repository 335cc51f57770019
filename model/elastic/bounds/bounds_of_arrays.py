"""Equal cells as the boxes of which energy bounds are made."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.bound_cells import (
    BoundCells,
    Foundation,
    Hanging,
    HeldSides,
    Loads,
    Mesh,
    corner_ends,
    entered,
    split_nodes,
)
from kaju.model.elastic.equal.cell_loads import portions_of_cells
from kaju.model.elastic.equal.problem import ElasticProblem, FaceFields
from kaju.model.elastic.equal.staggered import axis_pairs, force_of, strains, stresses
from kaju.model.elastic.moduli import Moduli
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER

PAD = 1  # Layers around the ghost cells; one more behind them
KINDS = 5  # Kinds of cells that are no material: negative, so they index a table from its end


def boxes_of_cells(
    problem: ElasticProblem, u: FaceFields, unsettled: float, grid: Scene, stage: int | None
) -> BoundCells:
    """Return equal cells with the stresses of a solution."""
    # `unsettled` is the relative error in the energy norm that the iteration has left, `grid` the
    # scene on the problem's cells.
    cells, d = _Cells(problem), problem.dimension
    stress = stresses(problem, strains(u))
    applied = grid.applied(stage)
    loaded = applied.cells - np.asarray(grid.bounds()[0], dtype=np.int64) + 1 + PAD
    box = cells.number[loaded @ cells.steps]
    force = applied.force / problem.scales.force
    body, loads = entered(box, applied.direction, force, len(cells.place))
    portions = portions_of_cells(applied, problem.scales.force)
    faces = [cells.laid(values) for values in u]
    nothing = np.zeros(0, dtype=np.int64)
    shear = {}
    for (a, b), tau in stress.edges.items():
        ends = np.add.outer([0, cells.steps[a]], [0, cells.steps[b]])
        whole = tau + problem.surface_shear.get((a, b), 0.0)
        shear[a, b] = cells.laid(whole)[cells.place + ends[..., None]]
    return BoundCells(
        np.ones(len(cells.place)),
        Moduli(*cells.law[:, cells.kinds[cells.place]]),
        np.stack([cells.laid(normal)[cells.place] for normal in stress.cells]),
        shear,
        body,
        cells.number[cells.beside],
        cells.kind,
        cells.uneven(loads),
        Hanging(nothing, nothing, nothing.reshape(0, 1 << (d - 1))),
        loads,
        cells.held(),
        cells.beds(),
        cells.mesh(faces),
        np.stack([faces[side // 2][cells.face(side)] for side in range(2 * d)]),
        portions._replace(box=box[portions.box]),
        cells.rest(force_of(problem, u, stress)),
        unsettled,
    )


class _Cells:
    """Equal cells, on vectors over all places: cells with two more around them.

    A place stands for a cell, its lower faces, edges and corner; `steps` is the distance between
    places along each axis, and `place` the places of the cells of material, in order.
    """

    def __init__(self, problem: ElasticProblem) -> None:
        self.problem = problem
        d = problem.dimension
        self.shape = tuple(n + 2 * PAD + 1 for n in problem.kinds.shape)
        self.steps = np.array([int(np.prod(self.shape[a + 1 :])) for a in range(d)])
        self.kinds = self.laid(problem.kinds, AIR)
        self.law = np.pad(np.stack(problem.moduli), [(0, 0), (0, KINDS)])
        self.place = np.flatnonzero(self.kinds >= 0)
        self.number = np.full(len(self.kinds), -1)
        self.number[self.place] = np.arange(len(self.place))
        self.beside = np.stack([self.place + s * step for step in self.steps for s in (-1, 1)])
        self.kind = self.kinds[self.beside].astype(np.int64)

    def laid(self, values: NDArray[Any], beyond: float = 0) -> NDArray[Any]:
        """Return values of cells, faces or edges, ghosts included, by places."""
        whole = np.full(self.shape, beyond, dtype=values.dtype)
        whole[tuple(slice(PAD, PAD + n) for n in values.shape)] = values
        return whole.ravel()

    def face(self, side: int, some: Ints | slice = slice(None)) -> Ints:
        """Return the places of the faces on a side of cells."""
        return np.asarray(self.place[some] + side % 2 * self.steps[side // 2])

    def uneven(self, loads: Loads) -> Flags:
        """Tell which cells lie round an edge where one of four is air, or bear loads along them."""
        found, kinds = np.zeros(len(self.kinds), dtype=np.bool_), self.kinds
        for a, b in axis_pairs(len(self.steps)):
            one, two = self.steps[[a, b]]
            back = (0, one, two, one + two)
            around = [kinds[one + two - k : len(kinds) - k] for k in back]
            bodies = sum((kind >= 0).view(np.int8) for kind in around)
            air = np.logical_or.reduce([kind == AIR for kind in around])
            edge = one + two + np.flatnonzero((bodies == 3) & air)
            found[edge - np.array(back)[:, None]] = True
        found[self.place[loads.dragged]] = True
        return found[self.place]

    def mesh(self, faces: list[Floats]) -> Mesh:
        """Return the nodes of the cells, and where these begin."""
        ends = corner_ends(len(self.steps))
        at_corners = self.place + (ends @ self.steps)[:, None]
        there = np.zeros(len(self.kinds), dtype=np.bool_)
        there[at_corners] = True
        points = np.flatnonzero(there)
        number = np.cumsum(there) - 1
        octants = [1 << k for k in range(len(ends))]
        nodes, double = split_nodes(list(number[at_corners]), octants, len(points))
        start = np.empty((len(points) + len(double), len(ends[0])))
        stretch = self.law[0][self.kinds]
        stiff = [stretch + np.roll(stretch, step) for step in self.steps]
        start[: len(points)] = _starts(faces, stiff, self.steps)[points]
        if len(double):
            twice = np.zeros(len(start), dtype=np.bool_)
            twice[double] = twice[len(points) :] = True
            for node, end in zip(nodes, ends, strict=True):
                # There each side has the displacement of its own faces.
                here = np.flatnonzero(twice[node])
                for axis, face in enumerate(faces):
                    start[node[here], axis] = face[self.face(2 * axis + end[axis], here)]
        corner, each = np.stack(nodes), np.arange(len(self.place))
        nothing, parts = (
            np.zeros((len(corner) // 2, 0), dtype=np.int64),
            np.broadcast_to(each, corner.shape),
        )
        return Mesh(corner, corner, each, np.ones(len(each)), parts, nothing[0], nothing, start)

    def rest(self, force: FaceFields) -> Floats:
        """Return the residual of the cells' faces; between two cells it is the lower one's."""
        rest = np.zeros(self.kind.shape)
        for side, kind in enumerate(self.kind):
            active = (kind != RIGID) & (kind != ROLLER)
            if side % 2 == 0:
                active &= kind < 0
            left = self.laid(force[side // 2] - self.problem.force[side // 2])
            rest[side, active] = (2 * (side % 2) - 1) * left[self.face(side, active)]
        return rest

    def held(self) -> list[HeldSides]:
        """Return the sides at walls."""
        found, fixed = [], [self.laid(values) for values in self.problem.fixed]
        for side, kinds in enumerate(self.kind):
            for kind in (ROLLER, RIGID):
                at = np.flatnonzero(kinds == kind)
                # Across a wall its own face has the value, along it the ghost beyond.
                place = [self.beside[side, at]] * len(fixed)
                place[side // 2] = self.face(side, at)
                values = [values[there] for values, there in zip(fixed, place, strict=True)]
                if len(at):
                    found.append(HeldSides(side, at, kind, np.stack(values, axis=1)))
        return found

    def beds(self) -> list[Foundation]:
        """Return the sides on foundations."""
        found = []
        for side, kind in enumerate(self.kind):
            stiffness = self.laid(self.problem.spring[side // 2])[self.face(side)]
            on = np.flatnonzero((stiffness > 0) & (kind < AIR))
            if len(on):
                found.append(Foundation(side, on, stiffness[on]))
        return found


def _starts(faces: list[Floats], stiff: list[Floats], steps: Ints) -> Floats:
    """Return how corners move: as the faces round them, stiff ones counting more."""
    start = np.zeros((len(faces[0]), len(faces)))
    for a, normal in enumerate(steps):
        across = [step for step in steps if step != normal]
        # In space along the one axis first, and along the other: so no axis is another's better.
        for order in permutations(across):
            value, weight = faces[a], stiff[a]
            for step in order:
                value, weight = _half_way(value, weight, step)
            start[:, a] += value / len(across)
    return start


def _half_way(value: Floats, weight: Floats, step: int) -> tuple[Floats, Floats]:
    """Return weighted means of what is before and behind places; a line's end is prolonged."""
    v, w = ([np.roll(each, k * step) for k in (2, 1, 0, -1)] for each in (value, weight))
    low, high, both = w[1] > 0.0, w[2] > 0.0, w[1] + w[2]
    after = np.where(w[3] > 0.0, 1.5 * v[2] - 0.5 * v[3], v[2])
    before = np.where(w[0] > 0.0, 1.5 * v[1] - 0.5 * v[0], v[1])
    between = (w[1] * v[1] + w[2] * v[2]) / np.where(both > 0.0, both, 1.0)
    return np.where(low & high, between, np.where(high, after, before)), both
