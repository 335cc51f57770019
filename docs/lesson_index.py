"""The index of the lessons: a picture of what will be seen, its question, minutes and age.

The pictures are drawn from the lessons' own runs. The file needs no other, and no network; it
reads how far somebody has got from the browser's own storage, where the lessons write it.
"""

from __future__ import annotations

import html
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lesson_runs
import numpy as np
from lesson_claims import words
from lesson_texts import ORDER, Lesson, lesson

STEPS = (
    *("#cdeabb", "#aedfb5", "#8ad1bc", "#62c2c2", "#3ea9c4"),
    *("#2588bb", "#2566aa", "#1c4490", "#102670"),
)
"""Colours of a quantity: far from the paper is more."""
LOAD, RULE, ELASTIC, SLEEPING = "#b33a08", "#0b5cad", "#a11a5b", "#d5d9de"
WIDTH, HEIGHT = 280, 112


def write_index(folder: Path) -> Path:
    """Write the index of all lessons into the folder of their pages; return it."""
    lessons = [lesson(name) for name in ORDER]
    cards = "\n".join(_card(found) for found in lessons)
    ages = sorted({found.age for found in lessons})
    page = TEMPLATE.replace("{{cards}}", cards).replace("{{ages}}", str(ages))
    target = folder / "index.html"
    target.write_text(page, encoding="utf-8")
    return target


def _card(of: Lesson) -> str:
    """Return a lesson as a card that leads to its page."""
    minutes = sum(question.minutes for question in of.texts["en"].questions)
    title = _in_all({k: text.title for k, text in of.texts.items()}, "h2")
    asks = _in_all({k: text.asks for k, text in of.texts.items()}, "p")
    return (
        f'<a class="card" href="{of.name}.html" data-key="{of.name}" data-age="{of.age}" '
        f'data-minutes="{minutes}">{picture(of)}<div>{title}{asks}'
        '<p class="facts"><span class="minutes"></span><span class="age"></span>'
        '<span class="done"></span></p></div></a>'
    )


def _in_all(texts: dict[str, str], tag: str) -> str:
    """Return a text in every language, of which the page shows one."""
    parts = (f'<{tag} lang="{k}">{html.escape(text)}</{tag}>' for k, text in texts.items())
    return "".join(parts)


def picture(of: Lesson) -> str:
    """Return what will be seen in a lesson, drawn from its own run."""
    drawn = PICTURES[of.name](words(of))
    box = f'viewBox="0 0 {WIDTH} {HEIGHT}"'
    return f'<svg {box} role="img" aria-hidden="true">{drawn}</svg>'


def _rect(x: float, y: float, wide: float, high: float, colour: str) -> str:
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{wide:.1f}" height="{high:.1f}" fill="{colour}"/>'


def _line(points: Any, colour: str, width: float = 2.0, dash: str = "") -> str:
    joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return (
        f'<polyline points="{joined}" fill="none" stroke="{colour}" stroke-width="{width:g}"'
        f"{dashed}/>"
    )


def _colour(values: Any) -> list[str]:
    """Return colours of positive values on a logarithmic scale of three decades."""
    level = 1.0 + np.log10(np.maximum(np.asarray(values) / np.max(values), 1e-3)) / 3.0
    return [STEPS[round(float(step) * (len(STEPS) - 1))] for step in level]


def _body(seen: Any, rows: int | None = None) -> str:
    """Draw loads taken in the upper rows of a body."""
    wide, high = seen.scene.lattice.shape
    rows = rows or high
    edge = min((WIDTH - 40) / wide, (HEIGHT - 12) / rows)
    left = 0.5 * (WIDTH - edge * wide)

    def square(cell: Any, colour: str) -> str:
        place = left + cell[0] * edge, 6 + (high - 1 - cell[1]) * edge
        return _rect(*place, edge - 0.5, edge - 0.5, colour)

    box = np.stack(np.meshgrid(np.arange(wide), np.arange(high - rows, high)), -1).reshape(-1, 2)
    drawn = [square(cell, SLEEPING) for cell in box[seen.scene.kinds(box) >= 0]]
    stage = seen.run.last
    colours = _colour(stage.taken.sum(axis=1))
    there = [i for i, cell in enumerate(stage.cells) if cell[1] >= high - rows]
    return "".join(drawn + [square(stage.cells[i], colours[i]) for i in there])


