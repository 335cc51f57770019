"""Shapes by samples, linear between them: grey images, arrays, distances sampled in Python."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import SceneError, SceneFileError, require

from .curves import polygonal
from .shapes import Box, Extent, Points, Relation, Shape

EMBEDDED_ARRAY = "data:application/x-npy;base64,"
"""What samples start with that a scene carries with it, in place of a path (RFC 2397)."""
EMBEDDED_PIXELS = "data:application/x-npy;samples=middles;base64,"
"""The same, if they lie in the middles of pixels."""


def sampled_shape(
    distance: Callable[[Floats], Any],
    lower: tuple[float, ...],
    upper: tuple[float, ...],
    samples: Sequence[int],
) -> dict[str, Any]:
    """Return an `image` for a region: the place where a function is not above 0.

    The body is where samples, bilinear (in space trilinear) between them, are not above 0. A true
    outline is straight from one line of samples to the next.

    Parameters
    ----------
    distance : callable
        A function of points (m), shape (n, 2) or (n, 3); below 0 within the body, such as a signed
        distance.
    lower, upper : point
        Corners (m) of the box that is sampled; there is no body outside of it.
    samples : two or three of int
        Samples along x, y (and z), two or more, those on the sides included.

    Returns
    -------
    dict
        For `Scene.with_region(material, image=image, outline="true")`.

    Examples
    --------
    >>> import numpy as np
    >>> from kaju import Scene, sampled_shape
    >>> def wavy(points):
    ...     away, angle = np.hypot(*points.T), np.arctan2(*points.T)
    ...     return away - 0.05 - 0.005 * np.cos(8 * angle)
    >>> body = {"size": [0.1, 0.1], "cells": [8, 8], "material": "steel"}
    >>> scene = Scene(body=body, sides={"left": "rigid"})
    >>> image = sampled_shape(wavy, (0.0, 0.0), (0.1, 0.1), (65, 65))
    >>> scene.with_region("air", image=image, outline="true").outlined
    True
    """
    count = len(samples)
    told = f"samples: two or more along each axis are needed, got {samples!r}"
    require(count in (2, 3) and min(samples) >= 2, told)
    boxed = len(lower) == len(upper) == count and np.all(np.array(lower) < np.array(upper))
    told = f"upper: {upper!r} must be above lower, {lower!r}, along each of {count} axes"
    require(bool(boxed), told)
    axes = [np.linspace(lower[a], upper[a], samples[a]) for a in range(count)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, count)
    found = np.asarray(distance(points), dtype=np.float64)
    numbers = found.shape == (len(points),) and bool(np.isfinite(found).all())
    told = f"distance: {len(points)} finite numbers are needed, got shape {found.shape}"
    require(numbers, told)
    text = embedded_array(-found.reshape(tuple(samples)))
    return {"file": text, "box": (tuple(lower), tuple(upper)), "level": 0.0}


def embedded_array(values: Floats, start: str = EMBEDDED_ARRAY) -> str:
    """Return a text for which `read_embedded` gives the values."""
    file = BytesIO()
    np.save(file, values, allow_pickle=False)
    return start + b64encode(file.getvalue()).decode("ascii")


def read_embedded(text: str, key: str) -> NDArray[Any]:
    """Return numbers from a text."""
    try:
        file = BytesIO(b64decode(text.partition(",")[2], validate=True))
        return np.asarray(np.load(file, allow_pickle=False))
    except (ValueError, EOFError, OSError):
        raise SceneFileError(
            f"{key}: the embedded numbers cannot be read; write the scene again from its file"
        ) from None


def checked(values: NDArray[Any], key: str, dimension: int) -> Floats:
    """Return samples as numbers."""
    numbers = values.dtype.kind in "fiub" and values.ndim == dimension
    if not numbers or min(values.shape) < 2:
        axes = " and ".join("xyz"[:dimension])
        raise SceneFileError(f"{key}: numbers along {axes} are needed, got shape {values.shape}")
    out = np.asarray(values, dtype=np.float64)
    if not np.isfinite(out).all():
        raise SceneFileError(f"{key}: holds numbers that are not finite; replace them")
    return out


@dataclass(frozen=True, eq=False)
class SampledShape(Shape):
    """Where samples, bilinear (in space trilinear) between them, are not below a level."""

    box: Box  # beyond which there is nothing of it
    values: Floats  # indexed [x, y] or [x, y, z]
    at_least: float
    middles: bool = False
    """Whether samples lie in the middles of pixels, and stay the same up to the sides of the box.
    Else the first and the last samples lie on its sides."""

    @property
    def extent(self) -> Extent:
        """The samples' box."""
        return self.box.extent

    def embedded(self) -> str:
        """Return what a scene carries with it in place of a file."""
        return embedded_array(self.values, EMBEDDED_PIXELS if self.middles else EMBEDDED_ARRAY)

    @cached_property
    def _grid(self) -> tuple[list[Floats], Floats]:
        """Return the samples' places along each axis (m), and how far they are above the level."""
        places, values = [], self.values
        for low, high, count in zip(self.box.lower, self.box.upper, values.shape, strict=True):
            if self.middles:
                inner = low + (high - low) * (np.arange(count) + 0.5) / count
                places.append(np.array([low, *inner, high]))
            else:
                places.append(np.linspace(low, high, count))
        if self.middles:
            values = np.pad(values, 1, mode="edge")
        above = values - self.at_least
        if above.ndim == 2:  # an outline must not run through a sample
            least = 1e-6 * np.abs(above).max()
            above = np.where(np.abs(above) < least, np.where(above < 0.0, -least, least), above)
        return places, above

    def _in_steps(self, points: Points) -> list[Floats]:
        """Return points' coordinates in steps from sample to sample, kept within the box."""
        columns = zip(points.T, self._grid[0], strict=True)
        return [np.interp(column, places, np.arange(len(places))) for column, places in columns]

    def _sampled(self, places: Sequence[Floats]) -> Floats:
        """Return how far the interpolated samples are above the level, at places in steps."""
        from scipy.ndimage import map_coordinates

        found = map_coordinates(
            self._grid[1], np.broadcast_arrays(*places), order=1, mode="nearest"
        )
        return np.asarray(found)

    def level(self, points: Points, reach: float) -> Floats:
        """Return how much lower than the level the samples are, at least what is beyond the box."""
        below = -self._sampled(self._in_steps(points))
        return np.asarray(np.maximum(below, self.box.level(points, reach)))

    def relation(self, low: Points, high: Points) -> Relation:
        """Tell how boxes lie to the shape."""
        # Between samples, and where a box ends, a trilinear function is largest at corners.
        inside, apart = self.box.relation(low, high)
        some = np.flatnonzero(~apart)
        if len(some):
            ends = list(zip(self._in_steps(low[some]), self._in_steps(high[some]), strict=True))
            many = int(np.ceil(max((b - a).max() for a, b in ends))) + 1
            places = []
            for axis, (a, b) in enumerate(ends):
                steps = np.clip(
                    np.floor(a[:, None]) + np.arange(many + 1.0), a[:, None], b[:, None]
                )
                along = np.ones(1 + len(ends), dtype=np.int64)
                along[[0, 1 + axis]] = steps.shape
                places.append(steps.reshape(along))
            found = self._sampled(places).reshape(len(some), -1)
            inside[some] &= found.min(axis=1) >= 0.0
            apart[some] = found.max(axis=1) < 0.0
        return inside, apart

    def outline(self) -> list[Floats]:
        """Return its closed lines, straight from one line of the grid to the next."""
        from contourpy import contour_generator

        places, above = self._grid
        places = [np.array([line[0], *line, line[-1]]) for line in places]
        above = np.pad(above, 1, constant_values=-np.abs(above).max())  # nothing beyond the box
        if not (lines := contour_generator(z=above.T).lines(0.0)):
            raise SceneError(f"level: nothing is above {self.at_least:g}; take another level")
        steps = [np.arange(len(line)) for line in places]
        found = (map(np.interp, np.asarray(line).T, steps, places) for line in lines)
        return [polygonal(zip(*line, strict=True)) for line in found]
