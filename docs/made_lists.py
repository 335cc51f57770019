"""What is made when the site is built: the options of all commands."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import typer

from kaju.cli import app


def with_lists(text: str) -> str:
    """Return a text with the options where ``<!-- made: commands -->`` stands."""
    return re.sub(r"^<!-- made: commands -->$", lambda _: commands(), text, flags=re.M)


def commands() -> str:
    """Return the options of all commands, a section each."""
    group = typer.main.get_command(app)
    listed = {name: c for name, c in sorted(group.commands.items()) if not c.hidden}
    rows = {name: dict(_rows(c.params)) for name, c in listed.items()}
    times = Counter(row for mine in rows.values() for row in mine.items())
    shared = [row for row, count in times.most_common() if count > 2]
    lines = ["## Options of many commands\n", *_table(shared)]
    for name, command in listed.items():
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join((p.metavar or p.name).upper() for p in arguments)
        lines += [f"## kaju {name}\n", f"```\nkaju {name} {usage}".rstrip() + "\n```\n"]
        lines += [(command.help or "").split("\n\n")[0].replace("\n", " ").strip() + "\n"]
        lines += _table([row for row in rows[name].items() if row not in shared])
        also = [row[0].split(",")[0] for row in rows[name].items() if row in shared]
        lines += [f"Also {', '.join(also)}.\n"] if also else []
    return "\n".join(lines).rstrip() + "\n"


def _rows(parameters: list[Any]) -> Iterator[tuple[str, str]]:
    for one in parameters:
        if one.param_type_name == "option" and not one.hidden and "--help" not in one.opts:
            yield f"`{'`, `'.join([*one.opts, *one.secondary_opts])}`", _plain(one.help)


def _table(rows: list[tuple[str, str]]) -> list[str]:
    cells = [f"| {option} | {meaning} |" for option, meaning in rows]
    return ["| option | meaning |\n|---|---|", *cells, ""] if rows else []


def _plain(text: str | None) -> str:
    words = " ".join((text or "").replace("|", "or").split())
    return re.sub(r"(?<!\w)(--[\w-]+)", r"`\1`", words)
