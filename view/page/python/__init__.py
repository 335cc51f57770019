"""Agents in Python in a page: what runs in it, and how it gets there.

In comes a scene; out go the sources of agents and engine, as text that the page runs.
Read `heart` (the sources, stripped), `engine` (what they need in a page), then `ready` (the agents
to begin with).
"""

from __future__ import annotations

import ast
import builtins
import inspect
import json
import math
import sys
import textwrap
import zlib
from base64 import b64encode
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib.resources import files
from types import FunctionType, ModuleType
from typing import Any

from kaju.errors import needing
from kaju.model.own_code import is_own

from .heart import heart

OFFERED = (
    "Emission", "FreeBoundaryAgent", "Load", "MaterialAgent", "Parameter", "RigidBoundaryAgent",
    "RollerBoundaryAgent", "Shares", "State",
)  # fmt: skip
"""What agents in a page import from kaju."""
SMALL = {
    "dataclasses": "def replace(of, **named):\n    return of._replace(**named)\n",
    "typing": "class A:\n    def __getitem__(self, what):\n        return self\n"
    "Any = ClassVar = A()\n",
    "random": "from kaju import Elsewhere, Random\n"
    'for name in ("random", "uniform", "randint", "choice", "shuffle", "sample"):\n'
    '    globals()[name] = Elsewhere(f"random.{name}", f"write self.random.{name}(...)")\n',
}
"""Modules of Python that agents may import, as far as they need them."""


def text_of(name: str) -> str:
    """Return the text of a file beside this one."""
    return files(__package__).joinpath(name).read_text("utf-8")


def header(own: dict[str, Any]) -> dict[str, Any]:
    """Return what a page's header says: the code it opens with, and the agents to begin from."""
    ready = json.loads(text_of("ready/ready.json"))
    for name, agent in ready.items():
        agent["code"] = text_of(f"ready/{name}.py")
    code, needs, values = ready["standard"]["code"], [], {}
    if own:
        values = {row["name"]: row["value"] for row in own["parameters"]}
        needs = _unknown(own["source"])
        head = [f"import {name}" for name in needs if name in ("kaju", "math", "random")]
        offered = [name for name in needs if name in OFFERED]
        head += [f"from kaju import {', '.join(offered)}"] * bool(offered)
        needs = [name for name in needs if name not in (*offered, "kaju", "math", "random")]
        code = "\n".join([*head, "", "", own["source"], ""]).lstrip()
    return {
        "python": {
            "code": code,
            "needs": needs,
            "values": values,
            "ready": ready,
            "licence": text_of("ready/licence.txt").strip(),
        }
    }


def sources(parts: Iterable[Any]) -> list[str]:
    """Return the sources of classes and functions, each after what of your own it names."""
    told: dict[str, str] = {}

    def add(name: str, of: Any, source: str) -> None:
        if source and name not in told:
            told[name] = ""  # it may name itself
            around = sys.modules.get(getattr(of, "__module__", ""))
            for other in _unknown(source):
                one = getattr(around, other, ...)
                add(other, one, _own(other, one))
            told[name] = told.pop(name) or source  # it stands after them

    for part in parts:
        add(part.__name__, part, _source(part))
    return list(told.values())


def _source(part: type | FunctionType) -> str:
    """Return the source of a class or function, or why there is none."""
    if part.__name__ in ("<lambda>", "partial"):  # its lines are those of a call, or Python's own
        return "# an order that is a lambda or a partial is not here: write def mine(waiting)"
    with suppress(OSError, TypeError, SyntaxError):
        source = textwrap.dedent(_lines_of(part)).rstrip()
        ast.parse(source)  # within a function a text may stand further left than its class
        return source
    return f"# the source of {part.__name__} is not at hand"


def _lines_of(part: type | FunctionType) -> str:
    """Return the lines of a class or function; of classes of one name those of this one."""
    if isinstance(part, FunctionType):
        return inspect.getsource(part)
    home = f"{part.__qualname__}."
    own = [one for one in vars(part).values() if getattr(one, "__qualname__", "").startswith(home)]
    codes = [one.__code__ for one in own if isinstance(one, FunctionType)]
    lines, _ = inspect.findsource(codes[0] if codes else part)
    nodes = [one for one in ast.walk(ast.parse("".join(lines))) if isinstance(one, ast.ClassDef)]
    spans = [
        {at.lineno for at in ast.walk(one) if hasattr(at, "lineno")} | {one.end_lineno or 0}
        for one in nodes
        if one.name == part.__name__
    ]  # decorators stand before their class
    meant = [s for s in spans if not codes or min(s) <= codes[0].co_firstlineno <= max(s)]
    if len(meant) != 1:
        raise OSError  # nobody knows
    return "".join(lines[min(meant[0]) - 1 : max(meant[0])])


def _own(name: str, of: Any) -> str:
    """Return the source or the line that makes what is called so; none of what others wrote."""
    if isinstance(of, ModuleType):
        there = of.__name__ in ("kaju", "math") and of.__name__ != name
        return f"import {of.__name__} as {name}" * there
    if isinstance(of, (type, FunctionType)):
        if of.__name__ != name and (of.__module__ or "").startswith("kaju."):
            return f"from kaju import {of.__name__} as {name}"
        return _source(of) if is_own(of.__module__) and of.__name__ == name else ""
    if getattr(math, name, None) is of:
        return f"from math import {name}"
    with suppress(ValueError, SyntaxError):
        return f"{name} = {of!r}" if ast.literal_eval(repr(of)) == of else ""
    return ""


def _unknown(source: str) -> list[str]:
    """Return the names that a source uses and neither it nor Python defines."""
    nodes = list(ast.walk(ast.parse(source)))
    names = [node for node in nodes if isinstance(node, ast.Name)]
    known = {node.id for node in names if not isinstance(node.ctx, ast.Load)} | set(dir(builtins))
    known |= {node.arg for node in nodes if isinstance(node, ast.arg)}
    known |= {n.name for n in nodes if isinstance(n, (ast.ClassDef, ast.FunctionDef))}
    known |= {n.asname or n.name for n in nodes if isinstance(n, ast.alias)}
    return sorted({node.id for node in names} - known)


@cache
def worker(modules: str) -> str:
    """Return the worker's deflated text: Brython, two of its modules, the page's, the agents."""
    with needing("python: a page that runs Python needs Brython; pip install 'kaju[page]'"):
        import brython
    library = files(brython).joinpath("data")
    stored = library.joinpath("brython_stdlib.js").read_text("utf-8")
    known, _ = json.JSONDecoder().raw_decode(stored[stored.index("{") :])
    needed = {name: known[name] for name in ("math", "_random")}
    parts = (
        'globalThis.__BRYTHON__ = { brython_path: "https://page.invalid/" };',
        library.joinpath("brython.js").read_text("utf-8"),
        f"__BRYTHON__.use_VFS = true; __BRYTHON__.update_VFS({json.dumps(needed)});",
        f"const ENGINE = {json.dumps(text_of('engine.py').replace('# ---- kaju', heart()))};",
        f"const OFFERED = {json.dumps(SMALL)};",
        modules,
        text_of("worker.js"),
    )
    packed = b64encode(zlib.compress("\n".join(parts).encode(), 9)).decode()
    return f'<script type="application/octet-stream" id="kaju-python">{packed}</script>\n'
