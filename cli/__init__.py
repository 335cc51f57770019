"""The command: one verb a function, in one table. Nothing else imports this room.

In come words, out go figures on the terminal and a folder of results.
Read the table below, `options` (what all verbs share), `commands_run` (verbs that compute),
`commands_many` and `commands_files`, then `console`.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn, TextIO

import typer

from kaju import __version__
from kaju.errors import KajuError

from .commands_files import animate, check, materials, new, page
from .commands_many import compare, sweep
from .commands_run import break_, creep, demo, grow, run, solve

VERBS = (
    *(demo, new, check, run, solve, creep, break_, grow),
    *(compare, page, animate, sweep, materials),
)
"""All commands, in the order in which they are told."""

app = typer.Typer(
    help="Agents that carry load through a body. Begin with: kaju demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for _verb in VERBS:
    # Paragraphs in one line each, for the terminal to break.
    _told = "\n\n".join(" ".join(part.split()) for part in (_verb.__doc__ or "").split("\n\n"))
    app.command(_verb.__name__.rstrip("_"), help=_told)(_verb)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"kaju {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command; whatever goes wrong is one line and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # ν on a terminal that knows only ASCII
    try:
        Path.cwd()  # fails where it was deleted, and every path counts from it
        app()
    except KajuError as error:
        _end(str(error))
    except MemoryError as error:
        _end(f"there is not enough memory ({error}); take a coarser or a smaller body")
    except OSError as error:
        gone = isinstance(error, FileNotFoundError)  # errors without a name are of a stream
        where = error.filename or ("the working folder" if gone else "the output")
        _end(f"{where}: {error.strerror or error}")


def _end(message: str) -> NoReturn:
    """Print an error, on the stream that still takes it, and exit."""
    _full(sys.stdout)
    typer.echo(f"error: {message}", err=not _full(sys.stderr))
    sys.exit(2)


def _full(stream: TextIO) -> bool:
    """Tell whether a stream takes nothing more; what it still holds is then discarded."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return True
    return False
