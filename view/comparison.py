"""Answers side by side: along lines, as shapes, through cuts, as maps of the error, and in words.

The reference is drawn as a line in ink, whatever is judged by it in colours with markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kaju.arrays import Floats, first_largest
from kaju.errors import ParameterError
from kaju.model.study.compare import Comparison, Pair, near_line

from . import style
from .body_plots import draw_body, draw_forces, reach_of
from .charts import KEPT, frame_cuts
from .deformed import moving_cells
from .maps import Quantity, draw_map
from .section import Section, section_of
from .style import COLOURS, INK
from .units import quantity, times, visible

if TYPE_CHECKING:
    from kaju.model.results.cuts import Cuts
    from kaju.model.study.rule_study import RuleStudy, StraightWay

BELIEVED = "elasticity"
TITLE: Any = {"loc": "left", "fontsize": 10, "fontweight": "bold", "color": INK}
Shown = tuple[str, str, str]
"""What a row of panels shows: a quantity, its component, and how it is called."""


def pair_of(of: Any, quantity: str, component: str = "") -> Pair:
    """Return a component of a comparison or a profile, or all of them."""
    pair: Pair | None = of.displacement if quantity == "displacement" else of.stress
    if pair is None:
        raise ParameterError(f"quantity: there is no {quantity!r} to compare")
    return pair.component(component) if component else pair


def _draw_along(
    ax: Axes, found: Mapping[str, Comparison], line: StraightWay, across: str, shown: Shown
) -> None:
    """Draw a quantity along one line: of the reference, and of all that is judged by it."""
    what, component, label = shown
    profile = next(iter(found.values())).along(line.start, line.end, 401)
    pair = pair_of(profile, what, component)
    ax.plot(profile.distance, pair.reference, color=INK, linewidth=1.6)
    start, span = np.asarray(line.start, dtype=np.float64), np.subtract(line.end, line.start)
    length = float(np.linalg.norm(span))
    judged = []
    for number, comparison in enumerate(found.values()):
        points = near_line(comparison.points, start, span / length, length)
        row = [first_largest(-np.abs(comparison.points - p).sum(axis=1)) for p in points]
        judged.append(pair_of(comparison, what, component).values[row])
        ax.plot((points - start) @ (span / length), judged[-1], **_look(number))
    _keep_to(ax, "y", pair.reference, judged)
    style.label_axis(ax.yaxis, label, [*ax.get_ylim()], pair.unit)
    title = "way down from the load"
    if line.depth is not None:
        title = f"{across}, {quantity(line.depth, 'm')} below the load"
    style.label_axis(ax.xaxis, title, [0.0, length], "m")
    ax.grid(True, color="#ececec", linewidth=0.6)
    ax.axhline(0.0, color="#b5b5b5", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _keep_to(ax: Axes, axis: str, reference: Floats, judged: Sequence[Floats]) -> None:
    """Keep an axis near the reference, and say so where what is judged leaves the picture."""
    low, high = min(0.0, float(np.nanmin(reference))), max(0.0, float(np.nanmax(reference)))
    least, most = 3.0 * low - 2.0 * high, 3.0 * high - 2.0 * low  # farther out is not shown
    values = np.concatenate(judged)
    values = values[np.isfinite(values)]
    if len(values) == 0 or (least <= values.min() and values.max() <= most):
        return
    ends = max(least, float(values.min())), min(most, float(values.max()))
    ends = min(ends[0], low), max(ends[1], high)
    edge = 0.05 * (ends[1] - ends[0])
    ax.set(**{f"{axis}lim": (ends[0] - edge, ends[1] + edge)})
    times_as_much = float(f"{np.abs(values).max() / max(-low, high):.2g}")
    told = f"not shown: up to {times_as_much:,.0f} times the largest of the reference"
    ax.text(0.5, 0.02, told, transform=ax.transAxes, fontsize=7, color=INK, ha="center")


def _profiles(study: RuleStudy, rows: Sequence[Shown]) -> Figure:
    """Draw quantities down from the load and along rows: a row of panels each."""
    lines, across = [study.down, *study.rows()], "xyz"[0 if study.axis else 1]
    figure = style.new_figure((4.1 * len(lines) + 0.5, 3.3 * len(rows) + 0.6))
    panels = figure.subplots(len(rows), len(lines), squeeze=False)
    for shown, row in zip(rows, panels, strict=True):
        for ax, line in zip(row, lines, strict=True):
            _draw_along(ax, study.comparisons, line, across, shown)
    _legend_below(figure, study.comparisons)
    return figure


def _look(number: int) -> dict[str, Any]:
    """Return how what is judged is drawn, by its number."""
    look = {"color": COLOURS[number], "marker": "sDo^v"[number], "markersize": 4.0}
    return look | {"linewidth": 0.9, "markerfacecolor": "white", "markeredgewidth": 1.0}


def _legend_below(figure: Figure, found: Mapping[str, object]) -> None:
    """Say what the lines are, below the figure."""
    handles = [Line2D([], [], color=INK, linewidth=1.6, label=BELIEVED)]
    handles += [Line2D([], [], label=name, **_look(n)) for n, name in enumerate(found)]
    _explain(figure, handles)


def _explain(figure: Figure, handles: list[Line2D], **more: Any) -> None:
    look: dict[str, Any] = {"fontsize": 8, "frameon": False, **more}
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), **look)


def plot_shapes(answers: Mapping[str, Any], believed: Any) -> Figure:
    """Draw the deformed cells of a plane body over those of the reference, all magnified alike."""
    section = section_of(next(iter(answers.values())).scene, None, None, False)
    true, pale = moving_cells(believed, section), "#c2c2c2"
    moved = {label: moving_cells(answer, section) for label, answer in answers.items()}
    largest = max(float(np.abs(tiles.moved).max()) for tiles in (true, *moved.values()))
    factor = visible(section.span, largest)
    figure = style.new_figure((3.3 * len(answers) + 0.4, 3.9))
    axes = figure.subplots(1, len(answers), sharey=True, squeeze=False)[0]
    handles = [Line2D([], [], color=pale, linewidth=2.4, label=BELIEVED)]
    for ax, (label, tiles), colour in zip(axes, moved.items(), COLOURS, strict=False):
        for shown, ink, width in ((true, pale, 2.4), (tiles, colour, 0.8)):
            look: dict[str, Any] = {"facecolors": "none", "edgecolors": ink, "linewidths": width}
            style.add_polygons(ax, shown.rest + factor * shown.moved, "moved", **look)
        draw_forces(ax, section)
        _frame(ax, section, label)
        handles.append(Line2D([], [], color=colour, label=label))
    _explain(figure, handles, title=f"displacement shown {times(factor)}", title_fontsize=8)
    return figure


def plot_error(comparison: Comparison, quantity: str = "displacement") -> Axes:
    """Draw where the error is, as a share of the reference's largest value."""
    pair, scene = pair_of(comparison, quantity), comparison.cells
    cells = scene.lattice.locate(comparison.points)
    cut = {"y": float(comparison.points[first_largest(pair.error)][1])}
    section = section_of(scene, None, cut if scene.lattice.dimension == 3 else None, False)
    ax = style.new_axes(None, (5.6, 4.8))
    draw_body(ax, section)
    drawn = draw_map(ax, section, cells, Quantity(pair.error, "error", "", signed=False))
    style.colour_bar(ax, drawn, f"share of the reference's largest {quantity}")
    _frame(ax, section, "")
    errors = f"largest {pair.max_error:.2g}, root mean square {pair.l2_error:.2g}"
    ax.set_title(f"Error of the {quantity}: {errors}", **TITLE)
    return ax


