"""Animations of stored runs, as GIF or MP4."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.animation import FFMpegWriter
from PIL import Image

from kaju.agents.materials import suggestion
from kaju.errors import MissingExtraError, ParameterError, ResultFileError
from kaju.files import scratch_beside
from kaju.model.result import Result

from .face_agents import waves
from .network_plots import increments
from .reels import Reel, loading, spawning
from .spawning_reels import generations

MOST_FRAMES = 200
"""Of longer runs evenly spaced frames are shown."""
_RESOLUTION = 100  # dots per inch

ReelMaker = Callable[..., Reel]

TRANSFER: dict[str, ReelMaker] = {"generations": spawning, "stages": loading}
"""What can be animated of a run of load transfer."""
NETWORK: dict[str, ReelMaker] = {"increments": increments}
"""What can be animated of a loaded spring network."""
SPAWNED: dict[str, ReelMaker] = {
    "generations": generations,
    "loads": partial(generations, colour="unbalanced_load"),
}
"""What can be animated of agents of many sizes."""

FACES: dict[str, ReelMaker] = {"waves": waves}
"""What can be animated of agents of the elastic rule."""
REELS_OF: dict[str, dict[str, ReelMaker]] = {
    "load transfer": TRANSFER,
    "elastic agents": FACES,
    "spawned": SPAWNED,
    "spring network": NETWORK,
}
"""What can be animated, by the kind of the result."""


def animate(
    result: Result,
    path: str | Path,
    what: str | None = None,
    *,
    fps: float = 2.0,
    hold: float = 3.0,
    **options: Any,
) -> Path:
    """Write an animation of a stored run; nothing is computed again.

    Parameters
    ----------
    result : Result
        A run of load transfer or of a spring network, or agents of many sizes.
    path : path
        A file ending in ``.gif``, or in ``.mp4`` if the program ffmpeg is there.
    what : str, optional
        Of load transfer "generations" of the last stage (as unless given) or "stages" of
        loading; of agents of the elastic rule "waves"; of a spring network "increments"; of
        agents of many sizes "generations", or "loads", which colours them by the load that they
        leave unbalanced.
    fps : float
        Frames per second, up to 50.
    hold : float
        For how long the last frame stays (s).
    **options
        ``cut`` and ``crop`` as for `plot`; for generations of agents of many sizes also
        ``colour``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        If there is no such animation, or the ending or a number is out of its rule.
    MissingExtraError
        If an MP4 is asked for and ffmpeg is missing.
    ResultFileError
        If the file cannot be written.
    """
    target = Path(path)
    writer = _writer(target)
    if not (isfinite(fps) and 0.0 < fps <= 50.0):
        raise ParameterError(f"fps: a number above 0 and up to 50 is needed, got {fps}")
    if not (isfinite(hold) and hold >= 0.0):
        raise ParameterError(f"hold: a time from 0 s upwards is needed, got {hold}")
    reel = _maker(result, what)(result, **options)
    reel.figure.set_dpi(_RESOLUTION)
    reel.settle()
    count = min(reel.last + 1, MOST_FRAMES)
    frames = np.unique(np.linspace(0, reel.last, count).round().astype(np.int64)).tolist()
    with scratch_beside(target, ResultFileError) as scratch:
        writer(reel, frames, scratch, fps, hold)
    return target


def _maker(result: Result, what: str | None) -> ReelMaker:
    known = REELS_OF.get(result.kind)
    if known is None:
        raise ParameterError(
            f"result: a result of {result.kind} is one state, there is nothing to animate; plot it"
        )
    name = next(iter(known)) if what is None else what
    if name not in known:
        raise ParameterError(
            f"what: there is no animation {name!r} of a {type(result).__name__}"
            f"{suggestion(str(name), known)}; there is {', '.join(known)}"
        )
    return known[name]


def _writer(target: Path) -> Callable[[Reel, list[int], Path, float, float], None]:
    ending = target.suffix.lower()
    if ending == ".gif":
        return _write_gif
    if ending != ".mp4":
        raise ParameterError(f"{target}: an animation ends in .gif or .mp4, not in {ending!r}")
    if not FFMpegWriter.isAvailable():
        raise MissingExtraError(
            f"{target}: MP4 needs the program ffmpeg, which is not on PATH; install it from "
            "your system's packages (such as apt install ffmpeg), or write a .gif"
        )
    return _write_mp4


def _image(reel: Reel, frame: int) -> Image.Image:
    reel.show(frame)
    canvas = cast(Any, reel.figure.canvas)  # Agg's, which arrives untyped
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _write_gif(reel: Reel, frames: list[int], path: Path, fps: float, hold: float) -> None:
    # One palette for all frames, or colours would flicker; the last frame has most of them.
    palette = _image(reel, frames[-1]).quantize(256, kmeans=3)
    images = [
        _image(reel, frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    durations = [round(1000.0 / fps)] * len(images)
    durations[-1] += round(1000.0 * hold)
    images[0].save(path, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)


def _write_mp4(reel: Reel, frames: list[int], path: Path, fps: float, hold: float) -> None:
    writer = FFMpegWriter(fps=cast(int, fps))
    with writer.saving(reel.figure, str(path), _RESOLUTION):
        for frame in frames:
            reel.show(frame)
            writer.grab_frame()
        for _ in range(round(hold * fps)):
            writer.grab_frame()
