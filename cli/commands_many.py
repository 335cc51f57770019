"""The verbs that run many scenes: `sweep` varies one, `stress` makes thousands up."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju import __version__
from kaju.errors import ParameterError, ResultFileError

from .options import SceneFile, folder

if TYPE_CHECKING:
    import pandas


def sweep(
    scene: SceneFile,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=VALUES",
            help="What is varied, may be repeated: values (rule.threshold=0.01,0.02), or a range "
            "to draw from (rule.beta=0:1 or 0..1, and rule.threshold=1e-4:1e-1:log).",
        ),
    ],
    out: Annotated[Path | None, folder("Folder for the table.")] = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A figure of the summary; all unless given."),
    ] = None,
    run: Annotated[
        str, typer.Option(help="auto (as the scene's rule says), agents, solve or stability.")
    ] = "auto",
    method: Annotated[str, typer.Option(help="grid, list, sobol or lhs.")] = "grid",
    samples: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="How many points to draw.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes; all processors unless given.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all random numbers.")] = 0,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw them.")] = True,
) -> None:
    """Run a scene at many points. The same command again goes on where it was interrupted."""
    from kaju.model.study.sweep import sweep as run_all

    target = out or Path(f"{scene.stem}-sweep")
    try:
        table = run_all(
            scene,
            dict(map(_varied, vary)),
            measure or None,
            samples=samples,
            method=method,
            run=_verb(run),
            workers=workers,
            out=target,
            seed=seed,
        )
    except KeyboardInterrupt:
        typer.echo("interrupted: what was computed is kept; the same command goes on", err=True)
        raise typer.Exit(130) from None
    failed = table[table["error"] != ""]
    typer.echo(f"{len(table)} runs, {len(failed)} failed")
    typer.echo(table.head(20).to_string(index=False, max_colwidth=60))
    if len(table) > 20:
        typer.echo(f"... and {len(table) - 20} more")
    if len(failed):
        typer.echo(f"run {failed['run'].iloc[0]} failed: {failed['error'].iloc[0]}")
    typer.echo(target / "table.parquet")
    for picture in _draw(table, target, measure) if pictures else ():
        typer.echo(picture)
    if len(failed) == len(table):
        raise typer.Exit(1)


def _verb(name: str) -> Any:
    from kaju.model.study.sweep_job import by_its_kind

    if name == "auto":
        return by_its_kind
    import kaju

    verbs = {"agents": "LoadModel", "solve": "solve", "stability": "stability"}
    if name not in verbs:
        raise ParameterError(f"--run: auto, {', '.join(verbs)}, got {name!r}")
    return getattr(kaju, verbs[name])


def _varied(text: str) -> tuple[str, Any]:
    """Return a key, and the values or the distribution that it takes."""
    key, equals, values = text.partition("=")
    if not (key.strip() and equals and values.strip()):
        raise ParameterError(f"--vary: KEY=VALUE,VALUE or KEY=LOW:HIGH is needed, got {text!r}")
    return key.strip(), _distribution(values) or _listed(values)


def _distribution(text: str) -> Any:
    """Return the distribution meant by ``0:1`` or ``1e-4:1e-1:log``; None for anything else."""
    from scipy.stats import loguniform, uniform

    low, _, rest = text.replace("..", ":").partition(":")
    high, _, log = rest.partition(":")
    try:
        ends = float(low), float(high)
    except ValueError:
        return None
    if not ends[0] < ends[1] or log not in ("", "log") or (log and ends[0] <= 0.0):
        raise ParameterError(
            f"--vary: a range is LOW:HIGH with LOW below HIGH, or LOW:HIGH:log above 0, "
            f"got {text!r}"
        )
    return loguniform(*ends) if log else uniform(ends[0], ends[1] - ends[0])


def _listed(text: str) -> list[Any]:
    """Return values as TOML reads them; those that it does not understand stay texts."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except tomllib.TOMLDecodeError:
        return [part.strip() for part in text.split(",") if part.strip()]


