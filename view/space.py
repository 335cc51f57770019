"""Bodies of cubes in space: the agents, or the body itself, by the faces that can be seen."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgba
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from kaju.arrays import Floats, Ints
from kaju.model.scene import Scene
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult

from .agents import SYMBOLS, boundary_entries, counts, spawn_bar, spawn_norm
from .body_plots import MOST_ARROWS, force_arrows, told
from .section import one_a_place
from .style import BODY, FAINT, FORCE, INK, SEQUENTIAL, caption, label_axis, legend, new_axes
from .units import grouped

MOST_ACROSS = 40
"""Where more cells than this lie side by side, a voxel is a block of cells."""

# Corners of a unit cube's faces, in the order -x, +x, -y, +y, -z, +z.
_FACES = np.array(
    [
        [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
        [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
        [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    ],
    dtype=np.float64,
)
_STEPS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])
_LIGHT = np.array([0.72, 0.86, 0.8, 0.7, 0.6, 1.0])  # of each face, so that form can be read
_EDGES = np.array(
    [[a, a | bit] for bit in (1, 2, 4) for a in range(8) if not a & bit]
)  # of a box whose corner k lies at the upper end along axis i if bit i of k is set


class DrawnBox(NamedTuple):
    """The part of a body that a picture in space shows."""

    lower: Ints
    upper: Ints
    """The cells shown: lower <= cell < upper. Shape (3,)."""
    block: int
    """A voxel is a cube of this many cells along each edge."""
    notes: list[str]
    """What a reader must be told."""


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


def seen_faces(voxels: Ints) -> tuple[Ints, Ints]:
    """Return voxel and direction of every face that no other voxel hides."""
    low = voxels.min(axis=0, initial=0) - 1
    span = voxels.max(axis=0, initial=0) - low + 2

    def key(places: Ints) -> Ints:
        shifted = places - low
        return np.asarray((shifted[:, 0] * span[1] + shifted[:, 1]) * span[2] + shifted[:, 2])

    own = key(voxels)
    hidden = np.stack([np.isin(key(voxels + step), own) for step in _STEPS], axis=1)
    voxel, direction = np.nonzero(~hidden)
    return voxel, direction


def draw_voxels(ax: Axes3D, voxels: Ints, edge: float, colours: Floats) -> Poly3DCollection:
    """Draw cubes of an edge (m) by their visible faces; colours have shape (n, 3 or 4)."""
    voxel, direction = seen_faces(voxels)
    faces = (voxels[voxel, None] + _FACES[direction]) * edge
    shaded = colours[voxel].copy()
    shaded[:, :3] *= _LIGHT[direction, None]
    drawn = Poly3DCollection(faces, facecolors=shaded, edgecolors=INK, linewidths=0.25, zorder=3)
    ax.add_collection3d(drawn)
    return drawn


def draw_frame(ax: Axes3D, scene: Scene, box: DrawnBox) -> None:
    """Draw the edges of the body's bounding box, and its rigid sides as hatched planes."""
    edge = scene.lattice.cell_size
    ends = np.stack([box.lower, box.upper]) * edge
    corners = np.array([[ends[k >> i & 1, i] for i in range(3)] for k in range(8)])
    frame = Line3DCollection(corners[_EDGES], colors=FAINT, linewidths=0.7, zorder=2)
    frame.set_gid("outline")
    ax.add_collection3d(frame)
    for number, side in enumerate(scene.lattice.sides):
        axis, upper = divmod(number, 2)
        at_side = (box.upper[axis] == scene.lattice.shape[axis]) if upper else box.lower[axis] == 0
        if scene.side_condition(side).supports and at_side:
            plane = _FACES[number] * (ends[1] - ends[0]) + ends[0]
            ground = Poly3DCollection(
                plane[None],
                facecolors=(0.8, 0.8, 0.8, 0.35),
                edgecolors=FAINT,
                hatch="////",
                zorder=1,
            )
            ground.set_gid(f"support {side}")
            ax.add_collection3d(ground)
    ax.set_xlim(ends[0, 0], ends[1, 0])
    ax.set_ylim(ends[0, 1], ends[1, 1])
    ax.set_zlim(ends[0, 2], ends[1, 2])
    ax.set_box_aspect(ends[1] - ends[0])
    ax.set_proj_type("ortho")
    ax.computed_zorder = False  # a flat ground would now and then hide what stands on it
    ax.view_init(elev=22.0, azim=-58.0)
    for name in "xyz":
        axis3d = getattr(ax, f"{name}axis")
        label_axis(axis3d, name, list(ends[:, "xyz".index(name)]), "m")
        axis3d.pane.set_visible(False)
        axis3d.line.set_color(FAINT)
    ax.grid(False)


