"""Lessons show their page, and names in backticks lead to what they name.

A lesson stays one text: under its title comes the page that runs it, and its code blocks, which
the tests read, and its answers fold. Lists that no hand keeps are put in by `made_lists`.
"""

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from made_lists import with_lists
from sphinx.application import Sphinx

import kaju

FRAME = """
<iframe class="lesson" src="../pages/{name}.html" title="{title}" loading="lazy"
 sandbox="allow-scripts allow-downloads"></iframe>
<p><a href="../pages/{name}.html">Open it alone, or save it and take it along</a></p>
"""
FOLDED = {"toml scene": "The scene", "toml try": "Change this"}
_FENCE = re.compile(r"^```(toml \w+)\n(.*?)^```\n", re.M | re.S)
_HINT = re.compile(r"^(\s+\*Hint:\*)", re.M)
_PAGE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)?pages/[^)]+)\)")


def show_lesson(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put a lesson's page under its title, and fold what is written for the tests."""
    # Pages are made beside the site, which is not asked whether they are there.
    source[0] = with_lists(_PAGE.sub(r'<a href="\2">\1</a>', source[0]))
    if not docname.startswith("lessons/"):
        return
    name = docname.removeprefix("lessons/")
    text = _HINT.sub(r"\n\1", _FENCE.sub(_folded, source[0]))
    text, heading, answers = text.partition("## For the teacher\n")
    text += f"{heading}\n::::{{dropdown}} The answers\n{answers}\n::::\n"
    if (Path(app.srcdir) / "pages" / f"{name}.html").is_file():
        headline, _, rest = text.partition("\n")
        frame = FRAME.format(name=name, title=headline.removeprefix("# "))
        text = f"{headline}\n\n```{{raw}} html\n{frame}```\n{rest}"
    source[0] = text


def _folded(found: re.Match[str]) -> str:
    """Return a block of a lesson that folds; what only the page needs is left out."""
    kind, code = found[1], found[2].rstrip("\n")
    if kind not in FOLDED or not code:
        return ""
    return f"::::{{dropdown}} {FOLDED[kind]}\n```toml\n{code}\n```\n::::\n"


def public_name(role, rawtext, text, lineno, inliner, options=None, content=()):
    """Make single backticks of a docstring code, and a link where the name is public."""
    name = text.removesuffix("()").removeprefix("kaju.")
    literal = nodes.literal(rawtext, text)
    if name.split(".")[0] not in kaju.__all__:
        return [literal], []
    from sphinx.addnodes import pending_xref

    target = f"kaju.{name}"
    link = pending_xref(
        rawtext, literal, refdomain="py", reftype="obj", reftarget=target, refwarn=False
    )
    return [link], []


def escape_bars(*event: Any) -> None:
    """Keep |x| in a docstring from being read as a substitution."""
    lines = event[-1]
    lines[:] = [line if "`" in line else line.replace("|", "\\|") for line in lines]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register both."""
    app.add_role("public_name", public_name)
    app.connect("source-read", show_lesson)
    app.connect("env-get-outdated", lambda *_: ["commands", "stability"])
    app.connect("autodoc-process-docstring", escape_bars)
    return {"parallel_read_safe": True}
