"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes.

A force normal to a face acts on that face, one in a cell's middle in halves on the two faces across
it. A force *along* a free surface is a shear stress on the surface. The face that it drags lies
half a cell below, so that it reaches the surface as a couple: u(surface) = u(below) + (h/2)(γ -
∂u_n/∂s) with γ given. Couples load the gradients of the displacement at edges. These are exact for
rotations of the whole body, so that no moment is lost.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints, moved
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model.elastic.moduli import constants_of, moduli_of
from kaju.model.elastic.scales import Scales
from kaju.model.elastic.uneven_loads import portions
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER
from kaju.model.scene.description import SideCondition
from kaju.model.scene.lattice import check_boxes
from kaju.model.scene.selection import AppliedLoads

from .problem import ACTIVE, ElasticProblem, FaceFields, face_zeros, rim_layer
from .supports import LOOSE, check_supports, slender_cell

Origin = tuple[int, ...]


def problem_of_scene(
    scene: Scene,
    stage: int | None = None,
    stiffness: Floats | None = None,
    loads: AppliedLoads | None = None,
) -> tuple[ElasticProblem, Origin]:
    """Return the problem that a scene poses, cut to the box around its body.

    With it comes the scene's cell that is the problem's first. `stiffness` is what the materials'
    moduli are multiplied by, cell by cell: every cell of material is a kind of its own then,
    numbered row by row. `loads` stand for those of the scene.
    """
    lattice = scene.lattice
    check_boxes(lattice)
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    # All cells with what lies beyond the sides.
    rim = np.pad(scene.rasterise().astype(np.int32), 1, constant_values=AIR)
    for index, name in enumerate(lattice.sides):
        code = scene.side_condition(name).code
        rim[rim_layer(lattice.dimension, index)] = RIGID if code == DISPLACED else code
    box = tuple(slice(int(a), int(b) + 2) for a, b in zip(lower, upper, strict=True))
    constants = constants_of(scene)
    kinds = np.ascontiguousarray(rim[box])
    body = kinds >= 0
    if not body.any():
        raise SceneError("body: no cell is of a material, so there is nothing to solve")
    if stiffness is not None:
        constants = constants[kinds[body]]
        constants[:, 0] *= np.pad(stiffness, 1)[box][body]
        kinds[body] = np.arange(len(constants))
    used = constants if len(constants) == 1 else constants[np.unique(kinds[body])]
    loads = (scene.applied(stage) if loads is None else loads).within(lower, upper)
    try:
        modulus, sides = float(used[:, 0].max()), sides_of(scene, lower, upper).values()
        scales = Scales.of_cells(scene, modulus, loads.force, sides)
        problem = problem_of(scene, kinds, constants, (lower, upper), loads, scales)
    except ParameterError as error:
        names = ", ".join(material.name for material in scene.cell_materials)
        raise ParameterError(f"materials ({names}): {error}") from error
    return problem, tuple(int(i) for i in lower)


def sides_of(scene: Scene, lower: Ints, upper: Ints) -> dict[int, SideCondition]:
    """Return the conditions of the sides that a box of cells reaches, by their number."""
    found = {}
    for index, name in enumerate(scene.lattice.sides):
        axis, high = divmod(index, 2)
        if upper[axis] == scene.lattice.shape[axis] if high else lower[axis] == 0:
            found[index] = scene.side_condition(name)
    return found


def problem_of(
    scene: Scene,
    rim: NDArray[np.int32],
    constants: Floats,
    box: tuple[Ints, Ints],
    loads: AppliedLoads,
    scales: Scales,
) -> ElasticProblem:
    """Return the problem of a box of a scene's cells."""
    # `rim` is what the cells are, by the row of `constants` (Young's modulus in Pa, Poisson's
    # ratio) or AIR, RIGID, with one layer more that says what lies beyond.
    d, shifts = rim.ndim, np.zeros((rim.ndim, 2, rim.ndim))
    for index, side in sides_of(scene, *scene.bounds()).items():
        shifts[divmod(index, 2)] = np.array(side.displacement or [0.0] * d) / scales.displacement
    fixed, spring = _side_fields(rim, sides_of(scene, *box), scales)
    problem = ElasticProblem(
        kinds=rim,
        moduli=moduli_of(constants[:, 0] / scales.modulus, constants[:, 1], scene.plane),
        force=face_zeros(rim),
        fixed=fixed,
        spring=spring,
        surface_shear={},
        moved=shifts,
        scales=scales,
        plane=scene.plane,
        thickness=scene.thickness if rim.ndim == 2 else 1.0,
    )
    if len(loads.force):
        face_forces(problem, loads)
    return problem


