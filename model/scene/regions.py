"""Regions as they are described: a shape, and what fills it."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from kaju.errors import ParameterError, SceneError
from kaju.model.scene.validation import Coordinate, Described, Length, Number, Text, one_given

from .lattice import Lattice
from .level_sets import EMBEDDED_ARRAY, LevelSet, checked, read_embedded
from .pictures import read_array, read_pixels
from .shapes import Ball, Box, Ellipse, Mask, Polygon, Ring, RoundedBox, Shape
from .solids import Cylinder, SampledSolid
from .surfaces import surface_from
from .svg_path import PathShape

Point = tuple[Coordinate, ...]

_SHAPES = (
    "box",
    "disk",
    "ball",
    "cylinder",
    "surface",
    "ring",
    "ellipse",
    "slot",
    "rounded_box",
    "polygon",
    "path",
    "image",
)
_SPACE = ("ball", "cylinder", "surface")
ONE_SHAPE = "box: a region has exactly one shape of"

MOST_CORNERS = 10_000
"""Every cell near a polygon is held against every edge of it."""


class Round(Described):
    """A disk or a ball: centre (m) and radius (m)."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    radius: Length = Field(description="the radius (m), such as 0.02")


class CylinderTable(Described):
    """What lies up to a radius from a straight line, between flat ends."""

    ends: tuple[Point, Point] = Field(description="the middles of both ends (m)")
    radius: Length = Field(description="the radius (m), such as 0.02")


