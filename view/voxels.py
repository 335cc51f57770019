"""Pictures of bodies of cubes in space: the agents, or the body itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D

from .agents import SYMBOLS, boundary_entries, counts, spawn_bar, spawn_norm
from .space import Box, box_around, draw_arrows, draw_frame, draw_voxels, gathered
from .style import BODY, INK, SEQUENTIAL, caption, legend, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize

    from kaju.model.propagation.stage import Stage
    from kaju.model.propagation.transfer_result import TransferResult
    from kaju.model.scene import Scene

_SIZE = (6.8, 6.2)


def draw_agents_in_space(
    ax: Axes3D, scene: Scene, stage: Stage, box: Box, norm: Normalize, generation: int | None = None
) -> list[Artist]:
    """Draw the agents that have spawned up to a generation; return the artists."""
    until = stage.generations + 1 if generation is None else generation
    edge = scene.lattice.cell_size * box.block
    born = stage.spawn_step <= until
    voxels, step = gathered(stage.cells[born], stage.spawn_step[born], box.block)
    colour = colormaps[SEQUENTIAL]
    drawn = draw_voxels(ax, voxels, edge, np.atleast_2d(colour(norm(step))))
    drawn.set_gid("material agents")
    artists: list[Artist] = [drawn]
    for kind, symbol in SYMBOLS.items():
        chosen = (stage.boundary_kind == kind) & (stage.boundary_spawn_step <= until)
        if chosen.any():
            cells, steps = stage.boundary_cells[chosen], stage.boundary_spawn_step[chosen]
            places, step = gathered(cells, steps, box.block)
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
    ax = new_axes(ax, _SIZE, "3d")
    space = cast(Axes3D, ax)
    draw_frame(space, scene, box)
    notes = draw_arrows(space, scene, box, result.stage)
    if len(stage.cells):
        norm = spawn_norm(stage.generations)
        draw_agents_in_space(space, scene, stage, box, norm)
        spawn_bar(space, norm, stage.generations)
        notes.insert(0, counts(stage))
        legend(space, boundary_entries(stage.boundary_kind))
    else:
        notes.insert(0, stage.outcome)
    caption(space, "Agents", [*notes, *box.notes])
    return ax


def plot_body_in_space(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw a body of cubes in space, coloured by material, with supports and forces."""
    lower, upper = scene.bounds()
    box = box_around(scene, np.empty((0, 3), dtype=np.int64))
    first = lower // box.block
    spans = -(-upper // box.block) - first
    voxels = first + np.indices(tuple(spans)).reshape(3, -1).T
    kind = scene.kinds(np.minimum(voxels * box.block + box.block // 2, upper - 1))
    palette = np.array([to_rgba(colour) for colour in BODY])
    ax = new_axes(ax, _SIZE, "3d")
    space = cast(Axes3D, ax)
    draw_frame(space, scene, box)
    body = kind >= 0
    edge = scene.lattice.cell_size * box.block
    drawn = draw_voxels(space, voxels[body], edge, palette[kind[body] % len(BODY)])
    drawn.set_gid("body")
    notes = draw_arrows(space, scene, box, None)
    names = [material.name for material in scene.cell_materials]
    legend(
        space,
        [Patch(fc=BODY[i % len(BODY)], ec=INK, label=name) for i, name in enumerate(names)],
    )
    caption(space, "The scene", [*notes, *box.notes])
    return ax
