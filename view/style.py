"""The look that all pictures share: colours, figures without a display, captions, legends.

Figures are made with Matplotlib's objects, never with pyplot: nothing is kept behind the
scenes, no display is needed, and pictures can be made in threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from math import ceil, log10
from pathlib import Path
from textwrap import wrap
from typing import Any, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from matplotlib.transforms import ScaledTranslation

from kaju.arrays import Floats
from kaju.errors import ResultFileError
from kaju.files import atomic_file

from .units import scale_for

INK = "#262626"
FAINT = "#6b6b6b"
LINE = "#c9c9c9"
FORCE = "#b2340b"
"""Applied forces: a vermilion that stays apart from every colour map used here."""
PULL = "#c51b8a"
"""Loads that pull, where those that push have the colour of forces."""
BODY = ("#ececec", "#e6d9be", "#cfe0ea", "#d9e3cf", "#e7d3dc", "#d6d4e6")
"""Materials that no load has reached; the first six, then again."""
BODY_HATCHES = ("", "...", "--", "oo", "++", "**")
"""So that materials differ without colour."""

COLOURS = ("#c8963e", "#b2340b", "#0b5394", "#4d8b57", "#8a5aa8")
"""Of several curves in one chart."""

SEQUENTIAL = "viridis"
SIZE = "YlGnBu"
"""For sizes from 0 upwards: light where there is little, as the body is."""
LOADS = ListedColormap(
    colormaps["cividis_r"](np.linspace(0.22, 1.0, 256)), "cividis_r without its palest part"
)
PULLS = ListedColormap(colormaps["RdPu"](np.linspace(0.4, 1.0, 256)), "RdPu without its pale part")
"""For loads that pull, as dark as `LOADS` for those that push."""
RIM: dict[str, Any] = {"edgecolors": "#3a3a3a", "linewidths": 0.25}
"""Of small things in the colours of `LOADS`, which may lie on a body of the same shade."""
DIVERGING = "PuOr_r"

RESOLUTION = 150
"""Dots per inch of saved pictures."""
_OWN = "kaju"  # marks figures that were made here and may be resized


class ShownFigure(Figure):
    """A figure that a notebook shows although no display was asked for."""

    def _repr_png_(self) -> bytes:
        """Return what a notebook shows."""
        data = BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


def new_figure(size: tuple[float, float]) -> Figure:
    """Return an empty figure of a size in inches that arranges its own parts."""
    figure = ShownFigure(figsize=size, dpi=RESOLUTION, layout="compressed", facecolor="white")
    FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    assert isinstance(engine, ConstrainedLayoutEngine)
    engine.set(w_pad=0.08, h_pad=0.08)  # inches
    figure.set_gid(_OWN)
    return figure


def save(figure: Figure, path: str | Path) -> Path:
    """Write a picture; the ending of the name decides the format."""
    target = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if target.suffix.lstrip(".").lower() not in known:
        raise ResultFileError(
            f"{target}: {target.suffix or 'no ending'!r} is no format of pictures; "
            f"choose .png, .svg or .pdf (there is {', '.join(sorted(known))})"
        )
    with atomic_file(target, ResultFileError) as scratch:
        figure.savefig(scratch, dpi=RESOLUTION)
    return target


def new_axes(
    ax: Axes | None, size: tuple[float, float] = (6.4, 4.8), projection: str | None = None
) -> Axes:
    """Return `ax`, or axes in a new figure of a size in inches."""
    return ax if ax is not None else new_figure(size).add_subplot(projection=projection)


def fit_figure(ax: Axes, ratio: float, handles: Sequence[Artist] = ()) -> None:
    """Give a figure of our own the size for axes of width/height `ratio`, and for a legend."""
    figure = figure_of(ax)
    bars = len(figure.axes) - 1
    if figure.get_gid() != _OWN or bars > 1:
        return
    width = min(5.6, max(3.6, 4.9 * ratio))
    height = min(max(width / ratio, 1.6), 5.4)
    figure.set_figwidth(width + 0.85 + 0.95 * bars)
    lines = max(1, -(-len(handles) // _columns(figure, handles)))
    figure.set_figheight(height + 1.25 + 0.19 * lines)


def _columns(figure: Figure, handles: Sequence[Artist]) -> int:
    """Return into how many columns, at most three, a figure's legend fits."""
    letters = np.array([len(str(handle.get_label())) for handle in handles])
    for columns in (3, 2):
        widest = [part.max(initial=0) for part in np.array_split(letters, columns)]
        if 4.6 * sum(widest) + 34.0 * columns <= 72.0 * figure.get_figwidth():  # points
            return columns
    return 1


def add_polygons(ax: Axes, corners: Floats, name: str, **look: Any) -> PolyCollection:
    """Add many polygons at once, corners of shape (n, corners, 2); `name` is kept as their gid."""
    drawn = PolyCollection(cast(Any, corners), gid=name, **look)
    ax.add_collection(drawn)
    return drawn


def figure_of(ax: Axes) -> Figure:
    """Return the figure that axes belong to."""
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    return figure


