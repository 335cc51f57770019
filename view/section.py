"""What part of a body a picture shows: a crop, a cut through it, and how coarsely.

Nothing here is ever as large as the body. A picture is made of *tiles*: single cells, or
blocks of cells where there are too many to be seen one by one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.path import Path
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import no_such, require
from kaju.model.results.mesh import corner_order, same_points
from kaju.model.scene import Scene

from .units import grouped, quantity

Cut: TypeAlias = Mapping[str, float] | None
"""Axis and place (m) of a plane; an empty one is a plane through the agents."""
How: TypeAlias = Literal["min", "max", "sum", "farthest"]
"""How the values of the cells of one tile become one."""


def check_number(key: str, value: float, last: float) -> None:
    """Refuse the number of a moment, or of a level, that there is not."""
    require(0 <= value <= last, f"{key}: must lie between 0 and {last:g} here, got {value}")


def check_word(key: str, word: str, known: Collection[str]) -> None:
    """Refuse what is not among the words of an option."""
    require(word in known, f"{key}: {no_such(repr(word), word, known)}")


def one_a_place(places: Ints, values: NDArray[Any], how: How) -> tuple[Ints, NDArray[Any]]:
    """Return places (n, dimension), each once, and one value of all that stand there."""
    if not len(places):
        return places, values
    order = np.lexsort(places.T)
    places, values = places[order], values[order]
    first = np.ones(len(places), dtype=np.bool_)
    first[1:] = np.any(places[1:] != places[:-1], axis=1)
    starts = np.flatnonzero(first)
    if how == "farthest":  # from 0
        low, high = (pairing.reduceat(values, starts) for pairing in (np.minimum, np.maximum))
        values = np.where(-low > high, low, high)
    else:
        found = {"min": np.minimum, "max": np.maximum, "sum": np.add}[how]
        values = found.reduceat(values, starts, axis=0)
    return places[starts], values


class Arrows(NamedTuple):
    """Where forces start (`pulls`) or end (m), and how large they are (N), shape (n, dimension).

    `wide` is the length of the surface (m) over which each is spread, 0 where that is not known.
    """

    place: Floats
    force: Floats
    pulls: NDArray[Any]
    wide: Any = 0.0


class TrueLines(NamedTuple):
    """What pictures show of a body within true outlines."""

    rings: list[tuple[Floats, Floats]]
    """Closed lines (m) that hold it on their left, and how they move (m)."""
    joints: Floats  # lines (m) along which materials meet, shape (n, 2, 2)
    arrows: Arrows
    asked: Scene  # the body that was described, with its loads
    pins: Floats  # the points (m) about which pinned regions turn; NaN of others, shape (n, 2)

    def path(self, factor: float = 0.0) -> Path:
        """Return what holds the body, moved times a factor."""
        paths = [Path(ring + factor * moved, closed=True) for ring, moved in self.rings]
        return Path.make_compound_path(*paths)

    def clip(self, drawn: PolyCollection, factor: float = 0.0) -> None:
        """Show of what is drawn what lies within the body, moved times a factor."""
        assert drawn.axes is not None
        drawn.set_clip_path(self.path(factor), drawn.axes.transData)


@dataclass(frozen=True, eq=False)
class Section:
    """A rectangle of tiles in a plane of a body."""

    scene: Scene
    lower: Ints
    upper: Ints  # cells shown: lower <= cell < upper, rightwards and upwards; shape (2,)
    axes: tuple[int, int]  # of the body that run rightwards and upwards
    cut: tuple[int, int] | None  # axis and layer of cells shown of a body in space
    block: int  # a tile is block × block cells
    cropped: bool  # whether there is more body outside the picture
    caveats: tuple[str, ...] = ()  # what is approximate of the answer, in a few words each
    place: float = 0.0  # where the cut lies along its axis (m)
    tiled: bool = True  # whether tiles are what is shown, or agents of many sizes
    curves: TrueLines | None = None

    @property
    def outlined(self) -> bool:
        """Whether tiles have outlines of their own; squares and blocks follow the coordinates."""
        return not self.scene.lattice.boxes and self.block == 1

    @cached_property
    def tile_size(self) -> Floats:
        """Distance between tiles, rightwards and upwards (m)."""
        return np.diag(self._pitch)

    @cached_property
    def _pitch(self) -> Floats:
        """Vectors from a tile to the next one (m), a column each: rightwards and upwards."""
        return self.block * self.scene.lattice.pitch[np.ix_(self.axes, self.axes)]

    def holds(self, cells: Ints) -> Flags:
        """Tell which cells of the body are in the picture."""
        flat = cells[:, self.axes]
        inside: Flags = np.all((flat >= self.lower) & (flat < self.upper), axis=1)
        if self.cut is not None:
            inside &= cells[:, self.cut[0]] == self.cut[1]
        return inside

    def gather(self, cells: Ints, values: NDArray[Any], how: How) -> tuple[Ints, NDArray[Any]]:
        """Return the tiles that show cells, (n, dimension), and one value each; leave out others.

        `values`, shape (n,) or (n, m): what the cells have.
        """
        shown = self.holds(cells)
        tiles = np.floor_divide(cells[shown][:, self.axes], self.block)
        return one_a_place(tiles, np.asarray(values)[shown], how)

    def in_plane(self, points: Floats) -> Floats:
        """Return points or vectors of the body, shape (n, dimension), as they are seen."""
        return points[:, self.axes]

    def in_body(self, points: Floats) -> Floats:
        """Return points of the picture, shape (n, 2), as points of the body."""
        if self.cut is None:
            return points
        full = np.empty((len(points), 3))
        full[:, self.axes] = points
        full[:, self.cut[0]] = self.place
        return full

    def meets(self, lower: Floats, size: Floats) -> Ints:
        """Return which agents of these lower corners and edges (m) are in the picture."""
        low, high = self.box
        flat = lower[:, self.axes]
        shown = np.all((flat < high) & (flat + size[:, None] > low), axis=1)
        if self.cut is not None:
            ahead = self.place - lower[:, self.cut[0]]
            shown &= (ahead >= 0.0) & (ahead < size)
        return np.flatnonzero(shown)

    def centres(self, tiles: Ints) -> Floats:
        """Return the middles of tiles (m), shape (n, 2)."""
        if self.outlined:
            return self.scene.lattice.centres(tiles)
        return (tiles + 0.5) @ self._pitch.T

    def polygons(self, tiles: Ints) -> Floats:
        """Return the corners of tiles (m), shape (n, corners, 2), counter-clockwise."""
        shapes = ((corner_order(2) - 0.5) @ self._pitch.T)[None]
        if self.outlined:
            lattice = self.scene.lattice
            forms = np.stack([lattice.outline(form) for form in range(lattice.forms)])
            shapes = forms[lattice.form(tiles)]
        return self.centres(tiles)[:, None] + shapes

    def stripes(self, tiles: Ints) -> Floats:
        """Return tiles like `polygons`, but rows of neighbouring rectangles as one each."""
        if self.outlined:
            return self.polygons(tiles)
        tiles = tiles[np.lexsort(tiles.T)]
        follows = np.zeros(len(tiles), dtype=np.bool_)
        follows[1:] = np.all(tiles[1:] == tiles[:-1] + np.array([1, 0]), axis=1)
        first = np.flatnonzero(~follows)
        last = np.append(first[1:], len(tiles))[: len(first)] - 1
        corners = self.polygons(tiles[first])
        corners[:, 1:3] = self.polygons(tiles[last])[:, 1:3]
        return corners

    @cached_property
    def ground(self) -> tuple[Ints, Ints]:
        """All tiles of the picture, shape (n, 2), and their kinds, shape (n,)."""
        first = self.lower // self.block
        last = -(-self.upper // self.block)
        columns, rows = (np.arange(a, b) for a, b in zip(first, last, strict=True))
        tiles = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1).reshape(-1, 2)
        flat = tiles * self.block + self.block // 2
        if self.cut is None:
            return tiles, self.scene.kinds(flat)
        cells = np.empty((len(flat), 3), dtype=np.int64)
        cells[:, self.axes] = flat
        cells[:, self.cut[0]] = self.cut[1]
        return tiles, self.scene.kinds(cells)

    def outlines(self) -> tuple[Floats, Floats]:
        """Return line segments, each (n, 2, 2) in m: the body's surface, and joints inside it.

        A joint lies where two materials meet.
        """
        if self.curves is not None:
            ends = [np.stack([ring[:-1], ring[1:]], axis=1) for ring, _ in self.curves.rings]
            return np.concatenate(ends), self.curves.joints
        tiles, kinds = self.ground
        corners = self.polygons(tiles)
        lines = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)
        first, edge = same_points(lines.mean(axis=1), self.tile_size / 100.0)
        low, high = np.full((2, len(first)), kinds[first // corners.shape[1]])
        np.minimum.at(low, edge, np.repeat(kinds, corners.shape[1]))
        np.maximum.at(high, edge, np.repeat(kinds, corners.shape[1]))
        surface, joint = (low < 0) & (high >= 0), (low >= 0) & (low < high)
        return lines[first[surface]], lines[first[joint]]

    @cached_property
    def box(self) -> Floats:
        """Lower and upper corner of the picture (m), shape (2, 2)."""
        ends = np.stack([self.lower // self.block, -(-self.upper // self.block) - 1])
        corners = self.polygons(ends).reshape(-1, 2)
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def span(self) -> float:
        """The longer edge of the picture (m)."""
        return float(np.ptp(self.box, axis=0).max())

    @property
    def notes(self) -> list[str]:
        """The cut, the crop, the coarsening, and what is approximate of the answer."""
        shown = []
        shape = np.array(self.scene.lattice.shape)
        if self.cut is not None:
            shown.append(f"cut at {'xyz'[self.cut[0]]} = {quantity(self.place, 'm')}")
        if self.cropped:
            seen = np.minimum(self.upper, shape[[*self.axes]]) - np.maximum(self.lower, 0)
            part, whole = (" × ".join(map(grouped, n)) for n in (seen, shape[[*self.axes]]))
            shown.append(f"cropped to {part} of {whole} cells")
        if self.block > 1 and self.tiled:
            shown.append(f"each tile stands for {self.block} × {self.block} cells")
        return ["; ".join(words) for words in (shown, self.caveats) if words]


WHOLE_UP_TO = 64
"""Bodies of up to this many cells across are never cropped."""


def section_of(
    scene: Scene,
    cells: Ints | None = None,
    cut: Cut = None,
    crop: bool | None = None,
    most_across: int = 240,
    whole_up_to: int = WHOLE_UP_TO,
    caveats: tuple[str, ...] = (),
) -> Section:
    """Choose what to show: the given cells with a margin, or the whole body.

    Of a body in space the layer at the place that `cut` names (m), or else the one that holds most
    of the cells. Unless `crop` says so, bodies of more than `whole_up_to` cells across are cropped.
    Where more cells than `most_across` lie side by side, tiles are blocks of cells.
    """
    if cells is None:
        cells, crop = np.empty((0, scene.lattice.dimension), dtype=np.int64), False
    named, where, place = named_cut(scene, cut), None, 0.0
    axes = (0, 1)
    if scene.lattice.dimension == 3:
        where = (named[0], layer_at(scene, *named)) if named else _fullest_layer(scene, cells)
        first, second = (axis for axis in range(3) if axis != where[0])
        axes, place = (first, second), (where[1] + 0.5) * scene.lattice.cell_size
        cells = cells[cells[:, where[0]] == where[1]]
    shape = np.array(scene.lattice.shape)[[*axes]]
    lower, upper = np.zeros(2, dtype=np.int64), shape
    if shape.max() > WHOLE_UP_TO:
        lower, upper = (corner[[*axes]] for corner in scene.bounds())
    whole = (upper - lower).max() <= whole_up_to if crop is None else not crop
    cropped = False
    if len(cells) and not whole:
        first, last = cells[:, axes].min(axis=0), cells[:, axes].max(axis=0) + 1
        span = last - first
        margin = np.maximum(3, np.rint(np.maximum(0.15 * span, 0.05 * span.max())).astype(np.int64))
        near = np.maximum(first - margin, lower), np.minimum(last + margin, upper)
        cropped = bool(np.prod((near[1] - near[0]) / (upper - lower)) <= 0.6)  # else not worth it
        if cropped:
            lower, upper = near
    block = ceil(int((upper - lower).max()) / most_across)
    rim = max(1, round(0.04 * int((upper - lower).max())))
    return Section(scene, lower - rim, upper + rim, axes, where, block, cropped, caveats, place)


def named_cut(scene: Scene, cut: Cut) -> tuple[int, float] | None:
    """Return axis and place (m) of a cut, None unless one is asked for; refuse anything else."""
    if not cut:
        return None
    told = f"cut: only bodies of cubes can be cut, got {dict(cut)!r}; leave it out"
    require(scene.lattice.dimension == 3, told)
    told = "cut: one of the axes 'x', 'y' and 'z' with a place in m, such as {'y': 0.05}"
    named = len(cut) == 1 and next(iter(cut)) in ("x", "y", "z")
    require(named, f"{told}, got {dict(cut)!r}")
    ((name, place),) = cut.items()
    axis = "xyz".index(name)
    end = scene.lattice.cell_size * scene.lattice.shape[axis]
    number = isinstance(place, (int, float, np.number)) and not isinstance(place, bool)
    within = number and 0.0 <= place <= end
    require(within, f"cut: {name} runs from 0 to {end:g} m, got {place!r}")
    return axis, float(place)


def layer_at(scene: Scene, axis: int, place: float) -> int:
    """Return the layer of cells that a plane through a body lies in."""
    # On a plane between two layers rounding must not decide which of them is shown.
    layer = int(place / scene.lattice.cell_size + 1e-9)
    return min(layer, scene.lattice.shape[axis] - 1)


def axis_across(scene: Scene, stage: int | None = None) -> int:
    """Return across which axis a body is shown cut: y, or x if the loads mainly run along y."""
    along = np.abs(scene.applied(stage).force).sum(axis=0)
    return 0 if along[1] > along[[0, 2]].max() else 1


def _fullest_layer(scene: Scene, cells: Ints) -> tuple[int, int]:
    """Return the layer with most of the cells, out of those that the loads run along.

    Of layers with about as many cells it is the middle one; without cells that of the body.
    """
    axis = axis_across(scene)
    if not len(cells):
        return axis, scene.lattice.shape[axis] // 2
    layers, counts = np.unique(cells[:, axis], return_counts=True)
    full = layers[counts >= 0.95 * counts.max()]
    return axis, int(full[len(full) // 2])
