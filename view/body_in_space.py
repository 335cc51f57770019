"""Bodies of cubes in space, by the faces that can be seen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from kaju.arrays import Flags, Floats, Ints
from kaju.model.results.mesh import CUBE_FACES, corner_order
from kaju.model.scene import Scene

from .body_plots import applied_text, force_arrows
from .style import BODY, FAINT, FORCE, INK, caption, label_axis, legend, new_axes
from .units import grouped

MOST_ACROSS = 40
"""Where more cells than this lie side by side, a voxel is a block of cells."""

# Corners of a unit cube's faces, outwards, in the order -x, +x, -y, +y, -z, +z.
_FACES = corner_order(3)[CUBE_FACES]
_LIGHT = (0.72, 0.86, 0.8, 0.7, 0.6, 1.0)  # of each face, so that form can be read
_EDGES = np.array(
    [pair for k in range(4) for pair in ((k, (k + 1) % 4), (k + 4, (k + 1) % 4 + 4), (k, k + 4))]
)  # round the bottom, round the top, and upwards


class DrawnBox(NamedTuple):
    """The part of a body that a picture in space shows."""

    lower: Ints
    upper: Ints  # cells shown: lower <= cell < upper; shape (3,)
    block: int  # a voxel is a cube of this many cells along each edge
    notes: list[str]  # on crop and blocks


def box_around(scene: Scene, cells: Ints, crop: bool | None = None) -> DrawnBox:
    """Return a box around cells, cropped as pictures of a plane are."""
    lower, upper = scene.bounds()
    whole = upper - lower
    notes = []
    if crop is None:
        crop = bool(whole.max() > 2 * MOST_ACROSS)
    if crop and len(cells):
        first, last = cells.min(axis=0), cells.max(axis=0) + 1
        margin = max(2, round(0.15 * int((last - first).max())))
        lower, upper = np.maximum(first - margin, lower), np.minimum(last + margin, upper)
        part, full = (" × ".join(map(grouped, n)) for n in (upper - lower, whole))
        if part != full:
            notes.append(f"cropped to {part} of {full} cells")
    block = -(-int((upper - lower).max()) // MOST_ACROSS)
    if block > 1:
        notes.append(f"each voxel stands for {' × '.join([str(block)] * 3)} cells")
    return DrawnBox(lower, upper, block, notes)


def draw_boxes(
    ax: Axes3D, lower: Floats, upper: Floats, colours: Floats, hides: Callable[[Floats], Flags]
) -> Poly3DCollection:
    """Draw boxes from corner to corner (m) by the faces that can be seen, shaded by direction.

    `colours` have shape (n, 4); `hides` tells of points just beyond faces whether these are hidden.
    """
    faces, shaded, rims = [], [], []
    size = upper - lower
    large = size.max(axis=1) > 0.01 * np.ptp(upper, axis=0).max(initial=0.0)
    for number, (corners, light) in enumerate(zip(_FACES, _LIGHT, strict=True)):
        axis, end = divmod(number, 2)
        beyond = 0.5 * (lower + upper)
        beyond[:, axis] += (0.5 + 1e-6) * (2 * end - 1) * size[:, axis]
        bare = ~hides(beyond)
        faces.append(lower[bare, None] + corners * size[bare, None])
        shaded.append(colours[bare] * [light, light, light, 1.0])
        rims.append(np.where(large[bare, None], to_rgba(INK), shaded[-1]))
    look = {"facecolors": np.concatenate(shaded), "edgecolors": np.concatenate(rims)}
    drawn = Poly3DCollection(np.concatenate(faces), linewidths=0.25, zorder=3, **look)
    ax.add_collection3d(drawn)
    return drawn


def draw_voxels(ax: Axes3D, voxels: Ints, edge: float, colours: Floats) -> Poly3DCollection:
    """Draw cubes of an edge (m), coloured by the rows of `colours`."""
    first = voxels.min(axis=0) - 1
    there = np.zeros(voxels.max(axis=0) - first + 2, dtype=np.bool_)
    there[tuple((voxels - first).T)] = True

    def hides(points: Floats) -> Flags:
        found: Flags = there[tuple((np.floor(points / edge).astype(np.int64) - first).T)]
        return found

    corner = (voxels * edge).astype(np.float64)
    return draw_boxes(ax, corner, corner + edge, colours, hides)


def space_for(
    ax: Axes | None, scene: Scene, box: DrawnBox, stage: int | None, most: int = 5
) -> tuple[Axes3D, list[str]]:
    """Return axes with a box's frame and up to `most` forces, and a note on these."""
    space = cast(Axes3D, new_axes(ax, (6.8, 6.2), "3d"))
    edge = scene.lattice.cell_size
    low, high = box.lower * edge, box.upper * edge
    faces = low + _FACES * (high - low)
    corners = low + corner_order(3) * (high - low)
    rims = corners[_EDGES]
    space.add_collection3d(Line3DCollection(rims, colors=FAINT, lw=0.7, zorder=2, gid="outline"))
    for number, side in enumerate(scene.lattice.sides):
        axis, upper = divmod(number, 2)
        at_side = (box.upper[axis] == scene.lattice.shape[axis]) if upper else box.lower[axis] == 0
        if scene.side_condition(side).kind != "free" and at_side:
            look: dict[str, Any] = {"facecolors": (0.8, 0.8, 0.8, 0.35), "edgecolors": FAINT}
            look |= {"hatch": "////", "zorder": 1, "gid": f"support {side}"}
            space.add_collection3d(Poly3DCollection(faces[number][None], **look))
    for name, first, last in zip("xyz", low.tolist(), high.tolist(), strict=True):
        getattr(space, f"set_{name}lim")(first, last)
        axis3d = getattr(space, f"{name}axis")
        label_axis(axis3d, name, [first, last], "m")
        axis3d.pane.set_visible(False)
        axis3d.line.set_color(FAINT)
    space.set_box_aspect(high - low)
    space.set_proj_type("ortho")
    space.computed_zorder = False  # a flat ground would now and then hide what stands on it
    space.view_init(elev=22.0, azim=-58.0)
    space.grid(False)
    applied = scene.applied(stage)
    inside = np.all((applied.cells >= box.lower) & (applied.cells < box.upper), axis=1)
    arrows = force_arrows(scene, applied, np.flatnonzero(inside), most)
    if len(arrows.force):
        reach = 0.28 * float((high - low).max())
        along = (reach / np.linalg.norm(arrows.force, axis=1).max()) * arrows.force
        tail = np.where(arrows.pulls[:, None], arrows.place, arrows.place - along)
        drawn = space.quiver(*tail.T, *along.T, color=FORCE, linewidth=2.2, arrow_length_ratio=0.3)
        drawn.set_gid("forces")
        drawn.set_zorder(20)
    return space, applied_text(scene, stage, applied)


def plot_body_in_space(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw a body of cubes in space, coloured by material, with supports and forces."""
    lower, upper = scene.bounds()
    box = box_around(scene, np.empty((0, 3), dtype=np.int64))
    first = lower // box.block
    spans = -(-upper // box.block) - first
    voxels = first + np.indices(tuple(spans)).reshape(3, -1).T
    kind = scene.kinds(np.minimum(voxels * box.block + box.block // 2, upper - 1))
    palette = np.array([to_rgba(colour) for colour in BODY])
    space, notes = space_for(ax, scene, box, None)
    body = kind >= 0
    edge = scene.lattice.cell_size * box.block
    drawn = draw_voxels(space, voxels[body], edge, palette[kind[body] % len(BODY)])
    drawn.set_gid("body")
    materials = enumerate(scene.cell_materials)
    legend(space, [Patch(fc=BODY[i % len(BODY)], ec=INK, label=m.name) for i, m in materials])
    caption(space, "The scene", [*notes, *box.notes])
    return cast("Axes", space)
