"""Regions as they are described: a shape, and what fills it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from kaju.errors import ParameterError, SceneError

from .described import Coordinate, Described, Length, Text, one_given
from .lattice import Lattice
from .pictures import read_pixels
from .shapes import Ball, Box, Mask, Polygon, Shape

Point = tuple[Coordinate, ...]

_SHAPES = ("box", "disk", "ball", "polygon", "image")
ONE_SHAPE = "box: a region has exactly one shape of"

MOST_CORNERS = 10_000
"""Every cell near a polygon is held against every edge of it."""


class Round(Described):
    """A disk or a ball: centre (m) and radius (m)."""

    centre: Point = Field(description="the middle (m), such as [0.1, 0.1]")
    radius: Length = Field(description="the radius (m), such as 0.02")


class RegionImage(Described):
    """The dark pixels of an image, stretched over a box or over the whole array."""

    file: Text = Field(description="the path of an image, such as 'hole.png'")
    box: tuple[Point, Point] | None = Field(
        default=None, description="the lower and the upper corner (m) that the image fills"
    )

    def mask(self, lattice: Lattice, where: str) -> Mask:
        """Return the dark pixels, in their place."""
        pixels = read_pixels(self.file, f"{where}.file").astype(np.float32)
        brightness = pixels[:, :, :3] @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
        dark = (brightness < 128.0) & (pixels[:, :, 3] >= 128.0)
        whole = ((0.0,) * lattice.dimension, lattice.extent)
        return Mask(_box(self.box or whole, lattice, f"{where}.box"), dark[::-1].T)


class Region(Described):
    """A part of the array, filled with something else. Later regions cover earlier ones.

    Exactly one shape; a cell belongs to it if its centre lies inside or on the edge.

    Parameters
    ----------
    material : str
        A material's name, "air", "rigid" or "roller".
    box : pair of points, optional
        Lower and upper corner (m).
    disk : Round, optional
        Centre and radius (m), in two dimensions.
    ball : Round, optional
        Centre and radius (m), in three dimensions.
    polygon : tuple of points, optional
        Corners (m), in two dimensions.
    image : RegionImage, optional
        The dark pixels of an image, in two dimensions.
    outline : {"cells", "true"}
        "cells" makes it a staircase of cells; "true" keeps the shape as it is, for `kaju.solve`
        alone.
    name : str, optional
        What loads call its outline.
    """

    material: Text = Field(description='a material\'s name, "air", "rigid" or "roller"')
    box: tuple[Point, Point] | None = Field(
        default=None, description="the lower and the upper corner (m), such as [[0, 0], [0.1, 0.2]]"
    )
    disk: Round | None = None
    ball: Round | None = None
    polygon: tuple[Point, ...] | None = Field(
        default=None,
        min_length=3,
        max_length=MOST_CORNERS,
        description="the corners (m), three or more; finer shapes are drawn as an image",
    )
    image: RegionImage | None = None
    outline: Literal["cells", "true"] = Field(
        default="cells", description='"cells" for a staircase of cells, "true" for the shape itself'
    )
    name: Text | None = Field(default=None, description="what loads call the region's outline")

    @model_validator(mode="after")
    def _one_shape(self) -> Region:
        shape = one_given(self, _SHAPES, ONE_SHAPE)
        if self.outline == "true" and shape in ("ball", "image"):
            raise ParameterError(
                f'outline: "true" is known of disk, polygon and box, not of {shape}; leave it out'
            )
        return self

    def shape_in(self, lattice: Lattice, where: str) -> Shape:
        """Return the region's shape in the array of `lattice`."""
        name = one_given(self, _SHAPES, ONE_SHAPE)
        if name == "ball" and lattice.dimension == 2:
            raise SceneError(f"{where}.ball: belongs to three dimensions; use disk")
        if name in ("disk", "polygon", "image") and lattice.dimension == 3:
            raise SceneError(f"{where}.{name}: belongs to two dimensions; use box or ball")
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
            return self.image.mask(lattice, where)
        circle = self.disk or self.ball
        assert circle is not None
        _check_dimension(circle.centre, lattice, where)
        return Ball(circle.centre, circle.radius)


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
