"""The verb `fit`: coefficients of the prescribed rule that come closest to a reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kaju.errors import ParameterError

from .console import Console
from .options import Force, Json, Quiet, Settings, folder, refuse_to_replace, scene_of

if TYPE_CHECKING:
    from kaju.model.study.fitting import Fit


def fit(
    scenes: Annotated[
        list[Path], typer.Argument(metavar="SCENE...", help="Scene files (TOML), fitted together.")
    ],
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="What to come close to, one for each scene: a result or reference (.npz), or the "
            "folder of a run; the answers of elasticity unless given.",
        ),
    ] = None,
    weigh: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=WEIGHT",
            help="What counts how much: displacement=1 and stress=1 unless given.",
        ),
    ] = None,
    runs: Annotated[int, typer.Option(metavar="N", help="Runs of the rule, about.")] = 600,
    seconds: Annotated[float, typer.Option(help="The search ends after so long.")] = 60.0,
    out: Annotated[
        Path | None,
        folder("Where the fitted scenes are written, as SCENE-fitted.toml; here unless given."),
    ] = None,
    settings: Settings = None,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the α and β that bring a scene's rule closest to elasticity.

    Several scenes, and displacement and stress, are fitted together; what gets worse for it is
    told. The coefficients fit these bodies under these loads, and no others.
    """
    from kaju.agents.rules import PrescribedRule
    from kaju.model.study.compare import load_answer
    from kaju.model.study.fitting import fit_rule

    console, place = Console(as_json, quiet), out or Path()
    targets = [place / f"{path.stem}-fitted.toml" for path in scenes]
    for target in targets:
        refuse_to_replace(target, force)
    described = [scene_of(path, settings) for path in scenes]
    believed = [load_answer(path) for path in reference] if reference else None
    weights = dict(map(_weight, weigh or ("displacement=1", "stress=1")))
    found = fit_rule(
        described,
        believed,
        quantity=weights,  # type: ignore[arg-type]  # refused by name where it is another
        evaluations=runs,
        seconds=seconds,
    )
    _say(found, scenes, console)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"--out: {place} cannot be made: {error.strerror}") from error
    for scene, target in zip(described, targets, strict=True):
        assert isinstance(scene.rule, PrescribedRule)
        rule = replace(scene.rule, alpha=found.rule.alpha, beta=found.rule.beta, materials={})
        scene.replace(rule=rule).save(target)
    console.files(targets)


def _weight(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        return name.strip(), float(number)
    except ValueError:
        raise ParameterError(
            f"--weigh: QUANTITY=WEIGHT is needed, such as stress=2, got {text!r}"
        ) from None


def _say(found: Fit, scenes: list[Path], console: Console) -> None:
    if console.as_json:
        console.figures(found.summary())
    alpha = ", ".join(f"{share:.4g}" for share in found.rule.alpha or ())
    console.say(f"alpha = [{alpha}], beta = {found.rule.beta:.4g}, after {found.evaluations} runs")
    console.say(f"  {'misfit (1: no better than nothing)':36}{'before':>8}{'after':>8}")
    for row in found.misfits:
        name = f"{scenes[row.scene].stem}, {row.quantity}"
        console.say(f"  {name:36}{row.before:8.3g}{row.after:8.3g}")
    for line in (found.trade_off, *found.notes):
        if line:
            console.say(line)
