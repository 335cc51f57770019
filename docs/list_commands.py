"""Write docs/commands.md from the command's own help: python docs/list_commands.py."""

from __future__ import annotations

from pathlib import Path

import typer

from kaju.__main__ import app

PATH = Path(__file__).with_name("commands.md")
HEAD = """# Command line

`kaju COMMAND --help` says the same. Results go into a folder of their own; `--json` prints the
summary for other programs and nothing else, `--quiet` prints nothing.
"""


def commands() -> str:
    """Return the page."""
    group = typer.main.get_command(app)
    lines = [HEAD]
    for name, command in sorted(group.commands.items()):
        if command.hidden:
            continue
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join((p.metavar or p.name).upper() for p in arguments)
        lines += [f"## kaju {name}\n", f"```\nkaju {name} {usage}".rstrip() + "\n```\n"]
        lines += [(command.help or "").split("\n\n")[0].replace("\n", " ").strip() + "\n"]
        rows = [
            f"| `{'`, `'.join([*p.opts, *p.secondary_opts])}` | {_plain(p.help)} |"
            for p in command.params
            if p.param_type_name == "option" and not p.hidden and "--help" not in p.opts
        ]
        lines += ["| option | meaning |\n|---|---|", *rows, ""] if rows else []
    return "\n".join(lines).rstrip() + "\n"


def _plain(text: str | None) -> str:
    return " ".join((text or "").replace("|", "or").split())


if __name__ == "__main__":
    PATH.write_text(commands())
