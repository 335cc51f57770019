"""The verb: run a scene at many points, on many processes, and go on after an interruption.

joblib hands the runs out, in batches sized by what runs have taken so far. A run that kills its
process ends the sweep; with a folder, the rows that were finished are kept, and it goes on there.
"""

from __future__ import annotations

import json
import os
import sqlite3
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from threading import Thread
from time import sleep
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju import __version__
from kaju.arrays import Ints
from kaju.errors import ParameterError, ResultFileError, SceneError, WorkerError, needing
from kaju.files import atomic_file, is_there
from kaju.model.scene import Scene, load_scene
from kaju.progress import progress_line

from .sweep_runs import (
    ERROR,
    RUN,
    Measure,
    Method,
    Row,
    SweepPoints,
    SweepRun,
    Vary,
    by_its_kind,
    plain,
    points_of,
)

if TYPE_CHECKING:
    import pandas

STORE, TABLE = "sweep.sqlite", "table.parquet"
_TRIED = 8  # points that are tried for their scene before anything starts


def sweep(
    subject: Scene | str | Path | Callable[..., Any],
    vary: Vary,
    measure: Measure = None,
    *,
    samples: int | None = None,
    method: Method = "grid",
    run: Callable[..., Any] = by_its_kind,
    workers: int | None = None,
    out: str | Path | None = None,
    seed: int = 0,
    progress: bool | None = None,
) -> pandas.DataFrame:
    """Run a scene at many points and return a table of what was measured.

    Parameters
    ----------
    subject : Scene, path or callable
        The scene to change; or a function that is called with the point's values by name and
        returns a scene, a network, a model to be run, or the answer itself.
    vary : mapping of str to sequence or distribution
        What is changed: key paths of the scene such as ``"rule.alpha[1]"`` or
        ``"loads[0].force[1]"``, with lists of values or distributions of `scipy.stats`. Keys
        that begin with ``run.`` are options of `run`: ``"run.tolerance"``.
    measure : str, sequence of str, callable or mapping of callables, optional
        What goes into the table: figures of the result's summary or attributes
        (``"last.ledger.taken"``, ``"reaction.bottom[1]"``), or functions of the result that
        return a number, or several by name. None: all single figures of the summary.
    samples : int, optional
        Number of points, for the methods that draw them.
    method : {"grid", "list", "sobol", "lhs"} or sequence of mappings
        "grid": every combination of the values. "list": the values go together one by one.
        "sobol", "lhs": samples of the distributions (lists are drawn from evenly). Or the
        points themselves, with an empty `vary`.
    run : callable
        What is done with every subject: a function such as `kaju.solve`, `kaju.stability` or
        ``functools.partial(kaju.creep, times=[1.0])``, or the class of a model, yours or
        kaju's. Unless given, scenes with a prescribed rule are run by `LoadModel`, other scenes
        and networks solved. A function that takes `rng` is given a seed of its own at every
        point.
    workers : int, optional
        How many runs are computed at a time; as many as there are processors unless given. 1
        computes in this process; inside ``with joblib.parallel_config(backend="dask")`` a
        cluster of Dask computes.
    out : path, optional
        A folder: rows are kept there as they are finished, in a SQLite database, and in the end
        as ``table.parquet``. The same call again computes only what is missing.
    seed : int
        From which all random numbers are made.
    progress : bool, optional
        Show a progress bar; None: on a terminal.

    Returns
    -------
    DataFrame
        One row per point: ``run`` (its number), the varied values, what was measured, and
        ``error``, which is empty unless the run failed. ``attrs["sweep"]`` says what was asked.

    Raises
    ------
    ParameterError
        If points, measures or functions are not what is described above.
    SceneError
        If none of the first points makes a scene.
    ResultFileError
        If the folder holds another sweep, or cannot be written.
    WorkerError
        If a run kills its process; what was finished is kept in `out`.

    Examples
    --------
    >>> import kaju
    >>> table = kaju.sweep(lambda x: x**2, {"x": [1, 2, 3]}, workers=1)
    >>> table["value"].tolist()
    [1, 4, 9]
    """
    if isinstance(subject, (str, Path)):
        subject = load_scene(subject)
    points = points_of(vary, method, samples, _whole("seed", seed, 0))
    runs = SweepRun(subject, run, _checked(measure), seed)
    _try_scenes(runs, points)
    workers = _whole("workers", workers or _processors(), 1)
    folder = Path(out) if out is not None else None
    with store_of(folder, _described(runs, points)) as rows, progress_line(progress) as report:
        missing = rows.missing(len(points))
        with closing(_rows_of(runs, points, missing, min(workers, len(missing)))) as came:
            for done, row in enumerate(came, len(points) - len(missing) + 1):
                rows.add(row)
                report(f"{done:,} of {len(points):,} runs")
        table = rows.table()
    if folder is not None and len(missing):
        write_table(table, folder)
    return table