def _side_fields(
    rim: NDArray[np.int32], sides: dict[int, SideCondition], scales: Scales
) -> tuple[FaceFields, FaceFields]:
    """Return the given displacements and the foundation's stiffness of all faces, scaled."""
    fixed, spring = face_zeros(rim), face_zeros(rim)
    for index, side in sides.items():
        axis, (own, beyond) = index // 2, (-2, -1) if index % 2 else (1, 0)
        if side.stiffness is not None:
            layer = list(rim_layer(rim.ndim, index))
            layer[axis] = own
            spring[axis][tuple(layer)] = side.stiffness * scales.length / scales.modulus
        # Its faces, and the ghosts within it; rigid cells inside the array stay where they are.
        for component, shift in enumerate(np.array(side.displacement or ()) / scales.displacement):
            lines = np.moveaxis(fixed[component], axis, 0)
            if component == axis:
                lines[own][np.moveaxis(rim, axis, 0)[own] != RIGID] = shift
            else:
                lines[beyond] = shift
    return fixed, spring


class Grid(NamedTuple):
    """A scene on the cells on which it is solved."""

    scene: Scene  # The scene, refined
    problem: ElasticProblem  # Its arrays
    origin: Origin  # Cell of the scene at which the arrays start
    division: int  # Cells per cell of the scene that was asked about, along every axis
    notes: tuple[str, ...] = ()  # What was changed by itself, in words

    def narrow(self, share: float = 0.0) -> str:
        """Return where a member is one cell wide, "" if none is; see `slender_cell`."""
        if (cell := slender_cell(self.problem, share)) is None:
            return ""
        return f"({', '.join(str(a + b) for a, b in zip(cell, self.origin, strict=True))})"


def grid_of(
    scene: Scene,
    stage: int | None,
    division: int = 1,
    known: ElasticProblem | None = None,
    stiffness: Floats | None = None,
    slides: bool = False,
) -> Grid:
    """Return the grid of a scene, with a relative stiffness of each of its cells if given.

    Its cells are halved where a member, or what holds the body against turning, is one cell wide:
    neither resists on this grid. A body that is supported like the `known` one needs no check.
    For `slides` see `check_supports`.
    """

    def refined(times: int) -> Grid:
        fine = scene if times == 1 else scene.refine(times)
        return Grid(fine, *problem_of_scene(fine, stage, repeated(stiffness, times)), times)

    grid = refined(division)
    if known is not None and known.edges is None:
        one, other = ((np.minimum(p.kinds, 0), *p.spring) for p in (grid.problem, known))
        if all(map(np.array_equal, one, other)):
            return grid
    thin = grid.narrow(LOOSE)
    narrow, loose = thin and grid.narrow(), None
    if not narrow:
        told = f"a member is one cell wide at {thin} beside what is far softer, and yields too much"
        notes = (f"{told}: take a tolerance, or resolution={2 * division}",) if thin else ()
        try:
            problem = check_supports(grid.problem, grid.origin, division, slides)
            return grid._replace(problem=problem, notes=notes)
        except SupportError as error:
            if "could turn" not in str(error):
                raise
            loose = error
    finer = refined(2 * division)
    if narrow and (where := finer.narrow()):
        raise SceneError(
            f"body: a member is one cell wide at cell {where} of the grid refined by "
            f"{2 * division} and carries no shear; widen it, or give a larger resolution"
        )
    try:
        problem = check_supports(finer.problem, finer.origin, 2 * division, slides)
    except SupportError as error:
        raise loose or error from None
    reason = f"a member is one cell wide at {narrow}"
    if loose is not None:
        reason = "a single rigid cell holds no turn"
    return finer._replace(problem=problem, notes=(f"{reason}: the cells were halved",))


def repeated(stiffness: Floats | None, division: int) -> Floats | None:
    """Return a field of stiffness on cells so many times smaller."""
    if stiffness is not None:
        for axis in range(stiffness.ndim):
            stiffness = np.repeat(stiffness, division, axis)
    return stiffness


