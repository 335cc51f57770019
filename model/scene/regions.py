"""Regions as they are described: a shape, and what fills it; paths and drawings of SVG.

Paths are in m, y upwards, of M, L, H, V, C, S, Q, T, A, Z; svgpathtools turns drawings into them.
"""

from __future__ import annotations

import re
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, permutations
from typing import Annotated, Any, Literal, Self
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from kaju.arrays import Floats
from kaju.errors import SceneError, SceneFileError, needing, suggestion
from kaju.files import text_of_file
from kaju.model.scene import validation
from kaju.model.scene.validation import Described, Length, Number, Text, check_axes, optional

from . import shapes
from .cell_types import NOT_BODY
from .curves import Point as Place
from .curves import conic, cubic, flattened, inflections, line, parted_at
from .lattice import Lattice, area_of
from .level_sets import EMBEDDED_ARRAY, EMBEDDED_PIXELS, SampledShape, checked, read_embedded
from .pictures import read_array, read_darkness, read_layers
from .shapes import Ball, Box, Extent, Point, Points, Polygon, Shape
from .surfaces import ClosedSurface, surface_from

METRES = "are these metres? 1 mm is 0.001 m"
_IN_SPACE = ("ball", "cylinder", "surface")
_IN_PLANE = ("disk", "ring", "ellipse", "slot", "rounded_box", "polygon", "path")
_SHAPES = ("box", "disk", *_IN_SPACE, *_IN_PLANE[1:], "image")


