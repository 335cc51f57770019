"""The verb `page`: one file in which a run can be watched, touched and handed on."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kaju.errors import ParameterError

if TYPE_CHECKING:
    from kaju.model.result import Result
    from kaju.model.scene import Scene

from .options import Force, Settings, refuse_to_replace, scene_of


def page(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A scene (.toml), a result, or its folder.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="The page, an .html file."),
    ] = None,
    title: Annotated[str | None, typer.Option(help="The headline.")] = None,
    language: Annotated[
        str | None, typer.Option(metavar="en|de|ja", help="Unless given, the reader's own.")
    ] = None,
    settings: Settings = None,
    force: Force = False,
) -> None:
    """Write a page that opens by a double click: no server, no network, no installation."""
    from kaju.view.page import export_page

    refuse_to_replace(target := out or Path(f"{file.stem}.html"), force)
    shown: Scene | Result
    if file.suffix == ".toml":
        shown = scene_of(file, settings)
    elif settings:
        raise ParameterError("--set: changes a scene, and what a stored result shows is over")
    else:
        from kaju.model.stored import load_result

        shown = load_result(file)
    headline = title or file.stem.replace("-", " ").replace("_", " ").capitalize()
    typer.echo(export_page(shown, target, title=headline, language=language))


def watch(
    scene: Annotated[
        Path | None,
        typer.Argument(metavar="SCENE", help="A scene (.toml); the worked plate unless given."),
    ] = None,
    port: Annotated[int, typer.Option(help="Where to listen; 0 takes any port.")] = 8000,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open a browser window.")
    ] = True,
    settings: Settings = None,
) -> None:
    """Watch agents at work in a browser; Python computes them, on this machine only."""
    from kaju.view.page import watch as serve

    worked = Path(str(files("kaju").joinpath("plate.toml")))
    serve(scene_of(scene or worked, settings), port, browser=browser)
