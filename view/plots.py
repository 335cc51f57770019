"""One word for every picture: `plot(result, "agents")`, and `plot_all` for the usual set."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError, ResultFileError
from kaju.model.results.result import Result
from kaju.model.results.subjects import answer_of
from kaju.model.scene import Scene
from kaju.model.transfer.transfer_result import TransferResult

from .agents import plot_agents
from .body_plots import draw_scene
from .creep import plot_body_at, plot_curves, plot_network_at
from .cut_plots import plot_cuts
from .deformed import plot_deformed
from .face_agents import plot_face_agents, plot_left
from .fracture_plots import plot_avalanches, plot_crack, plot_load_and_displacement
from .growth_plots import plot_design, plot_growth
from .ledger import plot_ledger
from .load_plots import plot_load_path, plot_loads
from .maps import plot_map
from .network_plots import plot_network, plot_response
from .outlined import plot_cut_agents
from .picture_files import save
from .quadtree import plot_octree, plot_quadtree
from .section import section_of
from .space import plot_body_in_space, plot_voxels
from .stages import plot_both, plot_stages
from .style import figure_of

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult

Picture = Callable[..., "Axes | Figure"]


Cut = Mapping[str, float]


def plot_scene(
    scene: Scene, ax: Axes | None = None, *, cut: Cut | None = None, crop: bool = False
) -> Axes:
    """Draw what is asked: body, supports and forces; all of it, or where the forces are."""
    if scene.lattice.dimension == 3 and cut is None:
        return plot_body_in_space(scene, ax)
    cells = scene.applied().cells if crop else None
    return draw_scene(scene, section_of(scene, cells, cut, crop), ax)


def _agents(
    result: TransferResult,
    ax: Axes | None = None,
    *,
    cut: Cut | None = None,
    crop: bool | None = None,
) -> Axes:
    if result.scene.lattice.dimension == 3 and cut is None:
        return plot_voxels(result, ax, crop=crop)
    return plot_agents(result, ax, cut=cut, crop=crop)


@wraps(plot_stages)
def _stages(result: TransferResult, ax: Axes | None = None, **options: Any) -> Axes | Figure:
    return plot_both(result) if ax is None and not options else plot_stages(result, ax, **options)


def _map(what: str) -> Picture:
    @wraps(plot_map)
    def draw(result: Any, ax: Axes | None = None, **options: Any) -> Axes:
        return plot_map(result, what, ax, **options)

    return draw


MAPS = ("displacement", "strain", "stress", "von_mises")


@wraps(plot_scene)
def _scene(result: Any, ax: Axes | None = None, **options: Any) -> Axes:
    return plot_scene(result.scene, ax, **options)


TRANSFER: dict[str, Picture] = {
    "agents": _agents,
    "loads": plot_loads,
    "deformed": plot_deformed,
    **{name: _map(name) for name in MAPS},
    "taken": _map("taken"),
    "load_path": plot_load_path,
    "cuts": plot_cuts,
    "ledger": plot_ledger,
    "stages": _stages,
    "scene": _scene,
}
"""Pictures of a run of load transfer."""

NETWORK: dict[str, Picture] = {"deformed": plot_network, "response": plot_response}
"""Pictures of a loaded spring network."""


FRACTURE: dict[str, Picture] = {
    "crack": plot_crack,
    "response": plot_load_and_displacement,
    "avalanches": plot_avalanches,
}
"""Pictures of a network or a body that breaks."""


@wraps(plot_quadtree)
def _many_sizes(result: ElasticResult, ax: Axes | None = None, **options: Any) -> Axes:
    whole = result.scene.lattice.dimension == 3 and not {"cut", "step"} & set(options)
    return plot_octree(result, ax, **options) if whole else plot_quadtree(result, ax, **options)


ELASTIC: dict[str, Picture] = {
    "agents": _many_sizes,
    "deformed": plot_deformed,
    **{name: _map(name) for name in MAPS},
    "cuts": plot_cuts,
    "scene": _scene,
}
"""Pictures of an elastic answer."""


def _settled(plot: Picture) -> Picture:
    """Draw what the agents have settled to."""

    @wraps(plot)
    def draw(run: Any, ax: Axes | None = None, **options: Any) -> Axes | Figure:
        return plot(run.result, ax, **options)

    return draw


FACES: dict[str, Picture] = {
    "agents": plot_face_agents,
    "left": plot_left,
    "curves": plot_curves,
    **{name: _settled(ELASTIC[name]) for name in ("deformed", *MAPS, "cuts")},
    "scene": _scene,
}
"""Pictures of agents of the elastic rule."""

BODY_IN_TIME: dict[str, Picture] = {
    "curves": plot_curves,
    "deformed": plot_body_at,
    "scene": _scene,
}
"""Pictures of bodies that creep."""

PICTURES_OF: dict[str, dict[str, Picture]] = {
    "load transfer": TRANSFER,
    "elastic": ELASTIC,
    "true outlines": {"agents": plot_cut_agents},
    "elastic agents": FACES,
    "spring network": NETWORK,
    "fracture": FRACTURE,
    "growth": {"design": plot_design, "history": plot_growth},
    "element in time": {"curves": plot_curves},
    "network in time": {"curves": plot_curves, "deformed": plot_network_at},
    "load transfer in time": BODY_IN_TIME,
    "elasticity in time": BODY_IN_TIME,
}
"""Pictures by the kind of the result."""

USUAL = ("agents", "loads", "deformed", "load_path", "von_mises", "ledger", "stages")


def pictures_of(subject: Scene | Result) -> dict[str, Picture]:
    """Return the pictures that can be made of a subject, by name, the usual one first."""
    if isinstance(subject, Scene):
        return {"scene": plot_scene}
    if not isinstance(subject, Result):
        raise ParameterError(
            f"subject: a Scene, a result, a model or a path is needed, got {type(subject).__name__}"
        )
    return {name: PICTURES_OF[subject.kind][name] for name in subject.pictures}


def plot(subject: Any, what: str | None = None, ax: Axes | None = None, **options: Any) -> Figure:
    """Draw a picture of a scene or a result.

    Parameters
    ----------
    subject : Scene, Result, model or path
        What the picture is of: of a model the answer as far as it has come, of a path the scene
        (.toml) or the result in it.
    what : str, optional
        Of a scene "scene". Of a run of load transfer "agents" (as unless given), "loads",
        "deformed", "displacement", "strain", "stress", "von_mises", "taken", "load_path",
        "cuts", "ledger", "stages" or "scene". Of elastic results those of them that are fields or
        the scene, and of agents of many sizes "agents" as well; of agents of the elastic rule
        also "left" and "curves"; of what creeps "curves" and, but for a single element,
        "deformed". Of a network's result "deformed" or "response"; of one that breaks
        "crack", "response" or "avalanches"; of a body that grows "design" or "history".
    ax : matplotlib Axes, optional
        Where to draw; a new figure unless given.
    **options
        What the picture takes; an option that it has not is refused by name.

        - ``cut={"y": 0.05}``: the plane through a body of cubes to show (m); unless given
          one through the agents, or the whole body in space.
        - ``crop``: whether to show only the surroundings of the agents; by itself for
          large bodies.
        - ``component`` of maps: of displacements "magnitude" (as unless given) or an axis; of
          stresses and strains a pair of axes such as "xy", unless given the largest.
        - ``magnification`` of "deformed": how many times larger than true displacements are
          drawn; unless given a round number that makes them visible. The picture states it.
        - ``generation`` of "loads": only the loads taken in it, from 1; of agents of many
          sizes: the generation to show, from 0.
        - ``colour`` of agents of many sizes: "level" (as unless given), "spawn_step",
          "unbalanced_load", "error_share" or "von_mises"; of networks "tension" or "strain".
        - ``step`` of agents of many sizes in the plane: outline those that spawned then; of
          "design": after which step, the last unless given.
        - ``level`` of agents of the elastic rule: 0 for those on the faces, 1 for parents ...
        - ``record`` of networks and of what creeps: which state; the last unless given.
        - ``breaks`` of "crack": after how many; the last state that resisted unless given.
        - ``axis`` of "cuts": across which the body is cut.
        - ``panel`` of "curves", ``quantity_shown`` ("displacement" or "agents") of "stages".

    Returns
    -------
    matplotlib Figure
        Call its ``savefig``, or let a notebook show it.

    Raises
    ------
    ParameterError
        If there is no such picture, it has no such option, or the option's value breaks its
        rule.

    Examples
    --------
    >>> from kaju import LoadModel, Scene, plot
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> figure = plot(LoadModel(scene).run())
    >>> len(figure.axes) > 0
    True
    """
    subject = answer_of(subject)
    known = pictures_of(subject)
    name = next(iter(known)) if what is None else what
    if name not in known:
        raise ParameterError(
            f"what: there is no picture {name!r} of a {type(subject).__name__}"
            f"{suggestion(str(name), known)}; there is {', '.join(known)}"
        )
    check_options(name, known[name], options)
    drawn = known[name](subject, ax, **options)
    return drawn if isinstance(drawn, Figure) else figure_of(drawn)


def plot_all(result: Result, directory: str | Path) -> list[Path]:
    """Write the usual pictures of a result as PNG files, each named after what it shows.

    Parameters
    ----------
    result : Result
        A result.
    directory : path
        Where to write; it must exist.

    Returns
    -------
    list of Path
        The files, in the order in which they are best looked at.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise ResultFileError(f"{folder}: there is no such directory for pictures")
    written = []
    for name in _usual(result):
        written.append(save(plot(result, name), folder / f"{name}.png"))
        if name == "agents" and (section := _section(result)):
            written.append(save(figure_of(section), folder / "agents_section.png"))
    return written


SECTIONS: dict[str, Callable[[Any], Axes]] = {
    "load transfer": plot_agents,
    "elastic": plot_quadtree,
}
"""Sections through the agents of bodies in space."""


def _section(result: Any) -> Axes | None:
    """Draw a section through the agents of a body in space."""
    if result.kind not in SECTIONS or result.scene.lattice.dimension == 2:
        return None
    return SECTIONS[result.kind](result)


def _usual(result: Result) -> list[str]:
    seldom = {"scene", "left"} | ({"agents"} - {result.pictures[0]})
    known = [name for name in result.pictures if name not in seldom]
    return [name for name in USUAL if name in known] if result.kind == "load transfer" else known


def check_options(name: str, draw: Callable[..., Any], options: Mapping[str, object]) -> None:
    """Refuse options that a picture or a film does not have."""
    (_, *rest) = inspect.signature(draw).parameters.values()
    known = [each.name for each in rest if each.name not in ("ax", "what")]
    if inspect.Parameter.VAR_KEYWORD in {each.kind for each in rest}:
        return
    for option in options:
        if option not in known:
            raise ParameterError(
                f"{option}: {name!r} has no such option{suggestion(option, known)}; "
                f"it has {', '.join(known) or 'none'}"
            )