def _frame(ax: Axes, section: Section, title: str) -> None:
    lower, upper = reach_of(ax, section, ("forces",))
    ax.set(aspect="equal", xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    ax.set_title(title, fontsize=9, color=INK)


def pictures_beside(study: RuleStudy) -> dict[str, Figure]:
    """Return the figures, by what they show.

    "stress" and "displacement": both normal stresses, and the displacement along the load, down
    from the load and along rows. "deformed" (plane bodies only): the shapes. "cuts": the force
    through every cut across the load.
    """
    names = "xyz"[: study.scene.lattice.dimension]
    along, across = names[study.axis], names[0 if study.axis else 1]
    stresses = [("stress", axis * 2, rf"$\sigma_{{{axis * 2}}}$") for axis in (along, across)]
    figures = {"stress": _profiles(study, stresses)}
    if study.scene.lattice.dimension == 2:
        shapes = {name: comparison.result for name, comparison in study.comparisons.items()}
        figures["deformed"] = plot_shapes(shapes, study.believed)
    moved = ("displacement", along, f"$u_{along}$")
    return figures | {"displacement": _profiles(study, [moved]), "cuts": _cuts_beside(study)}


def _cuts_beside(study: RuleStudy) -> Figure:
    """Draw what every answer carries through its cuts, each over its distance from the load."""
    figure = style.new_figure((6.4, 4.2))
    ax = figure.add_subplot()
    believed, judged = study.cuts()
    ax.plot(believed.carried, believed.at, color=INK, linewidth=1.6)
    for number, cuts in enumerate(judged.values()):
        ax.plot(cuts.carried, cuts.at, **_look(number))
    _keep_to(ax, "x", believed.carried, [cuts.carried for cuts in judged.values()])
    frame_cuts(ax, believed)
    ax.set_title("Force through each cut", **TITLE)
    _legend_below(figure, study.comparisons)
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
    return "the trend of elasticity" if misfit < 0.7 else "hardly better than no answer at all"


def _off(comparison: Comparison, what: str) -> str:
    pair = pair_of(comparison, what)
    place = comparison.points[first_largest(pair.error)]
    edges = ", ".join(f"{1e3 * value:.4g}" for value in place)
    return (
        f"{what} off by up to {pair.max_error:.1%} of the largest "
        f"({quantity(pair.scale, pair.unit)}), at ({edges}) mm; by {pair.l2_error:.1%} in the "
        f"mean square; misfit {pair.misfit:.3g} (1: no better than nothing)"
    )
