"""Lattices: where cells are, and all that follows from their form.

A lattice of your own says which *form* a cell has (squares have one, triangles stand on a side or
on a corner), the outline of each form, and where the middles of the cells are. The rest follows;
squares and cubes say it themselves, by formula.

A *direction* is the index of a face normal; the neighbour over that face is reached over the *arm*
of the same number. Cells are integer coordinates that count from 0 at left, front and bottom.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from inspect import isabstract
from itertools import chain, product
from math import pi, prod, sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.agents.shares import Lateral, Neighbourhood
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError, require, suggestion

Cells = NDArray[np.int64]
"""Integer cell coordinates, shape (n, dimension)."""

PERIOD = 5040
"""Cells so many steps apart along an axis have the same form: 2, 3 ... 10 all divide it."""

_NEAR = 1e-9  # of a cell


@dataclass(frozen=True)
class Lattice(ABC):
    """A regular arrangement of equal cells; the base class of your own lattices.

    A subclass gives `kind`, `forms`, `form`, `outline` and `centres`. Give it to a body as
    ``body={"lattice": Triangles, ...}``. A scene file names it by its kind, once the class exists.

    Parameters
    ----------
    shape : tuple of int
        Number of cells along the coordinates.
    cell_size : float
        Length of a cell along each of its axes (m): of squares, cubes and hexagons the distance
        of opposite faces, of triangles their height.

    Examples
    --------
    >>> import numpy as np
    >>> from kaju import Squares  # a subclass
    >>> squares = Squares((2, 2), 0.01)
    >>> squares.centres(np.array([[0, 1]])).tolist()  # (m)
    [[0.005, 0.015]]
    >>> squares.neighbours(np.array([[0, 1]]), 2).tolist()  # the cell below
    [[0, 0]]
    """

    shape: tuple[int, ...]
    cell_size: float

    kind: ClassVar[str] = ""
    """What a cell is called, in the singular."""
    forms: ClassVar[int] = 1
    """How many forms cells have."""
    dimension: ClassVar[int] = 2
    """2; only cubes have 3."""
    boxes: ClassVar[bool] = False
    """Whether cells are squares or cubes, which have smaller ones in them and a staggered grid."""

    def __post_init__(self) -> None:
        axes, size = len(self.shape), " x ".join(map(str, self.shape))
        told = f"shape: {self.kind!r} has {self.dimension} axes, but {self.shape} names {axes}"
        require(axes == self.dimension, told)
        told = f"shape: {size} cells are more than can be counted (2^62); use larger cells"
        require(prod(self.shape) < 2**62, told)

    # What a lattice says of itself.

    def form(self, cells: Cells) -> Ints:
        """Tell which of the forms each cell has, also outside the array: 0 to `forms` - 1."""
        return np.zeros(len(cells), dtype=np.int64)

    @abstractmethod
    def outline(self, form: int) -> Floats:
        """Return the corners of a form about the cell's middle (m), counter-clockwise."""

    @abstractmethod
    def centres(self, cells: Cells) -> Floats:
        """Return the middle points of cells (m), also outside the array, shape (n, dimension)."""

    # What follows from it: faces and neighbours.

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normals of the faces of all forms, shape (directions, dimension)."""
        # Whole degrees are taken exactly, so that opposite normals are as opposite as can be.
        normal = np.concatenate([_edge_normals(self.outline(form)) for form in range(self.forms)])
        degrees = np.rad2deg(np.arctan2(normal[:, 1], normal[:, 0]))
        whole = np.rint(degrees)
        degrees = np.where(np.abs(degrees - whole) < 1e-7, whole, degrees) % 360.0
        degrees = np.sort(degrees)
        angle = np.deg2rad(degrees[np.diff(degrees, prepend=-1.0) > 1e-7])
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    @cached_property
    def faces(self) -> Ints:
        """Edge k, k + 1 of a form's outline along a direction, or -1: (forms, directions)."""
        faces = np.full((self.forms, self.directions), -1, dtype=np.int64)
        for form in range(self.forms):
            along = _edge_normals(self.outline(form)) @ self.normals.T
            edge, direction = np.nonzero(along > 1.0 - _NEAR)
            faces[form, direction] = edge
        return faces

    @cached_property
    def face_offsets(self) -> Floats:
        """From a form's middle to those of its faces (m): (forms, directions, dimension)."""
        offsets = np.zeros((*self.faces.shape, self.dimension))
        for form, edges in enumerate(self.faces):
            corners = self.outline(form)
            middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
            offsets[form, edges >= 0] = middles[edges[edges >= 0]]
        return offsets

    @cached_property
    def distances(self) -> Floats:
        """From a form's middle to its faces (m), infinite where it has none."""
        reach = (self.face_offsets * self.normals).sum(axis=2)
        return np.where(self.faces < 0, np.inf, reach)

    @cached_property
    def arms(self) -> tuple[tuple[int, ...], ...]:
        """The directions in which each form has a face."""
        return tuple(tuple(np.flatnonzero(edges >= 0).tolist()) for edges in self.faces)

    @property
    def directions(self) -> int:
        """Number of directions of faces: 4, 6 (cubes, hexagons, triangles), ..."""
        return len(self.normals)

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Readable names: "-x", "+x", ... or "0°", "60°", ..."""
        degrees = np.rad2deg(np.arctan2(self.normals[:, 1], self.normals[:, 0])) % 360.0
        return tuple(f"{degree:.4g}°" for degree in np.round(degrees, 6) % 360.0)

    @cached_property
    def opposite(self) -> Ints:
        """For every direction the one that points the other way."""
        return np.asarray(np.argmin(self.normals @ self.normals.T, axis=1))

    @cached_property
    def mirrored(self) -> Ints:
        """Directions mirrored at a wall: `mirrored[n, d]` is d seen in a wall with normal n."""
        cosine = self.normals @ self.normals.T
        image = self.normals[None] - 2.0 * cosine[:, :, None] * self.normals[:, None]
        return np.asarray(np.argmax(image @ self.normals.T, axis=2))

    @cached_property
    def steps(self) -> Ints:
        """Coordinate steps over each arm, or 0: shape (forms, directions, dimension)."""
        steps = np.zeros((*self.faces.shape, self.dimension), dtype=np.int64)
        found = self.form(self.few)
        for form, arms in enumerate(map(list, self.arms)):
            cell = self.few[np.argmax(found == form)]
            beyond = self.face_offsets[form, arms] + 1e-3 * self.cell_size * self.normals[arms]
            steps[form, arms] = self.locate(self.centres(cell[None]) + beyond) - cell
        return steps

    @cached_property
    def few(self) -> Cells:
        """The first cells, ten along each coordinate: a whole pattern of forms."""
        return np.array(list(product(range(10), repeat=self.dimension)), dtype=np.int64)

    @cached_property
    def key_steps(self) -> Ints:
        """What a step over each arm adds to a cell's key, shape (forms, directions)."""
        origin = np.zeros((1, self.dimension), dtype=np.int64)
        steps = self.steps.reshape(-1, self.dimension)
        return (self.key(steps) - self.key(origin)).reshape(self.steps.shape[:2])

    def neighbours(self, cells: Cells, arm: int) -> Cells:
        """Return the cells reached over one arm: outside, or the same where there is no face."""
        return np.asarray(cells + self.steps[self.form(cells), arm])

    def face_middles(self, cells: Cells, direction: Ints) -> Floats:
        """Return the middles of faces (m), shape (n, dimension); direction -1: of the cells."""
        offsets = self.face_offsets[self.form(cells), direction]
        return self.centres(cells) + offsets * (direction >= 0)[:, None]

    def way(self, direction: int, form: int) -> Neighbourhood:
        """Return which faces are ahead of a load, behind and beside it, and with which weights.

        Ahead is the face whose normal is nearest to the load's direction; two that are equally
        near, as of a triangle that stands on a corner, take a half each. Behind likewise. Beside
        are all faces whose normal is not parallel to the load: the blocked expansion leaves by
        sin² of the angle between both, and friction acts on those with the smallest angle.
        """
        cosines = np.round(self.normals @ self.normals[direction], 12)  # equal ones exactly equal
        faces = [(arm, float(cosines[arm])) for arm in self.arms[form]]
        cosine = [c for _, c in faces]
        ahead, behind = (
            tuple((arm, 1.0 / cosine.count(end)) for arm, c in faces if c == end)
            for end in (max(cosine), min(cosine))
        )
        beside = [(arm, c) for arm, c in faces if abs(c) < 1.0]
        nearest = max((c for _, c in beside), default=0.0)
        lateral = tuple(Lateral(arm, float(c == nearest), 1.0 - c**2) for arm, c in beside)
        return Neighbourhood(ahead, behind, lateral)

    # Places and sizes.

    @property
    def size(self) -> int:
        """Number of cells, those of air and ground included."""
        return prod(self.shape)

    @cached_property
    def pitch(self) -> Floats:
        """How far (m) a step along each coordinate leads on the average, a column for each."""
        far = PERIOD * np.eye(self.dimension, dtype=np.int64)
        return (self.centres(far) - self.centres(0 * far)).T / PERIOD

    def coordinates(self, points: Floats) -> Floats:
        """Return points (m) in steps of the coordinates; a cell's middle lies near its own."""
        return points @ np.linalg.inv(self.pitch).T

    @cached_property
    def offsets(self) -> tuple[Floats, Floats]:
        """Least and largest difference of a cell's coordinates and those of its middle."""
        offsets = self.coordinates(self.centres(self.few)) - self.few
        return offsets.min(axis=0), offsets.max(axis=0)

    def locate(self, points: Floats) -> Cells:
        """Return the cell that each point (m) lies in; outside the array too."""
        points = np.asarray(points, dtype=np.float64)
        guess = np.rint(self.coordinates(points) - np.mean(self.offsets, axis=0)).astype(np.int64)
        found: Cells = guess
        nearest = np.full(len(points), np.inf)
        for step in product((0, -1, 1), repeat=self.dimension):
            cells = guess + np.array(step)
            along = (points - self.centres(cells)) @ self.normals.T
            out = (along - self.distances[self.form(cells)]).max(axis=1)
            better = out < nearest - _NEAR * self.cell_size
            found = np.where(better[:, None], cells, found)
            nearest = np.where(better, out, nearest)
        return found

    @cached_property
    def extent(self) -> tuple[float, ...]:
        """Size of the bounding box of the array (m)."""
        ends = [sorted({*range(min(10, n)), *range(max(0, n - 10), n)}) for n in self.shape]
        cells = np.array(list(product(*ends)), dtype=np.int64)
        form, middles = self.form(cells), self.centres(cells)
        corners = [
            middles[form == each][:, None] + self.outline(each) for each in range(self.forms)
        ]
        upper = np.concatenate([part.reshape(-1, self.dimension) for part in corners]).max(axis=0)
        return tuple(upper.tolist())

    def face_area(self, thickness: float = 1.0) -> float:
        """Return the area of a cell's face (m²); `thickness` (m) counts in two dimensions."""
        corners = self.outline(0)
        return float(np.linalg.norm(corners[1] - corners[0])) * thickness

    def cell_volume(self, thickness: float = 1.0) -> float:
        """Return the volume of a cell (m³); `thickness` (m) counts in two dimensions."""
        return area_of(self.outline(0)) * thickness

    # Axes, and the lines of cells along them.

    @cached_property
    def axes(self) -> Ints:
        """One direction of each opposite pair: the positive sense of the cell's axes."""
        return np.flatnonzero(np.arange(self.directions) < self.opposite)

    @cached_property
    def axis_of(self) -> Ints:
        """For every direction the index of its axis in `axes`."""
        return np.searchsorted(self.axes, np.minimum(np.arange(self.directions), self.opposite))

    @cached_property
    def within(self) -> Floats:
        """Where a cell's middle lies between its ends along an axis, 0 to 1: (forms, axes)."""
        along = [self.outline(form) @ self.normals[self.axes].T for form in range(self.forms)]
        return -np.stack([part.min(axis=0) for part in along]) / self.cell_size

    def line(self, cells: Cells, axis: int) -> tuple[Ints, Ints]:
        """Return the line along an axis that each cell lies on, and its position there.

        Lines are numbered; positions count cells along the axis' positive sense, from 0 upwards
        in the array.
        """
        along = self.normals[self.axes[axis]]
        across = np.array([-along[1], along[0]])
        middles = self.centres(cells) / self.cell_size
        # Lines are fractions of a cell apart, with denominators up to 14 (least common multiple:
        # 720720). Rounding removes what middles on one line differ by.
        line = np.rint(720720.0 * (middles @ across)).astype(np.int64)
        begins = middles @ along - self.within[self.form(cells), axis]
        lowest = np.minimum(0.0, along * self.extent).sum() / self.cell_size
        # An irrational shift keeps `floor` clear of the ends of cells, which lie at fractions.
        return line, np.floor(begins - lowest + 1.0 / pi).astype(np.int64)

    def along(self, cells: Cells, axis: int, count: Ints) -> Cells:
        """Return the cells so many further along an axis, on the same lines; below 0: back."""
        # The middle of a cell between its ends along the axis lies in it.
        ahead = count + 0.5 - self.within[self.form(cells), axis]
        way = self.cell_size * ahead[:, None] * self.normals[self.axes[axis]]
        return self.locate(self.centres(cells) + way)

    # The array.

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides of the array, lower before upper, axis by axis."""
        depth = ("front", "back") if self.dimension == 3 else ()
        return ("left", "right", *depth, "bottom", "top")

    def arms_of_side(self, side: str, form: int) -> list[int]:
        """Return the faces of a form that look most towards a side of the array."""
        axis, upper = divmod(self.sides.index(side), 2)
        arms = np.array(self.arms[form])
        towards = self.normals[arms, axis] * (1.0 if upper else -1.0)
        chosen: list[int] = arms[towards > towards.max() - _NEAR].tolist()
        return chosen

    def contains(self, cells: Cells) -> Flags:
        """Tell which cells lie inside the array."""
        return np.asarray(np.all((cells >= 0) & (cells < np.asarray(self.shape)), axis=1))

    def side_beyond(self, cells: Cells) -> Ints:
        """Return for each cell the index in `sides` that it lies beyond, -1 inside.

        A cell beyond two sides (outside a corner) counts for the later of them in `sides`.
        """
        beyond = np.full(len(cells), -1, dtype=np.int64)
        for axis, count in enumerate(self.shape):
            beyond[cells[:, axis] < 0] = 2 * axis
            beyond[cells[:, axis] >= count] = 2 * axis + 1
        return beyond

    def key(self, cells: Cells) -> Ints:
        """Give each cell its own number, also the cells just outside of the array."""
        padded = np.asarray(self.shape, dtype=np.int64) + 2
        key = cells[:, 0] + 1
        for axis in range(1, self.dimension):
            key = key * padded[axis] + cells[:, axis] + 1
        return key

    def cells(self, key: Ints) -> Cells:
        """Turn numbers made by `key` back into cell coordinates."""
        padded = np.asarray(self.shape, dtype=np.int64) + 2
        cells = np.empty((len(key), self.dimension), dtype=np.int64)
        for axis in range(self.dimension - 1, 0, -1):
            above = key // padded[axis]  # divmod takes several times as long
            cells[:, axis] = key - above * padded[axis] - 1
            key = above
        cells[:, 0] = key - 1
        return cells

    # Forces.

    def split(self, force: Floats) -> Floats:
        """Split forces (N) into loads along the directions, shape (n, directions).

        A force is the sum of its parts along the two face normals that it lies between.
        """
        angle = np.arctan2(self.normals[:, 1], self.normals[:, 0]) % (2.0 * pi)
        order = np.argsort(angle)
        turn = np.arctan2(force[:, 1], force[:, 0]) % (2.0 * pi)
        sector = np.searchsorted(angle[order], turn, side="right") - 1
        pair = np.stack([order[sector], order[(sector + 1) % len(order)]], axis=1)
        parts = np.linalg.solve(self.normals[pair].transpose(0, 2, 1), force[:, :, None])[..., 0]
        # A force along a direction has rounding alone along the next.
        size = np.linalg.norm(force, axis=1, keepdims=True)
        parts = np.where(parts > 1e-12 * size, parts, 0.0)
        parts = np.where(parts[:, ::-1] == 0.0, np.where(parts > 0.0, size, 0.0), parts)
        loads = np.zeros((len(force), self.directions))
        np.put_along_axis(loads, pair, parts, axis=1)
        return loads


def area_of(corners: Floats) -> float:
    """Return the area of a polygon (m²), above 0 if its corners run counter-clockwise."""
    x, y = corners.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _edge_normals(corners: Floats) -> Floats:
    edge = np.roll(corners, -1, axis=0) - corners
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


# The lattices that kaju brings, lattices by name, and the check of those of your own.


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

    def locate(self, points: Floats) -> Cells:
        """Return the cell that each point (m) lies in; outside the array too."""
        return np.floor(np.asarray(points, float) / self.cell_size).astype(np.int64)

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
    """A lattice of squares, the usual one in the plane.

    Examples
    --------
    >>> from kaju import Squares
    >>> squares = Squares((2, 3), 0.01)
    >>> squares.extent, squares.direction_names  # (m), and how faces are numbered
    ((0.02, 0.03), ('-x', '+x', '-y', '+y'))
    """

    kind: ClassVar[str] = "square"


class Cubes(BoxLattice):
    """A lattice of cubes, the only one in space.

    Examples
    --------
    >>> from kaju import Cubes
    >>> cubes = Cubes((2, 3, 4), 0.01)
    >>> cubes.size, cubes.extent  # cells, and (m)
    (24, (0.02, 0.03, 0.04))
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


def check_boxes(lattice: Lattice, what: str = "have a staggered grid") -> None:
    """Refuse cells other than squares and cubes, which alone do or can `what`."""
    told = f"body.lattice: only squares and cubes {what}, got {lattice.kind}s; take square cells"
    if not lattice.boxes:
        raise SceneError(told + ", or a SpringNetwork" * isinstance(lattice, Hexagons))


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