class SurfaceFile(Described):
    """The inside of a closed surface of triangles, from an STL file."""

    file: Text = Field(description="the path of an STL file, such as 'part.stl'")
    scale: Length = Field(default=1.0, description="what its unit of length is (m): 0.001 for mm")
    offset: Point = Field(default=(0.0, 0.0, 0.0), description="how far it is moved (m)")

    @model_validator(mode="before")
    @classmethod
    def _from_path(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value


class PathFile(Described):
    """Outlines of an SVG drawing, from the lower left corner of its page."""

    file: Text = Field(description="the path of an SVG file, such as 'drawing.svg'")
    id: Text | None = optional("the id of the one shape that is taken; unless given, all are")


def _path(value: Any) -> Any:
    """Return path data, or the file that is named."""
    if value is None or isinstance(value, PathFile):
        return value
    if isinstance(value, Mapping):
        return PathFile(**value)
    if not isinstance(value, str) or len(value) > 1_000_000:
        raise ValueError("must be a text of up to 1,000,000 letters, or a table with a file")
    return value


class RegionImage(Described):
    """The dark part of an image, stretched over a box or over the whole array."""

    file: Text = Field(description="the path of an image, such as 'hole.png'")  # or .npy
    box: tuple[Point, Point] | None = optional("the lower and the upper corner (m) that it fills")
    level: Number = Field(default=0.5, description="how dark a place must be, from 0 to 1")
    # Bilinear between the middles of pixels; or how large a number, between samples of an array, of
    # which the outer ones lie on the sides of the box.

    def shape_in(self, lattice: Lattice, where: str) -> Shape:
        """Return where it reaches its level, in its place."""
        whole = ((0.0,) * lattice.dimension, lattice.extent)
        box = _box(self.box or whole, lattice, f"{where}.box")
        key, file = f"{where}.file", self.file
        middles = not file.endswith(".npy") and not file.startswith(EMBEDDED_ARRAY)
        if file.endswith(".npy"):
            values: NDArray[Any] = read_array(file, key)
        elif file.startswith((EMBEDDED_ARRAY, EMBEDDED_PIXELS)):
            values = read_embedded(file, key)
        elif lattice.dimension == 2:
            values = read_darkness(file, key)[::-1].T
        elif file.lower().endswith((".tif", ".tiff")):
            values = read_layers(file, key)
        else:
            raise SceneError(f"{key}: one image is plane; give a TIFF of layers, or an .npy array")
        return SampledShape(box, checked(values, key, lattice.dimension), self.level, middles)


class _Shaped(Described):
    """Exactly one shape, of those that loads and regions share."""

    box: tuple[Point, Point] | None = optional(
        "the lower and the upper corner (m), such as [[0, 0], [0.1, 0.2]]"
    )
    disk: Ball | None = None
    ball: Ball | None = None
    ring: shapes.Ring | None = None
    polygon: tuple[Point, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=10_000,  # every cell near it is held against every edge
        description="the corners (m), three or more; finer shapes are drawn as an image",
    )

    @property
    def _name(self) -> str:
        """The only shape that is given."""
        names = tuple(name for name in _SHAPES if name in type(self).model_fields)
        return validation.one_given(self, names, "box: a region has exactly one shape of")

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        _ = self._name
        return self

    def shape_in(self, lattice: Lattice, where: str) -> Shape:
        """Return the shape in the array of `lattice`."""
        name = self._name
        given, where = getattr(self, name), f"{where}.{name}"
        if name in _IN_SPACE and lattice.dimension == 2:
            raise SceneError(f"{where}: belongs to three dimensions; use disk or box")
        if name in _IN_PLANE and lattice.dimension == 3:
            names = [n for n in _SHAPES if n in type(self).model_fields and n not in _IN_PLANE]
            raise SceneError(f"{where}: belongs to two dimensions; use one of {', '.join(names)}")
        if name == "path":
            return path_in(given, where)
        if name == "surface":
            check_axes(given.offset, 3, f"{where}.offset")
            return surface_from(given.file, f"{where}.file", given.scale, given.offset)
        if isinstance(given, RegionImage):
            return given.shape_in(lattice, where)
        if name == "box":
            return _box(given, lattice, where)
        if name == "rounded_box":
            lower, upper = _box(given.box, lattice, f"{where}.box").extent
            if np.any(2 * given.radius >= upper - lower):
                raise SceneError(
                    f"{where}.radius: {given.radius:g} must be below half of each edge; use slot"
                )
        shape: Shape = Polygon(given) if name == "polygon" else given
        points = given if name == "polygon" else getattr(given, "ends", getattr(given, "box", None))
        for point in points or [given.centre]:
            check_axes(point, lattice.dimension, where, "coordinates")
        return shape


class Region(_Shaped):
    """A part of the array, filled with something else. Later regions cover earlier ones.

    Exactly one shape; a cell belongs to it if its centre lies inside or on the edge.
    """

    material: Text = Field(description='a material\'s name, "air", "rigid", "pinned" or "roller"')
    cylinder: shapes.Cylinder | None = None
    surface: SurfaceFile | None = None  # no arc is guessed behind its triangles
    ellipse: shapes.Ellipse | None = None
    slot: shapes.Slot | None = None
    rounded_box: shapes.RoundedBox | None = None
    path: Annotated[str | PathFile | None, BeforeValidator(_path)] = optional(
        "path data of SVG (m, y upwards), such as 'M 0 0 H 0.1 V 0.1 Z', or {file = 'a.svg'}"
    )
    # Lines within a line go round holes.
    image: RegionImage | None = None
    # true without quotes, as in `--set`, means the same
    outline: Annotated[
        Literal["cells", "true"], BeforeValidator(lambda given: "true" if given is True else given)
    ] = Field(
        default="cells", description='"cells" for a staircase of cells, "true" for the shape itself'
    )
    name: Text | None = optional("what loads call the region's outline")

    def shape_in(self, lattice: Lattice, where: str) -> Shape:
        """Return the region's shape in the array of `lattice`."""
        shape, where = super().shape_in(lattice, where), f"{where}.{self._name}"
        lower, upper = shape.extent
        if np.any(upper <= lower):
            raise SceneError(f"{where}: has no extent; its corners lie on one line")
        if np.any(upper < 0.0) or np.any(lower > np.asarray(lattice.extent)):
            raise SceneError(f"{where}: lies outside the array: it {reach_of(shape, lattice)}")
        larger = self.material not in NOT_BODY and much_larger(shape, lattice)
        if larger and covers(shape, Box((0.0,) * len(lower), tuple(lattice.extent))):
            raise SceneError(f"{where}: holds the whole array: it {reach_of(shape, lattice)}")
        return shape


class LoadRegion(_Shaped):
    """A shape that selects what a load acts on; exactly one.

    A box without thickness along one axis selects the surface of the body on that plane. Of
    all other shapes a pressure, or a couple, takes the free faces whose middles lie inside, such
    as the edge of a hole; a force takes the cells inside. Of true outlines a box takes the edges.
    """

    def flat_axis(self, lattice: Lattice, where: str) -> int | None:
        """Return the axis along which the box has no thickness, None if it has volume."""
        assert self.box is not None
        lower, upper = _box(self.box, lattice, where, flat=True).extent
        flat = np.flatnonzero(upper - lower <= 1e-6 * lattice.cell_size).tolist()
        if len(flat) > 1:
            raise SceneError(
                f"{where}: has no thickness along {' and '.join('xyz'[axis] for axis in flat)}; "
                "a surface has none along one axis only; for a point use point = [...], and "
                "within true outlines a short box"
            )
        return flat[0] if flat else None


def much_larger(shape: Shape, lattice: Lattice) -> bool:
    """Tell whether a shape is so much larger than the array that its unit is hardly metres."""
    lower, upper = shape.extent
    return bool(np.max(upper - lower) > 20.0 * max(lattice.extent))


def covers(shape: Shape, other: Shape) -> bool:
    """Tell whether a shape holds all of another one, by samples."""
    steps = [np.linspace(*ends, 9)[1:-1] for ends in zip(*other.extent, strict=True)]
    samples = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, len(steps))
    samples = samples[other.contains(samples)]
    return len(samples) > 0 and bool(shape.contains(samples).all())


