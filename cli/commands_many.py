"""The verb that runs many scenes: `sweep` varies one."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju.errors import ParameterError

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
    from kaju.model.study.sweep_runs import by_its_kind

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
