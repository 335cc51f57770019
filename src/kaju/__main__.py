"""The command: `kaju demo`, `run`, `animate`, `check`, `materials`, `new`."""

from __future__ import annotations

import sys
from importlib.resources import files
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju import __version__
from kaju.errors import ConvergenceError, KajuError, ParameterError

from . import commands_compare

if TYPE_CHECKING:
    from kaju.model.result import Result
    from kaju.model.scene import Scene

app = typer.Typer(
    help="Agents that carry load through a body.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

app.command()(commands_compare.compare)
app.command()(commands_compare.bench)

Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change the scene, e.g. rule.threshold=0.001."),
]
Pictures = Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")]
Force = Annotated[bool, typer.Option("--force", help="Replace results that are already there.")]
AllowUnstable = Annotated[
    bool, typer.Option("--allow-unstable", help="Run although the loads will grow.")
]
Resolution = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Split every cell into N along each axis.")
]
Strategy = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Solve the scene as linear elasticity, whatever its rule: uniform (equal cells), "
        "spawning (agents that are small where the error asks for it) or auto.",
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Solve the scene as linear elasticity to this error (energy norm), by whichever "
        "strategy is cheaper. With --strategy uniform: solve the equations to this error.",
    ),
]
SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (TOML).")]


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"kaju {__version__}")
        raise typer.Exit


@app.command()
def demo(out: Out = None, pictures: Pictures = True, force: Force = False) -> None:
    """Run the worked example: a steel plate pressed at one cell of its top edge."""
    from kaju.model.scene import Scene

    folder = out or Path("kaju-demo")
    result = _run_into(folder, Scene.from_toml(_worked_plate()), pictures, force)
    if pictures:
        from kaju.view import animate

        animation = animate(result, folder / "spawning.gif")
        typer.echo(f"animation: {animation}")


@app.command()
def run(
    scene: SceneFile,
    out: Out = None,
    settings: Settings = None,
    pictures: Pictures = True,
    force: Force = False,
    allow_unstable: AllowUnstable = False,
    resolution: Resolution = None,
    strategy: Strategy = None,
    tolerance: Tolerance = None,
) -> None:
    """Run a scene and write summary.json, result.npz and pictures."""
    described = _scene(scene, settings)
    folder = out or Path(f"{scene.stem}-result")
    options: dict[str, Any] = {"allow_unstable": allow_unstable, "resolution": resolution}
    if strategy is not None or tolerance is not None:
        options["solving"] = {"strategy": strategy or "auto", "tolerance": tolerance}
    _run_into(folder, described, pictures, force, **options)


@app.command(name="animate")
def animate_result(
    stored: Annotated[Path, typer.Argument(metavar="RESULT", help="A result, or its folder.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="A .gif or .mp4 file.")
    ] = None,
    what: Annotated[
        str | None,
        typer.Option(help="generations (unless given), stages, increments, or loads left."),
    ] = None,
    frames_per_second: Annotated[float, typer.Option("--fps", help="Frames per second.")] = 2.0,
    force: Force = False,
) -> None:
    """Animate a stored run; nothing is computed again."""
    from kaju.model.stored import load_result
    from kaju.view import animate

    if stored.suffix == ".toml":
        raise ParameterError(
            f"{stored}: is a scene; run it first (kaju run {stored}), then animate its folder"
        )
    result = load_result(stored)
    folder = stored if stored.is_dir() else stored.parent
    target = out or folder / f"{what or 'film'}.gif"
    _refuse_to_replace(target, force)
    typer.echo(animate(result, target, what=what, fps=frames_per_second))


@app.command()
def check(scene: SceneFile, settings: Settings = None) -> None:
    """Say whether the loads of a scene will end; exit code 1 if they may not."""
    from kaju.model.propagation.stability import stability

    certificate = stability(_scene(scene, settings))
    radius = certificate.spectral_radius
    known = f"{radius:.6g}" if radius is not None else "not computed"
    typer.echo(f"verdict          {certificate.verdict}")
    typer.echo(f"spectral radius  {known} (loads added up, boundaries included)")
    typer.echo(f"  bounds         {certificate.lower:.6g} to {certificate.upper:.6g}")
    typer.echo(f"largest share    {certificate.largest_share:.6g} (of one load, passed on at once)")
    raise typer.Exit(0 if certificate.stable else 1)


@app.command()
def materials() -> None:
    """List the materials that scenes can use by name."""
    from rich.console import Console
    from rich.table import Table

    from kaju.agents.materials import LIBRARY

    table = Table("name", "E (Pa)", "ν", "density (kg/m³)", "source")
    for material in LIBRARY.values():
        table.add_row(
            material.name,
            f"{material.youngs_modulus:.4g}",
            f"{material.poissons_ratio:.3g}",
            "" if material.density is None else f"{material.density:.4g}",
            material.source,
        )
    Console().print(table)


@app.command()
def new(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="The file to write.")],
    force: Force = False,
) -> None:
    """Write a commented scene to start from."""
    _refuse_to_replace(scene, force)
    try:
        scene.write_text(_worked_plate(), encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"{scene}: cannot be written: {error.strerror}") from error
    typer.echo(f"{scene}: edit it, then: kaju run {scene}")


