"""The stage on which everything is shown: the body and what holds it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Patch
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.scene import kinds

from .forces import draw_forces
from .style import (
    BODY,
    BODY_HATCHES,
    INK,
    LEGEND_COLUMNS,
    LINE,
    add_polygons,
    caption,
    fit_figure,
    label_axis,
    legend,
    new_axes,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.text import Text

    from kaju.model.scene import Scene

    from .section import Section

_SUPPORTS = {
    kinds.RIGID: ("rigid", "////"),
    kinds.ROLLER: ("roller", "oo"),
    kinds.FOUNDATION: ("elastic bed", "xx"),
    kinds.DISPLACED: ("moved wall", "\\\\\\\\"),
}
_EDGES_UP_TO = 90  # tiles across, above which their edges are not drawn
_WIDEST = 3.0  # pictures are at most this much wider than high
_NARROWEST = 0.55
_TRUE_UP_TO = 30.0  # longer bodies than this are not drawn to scale


def draw_body(ax: Axes, section: Section, *, filled: bool = True) -> list[Artist]:
    """Draw body and supports; return what explains them in a legend.

    Parameters
    ----------
    ax : matplotlib Axes
        Where to draw.
    section : Section
        What part of the body.
    filled : bool
        False leaves the material out (for pictures that draw it deformed).
    """
    tiles, kind = section.ground
    entries: list[Artist] = []
    across = int((section.upper - section.lower).max()) // section.block
    separate = across <= _EDGES_UP_TO
    edge = LINE if separate else "none"
    for number, material in enumerate(section.scene.cell_materials if filled else ()):
        chosen = kind == number
        if chosen.any():
            some = tiles[chosen]
            colour, hatch = BODY[number % len(BODY)], BODY_HATCHES[number % len(BODY_HATCHES)]
            add_polygons(
                ax,
                section.polygons(some) if separate else section.stripes(some),
                f"material {material.name}",
                facecolors=colour,
                edgecolors="#b5b5b5" if hatch else edge,
                linewidths=0.0 if edge == "none" else 0.4,
                hatch=hatch or None,
                antialiased=edge != "none",
                zorder=1,
            )
            entries.append(
                Patch(facecolor=colour, edgecolor="#9a9a9a", hatch=hatch, label=material.name)
            )
    entries += _draw_supports(ax, section, tiles, kind)
    surface, joints = section.outlines()
    if filled:
        ax.add_collection(LineCollection(list(surface), colors=INK, linewidths=0.9, zorder=4))
        ax.add_collection(LineCollection(list(joints), colors=INK, linewidths=0.6, zorder=4))
    return entries


def _draw_supports(ax: Axes, section: Section, tiles: Ints, kind: Ints) -> list[Artist]:
    entries: list[Artist] = []
    idle = _beside_no_body(section, tiles, kind)
    for code, (name, hatch) in _SUPPORTS.items():
        chosen = (kind == code) & ~idle
        if not chosen.any():
            continue
        add_polygons(
            ax,
            section.stripes(tiles[chosen]),
            f"support {name}",
            facecolors="white",
            edgecolors="#6b6b6b",
            linewidths=0.0,
            hatch=hatch,
            zorder=1,
        )
        entries.append(Patch(facecolor="white", edgecolor="#6b6b6b", hatch=hatch, label=name))
    return entries


def _beside_no_body(section: Section, tiles: Ints, kind: Ints) -> NDArray[np.bool_]:
    """Tell which tiles lie beyond a side of the array where no body touches it."""
    first = tiles.min(axis=0) - 1
    body = np.zeros(tiles.max(axis=0) - first + 2, dtype=np.bool_)
    body[tuple((tiles - first)[kind >= 0].T)] = True
    near = body.copy()
    for axis in (0, 1):  # a tile and its eight neighbours
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
    shape = np.array(section.scene.lattice.shape)[[*section.axes]]
    inside = np.all((tiles >= 0) & (tiles * section.block < shape), axis=1)
    beside: NDArray[np.bool_] = ~inside & ~near[tuple((tiles - first).T)]
    return beside


def finish(ax: Axes, section: Section, title: str, notes: list[str], entries: list[Artist]) -> Text:
    """Set scales, labels, title, notes and legend of a picture of a section; return the notes."""
    lower, upper = section.box
    width, height = upper - lower
    ratio = width / height
    notes = [*notes, *section.notes]
    if not 1.0 / _TRUE_UP_TO <= ratio <= _TRUE_UP_TO:
        ax.set_aspect("auto")
        notes.append("not to scale: the picture is stretched across the body's length")
    else:
        ax.set_aspect("equal")
        # Long bodies lie in a frame of moderate form, so that there is room for words.
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        half = np.maximum(half, [half[1] * _NARROWEST, half[0] / _WIDEST])
        lower, upper = middle - half, middle + half
    reach = _reach(ax, section)
    lower, upper = np.minimum(lower, reach.min(axis=0)), np.maximum(upper, reach.max(axis=0))
    ax.set_xlim(lower[0], upper[0])
    ax.set_ylim(lower[1], upper[1])
    for axis, name, low, high in zip(
        (ax.xaxis, ax.yaxis), section.axis_names, lower, upper, strict=True
    ):
        label_axis(axis, name, [float(low), float(high)], "m")
    for spine in ax.spines.values():
        spine.set_color(LINE)
    stretched = ax.get_aspect() == "auto"
    form = 1.6 if stretched else float((upper - lower)[0] / (upper - lower)[1])
    fit_figure(ax, form, -(-len(entries) // LEGEND_COLUMNS))
    legend(ax, entries)
    return caption(ax, title, notes)


def _reach(ax: Axes, section: Section) -> Floats:
    """Return the box of everything that may stick out of the section: arrows, moved cells."""
    found = [section.box]
    for collection in ax.collections:
        if collection.get_gid() in ("forces", "moved") and collection.get_paths():
            points = np.concatenate([path.vertices for path in collection.get_paths()])
            found.append(np.stack([points.min(axis=0), points.max(axis=0)]))
    return np.concatenate(found)


def draw_scene(scene: Scene, section: Section, ax: Axes | None = None) -> Axes:
    """Draw what is asked: body, supports and loads."""
    ax = new_axes(ax)
    entries = draw_body(ax, section)
    notes = draw_forces(ax, section)
    finish(ax, section, "The scene", notes, entries)
    return ax
