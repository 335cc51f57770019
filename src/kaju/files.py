"""Opening files, and writing them and folders: whole or not at all, whenever the process ends.

What is being written has a hidden name (``.kaju-…``) beside its target and a lock that the system
releases with the process: so the next writer finds what a dead one left behind, and removes it.
"""

from __future__ import annotations

import ctypes
import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kaju.errors import KajuError

try:
    import fcntl
except ImportError:  # on Windows: there nothing is locked, so nothing is swept
    fcntl = None  # type: ignore[assignment]

HIDDEN = ".kaju-"
_EXCHANGE, _AT_FDCWD = 2, -100  # of Linux and macOS: swap; names count from the working folder


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
    if reason:
        raise error(f"{key}{': ' if key else ''}{path!s:.300}: cannot be read: {reason}")
    return Path(path)


def text_of_file(
    path: str | Path, error: type[KajuError], most: int, *, key: str = "", hint: str = ""
) -> str:
    """Return the text (UTF-8) in a file; `hint` says what to do if it is no text."""
    file = file_to_read(path, error, most=most, key=key)
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise error(f"{key}{': ' if key else ''}{path}: is not a text{hint}") from None
    except OSError as wrong:
        raise error(f"{path}: cannot be read: {wrong.strerror or wrong}") from None


def is_there(path: Path) -> bool:
    """Tell whether there is anything of that name; there is not if the system refuses the name."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


@contextmanager
def atomic_file(target: Path, error: type[KajuError]) -> Iterator[Path]:
    """Yield a file to write to, which takes the target's name only if all goes well."""
    with _named_errors(target, error), _hidden(target.parent, target.suffix) as scratch:
        yield scratch
        _to_disk(scratch)
        scratch.replace(target)
        _to_disk(target.parent)


@contextmanager
def hidden_folder(target: Path, error: type[KajuError]) -> Iterator[Path]:
    """Yield a hidden folder beside a folder to be; it goes when the block ends."""
    with _named_errors(target, error):
        target.parent.mkdir(parents=True, exist_ok=True)
        with _hidden(target.parent, folder=True) as scratch:
            yield scratch


def move_into_place(scratch: Path, target: Path, *, replace: bool) -> None:
    """Give a whole folder its name in one step; with `replace` it then has what stood there."""
    for path in (*scratch.rglob("*"), scratch):
        _to_disk(path)
    if replace:
        _exchange(scratch, target)
    else:
        scratch.rename(target)
    _to_disk(target.parent)


def check_writable(target: Path, error: type[KajuError]) -> None:
    """Refuse a place where nothing can be written, before anything is computed for it."""
    above = next(folder for folder in target.absolute().parents if is_there(folder))
    with _named_errors(target, error), _hidden(above):
        pass


@contextmanager
def _named_errors(target: Path, error: type[KajuError]) -> Iterator[None]:
    """Turn errors of the system into one of kaju's that names the target."""
    try:
        yield
    except OSError as reason:
        if isinstance(reason, KajuError):
            raise
        raise error(f"{target}: cannot be written: {reason.strerror or reason}") from reason


@contextmanager
def _hidden(place: Path, suffix: str = "", *, folder: bool = False) -> Iterator[Path]:
    """Yield a new hidden file or folder, locked until the block ends, and then removed."""
    for left in place.glob(f"{HIDDEN}*") if fcntl else ():
        if (lock := _lock(left)) is not None:  # its writer is no longer alive
            _remove(left)
            os.close(lock)
    lock = None
    while lock is None:  # another writer may sweep it before it is locked
        path = place / f"{HIDDEN}{secrets.token_hex(6)}{suffix}"
        if folder:
            path.mkdir()
        else:
            path.touch(exist_ok=False)
        lock = _lock(path)
    try:
        yield path
    finally:
        _remove(path)
        os.close(lock)


def _lock(path: Path) -> int | None:
    """Return an open lock of a file or folder; None if it is gone or belongs to a live writer."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        if fcntl:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not fcntl or path.stat().st_ino == os.fstat(handle).st_ino:
            return handle
    except OSError:
        pass
    os.close(handle)
    return None


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _to_disk(path: Path) -> None:
    """Wait until a file, or a folder's entries, are on the disk: no name outlives its content."""
    if os.name == "nt" and path.is_dir():
        return  # folders cannot be opened there
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _exchange(one: Path, other: Path) -> None:
    """Let two folders exchange their names, in one step where the system can (Linux, macOS)."""
    names, system = (os.fsencode(one), os.fsencode(other)), None
    if os.name != "nt":
        system = ctypes.CDLL(None)
    for function, arguments in (
        ("renameat2", (_AT_FDCWD, names[0], _AT_FDCWD, names[1], _EXCHANGE)),
        ("renamex_np", (*names, _EXCHANGE)),
    ):
        call = getattr(system, function, None)
        if call is not None and call(*arguments) == 0:
            return
    aside = one.with_name(f"{one.name}-old")
    other.rename(aside)
    one.rename(other)
    aside.rename(one)
