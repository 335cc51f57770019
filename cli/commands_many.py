"""The verbs that ask more than one answer: `compare` two, `sweep` one scene many times."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju.errors import require
from kaju.stepping import NOTE

from .console import Console, Folder, write_json
from .options import Force, Json, Pictures, Quiet, SceneFile, Settings, best_of, folder, scene_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaju.model.study.compare import Comparison

Stored = "a result or reference (.npz), or the folder of a run"


def compare(
    judged: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE|RESULT", help=f"A scene (.toml), whose rule is judged; or {Stored}."
        ),
    ],
    reference: Annotated[
        Path | None,
        typer.Argument(metavar="[REFERENCE]", help=f"With a result: {Stored}. It is believed."),
    ] = None,
    out: Annotated[
        Path | None,
        folder("Folder for comparison.json and pictures; of a scene SCENE-compared unless given."),
    ] = None,
    settings: Settings = None,
    resolution: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Cells of the believed answer for one of a scene's."),
    ] = None,
    fit: Annotated[
        int, typer.Option(metavar="RUNS", help="Runs for fitting a scene's rule; 0: no fit.")
    ] = 200,
    pictures: Pictures = True,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Say how far a scene's rule is from elasticity, or one result from another.

    Of a scene: runs its rule, the same with fitted coefficients, and agents of the elastic
    rule; draws the stress ratio, stresses along rows, shapes and displacements beside the
    answer of elasticity; and says in words how far each is off, and where.
    """
    from kaju.view.style import save

    console, is_scene = Console(as_json, quiet), judged.suffix == ".toml"
    target = out or (Path(f"{judged.stem}-compared") if is_scene else None)
    place = None if target is None else Folder(target, force)
    if is_scene:
        found, lines, drawn = _beside(judged, reference, settings, resolution, fit)
    else:
        changed = "--set" if settings else resolution and "--resolution"
        found, lines, drawn = _against(judged, reference, changed)
    console.say(*lines)
    if as_json:
        console.figures(found.summary())
    ended = NOTE in getattr(found, "notes", ())
    if place is not None:

        def parts(scratch: Path) -> None:
            write_json(scratch / "comparison.json", found.summary())
            for name, figure in drawn(found).items() if pictures and not ended else ():
                save(figure, scratch / f"{name}.png")

        console.say(*place.fill(parts))
    if ended:
        typer.echo(f"{NOTE}; it is in {target}", err=True)
        raise typer.Exit(130)


Told = tuple[Any, Iterable[str], Callable[[Any], dict[str, Any]]]
"""A comparison, its lines for people, and what draws it."""


def _beside(
    judged: Path, other: Path | None, settings: list[str] | None, resolution: int | None, fit: int
) -> Told:
    """Set a scene's rule beside elasticity, as far as Ctrl-C lets it."""
    from kaju.model.study.rule_study import RuleStudy, beside_elasticity
    from kaju.view.comparison import pictures_beside, words_beside

    require(
        other is None,
        f"{other}: a scene is compared with elasticity; to compare its run with another "
        f"result, run it first (kaju run {judged}), then compare its folder",
    )
    try:
        with scene_of(judged, settings) as scene:
            told = "body.regions: no rule runs within true outlines; compare answers of kaju solve"
            require(not scene.outlined, told)
            found = beside_elasticity(scene, resolution=resolution, evaluations=fit)
    except KeyboardInterrupt as stop:
        found = best_of(stop, RuleStudy)
    return found, words_beside(found), pictures_beside


def _against(judged: Path, reference: Path | None, changed: str | int | None) -> Told:
    """Compare one result with another; `changed` names an option that belongs to a scene."""
    from kaju.model.study.compare import compare, load_answer

    require(not changed, f"{changed}: belongs to a scene; {judged} is a result")
    require(reference is not None, f"REFERENCE: is needed, to compare {judged} with")
    found = compare(load_answer(judged), load_answer(reference or ""))
    return found, _table(found), _error_maps


def _table(found: Comparison) -> Iterator[str]:
    """Yield the errors of a comparison as a table."""
    summary = found.summary()
    yield f"{summary['result']} against {summary['reference']}, {len(found.points)} points"
    yield f"  {'':14}{'largest error':>14}{'r.m.s. error':>14}{'misfit':>10}"
    for name in ("displacement", "stress"):
        if errors := summary[name]:
            figures = (errors["max_error"], errors["l2_error"], errors["misfit"])
            yield "  {:14}{:14.4g}{:14.4g}{:10.4g}".format(name, *figures)
    if found.energy_error is not None:
        yield f"  energy norm of the error {found.energy_error:.4g}"
    yield "  errors are shares of the reference's largest value; misfit: |difference| over |it|"


def _error_maps(found: Comparison) -> dict[str, Figure]:
    from kaju.view.comparison import plot_error
    from kaju.view.style import figure_of

    names = ("displacement", "stress") if found.stress else ("displacement",)
    return {f"error_{name}": figure_of(plot_error(found, name)) for name in names}


def sweep(
    scene: SceneFile,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=VALUES",
            help="What is varied, may be repeated: values (rule.threshold=0.01,0.02), or a range "
            "to draw from (rule.beta=0:1, rule.threshold=1e-4:1e-1:log).",
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
    typer.echo(f"{len(table)} run{'s' * (len(table) != 1)}, {len(failed)} failed")
    # Of many columns those that say how runs differ.
    shown = table if measure or len(table) < 2 else table.loc[:, table.nunique(dropna=False) > 1]
    typer.echo(shown.head(20).to_string(index=False, max_colwidth=60))
    if len(table) > 20:
        typer.echo(f"... and {len(table) - 20} more")
    if len(failed):
        typer.echo(f"run {failed['run'].iloc[0]} failed: {failed['error'].iloc[0]}")
    typer.echo(f"all {table.shape[1]} columns: {target / 'table.csv'}")
    if len(failed) == len(table):
        raise typer.Exit(1)


def _verb(name: str) -> Any:
    import kaju
    from kaju.model.study.sweep import by_its_kind

    verbs = {"auto": "", "agents": "LoadModel", "solve": "solve", "stability": "stability"}
    require(name in verbs, f"--run: {', '.join(verbs)}, got {name!r}")
    return getattr(kaju, verbs[name]) if verbs[name] else by_its_kind


def _varied(text: str) -> tuple[str, Any]:
    """Return a key, and the values or the distribution that it takes."""
    key, equals, values = text.partition("=")
    right = bool(key.strip() and equals and values.strip())
    require(right, f"--vary: KEY=VALUE,VALUE or KEY=LOW:HIGH is needed, got {text!r}")
    return key.strip(), _distribution(values) or _listed(values)


def _distribution(text: str) -> Any:
    """Return the distribution meant by ``0:1`` or ``1e-4:1e-1:log``; None for anything else."""
    from scipy.stats import loguniform, uniform

    low, _, rest = text.partition(":")
    high, _, log = rest.partition(":")
    try:
        ends = float(low), float(high)
    except ValueError:
        return None
    right = ends[0] < ends[1] and (not log or (log == "log" and ends[0] > 0.0))
    told = "--vary: a range is LOW:HIGH with LOW below HIGH, or LOW:HIGH:log above 0"
    require(right, f"{told}, got {text!r}")
    return loguniform(*ends) if log else uniform(ends[0], ends[1] - ends[0])


def _listed(text: str) -> list[Any]:
    """Return values as TOML reads them; those that it does not understand stay texts."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except tomllib.TOMLDecodeError:
        return [part.strip() for part in text.split(",") if part.strip()]
