"""Animations of stored runs: as pictures that move, or as meshes that move."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter
from PIL import Image

from kaju.agents.materials import suggestion
from kaju.errors import ParameterError, ResultFileError, needing
from kaju.files import atomic_file
from kaju.model.results.result import Result
from kaju.model.results.subjects import answer_of
from kaju.model.scene import Scene
from kaju.result_kinds import KINDS, fetch
from kaju.view.films import Film

from .motion import film_of_motion
from .picture_files import new_folder
from .plots import check_options

MOST_FRAMES = 200
"""Of longer runs evenly spaced frames are shown."""
MESHES = (".glb", ".pvd")
_RESOLUTION = 100  # dots per inch


def animate(
    result: Any,
    path: str | Path,
    what: str | None = None,
    *,
    fps: float = 2.0,
    hold: float = 3.0,
    bare: bool = False,
    magnification: float | None = None,
    **options: Any,
) -> Path:
    """Write an animation of a stored run; nothing is computed again.

    Scale and camera stay the same from the first frame to the last.

    Parameters
    ----------
    result : Result, model or path
        Of a model, a solver, or `kaju.creep`; a model shows what it has done so far.
    path : path
        The ending decides: ``.gif``, ``.webp`` or ``.mp4`` are films; a name without ending is
        a folder of pictures without background (PNG with alpha), one a frame; ``.glb`` is a
        mesh with one morph target a frame, for Blender; ``.pvd`` is a list of VTK files in a
        folder beside it, for ParaView.
    what : str, optional
        Of load transfer "generations" of the last stage (as unless given) or "stages" of
        loading; of agents of the elastic rule "waves"; of an elastic body "loading"; of a
        spring network "increments", of one that breaks "breaks"; of a body that grows "steps";
        of agents of many sizes "generations", or "loads", which colours them by the load that they
        leave unbalanced (as meshes "loading"); of what creeps "times", or "curves" with a dot that
        runs along them.
    fps : float
        Frames per second, up to 50.
    hold : float
        For how long the last frame stays (s).
    bare : bool
        Leave out axes, words and scales; of pictures only.
    magnification : float, optional
        How many times larger than true a ``.glb`` shows displacements. Unless given, a round
        number that makes them visible, or 1; it is stated in the file.
    **options
        Of pictures ``cut`` and ``crop`` as for `plot`; for generations of agents of many sizes
        also ``colour``.

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
        If an MP4 is asked for and there is no ffmpeg, or a series and there is no meshio.
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
    result = answer_of(result)
    if isinstance(result, Scene):
        raise ParameterError(
            "result: a Scene has no film yet; run it first, kaju.animate(LoadModel(scene).run(), "
            f"{str(target)!r}), or solve it"
        )
    if not isinstance(result, Result):
        raise ParameterError(f"result: an answer of kaju is needed, got {type(result).__name__}")
    if ending in MESHES:
        moving = _chosen(KINDS[result.kind].meshes, result, what)(result)
        film_of_motion(moving, target, fps, hold, magnification)
        return target
    reels = {name: KINDS[result.kind].films[name] for name in result.films}
    chosen = _chosen(reels, result, what)
    check_options(what or next(iter(reels)), chosen, options)
    reel = chosen(result, **options)
    reel.figure.set_dpi(_RESOLUTION)
    reel.settle(bare=bare)
    count = min(reel.last + 1, MOST_FRAMES)
    frames = np.unique(np.linspace(0, reel.last, count).round().astype(np.int64)).tolist()
    if not ending:
        with new_folder(target) as folder:
            _write_frames(reel, frames, folder)
        return target
    with atomic_file(target, ResultFileError) as scratch:
        _WRITERS[ending](reel, frames, scratch, fps, hold)
    return target


