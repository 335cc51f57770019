"""Agents of many sizes as the squares in which a plane meets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, log2
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.result import Tiles

from .body_plots import draw_body
from .section import Section, layer_at, section_of
from .style import INK, add_polygons
from .units import grouped, quantity

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult

FINEST = 800
"""Agents smaller than this part of the picture are drawn together."""
OUTLINED = 160
"""Agents smaller than this part of the picture are drawn without outlines."""
LEGIBLE = 1000
"""If small agents are smaller than this part of the body, pictures are cropped."""
SMALL = 0.25
"""The agents that pictures are about are the smallest: this share of all."""

_RING = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])


@dataclass(frozen=True, eq=False)
class Layer(Section):
    """A rectangle of a body in the plane, or in a plane through its agents."""

    place: float = 0.0
    """Where the plane lies along the axis that it cuts (m); 0 for bodies in the plane."""

    def in_body(self, points: Floats) -> Floats:
        """Return points of the picture, shape (n, 2), as points of the body."""
        full = super().in_body(points)
        if self.cut is not None:
            full[:, self.cut[0]] = self.place
        return full

    def meets(self, lower: Floats, size: Floats) -> Ints:
        """Return which of the agents the picture shows."""
        low, high = self.box
        flat = lower[:, self.axes]
        shown = np.all((flat < high) & (flat + size[:, None] > low), axis=1)
        if self.cut is not None:
            ahead = self.place - lower[:, self.cut[0]]
            shown &= (ahead >= 0.0) & (ahead < size)
        return np.flatnonzero(shown)

    @property
    def notes(self) -> list[str]:
        """What a reader must be told: the cut, the crop, and what is approximate."""
        told = []
        if self.cut is not None:
            told.append(f"cut at {'xyz'[self.cut[0]]} = {quantity(self.place, 'm')}")
        if self.cropped:
            part = " × ".join(quantity(float(n), "m") for n in self.box[1] - self.box[0])
            told.append(f"cropped to {part}")
        return ["; ".join(words) for words in (told, self.caveats) if words]


def layer_of(
    result: ElasticResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Layer:
    """Show a plane (of itself one through small agents), cropped where they are hard to see."""
    scene = result.grid
    axis, place = _plane(result, cut)
    within = {} if axis is None else {"xyz"[axis]: place}
    small = small_agents(result)
    cells = scene.lattice.locate(small.middle)
    if axis is not None:
        cells[:, axis] = layer_at(scene, axis, place)
    found = section_of(scene, cells, within or None, small.hidden if crop is None else crop)
    return Layer(
        *(found.scene, found.lower, found.upper, found.axes),
        *(found.cut, found.block, found.cropped),
        place=place,
        caveats=result.caveats_in_brief,
    )


class Small(NamedTuple):
    """The smallest agents: lower corners and middles (m), and whether they are hard to see."""

    lower: Floats
    middle: Floats
    hidden: bool


def small_agents(result: ElasticResult) -> Small:
    """Return the agents that pictures are about: a quarter of all, the smallest."""
    limit = float(np.quantile(result.size, SMALL))
    small = result.size <= limit
    lower, upper = result.grid.bounds()
    span = float((upper - lower).max()) * result.grid.lattice.cell_size
    corner = result.lower[small]
    return Small(corner, corner + 0.5 * result.size[small, None], limit * LEGIBLE < span)


def _plane(result: ElasticResult, cut: Mapping[str, float] | None) -> tuple[int | None, float]:
    if result.lower.shape[1] == 2:
        if cut is not None:
            raise ParameterError("cut: belongs to three dimensions; leave it out")
        return None, 0.0
    if cut is None:
        along = np.abs(result.grid.applied(result.stage).force).sum(axis=0)
        axis = 0 if along[1] > along[[0, 2]].max() else 1
        middles = np.sort(small_agents(result).middle[:, axis])
        return axis, float(middles[len(middles) // 2])
    if len(cut) != 1 or not set(cut) <= set("xyz"):
        raise ParameterError(f"cut: names one of x, y and z, such as {{'y': 0.05}}; got {cut}")
    ((name, where),) = cut.items()
    axis, place = "xyz".index(name), float(where)
    low = result.lower[:, axis]
    if not np.any((low <= place) & (place < low + result.size)):
        raise ParameterError(f"cut: no agent stands at {name} = {place:g} m")
    return axis, place


class DrawnSquares(NamedTuple):
    """What is drawn: lower corners (m) in the picture, edges, values, and whose they are."""

    lower: Floats
    size: Floats
    value: Floats
    row: Ints

    @property
    def corners(self) -> Floats:
        """Corners (m), shape (n, 4, 2), counter-clockwise."""
        return np.asarray(self.lower[:, None] + _RING * self.size[:, None, None])


def squares_of(layer: Layer, tiles: Tiles) -> DrawnSquares:
    """Return the squares in which a layer meets agents, those too small to be seen together."""
    rows = layer.meets(tiles.lower, tiles.size)
    met = Tiles(tiles.lower[rows][:, layer.axes], tiles.size[rows], tiles.value[rows])
    drawn, chosen = together(met, layer.span / FINEST)
    return DrawnSquares(*drawn, rows[chosen])


def together(tiles: Tiles, finest: float) -> tuple[Tiles, Ints]:
    """Draw tiles smaller than `finest` together, by the value farthest from 0, and tell whose."""
    lower, size, value = tiles
    everybody = np.arange(len(size))
    step = float(size.min(initial=finest))
    step *= 2.0 ** max(0, ceil(log2(finest / step)))
    tiny = np.flatnonzero(size < 0.75 * step)
    if not len(tiny):
        return tiles, everybody
    place = np.floor((lower[tiny] + 0.5 * size[tiny, None]) / step).astype(np.int64)
    order = np.lexsort((np.abs(value[tiny]), *place.T))
    place = place[order]
    last = np.append(np.any(place[1:] != place[:-1], axis=1), True)
    seen = size >= 0.75 * step
    row = np.concatenate([everybody[seen], tiny[order[last]]])
    lower = np.concatenate([lower[seen], place[last] * step])
    size = np.concatenate([size[seen], np.full(np.count_nonzero(last), step)])
    return Tiles(lower, size, value[row]), row


def draw_squares(
    ax: Axes, layer: Layer, drawn: DrawnSquares, name: str, **look: Any
) -> PolyCollection:
    """Draw agents with outlines where these can be seen."""
    large = drawn.size > layer.span / OUTLINED
    return add_polygons(
        ax,
        drawn.corners,
        name,
        **look,
        edgecolors="#7d7d7d",
        linewidths=np.where(large, 0.3, 0.0),
        antialiaseds=large,
        zorder=2,
    )


def draw_surroundings(ax: Axes, layer: Layer) -> list[Artist]:
    """Draw supports, the body's surface and its joints; return what explains them."""
    entries = draw_body(ax, layer, filled=False)
    surface, joints = layer.outlines()
    ax.add_collection(LineCollection(list(surface), colors=INK, linewidths=0.9, zorder=4))
    ax.add_collection(LineCollection(list(joints), colors=INK, linewidths=0.9, zorder=4))
    return entries


def agents_told(agents: int, steps: int, error: float) -> str:
    """Return in words how many agents there are after how many steps, and their error."""
    many = "agent" if agents == 1 else "agents"
    return f"step {steps} of spawning: {grouped(agents)} {many}, estimated error {error:.2g}"