def reach_of(shape: Shape, lattice: Lattice, asked: str = "") -> str:
    """Say from where to where a shape reaches, and the array; unless told else, ask for units."""
    ends = (", ".join(f"{x:.4g}" for x in at) for at in (*shape.extent, lattice.extent))
    units = "is it in mm? give scale = 0.001" if isinstance(shape, ClosedSurface) else METRES
    asked = PIXELS if isinstance(shape, PathShape) and shape.in_pixels else asked or units
    return "reaches from ({}) to ({}) m, the array to ({}) m; {}".format(*ends, asked)


def _box(corners: tuple[Point, Point], lattice: Lattice, where: str, flat: bool = False) -> Box:
    """Return the box between two corners, which may be `flat`."""
    for corner in corners:
        check_axes(corner, lattice.dimension, where, "coordinates")
    lower, upper = corners
    if not all(low < high or (flat and low == high) for low, high in zip(*corners, strict=True)):
        raise SceneError(
            f"{where}: goes from {list(lower)} to {list(upper)}; the first corner must be the "
            "lower one along every axis"
        )
    return Box(lower, upper)


# Paths and drawings of SVG.

_UNITS = {
    **{"": 0.0254 / 96.0, "px": 0.0254 / 96.0, "in": 0.0254, "pt": 0.0254 / 72.0},
    **{"pc": 0.0254 / 6.0, "cm": 0.01, "mm": 0.001, "Q": 0.00025},
}
"""Metres, as CSS has them."""
_OUTLINES = ("path", "rect", "circle", "ellipse", "polygon")
_SILENT = ("defs", "metadata", "title", "desc", "style", "namedview", "clipPath", "mask", "marker")


PIXELS = (
    "the drawing names no unit, so its numbers are pixels of 1/96 inch; give its <svg> a width "
    'and a height with one, such as width="120mm" height="80mm"'
)


