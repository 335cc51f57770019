"""The index of the lessons: a picture of what will be seen, its question, minutes and age.

The pictures are those of `kaju.plot`, of the lessons' own runs. The file needs no other, and no
network; it reads how far somebody has got from the browser's own storage, where the lessons write
it.
"""

from __future__ import annotations

import html
from base64 import b64encode
from io import BytesIO
from pathlib import Path

import lesson_runs
from lesson_texts import ORDER, Lesson, lesson

from kaju import LoadModel, plot

SHOWN = {
    "find-its-way": ("0", "agents"),
    "write-the-rule": ("0", "agents"),
    "walls-and-air": ("0", "agents"),
    "blow-up": ("1", "agents"),
    "arching": ("1", "agents"),
    "who-holds-the-load": ("0", "cuts"),
    "root-depth": ("0", "von_mises"),
    "the-right-numbers": ("0", "deformed"),
    "agents-of-many-sizes": ("rough", "agents"),
    "two-wrong-answers": ("", "deformed"),
    "a-lattice-bends": ("0.2-N", "deformed"),
    "a-noodle-remembers": ("", "curves"),
    "bones-and-bridges": ("", "design"),
    "how-things-break": ("long", "crack"),
    "a-round-hole": ("", "agents"),
}
"""Of which preset or page of a lesson which picture is shown."""
TEMPLATE = (Path(__file__).parent / "lesson_index.html").read_text("utf-8")
"""The page round the cards."""


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
    """Return what will be seen in a lesson, without words and scales."""
    which, what = SHOWN[of.name]
    if of.scenes:
        result = LoadModel(of.scenes[int(which)], engine="arrays", allow_unstable=True).run()
    else:
        result = lesson_runs.run(of.name, which)
    shown = plot(result, what)
    figure = getattr(shown, "figure", None) or shown
    ax = figure.axes[0]
    for beside in [*figure.texts, *figure.legends, *figure.axes]:
        if beside is not ax:
            beside.remove()
    for words in [*ax.texts, *([ax.legend_] if ax.legend_ else [])]:
        words.remove()
    for where in ("left", "center", "right"):
        ax.set_title("", loc=where)
    ax.set_axis_off()
    ax.set_subplotspec(figure.add_gridspec(1, 1)[0])
    figure.set_size_inches(5.6, 2.24)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=100)
    data = b64encode(drawn.getvalue()).decode()
    return f'<img src="data:image/png;base64,{data}" alt="">'