def _draw(table: pandas.DataFrame, target: Path, measure: list[str] | None) -> list[Path]:
    """Draw the first measure that varies."""
    from kaju.view.picture_files import save
    from kaju.view.sweep_plots import plot_effects, plot_sweep_map

    about = table.attrs["sweep"]
    good = table[table["error"] == ""]
    columns = measure or [
        str(name) for name in table if name not in ("run", "error", *about["varied"])
    ]
    numbers = [name for name in columns if name in good and good[name].dtype.kind in "iuf"]
    shown = next((name for name in numbers if good[name].nunique() > 1), None)
    if shown is None:
        return []
    written = [save(plot_effects(table, shown), target / "effects.png")]
    if len(about["varied"]) > 1:
        written.append(save(plot_sweep_map(table, shown), target / "map.png"))
    return written


QUICK, ALL = 300, 10_000


def stress(
    out: Annotated[Path, folder("Folder for tables and pictures.")] = Path("stress"),
    quick: Annotated[bool, typer.Option("--quick", help=f"{QUICK} trials only.")] = False,
    count: Annotated[
        int | None, typer.Option(min=1, metavar="N", help=f"How many trials; all are {ALL}.")
    ] = None,
    first: Annotated[int, typer.Option(min=0, metavar="N", help="Number of the first.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes side by side.")] = 2,
    limit: Annotated[
        float, typer.Option(help="Seconds of processor time that a trial may take.")
    ] = 60.0,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures")] = True,
) -> None:
    """Put random and adversarial scenes to every rule and solver; exit code 1 if one fails.

    Every case that has ever failed runs first. A trial is answered, refused by a named error, or
    has failed: no number, out of processor time, a raw error, forces that do not balance, a
    certificate that did not hold. Exit code 3: none failed, but some did not finish on a machine
    that is too busy. The same number is the same trial on every machine: --first N --count 1
    repeats one.
    """
    from kaju.model.study.trials.trial import CORPUS, FAILED, UNFINISHED
    from kaju.model.study.trials.trial_workers import bounded, record, tally, trials

    try:
        out.mkdir(parents=True, exist_ok=True)
        table = out / "stress.csv"
        table.touch()
    except OSError as error:
        raise ResultFileError(f"{out}: cannot be written: {error.strerror}") from error
    began, outcomes = perf_counter(), []
    chosen = range(first, first + (count or (QUICK if quick else ALL)))
    cases = [*([] if count else CORPUS), *chosen]
    for outcome in record(trials(cases, workers, limit), table):
        outcomes.append(outcome)
        if outcome.verdict in (FAILED, UNFINISHED):
            typer.echo(f"trial {outcome.number}, {outcome.family}: {outcome.engine} {outcome.what}")
        elif len(outcomes) % 500 == 0:
            typer.echo(f"{len(outcomes)} of {len(cases)}")
    counts = tally(outcomes)
    typer.echo(f"{'':28}{'answered':>10}{'refused':>10}{'failed':>10}{'not finished':>14}")
    for engine, row in counts.items():
        typer.echo(f"{engine:28}{row[0]:10}{row[1]:10}{row[2]:10}{row[3]:14}")
    known, proven, inside = bounded(outcomes)
    typer.echo(f"truth known of {known} answers, bounds of {proven}, truth within {inside} of them")
    summary = {
        "trials": len(cases),
        "kaju_version": __version__,
        "workers": workers,
        "minutes": round((perf_counter() - began) / 60.0, 1),
        "processor_minutes": round(sum(outcome.seconds for outcome in outcomes) / 60.0, 1),
        "engines": counts,
        "bounds": [known, proven, inside],
    }
    (out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    typer.echo(table)
    if pictures:
        from kaju.view.trials import plot_trials

        typer.echo(plot_trials(outcomes, out / "outcomes.png"))
    _, _, failed, unfinished = map(sum, zip(*counts.values(), strict=True))
    if failed or unfinished:
        typer.echo(f"{failed} of {len(cases)} trials failed, {unfinished} not finished", err=True)
        raise typer.Exit(1 if failed else 3)
