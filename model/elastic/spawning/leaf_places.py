"""Places in a body of agents: points with weights, on which the mean over a place is taken."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import KajuError, ParameterError
from kaju.model.scene.body_cells import body_cells
from kaju.model.scene.regions import Region
from kaju.model.scene.shapes import Box, Shape

from .composite import Composite
from .ground import Ground
from .quantities import Place

NEAR = 1e-6
"""A plane that is nearer to a face than this part of a cell lies on it."""
SAMPLES = {2: 8, 3: 4}
"""Points along an agent by which round shapes are measured in it."""
PARTED = 4
"""Places are made up of agents if they end at multiples of this part of a cell."""
MANY = 10_000
"""Agents that are measured at a time."""


class Spots(NamedTuple):
    """Points that stand for parts of a place."""

    points: Floats  # The middles of the parts (units). Shape (n, dimension)
    leaf: Ints  # A leaf in or on which each lies. Shape (n,)
    weight: Floats  # Adds up to 1. Shape (n,)
    span: Floats  # How far each part reaches along every axis (units). Shape (n, dimension)


class Parts(NamedTuple):
    """Leaves of which a place is made up exactly, or sides of theirs."""

    leaf: Ints
    side: Ints
    """Side -1 is the whole leaf. Shape (n,)."""
    share: Floats  # Of the place; adds up to 1. Shape (n,)
    cut: Flags
    """Leaves on both sides of the place's rim: as long as there are any, it is not made up. Shape
    (leaves,)."""


class Points(NamedTuple):
    """A single point (units), in a cell (units)."""

    point: Floats
    unit: Ints

    def spots(self, grid: Composite) -> Spots:
        """Return the point."""
        leaf = grid.leaves.find(self.unit)
        return Spots(self.point, leaf, np.ones(1), np.zeros_like(self.point))

    def coarse(self, grid: Composite) -> Flags:
        """Tell of no leaf."""
        return np.zeros(len(grid.leaves), dtype=np.bool_)

    def parts(self, grid: Composite) -> str:
        """Return why no leaves make it up."""
        return "no energy bounds the value at a point; ask for the mean of a box round it"


class Solid(NamedTuple):
    """A shape with a volume, from `lower` to `upper` (units); `metre` is a unit."""

    shape: Shape
    lower: Floats
    upper: Floats
    metre: float

    def spots(self, grid: Composite) -> Spots:
        """Return the middle of the shape's part in every leaf, weighted by its volume."""
        leaf = np.flatnonzero(self._reached(grid))
        low = grid.leaves.lower[leaf].astype(np.float64)
        size = grid.leaves.size[leaf, None].astype(np.float64)
        if isinstance(self.shape, Box):
            first, last = np.maximum(low, self.lower), np.minimum(low + size, self.upper)
            return _weighted(0.5 * (first + last), leaf, (last - first).prod(axis=1), last - first)
        parts = [
            self._measured(low[at : at + MANY], size[at : at + MANY])
            for at in range(0, len(leaf), MANY)
        ]
        middle, share = (np.concatenate(column) for column in zip(*parts, strict=True))
        held = share > 0.0
        volume = share * size[:, 0] ** grid.dimension
        span = np.where(share == 1.0, size[:, 0], 0.0)[:, None] * np.ones(grid.dimension)
        return _weighted(middle[held], leaf[held], volume[held], span[held])

    def coarse(self, grid: Composite) -> Flags:
        """Tell which leaves in reach are larger than the shape, or a quarter if it is round."""
        widest = (self.upper - self.lower).min() / (1 if isinstance(self.shape, Box) else 4)
        return np.asarray(self._reached(grid) & (grid.leaves.size > widest))

    def parts(self, grid: Composite) -> Parts | str:
        """Return the leaves in a box."""
        if not isinstance(self.shape, Box):
            return "agents do not make up a round or slanted place; ask for the mean of a box"
        ends = _on_edges(self.lower, self.upper, grid)
        if isinstance(ends, str):
            return ends
        low, high = grid.leaves.lower, grid.leaves.lower + grid.leaves.size[:, None]
        inside = np.all((low >= ends[0]) & (high <= ends[1]), axis=1)
        cut = np.all((low < ends[1]) & (high > ends[0]), axis=1) & ~inside
        leaf = np.flatnonzero(inside)
        return _made_up(leaf, np.full(len(leaf), -1), grid.length[leaf] ** grid.dimension, cut)

    def _reached(self, grid: Composite) -> Flags:
        low, high = grid.leaves.lower, grid.leaves.lower + grid.leaves.size[:, None]
        return np.asarray(np.all((low < self.upper) & (high > self.lower), axis=1))

    def _measured(self, low: Floats, size: Floats) -> tuple[Floats, Floats]:
        """Return the middle of the shape's part in boxes, and its share of each."""
        d = low.shape[1]
        ticks = (np.arange(SAMPLES[d]) + 0.5) / SAMPLES[d]
        offsets = np.array(list(product(ticks, repeat=d)))
        points = low[:, None] + offsets * size[:, None]
        inside = self.shape.contains(points.reshape(-1, d) * self.metre).reshape(points.shape[:2])
        count = inside.sum(axis=1)
        middle = (points * inside[..., None]).sum(axis=1) / np.maximum(count, 1)[:, None]
        return middle, count / len(offsets)