def draw_arrows(
    ax: Axes3D, scene: Scene, box: DrawnBox, stage: int | None, most: int = MOST_ARROWS
) -> list[str]:
    """Draw the applied forces, or `most` of them; return a note that says how much they are."""
    applied = scene.applied(stage)
    inside = np.all((applied.cells >= box.lower) & (applied.cells < box.upper), axis=1)
    arrows = force_arrows(scene, applied, np.flatnonzero(inside), most)
    if len(arrows.force):
        size = np.linalg.norm(arrows.force, axis=1).max()
        reach = 0.28 * float((box.upper - box.lower).max()) * scene.lattice.cell_size
        along = (reach / size) * arrows.force
        tail = np.where(arrows.pulls[:, None], arrows.place, arrows.place - along)
        drawn = ax.quiver(*tail.T, *along.T, color=FORCE, linewidth=2.2, arrow_length_ratio=0.3)
        drawn.set_gid("forces")
        drawn.set_zorder(20)
    return told(applied)


def space_for(
    ax: Axes | None, scene: Scene, box: DrawnBox, stage: int | None, most: int = MOST_ARROWS
) -> tuple[Axes3D, list[str]]:
    """Return axes with a box's frame and the forces in it, and a note of how much these are."""
    space = cast(Axes3D, new_axes(ax, (6.8, 6.2), "3d"))
    draw_frame(space, scene, box)
    return space, draw_arrows(space, scene, box, stage, most)


def draw_agents_in_space(
    ax: Axes3D,
    scene: Scene,
    stage: Stage,
    box: DrawnBox,
    norm: Normalize,
    generation: int | None = None,
) -> list[Artist]:
    """Draw the agents that have spawned up to a generation; return the artists."""
    until = stage.generations + 1 if generation is None else generation
    edge = scene.lattice.cell_size * box.block
    born = stage.spawn_step <= until
    voxels, step = one_a_place(stage.cells[born] // box.block, stage.spawn_step[born], "min")
    colour = colormaps[SEQUENTIAL]
    drawn = draw_voxels(ax, voxels, edge, np.atleast_2d(colour(norm(step))))
    drawn.set_gid("material agents")
    artists: list[Artist] = [drawn]
    for kind, symbol in SYMBOLS.items():
        chosen = (stage.boundary_kind == kind) & (stage.boundary_spawn_step <= until)
        if chosen.any():
            cells, steps = stage.boundary_cells[chosen], stage.boundary_spawn_step[chosen]
            places, step = one_a_place(cells // box.block, steps, "min")
            marks = ax.scatter(
                *((places + 0.5) * edge).T,
                c=colour(norm(step)),
                s=26,
                marker=symbol.marker,
                edgecolors=INK,
                linewidths=0.6,
                depthshade=False,
                zorder=4,
            )
            marks.set_gid(f"{symbol.name}s")
            artists.append(marks)
    return artists


def plot_voxels(
    result: TransferResult, ax: Axes | None = None, *, crop: bool | None = None
) -> Axes:
    """Draw the agents of a body of cubes in space, coloured by their spawn step.

    Only material agents are solid; of the body there is the outline. Boundary agents are
    marks, round where the body is free and triangular where it is held.
    """
    scene, stage = result.scene, result.last
    cells = result.focus
    assert cells is not None
    box = box_around(scene, cells, crop)
    space, notes = space_for(ax, scene, box, result.stage)
    if len(stage.cells):
        norm = spawn_norm(stage.generations)
        draw_agents_in_space(space, scene, stage, box, norm)
        spawn_bar(space, norm, stage.generations)
        notes.insert(0, counts(stage))
        legend(space, boundary_entries(stage.boundary_kind))
    else:
        notes.insert(0, stage.outcome)
    caption(space, "Agents", [*notes, *box.notes])
    return cast("Axes", space)


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
    names = [material.name for material in scene.cell_materials]
    legend(
        space, [Patch(fc=BODY[i % len(BODY)], ec=INK, label=name) for i, name in enumerate(names)]
    )
    caption(space, "The scene", [*notes, *box.notes])
    return cast("Axes", space)
