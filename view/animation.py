"""Animations of stored runs: as pictures that move, or as meshes that move."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError, ResultFileError
from kaju.files import atomic_file
from kaju.model.results.loading import answer_of
from kaju.model.results.result import Result
from kaju.model.scene import Scene
from kaju.result_kinds import KINDS, fetch

from .films import WRITERS, Film, ffmpeg, frames, write_pictures
from .meshes import write_motion
from .picture_files import new_folder
from .plots import check_options, pictures_of
from .style import figure_of

MOST_FRAMES = 200
"""Of longer runs evenly spaced frames are shown."""
MESHES = (".glb", ".pvd")


def animate(
    result: Any,
    path: str | Path,
    what: str | None = None,
    *,
    fps: float | None = None,
    hold: float = 3.0,
    bare: bool = False,
    magnification: float | None = None,
    **options: Any,
) -> Path:
    """Write an animation of a run: one of its pictures, over one of its options.

    Scale, magnification and camera stay the same from the first frame to the last.

    Parameters
    ----------
    result : Result, model or path
        Of a model, a solver, or `kaju.creep`; a model shows what it has done so far, and one
        that has not begun is run.
    path : path
        The ending decides: ``.gif``, ``.webp`` or ``.mp4`` are films; a name without ending is
        a folder of pictures without background (PNG with alpha), one a frame; ``.glb`` is a
        mesh with one morph target a frame, for Blender; ``.pvd`` is a list of VTK files in a
        folder beside it, for ParaView.
    what : str, optional
        One of the result's `films`, the first of them unless given: such as "generations",
        "stages", "loading", "gaps" (generations coloured by the gap between the agents' two
        opinions), "waves", "increments", "breaks", "steps", "times" or "curves".
    fps : float, optional
        Frames per second, up to 50; unless given 25 of what moves in time, 2 of steps.
    hold : float
        For how long the last frame stays (s).
    bare : bool
        Leave out axes, words and scales; of pictures only.
    magnification : float, optional
        How many times larger than true a ``.glb`` shows displacements. Unless given, a round
        number that makes them visible, or 1; it is stated in the file.
    **options
        Those of the picture, as for `plot`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        If there is no such animation, or it has no such option, or the ending or a number is out
        of its rule.
    MissingExtraError
        If an MP4 is asked for and there is no ffmpeg, or a series and there is no meshlane.
    ResultFileError
        If the file cannot be written, or the folder is there already.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from kaju import LoadModel, Scene, animate
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> result = LoadModel(scene).run()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     animate(result, Path(folder) / "loads.gif").name
    ...
    'loads.gif'
    """
    target = Path(path)
    ending = target.suffix.lower()
    _check(target, ending, fps, hold)
    if getattr(result, "steps", None) == 0 and hasattr(result, "run"):
        result = result.run()
    result = answer_of(result)
    if isinstance(result, Scene):
        raise ParameterError(
            "result: a Scene has no film yet; run it first, kaju.animate(LoadModel(scene).run(), "
            f"{str(target)!r}), or solve it"
        )
    if not isinstance(result, Result):
        raise ParameterError(f"result: an answer of kaju is needed, got {type(result).__name__}")
    kind = KINDS[result.kind]
    if ending in MESHES:
        motion = _chosen(kind.meshes, result, what)(result)
        write_motion(motion, target, fps or 2.0, hold, magnification)
        return target
    known = {name: kind.films.get(name, "view.agents:GENERATIONS") for name in result.films}
    film: Film = _chosen(known, result, what)
    if what is not None and what not in kind.films:  # what agents of one's own know
        film = film._replace(picture=what)
    picture = pictures_of(result)[film.picture]
    check_options(film.picture, picture, options)
    if magnification is not None:
        options["magnification"] = magnification
    options = film.fixed(result, options) | options

    def draw(moment: Any) -> Figure:
        drawn = picture(result, **options, **{film.option: moment})
        return drawn if isinstance(drawn, Figure) else figure_of(drawn)

    every = film.moments(result)
    count = min(len(every), MOST_FRAMES)
    chosen = np.unique(np.linspace(0, len(every) - 1, count).round().astype(np.int64))
    moments = [every[k] for k in chosen]
    if not ending:
        with new_folder(target) as folder:
            write_pictures(frames(draw, moments, bare=bare, mode="RGBA"), folder)
        return target
    with atomic_file(target, ResultFileError) as scratch:
        WRITERS[ending](frames(draw, moments, bare=bare), scratch, fps or film.fps, hold)
    return target


def _check(target: Path, ending: str, fps: float | None, hold: float) -> None:
    endings = (*WRITERS, *MESHES)
    if ending and ending not in endings:
        raise ParameterError(
            f"{target}: an animation ends in {', '.join(endings)}, or in nothing (a folder of "
            f"pictures), not in {ending!r}"
        )
    if fps is not None and not (isfinite(fps) and 0.0 < fps <= 50.0):
        raise ParameterError(f"fps: a number above 0 and up to 50 is needed, got {fps}")
    if not (isfinite(hold) and hold >= 0.0):
        raise ParameterError(f"hold: a time from 0 s upwards is needed, got {hold}")
    if ending == ".mp4":
        ffmpeg(target)


def _chosen(known: Mapping[str, str], result: object, what: str | None) -> Any:
    name = next(iter(known), "mesh") if what is None else what
    if name not in known:
        raise ParameterError(
            f"what: there is no such animation {name!r} of a {type(result).__name__}"
            f"{suggestion(str(name), known)}; there is {', '.join(known) or 'none'}"
        )
    return fetch(known[name])