def caption(ax: Axes, title: str, notes: Sequence[str]) -> Text:
    """Set the title, and under it, smaller, what a reader must know; return the latter."""
    figure = figure_of(ax)
    room = 0.82 * figure.get_figwidth()
    if len(figure.axes) > 2:
        room = 0.95 * ax.get_position().width * figure.get_figwidth()
    letters = int(room / (4.6 / 72.0))  # of a mean width of so many inches
    lines = [line for note in notes if note for line in wrap(note, letters)]
    pad = 6.0 + 10.6 * len(lines)
    ax.set_title(title, loc="left", fontsize=11, fontweight="bold", color=INK, pad=pad)
    look: dict[str, Any] = {"va": "bottom", "fontsize": 8, "color": FAINT, "linespacing": 1.25}
    look |= {"xycoords": "axes fraction", "textcoords": "offset points", "gid": "notes"}
    text = ax.annotate("\n".join(lines), (0.0, 1.0), (0.0, 5.0), annotation_clip=False, **look)
    text.set_in_layout(False)  # its height is in the title's pad; its width may overhang
    return text


def label_axis(axis: Axis, name: str, values: Sequence[float], unit: str) -> None:
    """Label an axis whose values are in a base unit with a prefixed one.

    Far from its zero, an axis is numbered from a round place nearby, which its label states.
    """
    low, high = float(min(values)), float(max(values))
    offset, span = 0.0, high - low
    if span > 0.0 and max(abs(low), abs(high)) > 100.0 * span:
        step = 10.0 ** ceil(log10(span))
        offset = step * round(0.5 * (low + high) / step)
        far = scale_for([offset], unit)
        name = f"{name} − {offset / far.factor:.12g} {far.unit}"
    scale = scale_for([low - offset, high - offset], unit)
    axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    still = 1e-9 * span  # what rounding leaves of a zero
    axis.set_major_formatter(
        lambda value, _: scale.text(0.0 if abs(value - offset) < still else value - offset)
    )
    axis.set_label_text(f"{name} ({scale.unit})" if scale.unit else name, fontsize=9)
    axis.set_tick_params(labelsize=8, color=FAINT)


def colour_bar(
    ax: Axes, mappable: ScalarMappable, label: str, unit: str | None = None, extend: str = "neither"
) -> Colorbar:
    """Add a colour bar in a prefixed unit, or in powers of ten if that is empty.

    Without a unit numbers stay as they are; `extend` points on to values beyond the bar's ends.
    """
    norm = mappable.norm
    pad = 0.02 if ax.name != "3d" else 0.1
    look: dict[str, Any] = {"shrink": 0.85, "aspect": 28, "pad": pad, "extend": extend}
    bar = figure_of(ax).colorbar(mappable, ax=ax, **look)
    low, high = cast(float, norm.vmin), cast(float, norm.vmax)
    if isinstance(norm, LogNorm):
        decades = log10(high / low)
        bar.locator = LogLocator(subs=(1.0,) if decades > 3.0 else (1.0, 2.0, 5.0))
        bar.minorlocator = NullLocator()
    if unit is not None:
        scale = scale_for([low, high], unit)
        bar.formatter = FuncFormatter(scale.text)
        label = f"{label} ({scale.unit})" if scale.unit else label
    bar.update_ticks()
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)
    bar.outline.set_linewidth(0.5)
    return bar


def count_norm(first: int, last: int) -> Normalize:
    """Return the scale of whole numbers: single colours while there are few."""
    if last - first < 24:
        return BoundaryNorm(np.arange(first - 0.5, max(first, last) + 1.0), 256)
    return Normalize(first, last)


def count_bar(ax: Axes, mappable: ScalarMappable, label: str) -> None:
    """Add the colour bar of whole numbers."""
    bar = colour_bar(ax, mappable, label)
    bar.locator = MaxNLocator(12, integer=True)
    bar.update_ticks()
    bar.ax.minorticks_off()


def legend(ax: Axes, handles: Sequence[Artist]) -> None:
    """Explain symbols below the picture."""
    if not handles:
        return
    below = ax.transAxes + ScaledTranslation(0.0, -34.0 / 72.0, figure_of(ax).dpi_scale_trans)
    columns = _columns(figure_of(ax), handles)
    place = {"loc": "upper left", "bbox_to_anchor": (0.0, 0.0), "bbox_transform": below}
    look: dict[str, Any] = {"fontsize": 8, "frameon": False, "borderaxespad": 0.0}
    look |= place | {"ncols": columns, "handlelength": 1.4, "columnspacing": 1.4}
    ax.legend(handles=list(handles), **look)


# Corners of an arrow: how far along it from the head backwards, in head lengths (-1: at the
# tail), and how far aside, in shaft widths.
_BACK = np.array([0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
_ASIDE = np.array([0.0, 1.6, 0.5, 0.5, -0.5, -0.5, -1.6])


def arrow_polygons(tail: Floats, head: Floats, width: Floats) -> Floats:
    """Return the outlines of straight arrows, shape (n, 7, 2).

    `tail`, `head`, shape (n, 2): where the arrows begin and end; `width`, shape (n,): width of the
    shafts. A head is 3.2 shafts broad and 3.4 long, at most 0.6 of the arrow.
    """
    along = head - tail
    length = np.linalg.norm(along, axis=1)
    safe = np.where(length > 0.0, length, 1.0)
    unit = along / safe[:, None]
    aside = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    head_length = np.minimum(3.4 * width, 0.6 * length)
    back = np.where(_BACK < 0.0, length[:, None], head_length[:, None] * _BACK)
    return np.asarray(
        head[:, None]
        - back[:, :, None] * unit[:, None]
        + (width[:, None] * _ASIDE)[:, :, None] * aside[:, None]
    )