def _curves(x: Any, *drawn: tuple[Any, str, str]) -> str:
    """Draw curves (values, colour, dashes) over axes, scaled into the picture from zero on."""
    high = max(np.max(values) for values, _, _ in drawn)
    across = 40 + (WIDTH - 80) * np.asarray(x) / np.max(x)
    lines = []
    for values, colour, dash in drawn:
        up = HEIGHT - 14 - (HEIGHT - 30) * np.asarray(values) / high
        lines.append(_line(np.stack([across, up], axis=1), colour, 2.5, dash))
    axes = _line([(40, 10), (40, HEIGHT - 14), (WIDTH - 36, HEIGHT - 14)], "#4d5661", 1.0)
    return "".join(lines) + axes


def _fitted(place: Any, margin: tuple[float, float]) -> Any:
    """Return places (m, upwards) in the middle of the picture, as large as the margins let."""
    place = place - place.min(axis=0)
    size = place.max(axis=0)
    scale = ((WIDTH, HEIGHT) - 2.0 * np.array(margin)) / size
    at = place * scale.min()
    return at * [1.0, -1.0] + [0.5 * (WIDTH - at[:, 0].max()), HEIGHT - margin[1]]


def _bounces(see: dict[str, Any]) -> str:
    """Draw the column that a load runs down and up, generation by generation: row over time."""
    times = range(1, see["generations"]() + 1)
    rows = [(g, see["load_at"](g), see["pull_in"](g)) for g in times]
    step, edge = (WIDTH - 60) / len(rows), (HEIGHT - 20) / see["depth"]()
    colours = {False: RULE, True: ELASTIC}
    return "".join(
        _rect(
            30 + step * (g - 1), HEIGHT - 10 - edge * (row + 1), step - 1, edge - 1, colours[pull]
        )
        for g, row, pull in rows
    )


def _growth(see: dict[str, Any]) -> str:
    """Draw the load on its way at the usual numbers and just below the limit."""
    generations = np.arange(0, 21)
    grows, ends = (see["p"][n].radius() ** generations for n in (1, 0))
    return _curves(generations, (grows, LOAD, ""), (ends, RULE, ""))


def _cuts(see: dict[str, Any]) -> str:
    """Draw the force through each cut, and the line that elasticity keeps."""
    cuts = see["cuts"]()[:12]
    high, longest = (HEIGHT - 16) / len(cuts), max(cuts)
    bars = [
        _rect(60, 8 + n * high, max(150 * cut / longest, 0.5), high - 2, RULE)
        for n, cut in enumerate(cuts)
    ]
    line = 60 + 150 * see["put_on"]() / longest
    return "".join(bars) + _line([(line, 4), (line, HEIGHT - 4)], ELASTIC, 2.5, "5 4")


def _widths(see: dict[str, Any]) -> str:
    """Draw half widths over the depth: the rule, and elasticity."""
    rows = np.array([2, 5, 10, 15, 20, 25])
    rule, elastic = (
        [see[k](int(row)) for row in rows] for k in ("half_width", "elastic_half_width")
    )
    return _curves(rows, (rule, RULE, ""), (elastic, ELASTIC, "5 4"))


def _numbers(see: dict[str, Any]) -> str:
    """Draw how far the cells below the load move: chosen, fitted, elastic."""
    rows = np.arange(10)
    chosen, fitted = ([p.moved(5, 9 - int(r)) for r in rows] for p in see["p"][:2])
    elastic = [see["elastic_moved"](5, 9 - int(r)) for r in rows]
    return _curves(rows, (chosen, RULE, ""), (fitted, LOAD, ""), (elastic, ELASTIC, "5 4"))


def _sizes(see: dict[str, Any]) -> str:
    """Draw the agents of many sizes, the smallest the darkest."""
    result = lesson_runs.run("agents-of-many-sizes", "rough")
    scale = (HEIGHT - 12) / 0.2
    colours = _colour(result.size.min() / result.size)
    left = 0.5 * (WIDTH - 0.2 * scale)
    squares = zip(result.middle, result.size, colours, strict=True)
    return "".join(
        _rect(
            left + (x - s / 2) * scale,
            6 + (0.2 - y - s / 2) * scale,
            s * scale - 0.3,
            s * scale - 0.3,
            c,
        )
        for (x, y), s, c in squares
    )


