"""Make the lessons' pages, their index and those of the gallery.

A lesson is a text in docs/lessons, in three languages; its page holds all three. Where the rule
runs a lesson has one page with presets; other lessons show recorded runs, one a page. The index
of them all has a card each, with a picture of its run; it reads how far somebody has got from the
browser's own storage, where the lessons write it.
"""

from __future__ import annotations

import argparse
import html
import re
from base64 import b64encode
from dataclasses import replace
from io import BytesIO
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

import lesson_runs
import numpy as np
from lesson_measures import PLANE, answers
from lesson_texts import HEADINGS, ORDER, Lesson, Question, lesson, plain
from matplotlib.figure import Figure

from kaju import FractureModel, GrowthModel, export_page, load_scene, plot

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
AFTER = dict(
    re.findall(r"^\| (\d+) .*\| ([\d, ]*?) *\|$", (HERE / "teach.md").read_text("utf-8"), re.M)
)
"""The numbers of the lessons that each one builds on, as the table for teachers says."""
CODE = """
class Mine(MaterialAgent):

    def emissions(self, load):
        return ...
"""


GUESS = {"en": "Your guess", "de": "Deine Vermutung", "ja": "あなたの予想"}


def page_lesson(of: Lesson) -> dict[str, Any]:
    """Return what a page is told of a lesson: its questions, in all languages."""
    return {
        "key": of.name,
        "title": {k: text.title for k, text in of.texts.items()},
        "index": "index.html",
        "intro": {k: plain(text.sections["What is it?"]) for k, text in of.texts.items()},
        "curves": of.curves or None,
        "minutes": 45,
        "presets": [
            {"name": {k: text.presets[n][0] for k, text in of.texts.items()}}
            for n in range(len(of.scenes))
        ],
        "teacher": {k: text.plan for k, text in of.texts.items()},
        "questions": [_page_question(of, n) for n in range(len(of.kinds))],
    }


def _page_question(of: Lesson, number: int) -> dict[str, Any]:
    """Return what a page is told of a question; its answers are worked out."""
    kind = of.kinds[number]
    asked = {k: text.questions[number] for k, text in of.texts.items()}
    told: dict[str, Any] = {
        "key": kind["key"],
        "step": kind["step"],
        "minutes": asked["en"].minutes,
        "kind": kind.get("kind", "number" if "answers" in kind else "text"),
        "question": {k: q.asks for k, q in asked.items()},
        **{p: {k: getattr(q, p) for k, q in asked.items()} for p in ("note", "hint", "write")},
        "answer": {k: text.answers[number] for k, text in of.texts.items()},
        "show": kind.get("show", {}) | {"preset": kind.get("preset", 0)},
    }
    told |= {name: kind[name] for name in ("until", "lines", "draws", "recalls") if name in kind}
    if kind.get("first"):
        told["guess"] = {"key": f"{kind['key']}-guess", "kind": "text", "lines": 1, "write": GUESS}
    if not of.scenes:
        told["pages"] = pages_of(of, number)
    if "answers" in kind:
        said = asked["en"].asks + asked["en"].note + str(asked["en"].fields)
        told["rounds"] = "rounded" in said  # it says itself how
        told["fields"] = [
            _page_field(asked, n, value, tolerance(kind, n, value)) | _run_of(kind, n)
            for n, value in enumerate(answers(of, number))
        ]
    return told


def _page_field(
    asked: dict[str, Question], number: int, value: float, tolerance: float
) -> dict[str, Any]:
    """Return what a page is told of a field; a unit that is a word stands in its label."""
    label, unit = ({k: q.fields[number][part] for k, q in asked.items()} for part in (0, 1))
    if len(set(unit.values())) > 1:
        label = {k: f"{label[k]} ({unit[k]})" for k in label}
    return {
        "label": label,
        "unit": unit["en"] if len(set(unit.values())) == 1 else "",
        "read_in": unit,
        "key": accepted(value, tolerance),
        "answer": round(value, 6),
        "tolerance": tolerance,
    }


