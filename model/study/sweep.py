"""The verb: run a scene at many points, on many processes, and go on after an interruption.

A point becomes a scene, that a result, that a row. Grids take every combination of the values
given. The other methods draw points of the unit cube and read them through the distributions: Latin
hypercubes (McKay, Beckman & Conover 1979) and scrambled Sobol sequences (Owen 1998).

joblib hands the runs out, in batches sized by what runs have taken so far. A run that kills its
process ends the sweep; with a folder, the rows that were finished are kept, and it goes on there.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, is_dataclass
from functools import partial
from inspect import signature
from itertools import product
from pathlib import Path
from threading import Thread
from time import sleep
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np

from kaju import __version__, errors
from kaju.arrays import Ints
from kaju.errors import ParameterError, ResultFileError, WorkerError, by_name, needing, require
from kaju.files import atomic_file, is_there
from kaju.model.network import SpringNetwork
from kaju.model.network import solve as solve_network
from kaju.model.own_code import own_code, without_addresses
from kaju.model.scene import Scene, load_scene
from kaju.model.scene.validation import key_path, plain
from kaju.model.transfer.load_model import LoadModel
from kaju.stepping import progress_line, without_progress

from .solving import solve

if TYPE_CHECKING:
    import pandas

Row = dict[str, Any]
Measure = str | Callable[[Any], Any] | Sequence[str] | None

Vary = Mapping[str, Any]
Points = list[dict[str, Any]]
METHODS = ("grid", "list", "sobol", "lhs")
STORE = "sweep.sqlite"


def by_its_kind(subject: Any, rng: int | None = None) -> Any:
    """Run models and prescribed scenes, solve other scenes and networks; all else is an answer."""
    if isinstance(subject, Scene):
        if subject.rule.kind == "prescribed" and not subject.outlined:
            return LoadModel(subject, rng=rng).run()
        return solve(subject)
    return solve_network(subject) if isinstance(subject, SpringNetwork) else subject


@by_name
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
        Lists of values or distributions of `scipy.stats` by key path of the scene, such as
        ``"loads.0.force.1"``. Keys that begin with ``run.`` are options of `run`.
    measure : str, sequence of str or callable, optional
        Figures of the result's summary or attributes (``"last.ledger.taken"``,
        ``"reaction.bottom.1"``), or a function of the result that returns a number, or several by
        name. None: all figures of the summary, those of lists and tables by such names.
    samples : int, optional
        Number of points, for the methods that draw them.
    method : {"grid", "list", "sobol", "lhs"}
        "grid": every combination. "list": first values together, then second ones, and so on.
        "sobol", "lhs": samples of the distributions (lists are drawn from evenly).
    run : callable
        What is done with every subject: a function such as `kaju.solve`, or the class of a model,
        yours or kaju's. Unless given, scenes with a prescribed rule are run by `LoadModel`, other
        scenes and networks solved. One that takes `rng` is given a seed of its own at every point.
    workers : int, optional
        Runs at a time; as many as there are processors unless given. 1 computes in this process;
        inside ``with joblib.parallel_config(backend="dask")`` a cluster of Dask computes.
    out : path, optional
        A folder: rows are kept there as they are finished (SQLite), and in the end as
        ``table.csv``. The same call again computes only what is missing; it is refused if code of
        your own that makes the rows has changed.
    seed : int
        From which all random numbers are made.
    progress : bool, optional
        Show a progress bar; None: on a terminal.

    Returns
    -------
    DataFrame
        One row per point: ``run`` (its number), the varied values, ``outcome`` (how the run of a
        model ended, in words), what was measured, and ``error``, which is empty unless the run
        failed. ``attrs["sweep"]`` says what was asked.

    Warns
    -----
    UserWarning
        If runs were stopped, or ended with a ledger that does not balance.

    Raises
    ------
    ParameterError, SceneError
        If points, measures or functions are not as above or fit no point, or all runs fail alike.
    ResultFileError
        If the folder holds another sweep, or rows of other code, or cannot be written.
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
    for name, given in {"subject": subject, "run": run}.items():
        told = f"{name}: must be a function or the class of a model, got {errors.brief(given)}"
        require(callable(given) or isinstance(given, Scene), told)
    points = points_of(vary, method, samples, _whole("seed", seed, 0))
    options = [key for key in points[0] if key.startswith("run.") and key != "run.rng"]
    cure = "as functools.partial(kaju.LoadModel, material_agent=Mine), or kaju.solve (--run solve)"
    told = f"{''.join(options[:1])}: is an option of run=; give one that takes it, {cure}"
    require(run is not by_its_kind or not options, told)
    runs = SweepRun(subject, run, _checked(measure), seed)
    with needing("sweep: joblib hands out its runs, which a browser's Python has not"):
        import joblib
    workers = _whole("workers", workers or joblib.cpu_count(), 1)
    folder = Path(out) if out is not None else None
    store = closing(_store_of(folder, _described(runs, points, method)))
    with store as rows, progress_line(progress) as report:
        missing = rows.missing(len(points))
        with closing(_rows_of(runs, points, missing, min(workers, len(missing)))) as came:
            for done, row in enumerate(came, len(points) - len(missing) + 1):
                rows.add(row)
                report(f"{done:,} of {len(points):,} runs")
        table = rows.table()
        kinds = {told.partition(":")[0] for told in table["error"]}
        if len(kinds) == 1 and "" not in kinds:
            rows.forget()
            own = '; numbers of `run`, and of agents of your own, are called such as "run.wear"'
            told = f"{table['error'].iloc[0]}{own if kinds == {'SceneError'} else ''}"
            told = told.removeprefix("ParameterError: ")
            raise ParameterError(f"every run failed, the first with {told}")
        ends = table.get("outcome", table["error"][:0]).astype(str)
        odd = ends[ends.str.contains("stopped|does not balance")]
        if len(odd):
            told = f"sweep: {len(odd)} of {len(table)} runs did not end at rest (column 'outcome')"
            warn(f"{told}, the first {odd.iloc[0]}", stacklevel=3)
    if folder is not None and len(missing):
        with atomic_file(folder / "table.csv", ResultFileError) as scratch:
            table.to_csv(scratch, index=False)
    return table


def _checked(measure: Measure) -> Measure:
    """Return a measure; refuse anything else."""
    if measure is None or isinstance(measure, str) or callable(measure):
        return measure
    if isinstance(measure, Sequence) and measure and all(isinstance(m, str) for m in measure):
        return tuple(measure)
    told = "measure: must be a name of the summary, a list of names, or a function of the result"
    raise ParameterError(f"{told}, got {measure!r}")


def _whole(name: str, value: Any, least: int) -> int:
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise ParameterError(f"{name}: must be a whole number, {least} or more, got {value!r}")
    return value


def _described(runs: SweepRun, points: Points, method: str) -> dict[str, Any]:
    """Return what is asked, and a digest by which the same sweep is recognised."""
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
    identity = digest((without_addresses(json.dumps([about, points], default=str)), archive))
    chosen = [value for point in points for value in point.values() if not _is_figure(value)]
    code = own_code([runs.subject, runs.run, runs.measure, chosen])
    return about | {"kaju_version": __version__, "identity": identity, "code": code}


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
        self._do("INSERT OR IGNORE INTO rows VALUES (?, ?)", row["run"], json.dumps(row))

    def forget(self) -> None:
        """Give the folder free: nothing in it is worth keeping."""
        self._do("DELETE FROM rows")
        self._do("DELETE FROM about")

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
            table = pandas.DataFrame.from_records(rows, columns=None if rows else ["run", "error"])
            table = table[[*(name for name in table if name != "error"), "error"]]
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
        try:
            out.mkdir(parents=True, exist_ok=True)
            strangers = [path.name for path in out.iterdir()]
        except OSError as error:
            raise ResultFileError(f"{out}: cannot be written: {error.strerror}") from error
        if strangers and STORE not in strangers:
            raise ResultFileError(f"{out}: is not empty ({strangers[0]}); take another folder")
    store = SweepStore(out)
    store.begin(about)
    before = store.about()
    now = about["code"].items()
    changed = ", ".join(sorted(dict(before["code"].items() ^ now)))
    told = f"its rows were computed by other code ({changed} changed since)" if changed else ""
    if before["identity"] != about["identity"]:
        told = "holds another sweep (other points, scene, seed or measures)"
    if told:
        store.close()
        raise ResultFileError(f"{out}: {told}; take another folder, or delete this one")
    return store


def load_sweep(folder: str | Path) -> pandas.DataFrame:
    """Return the rows, as `sweep` does, that it has written to `out` so far, ended or not."""
    place = Path(folder)
    if not is_there(place / STORE):
        raise ResultFileError(f"{place}: is not the folder of a sweep: it has no {STORE}")
    with closing(SweepStore(place)) as store:
        return store.table()


# What is done at every point.


@dataclass(frozen=True)
class SweepRun:
    """What is done at every point."""

    subject: Scene | Callable[..., Any]  # changed by the point's keys, or called with them by name
    run: Callable[..., Any]  # takes the subject, and the keys that begin with "run." as options
    measure: Measure  # what of the result goes into the row
    seed: int  # from which the runs' own seeds are made

    def row(self, number: int, point: Mapping[str, Any]) -> Row:
        """Return the row of one point; one that fails has its error in it."""
        # In a cell of a table lists and tables are text; classes and functions have names.
        text = partial(json.dumps, default=lambda one: getattr(one, "__name__", str(one)))
        cells = {k: v if _is_figure(v) else text(v).strip('"') for k, v in point.items()}
        row = {"run": number, **cells}
        try:
            figures = self.figures(number, point)
            taken = ", ".join(figures.keys() & {"error", *row})
            told = f"measure: {taken!r} is another column's name; return it by a new one"
            require(not taken, told)
        except Exception as error:  # whatever a run dies of belongs into its row
            notes = getattr(error, "__notes__", ())  # of an agent of your own: where, and when
            return row | {"error": "; ".join([f"{type(error).__name__}: {error}", *notes])}
        return row | figures | {"error": ""}

    def figures(self, number: int, point: Mapping[str, Any]) -> Row:
        """Return what is measured at one point, with a seed independent of all others'."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(number,))
        seed = int(sequence.generate_state(1)[0])
        options = {k.removeprefix("run."): v for k, v in point.items() if k.startswith("run.")}
        changes = {key: value for key, value in point.items() if not key.startswith("run.")}
        with without_progress():
            subject = (
                self.subject.with_overrides(changes)
                if isinstance(self.subject, Scene)
                else _called(self.subject, (), changes, seed)
            )
            result = _called(self.run, (subject,), options, seed)
            if hasattr(result, "step") and hasattr(result, "run"):
                result = result.run()  # a model's class, or a part of its call, makes a model
        measured, ended = _measured(result, self.measure), getattr(result, "outcome", None)
        return {"outcome": ended} | measured if isinstance(ended, str) else measured


