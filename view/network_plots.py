"""Spring networks: how they deform, which springs are pulled and which are pressed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from kaju.arrays import Floats, Ints

from . import style
from .charts import from_end, moment_text
from .deformed import check_magnification
from .films import PER_SECOND, Film
from .style import FORCE, INK, LINE
from .units import quantity, times, visible

if TYPE_CHECKING:
    from kaju.model.network.network_result import NetworkResult
    from kaju.model.rheology.creeping_network import NetworkCreepResult


class NetworkPicture:
    """Axes for the states of one network, with its frame, colours and magnification."""

    def __init__(
        self,
        result: NetworkResult,
        ax: Axes | None,
        magnification: float | None = None,
        largest: float | None = None,
    ) -> None:
        check_magnification(magnification)
        self.result, self.network = result, result.network
        self.flat = self.network.dimension == 2
        self.ax = style.new_axes(ax, (6.8, 6.2), None if self.flat else "3d")
        if not self.flat:
            cast(Axes3D, self.ax).computed_zorder = False  # or rims would hide their springs
        moved = float(np.abs(result.displacement).max(initial=0.0))
        self.span = float(np.ptp(self.network.positions, axis=0).max())
        self.factor = magnification or max(1.0, visible(self.span, moved))
        most = largest or float(np.abs(result.tension).max(initial=0.0)) or 1.0
        self.norm = Normalize(-most, most)
        mappable = ScalarMappable(self.norm, style.DIVERGING)
        style.colour_bar(self.ax, mappable, "tension: pulled above 0, pressed below", "N")

    def places(self, record: int) -> Floats:
        """Return where the nodes are drawn (m)."""
        return np.asarray(self.network.positions + self.factor * self.result.displacement[record])

    def draw_lines(self, places: Floats, springs: Ints, name: str, **look: Any) -> None:
        """Draw springs between places of the nodes (m)."""
        kind = LineCollection if self.flat else Line3DCollection
        lines = kind(cast(Any, places[springs]), gid=name, **look)
        cast(Any, self.ax).add_collection(lines, autolim=False)

    def draw(self, record: int) -> None:
        """Draw springs, nodes and forces of one state."""
        where, values = (self.places(record), self.network.springs), self.result.tension[record]
        width = max(0.5, min(2.2, 60.0 / np.sqrt(len(values))))
        look: dict[str, Any] = {"array": values, "cmap": style.DIVERGING, "norm": self.norm}
        self.draw_lines(*where, "springs", **look, linewidths=width, zorder=3)
        # What carries little is nearly white, so every spring has a darker rim.
        self.draw_lines(*where, "rims", colors="#b0b0b0", linewidths=width + 0.8, zorder=2)
        places, held = where[0], self.network.held.any(axis=1)
        size, few = max(1.5, min(4.0, 60.0 / np.sqrt(len(places)))), len(places) <= 2000
        look = {"ls": "", "mec": INK, "mew": 0.7, "zorder": 4}
        nodes, triangles = places[~held & few].T, places[held].T
        cast(Any, self.ax).plot(*nodes, "o", ms=size, mfc=INK, gid="nodes", **look)
        white = "white" if few else INK
        cast(Any, self.ax).plot(*triangles, "^", ms=1.6 * size, mfc=white, gid="held nodes", **look)
        self._draw_forces(record)

    def _draw_forces(self, record: int) -> None:
        every = self.network.force_at(float(self.result.stage[record]))
        loaded = np.flatnonzero(every.any(axis=1))
        if not len(loaded):
            return
        along = 0.16 * self.span / np.linalg.norm(self.network.forces, axis=2).max() * every[loaded]
        head = self.places(record)[loaded]
        if not self.flat:
            self.ax.quiver(*(head - along).T, *along.T, color=FORCE, lw=1.8, gid="forces")
            return
        width = np.full(len(head), 0.012 * self.span / max(1.0, len(head) / 12.0))
        outlines = style.arrow_polygons(head - along, head, width)
        style.add_polygons(self.ax, outlines, "forces", fc=FORCE, ec="white", lw=0.4, zorder=6)

    def finish(self, notes: list[str]) -> Axes:
        """Set frame, labels, legend and title."""
        places = self.network.positions + self.factor * self.result.displacement
        lower, upper = places.min(axis=(0, 1)), places.max(axis=(0, 1))
        room = 0.2 * float((upper - lower).max() or 1.0)
        if not self.network.forces.any():
            room *= 0.25
        for name, low, high in zip("xyz", lower - room, upper + room, strict=False):
            getattr(self.ax, f"set_{name}lim")(low, high)
            style.label_axis(getattr(self.ax, f"{name}axis"), name, [float(low), float(high)], "m")
        if self.flat:
            self.ax.set_aspect("equal")
            for spine in self.ax.spines.values():
                spine.set_color(LINE)
            width, height = (upper - lower) + 2.0 * room
            style.fit_figure(self.ax, float(width / height))
        else:
            cast(Axes3D, self.ax).set_box_aspect(upper - lower + 2.0 * room)
        style.caption(self.ax, "Spring network", notes)
        return self.ax


def plot_network(
    result: NetworkResult | NetworkCreepResult,
    ax: Axes | None = None,
    *,
    record: int = -1,
    magnification: float | None = None,
) -> Axes:
    """Draw a loaded network over the one at rest, its springs coloured by tension or strain."""
    creeps = result.kind == "network in time"
    still = cast("NetworkResult", cast(Any, result).to_network_result() if creeps else result)
    last = len(still.stage) - 1
    record = from_end(record, last + 1)
    picture = NetworkPicture(still, ax, magnification)
    network = still.network
    rest: dict[str, Any] = {"colors": LINE, "linewidths": 0.6, "linestyles": "--", "zorder": 1}
    picture.draw_lines(network.positions, network.springs, "at rest", **rest)
    picture.draw(record)
    if network.held.any():
        mark = Line2D([], [], ls="", marker="^", mfc="white", mec=INK, label="held node")
        before = Line2D([], [], ls="--", lw=0.8, color=style.FAINT, label="before the load")
        style.legend(picture.ax, [mark, before])
    _, far = still.largest_displacement(record)
    force = np.linalg.norm(network.force_at(float(still.stage[record])), axis=1).max(initial=0.0)
    parts = [f"largest force {quantity(float(force), 'N')}"] if network.forces.any() else []
    parts.append(f"largest displacement {quantity(far, 'm')}")
    if last > 1 and not creeps:
        parts.insert(0, f"increment {record} of {last}")
    notes = [moment_text(cast(Any, result), record)] if creeps else []
    return picture.finish([*notes, "; ".join(parts), f"deformation shown {times(picture.factor)}"])


INCREMENTS = Film("deformed", "record", lambda result: range(len(result.stage)))
"""The states of a network along its load path."""
TIMES = Film("deformed", "record", lambda course: range(len(course.times)), fps=PER_SECOND)
"""A network that creeps at all times asked for."""
