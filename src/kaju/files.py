"""Writing files: whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kaju.errors import KajuError


@contextmanager
def scratch_beside(target: Path, error: type[KajuError]) -> Iterator[Path]:
    """Yield a file to write to, which takes the target's name only if all goes well.

    Parameters
    ----------
    target : Path
        The file to be.
    error : type of KajuError
        What to raise if it cannot be written.
    """
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".", suffix=target.suffix)
        os.close(handle)
        scratch = Path(name)
        try:
            yield scratch
            # mkstemp keeps its files private; the target is as readable as any other new file.
            mask = os.umask(0)
            os.umask(mask)
            scratch.chmod(0o666 & ~mask)
            scratch.replace(target)
        finally:
            scratch.unlink(missing_ok=True)
    except OSError as reason:
        text = reason.strerror or reason
        raise error(f"{target}: cannot be written: {text}") from reason
