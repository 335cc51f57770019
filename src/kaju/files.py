"""Opening files, and writing them and folders: whole or not at all.

What is being written has a name of its own (``.kaju-…``) beside its target, and takes the target's
name when it is whole. Nothing is ever removed that this process did not make.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kaju.errors import KajuError, suggestion


def file_to_read(
    path: str | Path, error: type[KajuError], *, most: int | None = None, key: str = ""
) -> Path:
    """Return the path of a file that can be read to its end."""
    try:
        about = Path(path).stat()
        reason = "" if stat.S_ISREG(about.st_mode) else "it is a pipe or a device"
        if stat.S_ISDIR(about.st_mode):
            reason = os.strerror(errno.EISDIR)
        elif most is not None and about.st_size > most:
            reason = f"its {about.st_size:,} bytes are more than {most:,}"
    except (OSError, ValueError, TypeError) as wrong:
        reason = getattr(wrong, "strerror", None) or str(wrong)
        if isinstance(wrong, FileNotFoundError):
            alike = Path(path).suffix, ".toml", ".npz"
            names = [x.name for x in Path(path).parent.glob("*") if x.suffix in alike]
            reason += suggestion(Path(path).name, names)
    if reason:
        raise error(f"{key}{': ' if key else ''}{path!s:.300}: cannot be read: {reason}")
    return Path(path)


def text_of_file(
    path: str | Path, error: type[KajuError], most: int, *, key: str = "", hint: str = ""
) -> str:
    """Return the text (UTF-8) in a file, "-" for standard input; `hint`: what to do with others."""
    try:
        with _named_errors(path, error, "read"):
            if str(path) == "-":
                data = sys.stdin.buffer.read(most + 1)
                if len(data) > most:
                    raise error(f"{path}: cannot be read: it has more than {most:,} bytes")
                return data.decode("utf-8-sig")  # without the mark that some editors put first
            return file_to_read(path, error, most=most, key=key).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{key}{': ' if key else ''}{path}: is not a text{hint}") from None


def is_there(path: Path) -> bool:
    """Tell whether there is anything of that name; there is not if the system refuses the name."""
    return os.path.exists(path)  # noqa: PTH110  # Path.exists raises what the system answers


@contextmanager
def atomic_file(target: Path, error: type[KajuError]) -> Iterator[Path]:
    """Yield a file to write to, which takes the target's name only if all goes well.

    If the target is a link, the file that it leads to is replaced.
    """
    with _named_errors(target, error):
        place = Path(os.path.realpath(target))
        scratch = _new_name(place.parent, target.suffix)
        scratch.touch(exist_ok=False)
        try:
            yield scratch
            scratch.replace(place)
        finally:
            scratch.unlink(missing_ok=True)


@contextmanager
def hidden_folder(target: Path, error: type[KajuError]) -> Iterator[Path]:
    """Yield a new folder beside a folder to be; what is in it when the block ends goes."""
    with _named_errors(target, error):
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = _new_name(target.parent)
        scratch.mkdir()
        try:
            yield scratch
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


def check_writable(target: Path, error: type[KajuError]) -> None:
    """Refuse a place where nothing can be written, before anything is computed for it."""
    above = next(folder for folder in target.absolute().parents if is_there(folder))
    with _named_errors(target, error):
        scratch = _new_name(above)
        scratch.touch(exist_ok=False)
        scratch.unlink()


@contextmanager
def _named_errors(
    path: str | Path, error: type[KajuError], done: str = "written"
) -> Iterator[None]:
    """Turn errors of the system into one of kaju's that names the file, and what is not done."""
    try:
        yield
    except OSError as reason:
        if isinstance(reason, KajuError):
            raise
        raise error(f"{path}: cannot be {done}: {reason.strerror or reason}") from reason


def _new_name(folder: Path, suffix: str = "") -> Path:
    return folder / f".kaju-{secrets.token_hex(8)}{suffix}"
