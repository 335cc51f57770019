"""The verb `compare`, of a rule with elasticity or of two results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju.errors import ParameterError, ResultFileError
from kaju.files import check_writable
from kaju.stopping import NOTE, Interrupted

from .console import Console
from .options import Force, Json, Pictures, Quiet, Settings, folder, scene_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaju.model.scene import Scene
    from kaju.model.study.compare import Comparison
    from kaju.model.study.rule_study import RuleStudy

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
    console = Console(as_json, quiet)
    if judged.suffix != ".toml":
        for given, name in ((settings, "--set"), (resolution, "--resolution")):
            if given is not None:
                raise ParameterError(f"{name}: belongs to a scene; {judged} is a result")
        if reference is None:
            raise ParameterError(f"REFERENCE: is needed, which {judged} is judged by")
        if out is not None:
            _check_free(out, force)
        found = _two(judged, reference, console)
        if out is not None:
            _write(out, found.summary(), _error_maps(found) if pictures else {}, console)
        return
    if reference is not None:
        raise ParameterError(
            f"{reference}: a scene is compared with elasticity; to compare its run with "
            f"another result, run it first (kaju run {judged}), then compare its folder"
        )
    target = out or Path(f"{judged.stem}-compared")
    _check_free(target, force)
    try:
        study = _study(scene_of(judged, settings), resolution, fit, console)
    except KeyboardInterrupt:
        typer.echo("interrupted before there was anything to keep", err=True)
        raise typer.Exit(130) from None
    from kaju.view.comparison import pictures_beside

    ended_early = bool(study.notes)
    drawn = pictures_beside(study) if pictures and not ended_early else {}
    _write(target, study.summary(), drawn, console)
    if ended_early:
        typer.echo(f"{NOTE}; it is in {target}", err=True)
        raise typer.Exit(130)


def _study(
    scene: Scene,
    resolution: int | None,
    fit: int,
    console: Console,
) -> RuleStudy:
    """Set a scene's rule beside elasticity, and say what was found."""
    from kaju.model.study.rule_study import RuleStudy, beside_elasticity
    from kaju.view.comparison import words_beside

    try:
        study = beside_elasticity(scene, resolution=resolution, evaluations=fit)
    except Interrupted as stop:
        if not isinstance(stop.best, RuleStudy):
            raise
        study = stop.best
    for line in words_beside(study):
        console.say(line)
    if console.as_json:
        console.figures(study.summary())
    return study


def _two(result: Path, reference: Path, console: Console) -> Comparison:
    """Compare two stored answers, and say what was found."""
    from kaju.model.study.compare import compare as compare_answers
    from kaju.model.study.compare import load_answer
    from kaju.model.study.reference import Reference

    if reference.suffix == ".toml":
        raise ParameterError(
            f"{reference}: is a scene; run it first (kaju run {reference}), then compare its folder"
        )
    judged = load_answer(result)
    if isinstance(judged, Reference):
        raise ParameterError(f"{result}: is a reference, which is believed; name it second")
    found = compare_answers(judged, load_answer(reference))
    summary = found.summary()
    if console.as_json:
        console.figures(summary)
    console.say(f"{summary['result']} against {summary['reference']}, {len(found.points)} points")
    console.say(f"  {'':14}{'largest error':>14}{'r.m.s. error':>14}{'misfit':>10}")
    for name in ("displacement", "stress"):
        if errors := summary[name]:
            console.say(
                f"  {name:14}{errors['max_error']:14.4g}{errors['l2_error']:14.4g}"
                f"{errors['misfit']:10.4g}"
            )
    if found.energy_error is not None:
        console.say(f"  energy norm of the error {found.energy_error:.4g}")
    console.say(
        "  errors are shares of the reference's largest value; misfit: |difference| over |it|"
    )
    return found


def _error_maps(found: Comparison) -> dict[str, Figure]:
    from kaju.view.comparison import plot_error
    from kaju.view.style import figure_of

    names = ("displacement", "stress") if found.stress else ("displacement",)
    return {f"error_{name}": figure_of(plot_error(found, name)) for name in names}


def _check_free(target: Path, force: bool) -> None:
    file = target / "comparison.json"
    if file.exists() and not force:
        raise ResultFileError(
            f"{file}: exists already; take another folder, or --force to replace it"
        )
    check_writable(target, ResultFileError)


def _write(
    target: Path, summary: dict[str, Any], figures: Mapping[str, Figure], console: Console
) -> None:
    from kaju.view.picture_files import save

    written = [target / "comparison.json"]
    try:
        target.mkdir(parents=True, exist_ok=True)
        text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
        written[0].write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultFileError(f"{target}: cannot be written: {error.strerror}") from error
    written += [save(figure, target / f"{name}.png") for name, figure in figures.items()]
    console.files(written)
