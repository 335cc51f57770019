"""What moves: pictures of a stored run, one frame after the other.

A reel is drawn once, with everything that stays; each frame then only exchanges what moves.
So frames never jump, and nothing is computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib.colors import Normalize
from mpl_toolkits.mplot3d import Axes3D

from .agents import boundary_entries, draw_agents, spawn_bar, spawn_norm
from .body import draw_body, finish
from .cropping import section_of
from .deformed import corner_displacements, draw_deformed, draw_rest, magnification_for, sizes_of
from .forces import draw_forces
from .loads import ARROWS_ACROSS, draw_loads, load_norm, taken_in
from .space import box_around, draw_arrows, draw_frame
from .stages import applied_loads
from .style import caption, colour_bar, figure_of, legend, new_axes
from .subject import focus_of, stage_number
from .units import counted, quantity, times
from .voxels import draw_agents_in_space

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from kaju.model.propagation.stage import Stage
    from kaju.model.propagation.transfer_result import TransferResult


TWO_LINES = ["…", "…"]  # kept free for the text of the frames


@dataclass
class Reel:
    """Frames of one figure.

    Attributes
    ----------
    figure : Figure
        With everything that stays.
    last : int
        Frames are numbered from 0 to this.
    draw : callable
        Draws what moves in a frame and returns its artists.
    notes : Text
        The text under the title.
    words : callable
        Returns that text for a frame.
    """

    figure: Figure
    last: int
    draw: Callable[[int], list[Artist]]
    notes: Text
    words: Callable[[int], str]
    _moving: list[Artist] = field(default_factory=list)

    def show(self, frame: int) -> None:
        """Exchange what moves for that of a frame."""
        for artist in self._moving:
            artist.remove()
        self._moving = self.draw(frame)
        self.notes.set_text(self.words(frame))

    def settle(self) -> None:
        """Arrange the figure around its fullest frame, and keep it so."""
        self.show(self.last)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")


def spawning(
    result: TransferResult, cut: Mapping[str, int] | None = None, crop: bool | None = None
) -> Reel:
    """Return the generations of a run's last stage: agents spawn, loads are taken."""
    if result.scene.lattice.dimension == 3 and cut is None:
        return _spawning_in_space(result)
    stage = result.last
    section = section_of(result.scene, focus_of(result), cut, crop)
    ax = new_axes(None)
    entries = draw_body(ax, section)
    draw_forces(ax, section, stage_number(result))
    norm = spawn_norm(stage.generations)
    spawn_bar(ax, norm, stage.generations)
    entries += boundary_entries(stage.boundary_kind[section.holds(stage.boundary_cells)])
    notes = finish(ax, section, "Agents spawn and pass their loads on", TWO_LINES, entries)
    loads = load_norm(stage.history.load)
    legible = int((section.upper - section.lower).max()) <= ARROWS_ACROSS

    def draw(generation: int) -> list[Artist]:
        artists = draw_agents(ax, section, stage, norm, generation)
        if legible:
            taken = taken_in(stage, generation)
            artists.append(draw_loads(ax, section, stage, taken, loads, plain=True)[0])
        return artists

    told = "; ".join(section.notes)
    return Reel(
        figure_of(ax), stage.generations, draw, notes, lambda g: _generation(stage, g, told)
    )


def _spawning_in_space(result: TransferResult) -> Reel:
    scene, stage = result.scene, result.last
    cells = focus_of(result)
    assert cells is not None
    box = box_around(scene, cells)
    ax = new_axes(None, (6.8, 6.2), "3d")
    space = cast(Axes3D, ax)
    draw_frame(space, scene, box)
    draw_arrows(space, scene, box, stage_number(result))
    norm = spawn_norm(stage.generations)
    spawn_bar(ax, norm, stage.generations)
    legend(ax, boundary_entries(stage.boundary_kind))
    notes = caption(ax, "Agents spawn", TWO_LINES)
    told = "; ".join(box.notes)
    return Reel(
        figure_of(ax),
        stage.generations,
        lambda generation: draw_agents_in_space(space, scene, stage, box, norm, generation),
        notes,
        lambda generation: _generation(stage, generation, told),
    )


def _generation(stage: Stage, generation: int, told: str) -> str:
    agents = int((stage.spawn_step <= generation).sum())
    taken = float(stage.history.load[stage.history.generation == generation].sum())
    if generation == 0:
        words = "before the first generation: the load has not been taken yet"
    else:
        words = (
            f"generation {generation} of {stage.generations}: "
            f"{counted(agents, 'material agent')}, {quantity(taken, 'N')} taken"
        )
    return f"{words}\n{told}"


def loading(
    result: TransferResult, cut: Mapping[str, int] | None = None, crop: bool | None = None
) -> Reel:
    """Return the stages of loading: the body deforms as the load grows."""
    section = section_of(result.scene, focus_of(result), cut, crop)
    every, kind = section.ground
    tiles = every[kind >= 0]
    states = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    moved = [corner_displacements(state, section, tiles) for state in states]
    size = [sizes_of(state, section, tiles) for state in states]
    moved.insert(0, np.zeros_like(moved[0]))
    size.insert(0, np.zeros_like(size[0]))
    factor = min(magnification_for(section, tiles, corners) for corners in moved[1:])
    norm = Normalize(0.0, float(max(values.max(initial=0.0) for values in size)) or 1.0)
    load = [0.0, *applied_loads(result).tolist()]
    ax = new_axes(None)
    entries = draw_body(ax, section, filled=False)
    draw_rest(ax, section)
    draw_forces(ax, section, stage_number(result))
    last = draw_deformed(ax, section, tiles, moved[-1], size[-1], factor, norm)
    colour_bar(ax, last, "displacement", "m")
    notes = finish(ax, section, "The body deforms", TWO_LINES, entries)
    for moving in (last, *(drawn for drawn in ax.collections if drawn.get_gid() == "forces")):
        moving.set_visible(False)
    told = "; ".join([f"deformation shown {times(factor)}", *section.notes])

    def words(number: int) -> str:
        agents = len(result.stages[number - 1].cells) if number else 0
        applied = f"{quantity(load[number], 'N')} of {quantity(load[-1], 'N')}"
        return f"applied: {applied}; {counted(agents, 'material agent')}\n{told}"

    def draw(number: int) -> list[Artist]:
        still = len(ax.collections)
        draw_deformed(ax, section, tiles, moved[number], size[number], factor, norm)
        if number:
            draw_forces(ax, section, number, share=load[number] / load[-1] if load[-1] else 1.0)
        return [*ax.collections[still:]]

    return Reel(figure_of(ax), len(states), draw, notes, words)
