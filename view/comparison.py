"""Answers side by side: profiles and ratios along lines, maps in one scale, shapes, errors.

The reference is drawn as a line in ink, whatever is judged by it in colours with markers.
A scene's rule beside elasticity takes five figures, and some words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kaju.arrays import Floats, first_largest
from kaju.errors import ParameterError
from kaju.model.study.compare import Comparison, Pair, near_line
from kaju.model.study.reference import Reference

from .body_plots import draw_body, draw_forces
from .charts import KEPT, frame_cuts
from .deformed import corner_displacements
from .maps import Quantity, draw_map
from .section import Section, section_of
from .style import (
    COLOURS,
    FAINT,
    INK,
    SIZE,
    add_polygons,
    colour_bar,
    label_axis,
    new_axes,
    new_figure,
)
from .units import quantity, round_down, times
from .units import quantity as with_unit

if TYPE_CHECKING:
    from kaju.model.results.cuts import Cuts
    from kaju.model.study.rule_study import RuleStudy, StraightWay


MARKERS = ("s", "D", "o", "^", "v")
ROOM = 2.0
"""Of the reference's range: what lies further outside of it would make a line of all others."""
MOST_PANELS = len(COLOURS)

Comparisons = Mapping[str, Comparison]
"""Comparisons with one reference, by what is judged."""


class Line(NamedTuple):
    """A line through the body: what it is called, and its two ends (m)."""

    title: str
    start: Sequence[float]
    end: Sequence[float]


def _profiles(
    comparisons: Comparisons,
    lines: Sequence[Line],
    symbols: Mapping[tuple[str, str], str],
    believed: str,
    per: float | None = None,
) -> Figure:
    """Draw components, by quantity and component, along lines: a row of panels each."""
    check_count(comparisons)
    figure = new_figure((4.1 * len(lines) + 0.5, 3.3 * len(symbols) + 0.6))
    panels = figure.subplots(len(symbols), len(lines), squeeze=False)
    for (what, symbol), row in zip(symbols.items(), panels, strict=True):
        for ax, line in zip(row, lines, strict=True):
            plot_profile(ax, comparisons, line, what, per, symbol)
    legend_below(figure, comparisons, believed)
    return figure


def plot_profile(
    ax: Axes,
    comparisons: Comparisons,
    line: Line,
    what: tuple[str, str],
    per: float | None,
    symbol: str,
) -> None:
    """Draw a component along one line, as it is or as a share of `per`."""
    profile = next(iter(comparisons.values())).along(line.start, line.end, 401)
    shown = pair_of(profile, *what)
    judged = [at_cells(comparison, line, what) for comparison in comparisons.values()]
    unit = per or 1.0
    ax.plot(profile.distance, shown.reference / unit, color=INK, linewidth=1.6)
    _draw_judged(ax, line, [(distance, pair.values / unit) for distance, pair in judged])
    keep_to(ax, "y", shown.reference / unit, [pair.values / unit for _, pair in judged])
    if per is None:
        label_axis(ax.yaxis, symbol, [*ax.get_ylim()], shown.unit)
    else:
        ax.set_ylabel(symbol, fontsize=9)