def face_forces(problem: ElasticProblem, loads: AppliedLoads) -> None:
    """Add forces to the problem's faces, and the moments of those that lie unevenly on theirs."""
    cells, direction, force = loads.cells + 1, loads.direction, loads.force / problem.scales.force
    d = problem.dimension
    for axis, upper in product(range(d), (0, 1)):
        for some, share in ((direction < 0, 0.5), (direction == 2 * axis + upper, 1.0)):
            _push(problem, axis, upper, cells[some], share * force[some, axis])
    for side in range(2 * d):
        for axis in (a for a in range(d) if a != side // 2):
            here = (direction == side) & (force[:, axis] != 0.0)
            if here.any():
                _drag(problem, axis, side, cells[here], force[here, axis])
    if loads.uneven is None:
        return
    row, part, growth = loads.uneven
    lower, size = np.zeros((len(row), d)), np.ones(len(row))
    growth = growth / problem.scales.force
    moment = portions(direction[row], force[row], part, growth, lower, size)[1]
    for side in np.unique(direction[row]).tolist():
        here = direction[row] == side
        _turn(problem, side, cells[row[here]], moment[here])


class _Couples(NamedTuple):
    """Couples on cells, about their middles: of forces along `axis` on a side."""

    problem: ElasticProblem
    axis: int
    normal: int  # Of the side
    upper: int  # Whether it is the upper one of the two
    cells: Ints  # In arrays with ghosts, shape (n, d)
    moment: Floats  # Positive from `normal` to `axis`; shape (n,)

    def only(self, some: Flags) -> _Couples:
        """Return some of them."""
        return self._replace(cells=self.cells[some], moment=self.moment[some])

    def edges(self, opposite: bool = False) -> list[Ints]:
        """Return the edges of the side, or of the opposite one, at both ends along the axis."""
        # An edge has the index of the cell behind it along both axes.
        side = moved(self.cells, self.normal, self.upper ^ opposite)
        return [moved(side, self.axis, end) for end in (0, 1)]

    def beyond(self, axis: int, upper: int) -> Ints:
        """Return the kinds of the neighbours along an axis."""
        return np.asarray(self.problem.kinds[tuple(moved(self.cells, axis, 2 * upper - 1).T)])

    def load_slope(self, component: int, edge: Ints, weight: Floats) -> None:
        """Load the slope that a displacement, along the axis or the normal, has along the other."""
        force, (faces, body) = self.problem.force[component], self._faces(component, edge)
        for face, there, sign in zip(faces, body, (-1.0, 1.0), strict=True):
            np.add.at(force, tuple(face.T), np.where(there, sign * weight, 0.0))

    def _faces(self, component: int, edge: Ints) -> tuple[list[Ints], list[Flags]]:
        """Return a component's faces before and behind edges, and which are of the body."""
        along = self.axis + self.normal - component
        kinds, faces = self.problem.kinds, [moved(edge, along, -1), edge]
        body = [
            (kinds[tuple(face.T)] >= 0) | (kinds[tuple(moved(face, component, -1).T)] >= 0)
            for face in faces
        ]
        return faces, body

    def free(self, component: int, edge: Ints) -> Flags:
        """Tell at which edges a component has faces before and behind that are free to move."""
        states = self.problem.face_states[component]
        faces, (before, behind) = self._faces(component, edge)
        moves = [states[tuple(face.T)] == ACTIVE for face in faces]
        return np.asarray(before & behind & moves[0] & moves[1])

    def lift(self, edge: Ints, weight: Floats) -> None:
        """Load the slope along the normal at edges of the opposite side, also against a wall."""
        self.load_slope(self.axis, edge, weight)
        before, behind = self._faces(self.axis, edge)[1]
        held = self.beyond(self.normal, 1 - self.upper) == RIGID
        pull = np.where(held, (1.0 * behind - before) * weight, 0.0)
        _bear(self, self.normal, 1 - self.upper, self.axis, -pull)

    def make_up(self) -> Floats:
        """Enter couples at the opposite side; return those that do not fit."""
        edges = self.edges(opposite=True)
        turns = np.stack([self.free(self.axis, e) & self.free(self.normal, e) for e in edges])
        kind = self.beyond(self.normal, 1 - self.upper)
        lifts = ~turns.any(axis=0) & ((kind == RIGID) | (kind >= 0))
        for edge, turn in zip(edges, turns, strict=True):
            share = turn / np.maximum(2 * turns.sum(axis=0), 1) * self.moment
            self.load_slope(self.axis, edge, share)
            self.load_slope(self.normal, edge, -share)
            self.lift(edge, np.where(lifts, 0.5 * self.moment, 0.0))
        return np.where(lifts | turns.any(axis=0), 0.0, self.moment)

    def tilt_surface(self, running: list[Flags], lost: Floats) -> None:
        """Load the surface where it runs on; enter what is lost where it ends, or else load it."""
        ended = lost != 0.0
        rest = np.zeros_like(lost)
        rest[ended] = self.only(ended)._replace(moment=lost[ended]).make_up()
        for edge, runs_on in zip(self.edges(), running, strict=True):
            load = np.where(runs_on, -0.5 * self.moment - rest, 0.0)
            self.load_slope(self.normal, edge, load)


def _push(problem: ElasticProblem, axis: int, upper: int, cells: Ints, value: Floats) -> None:
    """Add forces to faces normal to an axis, at one end of cells."""
    np.add.at(problem.force[axis], tuple(moved(cells, axis, upper).T), value)


def _bear(couples: _Couples, axis: int, upper: int, component: int, value: Floats) -> None:
    """Add forces on the walls beyond cells along an axis, in halves on the ghosts' faces."""
    ghost = moved(couples.cells, axis, 2 * upper - 1)
    for end in (0, 1):
        _push(couples.problem, component, end, ghost, 0.5 * value)


def _drag(problem: ElasticProblem, axis: int, side: int, cells: Ints, value: Floats) -> None:
    """Add forces along an axis on a side of cells, normal to another axis."""
    # The loaded faces lie half a cell below the side, so a couple comes with the force.
    normal, upper = divmod(side, 2)
    couples = _Couples(problem, axis, normal, upper, cells, (upper - 0.5) * value)
    kind = couples.beyond(normal, upper)
    held, inside = kind == RIGID, kind >= 0
    for end in (0, 1):
        _push(problem, axis, end, cells, np.where(held, 0.0, 0.5) * value)
    _bear(couples, normal, upper, axis, np.where(held, value, 0.0))
    for edge in couples.edges():
        couples.load_slope(axis, edge, np.where(inside, 0.5 * couples.moment, 0.0))
    # Frictionless supports take no shear, like a free surface: the body carries all of it.
    _drag_surface(couples.only(np.isin(kind, (AIR, ROLLER, FOUNDATION))))


def _drag_surface(couples: _Couples) -> None:
    """Add the traction of a free surface, and the load -moment·∂u_n/∂s along it."""
    problem, axis, normal, upper, cells, moment = couples
    if not len(cells):
        return
    pair = min(axis, normal), max(axis, normal)
    edges = [n + (a in pair) for a, n in enumerate(problem.kinds.shape)]
    shear = problem.surface_shear.setdefault(pair, np.zeros(edges))
    lost, running = np.zeros_like(moment), []
    far = couples.edges(opposite=True)
    for end, edge in enumerate(couples.edges()):
        np.add.at(shear, tuple(edge.T), moment)
        runs_on = couples.free(normal, edge)
        walled = ~runs_on & (couples.beyond(axis, end) == RIGID)
        pull = np.where(walled, (2 * end - 1) * moment, 0.0)
        _push(problem, normal, upper, cells, pull)
        _bear(couples, axis, end, normal, -pull)
        lost += np.where(runs_on | walled, 0.0, 0.5 * moment)
        running.append(runs_on)
        # The force on the wall acts half a cell from it: one more couple.
        held, inner = couples.only(walled), far[end][walled]
        before, behind = held._faces(axis, inner)[1]
        there = (before & behind) | (held.beyond(normal, 1 - upper) == RIGID)
        held.lift(inner, np.where(there, -0.5 * held.moment, 0.0))
    couples.tilt_surface(running, lost)


def _turn(problem: ElasticProblem, side: int, cells: Ints, moment: Floats) -> None:
    """Add the first moments, shape (n, d, d), of forces on a side of cells."""
    normal, upper = divmod(side, 2)
    axes = [axis for axis in range(problem.dimension) if axis != normal]
    for axis in axes:
        couples = _Couples(problem, axis, normal, upper, cells, -moment[:, normal, axis])
        free = [couples.free(normal, edge) for edge in couples.edges()]
        couples.tilt_surface(free, (2 - np.sum(free, axis=0)) * 0.5 * couples.moment)
    for first, second in combinations(axes, 2):
        twist = 0.5 * (moment[:, first, second] - moment[:, second, first])
        for end in (0, 1):
            _Couples(problem, first, second, end, cells, twist).make_up()
