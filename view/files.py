"""Writing pictures: whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from kaju.errors import ResultFileError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESOLUTION = 150
"""Dots per inch of saved pictures."""


@contextmanager
def scratch_beside(target: Path) -> Iterator[Path]:
    """Yield a file to write to, which takes the target's name only if all goes well.

    Raises
    ------
    ResultFileError
        If the file cannot be written.
    """
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".", suffix=target.suffix)
        os.close(handle)
        scratch = Path(name)
        try:
            yield scratch
            # mkstemp keeps its files private; a picture is as readable as any other new file.
            mask = os.umask(0)
            os.umask(mask)
            scratch.chmod(0o666 & ~mask)
            scratch.replace(target)
        finally:
            scratch.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise ResultFileError(f"{target}: cannot be written: {reason}") from error


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
    with scratch_beside(target) as scratch:
        figure.savefig(scratch, dpi=RESOLUTION)
    return target
