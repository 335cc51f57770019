"""Regions as they are described: a shape, and what fills it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from kaju.errors import SceneError
from kaju.model.scene.validation import (
    Described,
    Length,
    Number,
    Text,
    check_axes,
    one_given,
    optional,
)

from .lattice import Lattice
from .level_sets import (
    EMBEDDED_ARRAY,
    EMBEDDED_PIXELS,
    SampledShape,
    checked,
    read_embedded,
)
from .pictures import read_array, read_darkness, read_layers
from .shapes import (
    Ball,
    Box,
    Cylinder,
    Ellipse,
    Point,
    Polygon,
    Ring,
    RoundedBox,
    Shape,
    Slot,
)
from .surfaces import surface_from
from .svg_path import PathShape, drawing_in

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
    """All outlines of an SVG drawing, from the lower left corner of its page."""

    file: Text = Field(description="the path of an SVG file, such as 'drawing.svg'")


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
    box: tuple[Point, Point] | None = optional(
        "the lower and the upper corner (m) that the image fills"
    )
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
            raise SceneError(
                f"{key}: pixels belong to two dimensions; give a TIFF of layers, or an .npy array"
            )
        return SampledShape(box, checked(values, key, lattice.dimension), self.level, middles)


class _Shaped(Described):
    """Exactly one shape, of those that loads and regions share."""

    box: tuple[Point, Point] | None = optional(
        "the lower and the upper corner (m), such as [[0, 0], [0.1, 0.2]]"
    )
    disk: Ball | None = None
    ball: Ball | None = None
    ring: Ring | None = None
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
        return one_given(self, names, "box: a region has exactly one shape of")

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
            raise SceneError(
                f"{where}: belongs to two dimensions; use {', '.join(names[:-1])} or {names[-1]}"
            )
        if name == "path":
            file = given.file if isinstance(given, PathFile) else None
            return drawing_in(file, f"{where}.file") if file else PathShape(given)
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

    material: Text = Field(description='a material\'s name, "air", "rigid" or "roller"')
    cylinder: Cylinder | None = None
    surface: SurfaceFile | None = None  # no arc is guessed behind its triangles
    ellipse: Ellipse | None = None
    slot: Slot | None = None
    rounded_box: RoundedBox | None = None
    path: Annotated[str | PathFile | None, BeforeValidator(_path)] = optional(
        "path data of SVG (m, y upwards), such as 'M 0 0 H 0.1 V 0.1 Z', or {file = 'a.svg'}"
    )
    # Lines within a line go round holes.
    image: RegionImage | None = None
    outline: Literal["cells", "true"] = Field(
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
        return shape


class LoadRegion(_Shaped):
    """A shape that selects what a load acts on; exactly one.

    A box without thickness along one axis selects the surface of the body on that plane. Of
    all other shapes a pressure, or a couple, takes the free faces whose middles lie inside, such
    as the edge of a hole; a force takes the cells inside.
    """

    def flat_axis(self, lattice: Lattice, where: str) -> int | None:
        """Return the axis along which the box has no thickness, None if it has volume."""
        assert self.box is not None
        lower, upper = _box(self.box, lattice, where, flat=True).extent
        flat = np.flatnonzero(upper - lower <= 1e-6 * lattice.cell_size).tolist()
        if len(flat) > 1:
            raise SceneError(
                f"{where}: has no thickness along {' and '.join('xyz'[axis] for axis in flat)}; "
                "a surface has none along one axis only; for a point use point = [...]"
            )
        return flat[0] if flat else None


def reach_of(shape: Shape, lattice: Lattice, asked: str = METRES) -> str:
    """Say from where to where a shape reaches, and the array."""
    ends = (", ".join(f"{x:.4g}" for x in at) for at in (*shape.extent, lattice.extent))
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
