"""Films: frames of one figure, and how they are written as GIF, WebP, MP4 or single pictures.

A figure is drawn once, with everything that stays; each frame then only exchanges what moves, so
that frames never jump.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from kaju.errors import needing

RESOLUTION = 100
"""Dots per inch of films."""
TWO_LINES = ["…", "…"]  # kept free for the text of the frames
_BARE = 6.4  # longer side of a film without words (inches)


@dataclass
class Film:
    """Frames of one figure."""

    figure: Figure  # with everything that stays
    last: int  # frames are numbered from 0 to this
    draw: Callable[[int], list[Artist]]  # draws what moves in a frame and returns its artists
    notes: Text  # under the title
    text: Callable[[int], str]  # of the notes in a frame
    _moving: list[Artist] = field(default_factory=list)

    def show(self, frame: int) -> None:
        """Exchange what moves for that of a frame."""
        for artist in self._moving:
            artist.remove()
        self._moving = self.draw(frame)
        self.notes.set_text(self.text(frame))

    def settle(self, *, bare: bool = False) -> None:
        """Arrange the figure around its fullest frame, and keep it so.

        `bare` leaves out axes, words and scales: the body fills the frame.
        """
        self.figure.set_dpi(RESOLUTION)
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
            ratio = float(np.ptp(ax.get_xlim()) / np.ptp(ax.get_ylim()))
            side = _BARE / max(ratio, 1.0)
            self.figure.set_size_inches(side * ratio, side)
        ax.set_position((0.0, 0.0, 1.0, 1.0))

    def image(self, frame: int, mode: str = "RGB") -> Image.Image:
        """Return a frame as pixels."""
        self.show(frame)
        canvas = cast(Any, self.figure.canvas)  # Agg's, which arrives untyped
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert(mode)


def _durations(frames: list[int], fps: float, hold: float) -> list[int]:
    """Return for how long every frame stays (ms)."""
    durations = [round(1000.0 / fps)] * len(frames)
    durations[-1] += round(1000.0 * hold)
    return durations


def _write_gif(film: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    # One palette for all frames, or colours would flicker: that of a few of them, side by side.
    some = {k: film.image(k) for k in (frames[0], frames[len(frames) // 2], frames[-1])}
    strip = Image.fromarray(np.concatenate([np.asarray(image) for image in some.values()]))
    palette = strip.quantize(255, kmeans=3)
    colours = [*(palette.getpalette() or [])[:765], 255, 255, 255]
    palette.putpalette(colours)
    first, *rest = (_indexed(some.get(k) or film.image(k), palette) for k in frames)
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


def _write_webp(film: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    first, *rest = (film.image(frame) for frame in frames)
    durations = _durations(frames, fps, hold)
    options: dict[str, Any] = {"duration": durations, "loop": 0, "lossless": True}
    first.save(path, "WEBP", save_all=True, append_images=rest, **options)


def _write_mp4(film: Film, frames: list[int], path: Path, fps: float, hold: float) -> None:
    with rc_context({"animation.ffmpeg_path": ffmpeg(path)}):
        writer = FFMpegWriter(fps=cast(int, fps))
        with writer.saving(film.figure, str(path), RESOLUTION):
            for frame in frames:
                film.show(frame)
                writer.grab_frame()
            for _ in range(round(hold * fps)):
                writer.grab_frame()


def ffmpeg(target: Path) -> str:
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


def write_frames(film: Film, frames: list[int], folder: Path) -> None:
    """Write one picture a frame, without background (PNG with alpha)."""
    film.figure.patch.set_alpha(0.0)
    for axes in film.figure.axes:
        axes.patch.set_alpha(0.0)
    for number, frame in enumerate(frames):
        film.image(frame, "RGBA").save(folder / f"{number:04d}.png")


WRITERS = {".gif": _write_gif, ".webp": _write_webp, ".mp4": _write_mp4}
