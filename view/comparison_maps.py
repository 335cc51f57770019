"""Answers side by side over the body: maps in one scale, deformed shapes, where the error is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from kaju.errors import ParameterError
from kaju.model.compare import Comparison
from kaju.model.reference import Reference

from .body import draw_body
from .comparison import COLOURS, TITLE, Comparisons, check_count, pair_of
from .cropping import section_of
from .deformed import corner_displacements
from .forces import draw_forces
from .maps import Quantity, draw_map
from .style import DIVERGING, INK, SIZE, add_polygons, colour_bar, new_axes, new_figure
from .units import round_down, scale_for, times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .section import Section

_PALE = "#c2c2c2"


def plot_maps(
    comparisons: Comparisons,
    quantity: str,
    component: str,
    *,
    believed: str = "reference",
    symbol: str = "",
    cut: Mapping[str, float] | None = None,
) -> Figure:
    """Draw a component over the cells, every answer in the same colours.

    Stresses are shown on a scale that is logarithmic above a hundredth of the largest.
    """
    check_count(comparisons)
    first = next(iter(comparisons.values()))
    fields = {name: pair_of(c, quantity, component).values for name, c in comparisons.items()}
    fields[believed] = pair_of(first, quantity, component).reference
    unit = pair_of(first, quantity, component).unit
    largest = max(float(np.abs(values).max()) for values in fields.values())
    norm, ticks = _scale(largest, logarithmic=quantity == "stress")
    section = section_of(first.result.scene, None, cut, False)
    figure = new_figure((2.75 * len(fields) + 1.0, 3.3))
    axes = figure.subplots(1, len(fields), sharey=True)
    cells = first.result.scene.lattice.locate(first.points)
    for ax, (name, values) in zip(axes, fields.items(), strict=True):
        draw_body(ax, section)
        shown = Quantity(values, name, unit, signed=True)
        drawn = draw_map(ax, section, cells, shown)
        drawn.set_norm(norm)
        drawn.set_cmap(DIVERGING)
        draw_forces(ax, section)
        _place(ax, section, name)
    bar = figure.colorbar(drawn, ax=list(axes), shrink=0.9, aspect=24, pad=0.01)
    scale = scale_for([largest], unit)
    bar.set_ticks(ticks)
    bar.minorticks_off()
    bar.formatter = FuncFormatter(scale.text)
    bar.set_label(f"{symbol} ({scale.unit})", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    bar.outline.set_linewidth(0.5)
    return figure


def plot_shapes(
    answers: Mapping[str, Any],
    believed: Any,
    *,
    name: str = "reference",
    magnification: float | None = None,
) -> Figure:
    """Draw the deformed lines between the cells of a plane body, over those of the reference.

    Parameters
    ----------
    answers : mapping of str to BodyResult
        What is judged, by name.
    believed : BodyResult or Reference
        Knows the displacement of the corners of the cells.
    name : str
        What the reference is called.
    magnification : float, optional
        How many times larger than true; one for all panels.
    """
    first = next(iter(answers.values()))
    section = section_of(first.scene, None, None, False)
    tiles, kinds = section.ground
    tiles = tiles[kinds >= 0]
    rest = section.polygons(tiles)
    moved = {label: corner_displacements(a, section, tiles) for label, a in answers.items()}
    if isinstance(believed, Reference):
        true = believed.displacement_at(rest.reshape(-1, 2)).reshape(rest.shape)
    else:
        true = corner_displacements(believed, section, tiles)
    largest = max(float(np.abs(shift).max()) for shift in (true, *moved.values()))
    lower, upper = section.box
    factor = magnification or round_down(0.1 * float((upper - lower).max()) / largest)
    figure = new_figure((3.3 * len(answers) + 0.4, 3.9))
    axes = figure.subplots(1, len(answers), sharey=True, squeeze=False)[0]
    for ax, label, colour in zip(axes, answers, COLOURS, strict=False):
        for shift, ink, width in ((true, _PALE, 2.4), (moved[label], colour, 0.8)):
            look: dict[str, Any] = {"facecolors": "none", "edgecolors": ink, "linewidths": width}
            add_polygons(ax, rest + factor * shift, "moved", **look)
        draw_forces(ax, section)
        _place(ax, section, label)
    handles = [Line2D([], [], color=_PALE, linewidth=2.4, label=name)]
    handles += [Line2D([], [], color=COLOURS[n], label=label) for n, label in enumerate(answers)]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        fontsize=8,
        frameon=False,
        title=f"displacement shown {times(factor)}",
        title_fontsize=8,
    )
    return figure


def plot_error(
    comparison: Comparison,
    quantity: str = "displacement",
    ax: Axes | None = None,
    *,
    cut: Mapping[str, float] | None = None,
) -> Axes:
    """Draw where the error is, as a share of the reference's largest value."""
    pair = comparison.displacement if quantity == "displacement" else comparison.stress
    if pair is None:
        raise ParameterError(f"quantity: there is no {quantity!r} to compare")
    scene = comparison.result.scene
    cells = scene.lattice.locate(comparison.points)
    worst = cells[int(np.argmax(pair.error))]
    if scene.lattice.dimension == 3 and cut is None:
        cut = {"y": (float(worst[1]) + 0.5) * scene.lattice.cell_size}
    section = section_of(scene, None, cut, False)
    ax = new_axes(ax, (5.6, 4.8))
    draw_body(ax, section)
    drawn = draw_map(ax, section, cells, Quantity(pair.error, "error", "", signed=False))
    drawn.set_cmap(SIZE)
    colour_bar(ax, drawn, f"share of the reference's largest {quantity}")
    _place(ax, section, "")
    told = f"largest {pair.max_error:.2g}, root mean square {pair.l2_error:.2g}"
    ax.set_title(f"Error of the {quantity}: {told}", **TITLE)
    return ax


def _scale(largest: float, logarithmic: bool) -> tuple[Normalize, list[float]]:
    """Return colours from -largest to largest, and the values to mark."""
    if not logarithmic:
        return Normalize(-largest, largest), [-largest, -0.5 * largest, 0.0, 0.5 * largest, largest]
    top = 10.0 ** np.ceil(np.log10(0.999 * largest))
    marks = [top, 0.1 * top, 0.01 * top]
    norm = SymLogNorm(0.01 * top, linscale=0.5, vmin=-top, vmax=top)
    return norm, [*(-mark for mark in marks), 0.0, *marks[::-1]]


def _place(ax: Axes, section: Section, title: str) -> None:
    lower, upper = section.box
    for drawn in ax.collections:
        if drawn.get_gid() == "forces" and drawn.get_paths():
            places = np.concatenate([path.vertices for path in drawn.get_paths()])
            lower = np.minimum(lower, places.min(axis=0))
            upper = np.maximum(upper, places.max(axis=0))
    ax.set_aspect("equal")
    ax.set_xlim(lower[0], upper[0])
    ax.set_ylim(lower[1], upper[1])
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.set_title(title, fontsize=9, color=INK)
