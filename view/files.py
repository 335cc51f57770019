"""Writing pictures: whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kaju.errors import ResultFileError
from kaju.files import scratch_beside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESOLUTION = 150
"""Dots per inch of saved pictures."""


def save(figure: Figure, path: str | Path) -> Path:
    """Write a picture; the ending of the name decides the format.

    Raises
    ------
    ResultFileError
        If the file cannot be written, or its ending is no format of pictures.
    """
    target = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if target.suffix.lstrip(".").lower() not in known:
        raise ResultFileError(
            f"{target}: {target.suffix or 'no ending'!r} is no format of pictures; "
            f"choose .png, .svg or .pdf (there is {', '.join(sorted(known))})"
        )
    with scratch_beside(target, ResultFileError) as scratch:
        figure.savefig(scratch, dpi=RESOLUTION)
    return target
