"""The lattices that kaju brings, lattices by name, and the check of those of your own."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import isabstract
from itertools import chain
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Floats, Ints
from kaju.errors import SceneError

from .lattice import PERIOD, Cells, Lattice, area_of


class BoxLattice(Lattice):
    """Squares or cubes along the axes: everything by formula, in two and three dimensions."""

    boxes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        d, edge = self.dimension, self.cell_size
        normals = np.concatenate([np.outer((-1.0, 1.0), axis) for axis in np.eye(d)])  # -x, +x, -y
        vars(self).update(  # what other lattices find by their outlines when it is asked for
            normals=normals,
            arms=(tuple(range(2 * d)),),
            face_offsets=0.5 * edge * normals[None],
            steps=normals[None].astype(np.int64),
            axes=np.arange(1, 2 * d, 2),
            within=np.full((1, d), 0.5),
            pitch=edge * np.eye(d),
            extent=tuple(edge * count for count in self.shape),
        )

    def outline(self, form: int) -> Floats:
        """Return the corners of a square about its middle (m), counter-clockwise."""
        return self.cell_size * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

    def centres(self, cells: Cells) -> Floats:
        """Return the middle points of cells (m)."""
        return self.cell_size * (cells.astype(np.float64) + 0.5)

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Readable names: "-x", "+x", ..."""
        return tuple(sign + axis for axis in "xyz"[: self.dimension] for sign in "-+")

    def line(self, cells: Cells, axis: int) -> tuple[Ints, Ints]:
        """Return the line along an axis that each cell lies on, and its position there."""
        foot = cells.copy()
        foot[:, axis] = 0
        return self.key(foot), cells[:, axis].copy()

    def coordinates(self, points: Floats) -> Floats:
        """Return points (m) in edges of cells."""
        return points / self.cell_size

    def locate(self, points: Floats) -> Cells:
        """Return the cell that each point (m) lies in; outside the array too."""
        return np.floor(self.coordinates(np.asarray(points, float))).astype(np.int64)

    def face_area(self, thickness: float = 1.0) -> float:
        """Return the area of a cell's face (m²); `thickness` (m) counts in two dimensions."""
        return self.cell_size * (thickness if self.dimension == 2 else self.cell_size)

    def cell_volume(self, thickness: float = 1.0) -> float:
        """Return the volume of a cell (m³); `thickness` (m) counts in two dimensions."""
        return self.cell_size * self.face_area(thickness)

    def split(self, force: Floats) -> Floats:
        """Split forces (N) into their components."""
        loads = np.zeros((len(force), self.directions))
        loads[:, 0::2] = np.maximum(-force, 0.0)
        loads[:, 1::2] = np.maximum(force, 0.0)
        return loads


class Squares(BoxLattice):
    """Squares.

    Examples
    --------
    >>> from kaju import Squares
    >>> squares = Squares((2, 3), 0.01)
    >>> squares.size, squares.dimension
    (6, 2)
    """

    kind: ClassVar[str] = "square"


class Cubes(BoxLattice):
    """Cubes.

    Examples
    --------
    >>> from kaju import Cubes
    >>> cubes = Cubes((2, 3, 4), 0.01)
    >>> cubes.size, cubes.dimension
    (24, 3)
    """

    kind: ClassVar[str] = "cube"
    dimension: ClassVar[int] = 3


class Hexagons(Lattice):
    """Rows of regular hexagons standing on a corner, odd rows half a cell to the right."""

    kind: ClassVar[str] = "hexagon"
    forms: ClassVar[int] = 2  # of the same outline; the neighbours of odd rows count differently

    def form(self, cells: Cells) -> Ints:
        """Tell whether a cell's row is odd."""
        return cells[:, 1] & 1

    def outline(self, form: int) -> Floats:
        """Return the corners of a hexagon about its middle (m)."""
        angle = np.deg2rad(60.0 * np.arange(6) - 30.0)
        corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return corners * (self.cell_size / sqrt(3.0))

    def centres(self, cells: Cells) -> Floats:
        """Return the middle points of cells (m)."""
        x = cells[:, 0] + 0.5 + 0.5 * self.form(cells)
        y = (cells[:, 1] + 2.0 / 3.0) * (sqrt(3.0) / 2.0)
        return self.cell_size * np.stack([x, y], axis=1)


BUILT_IN: dict[str, type[Lattice]] = {each.kind: each for each in (Squares, Hexagons, Cubes)}


def lattice_given(value: object) -> str | type[Lattice]:
    """Return the name of a lattice that kaju brings, or the class of your own, given either."""
    by_kind = {each.kind: each for each in _subclasses(Lattice) if each.kind} | BUILT_IN
    if isinstance(value, str) and value not in by_kind:
        raise SceneError(
            f"there is no lattice {value!r}{suggestion(value, by_kind)}; "
            f"there is {', '.join(BUILT_IN)}; import the class of a lattice of your own before the "
            "scene is read"
        )
    given = by_kind[value] if isinstance(value, str) else value
    if not (isinstance(given, type) and issubclass(given, Lattice)):
        raise SceneError(
            f"must be {', '.join(map(repr, BUILT_IN))} or a subclass of kaju.Lattice, got {given!r}"
        )
    if BUILT_IN.get(given.kind) is given:
        return given.kind
    if isabstract(given):
        missing = ", ".join(sorted(given.__abstractmethods__))
        raise SceneError(f"{given.__name__} needs {missing}; see kaju.Lattice")
    if not given.kind or given.kind in BUILT_IN:
        raise SceneError(f"{given.__name__} needs a kind of its own, got {given.kind!r}")
    return given


