"""Writing pictures: whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from matplotlib.figure import Figure

from kaju.errors import ResultFileError
from kaju.files import atomic_file, hidden_folder, move_into_place

RESOLUTION = 150
"""Dots per inch of saved pictures."""


def save(figure: Figure, path: str | Path) -> Path:
    """Write a picture; the ending of the name decides the format."""
    target = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if target.suffix.lstrip(".").lower() not in known:
        raise ResultFileError(
            f"{target}: {target.suffix or 'no ending'!r} is no format of pictures; "
            f"choose .png, .svg or .pdf (there is {', '.join(sorted(known))})"
        )
    with atomic_file(target, ResultFileError) as scratch:
        figure.savefig(scratch, dpi=RESOLUTION)
    return target


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """Yield a folder to fill, which takes the target's name only if all goes well."""
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise ResultFileError(f"{target}: is there already; take another name, or remove it")
    with hidden_folder(target, ResultFileError) as scratch:
        yield scratch
        move_into_place(scratch, target)