def _run_of(kind: dict[str, Any], field: int) -> dict[str, int]:
    """Return of which preset's run an answer is read; nothing if of several or of none."""
    answer = kind["answers"][min(field, len(kind["answers"]) - 1)]
    words = PLANE.keys() & set(re.findall(r"\w+", answer)) - {"derived"}
    runs = set(re.findall(r"\bp\[(\d+)\]", answer)) or {kind.get("preset", 0)}
    one = words and not words & {"ready", "with_"} and len(runs) == 1
    return {"of": int(runs.pop())} if one else {}


def tolerance(kind: dict[str, Any], field: int, value: float) -> float:
    """Return how far off an answer may be: not at all if counted, else 2 % or two right digits."""
    if "tolerances" in kind:
        return float(kind["tolerances"][field])
    if "tolerance" in kind:
        return float(kind["tolerance"])
    if value == int(value):
        return 0.0
    if kind.get("exact"):
        return 5e-4
    off = max(0.02 * abs(value), abs(float(f"{value:.2g}") - value) + 1e-6)
    step = 10.0 ** floor(log10(off)) / 2  # the next above that is read at a glance: 0.045
    return float(f"{step * ceil(off / step - 1e-6):.2g}")


def accepted(value: float, tolerance: float) -> str:
    """Return an answer to a quarter of what is allowed, and between which numbers it is right."""
    near = tolerance / 4 + 1e-9
    short = next(r for n in range(9) if abs((r := round(value, n)) - value) <= near)
    if tolerance <= 0.004 * abs(value):
        return f"{short:g}"
    step = 10.0 ** floor(log10(near))
    low, high = ceil((value - tolerance) / step - 1e-6), floor((value + tolerance) / step + 1e-6)
    return f"{short:g} ({low * step:g} – {high * step:g})"


def make_lesson(of: Lesson, folder: Path) -> list[Path]:
    """Write the pages of a lesson into a folder; return them."""
    shown = HEADINGS["en"][:3]  # the others would answer the questions
    title = {k: text.title for k, text in of.texts.items()}
    words = {k: text.words(*shown) for k, text in of.texts.items()}
    told = page_lesson(of)
    if of.scenes:
        first, *others = of.scenes
        names = [name for name, _ in of.texts["en"].presets]
        presets = dict(zip(names[1:], others, strict=True))  # notes would answer the questions
        target = folder / f"{of.name}.html"
        options = {"presets": presets, "lesson": told, "python": of.python}
        return [export_page(first, target, title=title, text=words, **options)]
    made = []
    for name in lesson_runs.PAGES[of.name]:
        target = folder / f"{'-'.join(filter(None, (of.name, name)))}.html"
        told["here"] = target.name
        if name:
            calls = {k: text.calls(target.name) for k, text in of.texts.items()}
            title = {k: f"{c[0].upper()}{c[1:]} · {of.texts[k].title}" for k, c in calls.items()}
            told["opens"] = asked_for(of, target.name)
        run = lesson_runs.run(of.name, name)
        made.append(export_page(run, target, title=title, text=words, lesson=told))
    return made


def pages_of(of: Lesson, number: int) -> list[str]:
    """Return the pages that a question asks for, the lesson's first one if it names none."""
    asked = of.texts["en"].questions[number]
    return re.findall(r"\(([\w.-]+\.html)\)", asked.asks + asked.note) or [f"{of.name}.html"]


def asked_for(of: Lesson, page: str) -> int:
    """Return the first question that links to a page, or the first that lets readers try."""
    asked = (f"{q.asks}{q.note}{q.hint}{q.write}" for q in of.texts["en"].questions)
    tries = [kind["step"] for kind in of.kinds].index("try")
    return next((n for n, text in enumerate(asked) if f"({page})" in text), tries)


def make_gallery(folder: Path) -> list[Path]:
    """Write the pages of `gallery.md` and of the first screen; return them."""
    bridge = load_scene(EXAMPLES / "bridge" / "bridge.toml")
    notch = load_scene(EXAMPLES / "notch" / "notch.toml")
    shown = {
        "bridge": GrowthModel(bridge, volume=0.3, filter_radius=2.0),
        "bone": GrowthModel(bridge, rule="remodelling", volume=0.3),
        "notch": FractureModel(notch, strength=50e6, scatter=0.2),
    }
    plate = export_page(lesson("find-its-way").scenes[0], folder / "plate.html")
    return [plate, *(export_page(shown[name].run(), folder / f"{name}.html") for name in shown)]