def _check(target: Path, ending: str, fps: float, hold: float) -> None:
    endings = (*_WRITERS, *MESHES)
    if ending and ending not in endings:
        raise ParameterError(
            f"{target}: an animation ends in {', '.join(endings)}, or in nothing (a folder of "
            f"pictures), not in {ending!r}"
        )
    if not (isfinite(fps) and 0.0 < fps <= 50.0):
        raise ParameterError(f"fps: a number above 0 and up to 50 is needed, got {fps}")
    if not (isfinite(hold) and hold >= 0.0):
        raise ParameterError(f"hold: a time from 0 s upwards is needed, got {hold}")
    if ending == ".mp4":
        _ffmpeg(target)


def _chosen(known: Mapping[str, str], result: object, what: str | None) -> Callable[..., Any]:
    name = next(iter(known), "mesh") if what is None else what
    if name not in known:
        raise ParameterError(
            f"what: there is no such animation {name!r} of a {type(result).__name__}"
            f"{suggestion(str(name), known)}; there is {', '.join(known) or 'none'}"
        )
    return cast(Callable[..., Any], fetch(known[name]))


def _image(reel: Film, frame: int, mode: str = "RGB") -> Image.Image:
    reel.show(frame)
    canvas = cast(Any, reel.figure.canvas)  # Agg's, which arrives untyped
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert(mode)


def _durations(frames: list[int], fps: float, hold: float) -> list[int]:
    """Return for how long every frame stays (ms)."""
    durations = [round(1000.0 / fps)] * len(frames)
    durations[-1] += round(1000.0 * hold)
    return durations


def _write_gif(reel: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    # One palette for all frames, or colours would flicker: that of a few of them, side by side.
    some = {k: _image(reel, k) for k in (frames[0], frames[len(frames) // 2], frames[-1])}
    strip = Image.fromarray(np.concatenate([np.asarray(image) for image in some.values()]))
    palette = strip.quantize(255, kmeans=3)
    colours = [*(palette.getpalette() or [])[:765], 255, 255, 255]
    palette.putpalette(colours)
    first, *rest = (_indexed(some.get(k) or _image(reel, k), palette) for k in frames)
    durations = _durations(frames, fps, hold)
    first.save(path, "GIF", save_all=True, append_images=rest, duration=durations, loop=0)


def _indexed(image: Image.Image, palette: Image.Image) -> Image.Image:
    """Return an image in the colours of a palette, of which the last is white."""
    nearest = image.quantize(palette=palette, dither=Image.Dither.NONE)
    number = np.array(nearest)
    number[(np.asarray(image) == 255).all(axis=2)] = 255  # Pillow takes any light grey for it
    indexed = Image.fromarray(number, "P")
    indexed.putpalette(palette.getpalette() or [])
    return indexed


def _write_webp(reel: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    first, *rest = (_image(reel, frame) for frame in frames)
    durations = _durations(frames, fps, hold)
    options: dict[str, Any] = {"duration": durations, "loop": 0, "lossless": True}
    first.save(path, "WEBP", save_all=True, append_images=rest, **options)


def _write_mp4(reel: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    with rc_context({"animation.ffmpeg_path": _ffmpeg(path)}):
        writer = FFMpegWriter(fps=cast(int, fps))
        with writer.saving(reel.figure, str(path), _RESOLUTION):
            for frame in frames:
                reel.show(frame)
                writer.grab_frame()
            for _ in range(round(hold * fps)):
                writer.grab_frame()


def _ffmpeg(target: Path) -> str:
    """Return the program that makes MP4: the system's, or the one that a wheel ships."""
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    with needing(
        f"{target}: MP4 needs the program ffmpeg: pip install 'kaju[film]', or install it "
        "from your system's packages; or write a .gif or .webp"
    ):
        import imageio_ffmpeg
    program: str = imageio_ffmpeg.get_ffmpeg_exe()
    return program


def _write_frames(reel: Film, frames: list[int], folder: Path) -> None:
    reel.figure.patch.set_alpha(0.0)
    for axes in reel.figure.axes:
        axes.patch.set_alpha(0.0)
    for number, frame in enumerate(frames):
        _image(reel, frame, "RGBA").save(folder / f"{number:04d}.png")


_WRITERS = {".gif": _write_gif, ".webp": _write_webp, ".mp4": _write_mp4}
