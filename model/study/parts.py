"""Where the rows of a sweep are kept: in memory, or in a folder of Parquet parts.

A part appears whole or not at all, so the folder holds finished rows at any moment. When all
runs are there, one table takes the parts' place. Rows are told apart by the number of their run:
whatever is found twice, between the two, counts once.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kaju.arrays import Ints
from kaju.errors import MissingExtraError, ResultFileError
from kaju.files import scratch_beside

from .job import ERROR, RUN, Row

try:
    import fcntl
except ImportError:  # on Windows: two sweeps of one folder are not kept apart there
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    import pandas

ABOUT = "sweep.json"
TABLE = "table.parquet"
_PARTS = "part-*.parquet"
_EVERY = 1.0  # s between parts
_PATIENCE = 10.0  # s for the workers of a killed sweep to be gone


class Rows(Protocol):
    """What takes the rows of a sweep as they come."""

    def missing(self, count: int) -> Ints:
        """Return the runs, of `count`, that have no row."""

    def add(self, rows: list[Row]) -> None:
        """Take rows, perhaps none; called at least once a second."""

    def table(self) -> pandas.DataFrame:
        """Return all rows in the order of their runs."""


class InMemory:
    """Rows that nothing but the table will hold."""

    def __init__(self) -> None:
        self._rows: list[Row] = []

    def missing(self, count: int) -> Ints:
        """Return the runs that have no row: all of them."""
        return np.arange(count)

    def add(self, rows: list[Row]) -> None:
        """Keep rows."""
        self._rows += rows

    def table(self) -> pandas.DataFrame:
        """Return all rows in the order of their runs."""
        return _framed(self._rows)


class InFolder:
    """Rows in a folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._rows: list[Row] = []
        self._written = monotonic()

    def missing(self, count: int) -> Ints:
        """Return the runs that have no row in any part."""
        there = np.zeros(count, dtype=bool)
        for part in _parts(self.folder):
            runs = _read(part, [RUN])[RUN].to_numpy()
            there[runs[runs < count]] = True
        return np.flatnonzero(~there)

    def add(self, rows: list[Row]) -> None:
        """Keep rows, and write a part if the last one is a second old."""
        self._rows += rows
        if monotonic() - self._written > _EVERY:
            self.write()

    def write(self) -> None:
        """Write a part of what has not been written."""
        self._written = monotonic()
        if not self._rows:
            return
        last = max((int(part.stem[5:]) for part in self.folder.glob(_PARTS)), default=-1)
        _write(_framed(self._rows), self.folder / f"part-{last + 1:06}.parquet")
        self._rows = []

    def table(self) -> pandas.DataFrame:
        """Let one table take the place of the parts, and return it."""
        self.write()
        table = _joined(self.folder)
        parts = sorted(self.folder.glob(_PARTS))
        if parts:
            _write(table, self.folder / TABLE)
        for part in parts:
            part.unlink()
        return table


def load_sweep(folder: str | Path) -> pandas.DataFrame:
    """Return the rows that a sweep has written so far, whether it has ended or not.

    Parameters
    ----------
    folder : path
        What `out` of the sweep was.

    Returns
    -------
    DataFrame
        As `sweep` returns it.

    Raises
    ------
    ResultFileError
        If there is no sweep, or it cannot be read.
    """
    place = Path(folder)
    table = _joined(place)
    table.attrs["sweep"] = read_about(place)
    return table


def read_about(folder: Path) -> dict[str, Any]:
    """Return what a folder says of its sweep.

    Raises
    ------
    ResultFileError
        If it says nothing that can be understood.
    """
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ResultFileError(f"{folder}: is no folder of a sweep: it has no {ABOUT}") from None
    except (OSError, ValueError) as error:
        raise ResultFileError(f"{folder / ABOUT}: cannot be read: {error}") from error
    if not isinstance(about, dict) or "identity" not in about:
        raise ResultFileError(f"{folder / ABOUT}: does not describe a sweep")
    return about


