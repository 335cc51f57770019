"""Regions of a body over which the mean of a quantity counts, by quadrature points or agents."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import KajuError, ParameterError
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.goals.quantities import Place
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene import Region, body_cells
from kaju.model.scene.shapes import Box, Shape

NEAR = 1e-6  # A plane that is nearer to a face than this part of a cell lies on it
SAMPLES = {2: 8, 3: 4}  # Points along an agent by which round shapes are measured in it
PARTED = 4  # Agents can cover regions that end at multiples of this part of a cell
MANY = 10_000  # Agents that are measured at a time


class QuadraturePoints(NamedTuple):
    """Middles of parts of a region; a row of `place` and `span` for each."""

    place: Floats  # Units; shape (n, dimension)
    leaf: Ints  # A leaf in or on which each lies; shape (n,)
    weight: Floats  # Adds up to 1; shape (n,)
    span: Floats  # How far each part reaches along every axis (units); shape (n, dimension)


class ExactCover(NamedTuple):
    """Leaves, or sides of leaves, that cover a region exactly."""

    leaf: Ints
    side: Ints  # -1: the whole leaf; shape (n,)
    share: Floats  # Of the region; adds up to 1; shape (n,)
    cut: Flags  # Leaves across the region's boundary: the cover is exact without; shape (leaves,)


@dataclass(frozen=True, eq=False)
class Point:
    """A single point (units), in a cell (units)."""

    place: Floats
    unit: Ints

    def points(self, grid: CompositeGrid) -> QuadraturePoints:
        """Return the point."""
        leaf = grid.leaves.find(self.unit)
        return QuadraturePoints(self.place, leaf, np.ones(1), np.zeros_like(self.place))

    def coarse(self, grid: CompositeGrid) -> Flags:
        """Return that no leaf is too large to see the point."""
        return np.zeros(len(grid.leaves), dtype=np.bool_)

    def parts(self, grid: CompositeGrid) -> str:
        """Return why no leaves cover it."""
        return "no energy bounds the value at a point; ask for the mean of a box round it"


@dataclass(frozen=True, eq=False)
class Cuboid:
    """A box (units); `flat` along an axis it is a section of the body, or part of its surface."""

    lower: Floats
    upper: Floats
    flat: int | None = None
    coarsest: ClassVar[float] = 1.0  # Share of the width that leaves may have

    def points(self, grid: CompositeGrid) -> QuadraturePoints:
        """Return the middle of the box's part in every leaf, weighted by its volume or area."""
        leaf = np.flatnonzero(self._reached(grid))
        first = np.maximum(grid.leaves.lower[leaf], self.lower)
        last = np.minimum(grid.leaves.upper[leaf], self.upper)
        weight = self._across(last - first).prod(axis=1)
        return _weighted(0.5 * (first + last), leaf, weight, last - first)

    def coarse(self, grid: CompositeGrid) -> Flags:
        """Tell which leaves in reach are larger than the box, or too large a share of it."""
        widest = self.coarsest * self._across(self.upper - self.lower).min()
        return np.asarray(self._reached(grid) & (grid.leaves.size > widest))

    def parts(self, grid: CompositeGrid) -> ExactCover | str:
        """Return the leaves in the box; of a flat one the sides below, or bare ones above."""
        step = max(grid.ground.cell // PARTED, grid.ground.smallest)
        first, last = (np.rint(end / step) * step for end in (self.lower, self.upper))
        off = max(np.abs(first - self.lower).max(), np.abs(last - self.upper).max())
        if off > NEAR * grid.ground.cell:
            return (
                f"its ends are no multiples of 1/{grid.ground.cell // step} of a cell, where "
                "agents could end as well"
            )
        low, high, axis = grid.leaves.lower, grid.leaves.upper, self.flat
        within, over = (low >= first) & (high <= last), (low < last) & (high > first)
        if axis is None:
            leaf = np.flatnonzero(within.all(axis=1))
            cut = np.asarray(over.all(axis=1) & ~within.all(axis=1))
            side = np.full(len(leaf), -1)
        else:
            within[:, axis] = over[:, axis] = True
            below = high[:, axis] == first[axis]
            above = (low[:, axis] == first[axis]) & (grid.beside[:, 2 * axis] < 0)
            there = within.all(axis=1) & (below | above)
            across = (low[:, axis] < first[axis]) & (high[:, axis] > first[axis])
            cut = over.all(axis=1) & (across | ((below | above) & ~there))
            leaf = np.flatnonzero(there)
            side = 2 * axis + below[leaf]
        share = grid.length[leaf] ** (grid.dimension - (axis is not None))
        return ExactCover(leaf, side, share / (share.sum() or 1.0), cut)

    def _across(self, values: Floats) -> Floats:
        return values if self.flat is None else np.delete(values, self.flat, axis=-1)

    def _reached(self, grid: CompositeGrid) -> Flags:
        """Tell which leaves have the box in them; on top of one that is flat only bare ones."""
        low, high, axis = grid.leaves.lower, grid.leaves.upper, self.flat
        within = (low < self.upper) & (high > self.lower)
        if axis is not None:
            bare = (low[:, axis] == self.lower[axis]) & (grid.beside[:, 2 * axis] < 0)
            inside = (low[:, axis] < self.lower[axis]) & (self.lower[axis] <= high[:, axis])
            within[:, axis] = inside | bare
        return np.asarray(within.all(axis=1))


@dataclass(frozen=True, eq=False)
class Rounded(Cuboid):
    """Another shape with a volume, in the box from `lower` to `upper`."""

    shape: Shape = field(kw_only=True)
    metre: float = field(kw_only=True)  # of a unit
    coarsest: ClassVar[float] = 0.25

    def points(self, grid: CompositeGrid) -> QuadraturePoints:
        """Return the middle of the shape's part in every leaf, weighted by its volume."""
        leaf = np.flatnonzero(self._reached(grid))
        low = grid.leaves.lower[leaf].astype(np.float64)
        size = grid.leaves.size[leaf, None].astype(np.float64)
        parts = [
            self._measured(low[at : at + MANY], size[at : at + MANY])
            for at in range(0, len(leaf), MANY)
        ]
        middle, share = (np.concatenate(column) for column in zip(*parts, strict=True))
        met = share > 0.0
        volume = share * size[:, 0] ** grid.dimension
        span = np.where(share == 1.0, size[:, 0], 0.0)[:, None] * np.ones(grid.dimension)
        return _weighted(middle[met], leaf[met], volume[met], span[met])

    def parts(self, grid: CompositeGrid) -> str:
        """Return why no leaves cover it."""
        return "agents do not make up a round or slanted place; ask for the mean of a box"

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


GoalRegion = Point | Cuboid
"""Gives for every grid its quadrature points, the leaves or sides that cover it exactly (or the
reason why none ever do), and which leaves are too large to see it."""


def _weighted(points: Floats, leaf: Ints, weight: Floats, span: Floats) -> QuadraturePoints:
    return QuadraturePoints(points, leaf, weight / (weight.sum() or 1.0), span)


def located(ground: PosedBody, points: Floats, cells: Ints) -> tuple[Floats, Ints]:
    """Return points (m) that lie in or on cells in units, and a unit cell of each."""
    first = cells * ground.cell
    place = np.clip(points / _metre(ground), first, first + ground.cell)
    return place, np.clip(np.floor(place).astype(np.int64), first, first + ground.cell - 1)


def region_of(at: Place, ground: PosedBody) -> GoalRegion:
    """Return the region of a body that a place is."""
    if isinstance(at, str):
        return _side(at, ground)
    if isinstance(at, dict):
        return _region(at, ground)
    d = ground.dimension
    if len(at) != d:
        raise ParameterError(
            f"goal: {list(at)} should have {d} coordinates (m), one for each axis of the cells"
        )
    point = np.array([at])
    if np.isfinite(point).all():
        cells, found = body_cells(ground.scene, point)
        if found.all():
            return Point(*located(ground, point, cells))
    raise ParameterError(
        f"goal: ({', '.join(f'{x:g}' for x in at)}) m lies outside the body; choose a "
        "place in or on it"
    )


def _metre(ground: PosedBody) -> float:
    return ground.scene.lattice.cell_size / ground.cell


def _side(name: str, ground: PosedBody) -> GoalRegion:
    lattice = ground.scene.lattice
    if name not in lattice.sides:
        raise ParameterError(
            f"goal: there is no side {name!r}{suggestion(name, lattice.sides)}; there is "
            f"{', '.join(lattice.sides)}, and 'displacement' for the largest error anywhere"
        )
    axis, upper = divmod(lattice.sides.index(name), 2)
    low, high = np.zeros(ground.dimension), np.asarray(lattice.shape) * float(ground.cell)
    low[axis] = high[axis] = high[axis] if upper else 0.0
    return Cuboid(low, high, axis)


def _region(region: dict[str, Any], ground: PosedBody) -> GoalRegion:
    lattice, metre = ground.scene.lattice, _metre(ground)
    flat = _flat_axis(region.get("box"), lattice.cell_size) if len(region) == 1 else None
    if flat is not None:
        low, high = (np.asarray(corner, dtype=np.float64) / metre for corner in region["box"])
        face = np.rint(low[flat])
        if abs(low[flat] - face) < NEAR * ground.cell:
            low[flat] = high[flat] = face
        return Cuboid(low, high, flat)
    try:
        shape = Region(material="air", **region).shape_in(lattice, "goal")
    except KajuError as error:
        message = str(error)
        where = "" if message.startswith("goal") else "goal: "
        raise ParameterError(where + message) from None
    lower, upper = (np.asarray(corner) / metre for corner in shape.extent)
    if isinstance(shape, Box):
        return Cuboid(lower, upper)
    return Rounded(lower, upper, shape=shape, metre=metre)


def _flat_axis(box: Any, cell_size: float) -> int | None:
    """Return the one axis along which a box has no thickness."""
    try:
        lower, upper = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    spans = np.atleast_1d(upper - lower)
    flat = np.flatnonzero(np.abs(spans) <= NEAR * cell_size)
    return int(flat[0]) if len(flat) == 1 and np.all(np.delete(spans, flat) > 0.0) else None
