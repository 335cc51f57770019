"""Where a quantity is taken: points, boxes, sections, sides and round shapes of a body.

A place gives the points over which a quantity counts, whatever the sizes of the agents; and the
box whose ends agents can have, over which a load can be laid.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from kaju.agents.materials import suggestion
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import KajuError, ParameterError
from kaju.model.elastic.corners import ON_EDGE
from kaju.model.elastic.goals.quantities import Place
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene import Region, Scene, body_cells
from kaju.model.scene.shapes import Box, Shape

PARTED = {2: 16, 3: 2}
"""Agents can end at multiples of this part of a cell, should a goal ask for it."""
RULE = 3  # Points along an axis of an agent: exact for quadratics
SAMPLES = {2: 8, 3: 4}
"""Points along an axis by which round shapes are measured in an agent: a disk of the radius of an
agent's edge is 3 % off at most, a ball 4 % (of 40 places)."""


class Points(NamedTuple):
    """Points that stand for a place."""

    place: Floats  # (m), shape (n, dimension)
    cell: Ints  # In or on which each lies
    weight: Floats  # Adds up to 1


class Cover(NamedTuple):
    """Agents, or sides of agents, that cover a box exactly."""

    agent: Ints
    side: Ints  # -1: the whole agent
    share: Floats  # Of the box; adds up to 1


@dataclass(frozen=True, eq=False)
class Where:
    """A place in a body; lengths in the cells of the scene that says where the body is."""

    scene: Scene
    name: str
    lower: Floats
    upper: Floats
    flat: int | None = None  # The axis along which a box has no thickness
    shape: Shape | None = None  # Of what is no box
    cell: Ints | None = None  # That a point lies in

    def points(self, lower: Floats, size: Floats) -> Points:
        """Return the points of agents with these lower corners and edges, in cells."""
        h = self.scene.lattice.cell_size
        if self.cell is not None:
            return Points(h * self.lower[None], self.cell[None], np.ones(1))
        agent = np.flatnonzero(self._met(lower, size))
        first = np.maximum(lower[agent], self.lower)
        span = np.minimum(lower[agent] + size[agent, None], self.upper) - first
        d = len(self.lower)
        line, share = np.polynomial.legendre.leggauss(RULE)
        line, share = 0.5 + 0.5 * line, 0.5 * share
        if self.shape is not None:
            line = (np.arange(SAMPLES[d]) + 0.5) / SAMPLES[d]
            share = np.full(len(line), 1.0 / len(line))
        across = [axis for axis in range(d) if axis != self.flat]
        inside = np.full((len(line) ** len(across), d), 0.5)
        inside[:, across] = list(product(line, repeat=len(across)))
        weight = span[:, across].prod(axis=1)[:, None] * np.prod(
            list(product(share, repeat=len(across))), axis=1
        )
        place = (first[:, None] + inside * span[:, None]).reshape(-1, d)
        agent, weight = np.repeat(agent, len(inside)), weight.ravel()
        if self.shape is not None:
            within = self.shape.contains(place * h)
            place, agent, weight = place[within], agent[within], weight[within]
        if not len(agent):
            raise ParameterError(f"goal: there is no body at {self.name}")
        low, high = np.floor(lower[agent]), np.ceil(lower[agent] + size[agent, None]) - 1
        cell = np.clip(np.floor(place), low, np.maximum(high, low)).astype(np.int64)
        return Points(h * place, cell, weight / weight.sum())

    def _met(self, lower: Floats, size: Floats) -> Flags:
        """Tell which agents lie in reach; on top of a section only those with nothing below."""
        upper = lower + size[:, None]
        met = (lower < self.upper) & (upper > self.lower)
        if self.flat is not None:
            axis, plane = self.flat, self.lower[self.flat]
            met[:, axis] = (lower[:, axis] < plane) & (plane <= upper[:, axis])
            top = lower[:, axis] == plane
            below = np.floor(np.maximum(lower, self.lower)).astype(np.int64)
            below[:, axis] = np.ceil(plane) - 1
            met[:, axis] |= top & (self.scene.kinds(below) < 0)
        return np.asarray(met.all(axis=1))


