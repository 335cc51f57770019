"""The command: one verb a function, gathered here."""

from __future__ import annotations

import io
import sys
from typing import Annotated, Any

import typer
import typer.core

from kaju import __version__
from kaju.errors import KajuError

from . import (
    commands_compare,
    commands_fit,
    commands_look,
    commands_many,
    commands_run,
    commands_scene,
)


class Verbs(typer.core.TyperGroup):
    """The verbs; a scene alone is run."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb that is meant, and its words."""
        return super().resolve_command(ctx, ["run", *args] if args[0].endswith(".toml") else args)


app = typer.Typer(
    cls=Verbs,
    help="Agents that carry load through a body.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for _verb in (
    commands_run.demo,
    commands_scene.new,
    commands_scene.check,
    commands_run.run,
    commands_run.solve,
    commands_run.creep,
    commands_look.animate,
    commands_look.page,
    commands_look.watch,
    commands_compare.compare,
    commands_fit.fit,
    commands_many.stress,
    commands_many.sweep,
    commands_scene.materials,
):
    app.command()(_verb)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"kaju {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command; an error of kaju's is one line and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # ν on a terminal that knows only ASCII
    try:
        app()
    except KajuError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
