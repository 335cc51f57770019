"""The verb: run a scene at many points, on many processes, and go on after an interruption."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju import __version__
from kaju.errors import ParameterError, SceneError
from kaju.model.scene import Scene, load_scene

from .crew import Borrowed, Crew, Own, rows_of
from .job import Job, Measure, by_its_kind
from .parts import InFolder, InMemory, folder_of, identity_of
from .points import Method, Points, Vary, plain, points_of

if TYPE_CHECKING:
    import pandas

_TRIED = 8
"""So many points are tried for their scene before anything starts."""


def sweep(
    subject: Scene | str | Path | Callable[..., Any],
    vary: Vary,
    measure: Measure = None,
    *,
    samples: int | None = None,
    method: Method = "grid",
    run: Callable[..., Any] = by_its_kind,
    executor: Executor | None = None,
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
        returns a scene, a network, or the answer itself.
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
    method : {"grid", "list", "sobol", "lhs", "saltelli"} or sequence of mappings
        "grid": every combination of the values. "list": the values go together one by one.
        "sobol", "lhs": samples of the distributions (lists are drawn from evenly). "saltelli":
        samples from which `kaju.model.study.sensitivity` makes Sobol indices. Or the points
        themselves, with an empty `vary`.
    run : callable
        What is done with every subject: a function such as `kaju.solve`, `kaju.stability` or
        ``functools.partial(kaju.creep, times=[1.0])``, or the class of a model, yours or
        kaju's. Unless given, scenes with a prescribed rule are run by `LoadModel`, other scenes
        and networks solved. A function that takes `rng` is given a seed of its own at every
        point.
    executor : concurrent.futures.Executor, optional
        Who computes: also ``client.get_executor()`` of Dask, loky's and mpi4py's. None:
        processes that are started for the sweep and end with it, however it ends.
    workers : int, optional
        How many runs are computed at a time; as many as there are processors unless given.
    out : path, optional
        A folder: rows are kept there as they are finished, in Parquet files. The same call
        again computes only what is missing.
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
        If nobody is left to compute; what was finished is kept in `out`.
    """
    if isinstance(subject, (str, Path)):
        subject = load_scene(subject)
    points = points_of(vary, method, samples, _whole("seed", seed, 0))
    job = Job(subject, run, _checked(measure), seed)
    _try_scenes(job, points)
    crew_size = _whole("workers", workers or _processors(), 1)
    about = _described(job, points, samples)
    with ExitStack() as stack:
        rows: InMemory | InFolder = InMemory()
        if out is not None:
            rows = stack.enter_context(folder_of(Path(out), about))
        missing = rows.missing(len(points))
        if len(missing):
            # Processes are forked before the bar starts a thread of its own.
            crew = stack.enter_context(_crew(executor, job, min(crew_size, len(missing))))
            came = rows_of(crew, points, missing)
            first = next(came)
            rows.add(first)
            done = len(points) - len(missing) + len(first)
            with _bar(len(points), done, progress) as advance:
                for batch in came:
                    rows.add(batch)
                    advance(len(batch))
        table = rows.table()
    table.attrs["sweep"] = about
    return table


def _checked(measure: Measure) -> Measure:
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


def _try_scenes(job: Job, points: Points) -> None:
    """Refuse a sweep of which no point makes a scene: a key is misspelt rather than 2000 runs."""
    if not isinstance(job.subject, Scene):
        return
    first: SceneError | None = None
    for number in np.unique(np.linspace(0, len(points) - 1, _TRIED).astype(int)):
        point = points[int(number)]
        changes = {key: value for key, value in point.items() if not key.startswith("run.")}
        try:
            job.varied(changes, 0)
        except SceneError as error:
            first = first or error
        else:
            return
    assert first is not None
    raise SceneError(f"no point that was tried makes a scene; the first: {first}") from first


def _described(job: Job, points: Points, samples: int | None) -> dict[str, Any]:
    """Return what is asked, and by what it is known again."""
    about = {
        "subject": str(job.subject) if isinstance(job.subject, Scene) else _named(job.subject),
        "run": _named(job.run),
        "measure": _words(job.measure),
        "varied": list(points.columns),
        "method": points.method,
        "samples": samples,
        "points": len(points),
        "seed": job.seed,
    }
    identity = identity_of(_identifying(job, points, about))
    return about | {"kaju_version": __version__, "identity": identity}


def _identifying(job: Job, points: Points, about: dict[str, Any]) -> Iterator[bytes]:
    yield json.dumps(about, default=str).encode()
    if isinstance(job.subject, Scene):
        text, arrays = job.subject.to_archive()
        yield text.encode()
        for name, array in sorted(arrays.items()):
            yield name.encode()
            yield np.ascontiguousarray(array).tobytes()
    for number in range(len(points)):
        yield json.dumps(points[number], default=str).encode()


def _words(measure: Measure) -> list[str] | None:
    if measure is None:
        return None
    if isinstance(measure, str) or callable(measure):
        return [_named(measure)]
    return list(measure)


def _named(what: Any) -> str:
    """Return by which name something is known again in another process."""
    if isinstance(what, str):
        return what
    if isinstance(what, partial):
        options = json.dumps([what.args, what.keywords], default=str, sort_keys=True)
        return f"partial({_named(what.func)}, {options})"
    module = getattr(what, "__module__", "")
    return f"{module}.{getattr(what, '__qualname__', type(what).__qualname__)}"


@contextmanager
def _crew(executor: Executor | None, job: Job, workers: int) -> Iterator[Crew]:
    if executor is not None:
        yield Borrowed(executor, job, workers)
        return
    own = Own(job, workers)
    try:
        yield own
    finally:
        own.close()


@contextmanager
def _bar(total: int, done: int, shown: bool | None) -> Iterator[Callable[[int], None]]:
    """Show how many runs are finished, how many a second, and the time that is left."""
    if not (sys.stderr.isatty() if shown is None else shown):
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    rate = TextColumn("{task.fields[rate]}")
    columns = (TextColumn("sweep"), BarColumn(), MofNCompleteColumn(), rate, TimeLeft())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task("sweep", total=total, completed=done, rate="")

        def advance(count: int) -> None:
            speed = progress.tasks[0].speed
            progress.update(task, advance=count, rate=f"{speed:.3g} runs/s" if speed else "")

        yield advance