def write_index(folder: Path) -> Path:
    """Write the index of all lessons into the folder of their pages; return it."""
    cards = "\n".join(_card(lesson(name)) for name in ORDER)
    plans = [f'<a href="{name}.html#teacher">{n + 1}</a>' for n, name in enumerate(ORDER)]
    page = (HERE / "lesson_index.html").read_text("utf-8").replace("{{plans}}", ", ".join(plans))
    target = folder / "index.html"
    target.write_text(page.replace("{{cards}}", cards), encoding="utf-8")
    return target


def _card(of: Lesson) -> str:
    """Return a lesson as a card that leads to its page."""
    number = ORDER.index(of.name) + 1
    named = {k: f"{number} · {text.title}" for k, text in of.texts.items()}
    asks = _in_all({k: text.asks for k, text in of.texts.items()}, "p")
    return (
        f'<a class="card" href="{of.name}.html" data-key="{of.name}" data-age="{of.age}"'
        f' data-after="{AFTER[str(number)]}">{picture(of)}<div>{_in_all(named, "h2")}{asks}'
        '<p class="facts"><span class="age"></span><span class="after"></span>'
        '<span class="done"></span></p></div></a>'
    )


def _in_all(texts: dict[str, str], tag: str) -> str:
    """Return a text in every language, of which the page shows one."""
    parts = (f'<{tag} lang="{k}">{html.escape(text)}</{tag}>' for k, text in texts.items())
    return "".join(parts)


def picture(of: Lesson) -> str:
    """Return a lesson's body and load before the first step: it must not answer a question."""
    figure = _at_rest(of)
    ax = figure.axes[0]
    legend = [ax.legend_] if ax.legend_ else []
    for beside in [*figure.texts, *figure.legends, *figure.axes[1:], *ax.texts, *legend]:
        beside.remove()
    for part in ax.findobj(lambda one: one.get_gid() in ("nodes", "rims")):
        part.set(color="0.5", visible=part.get_gid() == "rims")  # a cut is seen
    for where in ("left", "center", "right"):
        ax.set_title("", loc=where)
    ax.set_axis_off()
    figure.set_layout_engine("none")
    ax.set_anchor("C")
    left, width = (0.5, 0.47) if of.shown == "rule" else (0.03, 0.94)
    ax.set_position((left, 0.03, width, 0.94))
    if of.shown == "cut":
        ax.axhline(0.5 * of.scenes[0].lattice.extent[1], color="#a11a5b", ls="--", lw=2)
    elif of.shown == "rule":
        figure.text(0.05, 0.5, CODE, family="monospace", size=11, va="center", linespacing=1.4)
    figure.set_size_inches(5.6, 2.24)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=100)
    data = b64encode(drawn.getvalue()).decode()
    return f'<img src="data:image/png;base64,{data}" alt="">'


def _at_rest(of: Lesson) -> Figure:
    """Return a picture of what a lesson begins with, whose words are still to be taken out."""
    if of.scenes:
        return plot(of.scenes[0], crop=of.shown == "near")
    run = lesson_runs.run(of.name)
    if hasattr(run, "scene"):
        return plot(run, "scene") if "scene" in run.pictures else plot(run.scene)
    if hasattr(run, "state"):
        run = run.state(0)
    elif hasattr(run, "to_network_result"):
        run = run.to_network_result()
    still = replace(run, displacement=0.0 * run.displacement, tension=0.0 * run.tension)
    return plot(still, record=int(np.argmax(run.stage)))


def make(folder: Path) -> list[Path]:
    """Write the pages of all lessons into a folder, their index, and the gallery's; return them."""
    folder.mkdir(parents=True, exist_ok=True)
    made = [page for name in ORDER for page in make_lesson(lesson(name), folder)]
    return [write_index(folder), *made, *make_gallery(folder)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=HERE / "pages")
    pages = make(parser.parse_args().folder)
    print(f"{len(pages)} pages; the first to open is {pages[0].name}")