def _checked(measure: Measure) -> Measure:
    """Return a measure, or refuse what is none."""
    if measure is None or isinstance(measure, str) or callable(measure):
        return measure
    if isinstance(measure, Mapping) and all(map(callable, measure.values())):
        return dict(measure)
    if isinstance(measure, Sequence) and measure and all(isinstance(m, str) for m in measure):
        return tuple(measure)
    raise ParameterError(
        "measure: a name of the summary, a list of them, a function of the result, "
        f"or a mapping of names to functions is needed, got {measure!r}"
    )


def _whole(name: str, value: Any, least: int) -> int:
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ParameterError(f"{name}: must be a whole number, {least} or more, got {value!r}")
    return value


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _try_scenes(runs: SweepRun, points: SweepPoints) -> None:
    """Refuse a sweep of which no point makes a scene: a key is misspelt rather than 2000 runs."""
    if not isinstance(runs.subject, Scene):
        return
    first = None
    for number in np.unique(np.linspace(0, len(points) - 1, _TRIED).astype(int)):
        try:
            runs.subject_at(points[int(number)], 0)
            return
        except SceneError as error:
            first = first or error
    raise SceneError(f"no point that was tried makes a scene; the first: {first}") from first


def _described(runs: SweepRun, points: SweepPoints) -> dict[str, Any]:
    """Return what is asked, and a digest by which the same sweep is recognised."""
    with needing("sweep: joblib hands out its runs, which a browser's Python has not"):
        from joblib import hash as digest

    measure: Any = runs.measure
    if isinstance(measure, str) or callable(measure):
        measure = [_named(measure)]
    scene = runs.subject if isinstance(runs.subject, Scene) else None
    about = {
        "subject": str(scene) if scene else _named(runs.subject),
        "run": _named(runs.run),
        "measure": None if measure is None else list(measure),
        "varied": list(points.columns),
        "method": points.method,
        "points": len(points),
        "seed": runs.seed,
    }
    values = [json.dumps(points[number], default=str) for number in range(len(points))]
    archive = scene.to_archive() if scene else None
    identity = digest((json.dumps(about, default=str), archive, values))
    return about | {"kaju_version": __version__, "identity": identity}


def _named(what: Any) -> str:
    """Return the name by which something is recognised in another process."""
    if isinstance(what, str):
        return what
    if isinstance(what, partial):
        options = json.dumps([what.args, what.keywords], default=str, sort_keys=True)
        return f"partial({_named(what.func)}, {options})"
    module = getattr(what, "__module__", "")
    return f"{module}.{getattr(what, '__qualname__', type(what).__qualname__)}"


def _rows_of(
    runs: SweepRun, points: SweepPoints, numbers: Ints, workers: int
) -> Generator[Row, None, None]:
    """Yield the rows of runs as they are finished."""
    from joblib import Parallel, delayed

    if not len(numbers):
        return
    parallel = Parallel(
        n_jobs=workers,
        return_as="generator_unordered",
        mmap_mode=None,
        # Not with a worker's first run: if this process is killed before it, the worker stays.
        initializer=_end_with,
        initargs=(os.getpid(),),
    )
    try:
        yield from parallel(delayed(runs.row)(int(run), points[int(run)]) for run in numbers)
    except Exception as error:  # not of a run: those are in their rows
        raise WorkerError(
            f"sweep: the workers failed with {type(error).__name__}: {error}; the rows that "
            "were finished are kept in out=, and the same sweep goes on from there"
        ) from error


def _end_with(home: int) -> None:
    """Let a worker end with the process that started it."""

    def watch() -> None:
        while os.getppid() == home:
            sleep(0.2)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


# Where rows are kept: every row is a transaction, so that all finished ones are there whenever a
# sweep is killed; whatever is computed twice counts once.


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