@dataclass(frozen=True, eq=False)
class GoalBox:
    """A box with ends that agents can have; in units."""

    body: PosedBody
    lower: Ints
    upper: Ints
    flat: int | None
    exact: bool  # Whether it is the place itself

    @classmethod
    def of(cls, where: Where, body: PosedBody, flat: bool) -> GoalBox:
        """Return the smallest box round a place; `flat` says whether it may be a section."""
        step = max(body.cell // PARTED[body.dimension], body.smallest)
        low, high = where.lower * (body.cell / step), where.upper * (body.cell / step)
        near = ON_EDGE * body.cell / step
        first, last = np.floor(low + near), np.ceil(high - near)
        axis = where.flat if flat else None
        if axis is not None:
            first[axis] = last[axis] = np.rint(low[axis])
        exact = bool(np.all(np.abs(first - low) <= near) and np.all(np.abs(last - high) <= near))
        exact = exact and where.cell is None and where.shape is None and where.flat == axis
        for along in range(len(first)):
            if along == axis or last[along] > first[along]:
                continue
            # A point, or the plane of a section, is widened to either side that it has.
            first[along] -= 1 if where.cell is None else 0
            last[along] += 1
        if where.cell is not None:
            ticks = body.cell // step
            first = np.clip(first, where.cell * ticks, (where.cell + 1) * ticks - 1)
            last = first + 1
        lower, upper = (np.asarray(end * step, dtype=np.int64) for end in (first, last))
        return cls(body, lower, upper, axis, exact)

    def aligned(self, leaves: LeafCells) -> LeafCells:
        """Return agents of which none lies across an end of the box."""
        while (cut := self._cut(leaves)).any():
            leaves = leaves.split(cut)
        return leaves

    def _cut(self, leaves: LeafCells) -> Flags:
        low, high, axis = leaves.lower, leaves.upper, self.flat
        over = (low < self.upper) & (high > self.lower)
        within = (low >= self.lower) & (high <= self.upper)
        if axis is not None:
            plane = self.lower[axis]
            over[:, axis] = (low[:, axis] <= plane) & (plane <= high[:, axis])
            within[:, axis] = (low[:, axis] == plane) | (high[:, axis] == plane)
        return np.asarray(over.all(axis=1) & ~within.all(axis=1))

    def cover(self, leaves: LeafCells) -> Cover:
        """Return the agents in the box; of a section the sides below, or bare ones above."""
        low, high, axis = leaves.lower, leaves.upper, self.flat
        within = (low >= self.lower) & (high <= self.upper)
        side = np.full(len(leaves), -1)
        if axis is not None:
            plane = self.lower[axis]
            below, above = high[:, axis] == plane, low[:, axis] == plane
            beyond = low.copy()
            beyond[:, axis] = plane - 1
            within[:, axis] = below | (above & (self.body.kinds_at(beyond) < 0))
            side = 2 * axis + below
        agent = np.flatnonzero(within.all(axis=1))
        share = (leaves.size[agent] / self.body.cell) ** (leaves.dimension - (axis is not None))
        return Cover(agent, side[agent], share / share.sum())


def where_of(at: Place, scene: Scene) -> Where:
    """Return the place of a body that is meant."""
    if isinstance(at, str):
        return _side(at, scene)
    if isinstance(at, dict):
        return _region(at, scene)
    d = scene.lattice.dimension
    if len(at) != d:
        raise ParameterError(
            f"goal: {list(at)} must have {d} coordinates (m), one for each axis of the cells"
        )
    point = np.array([at])
    if np.isfinite(point).all():
        cells, found = body_cells(scene, point)
        if found.all():
            place = np.clip(point[0] / scene.lattice.cell_size, cells[0], cells[0] + 1)
            return Where(scene, f"{at}", place, place, cell=cells[0])
    raise ParameterError(
        f"goal: ({', '.join(f'{x:g}' for x in at)}) m lies outside the body; choose a place in or "
        "on it"
    )


def _side(name: str, scene: Scene) -> Where:
    lattice = scene.lattice
    if name not in lattice.sides:
        raise ParameterError(
            f"goal: there is no side {name!r}{suggestion(name, lattice.sides)}; there is "
            f"{', '.join(lattice.sides)}"
        )
    axis, upper = divmod(lattice.sides.index(name), 2)
    low, high = np.zeros(lattice.dimension), np.asarray(lattice.shape, dtype=np.float64)
    low[axis] = high[axis] = high[axis] if upper else 0.0
    return Where(scene, f"{name!r}", low, high, axis)


def _region(region: dict[str, Any], scene: Scene) -> Where:
    lattice = scene.lattice
    flat = _flat_axis(region.get("box"), lattice.cell_size) if len(region) == 1 else None
    if flat is not None:
        low, high = (np.asarray(c, dtype=np.float64) / lattice.cell_size for c in region["box"])
        face = np.rint(low[flat])
        if abs(low[flat] - face) < ON_EDGE:
            low[flat] = high[flat] = face
        return Where(scene, f"{region}", low, high, flat)
    try:
        shape = Region(material="air", **region).shape_in(lattice, "goal")
    except KajuError as error:
        message = str(error)
        raise ParameterError(
            message if message.startswith("goal") else f"goal: {message}"
        ) from None
    lower, upper = (
        np.clip(np.asarray(corner) / lattice.cell_size, 0.0, lattice.shape)
        for corner in shape.extent
    )
    return Where(scene, f"{region}", lower, upper, shape=None if isinstance(shape, Box) else shape)


def _flat_axis(box: Any, cell_size: float) -> int | None:
    """Return the one axis along which a box has no thickness."""
    try:
        lower, upper = np.asarray(box, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    spans = np.atleast_1d(upper - lower)
    flat = np.flatnonzero(np.abs(spans) <= ON_EDGE * cell_size)
    return int(flat[0]) if len(flat) == 1 and np.all(np.delete(spans, flat) > 0.0) else None