def _subclasses(of: Any) -> list[type[Lattice]]:
    return [each for sub in of.__subclasses__() for each in (sub, *_subclasses(sub))]


def check_boxes(lattice: Lattice) -> None:
    """Refuse cells on which elasticity is not worked out."""
    if not lattice.boxes:
        other = "solve it as a SpringNetwork, or " if isinstance(lattice, Hexagons) else ""
        raise SceneError(
            f"body.lattice: {lattice.kind!r} has no staggered grid; {other}take square cells"
        )


def check_lattice(lattice: Lattice) -> None:
    """Refuse a lattice of your own whose answers do not fit together."""
    # Of squares and cubes only `way` is not a formula.
    checks = (_of_ways,) if lattice.boxes else (_of_forms, _of_places, _of_neighbours)
    for holds, answer, rule in chain.from_iterable(check(lattice) for check in checks):
        if not holds:
            raise SceneError(f"body.lattice: {answer} of {type(lattice).__name__}: {rule}")


Conditions = Iterator[tuple[object, str, str]]
"""Whether each holds, the answer that it is about, and what it asks for."""


def _of_ways(lattice: Lattice) -> Conditions:
    for direction in range(lattice.directions):
        ahead, behind, beside = lattice.way(direction, 0)
        rows = [*ahead, *behind, *((arm, weight) for arm, *both in beside for weight in both)]
        sound = all(arm in lattice.arms[0] and 0.0 <= weight <= 1.0 for arm, weight in rows)
        rule = f"along direction {direction} must name faces of the cell with weights from 0 to 1"
        yield sound, "way", rule


def _of_forms(lattice: Lattice) -> Conditions:
    given, wanted = np.asarray(lattice.form(lattice.few)), list(range(lattice.forms))
    yield given.dtype.kind in "iu" and given.shape == (100,), "form", "must be whole numbers, (n,)"
    forms = np.unique(given).tolist()
    yield forms == wanted, "form", f"must give all of {wanted}, gives {forms}"
    outlines = [np.asarray(lattice.outline(form)) for form in wanted]
    shapes = sorted({outline.shape for outline in outlines})
    alike = len(shapes) == 1 and shapes[0][1:] == (2,)
    yield alike, "outline", f"must be of one shape (corners, 2) for each form, is {shapes}"
    areas = [area_of(outline) for outline in outlines]
    edges = [np.linalg.norm(o - np.roll(o, 1, axis=0), axis=1) for o in outlines]
    equal = min(areas) > 0.0 and np.allclose(areas, areas[0]) and np.allclose(edges, edges[0][0])
    rule = "must run counter-clockwise; all cells have one area, and all edges one length"
    yield equal, "outline", rule
    count = len(lattice.normals)
    rule = f"may look along 8 directions at most, looks along {count}"
    yield count <= 8, "outline", rule
    faces = (lattice.faces >= 0).sum(axis=1) == shapes[0][0]
    rule = "must be convex about the cell's middle, and no two faces may look the same way"
    yield faces.all() and np.all(lattice.distances >= 0), "outline", rule
    length = [np.ptp(outline @ lattice.normals.T, axis=0) for outline in outlines]
    rule = f"must be cell_size = {lattice.cell_size:g} m long along every direction"
    yield np.allclose(length, lattice.cell_size), "outline", rule


def _of_places(lattice: Lattice) -> Conditions:
    few, near = lattice.few, 1e-6 * lattice.cell_size
    middles, forms = lattice.centres(few), lattice.form(few)
    yield middles.shape == few.shape, "centres", f"must have the shape {few.shape}"
    repeat = "must repeat after 2 to 10 cells along each coordinate"
    for far in PERIOD * np.eye(2, dtype=np.int64):
        moved = lattice.centres(few + far) - middles
        yield np.ptp(moved, axis=0).max() <= near, "centres", repeat
        yield np.array_equal(lattice.form(few + far), forms), "form", repeat
    onwards = np.diag(lattice.pitch).min() > 0.0
    yield onwards, "centres", "must go right along the first coordinate, up along the second"
    lowest = np.min([middles[n] + lattice.outline(f).min(axis=0) for n, f in enumerate(forms)], 0)
    yield np.all(lowest >= -near), "centres", f"must begin at (0, 0) m, begin at {lowest.tolist()}"


def _of_neighbours(lattice: Lattice) -> Conditions:
    few = lattice.few
    forms, names = lattice.form(few), lattice.direction_names
    near = np.abs(lattice.steps).max() <= 1
    yield near, "centres", "must give neighbours that differ by at most 1 in each coordinate"
    for arm, back in enumerate(lattice.opposite.tolist()):
        here = few[lattice.faces[forms, arm] >= 0]
        there = lattice.neighbours(here, arm)
        ours = lattice.face_middles(here, np.full(len(here), arm))
        theirs = lattice.face_middles(there, np.full(len(here), back))
        meet = np.allclose(ours, theirs, rtol=0.0, atol=1e-6 * lattice.cell_size)
        meet = meet and bool(np.all(lattice.faces[lattice.form(there), back] >= 0))
        rule = f"must leave no gaps: cells do not meet face to face along {names[arm]}"
        yield meet, "centres", rule
    for axis, arm in enumerate(lattice.axes.tolist()):
        line, position = lattice.line(few, axis)
        after = lattice.line(lattice.along(few, axis, np.ones(len(few), dtype=np.int64)), axis)
        aligned = np.array_equal(after[0], line) and np.array_equal(after[1], position + 1)
        yield aligned, "centres", f"must lie in rows along {names[arm]}"
