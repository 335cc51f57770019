"""Maps: a value of every cell, or agent, as a colour, with its unit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize

from kaju.arrays import Floats, Ints, first_largest
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import BodyPicture, draw_cells
from .deformed import settled
from .layers import Tiles, draw_squares, layer_of, squares_of, usual_top
from .load_plots import load_norm
from .section import Cut, Section, check_word, section_of
from .style import DIVERGING, LOADS, SIZE, colour_bar
from .units import quantity

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult


class Quantity(NamedTuple):
    """What a map shows: one value for each cell."""

    values: Floats
    title: str
    unit: str
    signed: bool
    logarithmic: bool = False


def quantity_of(
    result: ElasticResult | TransferResult, what: str, component: str | None
) -> Quantity:
    """Return a field of a result, or one component of it."""
    if what == "von_mises":
        found = result.von_mises if isinstance(result, TransferResult) else result.largest_von_mises
        return Quantity(found, "Von Mises stress", "Pa", signed=False)
    if isinstance(result, TransferResult) and what == "taken":
        return Quantity(result.last.taken.sum(axis=1), "Loads taken", "N", False, True)
    names = "xyz"[: result.scene.lattice.dimension]
    if what == "displacement":
        chosen = component or "magnitude"
        check_word("component", chosen, ("magnitude", *names))
        if chosen == "magnitude":
            size = np.linalg.norm(result.displacement, axis=1)
            return Quantity(size, "Displacement", "m", signed=False)
        values = result.displacement[:, names.index(chosen)]
        return Quantity(values, f"Displacement along {chosen}", "m", signed=True)
    tensor, unit = getattr(result, what), "Pa" if what == "stress" else ""
    pairs = {f"{a}{b}": (i, j) for i, a in enumerate(names) for j, b in enumerate(names) if i <= j}
    sizes = [np.abs(tensor[:, *pair]).max(initial=0.0) for pair in pairs.values()]
    chosen = component or list(pairs)[first_largest(np.array(sizes))]
    check_word("component", chosen, pairs)
    symbol = "σ" if what == "stress" else "ε"
    title = f"{what.capitalize()} {symbol}{chosen}"
    return Quantity(tensor[:, *pairs[chosen]], title, unit, signed=True)


def draw_map(ax: Axes, section: Section, cells: Ints, shown: Quantity) -> PolyCollection:
    """Colour cells by a value; of the cells of one tile the value farthest from 0 counts."""
    drawn = draw_cells(ax, section, cells, shown.values, "farthest", "map")
    drawn.set(**colours_of(shown, np.asarray(drawn.get_array())))
    return drawn


def colours_of(shown: Quantity, values: Floats, largest: float | None = None) -> dict[str, Any]:
    """Return colour map and scale for values, or for all up to a largest one."""
    if shown.logarithmic:
        return {"cmap": LOADS, "norm": load_norm(values)}
    size = (largest or float(np.abs(values).max(initial=0.0))) or 1.0
    low, cmap = (-size, DIVERGING) if shown.signed else (0.0, SIZE)
    return {"cmap": cmap, "norm": Normalize(low, size)}


def plot_map(
    result: ElasticResult | TransferResult,
    ax: Axes | None = None,
    *,
    what: str,
    component: str | None = None,
    cut: Cut = None,
    crop: bool | None = None,
) -> Axes:
    """Draw a field as the colours of cells, or of agents; cells that have none stay light."""
    if result.kind.startswith("elastic"):
        elastic = settled(result)
        shown, layer = quantity_of(elastic, what, component), layer_of(elastic, cut, crop)
        picture = BodyPicture(layer, ax, elastic.stage, filled=False)
        squares = squares_of(layer, Tiles(elastic.lower, elastic.size, shown.values))
        top, beyond = usual_top(squares.value, squares.size)
        look = colours_of(shown, squares.value, top)
        drawn = draw_squares(picture.ax, layer, squares, "map", **look)
        extend = ("both" if shown.signed else "max") if beyond else "neither"
        told = "value" if what == "von_mises" else "mean of an agent"  # at a point it may be larger
    else:
        run, extend, told = cast(TransferResult, result), "neither", "value"
        shown = quantity_of(run, what, component)
        section = section_of(run.grid, run.focus, cut, crop, caveats=run.caveats_in_brief)
        picture = BodyPicture(section, ax, run.stage)
        if not len(shown.values):
            return picture.finish(shown.title, ["no cell has taken a load", *picture.notes])
        drawn = draw_map(picture.ax, section, run.last.cells, shown)
    label = shown.title[0].lower() + shown.title[1:]
    colour_bar(picture.ax, drawn, label, shown.unit, extend)
    extreme = float(shown.values[first_largest(np.abs(shown.values))])
    notes = [f"largest {told} {quantity(extreme, shown.unit)}; " + "; ".join(picture.notes)]
    return picture.finish(shown.title, notes)


plot_displacement, plot_strain, plot_stress, plot_von_mises, plot_taken = (
    partial(plot_map, what=what)
    for what in ("displacement", "strain", "stress", "von_mises", "taken")
)
