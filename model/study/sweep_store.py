"""Where the rows of a sweep are kept: a SQLite database, in memory or in a folder.

Every row is a transaction, so the database holds all finished rows whenever a sweep is killed.
A run has one row: whatever is computed twice counts once.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.arrays import Ints
from kaju.errors import ResultFileError, needing
from kaju.files import atomic_file, is_there

from .sweep_runs import ERROR, RUN, Row

if TYPE_CHECKING:
    import pandas

STORE, TABLE = "sweep.sqlite", "table.parquet"


class SweepStore:
    """The rows of one sweep."""

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database

    def begin(self, about: dict[str, Any]) -> None:
        """Make the tables of a new store; leave those that are there."""
        with self._database:  # one transaction
            self._database.execute("BEGIN IMMEDIATE")
            if not self._database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                self._database.execute("CREATE TABLE about (text)")
                self._database.execute("CREATE TABLE rows (run INTEGER PRIMARY KEY, text)")
                text = json.dumps(about, default=str)
                self._database.execute("INSERT INTO about VALUES (?)", (text,))

    def missing(self, count: int) -> Ints:
        """Return the runs, of `count`, that have no row."""
        there = [run for (run,) in self._database.execute("SELECT run FROM rows")]
        return np.setdiff1d(np.arange(count), there)

    def add(self, row: Row) -> None:
        """Keep a row."""
        values = row[RUN], json.dumps(row)
        self._database.execute("INSERT OR IGNORE INTO rows VALUES (?, ?)", values)

    def about(self) -> dict[str, Any]:
        """Return what the sweep is."""
        ((text,),) = self._database.execute("SELECT * FROM about")
        about: dict[str, Any] = json.loads(text)
        return about

    def table(self) -> pandas.DataFrame:
        """Return all rows in the order of their runs, errors last, and what the sweep is."""
        import pandas

        texts = self._database.execute("SELECT text FROM rows ORDER BY run")
        rows = [json.loads(text) for (text,) in texts]
        table = pandas.DataFrame.from_records(rows, columns=None if rows else [RUN, ERROR])
        table = table[[*(name for name in table if name != ERROR), ERROR]]
        for name in table:
            if table[name].dtype == object and len({type(v) for v in table[name].dropna()}) > 1:
                table[name] = table[name].map(lambda v: v if v != v else str(v))
        table.attrs["sweep"] = self.about()
        return table


@contextmanager
def store_of(out: Path | None, about: dict[str, Any]) -> Iterator[SweepStore]:
    """Yield a store for a sweep alone: in memory, or in a folder that is new or its own."""
    if out is None:
        with closing(sqlite3.connect(":memory:", isolation_level=None)) as database:
            store = SweepStore(database)
            store.begin(about)
            yield store
        return
    with needing(
        "a sweep's folder needs pyarrow: pip install 'kaju[sweep]'; "
        "without out= the table is returned all the same"
    ):
        import pyarrow  # noqa: F401
    try:
        out.mkdir(parents=True, exist_ok=True)
        strangers = [path.name for path in out.iterdir()]
    except OSError as error:
        raise ResultFileError(f"{out}: cannot be written: {error.strerror}") from error
    if strangers and STORE not in strangers:
        raise ResultFileError(f"{out}: is not empty ({strangers[0]}); take another folder")
    with _opened(out) as store:
        with _reading(out):
            store.begin(about)
            identity = store.about()["identity"]
        if identity != about["identity"]:
            raise ResultFileError(
                f"{out}: holds another sweep (other points, scene, seed or measures); "
                "take another folder, or delete this one"
            )
        yield store


def write_table(table: pandas.DataFrame, out: Path) -> None:
    """Write the table of a finished sweep beside its store, for everybody to read."""
    with atomic_file(out / TABLE, ResultFileError) as scratch:
        bare = table.copy(deep=False)
        bare.attrs = {}
        bare.to_parquet(scratch, index=False)


def load_sweep(folder: str | Path) -> pandas.DataFrame:
    """Return the rows, as `sweep` does, that it has written to `out` so far, ended or not."""
    place = Path(folder)
    if not is_there(place / STORE):
        raise ResultFileError(f"{place}: is no folder of a sweep: it has no {STORE}")
    with _opened(place) as store, _reading(place):
        return store.table()


@contextmanager
def _opened(folder: Path) -> Iterator[SweepStore]:
    with closing(sqlite3.connect(folder / STORE, isolation_level=None)) as database:
        with _reading(folder):
            # Appends to a journal: a row costs no wait for the disk, and readers block nothing.
            database.execute("PRAGMA journal_mode=WAL")
            database.execute("PRAGMA synchronous=NORMAL")
        yield SweepStore(database)


@contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """Name the file where it cannot be read."""
    try:
        yield
    except (sqlite3.Error, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(
            f"{folder / STORE}: cannot be read ({error}); delete it, and its runs are computed "
            "again"
        ) from error
