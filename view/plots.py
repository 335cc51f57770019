"""One word for every picture: `plot(result, "agents")`, and `plot_all` for the usual set."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaju.errors import ParameterError, ResultFileError, no_such, require, unknown
from kaju.model.results.archive import answer_of
from kaju.model.results.result import Result, solved_scene
from kaju.model.scene import Scene
from kaju.result_kinds import KINDS, fetch

from .agents import plot_agents
from .body_in_space import plot_body_in_space
from .body_plots import BodyPicture
from .layers import layer_of
from .section import Cut, section_of
from .style import figure_of, save

Picture = Callable[..., "Axes | Figure"]


def plot_scene(
    subject: Any, ax: Axes | None = None, *, cut: Cut = None, crop: bool = False
) -> Axes:
    """Draw what a scene or a result asks: body, supports, forces; all of it, or where these are."""
    if isinstance(subject, Scene) and subject.outlined and subject.lattice.dimension == 2:
        from kaju.model.study.solving import solve

        subject = solve(subject, 0.3)  # a few agents know what outlines leave of the body
    if getattr(subject, "cut_agents", None):
        section = layer_of(subject, crop=False)
    else:
        scene = subject if isinstance(subject, Scene) else solved_scene(subject)
        if scene.lattice.dimension == 3 and cut is None:
            return plot_body_in_space(scene, ax)
        section = section_of(scene, scene.applied().cells if crop else None, cut, crop)
    picture = BodyPicture(section, ax)
    return picture.finish("The scene", picture.notes)


def pictures_of(subject: Scene | Result) -> dict[str, Picture]:
    """Return the pictures that can be made of a subject, by name, the usual one first."""
    if isinstance(subject, Scene):
        return {"scene": plot_scene}
    if not isinstance(subject, Result):
        raise ParameterError(
            f"subject: a Scene, a result, a model or a path is needed, got {type(subject).__name__}"
        )
    known = KINDS[subject.kind].pictures
    return {
        name: fetch(known[name]) if name in known else partial(plot_agents, state=name)
        for name in subject.pictures  # others are names of states of agents of your own
    }


def plot(subject: Any, what: str | None = None, ax: Axes | None = None, **options: Any) -> Figure:
    """Draw a picture of a scene or a result.

    Parameters
    ----------
    subject : Scene, Result, model or path
        What the picture is of: of a model the answer as far as it has come, of a path the scene
        (.toml) or the result in it.
    what : str, optional
        One of the result's `pictures`, the first of them unless given; of a scene "scene".
    ax : matplotlib Axes, optional
        Where to draw; a new figure unless given.
    **options
        Options of the picture; others raise an error.

        - ``cut={"y": 0.05}``: the plane through a body of cubes to show (m), ``cut={}`` one
          through the agents; unless given that, or the whole body in space.
        - ``crop``: whether to show only the surroundings of the agents.
        - ``component`` of maps: "magnitude" or an axis of displacements, a pair of axes such as
          "xy" of stresses and strains.
        - ``magnification`` of "deformed": how many times larger than true displacements are
          drawn; unless given a round number that makes them visible. The picture states it.
        - Which state: ``generation`` of agents, ``stage``, ``share`` of the load or ``record`` of
          "deformed", ``moment`` of "left", ``breaks`` of "crack", ``step`` of "design".
        - ``colour`` of "deformed": "von_mises" (as unless given) or "displacement"; of agents of
          many sizes: "level" (as unless given), "spawn_step", "gap" (between their two opinions),
          "fitted" or "balanced" (the stress of each opinion) or "von_mises".
        - ``level`` of agents of the elastic rule: 0 for those on the faces, 1 for parents ...
        - ``axis`` of "cuts": across which the body is cut; ``panel`` of curves on given axes.

    Returns
    -------
    matplotlib Figure
        A notebook shows it; ``savefig`` writes it.

    Raises
    ------
    ParameterError
        If there is no such picture, it has no such option, or the option's value breaks its
        rule.

    Examples
    --------
    >>> import kaju
    >>> figure = kaju.plot(kaju.LoadModel(kaju.load_scene("plate.toml")).run())
    >>> len(figure.axes) > 0
    True
    """
    subject = answer_of(subject)
    known = pictures_of(subject)
    name = next(iter(known)) if what is None else what
    told = f"picture {name!r} of {type(subject).__name__}"
    require(name in known, f"what: {no_such(told, name, known)}")
    check_options(name, known[name], options)
    drawn = known[name](subject, ax, **options)
    return drawn if isinstance(drawn, Figure) else figure_of(drawn)


def plot_all(result: Result, directory: str | Path) -> list[Path]:
    """Write the usual pictures of a result into a folder, as PNG files named after what they show.

    Returns the files in the order in which they are best looked at. The folder must exist.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise ResultFileError(f"{folder}: there is no such directory for pictures")
    seldom = {"scene", "left"}
    if not getattr(result, "spawned", True):
        seldom |= {"agents"}  # equal agents are no news
    names = [name for name in result.pictures if name not in seldom]
    if result.kind == "load transfer":
        usual = ("agents", "loads", "deformed", "von_mises", "stages")
        names = [name for name in usual if name in names]
    written = []
    for name in names:
        figure = plot(result, name)
        written.append(save(figure, folder / f"{name}.png"))
        if name == "agents" and figure.axes[0].name == "3d":
            written.append(save(plot(result, name, cut={}), folder / "agents_section.png"))
    return written


def check_options(name: str, draw: Callable[..., Any], options: Mapping[str, object]) -> None:
    """Refuse options that a picture or a film does not have."""
    (_, *rest) = inspect.signature(draw).parameters.values()
    known = [each.name for each in rest if each.name not in ("ax", "what", "state")]
    if inspect.Parameter.VAR_KEYWORD in {each.kind for each in rest}:
        return
    for option in options:
        if option not in known:
            raise unknown(option, repr(name), known)