def read_drawing(text: str, only: str | None = None) -> list[Floats]:
    """Return the closed lines of a drawing, or of the shape of one id, each of shape (n, 4, 3).

    The page's lower left corner is the origin. Lines within a line go round holes, whatever their
    colour; within a path its fill rule says so.
    """
    with needing("path.file: an SVG drawing needs svgpathtools: pip install 'kaju[cad]'"):
        from svgpathtools.document import CONVERSIONS
        from svgpathtools.parser import parse_transform
    if "<!ENTITY" in text:
        raise _wrong("entities are not read; save it as plain SVG")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 (without entities)
    except ElementTree.ParseError as error:
        raise _wrong(f"is not an SVG drawing ({error}); save it as plain SVG") from None
    ids = [one.get("id", "") for one in root.iter() if _name(one) in _OUTLINES]
    if only is not None and only not in ids:
        there = ", ".join(filter(None, ids)) or "none"
        raise _wrong(f"no shape has the id {only!r}{suggestion(only, ids)}; ids are {there}")
    found: list[Floats] = []
    for element, place in _elements(root, _page(root), parse_transform, only):
        try:
            drawn = read_path(CONVERSIONS[_name(element)](_rounded(element)), enlarge=True)
            lines = [arcs @ place.T for arcs in drawn]  # of homogeneous points
        except (SceneError, ValueError) as error:
            raise _wrong(f"{_called(element)} is no outline ({error})") from None
        found += lines if _style(element, "fill-rule") == "evenodd" else _nonzero(lines)
    if not found:
        raise _wrong("holds no outline; draw a path, rect, circle, ellipse or polygon")
    _check_apart(found)
    return found


def _wrong(what: str) -> SceneError:
    return SceneError(f"path.file: {what}")


def _name(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]


def _called(element: Any) -> str:
    name = element.get("id")
    return f"<{_name(element)}{f' id={name!r}' if name else ''}>"


def _style(element: Any, key: str) -> str:
    """Return a property from an element's style, or its attribute of that name."""
    found = re.search(rf"(?:^|;)\s*{key}\s*:\s*([^;]+)", element.get("style", ""))
    return (found[1] if found else element.get(key, "")).strip()


def _page(root: Any) -> Floats:
    """Return the matrix from a drawing's own units to metres, y upwards."""
    if _name(root) != "svg":
        raise _wrong(f"its first element is <{_name(root)}>, not <svg>; save it as plain SVG")
    size = [_length(root.get(key, "")) for key in ("width", "height")]
    box = [float(part) for part in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if part]
    if len(box) != 4 and size[1] is None:
        raise _wrong("has neither height nor viewBox, so its lower edge is not known; give one")
    if len(box) != 4:
        box = [0.0, 0.0, *((length or 1.0) / _UNITS["px"] for length in size)]
    if min(box[2:]) <= 0.0:
        raise _wrong(f"its viewBox {box} has no area")
    sizes = zip(size, box[2:], strict=True)
    scale = min((a / b for a, b in sizes if a is not None), default=_UNITS["px"])
    # a side that is left out keeps the proportions
    whole = [scale * b if a is None else a for a, b in zip(size, box[2:], strict=True)]
    x, y = (0.5 * (a - scale * b) for a, b in zip(whole, box[2:], strict=True))  # in the middle
    right, up = x - scale * box[0], whole[1] - y + scale * box[1]
    return np.array([[scale, 0.0, right], [0.0, -scale, up], [0.0, 0.0, 1.0]])


def _length(text: str) -> float | None:
    """Return a length (m); None for what is left out or a share of the screen."""
    found = re.match(r"\s*([-+\d.eE]+?)\s*(px|in|pt|pc|cm|mm|Q|)\s*$", text)
    if not text.strip() or text.strip().endswith("%") or text == "auto":
        return None
    if not found:
        raise _wrong(
            f"its size {text!r} is no length; give it in {', '.join(filter(None, _UNITS))}"
        )
    return float(found[1]) * _UNITS[found[2]]