class Plane(NamedTuple):
    """A box without thickness: a section of the body, or a part of its surface (units)."""

    axis: int
    lower: Floats
    upper: Floats

    def spots(self, grid: Composite) -> Spots:
        """Return the middle of the plane's part in every leaf, weighted by its area."""
        axis, height = self.axis, self.lower[self.axis]
        leaf = np.flatnonzero(self._reached(grid))
        low = grid.leaves.lower[leaf].astype(np.float64)
        first = np.maximum(low, self.lower)
        last = np.minimum(low + grid.leaves.size[leaf, None], self.upper)
        middle = 0.5 * (first + last)
        middle[:, axis] = height
        area = np.delete(last - first, axis, axis=1).prod(axis=1)
        span = last - first
        span[:, axis] = 0.0
        return _weighted(middle, leaf, area, span)

    def coarse(self, grid: Composite) -> Flags:
        """Tell which leaves in reach are larger than the plane's part."""
        widest = np.delete(self.upper - self.lower, self.axis).min()
        return np.asarray(self._reached(grid) & (grid.leaves.size > widest))

    def parts(self, grid: Composite) -> Parts | str:
        """Return the sides on the plane: of the leaves below, or above where there are none."""
        ends = _on_edges(self.lower, self.upper, grid)
        if isinstance(ends, str):
            return ends
        axis, (first, last) = self.axis, ends
        low, high = grid.leaves.lower, grid.leaves.lower + grid.leaves.size[:, None]
        within, over = (low >= first) & (high <= last), (low < last) & (high > first)
        within[:, axis] = over[:, axis] = True
        below = high[:, axis] == first[axis]
        above = (low[:, axis] == first[axis]) & (grid.beside[:, 2 * axis] < 0)
        there = within.all(axis=1) & (below | above)
        across = (low[:, axis] < first[axis]) & (high[:, axis] > first[axis])
        cut = over.all(axis=1) & (across | ((below | above) & ~there))
        leaf = np.flatnonzero(there)
        side = 2 * axis + below[leaf]
        return _made_up(leaf, side, grid.length[leaf] ** (grid.dimension - 1), cut)

    def _reached(self, grid: Composite) -> Flags:
        """Tell which leaves have the plane in them or on top; below only, if nothing is there."""
        axis, height = self.axis, self.lower[self.axis]
        low, high = grid.leaves.lower, grid.leaves.lower + grid.leaves.size[:, None]
        beside = np.all(np.delete((low < self.upper) & (high > self.lower), axis, axis=1), axis=1)
        bare = grid.beside[:, 2 * axis] < 0
        within = (low[:, axis] < height) & (height <= high[:, axis])
        return np.asarray(beside & (within | ((low[:, axis] == height) & bare)))


Site = Points | Solid | Plane
"""A place, asked grid by grid: the points that stand for it, the leaves or sides that make it up
(in words why none ever do), and which leaves are too large for it to be seen."""


