"""Lessons in which the rule runs: docs/lessons/NAME.md becomes docs/pages/NAME.html.

A lesson is one text. Its block ``toml scene`` is what the page starts with; each heading of the
third order with a block ``toml try`` is a preset, and its block ``toml see`` says what is to be
observed there, which the tests check. `make_pages.py` builds them with the other lessons.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import kaju

LESSONS = Path(__file__).parent / "lessons"
_FENCE = re.compile(r"^```(.*?)\n(.*?)^```\n?", re.M | re.S)


@dataclass(frozen=True)
class Preset:
    """Something to try: a scene, what to look for, and what is then seen."""

    name: str
    note: str
    scene: kaju.Scene
    see: dict[str, Any]


@dataclass(frozen=True)
class Lesson:
    """A lesson: its headline, its words without code, and its presets, the first of all first."""

    name: str
    title: str
    words: str
    presets: tuple[Preset, ...]


def lesson(path: Path) -> Lesson:
    """Read a lesson."""
    text = path.read_text("utf-8")
    blocks = dict(_FENCE.findall(text))
    scene = kaju.Scene.from_toml(blocks["toml scene"])
    presets = []
    for part in re.split(r"^### ", text, flags=re.M)[1:]:
        own = dict(_FENCE.findall(part))
        name, _, rest = part.partition("\n")
        changes = _flat(tomllib.loads(own["toml try"]))
        see = tomllib.loads(own["toml see"])
        note = rest[: rest.index("```")].strip()
        presets.append(Preset(name, note, scene.with_overrides(changes) if changes else scene, see))
    title = text.split("\n", 1)[0].removeprefix("# ")
    words = _FENCE.sub("", text).split("\n", 1)[1].split("## Extending it")[0]
    return Lesson(path.stem, title, _paragraphs(words), tuple(presets))


def lessons() -> list[Lesson]:
    """Read all lessons in which the rule runs."""
    texts = sorted(LESSONS.glob("*.md"))
    return [lesson(path) for path in texts if "```toml scene" in path.read_text("utf-8")]


def _flat(table: dict[str, Any], start: str = "") -> dict[str, Any]:
    """Return nested tables by key paths: rule.alpha, loads.0.force."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        nested = isinstance(value, dict)
        found |= _flat(value, f"{start}{key}.") if nested else {f"{start}{key}": value}
    return found


def _paragraphs(words: str) -> str:
    """Set headings apart from what follows them, as the page reads its text."""
    return re.sub(r"^(#+ .*)$", r"\n\1\n", words, flags=re.M).replace("`", "")


def observe(scene: kaju.Scene) -> dict[str, Any]:
    """Return what can be seen when a scene is run: the vocabulary of ``toml see``.

    Returns
    -------
    dict
        generations, agents, depth (rows from the top that woke), stable, verdict, radius
        (multiple of load a generation), pulls (whether any load pulls), tip (which way the
        loaded cell moves, 1 up, -1 down), widening (spread of the downward loads at 32 rows
        over that at 8), shadow (load taken in the middle of the bottom row over the row's mean).
    """
    certificate = kaju.stability(scene)
    seen: dict[str, Any] = {
        "stable": certificate.stable,
        "verdict": certificate.verdict,
        "radius": round(certificate.upper, 6),
    }
    if not certificate.stable:
        return seen
    result = kaju.LoadModel(scene, engine="arrays").run()
    last, (nx, ny) = result.last, scene.lattice.shape
    down = np.zeros((nx, ny))
    down[tuple(last.cells.T)] = (last.taken - last.pulled)[:, 2]
    seen |= {
        "generations": last.generations,
        "agents": len(last.cells),
        "depth": int(ny - last.cells[:, 1].min()) if len(last.cells) else 0,
        "pulls": bool(last.pulled.any()),
        "shadow": float(down[nx // 2, 0] / down[:, 0].mean()) if down[:, 0].any() else 0.0,
    }
    if len(last.cells):
        top = scene.applied().cells[:1]
        moved = result.displacement_at(scene.lattice.centres(top))[0, 1]
        seen["tip"] = int(np.sign(moved))
    if ny > 32:
        seen["widening"] = float(_spread(down[:, ny - 33]) / _spread(down[:, ny - 9]))
    return seen


def _spread(load: np.ndarray) -> float:
    place = np.arange(len(load))
    middle = (load * place).sum() / load.sum()
    return float(np.sqrt((load * (place - middle) ** 2).sum() / load.sum()))


def build(found: Lesson, folder: Path) -> Path:
    """Write the page of a lesson."""
    first = found.presets[0].scene
    presets = {p.name: (p.scene, p.note) for p in found.presets[1:]}
    path = folder / f"{found.name}.html"
    return kaju.export_page(first, path, title=found.title, text=found.words, presets=presets)
