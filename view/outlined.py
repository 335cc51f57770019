"""Bodies with true outlines: agents as the outlines cut them."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib.collections import PolyCollection

from kaju.errors import ParameterError
from kaju.model.elastic.goals.quantities import named
from kaju.model.scene.curves import flattened
from kaju.model.scene.shapes import OutlinedShape

from .style import caption, colour_bar, label_axis, new_axes
from .units import quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaju.model.outline.outline_result import OutlineResult


def plot_cut_agents(
    result: OutlineResult, ax: Axes | None = None, *, generation: int | None = None
) -> Axes:
    """Draw what each agent holds of the body, in the colour of its equivalent stress."""
    ax = new_axes(ax)
    if generation is not None:
        last = len(result.leaves) - 1
        if not 0 <= generation <= last:
            raise ParameterError(f"generation: must lie between 0 and {last}, got {generation}")
        result = result.generations[generation]
    agent, pieces = result.pieces()
    value = result.von_mises[agent]
    squares = PolyCollection(pieces, array=value, cmap="viridis", edgecolors="face", lw=0.1)
    squares.set_clim(0.0, float(value.max()))
    ax.add_collection(squares)
    low, size = result.lower, result.size[:, None]
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    edges = low[:, None] + size[:, None] * corners
    whole = ~result.cut
    lines = PolyCollection(list(edges[whole]), facecolors="none", edgecolors="white", lw=0.3)
    ax.add_collection(lines)
    scene = result.scene
    if len(scene.cell_materials) > 1:  # agents have one colour on both sides of an outline
        for number, region in enumerate(scene.body.regions):
            shape = cast(OutlinedShape, region.shape_in(scene.lattice, f"body.regions.{number}"))
            drawn = [flattened(arcs, 16) for arcs in shape.outline()]
            ax.add_collection(PolyCollection(drawn, facecolors="none", edgecolors="black", lw=0.8))
    extent = scene.lattice.extent
    ax.set(xlim=(0.0, extent[0]), ylim=(0.0, extent[1]), aspect="equal")
    label_axis(ax.xaxis, "x", [0.0, extent[0]], "m")
    label_axis(ax.yaxis, "y", [0.0, extent[1]], "m")
    colour_bar(ax, squares, "equivalent stress", "Pa")
    cut = int(result.cut.sum())
    error = f"{'at most' if result.proof else 'about'} {100 * result.error_estimate:.2g} %"
    if result.tolerance_at is None:
        error += f", {result.tolerance_kept}"
    notes = [
        f"{result.agents} agents, {cut} cut by an outline; largest mean "
        f"{quantity(float(value.max()), 'Pa')}; error {error}"
    ]
    notes += [
        f"largest {named(goal.quantity)}: {quantity(float(goal.value), 'Pa')}, "
        f"{100 * goal.relative_error:.2g} % off as estimated"
        for goal in result.goals
    ]
    caption(ax, "agents within true outlines", notes)
    return ax
