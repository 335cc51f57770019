"""What moves: pictures of a stored run, one frame after the other.

A reel is drawn once, with everything that stays; each frame then only exchanges what moves.
So frames never jump, and nothing is computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.text import Text

from kaju.arrays import Floats, first_largest
from kaju.errors import ParameterError
from kaju.model.results.result import BodyResult
from kaju.model.transfer.stage import Stage
from kaju.model.transfer.transfer_result import TransferResult
from kaju.view.agents import boundary_entries, draw_agents, spawn_bar, spawn_norm
from kaju.view.body_plots import draw_body, draw_forces, finish
from kaju.view.deformed import Moving, draw_deformed, draw_rest, magnification_for, moving_cells
from kaju.view.layers import draw_squares, draw_surroundings, layer_of, squares_of
from kaju.view.load_plots import (
    FILM_ARROWS_ACROSS,
    draw_loads,
    load_norm,
    loads_taken,
    sense_entries,
)
from kaju.view.quadtree import (
    MOST_ARROWS,
    OF_EVERY_GENERATION,
    bar_of,
    draw_cubes,
    look_of,
    standing,
    told,
    view_of,
    view_told,
)
from kaju.view.section import Section, section_of
from kaju.view.space import box_around, draw_agents_in_space, space_for
from kaju.view.stages import applied_loads
from kaju.view.style import caption, colour_bar, figure_of, legend, new_axes
from kaju.view.units import counted, quantity, times

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.rheology.creeping_body import TransferCreepResult
    from kaju.model.rheology.elastic import ElasticCreepResult


_BARE = 6.4
"""Longer side of a film without words (inches)."""
TWO_LINES = ["…", "…"]  # kept free for the text of the frames


@dataclass
class Film:
    """Frames of one figure."""

    figure: Figure
    """With everything that stays."""
    last: int
    """Frames are numbered from 0 to this."""
    draw: Callable[[int], list[Artist]]
    """Draws what moves in a frame and returns its artists."""
    notes: Text
    """The text under the title."""
    words: Callable[[int], str]
    """Returns that text for a frame."""
    _moving: list[Artist] = field(default_factory=list)

    def show(self, frame: int) -> None:
        """Exchange what moves for that of a frame."""
        for artist in self._moving:
            artist.remove()
        self._moving = self.draw(frame)
        self.notes.set_text(self.words(frame))

    def settle(self, *, bare: bool = False) -> None:
        """Arrange the figure around its fullest frame, and keep it so.

        `bare` leaves out axes, words and scales: the body fills the frame.
        """
        self.show(self.last)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")
        if not bare:
            return
        ax, *bars = self.figure.axes
        for bar in bars:
            bar.set_visible(False)
        key = ax.get_legend()
        if key is not None:
            key.set_visible(False)
        ax.set_axis_off()
        ax.set_title("", loc="left")
        self.notes.set_visible(False)
        if ax.name != "3d" and ax.get_aspect() != "auto":
            width, height = ax.get_xlim(), ax.get_ylim()
            ratio = (width[1] - width[0]) / (height[1] - height[0])
            side = _BARE / max(ratio, 1.0)
            self.figure.set_size_inches(side * ratio, side)
        ax.set_position((0.0, 0.0, 1.0, 1.0))


def spawning(
    result: TransferResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Film:
    """Return the generations of a run's last stage: agents spawn, loads are taken."""
    if result.scene.lattice.dimension == 3 and cut is None:
        return _spawning_in_space(result)
    stage = result.last
    section = section_of(result.scene, result.focus, cut, crop)
    ax = new_axes(None)
    entries = draw_body(ax, section)
    draw_forces(ax, section, result.stage)
    norm = spawn_norm(stage.generations)
    spawn_bar(ax, norm, stage.generations)
    entries += boundary_entries(stage.boundary_kind[section.holds(stage.boundary_cells)])
    every = [loads_taken(stage, generation) for generation in range(stage.generations + 1)]
    entries += sense_entries(every[0], stage.taken.shape[1], plain=True)
    notes = finish(ax, section, "Agents spawn and pass their loads on", TWO_LINES, entries)
    coarse = section_of(result.scene, result.focus, cut, crop, FILM_ARROWS_ACROSS)
    largest = max(coarse.gather(stage.cells, t, "sum")[1].max(initial=0.0) for t in every)
    scale = load_norm(np.array([largest]))

    def draw(generation: int) -> list[Artist]:
        still = len(ax.collections)
        draw_agents(ax, section, stage, norm, generation)
        draw_loads(ax, coarse, stage, every[generation], scale, plain=True)
        return [*ax.collections[still:]]

    told = "; ".join(section.notes)
    return Film(
        figure_of(ax), stage.generations, draw, notes, lambda g: _generation(stage, g, told)
    )


