"""Write docs/commands.md from the command's own help: python docs/list_commands.py."""

from __future__ import annotations

from pathlib import Path

import typer

from kaju.__main__ import app

PATH = Path(__file__).with_name("commands.md")
HEAD = """# Command line

`kaju COMMAND --help` says the same. Results go into a folder of their own; `--json` prints the
summary for other programs and nothing else, `--quiet` prints nothing.

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