def _elements(
    element: Any, place: Floats, transform: Any, only: str | None
) -> Iterator[tuple[Any, Floats]]:
    """Yield each outline of a drawing, or that of one id, and the matrix from it to metres."""
    for child in element:
        if only is not None and all(one.get("id") != only for one in child.iter()):
            continue
        name = _name(child)
        own = "}" not in str(child.tag) or "www.w3.org/2000/svg}" in str(child.tag)
        if not own or name in _SILENT or _style(child, "display") == "none":
            continue
        if name not in ("g", "a", *_OUTLINES):
            raise _wrong(f"{_called(child)} is no outline; turn it into a path, or remove it")
        for key in ("clip-path", "mask"):  # they hide a part of it
            if _style(child, key) not in ("", "none"):
                raise _wrong(f"{_called(child)} has a {key}; cut its outline in the drawing")
        try:
            inner = place @ transform(child.get("transform", ""), strict=True)
        except (ValueError, TypeError) as error:
            raise _wrong(f"{_called(child)}: its transform is not read ({error})") from None
        if name in ("g", "a"):
            yield from _elements(child, inner, transform, only)
        else:
            yield child, inner


def _rounded(element: Any) -> Any:
    """Return a rectangle whose corners are no rounder than its sides allow, as SVG draws it."""
    if _name(element) != "rect":
        return element
    given = dict(element.attrib)
    for key, other, side in (("rx", "ry", "width"), ("ry", "rx", "height")):
        radius = element.get(key, element.get(other))
        if radius not in (None, "auto"):
            given[key] = str(min(float(radius), 0.5 * float(element.get(side, 0))))
    return ElementTree.Element(element.tag, given)


def _polygon(arcs: Floats, count: int = 16) -> Polygon:
    return Polygon(tuple(map(tuple, flattened(arcs, count).tolist())))


def _nonzero(lines: list[Floats]) -> list[Floats]:
    """Return the lines of a path beside which the winding number is 0 on one side alone."""
    shapes = [_polygon(arcs) for arcs in lines]
    turns = np.array([1 if area_of(np.array(shape.corners)) > 0.0 else -1 for shape in shapes])
    starts = np.array([shape.corners[0] for shape in shapes])
    within = np.array([shape.contains(starts) for shape in shapes])
    np.fill_diagonal(within, False)
    outside = turns @ within
    return [
        arcs for arcs, a, b in zip(lines, outside, turns, strict=True) if (a == 0) != (a + b == 0)
    ]


def _check_apart(lines: list[Floats]) -> None:
    """Refuse outlines that cross: which of both is meant cannot be told by lines within lines."""
    for inner, outer in permutations([_polygon(arcs) for arcs in lines], 2):
        inside = outer.contains(np.array(inner.corners))
        if inside.any() and not inside.all():
            x, y = np.array(inner.corners)[int(np.argmax(inside))]
            raise _wrong(
                f"two outlines cross or touch near ({x:.4g}, {y:.4g}) m; join them into one path "
                "in the drawing"
            )


