"""Films: a picture drawn again for every value of one of its options, as GIF, WebP, MP4 or PNG.

What a kind of result films is one `Film`: which picture, over which option. All frames have the
size, the axes and the scales of the whole run, so that nothing jumps.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from kaju.arrays import Ints
from kaju.errors import ResultFileError, needing

RESOLUTION = 100
"""Dots per inch of films."""
PER_SECOND = 25.0
"""Frames a second of films of what moves in time."""


def evenly(count: int, most: int) -> Ints:
    """Return all of so many moments, or `most` of them, evenly, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


class Film(NamedTuple):
    """A picture over the values of one of its options."""

    picture: str
    option: str
    moments: Callable[[Any], Sequence[Any]]
    """The values of the option, in order, of a result."""
    fixed: Callable[[Any, Mapping[str, Any]], dict[str, Any]] = lambda *_: {}
    """Options that all frames share, of a result and the options that were asked for."""
    fps: float = 2.0


def frames(
    draw: Callable[[Any], Figure], moments: Sequence[Any], *, bare: bool = False, mode: str = "RGB"
) -> Iterator[Image.Image]:
    """Yield the pictures of some moments, all with the same axes; `bare` shows the body alone.

    `mode` "RGBA" leaves the background out.
    """
    # Three pictures decide how much room all of them get.
    looked_at = [draw(moments[k]) for k in evenly(len(moments), 3)]
    for figure in looked_at:
        figure.set_dpi(RESOLUTION)
        figure.draw_without_rendering()
    first = min(looked_at, key=lambda figure: figure.axes[0].get_position(original=True).height)
    limits = []  # of all pictures together
    for n, ax in enumerate(first.axes):
        every = [[getattr(f.axes[n], f"get_{x}lim")() for f in looked_at] for x in _names(ax)]
        limits.append([(min(low), max(high)) for low, high in map(np.transpose, every)])
    places = [ax.get_position(original=True) for ax in first.axes]
    for moment in moments:
        figure = draw(moment)
        figure.set_layout_engine("none")
        figure.set_size_inches(*first.get_size_inches())
        for ax, place, sides in zip(figure.axes, places, limits, strict=True):
            ax.set_position(place)
            for name, (low, high) in zip(_names(ax), sides, strict=True):
                getattr(ax, f"set_{name}lim")(low, high)
        if bare:
            _bare(figure)
        yield _pixels(figure, mode)


def _names(ax: Axes) -> str:
    """Return the axes whose limits a film keeps; colour bars have the same in every frame."""
    if ax.get_label() == "<colorbar>":
        return ""
    return "xyz" if ax.name == "3d" else "xy"


def _bare(figure: Figure) -> None:
    """Leave out axes, words and scales: the body fills the frame."""
    ax, *bars = figure.axes
    for part in filter(None, (*bars, ax.get_legend())):
        part.set_visible(False)
    ax.set_axis_off()
    ax.set_title("", loc="left")
    for text in ax.texts:
        text.set_visible(False)
    if ax.name != "3d" and ax.get_aspect() != "auto":
        ratio = float(np.ptp(ax.get_xlim()) / np.ptp(ax.get_ylim()))
        side = 6.4 / max(ratio, 1.0)  # inches
        figure.set_size_inches(side * ratio, side)
    ax.set_position((0.0, 0.0, 1.0, 1.0))


def _pixels(figure: Figure, mode: str) -> Image.Image:
    figure.set_dpi(RESOLUTION)
    if mode == "RGBA":
        for patch in (figure.patch, *(ax.patch for ax in figure.axes)):
            patch.set_alpha(0.0)
    canvas = cast(Any, figure.canvas)  # Agg's, which arrives untyped
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert(mode)


def _durations(count: int, fps: float, hold: float) -> list[int]:
    """Return for how long every frame stays (ms)."""
    durations = [round(1000.0 / fps)] * count
    durations[-1] += round(1000.0 * hold)
    return durations


def _write_gif(shown: Iterator[Image.Image], path: Path, fps: float, hold: float) -> None:
    """Write frames in one palette that covers every colour, however few pixels have it."""
    images = list(shown)  # arrows are small, and would be lost beside a large body
    width, height = images[0].size
    sheet = Image.new("RGB", (width, height * len(images)))
    for number, image in enumerate(images):
        sheet.paste(image, (0, height * number))
    # the 64 most frequent colours as they are: the body's are many pixels
    counted = cast("list[tuple[int, Any]]", sheet.getcolors(sheet.width * sheet.height))
    most = [part for _, colour in sorted(counted, reverse=True)[:64] for part in colour]
    covering = sheet.quantize(192, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette((most + covering)[:768])  # of older Pillow covering has zeros behind
    sheet = sheet.quantize(palette=palette, dither=Image.Dither.NONE)
    tops = range(0, height * len(images), height)
    first, *rest = (sheet.crop((0, top, width, top + height)) for top in tops)
    durations = _durations(len(images), fps, hold)
    first.save(path, "GIF", save_all=True, append_images=rest, duration=durations, loop=0)


def _write_webp(shown: Iterator[Image.Image], path: Path, fps: float, hold: float) -> None:
    first, *rest = shown
    options: dict[str, Any] = {"duration": _durations(1 + len(rest), fps, hold), "loop": 0}
    first.save(path, "WEBP", save_all=True, append_images=rest, lossless=True, **options)


def _write_mp4(shown: Iterator[Image.Image], path: Path, fps: float, hold: float) -> None:
    """Send the frames to ffmpeg; MP4 wants an even number of pixels each way."""
    last = next(shown)
    words = [ffmpeg(path), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    words += ["-s", f"{last.width}x{last.height}", "-r", str(fps), "-i", "-"]
    words += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"]
    words += ["-c:v", "h264", "-f", "mp4", str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stderr=pipe) as program:  # noqa: S603 - our own words
        assert program.stdin is not None
        program.stdin.write(last.tobytes())
        for last in shown:
            program.stdin.write(last.tobytes())
        for _ in range(round(hold * fps)):
            program.stdin.write(last.tobytes())
        _, told = program.communicate()
    if program.returncode:
        raise ResultFileError(f"{path}: ffmpeg cannot write it: {told.decode(errors='replace')}")


def ffmpeg(target: Path) -> str:
    """Return the program that makes MP4: the system's, or the one that a wheel ships."""
    if found := shutil.which("ffmpeg"):
        return found
    with needing(
        f"{target}: MP4 needs the program ffmpeg: pip install 'kaju[film]', or install it "
        "from your system's packages; or write a .gif or .webp"
    ):
        import imageio_ffmpeg
    program: str = imageio_ffmpeg.get_ffmpeg_exe()
    return program


WRITERS = {".gif": _write_gif, ".webp": _write_webp, ".mp4": _write_mp4}
