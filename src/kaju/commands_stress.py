"""The command `kaju stress`."""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from kaju import __version__
from kaju.errors import ResultFileError

if TYPE_CHECKING:
    from kaju.model.trials.trial import Outcome

QUICK, ALL = 300, 10_000


def stress(
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for tables and pictures."),
    ] = Path("stress"),
    quick: Annotated[bool, typer.Option("--quick", help=f"{QUICK} trials only.")] = False,
    count: Annotated[
        int | None, typer.Option(min=1, metavar="N", help=f"How many trials; all are {ALL}.")
    ] = None,
    first: Annotated[int, typer.Option(min=0, metavar="N", help="Number of the first.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes side by side.")] = 2,
    limit: Annotated[
        float, typer.Option(help="Seconds of processor time of a trial that has hung.")
    ] = 30.0,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures")] = True,
) -> None:
    """Put random and adversarial scenes to every rule and solver; exit code 1 if one fails.

    A trial is answered, refused by a named error, or has failed: no number, hung, a raw error,
    forces that do not balance, a certificate that did not hold. The same number is the same
    trial on every machine: --first N --count 1 repeats one.
    """
    from kaju.model.trials.run import bounded, record, tally, trials
    from kaju.model.trials.trial import FAILED

    try:
        out.mkdir(parents=True, exist_ok=True)
        table = out / "stress.csv"
        table.touch()
    except OSError as error:
        raise ResultFileError(f"{out}: cannot be written: {error.strerror}") from error
    began = perf_counter()
    number = count or (QUICK if quick else ALL)
    outcomes: list[Outcome] = []
    for outcome in record(trials(range(first, first + number), workers, limit), table):
        outcomes.append(outcome)
        if outcome.verdict == FAILED:
            typer.echo(f"trial {outcome.number}, {outcome.family}: {outcome.engine} {outcome.what}")
        elif len(outcomes) % 500 == 0:
            typer.echo(f"{len(outcomes)} of {number}")
    typer.echo(f"{'':16}{'answered':>10}{'refused':>10}{'failed':>10}")
    counts = tally(outcomes)
    for row in counts:
        typer.echo(f"{row.engine:16}{row.answered:10}{row.refused:10}{row.failed:10}")
    known, proven, inside = bounded(outcomes)
    typer.echo(f"truth known of {known} answers, bounds of {proven}, truth within {inside} of them")
    told = {
        "trials": number,
        "kaju_version": __version__,
        "workers": workers,
        "minutes": round((perf_counter() - began) / 60.0, 1),
        "processor_minutes": round(sum(outcome.seconds for outcome in outcomes) / 60.0, 1),
        "engines": {row.engine: [row.answered, row.refused, row.failed] for row in counts},
        "bounds": [known, proven, inside],
    }
    (out / "summary.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    typer.echo(table)
    if pictures:
        from kaju.view.trials import plot_trials

        typer.echo(plot_trials(outcomes, out / "outcomes.png"))
    failed = sum(row.failed for row in counts)
    if failed:
        typer.echo(f"{failed} of {number} trials failed", err=True)
        raise typer.Exit(1)
