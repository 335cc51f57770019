"""Agents of many sizes as the squares in which a plane meets them."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, log2
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.mesh import corner_order

from .section import Arrows, Cut, Section, TrueLines, axis_across, layer_at, named_cut, section_of
from .style import add_polygons

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.pair.cut_agents import CutAgents

FINEST = 800
"""Agents smaller than this part of the picture are drawn together."""
OUTLINED = 160
"""Agents smaller than this part of the picture are drawn without outlines."""


class Tiles(NamedTuple):
    """Squares or cubes with a value each: what maps, sections and solids are drawn of."""

    lower: Floats  # lower corners (m), shape (n, dimension)
    size: Floats  # edges (m), shape (n,)
    value: Floats  # shape (n,)


def layer_of(result: ElasticResult, cut: Cut = None, crop: bool | None = None) -> Section:
    """Show a plane (of itself one through small agents), cropped where they are hard to see."""
    scene, (_, middle, hidden) = result.grid, small_agents(result)
    named = named_cut(scene, cut)
    cells, place, within = scene.lattice.locate(middle), 0.0, None
    if scene.lattice.dimension == 3:
        if named is None:
            axis = axis_across(scene, result.stage)
            middles = np.sort(middle[:, axis])
            place = float(middles[len(middles) // 2])
        else:
            axis, place = named
            low = result.lower[:, axis]
            if not np.any((low <= place) & (place < low + result.size)):
                raise ParameterError(f"cut: there is no agent at {'xyz'[axis]} = {place:g} m")
        cells[:, axis] = layer_at(scene, axis, place)
        within = {"xyz"[axis]: place}
    crop = hidden if crop is None else crop
    section = section_of(scene, cells, within, crop, caveats=result.caveats_in_brief)
    if (found := result.cut_agents) is None:
        return replace(section, place=place, tiled=False)
    lines = found.opinions.along if len(result.scene.cell_materials) > 1 else [np.empty((0, 2, 2))]
    joints = found.ground.edge * np.concatenate(lines)
    pins = found.ground.edge * found.ground.pivots
    curves = TrueLines(rings_of(found), joints, arrows_of(found), result.scene, pins)
    return replace(section, place=place, tiled=False, curves=curves)


def rings_of(found: CutAgents) -> list[tuple[Floats, Floats]]:
    """Return the closed lines (m) that hold the body, on their left, and how they move (m)."""
    from kaju.model.elastic.pair.sheets import loops_of

    fit, ends = found.opinions.fitting, found.opinions.borders[0].ends
    place = found.ground.edge * fit.mesh.place
    moved = found.scales.displacement * fit.value.reshape(-1, 2)
    rings = [np.append(ends[loop, 0], ends[loop[0], 0]) for loop in loops_of(*ends.T)]
    return [(place[ring], moved[ring]) for ring in rings]


def arrows_of(found: CutAgents) -> Arrows:
    """Return few arrows that stand for the loads on agents within outlines.

    One stands for what would lie over each other, else 5 for a straight edge, or 16 for another.
    """
    from kaju.model.elastic.pair.sheets import loops_of  # these need SciPy, pictures of loads none
    from kaju.model.outline.posed_outlines import SIDES
    from kaju.model.outline.true_shapes import UNIT

    border, force = found.border, found.border.given
    walk = np.concatenate(loops_of(*border.ends.T))
    walk = walk[force[walk].any(axis=1)]
    places = np.where(border.side >= 0, border.side, len(SIDES) + border.outline)[walk]
    drawn, runs = [], []
    for place in np.unique(places).tolist():
        rows = walk[places == place]
        # what is not loaded all round begins where it does not go on
        gaps = np.flatnonzero(border.ends[rows, 1] != border.ends[np.roll(rows, -1), 0])
        first = gaps[0] if len(gaps) else -1
        runs += np.split(np.roll(rows, -1 - first), gaps[1:] - first)
    for rows in runs:
        long, outward = np.hypot(*border.run[rows].T), border.outward[rows]
        unit = force[rows] / np.linalg.norm(force[rows], axis=1, keepdims=True)
        along_it = abs(float(((unit * outward).sum(axis=1) / long).mean())) < 0.5
        flat = np.ptp(outward / long[:, None], axis=0).max() < 1e-6
        even = np.ptp(unit, axis=0).max() < 1e-6
        count = 1 if even and (along_it or not flat) else 5 if flat else 16
        # places, and sums of the forces up to there, at ends and middles of equal parts
        way = np.append(0.0, np.cumsum(long))
        stops = np.linspace(0.0, way[-1], 2 * count + 1)
        ends = np.vstack([border.at[rows[:1], 0], border.at[rows, 1]])
        sums = np.vstack([np.zeros(2), np.cumsum(force[rows], axis=0)])
        at, sofar = (np.array([np.interp(stops, way, x) for x in y.T]).T for y in (ends, sums))
        own, row = np.diff(sofar[::2], axis=0), np.searchsorted(way[1:-1], stops[1::2])
        drawn.append((at[1::2], own, (own * outward[row]).sum(axis=1) > 0.0))
    if found.ground.weight.any():
        area = found.opinions.area[1][:, None]
        centre = (area * found.leaves.middle * UNIT).sum(axis=0, keepdims=True) / area.sum()
        drawn.append((centre, found.ground.weight[None] * area.sum(), np.array([True])))
    at, own, pull = (np.concatenate(column) for column in zip(*drawn, strict=True))
    size = np.linalg.norm(own, axis=1)
    kept = size > 1e-9 * size.max(initial=0.0)  # none in the middle of a couple
    return Arrows(found.ground.edge * at[kept], found.scales.force * own[kept], pull[kept])


def small_agents(result: ElasticResult) -> tuple[Floats, Floats, bool]:
    """Return lower corners and middles (m) of the smallest agents, and whether they are hidden.

    Pictures are about them, a quarter of all; hidden are those too small to be seen.
    """
    limit, usual = (float(np.quantile(result.size, share)) for share in (0.25, 0.5))
    small = result.size <= limit
    lower, upper = result.grid.bounds()
    span = float((upper - lower).max()) * result.grid.lattice.cell_size
    corner = result.lower[small]
    return corner, corner + 0.5 * result.size[small, None], usual * 1000.0 < span


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


def squares_of(layer: Section, tiles: Tiles) -> DrawnSquares:
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


def usual_top(values: Floats, edge: Floats) -> tuple[float, bool]:
    """Return the end of the scale of squares' values, and whether there are values beyond it."""
    size = np.abs(values)
    order = np.argsort(-size, kind="stable")
    area = np.cumsum(edge[order] ** 2)
    # Stresses grow at corners: on two thousandths of the picture they may lie beyond the scale.
    usual = float(size[order[np.searchsorted(area, 2e-3 * area[-1])]])
    largest = float(size.max())
    return (usual, True) if 0.0 < 1.5 * usual < largest else (largest, False)


def draw_squares(
    ax: Axes, layer: Section, drawn: DrawnSquares, name: str, **look: Any
) -> PolyCollection:
    """Draw agents in the colours of their values, with outlines where these can be seen."""
    large = drawn.size > layer.span / OUTLINED
    look |= {"edgecolors": "#7d7d7d", "linewidths": np.where(large, 0.3, 0.0), "zorder": 2}
    shown = add_polygons(ax, drawn.corners, name, array=drawn.value, antialiaseds=large, **look)
    if layer.curves is not None:
        layer.curves.clip(shown)
    return shown