def _on_edges(lower: Floats, upper: Floats, grid: Composite) -> tuple[Floats, Floats] | str:
    """Return the ends of a place where agents that are small enough end as well."""
    step = max(grid.ground.cell // PARTED, grid.ground.smallest)
    ends = np.rint(lower / step) * step, np.rint(upper / step) * step
    off = max(float(np.abs(end - own).max()) for end, own in zip(ends, (lower, upper), strict=True))
    if off > NEAR * grid.ground.cell:
        return (
            f"its ends are no multiples of 1/{grid.ground.cell // step} of a cell, where agents "
            "could end as well"
        )
    return ends


def _made_up(leaf: Ints, side: Ints, share: Floats, cut: Flags) -> Parts:
    return Parts(leaf, side, share / (share.sum() or 1.0), cut)


def _weighted(points: Floats, leaf: Ints, weight: Floats, span: Floats) -> Spots:
    return Spots(points, leaf, weight / (weight.sum() or 1.0), span)


def located(ground: Ground, points: Floats, cells: Ints) -> tuple[Floats, Ints]:
    """Return points (m) that lie in or on cells in units, and a unit cell of each."""
    first = cells * ground.cell
    place = np.clip(points / _metre(ground), first, first + ground.cell)
    return place, np.clip(np.floor(place).astype(np.int64), first, first + ground.cell - 1)


def site_of(at: Place, ground: Ground) -> Site:
    """Return a place on some ground."""
    if isinstance(at, str):
        return _side(at, ground)
    if isinstance(at, dict):
        return _region(at, ground)
    d = ground.dimension
    if len(at) != d:
        raise ParameterError(
            f"tolerance_at: {list(at)} should have {d} coordinates (m), one for each axis of the "
            "cells"
        )
    point = np.array([at])
    inside = np.isfinite(point).all()
    if inside:
        cells, found = body_cells(ground.scene, point)
        inside = found.all()
    if not inside:
        raise ParameterError(f"tolerance_at: ({', '.join(f'{x:g}' for x in at)}) m {_OUTSIDE}")
    return Points(*located(ground, point, cells))


_OUTSIDE = "lies outside the body; choose a place in or on it"


def _metre(ground: Ground) -> float:
    return ground.scene.lattice.cell_size / ground.cell


def _side(name: str, ground: Ground) -> Site:
    lattice = ground.scene.lattice
    if name not in lattice.sides:
        raise ParameterError(
            f"tolerance_at: there is no side {name!r}{suggestion(name, lattice.sides)}; there is "
            f"{', '.join(lattice.sides)}, and 'displacement' for the largest error anywhere"
        )
    axis, upper = divmod(lattice.sides.index(name), 2)
    low, high = np.zeros(ground.dimension), np.asarray(lattice.shape) * float(ground.cell)
    low[axis] = high[axis] = high[axis] if upper else 0.0
    return Plane(axis, low, high)


def _region(region: dict[str, Any], ground: Ground) -> Site:
    lattice, metre = ground.scene.lattice, _metre(ground)
    flat = _flat_axis(region.get("box"), lattice.cell_size) if len(region) == 1 else None
    if flat is not None:
        low, high = (np.asarray(corner, dtype=np.float64) / metre for corner in region["box"])
        face = np.rint(low[flat])
        if abs(low[flat] - face) < NEAR * ground.cell:
            low[flat] = high[flat] = face
        return Plane(flat, low, high)
    try:
        shape = Region(material="air", **region).shape_in(lattice, "tolerance_at")
    except KajuError as error:
        told = str(error)
        told = told if told.startswith("tolerance_at") else f"tolerance_at: {told}"
        raise ParameterError(told) from None
    lower, upper = (np.asarray(corner) / metre for corner in shape.extent)
    return Solid(shape, lower, upper, metre)


def _flat_axis(box: Any, cell_size: float) -> int | None:
    """Return the one axis along which a box has no thickness."""
    corners = np.asarray(box, dtype=np.float64) if _is_box(box) else np.ones((1, 0))
    if len(corners) != 2:
        return None
    spans = corners[1] - corners[0]
    flat = np.flatnonzero(np.abs(spans) <= NEAR * cell_size)
    return int(flat[0]) if len(flat) == 1 and np.all(np.delete(spans, flat) > 0.0) else None


def _is_box(box: Any) -> bool:
    try:
        return np.asarray(box, dtype=np.float64).shape[:1] == (2,)
    except (TypeError, ValueError):
        return False