def _worked_plate() -> str:
    return files("kaju").joinpath("plate.toml").read_text(encoding="utf-8")


def _scene(path: Path, settings: list[str] | None) -> Scene:
    from kaju.model.scene import load_scene

    described = load_scene(path)
    if not settings:
        return described
    changes = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not (key and equals):
            raise ParameterError(f"--set: KEY=VALUE is needed, got {setting!r}")
        changes[key.strip()] = value.strip()
    return described.with_overrides(changes)


def _refuse_to_replace(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise ParameterError(f"{path}: exists already; take another name, or --force to replace it")


def _run_into(folder: Path, scene: Scene, pictures: bool, force: bool, **options: Any) -> Result:
    """Run a scene, print its key figures and write the folder."""
    from kaju.model.result import Result

    from .output import Folder

    target = Folder(folder, force)
    solved = scene.rule.kind == "elastic" or "solving" in options
    try:
        result, interrupted = _solve(scene, **options) if solved else _step(scene, **options)
    except ConvergenceError as error:
        if isinstance(error.best, Result):
            for path in target.write(error.best, pictures=False):
                typer.echo(path)
        raise
    for key, value in result.summary().items():
        typer.echo(f"  {key:22} {value}")
    for path in target.write(result, pictures and not interrupted):
        typer.echo(path)
    if interrupted:
        typer.echo("interrupted: what was computed until then has been kept", err=True)
        raise typer.Exit(130)
    return result


def _step(
    scene: Scene, allow_unstable: bool = False, resolution: int | None = None
) -> tuple[Result, bool]:
    """Let agents pass the loads on; return the result, and whether it was interrupted."""
    from kaju.model.propagation.load_model import LoadModel

    if resolution is not None:
        scene = scene.refine(resolution)
    model = LoadModel(scene, allow_unstable=allow_unstable)
    interrupted = False
    try:
        model.run()
    except KeyboardInterrupt:
        interrupted = True
    result = model.result()
    typer.echo(result.last.outcome)
    return result, interrupted


def _solve(
    scene: Scene,
    allow_unstable: bool = False,
    resolution: int | None = None,
    solving: dict[str, Any] | None = None,
) -> tuple[Result, bool]:
    """Solve a scene with the elastic rule."""
    from kaju.model.solving import solve

    if allow_unstable:
        raise ParameterError("--allow-unstable: the solver of the elastic rule is always stable")
    return solve(scene, resolution=resolution, **(solving or {})), False


def main() -> None:
    """Run the command; an error of kaju's is one line and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        # A terminal without Greek letters shows a question mark instead of ending the run.
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        app()
    except KajuError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
