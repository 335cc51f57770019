"""The verbs that look at what has been stored: `animate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kaju.errors import ParameterError

from .options import Force, refuse_to_replace


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
        str | None,
        typer.Option(help="generations, stages, waves, loading, increments, or loads."),
    ] = None,
    frames_per_second: Annotated[float, typer.Option("--fps", help="Frames per second.")] = 2.0,
    bare: Annotated[bool, typer.Option("--bare", help="Only the body: no axes, no words.")] = False,
    force: Force = False,
) -> None:
    """Animate a stored run; nothing is computed again."""
    from kaju.model.stored import load_result
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