def _draw_judged(ax: Axes, line: Line, curves: Sequence[tuple[Floats, Floats]]) -> None:
    """Draw what is judged over the distance along a line, in a light frame."""
    for number, (distance, values) in enumerate(curves):
        ax.plot(distance, values, **look_of(number))
    length = float(np.linalg.norm(np.subtract(line.end, line.start)))
    label_axis(ax.xaxis, line.title, [0.0, length], "m")
    ax.tick_params(labelsize=8, color=FAINT)
    ax.grid(True, color="#ececec", linewidth=0.6)
    ax.axhline(0.0, color="#b5b5b5", linewidth=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def keep_to(ax: Axes, axis: str, reference: Floats, judged: Sequence[Floats]) -> None:
    """Keep an axis near the reference, and say so where what is judged leaves the picture."""
    low, high = min(0.0, float(reference.min())), max(0.0, float(reference.max()))
    least, most = low - ROOM * (high - low), high + ROOM * (high - low)
    values = np.concatenate(judged)
    values = values[np.isfinite(values)]
    if len(values) == 0 or (least <= values.min() and values.max() <= most):
        return
    ends = max(least, float(values.min())), min(most, float(values.max()))
    ends = min(ends[0], low), max(ends[1], high)
    edge = 0.05 * (ends[1] - ends[0])
    ax.set(**{f"{axis}lim": (ends[0] - edge, ends[1] + edge)})
    times_as_much = float(f"{np.nanmax(np.abs(values)) / max(-low, high):.2g}")
    told = f"not shown: up to {times_as_much:,.0f} times the largest of the reference"
    ax.text(0.5, 0.02, told, transform=ax.transAxes, fontsize=7, color=INK, ha="center")


def stress_symbol(axis: str) -> str:
    """Return how a normal stress is written."""
    return rf"$\sigma_{{{axis}{axis}}}$"


def plot_stress_ratio(
    comparisons: Comparisons, line: Line, axes: str, pressure: float, *, believed: str = "reference"
) -> Figure:
    """Draw stress along a line over a pressure (Pa), and over the reference's.

    `axes`: the one along which it presses; with another, stress across is drawn over that along,
    too.
    """
    check_count(comparisons)
    along, symbol = ("stress", axes[0] * 2), stress_symbol(axes[0])
    figure = new_figure((4.2 * (1 + len(axes)) + 0.4 * (len(axes) == 1), 3.9))
    left, middle, *rest = figure.subplots(1, 1 + len(axes))
    plot_profile(left, comparisons, line, along, -pressure, f"−{symbol} / $p$")
    left.set_title(f"Share of the pressure p = {with_unit(pressure, 'Pa')}", **TITLE)
    pressed = [at_cells(comparison, line, along) for comparison in comparisons.values()]
    middle.axhline(1.0, color=INK, linewidth=1.6)
    _draw_judged(middle, line, [(distance, pair.ratio) for distance, pair in pressed])
    keep_to(middle, "y", np.ones(1), [pair.ratio for _, pair in pressed])
    middle.set_ylabel(f"{symbol} over that of {believed}", fontsize=9)
    middle.set_title(f"Over the stress of {believed}", **TITLE)
    for right in rest:
        profile = next(iter(comparisons.values())).along(line.start, line.end, 401)
        across = ("stress", axes[1] * 2)
        true = _over(pair_of(profile, *across).reference, pair_of(profile, *along).reference)
        right.plot(profile.distance, true, color=INK, linewidth=1.6)
        beside = [at_cells(comparison, line, across) for comparison in comparisons.values()]
        _draw_judged(
            right,
            line,
            [
                (distance, _over(above.values, below.values))
                for (distance, above), (_, below) in zip(beside, pressed, strict=True)
            ],
        )
        clear = true[
            np.abs(pair_of(profile, *along).reference) > 0.1 * pair_of(profile, *along).scale
        ]
        keep_to(right, "y", clear, [true])
        right.set_ylabel(f"{stress_symbol(axes[1])} / {symbol}", fontsize=9)
        right.set_title("Stress across over stress along", **TITLE)
    legend_below(figure, comparisons, believed)
    return figure


def _over(above: Floats, below: Floats) -> Floats:
    """Return a ratio, NaN where the divisor is next to nothing."""
    small = np.abs(below) < 1e-3 * np.abs(below).max(initial=0.0)
    return above / np.where(small | (below == 0.0), np.nan, below)


TITLE: Any = {"loc": "left", "fontsize": 10, "fontweight": "bold", "color": INK}


def check_count(comparisons: Comparisons) -> None:
    """Refuse more answers than there are colours."""
    if not 1 <= len(comparisons) <= MOST_PANELS:
        raise ParameterError(
            f"comparisons: between 1 and {MOST_PANELS} can be drawn, got {len(comparisons)}"
        )


def pair_of(of: Any, quantity: str, component: str = "") -> Pair:
    """Return a component of a comparison or a profile, or all of them."""
    pair: Pair | None = of.displacement if quantity == "displacement" else of.stress
    if pair is None:
        raise ParameterError(f"quantity: there is no {quantity!r} to compare")
    return pair.component(component) if component else pair


def at_cells(comparison: Comparison, line: Line, what: tuple[str, str]) -> tuple[Floats, Pair]:
    """Return a component at those points of a comparison that lie on a line."""
    start = np.asarray(line.start, dtype=np.float64)
    span = np.asarray(line.end, dtype=np.float64) - start
    length = float(np.linalg.norm(span))
    on_line = near_line(comparison.points, start, span / length, length)
    pair = pair_of(comparison, *what)
    row = [first_largest(-np.abs(comparison.points - p).sum(axis=1)) for p in on_line]
    chosen = Pair(pair.name, pair.unit, pair.values[row], pair.reference[row])
    return (on_line - start) @ (span / length), chosen


def look_of(number: int) -> dict[str, Any]:
    """Return how what is judged is drawn, by its number."""
    return {
        "color": COLOURS[number],
        "marker": MARKERS[number],
        "markersize": 4.0,
        "linewidth": 0.9,
        "markerfacecolor": "white",
        "markeredgewidth": 1.0,
    }


def legend_below(figure: Figure, comparisons: Comparisons, believed: str) -> None:
    """Say what the lines are, below the figure."""
    handles = [Line2D([], [], color=INK, linewidth=1.6, label=believed)]
    handles += [Line2D([], [], label=name, **look_of(n)) for n, name in enumerate(comparisons)]
    _explain(figure, handles)


def _explain(figure: Figure, handles: list[Line2D], **more: Any) -> None:
    look: dict[str, Any] = {"fontsize": 8, "frameon": False, **more}
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), **look)