@contextmanager
def folder_of(out: Path, about: dict[str, Any]) -> Iterator[InFolder]:
    """Yield a folder for the rows of one sweep, which nobody else writes to meanwhile.

    Parameters
    ----------
    out : Path
        A new or empty folder, or the one in which the same sweep was begun.
    about : dict
        What the sweep is; its "identity" tells it from others.

    Raises
    ------
    ResultFileError
        If the folder holds something else, is being written to, or cannot be written.
    """
    _parquet()
    try:
        out.mkdir(parents=True, exist_ok=True)
        with _alone(out):
            _begin(out, about)
            kept = InFolder(out)
            try:
                yield kept
            finally:
                kept.write()
    except OSError as error:
        if isinstance(error, ResultFileError):
            raise
        raise ResultFileError(f"{out}: cannot be written: {error.strerror or error}") from error


def identity_of(parts: Iterable[bytes]) -> str:
    """Return a digest by which a sweep is known again."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


def _begin(out: Path, about: dict[str, Any]) -> None:
    if (out / ABOUT).exists():
        if read_about(out)["identity"] != about["identity"]:
            raise ResultFileError(
                f"{out}: holds another sweep (other points, scene, seed or measures); "
                "take another folder, or delete this one"
            )
        return
    strangers = [path.name for path in out.iterdir() if not path.name.startswith(".kaju-")]
    if strangers:
        raise ResultFileError(f"{out}: is not empty ({strangers[0]}); take another folder")
    with scratch_beside(out / ABOUT, ResultFileError) as scratch:
        scratch.write_text(json.dumps(about, indent=2, default=str) + "\n", encoding="utf-8")


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Hold the lock of a folder, which the system takes away with the process."""
    if fcntl is None:
        yield
        return
    handle = os.open(out, os.O_RDONLY)
    try:
        began = monotonic()
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if monotonic() - began > _PATIENCE:
                    raise ResultFileError(
                        f"{out}: another sweep is writing to this folder; wait for it to end"
                    ) from None
                sleep(0.05)
        yield
    finally:
        os.close(handle)


def _parts(folder: Path) -> list[Path]:
    whole = folder / TABLE
    return [*([whole] if whole.exists() else []), *sorted(folder.glob(_PARTS))]


def _joined(folder: Path) -> pandas.DataFrame:
    import pandas

    frames = [_read(part) for part in _parts(folder)]
    if not frames:
        return _framed([])
    table = pandas.concat(frames, ignore_index=True) if len(frames) > 1 else frames[0]
    return _ordered(table.drop_duplicates(RUN).sort_values(RUN, ignore_index=True))


def _framed(rows: list[Row]) -> pandas.DataFrame:
    import pandas

    columns = [RUN, ERROR] if not rows else None
    table = pandas.DataFrame.from_records(rows, columns=columns)
    return _ordered(table.sort_values(RUN, ignore_index=True))


def _ordered(table: pandas.DataFrame) -> pandas.DataFrame:
    """Return a table with the errors last, and texts in columns of mixed kinds."""
    table = table[[*(name for name in table if name != ERROR), ERROR]]
    mixed = {
        str(name): table[name].map(lambda value: value if value != value else str(value))
        for name in table
        if table[name].dtype == object and _is_mixed(table[name])
    }
    return table.assign(**mixed)


def _is_mixed(column: pandas.Series) -> bool:
    kinds = {type(value) for value in column.dropna()}
    return len(kinds) > 1


def _parquet() -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "a sweep's folder needs pyarrow: pip install 'kaju[sweep]'; "
            "without out= the table is returned all the same"
        ) from error


def _write(table: pandas.DataFrame, path: Path) -> None:
    with scratch_beside(path, ResultFileError) as scratch:
        bare = table.copy(deep=False)
        bare.attrs = {}
        bare.to_parquet(scratch, engine="pyarrow", index=False, write_page_checksum=True)


def _read(path: Path, columns: list[str] | None = None) -> pandas.DataFrame:
    _parquet()
    from pyarrow.parquet import read_table

    try:
        table: pandas.DataFrame = read_table(
            path, columns=columns, page_checksum_verification=True
        ).to_pandas()
        if table[RUN].dtype != np.int64 or not (table[RUN] >= 0).all():
            raise ValueError(f"its {RUN!r} are no whole numbers from 0 on")
        if columns is None and ERROR not in table:
            raise ValueError(f"it has no column {ERROR!r}")
        return table
    except Exception as error:
        raise ResultFileError(
            f"{path}: cannot be read ({error}); delete it, and its runs are computed again"
        ) from error
