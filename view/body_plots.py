"""The stage on which everything is shown: the body, what holds it, and the applied forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Patch, PathPatch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene import AppliedLoads, Scene, cell_types

from . import style
from .section import Arrows, How, Section
from .style import BODY, BODY_HATCHES, FORCE, INK, LINE
from .units import counted, quantity


def force_arrows(scene: Scene, applied: AppliedLoads, rows: Ints, most: int = 5) -> Arrows:
    """Gather the applied forces of some rows in arrows, few enough to be seen one by one.

    Forces of one direction on faces of one direction that lie beside each other become a few
    arrows: of a force along the side one, for several would lie over each other. So do forces in
    the middle of cells, such as a weight.
    """
    rows = rows[np.abs(applied.force[rows]).max(axis=1, initial=0.0) > 0.0]
    lattice, force = scene.lattice, applied.force[rows]
    face = applied.direction[rows]
    size = np.linalg.norm(force, axis=1, keepdims=True)
    unit = force / np.where(size > 0.0, size, 1.0)
    normal = lattice.normals[face] * (face >= 0)[:, None]
    place = lattice.face_middles(applied.cells[rows], face)
    # A force on no face ends in the middle of its cell; of a cell at the surface, outside of it,
    # where the body does not hide the arrow.
    behind = scene.kinds(lattice.locate(place - lattice.cell_size * unit))
    few = np.count_nonzero(face < 0) <= most
    bare = (face < 0) & (behind < 0) & few
    place = place - np.where(bare[:, None], 0.56 * lattice.cell_size * unit, 0.0)
    places, sums, pulls, wide = [], [], [], []
    alike = np.column_stack([face, np.rint(1e6 * unit)])
    for number in range(len(kinds := np.unique(alike, axis=0))):
        group = np.flatnonzero((alike == kinds[number]).all(axis=1))
        outwards = float(unit[group[0]] @ normal[group[0]])
        for patch in _patches(place[group], lattice.cell_size if normal[group].any() else np.inf):
            one = group[patch]
            along = face[one[0]] >= 0 and abs(outwards) < 0.5
            for part in _parts(place[one], 1 if along else most):
                inside = one[part]
                middle = place[inside].mean(axis=0)
                if np.ptp((place[inside] - middle) @ normal[one[0]]) > 1e-9 or face[one[0]] < 0:
                    middle = place[inside[np.linalg.norm(place[inside] - middle, axis=1).argmin()]]
                places.append(middle)  # of faces in one plane, so that arrows stand evenly
                sums.append(force[inside].sum(axis=0))
                spread = np.ptp(place[inside], axis=0).max() + lattice.cell_size
                wide.append(0.0 if along or face[one[0]] < 0 else spread)
                pulls.append(outwards > 1e-9 or (face[one[0]] < 0 and not few))
    shape = (-1, lattice.dimension)
    arrows = np.reshape(places, shape), np.reshape(sums, shape), np.array(pulls, dtype=np.bool_)
    return Arrows(*arrows, wide=np.array(wide))


def _patches(places: Floats, cell_size: float) -> list[Ints]:
    """Return which of some places (m) lie beside each other, patch by patch."""
    order = np.lexsort(places.T)
    if places.shape[1] == 3 or len(places) == 1:
        return [order]
    order = order[np.argsort(places[order, np.ptp(places, axis=0).argmax()], kind="stable")]
    apart = np.linalg.norm(np.diff(places[order], axis=0), axis=1) > 2.5 * cell_size
    return np.split(order, np.flatnonzero(apart) + 1)


def _parts(places: Floats, most: int) -> list[Ints]:
    """Split a patch of places (m) into at most so many parts along its longest side."""
    if len(places) <= most:
        return [np.array([number]) for number in range(len(places))]
    along = np.ptp(places, axis=0)
    lower, span = places.min(axis=0), along.max() or 1.0
    part = np.minimum((places - lower) * (most / span), most - 1).astype(np.int64)
    number = np.unique(part, axis=0, return_inverse=True)[1].ravel()
    return [np.flatnonzero(number == one) for one in range(int(number.max()) + 1)]


def applied_text(scene: Scene, stage: int | None, applied: AppliedLoads | Arrows) -> list[str]:
    """Return in words how much is applied, if anything is."""
    total = float(np.linalg.norm(applied.force, axis=1).sum())
    resultant = float(np.linalg.norm(applied.force.sum(axis=0)))
    if total == 0.0:
        return []
    told, where, now = quantity(total, "N"), "", stage or scene.stages
    turned = [  # by forces that cancel
        np.linalg.norm(load.couple) * min(now / load.steps, 1.0)
        for load in scene.loads
        if load.couple is not None
    ]
    if turned:
        told = " and ".join(f"a couple of {quantity(float(one), 'N m')}" for one in turned)
        if resultant > 1e-9 * total:
            told = f"forces of resultant {quantity(resultant, 'N')} and {told}"
    elif isinstance(applied, AppliedLoads):
        faces = int((applied.direction >= 0).sum())
        inner = len(applied.direction) - faces
        places = [f"{counted(faces, 'face')}"] if faces else []
        places += [f"in {counted(inner, 'cell')}"] if inner else []
        where = f" on {' and '.join(places)}".replace("on in", "in") if faces + inner > 1 else ""
    opposed = not turned and resultant < (1.0 - 1e-9) * total
    return [f"applied: {told}{where}{', added by amount' if opposed else ''}"]


def draw_forces(
    ax: Axes,
    section: Section,
    stage: int | None = None,
    share: float = 1.0,
    at: Callable[[Floats], Floats] | None = None,
) -> list[str]:
    """Draw the applied forces of a section, shortened to a share; return notes on their sum.

    `at`: where places in the section have moved to.
    """
    scene = section.scene
    if section.curves is None:
        applied = scene.applied(stage)
        rows = np.flatnonzero(section.holds(applied.cells))
        arrows, notes = force_arrows(scene, applied, rows), applied_text(scene, stage, applied)
    else:
        arrows = section.curves.arrows
        notes = applied_text(section.curves.asked, stage, arrows)
    force, place = section.in_plane(arrows.force), section.in_plane(arrows.place)
    size = np.linalg.norm(force, axis=1)
    seen = size > 1e-9 * size.max(initial=0.0)
    if not seen.any():
        return notes
    force, place, size, pulls = force[seen], place[seen], size[seen], arrows.pulls[seen]
    place, span = place if at is None else at(place), section.span
    along = ((share or 1.0) * span * (0.06 + 0.07 * size / size.max()) / size)[:, None] * force
    head = np.where(pulls[:, None], place + along, place)
    width = np.full(len(head), min(0.011, 0.2 / len(head) + 0.004) * span)
    outlines = style.arrow_polygons(head - along, head, width)
    # Forces that do not act now have their room all the same: in a film they act at other times.
    look: dict[str, Any] = {"fc": FORCE, "ec": "white", "visible": bool(share)}
    style.add_polygons(ax, outlines, "forces", lw=0.4, zorder=8, **look)
    return notes


SUPPORTS = {
    cell_types.RIGID: ("rigid", "////"),
    cell_types.ROLLER: ("roller", "oo"),
    cell_types.FOUNDATION: ("elastic bed", "xx"),
    cell_types.DISPLACED: ("moved wall", "\\\\\\\\"),
}


def draw_body(
    ax: Axes, section: Section, *, filled: bool = True, outlined: bool = True
) -> list[Artist]:
    """Draw materials, supports, surface and joints of a body; return what a legend explains."""
    tiles, kind = section.ground
    entries: list[Artist] = []
    across = int((section.upper - section.lower).max()) // section.block
    separate = across <= 90
    edge = LINE if separate else "none"
    if filled and section.curves is not None:  # whose edges cells reach beyond, or do not reach
        ax.add_patch(PathPatch(section.curves.path(), fc=BODY[0], lw=0.0, zorder=0.9))
    for number, material in enumerate(section.scene.cell_materials if filled else ()):
        chosen = kind == number
        if not chosen.any():
            continue
        colour, hatch = BODY[number % len(BODY)], BODY_HATCHES[number % len(BODY_HATCHES)]
        corners = (section.polygons if separate else section.stripes)(tiles[chosen])
        look: dict[str, Any] = {"facecolors": colour, "hatch": hatch or None, "zorder": 1}
        look |= {"edgecolors": "#b5b5b5" if hatch else edge, "antialiased": separate}
        look["linewidths"] = 0.4 if separate else 0.0
        drawn = style.add_polygons(ax, corners, f"material {material.name}", **look)
        if section.curves is not None:
            section.curves.clip(drawn)
        entries.append(Patch(fc=colour, ec="#9a9a9a", hatch=hatch, label=material.name))
    entries += _draw_supports(ax, section, tiles, kind)
    if section.curves is not None and np.isfinite(pins := section.curves.pins).any():
        look = {"color": INK, "mec": "white", "mew": 1.2, "ms": 6, "zorder": 9}
        entries += ax.plot(*pins.T, "o", label="pin, about which it turns", **look)
    if outlined:
        for lines, width in zip(section.outlines(), (0.9, 0.6), strict=True):
            ax.add_collection(LineCollection(list(lines), colors=INK, linewidths=width, zorder=4))
    return entries


def _draw_supports(ax: Axes, section: Section, tiles: Ints, kind: Ints) -> list[Artist]:
    entries: list[Artist] = []
    idle = _beside_no_body(section, tiles, kind)
    for code, (name, hatch) in SUPPORTS.items():
        chosen = (kind == code) & ~idle
        if not chosen.any():
            continue
        look: dict[str, Any] = {"fc": "white", "ec": style.FAINT, "hatch": hatch}
        corners = section.stripes(tiles[chosen])
        style.add_polygons(ax, corners, f"support {name}", lw=0.0, zorder=1, **look)
        entries.append(Patch(label=name, **look))
    return entries


def _beside_no_body(section: Section, tiles: Ints, kind: Ints) -> Flags:
    """Tell which tiles lie beyond a side of the array where no body touches it."""
    place = tiles - tiles.min(axis=0)
    body = np.zeros(place.max(axis=0) + 3, dtype=np.bool_)  # in a frame of one tile
    body[tuple(place[kind >= 0].T + 1)] = True
    near = np.any(sliding_window_view(body, (3, 3)), axis=(2, 3))
    shape = np.array(section.scene.lattice.shape)[[*section.axes]]
    inside = np.all((tiles >= 0) & (tiles * section.block < shape), axis=1)
    return np.asarray(~inside & ~near[tuple(place.T)])


def draw_cells(
    ax: Axes,
    section: Section,
    cells: Ints,
    values: NDArray[Any],
    how: How,
    name: str,
    rims: bool = True,
    **look: Any,
) -> PolyCollection:
    """Draw the tiles of some cells in the colours of their values, with rims unless many."""
    tiles, shown = section.gather(cells, np.asarray(values, dtype=np.float64), how)
    rims &= len(section.ground[0]) <= 10_000
    look |= {"edgecolors": "white" if rims else "none", "linewidths": 0.4 if rims else 0.0}
    corners = section.polygons(tiles)
    return style.add_polygons(ax, corners, name, array=shown, antialiased=rims, zorder=2, **look)


def reach_of(ax: Axes, section: Section, names: Sequence[str] = ("forces", "moved")) -> Floats:
    """Return the box of a section and of what may stick out of it, shape (2, 2)."""
    found = [section.box]
    for collection in ax.collections:
        if collection.get_gid() in names and collection.get_paths():
            found += [np.asarray(path.vertices) for path in collection.get_paths()]
    points = np.concatenate(found)
    return np.stack([points.min(axis=0), points.max(axis=0)])


class BodyPicture:
    """A section of a body with its supports and forces, on which results are drawn."""

    def __init__(
        self,
        section: Section,
        ax: Axes | None = None,
        stage: int | None = None,
        *,
        filled: bool = True,
        outlined: bool = True,
        share: float = 1.0,
        at: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self.section = section
        self.ax = style.new_axes(ax)
        self.entries = draw_body(self.ax, section, filled=filled, outlined=outlined)
        self.notes = draw_forces(self.ax, section, stage, share, at)  # on the sum

    def finish(self, title: str, notes: list[str]) -> Axes:
        """Set scales, labels, title, notes and legend; return the axes."""
        ax, section = self.ax, self.section
        lower, upper = section.box
        ratio = float(np.divide(*(upper - lower)))
        stretched = not 1.0 / 30.0 <= ratio <= 30.0
        ax.set_aspect("auto" if stretched else "equal")
        notes = [*notes, *section.notes]
        if stretched:
            notes.append("not to scale: the picture is stretched across the body's length")
        else:
            # Long bodies lie in a frame of moderate form, so that there is room for words.
            middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
            half = np.maximum(half, [half[1] * 0.55, half[0] / 3.0])
            lower, upper = middle - half, middle + half
        reach = reach_of(ax, section)
        lower, upper = np.minimum(lower, reach[0]), np.maximum(upper, reach[1])
        ax.set(xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))
        ends = np.stack([lower, upper], axis=1).tolist()
        for axis, along, values in zip((ax.xaxis, ax.yaxis), section.axes, ends, strict=True):
            style.label_axis(axis, "xyz"[along], values, "m")
        for spine in ax.spines.values():
            spine.set_color(LINE)
        form = 1.6 if stretched else float(np.divide(*(upper - lower)))
        style.fit_figure(ax, form, self.entries)
        style.legend(ax, self.entries)
        style.caption(ax, title, notes)
        return ax
