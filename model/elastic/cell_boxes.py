"""Equal cells as the boxes of which brackets are made.

Only where something happens are cells told one by one: at supports, loads and re-entrant edges, and
where corners that take the mean of the faces round them are far from balance. All others are added
up, and their corners stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene import Scene
from kaju.model.scene.kinds import AIR, RIGID, ROLLER

from .balanced import polynomials
from .boxes import (
    Bed,
    Boxes,
    Hanging,
    Held,
    Loads,
    Mesh,
    Others,
    bodies_at_point,
    corner_ends,
    parted,
    whole_mesh,
)
from .cell_loads import portions_of_cells
from .kernels_bilinear import element_stiffness
from .moduli import Moduli
from .problem import ElasticProblem, FaceFields
from .staggered import Pair, axis_pairs, strains, stresses
from .tractions import Portions
from .volume_field import LOCKING

PAD = 1
"""Cells around the rim; one more after it."""
KINDS = 5
"""Kinds of cells that are no material: they count from the end of a table."""
FEW = {2: 50_000, 3: 5_000}
"""So few cells are told one by one."""
KINDS_SUMMED = 1_000
"""Cells of more kinds are told one by one, too."""
AT_ONCE = 10_000
"""So many are added up at a time."""
ROUND_EDGES, ROUND_CORNERS = 2, 1
"""Cells round re-entrant edges, and round corners that are to sink, that are told as well."""
UNBALANCED = 0.1
"""Share of the gap that corners may keep which could sink."""


def boxes_of_cells(
    problem: ElasticProblem,
    u: FaceFields,
    unsettled: float,
    grid: Scene,
    stage: int | None,
    gap: float = 0.0,
) -> Boxes:
    """Return equal cells with the stresses of a solution; no loads act along surfaces."""
    # `unsettled` is the relative error in the energy norm that the iteration has left, `grid` the
    # scene on the problem's cells, `gap` about what lies between the two energies (0: all cells are
    # told).
    cells = Cells(problem, u, unsettled, grid, stage)
    return cells.told(gap) if gap > 0.0 else cells.boxes(cells.body)


class Cells:
    """Equal cells, on vectors over all places: cells with two more around them.

    A place stands for a cell, its lower faces, edges and corner; `steps` is the distance between
    places along each axis.
    """

    def __init__(
        self,
        problem: ElasticProblem,
        u: FaceFields,
        unsettled: float,
        grid: Scene,
        stage: int | None,
    ) -> None:
        self.problem, self.u, self.unsettled = problem, u, unsettled
        d = self.dimension = problem.dimension
        self.shape = tuple(n + 2 * PAD + 1 for n in problem.kinds.shape)
        self.steps = np.array([int(np.prod(self.shape[a + 1 :])) for a in range(d)])
        kinds = np.full(self.shape, AIR, dtype=np.int32)
        self._inside(kinds, problem.kinds)[...] = problem.kinds
        self.kinds = kinds.ravel()
        self.law = np.pad(np.stack(problem.moduli), [(0, 0), (0, KINDS)])
        self.faces = np.zeros((d, len(self.kinds)))
        for whole, values in zip(self.faces, u, strict=True):
            self._inside(whole.reshape(self.shape), values)[...] = values
        self.ahead = corner_ends(d) @ self.steps
        self.body = np.flatnonzero(self.kinds >= 0)
        self._loads, self._within, self._uneven_loads = self._applied(grid, stage)
        self.near = self._where_something_happens()
        self.shear = np.zeros((len(axis_pairs(d)), len(self.kinds)))
        self.sigma, self.start = np.zeros_like(self.faces), np.zeros_like(self.faces)
        normal, shear = stresses(problem, strains(u))
        wholes = (*self.sigma, *self.shear)
        for whole, values in zip(wholes, (*normal, *shear.values()), strict=True):
            self._inside(whole.reshape(self.shape), values)[...] = values
        for corner in _parts(np.flatnonzero(self._corners_of(self.kinds >= 0))):
            self._start_at(corner)

    def _inside(self, whole: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        return whole[tuple(slice(PAD, PAD + n) for n in values.shape)]

    def _applied(self, grid: Scene, stage: int | None) -> tuple[Loads, Loads, Portions]:
        """Return the forces by sides of cells, those within cells, and which lie unevenly."""
        applied = grid.applied(stage)
        lower = np.asarray(grid.bounds()[0], dtype=np.int64)
        place = (applied.cells - lower + 1 + PAD) @ self.steps
        force = applied.force / self.problem.scales.force
        within = applied.direction < 0
        by_side, inside = (
            Loads(place[some], applied.direction[some], force[some]) for some in (~within, within)
        )
        uneven = portions_of_cells(applied, self.problem.scales.force)
        return by_side, inside, uneven._replace(box=place[uneven.box])

    def told(self, gap: float) -> Boxes:
        """Return the cells where something happens, and the sums of all others."""
        moduli, kinds = self.problem.moduli, self.kinds
        used = np.bincount(kinds[self.body], minlength=len(moduli.shear)) > 0
        locks = self.dimension == 2 and np.any((moduli.lateral > LOCKING * moduli.stretch) & used)
        many = len(moduli.shear) > KINDS_SUMMED
        if len(self.body) <= FEW[self.dimension] or locks or many:
            return self.boxes(self.body)
        body, near = kinds >= 0, self.near
        plain = body & ~near
        left, column = np.zeros_like(self.start), np.zeros(len(kinds))
        sums = self.sums(plain, left, column)
        square = np.einsum("an,an->n", left, left)
        sinks = square > (2.0 * UNBALANCED * gap / len(self.body)) * column
        sinks &= ~self._corners_of(near)
        more = self._grown(self._cells_at(np.flatnonzero(sinks)), ROUND_CORNERS) & plain
        sums -= self.sums(more, left)
        return self.boxes(np.flatnonzero(near | more), sums)

    def sums(self, chosen: Flags, left: Floats, column: Floats | None = None) -> Floats:
        """Add up the energies of cells without loads or walls at their faces."""
        # These are the complementary energy, that of the corners' displacement, and its work on
        # what the faces are left with; a face belongs to the cell below, if there is one. The
        # forces at the corners are taken off `left`, their own stiffness is added to `column`.
        forms = _forms(self.dimension, *(tuple(modulus.tolist()) for modulus in self.law))
        total, places = np.zeros(3), np.flatnonzero(chosen)
        for first in range(int(places[0]), int(places[-1]) + 1, AT_ONCE) if len(places) else ():
            row = slice(first, min(first + AT_ONCE, int(places[-1]) + 1))
            for kind in np.unique(self.kinds[row][chosen[row]]):
                own = chosen[row] & (self.kinds[row] == kind)
                data = own * np.stack([*self.sigma[:, row], *self._edge_shears(row)])
                total[0] += 0.5 * float(np.vdot(data, forms[0][kind] @ data))
                corners = [_past(row, step) for step in self.ahead]
                moved = own * np.stack([self.start[:, at] for at in corners])
                force = forms[1][kind] @ moved.reshape(-1, len(own))
                total[1] += 0.5 * float(np.vdot(moved, force))
                total[2] -= self._work_of_rest(row, moved)
                for at, held in zip(corners, force.reshape(moved.shape), strict=True):
                    left[:, at] -= held
                    if column is not None:
                        column[at] += forms[1][kind][0, 0] * own
        return total

    def _edge_shears(self, row: slice) -> list[Floats]:
        """Return the shear stresses of cells' edges, pair by pair."""
        found = []
        for tau, (a, b) in zip(self.shear, axis_pairs(self.dimension), strict=True):
            ends = product((0, self.steps[a]), (0, self.steps[b]))
            found += [tau[_past(row, one + two)] for one, two in ends]
        return found

    def _work_of_rest(self, row: slice, moved: Floats) -> float:
        """Return the work of cells' corners, shape (corners, d, n), on what faces are left with."""
        work, ends = 0.0, corner_ends(self.dimension)
        for axis, upper in product(range(self.dimension), (0, 1)):
            step = self.steps[axis]
            mean = moved[ends[:, axis] == upper, axis].mean(axis=0)
            if not upper:
                mean *= self.kinds[_past(row, -step)] < 0
            work += float(np.vdot(self._pull(axis, _past(row, upper * step)), mean))
        return work

    def _pull(self, axis: int, face: Ints | slice) -> Floats:
        """Return the forces by which stresses hold faces."""
        force = self.sigma[axis, _past(face, -self.steps[axis])] - self.sigma[axis, face]
        for tau, pair in zip(self.shear, axis_pairs(self.dimension), strict=True):
            if axis in pair:
                force += tau[face] - tau[_past(face, self.steps[sum(pair) - axis])]
        return np.asarray(force)

    def _start_at(self, corner: Ints) -> None:
        """Let corners move as the faces round them, stiff ones counting more."""
        for a, normal in enumerate(self.steps):
            first, *others = (step for step in self.steps if step != normal)

            def line(place: Ints, a: int = a, n: int = normal, step: int = first) -> _Line:
                at = place + step * np.arange(-2, 2)[:, None]
                stiff = self.law[0][self.kinds[at]] + self.law[0][self.kinds[at - n]]
                return self.faces[a, at], stiff

            if others:
                lines = [line(corner + k * others[0]) for k in range(-2, 2)]
                weights = [w[1] + w[2] for _, w in lines]
                self.start[a, corner] = _half_way([_half_way(*row) for row in lines], weights)
            else:
                self.start[a, corner] = _half_way(*line(corner))

    def _where_something_happens(self) -> Flags:
        """Tell which cells are at a support, a load, a re-entrant edge or touch a body's corner."""
        body = self.kinds >= 0
        filled = np.zeros(len(body), dtype=np.uint8)
        for k, step in enumerate(self.ahead):
            filled[step:] |= body[: len(body) - step].view(np.uint8) << k
        rim = np.flatnonzero((filled > 0) & (filled < (1 << len(self.ahead)) - 1))
        reentrant, parts = (table[filled[rim]] for table in _odd_corners(self.dimension))
        wall = (self.kinds[rim - self.ahead[:, None]] < AIR).any(axis=0)
        cells = self._loads.box, self._within.box
        self._at_edges = self._cells_at(rim[reentrant])
        found = self._cells_at(rim[wall | parts]) | self._grown(self._at_edges, ROUND_EDGES)
        return body & (found | self._grown(self._marked(np.concatenate(cells)), 1))

    def _marked(self, places: Ints) -> Flags:
        found = np.zeros(len(self.kinds), dtype=np.bool_)
        found[places] = True
        return found

    def _cells_at(self, corners: Ints) -> Flags:
        return self._marked(corners - self.ahead[:, None])

    def _corners_of(self, cells: Flags) -> Flags:
        found = cells.copy()
        for step in self.ahead[1:]:
            found[step:] |= cells[:-step]
        return found

    def _grown(self, cells: Flags, rings: int) -> Flags:
        found = cells.copy()
        for step in self.steps if cells.any() else ():
            for _ in range(rings):
                before = found.copy()
                found[step:] |= before[:-step]
                found[:-step] |= before[step:]
        return found

    def boxes(self, told: Ints, sums: Floats | None = None) -> Boxes:
        """Return cells, in order, as boxes."""
        d, n, kinds, problem = self.dimension, len(told), self.kinds, self.problem
        cells = np.stack(np.unravel_index(told, self.shape), axis=1) - PAD
        number = np.full(len(kinds), -1)
        number[told] = np.arange(n)
        sides = told + np.stack([s * step for step in self.steps for s in (-1, 1)])[:, None]
        beyond = kinds[sides].astype(np.int64)
        body = np.zeros((d, n))
        np.add.at(body.T, number[self._within.box], self._within.force)
        nothing = np.zeros(0, dtype=np.int64)
        mesh, known = self._mesh(told, cells, number)
        others = None
        if sums is not None:
            complementary, whole, rest = sums.tolist()
            others = Others(complementary, whole, rest, partial(self._tell, known))
        return Boxes(
            np.ones(n),
            Moduli(*self.law[:, kinds[told]]),
            self.sigma[:, told],
            {
                pair: np.stack([tau[at] for at in self._edges(told, pair)]).reshape(2, 2, n)
                for pair, tau in zip(axis_pairs(d), self.shear, strict=True)
            },
            body,
            number[sides],
            beyond,
            self._uneven(told),
            Hanging(nothing, nothing, nothing.reshape(0, 1 << (d - 1))),
            self._loads._replace(box=number[self._loads.box]),
            list(_held_cells(problem, cells, beyond)),
            list(_beds_of_cells(problem, cells, beyond)),
            mesh,
            np.stack([self.faces[s // 2, told + s % 2 * self.steps[s // 2]] for s in range(2 * d)]),
            self._uneven_loads._replace(box=number[self._uneven_loads.box]),
            self._rest(told, cells, beyond),
            self.unsettled,
            others,
        )

    def _tell(self, known: Ints, moved: Floats, scale: float) -> Boxes:
        """Return all cells; see `Others`."""
        boxes = self.boxes(self.body)
        every = self._corners(self.body)[1]
        start = scale * boxes.mesh.start
        start[np.searchsorted(every, known)] = moved[: len(known)]
        start[len(every) :] = moved[len(known) :]
        return replace(boxes, mesh=boxes.mesh._replace(start=start))

    def _edges(self, place: Ints, pair: Pair) -> list[Ints]:
        a, b = self.steps[list(pair)]
        return [place, place + b, place + a, place + a + b]

    def _uneven(self, told: Ints) -> Flags:
        """Tell which cells lie round an edge where one of four is air, the others are body."""
        found = np.zeros(len(told), dtype=np.bool_)
        some = np.flatnonzero(self._at_edges[told])
        for pair in axis_pairs(self.dimension):
            a, b = self.steps[list(pair)]
            for edge in self._edges(told[some], pair):
                around = self.kinds[np.stack([edge, edge - a, edge - b, edge - a - b])]
                here = ((around >= 0).sum(axis=0) == 3) & (around == AIR).any(axis=0)
                found[some[here]] = True
        return found

    def _corners(self, told: Ints) -> tuple[Ints, Ints]:
        """Return the numbers of the nodes at cells' corners, and their places."""
        corner = told + self.ahead[:, None]
        known = np.flatnonzero(self._marked(corner))
        number = np.empty(len(self.kinds), dtype=np.int64)
        number[known] = np.arange(len(known))
        return number[corner], known

    def _mesh(self, told: Ints, cells: Ints, number: Ints) -> tuple[Mesh, Ints]:
        """Return the nodes of cells, and the places of all but those that are there twice."""
        corner, known = self._corners(told)
        body = self.kinds[known - self.ahead[:, None]] >= 0
        filled = (body << np.arange(len(body))[:, None]).sum(axis=0)
        still = np.flatnonzero((body & (number[known - self.ahead[:, None]] < 0)).any(axis=0))
        nodes, double = parted(list(corner), [1 << k for k in range(len(corner))], filled)
        corner, start = np.stack(nodes), self.start[:, known].T.copy()
        if len(double):
            twice = np.zeros(len(known) + len(double), dtype=np.bool_)
            twice[double] = twice[len(known) :] = True
            start = np.concatenate([start, start[double]])
            for node, end in zip(corner, corner_ends(self.dimension), strict=True):
                # There each side has the displacement of its own faces.
                here = np.flatnonzero(twice[node])
                for axis, step in enumerate(self.steps):
                    start[node[here], axis] = self.faces[axis, told[here] + end[axis] * step]
        return whole_mesh(corner, np.ones(len(told)), start)._replace(still=still), known

    def _rest(self, told: Ints, cells: Ints, beyond: Ints) -> Floats:
        """Return what the cells' faces are left with, told by the cell below if there is one."""
        rest = np.zeros(beyond.shape)
        for side, kind in enumerate(beyond):
            axis, upper = divmod(side, 2)
            active = (kind != RIGID) & (kind != ROLLER)
            if not upper:
                active &= kind < 0
            some = np.flatnonzero(active)
            face = told[some] + upper * self.steps[axis]
            force = self._pull(axis, face)
            at = list(cells[some].T)
            at[axis] = at[axis] + upper
            place = tuple(at)
            force += self.problem.spring[axis][place] * self.u[axis][place]
            rest[side, some] = (2 * upper - 1) * (force - self.problem.force[axis][place])
        return rest


def _past(place: Ints | slice, step: int) -> Ints | slice:
    """Return places some steps further on: one by one, or in a row."""
    if isinstance(place, slice):
        return slice(place.start + step, place.stop + step)
    return place + step


def _parts(places: Ints) -> list[Ints]:
    """Return places in parts of `AT_ONCE` or less."""
    return np.array_split(places, len(places) // AT_ONCE + 1)


_Line = tuple[Sequence[Floats] | Floats, Sequence[Floats] | Floats]


def _half_way(v: Sequence[Floats] | Floats, w: Sequence[Floats] | Floats) -> Floats:
    """Return the weighted mean half-way between four in a row; a line's end is prolonged."""
    low, high = w[1] > 0.0, w[2] > 0.0
    weight = np.where(low & high, w[1] + w[2], 1.0)
    after = np.where(w[3] > 0.0, 1.5 * v[2] - 0.5 * v[3], v[2])
    before = np.where(w[0] > 0.0, 1.5 * v[1] - 0.5 * v[0], v[1])
    ends = np.where(high, after, before)
    return np.where(low & high, (w[1] * v[1] + w[2] * v[2]) / weight, ends)


@lru_cache(maxsize=2)
def _odd_corners(dimension: int) -> tuple[Flags, Flags]:
    """Tell at which octants (bits) a point lies on a re-entrant edge, or parts bodies."""
    ends = corner_ends(dimension)
    bodies = bodies_at_point(dimension)
    there = (np.arange(len(bodies))[:, None] >> np.arange(len(ends)) & 1).astype(np.bool_)
    edge = np.zeros(len(bodies), dtype=np.bool_)
    for pair in axis_pairs(dimension):
        others = [a for a in range(dimension) if a not in pair]
        for end in product((0, 1), repeat=len(others)):
            edge |= there[:, (ends[:, others] == end).all(axis=1)].sum(axis=1) == 3
    return edge, np.asarray(bodies.any(axis=1))


@lru_cache(maxsize=8)
def _forms(dimension: int, *law: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Return the energies of cells of all materials as matrices."""
    # The complementary one, half of data·A·data, by a cell's normal stresses and the shear stresses
    # of its edges, pair by pair; and that of the displacement of its corners.
    pairs = axis_pairs(dimension)
    size = dimension + 4 * len(pairs)
    first, second = np.repeat(np.eye(size), size, axis=0).T, np.tile(np.eye(size), (size, 1)).T

    def energy(data: Floats, one: Moduli) -> Floats:
        shear = data[dimension:].reshape(len(pairs), 2, 2, -1)
        within = np.zeros((dimension, data.shape[1]))
        field = polynomials(data[:dimension], dict(zip(pairs, shear, strict=True)), within)
        return field.energy(one)

    statics, stiffness, forms = [], [], element_stiffness(dimension)
    for one in zip(*law, strict=True):
        own = Moduli(*(np.array([modulus]) for modulus in one))
        if one[0] > 0.0:
            both = energy(first + second, own) - energy(first, own) - energy(second, own)
            statics.append(both.reshape(size, size))
            stiffness.append(sum(modulus * form for modulus, form in zip(one, forms, strict=True)))
    return np.stack(statics), np.stack(stiffness)


def _held_cells(problem: ElasticProblem, cells: Ints, beyond: Ints) -> list[Held]:
    found = []
    for side, kinds in enumerate(beyond):
        axis, upper = divmod(side, 2)
        for kind in (ROLLER, RIGID):
            at = np.flatnonzero(kinds == kind)
            value = np.zeros((len(at), problem.dimension))
            for component, fixed in enumerate(problem.fixed):
                place = cells[at].copy()
                place[:, axis] += upper if component == axis else 2 * upper - 1
                value[:, component] = fixed[tuple(place.T)]
            if len(at):
                found.append(Held(side, at, kind, value))
    return found


def _beds_of_cells(problem: ElasticProblem, cells: Ints, beyond: Ints) -> list[Bed]:
    found = []
    for side, kinds in enumerate(beyond):
        axis, upper = divmod(side, 2)
        on = np.flatnonzero(kinds < AIR)
        place = cells[on]
        place[:, axis] += upper
        stiffness = problem.spring[axis][tuple(place.T)]
        on = on[stiffness > 0]
        if len(on):
            found.append(Bed(side, on, stiffness[stiffness > 0]))
    return found