class SurfaceTable(Described):
    """The inside of a closed surface of triangles, from an STL file."""

    file: Text = Field(description="the path of an STL file, such as 'part.stl'")
    scale: Length = Field(default=1.0, description="what its unit of length is (m): 0.001 for mm")

    @model_validator(mode="before")
    @classmethod
    def _from_path(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value


class RingTable(Described):
    """What lies between two circles: centre (m), and both radii (m)."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    inner: Length = Field(description="the smaller radius (m)")
    outer: Length = Field(description="the larger radius (m)")

    @model_validator(mode="after")
    def _between(self) -> RingTable:
        if self.inner >= self.outer:
            raise ParameterError(f"inner: {self.inner:g} m must be below outer, {self.outer:g} m")
        return self


class RoundEllipse(Described):
    """An ellipse: its middle, its half-axes, and the angle of the first one to the x axis."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    radii: tuple[Length, Length] = Field(description="both half-axes (m), such as [0.03, 0.01]")
    angle: Number = Field(default=0.0, description="from the x axis to the first one (degrees)")


class Slot(Described):
    """All points up to a radius from a straight line."""

    ends: tuple[Point, Point] = Field(description="where its rounded ends have their middles (m)")
    radius: Length = Field(description="half of its width (m), such as 0.01")


class BoxWithRadius(Described):
    """A box whose corners are parts of circles."""

    box: tuple[Point, Point] = Field(description="the lower and the upper corner (m)")
    radius: Length = Field(description="the radius of its corners (m), such as 0.01")


class RegionImage(Described):
    """The dark part of an image, stretched over a box or over the whole array."""

    file: Text = Field(description="the path of an image, such as 'hole.png'")
    """The path of an image, or of an ``.npy`` array of numbers, indexed [x, y]."""
    box: tuple[Point, Point] | None = Field(
        default=None, description="the lower and the upper corner (m) that the image fills"
    )
    """The corners (m) that it fills."""
    level: Number | None = Field(
        default=None, description="how dark a place must be, from 0 to 1, such as 0.5"
    )
    """How dark, from 0 to 1, a place must be, bilinear between the middles of pixels; or how large
    a number, bilinear between samples, of which the outer ones lie on the sides of the box. Without
    one, cells take pixels that are darker than 0.5; true outlines and arrays take 0.5."""

    def shape_in(self, lattice: Lattice, where: str, level: float | None) -> Shape:
        """Return its dark pixels, or where it reaches a level, in their place."""
        whole = ((0.0,) * lattice.dimension, lattice.extent)
        box = _box(self.box or whole, lattice, f"{where}.box")
        key, array = f"{where}.file", self.file.endswith(".npy")
        if array or self.file.startswith(EMBEDDED_ARRAY):
            values = read_array(self.file, key) if array else read_embedded(self.file, key)
            samples = checked(values, key, lattice.dimension)
            level = 0.5 if level is None else level
            if lattice.dimension == 3:
                return SampledSolid(box, samples, level)
            return LevelSet(box, samples, level)
        if lattice.dimension == 3:
            raise SceneError(f"{key}: pixels belong to two dimensions; give an .npy array")
        pixels = read_pixels(self.file, key)
        weights = np.array([0.299, 0.587, 0.114], dtype=np.float32)
        brightness = pixels[:, :, :3].astype(np.float32) @ weights
        if level is None:
            dark = (brightness < 128.0) & (pixels[:, :, 3] >= 128.0)
            return Mask(box, dark[::-1].T)
        darkness = (1.0 - brightness.astype(np.float64) / 255.0) * pixels[:, :, 3] / 255.0
        return LevelSet(box, darkness[::-1].T, level, pixels)


class Region(Described):
    """A part of the array, filled with something else. Later regions cover earlier ones.

    Exactly one shape; a cell belongs to it if its centre lies inside or on the edge.
    """

    material: Text = Field(description='a material\'s name, "air", "rigid" or "roller"')
    """A material's name, "air", "rigid" or "roller"."""
    box: tuple[Point, Point] | None = Field(
        default=None, description="the lower and the upper corner (m), such as [[0, 0], [0.1, 0.2]]"
    )
    """Lower and upper corner (m)."""
    disk: Round | None = None
    """Centre and radius (m), in two dimensions."""
    ball: Round | None = None
    """Centre and radius (m), in three dimensions."""
    cylinder: CylinderTable | None = None
    """Ends of its axis, and radius (m), in three dimensions."""
    surface: SurfaceTable | None = None
    """A closed surface of triangles, in three dimensions: an STL file, and the unit of its numbers
    (m). It is the body: no arc is guessed behind its triangles."""
    ring: RingTable | None = None
    """Centre, inner and outer radius (m), in two dimensions."""
    ellipse: RoundEllipse | None = None
    """Centre and half-axes (m), and the angle (degrees) of the first one, in two dimensions."""
    slot: Slot | None = None
    """Ends of its middle line, and radius (m), in two dimensions."""
    rounded_box: BoxWithRadius | None = None
    """A box, and the radius (m) of its corners, in two dimensions."""
    polygon: tuple[Point, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=MOST_CORNERS,
        description="the corners (m), three or more; finer shapes are drawn as an image",
    )
    """Corners (m), in two dimensions."""
    path: Text | None = Field(
        default=None,
        max_length=1_000_000,
        description="path data of SVG (m, y upwards), such as 'M 0 0 H 0.1 V 0.1 Z'",
    )
    """Path data of SVG in the array's coordinates (m, y upwards), in two dimensions. Lines within a
    line go round holes."""
    image: RegionImage | None = None
    """The dark pixels of an image, in two dimensions; where samples reach a level, in either."""
    outline: Literal["cells", "true"] = Field(
        default="cells", description='"cells" for a staircase of cells, "true" for the shape itself'
    )
    """"cells" makes it a staircase of cells; "true" keeps the shape as it is, for `kaju.solve`
    alone."""
    name: Text | None = Field(default=None, description="what loads call the region's outline")
    """What loads call its outline."""

    @model_validator(mode="after")
    def _one_shape(self) -> Region:
        one_given(self, _SHAPES, ONE_SHAPE)
        return self

    def shape_in(self, lattice: Lattice, where: str) -> Shape:
        """Return the region's shape in the array of `lattice`."""
        name = one_given(self, _SHAPES, ONE_SHAPE)
        if name in _SPACE and lattice.dimension == 2:
            raise SceneError(f"{where}.{name}: belongs to three dimensions; use disk or box")
        if name not in ("box", "image", *_SPACE) and lattice.dimension == 3:
            raise SceneError(
                f"{where}.{name}: belongs to two dimensions; use box, {', '.join(_SPACE)} or image"
            )
        shape = self._shape(lattice, f"{where}.{name}")
        _check_place(shape, lattice, f"{where}.{name}")
        return shape

    def _shape(self, lattice: Lattice, where: str) -> Shape:
        if self.box is not None:
            return _box(self.box, lattice, where)
        if self.polygon is not None:
            for corner in self.polygon:
                _check_dimension(corner, lattice, where)
            return Polygon(self.polygon)
        if self.image is not None:
            level = self.image.level
            if level is None and self.outline == "true":
                level = 0.5
            return self.image.shape_in(lattice, where, level)
        if self.path is not None:
            return PathShape(self.path)
        if self.slot is not None:
            for end in self.slot.ends:
                _check_dimension(end, lattice, where)
            if self.slot.ends[0] == self.slot.ends[1]:
                raise SceneError(f"{where}.ends: are one point; use disk")
            return RoundedBox(tuple(_plane(end) for end in self.slot.ends), self.slot.radius)
        if self.rounded_box is not None:
            return _rounded(self.rounded_box, lattice, where)
        if self.surface is not None:
            return surface_from(self.surface.file, f"{where}.file", self.surface.scale)
        if self.cylinder is not None:
            for end in self.cylinder.ends:
                _check_dimension(end, lattice, where)
            if self.cylinder.ends[0] == self.cylinder.ends[1]:
                raise SceneError(f"{where}.ends: are one point; take two")
            return Cylinder(self.cylinder.ends, self.cylinder.radius)
        circle = self.disk or self.ball or self.ring or self.ellipse
        assert circle is not None
        _check_dimension(circle.centre, lattice, where)
        if isinstance(circle, RingTable):
            return Ring(circle.centre, circle.inner, circle.outer)
        if isinstance(circle, RoundEllipse):
            return Ellipse(_plane(circle.centre), circle.radii, float(np.deg2rad(circle.angle)))
        return Ball(circle.centre, circle.radius)


def _plane(point: Point) -> tuple[float, float]:
    x, y = point
    return x, y


def _rounded(given: BoxWithRadius, lattice: Lattice, where: str) -> RoundedBox:
    box, radius = _box(given.box, lattice, f"{where}.box"), given.radius
    if not all(2 * radius < b - a for a, b in zip(box.lower, box.upper, strict=True)):
        raise SceneError(f"{where}.radius: {radius:g} must be below half of each edge; use slot")
    (x0, y0), (x1, y1) = box.lower, box.upper
    x0, y0, x1, y1 = x0 + radius, y0 + radius, x1 - radius, y1 - radius
    return RoundedBox(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), radius)


def _check_dimension(point: Point, lattice: Lattice, where: str) -> None:
    if len(point) != lattice.dimension:
        raise SceneError(
            f"{where}: {list(point)} should have {lattice.dimension} coordinates, one for each "
            "axis of the cells"
        )


def _box(corners: tuple[Point, Point], lattice: Lattice, where: str) -> Box:
    for corner in corners:
        _check_dimension(corner, lattice, where)
    lower, upper = corners
    if not all(low < high for low, high in zip(lower, upper, strict=True)):
        raise SceneError(
            f"{where}: goes from {list(lower)} to {list(upper)}; the first corner must be the "
            "lower one along every axis"
        )
    return Box(lower, upper)


def _check_place(shape: Shape, lattice: Lattice, where: str) -> None:
    lower, upper = shape.extent
    if np.any(upper <= lower):
        raise SceneError(f"{where}: has no extent; its corners lie on one line")
    if np.any(upper < 0.0) or np.any(lower > np.asarray(lattice.extent)):
        raise SceneError(
            f"{where}: lies outside the array, which goes from 0 to "
            f"{[float(f'{edge:.6g}') for edge in lattice.extent]} m"
        )