def _spawning_in_space(result: TransferResult) -> Film:
    scene, stage = result.scene, result.last
    cells = result.focus
    assert cells is not None
    box = box_around(scene, cells)
    space, _ = space_for(None, scene, box, result.stage)
    norm = spawn_norm(stage.generations)
    spawn_bar(space, norm, stage.generations)
    legend(space, boundary_entries(stage.boundary_kind))
    notes = caption(space, "Agents spawn", TWO_LINES)
    told = "; ".join(box.notes)
    return Film(
        figure_of(space),
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
    result: TransferResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Film:
    """Return the stages of loading: the body deforms as the load grows."""
    section = section_of(result.scene, result.focus, cut, crop)
    states = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    load = [0.0, *applied_loads(result).tolist()]

    def words(number: int) -> str:
        agents = len(result.stages[number - 1].cells) if number else 0
        applied = f"{quantity(load[number], 'N')} of {quantity(load[-1], 'N')}"
        return f"applied: {applied}; {counted(agents, 'material agent')}"

    shares = [value / load[-1] if load[-1] else 1.0 for value in load]
    moves = [moving_cells(state, section) for state in states]
    return _deforming(result, section, [moves[0].scaled(0.0), *moves], shares, words, staged=True)


GROWING = 24
"""Frames in which an elastic body takes its load."""


def growing(
    result: BodyResult, cut: Mapping[str, float] | None = None, crop: bool | None = None
) -> Film:
    """Return an elastic body whose load grows evenly, and its displacements with it."""
    section = section_of(result.grid, result.focus, cut, crop)
    full = moving_cells(result, section)
    shares = [number / GROWING for number in range(GROWING + 1)]
    moves = [full.scaled(share) for share in shares]
    return _deforming(result, section, moves, shares, lambda k: f"{shares[k]:.0%} of the load")


def creeping(
    result: TransferCreepResult | ElasticCreepResult,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Film:
    """Return a body in time, at the moments asked for."""
    section = section_of(result.static.grid, result.static.focus, cut, crop)
    moves = [
        moving_cells(result.static, section, partial(result.displacement_at, record=k))
        for k in range(len(result.times))
    ]
    shares = result.factors.tolist()
    told = [
        f"{quantity(t, 's')}; {f:.0%} of the load"
        for t, f in zip(result.times, shares, strict=True)
    ]
    return _deforming(result.static, section, moves, shares, lambda k: told[k])


def _deforming(
    result: BodyResult,
    section: Section,
    moves: list[Moving],
    shares: list[float],
    words: Callable[[int], str],
    *,
    staged: bool = False,
) -> Film:
    """Return a body that deforms: one move and one share of the load a frame.

    `staged` frames are the scene's own stages of loading.
    """
    stage = result.stage
    factor = min((magnification_for(section, m) for m in moves if m.largest), default=1.0)
    norm = Normalize(0.0, max(move.largest for move in moves) or 1.0)
    ax = new_axes(None)
    entries = draw_body(ax, section, filled=False)
    draw_rest(ax, section)
    draw_forces(ax, section, stage)
    sizes = [np.abs(move.moved).max(initial=0.0) for move in moves]
    fullest = moves[first_largest(np.array(sizes))]
    last = draw_deformed(ax, section, fullest, factor, norm)
    colour_bar(ax, last, "displacement", "m")
    notes = finish(ax, section, "The body deforms", TWO_LINES, entries)
    for moving in (last, *(drawn for drawn in ax.collections if drawn.get_gid() == "forces")):
        moving.set_visible(False)
    told = "; ".join([f"deformation shown {times(factor)}", *section.notes])

    def draw(number: int) -> list[Artist]:
        still = len(ax.collections)
        draw_deformed(ax, section, moves[number], factor, norm)
        if shares[number]:
            draw_forces(ax, section, number if staged else stage, share=shares[number])
        return [*ax.collections[still:]]

    return Film(figure_of(ax), len(moves) - 1, draw, notes, lambda k: f"{words(k)}\n{told}")


TITLE = "Agents spawn where load is left unbalanced"


def generations(
    result: ElasticResult,
    colour: str = "level",
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
) -> Film:
    """Return the generations of spawning, coloured by what is known of each of them."""
    values = _all_values(result, colour)
    look = look_of(colour, values)
    if result.lower.shape[1] == 3 and cut is None:
        return _in_space(result, colour, crop, look, values)
    layer = layer_of(result, cut, crop)
    ax = new_axes(None)
    entries = draw_surroundings(ax, layer)
    draw_forces(ax, layer, result.stage)
    bar_of(ax, ScalarMappable(look["norm"], look["cmap"]), colour, values)
    notes = finish(ax, layer, TITLE, TWO_LINES, entries)

    def draw(number: int) -> list[Artist]:
        agents = standing(result, colour, number)
        shown = squares_of(layer, agents.tiles)
        return [draw_squares(ax, layer, shown, "agents", array=shown.value, **look)]

    words = _words(result, "; ".join(layer.notes))
    return Film(figure_of(ax), len(result.generations) - 1, draw, notes, words)


unbalanced_loads = partial(generations, colour="unbalanced_load")


def _in_space(
    result: ElasticResult, colour: str, crop: bool | None, look: dict[str, Any], values: Floats
) -> Film:
    view = view_of(result, crop)
    space, _ = space_for(None, result.grid, view.box, result.stage, MOST_ARROWS)
    bar_of(space, ScalarMappable(look["norm"], look["cmap"]), colour, values)
    notes = caption(space, TITLE, TWO_LINES)

    def draw(number: int) -> list[Artist]:
        return [draw_cubes(space, result.grid, view, standing(result, colour, number), look)]

    words = _words(result, "; ".join(view_told(view)))
    return Film(figure_of(space), len(result.generations) - 1, draw, notes, words)


def _words(result: ElasticResult, still: str) -> Callable[[int], str]:
    return lambda number: f"{told(result, number)}\n{still}"


def _all_values(result: ElasticResult, colour: str) -> Floats:
    """Return what the colours show of all generations together."""
    if colour not in OF_EVERY_GENERATION:
        raise ParameterError(
            f"colour: an animation shows {', '.join(OF_EVERY_GENERATION)}, got {colour!r}"
        )
    if colour == "unbalanced_load":
        return np.concatenate([generation.load for generation in result.generations])
    return np.asarray(standing(result, colour).value)
