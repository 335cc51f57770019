"""The verb: run a scene at many points, on many processes, and go on after an interruption.

joblib hands the runs out, in batches sized by what runs have taken so far. A run that kills its
process ends the sweep; with a folder, the rows that were finished are kept, and it goes on there.
"""

from __future__ import annotations

import json
import os
import sqlite3
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
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
    Row,
    SweepRun,
    Vary,
    by_its_kind,
    plain,
    points_of,
)

if TYPE_CHECKING:
    import pandas

Points = list[dict[str, Any]]
STORE, TABLE = "sweep.sqlite", "table.parquet"
_TRIED = 8  # points that are tried for their scene before anything starts


def sweep(
    subject: Scene | str | Path | Callable[..., Any],
    vary: Vary,
    measure: Measure = None,
    *,
    samples: int | None = None,
    method: str = "grid",
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
    measure : str, sequence of str or callable, optional
        What goes into the table: figures of the result's summary or attributes
        (``"last.ledger.taken"``, ``"reaction.bottom[1]"``), or a function of the result that
        returns a number, or several by name. None: all single figures of the summary.
    samples : int, optional
        Number of points, for the methods that draw them.
    method : {"grid", "list", "sobol", "lhs"}
        "grid": every combination of the values. "list": first values together, then second
        ones, and so on. "sobol", "lhs": samples of the distributions (lists are drawn from
        evenly).
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
    store = closing(_store_of(folder, _described(runs, points, method)))
    with store as rows, progress_line(progress) as report:
        missing = rows.missing(len(points))
        with closing(_rows_of(runs, points, missing, min(workers, len(missing)))) as came:
            for done, row in enumerate(came, len(points) - len(missing) + 1):
                rows.add(row)
                report(f"{done:,} of {len(points):,} runs")
        table = rows.table()
    if folder is not None and len(missing):
        with atomic_file(folder / TABLE, ResultFileError) as scratch:
            bare = table.copy(deep=False)
            bare.attrs = {}
            bare.to_parquet(scratch, index=False)
    return table


def _checked(measure: Measure) -> Measure:
    """Return a measure; refuse anything else."""
    if measure is None or isinstance(measure, str) or callable(measure):
        return measure
    if isinstance(measure, Sequence) and measure and all(isinstance(m, str) for m in measure):
        return tuple(measure)
    raise ParameterError(
        "measure: must be a name of the summary, a list of names, or a function of the result, "
        f"got {measure!r}"
    )


def _whole(name: str, value: Any, least: int) -> int:
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ParameterError(f"{name}: must be a whole number, {least} or more, got {value!r}")
    return value


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _try_scenes(runs: SweepRun, points: Points) -> None:
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


def _described(runs: SweepRun, points: Points, method: str) -> dict[str, Any]:
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
        "varied": list(points[0]),
        "method": method,
        "points": len(points),
        "seed": runs.seed,
    }
    archive = scene.to_archive() if scene else None
    identity = digest((json.dumps([about, points], default=str), archive))
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
    runs: SweepRun, points: Points, numbers: Ints, workers: int
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


class SweepStore:
    """The rows of one sweep in SQLite, in memory or in a folder.

    Every row is a transaction, so all finished ones are there whenever a sweep is killed.
    """

    def __init__(self, folder: Path | None) -> None:
        self._place: str | Path = ":memory:" if folder is None else folder / STORE
        self._database = sqlite3.connect(self._place, isolation_level=None)
        self.close = self._database.close
        # Appends to a journal: a row costs no wait for the disk, and readers block nothing.
        self._do("PRAGMA journal_mode=WAL")
        self._do("PRAGMA synchronous=NORMAL")

    def begin(self, about: dict[str, Any]) -> None:
        """Make the tables of a new store; leave those that are there."""
        self._do("CREATE TABLE IF NOT EXISTS about (text)")
        self._do("CREATE TABLE IF NOT EXISTS rows (run INTEGER PRIMARY KEY, text)")
        text = json.dumps(about, default=str)
        self._do("INSERT INTO about SELECT ? WHERE NOT EXISTS (SELECT * FROM about)", text)

    def missing(self, count: int) -> Ints:
        """Return the runs, of `count`, that have no row."""
        return np.setdiff1d(np.arange(count), [run for (run,) in self._do("SELECT run FROM rows")])

    def add(self, row: Row) -> None:
        """Keep a row."""
        self._do("INSERT OR IGNORE INTO rows VALUES (?, ?)", row[RUN], json.dumps(row))

    def about(self) -> dict[str, Any]:
        """Return what the sweep is."""
        with self._readable():
            ((text,),) = self._do("SELECT * FROM about")
            return dict(json.loads(text))

    def table(self) -> pandas.DataFrame:
        """Return all rows in the order of their runs, errors last, and what the sweep is."""
        import pandas

        with self._readable():
            texts = self._do("SELECT text FROM rows ORDER BY run")
            rows = [json.loads(text) for (text,) in texts]
            table = pandas.DataFrame.from_records(rows, columns=None if rows else [RUN, ERROR])
            table = table[[*(name for name in table if name != ERROR), ERROR]]
        for name in table:
            if table[name].dtype == object and len({type(v) for v in table[name].dropna()}) > 1:
                table[name] = table[name].map(lambda v: v if v != v else str(v))
        table.attrs["sweep"] = self.about()
        return table

    def _do(self, command: str, *values: Any) -> list[Any]:
        with self._readable():
            return self._database.execute(command, values).fetchall()

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Name the file where it cannot be read."""
        try:
            yield
        except (sqlite3.Error, ValueError, KeyError, TypeError) as error:
            raise ResultFileError(
                f"{self._place}: cannot be read ({error}); delete it, and its runs are computed "
                "again"
            ) from error


def _store_of(out: Path | None, about: dict[str, Any]) -> SweepStore:
    """Return a store for a sweep alone: in memory, or in a folder that is new or its own."""
    if out is not None:
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
    store = SweepStore(out)
    store.begin(about)
    if store.about()["identity"] != about["identity"]:
        store.close()
        raise ResultFileError(
            f"{out}: holds another sweep (other points, scene, seed or measures); "
            "take another folder, or delete this one"
        )
    return store


def load_sweep(folder: str | Path) -> pandas.DataFrame:
    """Return the rows, as `sweep` does, that it has written to `out` so far, ended or not."""
    place = Path(folder)
    if not is_there(place / STORE):
        raise ResultFileError(f"{place}: is not the folder of a sweep: it has no {STORE}")
    with closing(SweepStore(place)) as store:
        return store.table()