_PALE = "#c2c2c2"


def plot_shapes(
    answers: Mapping[str, Any],
    believed: Any,
    *,
    name: str = "reference",
    magnification: float | None = None,
) -> Figure:
    """Draw the deformed cells of a plane body over those of the reference, all magnified alike."""
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
    _explain(figure, handles, title=f"displacement shown {times(factor)}", title_fontsize=8)
    return figure


def plot_error(
    comparison: Comparison,
    quantity: str = "displacement",
    ax: Axes | None = None,
    *,
    cut: Mapping[str, float] | None = None,
) -> Axes:
    """Draw where the error is, as a share of the reference's largest value."""
    pair, scene = pair_of(comparison, quantity), comparison.cells
    cells = scene.lattice.locate(comparison.points)
    worst = cells[first_largest(pair.error)]
    if scene.lattice.dimension == 3 and cut is None:
        cut = {"y": (float(worst[1]) + 0.5) * scene.lattice.cell_size}
    section = section_of(scene, None, cut, False)
    ax = new_axes(ax, (5.6, 4.8))
    draw_body(ax, section)
    drawn = draw_map(ax, section, cells, Quantity(pair.error, "error", "", signed=False))
    drawn.set_cmap(SIZE)
    colour_bar(ax, drawn, f"share of the reference's largest {quantity}")
    _place(ax, section, "")
    errors = f"largest {pair.max_error:.2g}, root mean square {pair.l2_error:.2g}"
    ax.set_title(f"Error of the {quantity}: {errors}", **TITLE)
    return ax


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


BELIEVED = "elasticity"