_PARTS = [
    re.compile(rf"[\s,]*({part})")
    for part in ("[MmLlHhVvCcSsQqTtAaZz]", "[01]", r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
]
"""Of a path: commands, flags and numbers."""
_COUNT = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
EMBEDDED_DRAWING = "data:image/svg+xml;base64,"
"""What a drawing starts with that a scene carries with it, in place of a path (RFC 2397)."""


@dataclass(frozen=True)
class PathShape(Shape):
    """What the closed lines of a path hold (even-odd rule)."""

    text: str
    drawing: PathFile | None = None
    """Of which drawing the text is, and what of it is taken; None: it is path data."""

    @cached_property
    def _lines(self) -> list[Floats]:
        return read_drawing(self.text, self.drawing.id) if self.drawing else read_path(self.text)

    @property
    def in_pixels(self) -> bool:
        """Whether it is a drawing that names no unit."""
        page = re.search(r"<(\w+:)?svg\b[^>]*>", self.text) if self.drawing else None
        size = rf"\s(width|height)=.[\d.]+\s*({'|'.join(filter(None, _UNITS))})\W"
        return page is not None and not re.search(size, page[0])

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a drawing's file."""
        return EMBEDDED_DRAWING + b64encode(self.text.encode()).decode("ascii")

    def outline(self) -> list[Floats]:
        """Return its closed lines."""
        return self._lines

    @cached_property
    def _polygons(self) -> list[Polygon]:
        # The control points of a straight line lie at its ends.
        parts = [256 if (arcs[:, ::3] != arcs[:, 1:3]).any() else 1 for arcs in self._lines]
        return list(map(_polygon, self._lines, parts))

    @property
    def extent(self) -> Extent:
        """The bounding box."""
        low, high = zip(*(polygon.extent for polygon in self._polygons), strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def level(self, points: Points, reach: float) -> Floats:
        """Return how far (m) points lie outside, of 256 straight lines for a curve."""
        levels = np.array([polygon.level(points, reach) for polygon in self._polygons])
        nearest, odd = np.abs(levels).min(axis=0), (levels < 0.0).sum(axis=0) % 2 > 0
        return np.asarray(np.where(odd, -nearest, nearest))


def path_in(given: str | PathFile, where: str) -> PathShape:
    """Return what a path, an SVG file, or a text that a scene carries with it, draws."""
    if isinstance(given, str):
        shape = PathShape(given)
    elif given.file.startswith(EMBEDDED_DRAWING):
        embedded = b64decode(given.file.removeprefix(EMBEDDED_DRAWING))
        shape = PathShape(embedded.decode("utf-8"), given)
    else:
        text = text_of_file(given.file, SceneFileError, 20_000_000, key=f"{where}.file")
        shape = PathShape(text, given)
    try:
        shape.outline()
    except SceneError as error:
        raise SceneError(str(error).replace("path", where, 1)) from None
    return shape


def read_path(text: str, enlarge: bool = False) -> list[Floats]:
    """Return the closed lines of a path, each of shape (n, 4, 3); lines left open are closed.

    Arcs too small for their ends are made larger as SVG does, or refused as mistyped.
    """
    lines: list[list[Floats]] = []
    start: Place = (0.0, 0.0)
    here, handle, command, last, place = start, start, "", "", 0
    while text[place:].strip(" \t\r\n,"):
        if found := _PARTS[0].match(text, place):
            command, place = found[1], found.end()
        elif command in ("M", "m"):  # further places of a move are lines
            command = "L" if command == "M" else "l"
        kind = command.upper()
        if not command or (kind == "Z" and not found) or (not lines and kind != "M"):
            raise SceneError(f"path: is not a valid SVG path at {text[place : place + 20]!r}")
        given, place = _numbers(text, place, kind)
        origin = here if command.islower() else (0.0, 0.0)
        x, y = here
        places = given[5:] if kind == "A" else given
        at = [
            (origin[0] + a, origin[1] + b) for a, b in zip(places[::2], places[1::2], strict=False)
        ]
        if kind in "MZ":
            _close(lines, start, here)
            lines.append([])
            start = at[0] if at else start
        elif kind in "LHV":
            if kind == "H":
                at = [(origin[0] + given[0], y)]
            elif kind == "V":
                at = [(x, origin[1] + given[0])]
            lines[-1].append(line(here, at[-1]))
        elif kind == "A":
            lines[-1] += _elliptic(here, given, at[-1], enlarge)
        else:
            mirrored = (2 * x - handle[0], 2 * y - handle[1])
            smooth = mirrored if last in {"S": "CS", "T": "QT"}.get(kind, "") and last else here
            at = [smooth, *at] if kind in "ST" else at
            handle = at[-2]
            curve = conic(here, at[0], at[1], 1.0) if kind in "QT" else cubic(here, *at)
            lines[-1] += parted_at(curve, np.append(inflections(curve), 0.5))
        here, last = at[-1] if at else start, kind
        if sum(map(len, lines)) > 10_000:
            raise SceneError("path: has more than 10,000 curves; draw it as an image")
    _close(lines, start, here)
    if not (kept := [np.array(arcs) for arcs in lines if len(arcs) > 1]):
        raise SceneError("path: encloses nothing; write one such as M 0 0 H 1 V 1 Z")
    return kept


def _numbers(text: str, place: int, kind: str) -> tuple[list[float], int]:
    """Return what a command takes, and where the text goes on."""
    given = []
    for k in range(_COUNT[kind]):
        if not (found := _PARTS[1 if kind == "A" and k in (3, 4) else 2].match(text, place)):
            raise SceneError(f"path: {kind} takes {_COUNT[kind]} numbers, at {text[place:][:20]!r}")
        given.append(float(found[1]))
        place = found.end()
    return given, place


def _close(lines: list[list[Floats]], start: Place, here: Place) -> None:
    """Close the line in hand, and leave out what has no length but by rounding."""
    if not lines or not lines[-1]:
        return
    arcs = np.array([*lines[-1], line(here, start)])
    points = arcs[:, :, :2]  # ends have a weight of 1
    length = np.ptp(points, axis=1).max(axis=1)
    kept = arcs[length > 1e-9 * np.ptp(points.reshape(-1, 2), axis=0).max()]
    kept[:, 3, :2] = np.roll(kept[:, 0, :2], -1, axis=0)
    lines[-1] = list(kept)


def _elliptic(start: Place, given: list[float], end: Place, enlarge: bool) -> list[Floats]:
    """Return a part of an ellipse by its ends, radii and turn, as in SVG's appendix B.2.4."""
    p, q, turn = np.array(start), np.array(end), np.deg2rad(given[2])
    radii = np.abs(given[:2])
    if not (p - q).any():
        return []
    if not radii.all():
        return [line(start, end)]
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * radii[:, None]
    to_circle = np.linalg.inv(axes)
    u, v = p @ to_circle, q @ to_circle
    half = 0.5 * (v - u)
    length = np.hypot(*half)
    if length > 1.001 and not enlarge:
        least = f"{np.hypot(*(p - q)):g} apart; give {length * radii[0]:.4g} or more"
        raise SceneError(
            f"path: an arc's radius of {radii[0]:g} is too small for its ends, {least}"
        )
    if length > 1.0:
        axes, u, v, half = axes * length, u / length, v / length, half / length
        length = 1.0
    side = 1.0 if given[3] != given[4] else -1.0
    away = side * np.sqrt(max(1.0 / length**2 - 1.0, 0.0))
    centre = 0.5 * (u + v) + away * np.array([-half[1], half[0]])
    first, last = (np.arctan2(*(at - centre)[::-1]) for at in (u, v))
    sweep = (last - first) % (2 * np.pi) - (0.0 if given[4] else 2 * np.pi)
    count = int(np.ceil(abs(sweep) / (np.pi / 2) - 1e-9))
    angles = first + sweep * np.arange(count + 1) / count
    at = [centre + np.array([np.cos(t), np.sin(t)]) for t in angles]
    at[0], at[-1] = u, v
    weight = np.cos(0.5 * sweep / count)
    arcs = []
    for a, b in pairwise(at):
        tip = centre + (0.5 * (a + b) - centre) / weight**2
        arcs.append(conic(a @ axes, tip @ axes, b @ axes, weight))
    arcs[0][0, :2], arcs[-1][3, :2] = start, end
    return arcs