def _called(
    function: Callable[..., Any], arguments: tuple[Any, ...], options: Mapping[str, Any], seed: int
) -> Any:
    takes = signature(function).parameters
    seeded = "rng" not in takes or not {"rng", "seed"}.isdisjoint(options)
    chance = {} if seeded else {"rng": seed}
    return function(*arguments, **options, **chance)


def _measured(result: Any, measure: Measure) -> Row:
    """Return what the measure takes of a result, by column."""
    if measure is None:
        return _everything(result)
    if isinstance(measure, str):
        measure = (measure,)
    if callable(measure):
        value = measure(result)
        name = getattr(measure, "__name__", "measure").replace("<lambda>", "measure")
        require(value is not None, f"measure: {name} returned None; let it return a number")
        found: Mapping[str, Any] = value if isinstance(value, Mapping) else {name: value}
    else:
        table = _table(result)
        found = {name: _found(result, table, name) for name in measure}
    return {str(name): _figure(str(name), value) for name, value in found.items()}


def _table(result: Any) -> Mapping[str, Any]:
    if isinstance(result, Mapping):
        return result
    if callable(getattr(result, "summary", None)):
        return dict(result.summary())
    return vars(result) if is_dataclass(result) else {}


def _everything(result: Any) -> Row:
    """Return all figures of a result that are the same at every repetition."""
    if _is_figure(plain(result)):
        return {"value": plain(result)}
    others = ("seconds", "kaju_version", "notes")  # times say nothing about the point
    table = _table(result).items()
    figures = dict(each for key, value in table if key not in others for each in _flat(key, value))
    told = f"measure: {type(result).__name__} has no figures of its own"
    require(bool(figures), f"{told}; say what to measure by a function of it")
    return figures


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the figures of a value by names such as ``reaction.bottom.1``."""
    value = plain(value)
    if _is_figure(value):
        yield name, value
    elif isinstance(value, (Mapping, Sequence)):
        parts = value.items() if isinstance(value, Mapping) else enumerate(value)
        for part, inner in parts:
            yield from _flat(f"{name}.{part}", inner)


def _found(result: Any, table: Mapping[str, Any], name: str) -> Any:
    """Return ``reaction.bottom.1`` of a summary, or ``last.ledger.taken`` of the result."""
    first, homes = key_path(name).split(".")[0], (table, getattr(result, "states", None))
    found: Any = next((h for h in homes if isinstance(h, Mapping) and first in h), result)
    for key in key_path(name).split("."):
        try:
            if isinstance(found, Mapping):
                found = found[key]
            else:
                found = found[int(key)] if key.isdecimal() else getattr(found, key)
        except (KeyError, IndexError, TypeError, AttributeError):
            known = [part for key, value in table.items() for part, _ in _flat(key, value)]
            near = errors.suggestion(name, known)
            told = f"measure: the result has no {name!r}{near}; its summary has {', '.join(known)}"
            raise ParameterError(told) from None
    return found


def _is_figure(value: Any) -> bool:
    return value is None or isinstance(value, (bool, int, float, str))


def _figure(name: str, value: Any) -> Any:
    value = plain(value)
    if value is None:
        return math.nan
    told = f"measure: {name!r} must be one number, text or truth value, got {type(value).__name__}"
    cure = "of many values take one number, such as their sum"
    if hasattr(value, "meaning"):  # the course of a State
        cure += f', by lambda result: result.states["{value.name}"].values().sum()'
    require(_is_figure(value), f"{told}; {cure}")
    return value


# Which points are run.


def points_of(vary: Vary, method: str, samples: int | None, seed: int) -> Points:
    """Return the points that `sweep` is asked for."""
    told = f"method: {errors.no_such(f'method {method!r}', method, METHODS)}"
    require(method in METHODS, told)
    if not isinstance(vary, Mapping) or not vary:
        raise ParameterError("vary: at least one quantity is needed, as {'rule.threshold': [...]}")
    if method in METHODS[2:]:
        columns = _sampled(vary, method, samples, seed)
    else:
        told = f"samples: a {method} has as many points as its values make; leave samples away"
        require(samples is None, told)
        columns = [_values(key, given) for key, given in vary.items()]
    lengths = dict(zip(vary, map(len, columns), strict=True))
    told = f"vary: the values of a list go together one by one; got {lengths} of them"
    require(method != "list" or len({*lengths.values()}) == 1, told)
    told = f"vary: {math.prod(lengths.values()):,} combinations are more than 1,000,000; take fewer"
    told += " values, or draw samples (method='sobol', samples=1024)"
    require(method != "grid" or math.prod(lengths.values()) <= 1_000_000, told)
    rows = product(*columns) if method == "grid" else zip(*columns, strict=True)
    return [dict(zip(vary, plain(row, math.inf), strict=True)) for row in rows]


def _values(key: str, given: Any) -> Sequence[Any]:
    told = f"vary: {key!r} is a distribution, of which a grid or list cannot be made"
    require(not hasattr(given, "ppf"), f"{told}; take method='sobol' or 'lhs', with samples=")
    if isinstance(given, str | bytes) or not isinstance(given, Sequence | np.ndarray):
        told = f"vary: {key!r} needs a list of values or a scipy.stats distribution, got {given!r}"
        raise ParameterError(told)
    require(len(given) > 0, f"vary: {key!r} has no values")
    return list(given)


def _sampled(vary: Vary, method: str, samples: int | None, seed: int) -> list[Sequence[Any]]:
    if samples is None or isinstance(samples, bool) or int(samples) != samples or samples < 1:
        told = f"samples: {method} needs the number of points, 1 or more; got {samples!r}"
        raise ParameterError(told)
    below = 1 << (int(samples).bit_length() - 1)
    told = f"samples: Sobol points are balanced only in powers of two; take {below} or {2 * below}"
    told += f" instead of {samples}, or method='lhs'"
    require(method == "lhs" or samples == below, told)
    from scipy.stats import qmc

    engine = qmc.Sobol if method == "sobol" else qmc.LatinHypercube
    unit = engine(len(vary), seed=seed).random(samples)
    unit = np.clip(np.asarray(unit, dtype=np.float64), 0.0, np.nextafter(1.0, 0.0))
    columns: list[Sequence[Any]] = []
    for (key, given), column in zip(vary.items(), unit.T, strict=True):
        if hasattr(given, "ppf"):
            columns.append(given.ppf(column))
            told = f"vary: the distribution of {key!r} gave infinite values"
            require(bool(np.isfinite(columns[-1]).all()), told)
        else:
            values = _values(key, given)
            columns.append([values[int(place)] for place in column * len(values)])
    return columns
