"""Write docs/commands.md from the command's own help: python docs/list_commands.py."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import typer

from kaju.__main__ import app

PATH = Path(__file__).with_name("commands.md")
HEAD = """# Command line

`kaju COMMAND --help` says the same. Results go into a folder of their own.

## In this order

```
kaju new my.toml                              # write a commented scene to start from
kaju check my.toml                            # will its loads end? (or a result: is it whole?)
kaju run my.toml                              # let its agents act: my-result
kaju run my.toml --set rule.threshold=0.001 --set loads.0.steps=1 --out finer
kaju run my.toml --set rule.kind=elastic --out elastic-agents
kaju solve my.toml                            # the answer of elasticity: my-solved
kaju solve my.toml --tolerance 0.05 --out kept
kaju creep my.toml --hold 10                  # in time, if its materials flow: my-creep
kaju grow my.toml --volume 40%                # where it carries, material stays: my-grown
kaju animate my-result                        # a film of the stored run
kaju compare my-result kept                   # how far is one answer from another?
kaju compare my.toml                          # the rule beside elasticity: figures and words
kaju page my.toml --out my.html               # one file to watch, touch and hand on
kaju materials                                # the materials that scenes know by name
```

`run` lets agents act by the scene's rule, `solve` gives the answer of elasticity whatever the rule.
A scene is a TOML file; [scenes](scenes.md) lists all that it can say.
"""


def commands() -> str:
    """Return the page."""
    group = typer.main.get_command(app)
    listed = {name: c for name, c in sorted(group.commands.items()) if not c.hidden}
    rows = {name: dict(map(_row, filter(_shown, c.params))) for name, c in listed.items()}
    times = Counter(row for mine in rows.values() for row in mine.items())
    shared = [row for row, count in times.most_common() if count > 2]
    lines = [HEAD, "## Options of many commands\n", *_table(shared)]
    for name, command in listed.items():
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join((p.metavar or p.name).upper() for p in arguments)
        lines += [f"## kaju {name}\n", f"```\nkaju {name} {usage}".rstrip() + "\n```\n"]
        lines += [(command.help or "").split("\n\n")[0].replace("\n", " ").strip() + "\n"]
        lines += _table([row for row in rows[name].items() if row not in shared])
        also = [row[0].split(",")[0] for row in rows[name].items() if row in shared]
        lines += [f"Also {', '.join(also)}.\n"] if also else []
    return "\n".join(lines).rstrip() + "\n"


def _shown(parameter: Any) -> bool:
    return (
        parameter.param_type_name == "option"
        and not parameter.hidden
        and "--help" not in parameter.opts
    )


def _row(option: Any) -> tuple[str, str]:
    return f"`{'`, `'.join([*option.opts, *option.secondary_opts])}`", _plain(option.help)


def _table(rows: list[tuple[str, str]]) -> list[str]:
    cells = [f"| {option} | {meaning} |" for option, meaning in rows]
    return ["| option | meaning |\n|---|---|", *cells, ""] if rows else []


def _plain(text: str | None) -> str:
    return " ".join((text or "").replace("|", "or").split())


if __name__ == "__main__":
    PATH.write_text(commands())
