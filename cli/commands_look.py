"""The verbs that show: `animate` what has been stored, `page` in a file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kaju.errors import ParameterError

from .options import Force, Settings, refuse_to_replace, scene_of

Language = StrEnum("Language", "en de ja")


def animate(
    stored: Annotated[Path, typer.Argument(metavar="RESULT", help="A result, or its folder.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="A .gif, .webp or .mp4 film, a .glb mesh (Blender), a .pvd series (ParaView), or "
            "a folder of frames without background.",
        ),
    ] = None,
    what: Annotated[
        str | None, typer.Option(help="generations, stages, waves, loading, increments, or loads.")
    ] = None,
    frames_per_second: Annotated[
        float | None, typer.Option("--fps", help="Frames per second: 25 in time, 2 of steps.")
    ] = None,
    bare: Annotated[bool, typer.Option("--bare", help="Only the body: no axes, no words.")] = False,
    force: Force = False,
) -> None:
    """Animate a stored run; nothing is computed again."""
    from kaju.model.results.result import load_result
    from kaju.view import animate as film

    if stored.suffix == ".toml":
        raise ParameterError(
            f"{stored}: is a scene; run it first (kaju run {stored}), then animate its folder"
        )
    result = load_result(stored)
    folder = stored if stored.is_dir() else stored.parent
    target = out or folder / f"{what or 'film'}.gif"
    refuse_to_replace(target, force)
    typer.echo(film(result, target, what=what, fps=frames_per_second, bare=bare))


def page(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A scene (.toml), a result, or its folder.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="The page, an .html file.")
    ] = None,
    title: Annotated[str | None, typer.Option(help="The headline.")] = None,
    language: Annotated[
        Language | None,
        typer.Option(help="Of the page's own words; the reader's own unless given."),
    ] = None,
    python: Annotated[
        bool, typer.Option("--python", help="Readers write agents of their own in it.")
    ] = False,
    settings: Settings = None,
    force: Force = False,
) -> None:
    """Write a page that opens by a double click: no server, no network, no installation."""
    from kaju.model.results.result import load_result
    from kaju.view.page import export_page

    refuse_to_replace(target := out or Path(f"{file.stem}.html"), force)
    is_scene = file.suffix == ".toml"
    if settings and not is_scene:
        raise ParameterError("--set: changes a scene, and what a stored result shows is over")
    shown: Any = scene_of(file, settings) if is_scene else load_result(file)
    headline = title or file.stem.replace("-", " ").replace("_", " ").capitalize()
    words = language and language.value
    typer.echo(export_page(shown, target, title=headline, language=words, python=python))