def _bounds(see: dict[str, Any]) -> str:
    """Draw the pairs of wrong answers, which close in on the truth."""
    low, high = see["low"](10), see["high"](10)
    place = lambda energy: 30 + (WIDTH - 60) * (energy - low) / (high - low)  # noqa: E731
    bars = []
    for n, cells in enumerate((10, 20, 40, 80)):
        ends, y = (place(see["low"](cells)), place(see["high"](cells))), 18 + 26 * n
        bars.append(_rect(ends[0], y - 5, ends[1] - ends[0], 10, "#cfe3f5"))
        bars.append(
            _rect(ends[0] - 2, y - 8, 4, 16, RULE) + _rect(ends[1] - 2, y - 8, 4, 16, ELASTIC)
        )
    return "".join(bars)


def _lattice(see: dict[str, Any]) -> str:
    """Draw the bent lattice: what is pressed, and what is pulled."""
    result = see["run"]("0.2-N")
    at = _fitted(result.positions(), (20, 8))
    pulled = result.tension[-1] > 0.0
    return "".join(
        _line(at[ends], LOAD if pull else RULE, 1.5)
        for ends, pull in zip(result.network.springs, pulled, strict=True)
    )


def _noodle(see: dict[str, Any]) -> str:
    """Draw the dent over time."""
    times = np.linspace(0.0, 27.0, 109)
    return _curves(times, ([see["dent"](float(t)) for t in times], RULE, ""))


def _bridge(see: dict[str, Any]) -> str:
    """Draw the bridge that has grown."""
    density = see["run"]().density
    edge = (HEIGHT - 10) / density.shape[1]
    left = 0.5 * (WIDTH - edge * len(density))
    return "".join(
        _rect(left + edge * x, HEIGHT - 5 - edge * (y + 1), edge, edge, STEPS[int(8 * value)])
        for (x, y), value in np.ndenumerate(density)
        if value > 0.1
    )


def _crack(see: dict[str, Any]) -> str:
    """Draw the net that has parted: what is left, and what broke."""
    result = see["run"]("long")
    at = _fitted(result.network.positions, (4, 4))
    springs, broken = result.network.springs, set(result.broken.tolist())
    left = [_line(at[ends], RULE, 0.5) for k, ends in enumerate(springs) if k not in broken]
    return "".join([*left, *(_line(at[springs[k]], LOAD, 1.5) for k in sorted(broken))])


def _hole(see: dict[str, Any]) -> str:
    """Draw a quarter of the plate, agents cut by the hole, the most loaded ones the darkest."""
    result = see["run"]("coarse")
    agent, pieces = result.pieces()
    colours = _colour(result.von_mises / result.von_mises.max())
    scale, drawn = (HEIGHT - 12) / 0.1, []
    for which, corners in zip(agent, pieces, strict=True):
        at = np.array([0.5 * (WIDTH - 0.1 * scale), HEIGHT - 6]) + corners * [scale, -scale]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        drawn.append(f'<polygon points="{points}" fill="{colours[which]}" stroke="white"/>')
    return "".join(drawn)


PICTURES: dict[str, Callable[[dict[str, Any]], str]] = {
    "find-its-way": lambda see: _body(see["p"][0], 10),
    "walls-and-air": _bounces,
    "blow-up": _growth,
    "arching": lambda see: _body(see["p"][1]),
    "who-holds-the-load": _cuts,
    "root-depth": _widths,
    "the-right-numbers": _numbers,
    "agents-of-many-sizes": _sizes,
    "two-wrong-answers": _bounds,
    "a-lattice-bends": _lattice,
    "a-noodle-remembers": _noodle,
    "bones-and-bridges": _bridge,
    "how-things-break": _crack,
    "a-round-hole": _hole,
}
"""How a lesson's picture is drawn."""
TEMPLATE = (Path(__file__).parent / "lesson_index.html").read_text("utf-8")
"""The page round the cards."""
