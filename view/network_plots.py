"""Spring networks: how they deform, which springs are pulled and which are pressed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.text import Text
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError

from .films import Film
from .style import (
    DIVERGING,
    FAINT,
    FORCE,
    INK,
    LINE,
    add_polygons,
    arrow_polygons,
    caption,
    colour_bar,
    fit_figure,
    frame_curves,
    label_axis,
    legend,
    new_axes,
)
from .units import quantity, round_down, times

if TYPE_CHECKING:
    from kaju.model.network.network_result import NetworkResult

Colour = Literal["tension", "strain"]

_VISIBLE = 0.03  # of the network's size: smaller displacements are magnified up to 0.08
_MOST_NODES = 2000  # above this, nodes are not drawn one by one


def visible(positions: Floats, moved: float) -> float:
    """Return by how much displacements of a network up to `moved` (m) are magnified."""
    size = float(np.ptp(positions, axis=0).max())
    if moved == 0.0 or moved >= _VISIBLE * size:
        return 1.0
    return max(1.0, round_down(0.08 * size / moved))


class NetworkPicture:
    """Axes for the states of one network, with its frame, colours and magnification."""

    def __init__(
        self,
        result: NetworkResult,
        ax: Axes | None,
        colour: Colour,
        magnification: float | None,
        largest: float | None = None,
    ) -> None:
        if colour not in ("tension", "strain"):
            raise ParameterError(f"colour: 'tension' or 'strain', got {colour!r}")
        if magnification is not None and not 0.0 < magnification < np.inf:
            raise ParameterError(f"magnification: a number above 0, got {magnification}")
        self.result, self.network = result, result.network
        self.colour = colour
        self.flat = self.network.dimension == 2
        self.ax = new_axes(ax, (6.8, 6.2), None if self.flat else "3d")
        if not self.flat:
            cast(Axes3D, self.ax).computed_zorder = False  # or rims would hide their springs
        moved = float(np.abs(result.displacement).max(initial=0.0))
        self.factor = magnification or visible(self.network.positions, moved)
        largest = largest or max(
            (float(np.abs(self.values(record)).max(initial=0.0)) for record in self.records),
            default=0.0,
        )
        self.norm = Normalize(-(largest or 1.0), largest or 1.0)
        label = "tension: pulled above 0, pressed below" if colour == "tension" else "strain"
        unit = "N" if colour == "tension" else ""
        colour_bar(self.ax, ScalarMappable(self.norm, DIVERGING), label, unit)

    @property
    def records(self) -> range:
        """Numbers of the states."""
        return range(len(self.result.stage))

    def values(self, record: int) -> Floats:
        """Return what the colours mean, of every spring."""
        if self.colour == "tension":
            return np.asarray(self.result.tension[record])
        return self.result.strain(record)

    def places(self, record: int) -> Floats:
        """Return where the nodes are drawn (m)."""
        return np.asarray(self.network.positions + self.factor * self.result.displacement[record])

    def draw_lines(self, places: Floats, springs: Ints, name: str, **look: Any) -> Artist:
        """Draw springs between places of the nodes (m); return the artist."""
        kind = LineCollection if self.flat else Line3DCollection
        lines = kind(cast(Any, places[springs]), gid=name, **look)
        cast(Any, self.ax).add_collection(lines, autolim=False)
        return lines

    def draw_springs(self, record: int) -> list[Artist]:
        """Draw the springs of one state; return the artists."""
        where, values = (self.places(record), self.network.springs), self.values(record)
        width = max(0.5, min(2.2, 60.0 / np.sqrt(len(values))))
        look: dict[str, Any] = {"array": values, "cmap": DIVERGING, "norm": self.norm}
        # What carries little is nearly white, so every spring has a darker rim.
        rim = {"colors": "#b0b0b0", "linewidths": width + 0.8}
        return [
            self.draw_lines(*where, "springs", **look, linewidths=width, zorder=3),
            self.draw_lines(*where, "rims", **rim, zorder=2),
            *self._draw_nodes(record),
        ]

    def _draw_nodes(self, record: int) -> list[Artist]:
        places, held = self.places(record), self.network.held.any(axis=1)
        groups = [(held, "^", INK, "held nodes")]
        if len(places) <= _MOST_NODES:
            groups = [(~held, "o", INK, "nodes"), (held, "^", "white", "held nodes")]
        size = max(1.5, min(4.0, 60.0 / np.sqrt(len(places))))
        drawn: list[Artist] = []
        for chosen, marker, face, name in groups:
            if chosen.any():
                mark = 1.6 * size if marker == "^" else size
                style = {"marker": marker, "ms": mark, "mfc": face, "mec": INK, "mew": 0.7}
                style |= {"ls": "", "zorder": 4, "gid": name}
                drawn += cast(Any, self.ax).plot(*places[chosen].T, **style)
        return [*drawn, *self._draw_forces(record)]

    def _draw_forces(self, record: int) -> list[Artist]:
        every = self.network.force_at(float(self.result.stage[record]))
        loaded = np.flatnonzero(every.any(axis=1))
        if not len(loaded):
            return []
        span = float(np.ptp(self.network.positions, axis=0).max())
        along = 0.16 * span / np.linalg.norm(self.network.forces, axis=2).max() * every[loaded]
        head = self.places(record)[loaded]
        if not self.flat:
            arrows = self.ax.quiver(*(head - along).T, *along.T, color=FORCE, lw=1.8, gid="forces")
            return [arrows]
        width = np.full(len(head), 0.012 * span / max(1.0, len(head) / 12.0))
        outlines = arrow_polygons(head - along, head, width)
        return [add_polygons(self.ax, outlines, "forces", fc=FORCE, ec="white", lw=0.4, zorder=6)]

    def draw_rest(self) -> None:
        """Draw the network before any load, faintly."""
        where = self.network.positions, self.network.springs
        self.draw_lines(*where, "at rest", colors=LINE, linewidths=0.6, linestyles="--", zorder=1)

    def finish(self, notes: list[str]) -> Text:
        """Set frame, labels, legend and title; return the notes."""
        places = np.concatenate([self.places(record) for record in self.records])
        lower, upper = places.min(axis=0), places.max(axis=0)
        room = 0.2 * float((upper - lower).max() or 1.0)
        if not self.network.forces.any():
            room *= 0.25
        for name, low, high in zip("xyz", lower - room, upper + room, strict=False):
            getattr(self.ax, f"set_{name}lim")(low, high)
            label_axis(getattr(self.ax, f"{name}axis"), name, [float(low), float(high)], "m")
        if self.flat:
            self.ax.set_aspect("equal")
            for spine in self.ax.spines.values():
                spine.set_color(LINE)
            width, height = (upper - lower) + 2.0 * room
            fit_figure(self.ax, float(width / height), 1)
        else:
            cast(Axes3D, self.ax).set_box_aspect(upper - lower + 2.0 * room)
        if self.network.held.any():
            mark = Line2D([], [], ls="", marker="^", mfc="white", mec=INK, label="held node")
            rest = Line2D([], [], ls="--", lw=0.8, color=FAINT, label="before the load")
            legend(self.ax, [mark, rest])
        return caption(self.ax, "Spring network", notes)

    def notes(self, record: int) -> list[str]:
        """Return load, displacement and magnification of one state."""
        _, far = self.result.largest_displacement(record)
        stage = float(self.result.stage[record])
        force = float(np.linalg.norm(self.network.force_at(stage), axis=1).max(initial=0.0))
        parts = [f"largest force {quantity(force, 'N')}"] if self.network.forces.any() else []
        parts.append(f"largest displacement {quantity(far, 'm')}")
        return ["; ".join(parts), f"deformation shown {times(self.factor)}"]


def plot_network(
    result: NetworkResult,
    ax: Axes | None = None,
    *,
    record: int = -1,
    colour: Colour = "tension",
    magnification: float | None = None,
) -> Axes:
    """Draw a loaded network over the one at rest, its springs coloured by tension or strain."""
    picture = NetworkPicture(result, ax, colour, magnification)
    if not -len(picture.records) <= record < len(picture.records):
        raise ParameterError(
            f"record: this result has the records 0 to {len(picture.records) - 1}, got {record}"
        )
    picture.draw_rest()
    picture.draw_springs(record)
    notes, last = picture.notes(record), len(picture.records) - 1
    if last > 1:
        notes[0] = f"increment {record % (last + 1)} of {last}; {notes[0]}"
    picture.finish(notes)
    return picture.ax


def plot_response(result: NetworkResult, ax: Axes | None = None) -> Axes:
    """Draw how far the node that moves most has moved, along the load path."""
    name, _ = result.largest_displacement()
    moved = np.linalg.norm(result.displacement[:, result.network.node(name)], axis=1)
    ax = new_axes(ax, (6.4, 4.2))
    ax.plot(result.stage, moved, marker="o", ms=4, lw=1.4, color=INK, label=f"node {name}")
    if result.network.stages == 1:
        ends = [0.0, float(result.stage[-1])]
        ax.plot(ends, [0.0, moved[-1]], ls="--", lw=1.0, color=FAINT, label="proportional")
    label_axis(ax.xaxis, "load path (1: end of the first stage)", list(result.stage), "")
    label_axis(ax.yaxis, "displacement", list(moved), "m")
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    return frame_curves(ax, "Displacement along the load path", [], loc="upper left")


INCREMENTS = Film("deformed", "record", lambda result: range(len(result.stage)))
"""The states of a network along its load path."""
