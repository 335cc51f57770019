"""The verbs that compute a scene: `demo` and `run` let agents act, `solve` gives the answer."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kaju.errors import ConvergenceError, ParameterError
from kaju.stopping import NOTE

from .console import Console
from .options import (
    Force,
    Json,
    Out,
    Pictures,
    Quiet,
    Resolution,
    SceneFile,
    Settings,
    scene_of,
    worked_plate,
)

if TYPE_CHECKING:
    from kaju.model.elastic.settling.elastic_model import ElasticModel
    from kaju.model.propagation.load_model import LoadModel
    from kaju.model.result import Result
    from kaju.model.scene import Scene


class StrategyName(Enum):
    """Where agents may be small, for the shell to complete."""

    AUTO = "auto"
    UNIFORM = "uniform"
    SPAWNING = "spawning"


class EngineName(Enum):
    """Whose machinery solves equal cells, for the shell to complete."""

    KAJU = "kaju"
    PETSC = "petsc"


AllowUnstable = Annotated[
    bool, typer.Option("--allow-unstable", help="Run although the loads will grow.")
]
Strategy = Annotated[
    StrategyName,
    typer.Option(
        help="Equal cells, agents that are small where the error asks for it, or (auto) "
        "whichever is cheaper.",
    ),
]
Engine = Annotated[
    EngineName,
    typer.Option(
        help="kaju's own, or PETSc for equal cells, on many processes under mpirun (docs/scale.md)."
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(help="Relative error in the energy norm to keep; 0.01 is one per cent."),
]
Misplaced = Annotated[str | None, typer.Option(hidden=True)]

LOW = {"body.size": [0.2, 0.05], "body.cells": [20, 5], "loads.0.cell": [10, 4]}
"""What makes the worked plate so low that its load reaches the ground and wakes agents there."""


def demo(
    out: Out = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run the worked example: a steel plate pressed at one cell of its top edge.

    A second film shows a plate so low that the load reaches the ground, which answers.
    """
    from kaju.model.propagation.load_model import LoadModel
    from kaju.model.scene import Scene

    console, folder = Console(as_json, quiet), out or Path("kaju-demo")
    scene = Scene.from_toml(worked_plate())
    result = into_folder(folder, console, lambda: _watched(scene, console), pictures, force)
    if pictures:
        from kaju.view import animate

        console.say(animate(result, folder / "spawning.gif"))
        low = LoadModel(scene.with_overrides(LOW)).run()
        console.say(animate(low, folder / "ground.gif"))


def run(
    scene: SceneFile,
    out: Out = None,
    settings: Settings = None,
    pictures: Pictures = True,
    force: Force = False,
    allow_unstable: AllowUnstable = False,
    resolution: Resolution = None,
    as_json: Json = False,
    quiet: Quiet = False,
    strategy: Misplaced = None,
    tolerance: Misplaced = None,
) -> None:
    """Let the agents of a scene act, by its rule, until no load moves any more.

    Writes summary.json, result.npz and pictures. An elastic rule's order, share, threshold
    and tolerance are obeyed; for the answer of elasticity itself see `kaju solve`.
    """
    for name, value in (("strategy", strategy), ("tolerance", tolerance)):
        if value is not None:
            raise ParameterError(
                f"--{name}: `kaju run` lets agents act by the scene's rule; for the answer of "
                f"elasticity: kaju solve {scene} --{name} {value}"
            )
    console, described = Console(as_json, quiet), scene_of(scene, settings)
    if resolution is not None:
        described = described.refine(resolution)
    into_folder(
        out or Path(f"{scene.stem}-result"),
        console,
        lambda: _watched(described, console, allow_unstable),
        pictures,
        force,
    )


def solve(
    scene: SceneFile,
    out: Out = None,
    settings: Settings = None,
    pictures: Pictures = True,
    force: Force = False,
    resolution: Resolution = None,
    strategy: Strategy = StrategyName.AUTO,
    tolerance: Tolerance = None,
    engine: Engine = EngineName.KAJU,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Solve a scene as linear elasticity, whatever its rule.

    Writes summary.json, result.npz and pictures. With a tolerance the error is kept below it;
    without one the scene's own cells are solved.
    """
    console, described = Console(as_json, quiet), scene_of(scene, settings)
    folder = out or Path(f"{scene.stem}-solved")
    if engine is EngineName.PETSC:
        from .on_processes import solve_on_processes

        how = {"tolerance": tolerance, "resolution": resolution}
        if solve_on_processes(described, folder, console, **how):
            return

    def answer() -> Result:
        from kaju.model.solving import solve as solve_scene

        found: Result
        if engine is EngineName.PETSC:
            found = solve_scene(described, tolerance, resolution, strategy.value, engine="petsc")
        else:
            found = solve_scene(described, tolerance, resolution, strategy.value)
        console.say("solved as linear elasticity")
        return found

    into_folder(folder, console, answer, pictures, force)


def into_folder(
    folder: Path,
    console: Console,
    compute: Callable[[], Result],
    pictures: bool,
    force: bool,
) -> Result:
    """Compute a result, print its key figures and write its folder.

    After Ctrl-C what there is is written without pictures, and the exit code is 130. An answer that
    missed its tolerance is kept before the error is told.
    """
    from kaju.model.result import Result

    from .output import Folder

    target = Folder(folder, force)
    try:
        result = compute()
    except KeyboardInterrupt as stop:
        best = getattr(stop, "best", None)
        if isinstance(best, Result):
            console.figures(best.summary())
            console.files(target.write(best, pictures=False))
            typer.echo(f"{NOTE}; it is in {target.path}", err=True)
        else:
            typer.echo("interrupted before there was anything to keep", err=True)
        raise typer.Exit(130) from None
    except ConvergenceError as error:
        if isinstance(error.best, Result):
            console.files(target.write(error.best, pictures=False))
        raise
    console.figures(result.summary())
    console.files(target.write(result, pictures))
    return result


def _watched(scene: Scene, console: Console, allow_unstable: bool = False) -> Result:
    """Let agents act."""
    result = _model_of(scene, allow_unstable).run()
    console.say(f"agents of the {scene.rule.kind} rule: {result.outcome}")
    return result


def _model_of(scene: Scene, allow_unstable: bool) -> LoadModel | ElasticModel:
    if scene.rule.kind == "elastic":
        from kaju.model.elastic.settling.elastic_model import ElasticModel

        return ElasticModel(scene, allow_unstable=allow_unstable)
    from kaju.model.propagation.load_model import LoadModel

    return LoadModel(scene, allow_unstable=allow_unstable)