def pictures_beside(study: RuleStudy) -> dict[str, Figure]:
    """Return the figures, by what they show.

    "stress_ratio": stress down from the load as a share of the pressure, over that of elasticity,
    and stress across over stress along. "stress_rows": both normal stresses along rows. "deformed"
    (plane bodies only): the shapes. "displacement": down from the load, and along the rows. "cuts":
    the force through every cut across the load.
    """
    names = "xyz"[: study.scene.lattice.dimension]
    along, across = names[study.axis], names[0 if study.axis else 1]
    down, rows = _line(study, study.down), [_line(study, way) for way in study.rows()]
    found = study.comparisons
    stress = plot_stress_ratio(found, down, along + across, study.pressure, believed=BELIEVED)
    figures = {"stress_ratio": stress}
    symbols = {("stress", axis * 2): stress_symbol(axis) for axis in (along, across)}
    figures["stress_rows"] = _profiles(found, rows, symbols, BELIEVED)
    if study.scene.lattice.dimension == 2:
        shapes = {name: comparison.result for name, comparison in found.items()}
        figures["deformed"] = plot_shapes(shapes, study.believed, name=BELIEVED)
    moved = {("displacement", along): f"$u_{along}$"}
    figures["displacement"] = _profiles(found, [down, *rows], moved, BELIEVED)
    figures["cuts"] = _cuts_beside(study)
    return figures


def _line(study: RuleStudy, way: StraightWay) -> Line:
    across = "xyz"[0 if study.axis else 1]
    if way.depth is None:
        return Line("way down from the load", way.start, way.end)
    return Line(f"{across}, {quantity(way.depth, 'm')} below the load", way.start, way.end)


def _cuts_beside(study: RuleStudy) -> Figure:
    """Draw what every answer carries through its cuts, each over its distance from the load."""
    figure = new_figure((6.4, 4.2))
    ax = figure.add_subplot()
    believed, judged = study.cuts()
    ax.plot(believed.carried, believed.at, color=INK, linewidth=1.6)
    for number, cuts in enumerate(judged.values()):
        ax.plot(cuts.carried, cuts.at, **look_of(number))
    keep_to(ax, "x", believed.carried, [cuts.carried for cuts in judged.values()])
    frame_cuts(ax, believed)
    ax.set_title("Force through each cut", **TITLE)
    legend_below(figure, study.comparisons, BELIEVED)
    return figure


def words_beside(study: RuleStudy) -> list[str]:
    """Return sentences on how far each of the answers is off, and where."""
    lines = []
    unreached = study.unreached()
    believed, judged = study.cuts()
    for name, comparison in study.comparisons.items():
        lines.append(f"{name}: {_grade(comparison.displacement.misfit)}")
        lines.append(f"  {_off(comparison, 'displacement')}")
        if comparison.stress is not None:
            lines.append(f"  {_off(comparison, 'stress')}")
        ours, theirs = _carries(judged[name]), _carries(believed)
        lines.append(f"  carries {ours}" + (f" ({BELIEVED}: {theirs})" if ours != theirs else ""))
        if unreached.get(name, 0.0) > 0.01:
            lines.append(
                f"  {unreached[name]:.0%} of the squared error of the displacement lies where no "
                "load arrived"
            )
    if study.fit is not None:
        lines.append(f"the fit: {study.fit}")
    return lines


def _carries(cuts: Cuts) -> str:
    """Say between which forces the cuts carry; the same when they differ by rounding only."""
    least, most = float(cuts.carried.min()), float(cuts.carried.max())
    if most - least <= KEPT * max(abs(least), abs(most)):
        return f"{quantity(most, 'N')} through every cut"
    return f"{quantity(least, 'N')} to {quantity(most, 'N')} through its cuts"


def _grade(misfit: float) -> str:
    if misfit < 0.03:
        return "the answer of elasticity, nearly"
    if misfit < 0.3:
        return "close to elasticity"
    return "the trend of elasticity" if misfit < 0.7 else "hardly closer than no answer at all"


def _off(comparison: Comparison, what: str) -> str:
    pair = comparison.displacement if what == "displacement" else comparison.stress
    assert pair is not None
    place = comparison.points[first_largest(pair.error)]
    edges = ", ".join(f"{1e3 * value:.4g}" for value in place)
    return (
        f"{what} off by up to {pair.max_error:.1%} of the largest "
        f"({quantity(pair.scale, pair.unit)}), at ({edges}) mm; by {pair.l2_error:.1%} in the "
        f"mean square; misfit {pair.misfit:.3g} (1: no better than nothing)"
    )
