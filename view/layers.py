"""Agents of many sizes as the squares in which a plane meets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, log2
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.mesh import corner_order
from kaju.model.results.result import Tiles

from .section import Section, axis_across, layer_at, named_cut, section_of
from .style import add_polygons
from .units import quantity

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
        """The cut, the crop, and what is approximate of the answer."""
        shown = []
        if self.cut is not None:
            shown.append(f"cut at {'xyz'[self.cut[0]]} = {quantity(self.place, 'm')}")
        if self.cropped:
            part = " × ".join(quantity(float(n), "m") for n in self.box[1] - self.box[0])
            shown.append(f"cropped to {part}")
        return ["; ".join(words) for words in (shown, self.caveats) if words]


def layer_of(
    result: ElasticResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Layer:
    """Show a plane (of itself one through small agents), cropped where they are hard to see."""
    scene, small = result.grid, small_agents(result)
    named = named_cut(scene, cut)
    cells, place, within = scene.lattice.locate(small.middle), 0.0, None
    if scene.lattice.dimension == 3:
        if named is None:
            axis = axis_across(scene, result.stage)
            middles = np.sort(small.middle[:, axis])
            place = float(middles[len(middles) // 2])
        else:
            axis, place = named
            low = result.lower[:, axis]
            if not np.any((low <= place) & (place < low + result.size)):
                raise ParameterError(f"cut: there is no agent at {'xyz'[axis]} = {place:g} m")
        cells[:, axis] = layer_at(scene, axis, place)
        within = {"xyz"[axis]: place}
    section = section_of(scene, cells, within, small.hidden if crop is None else crop)
    fields = {name: getattr(section, name) for name in Section.__dataclass_fields__}
    return Layer(**fields | {"caveats": result.caveats_in_brief}, place=place)


class Small(NamedTuple):
    """The smallest agents: lower corners and middles (m), and whether they are hard to see."""

    lower: Floats
    middle: Floats
    hidden: bool


def small_agents(result: ElasticResult) -> Small:
    """Return the agents that pictures are about: a quarter of all, the smallest."""
    limit, usual = (float(np.quantile(result.size, share)) for share in (SMALL, 0.5))
    small = result.size <= limit
    lower, upper = result.grid.bounds()
    span = float((upper - lower).max()) * result.grid.lattice.cell_size
    corner = result.lower[small]
    return Small(corner, corner + 0.5 * result.size[small, None], usual * LEGIBLE < span)


class DrawnSquares(NamedTuple):
    """What is drawn: lower corners (m) in the picture, edges, values, and whose they are."""

    lower: Floats
    size: Floats
    value: Floats
    row: Ints

    @property
    def corners(self) -> Floats:
        """Corners (m), shape (n, 4, 2), counter-clockwise."""
        return np.asarray(self.lower[:, None] + corner_order(2) * self.size[:, None, None])


def squares_of(layer: Layer, tiles: Tiles) -> DrawnSquares:
    """Return the squares in which a layer meets agents, those too small to be seen together."""
    rows = layer.meets(tiles.lower, tiles.size)
    met = Tiles(tiles.lower[rows][:, layer.axes], tiles.size[rows], tiles.value[rows])
    drawn, chosen = merge_small(met, layer.span / FINEST)
    return DrawnSquares(*drawn, rows[chosen])


def merge_small(tiles: Tiles, finest: float) -> tuple[Tiles, Ints]:
    """Merge tiles smaller than `finest` to ones of the value farthest from 0; return rows, too."""
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


PEAK = 2e-3
"""Values on this share of the picture may lie beyond the scale: stresses grow at corners."""


def usual_top(values: Floats, edge: Floats) -> tuple[float, bool]:
    """Return the end of the scale of squares' values, and whether there are values beyond it."""
    size = np.abs(values)
    order = np.argsort(-size, kind="stable")
    area = np.cumsum(edge[order] ** 2)
    usual = float(size[order[np.searchsorted(area, PEAK * area[-1])]])
    largest = float(size.max())
    return (usual, True) if 0.0 < 1.5 * usual < largest else (largest, False)


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
