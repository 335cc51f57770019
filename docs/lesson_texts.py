"""Read the lessons: docs/lessons/NAME.md, and the same in German and Japanese beside it.

The English text holds what all three share. Its block ``toml lesson`` says for whom it is,
``toml scene`` what its page starts with, ``toml try`` below a heading of the third order what a
preset changes, and ``toml questions`` what kind of question each one of the worksheet is. The
answers there are expressions of `lesson_measures`, worked out when they are asked for: no
language tells a number that another does not.

What stands before the answers for the teacher is the plan of the lesson. In a worksheet a question
begins in bold, ``- label: ___ unit`` is a field to fill in, a last point without a blank says what
to write in words, and ``*Hint:*`` is a hint. What stands in ``<!-- -->`` behind a sentence holds
it: `lesson_measures.py`.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import kaju

LESSONS = Path(__file__).parent / "lessons"
ORDER = tuple(re.findall(r"^lessons/(.+)$", (LESSONS / "../teach.md").read_text("utf-8"), re.M))
"""In which order they are offered: that of the site's menu."""
HEADINGS = {
    "en": [
        *("What is it?", "How it works", "Things to notice", "Things to try"),
        *("Worksheet (45 minutes)", "For the teacher"),
    ]
}
for _own in ("de", "ja"):
    _first = (LESSONS / _own / f"{ORDER[0]}.md").read_text("utf-8")
    HEADINGS[_own] = re.findall(r"^## (.*)$", _first, re.M)
"""What every lesson has, in this order; the English ones also say more for those who program."""
FENCE = re.compile(r"^```(.*?)\n(.*?)^```\n?", re.M | re.S)
MARK = re.compile(r"<!--.*?-->", re.S)
_HINT = re.compile(r"^\s+\*(?:Hint|Tipp|ヒント)[:：]\*\s*", re.M)
_FIELD = re.compile(r"^\s+- (?P<label>.+?)[:：]\s*___ ?(?P<unit>.*)$", re.M)
_WRITE = re.compile(r"^\s+- (.+)$", re.M)
_QUESTION = re.compile(r"\((\d+) (?:min|Min\.|分)\)\s*\*\*(.+?)\*\*\s*(.*)", re.S)


@dataclass(frozen=True)
class Question:
    """A question in one language: fields are pairs of label and unit, `write` asks for words."""

    minutes: int
    asks: str
    note: str
    hint: str
    fields: tuple[tuple[str, str], ...]
    write: str


@dataclass(frozen=True)
class Text:
    """A lesson in one language.

    `sections` are its texts by the English heading, `presets` names and notes, the start first;
    `plan` is how to hold it, and what the presets are for.
    """

    language: str
    title: str
    asks: str
    sections: dict[str, str]
    presets: tuple[tuple[str, str], ...]
    questions: tuple[Question, ...]
    plan: str
    answers: tuple[str, ...]

    def words(self, *headings: str) -> str:
        """Return some of its sections as the page reads them, without what holds them."""
        named = dict(zip(HEADINGS["en"], HEADINGS[self.language], strict=True))
        return "\n\n".join(f"# {named[h]}\n\n{plain(self.sections[h])}" for h in headings)

    def calls(self, page: str) -> str:
        """Return the words that lead to a page beside the lesson's own."""
        return re.findall(
            rf"\[([^]]+)\]\([./]*pages/{re.escape(page)}\)", self.sections["Things to try"]
        )[0]


@dataclass(frozen=True)
class Lesson:
    """A lesson in all its languages, with what they share.

    `scenes` belong to the presets, the start first; there are none where the page shows a
    recorded run. With `python` agents are written in the page. `shown` is what the picture in
    the index has besides the body: "near" the load only, a "cut", a "rule"; `curves` are those
    that the page shows, if not all. `kinds` says of each question what the page has to know.
    """

    name: str
    age: int
    python: bool
    shown: str
    curves: tuple[str, ...]
    texts: dict[str, Text]
    scenes: tuple[kaju.Scene, ...]
    kinds: tuple[dict[str, Any], ...]


def plain(markdown: str) -> str:
    """Return a text as a page shows it: no programs, links to pages beside it."""
    text = MARK.sub("", FENCE.sub("", markdown)).replace("../pages/", "")
    return re.sub(r"\n{3,}", "\n\n", text).strip()


def lesson(name: str) -> Lesson:
    """Read a lesson in all languages."""
    source = (LESSONS / f"{name}.md").read_text("utf-8")
    blocks = dict(FENCE.findall(source))
    paths = {k: LESSONS / k.replace("en", "") / f"{name}.md" for k in HEADINGS}
    texts = {k: _text(path.read_text("utf-8"), k) for k, path in paths.items()}
    scenes = []
    if "toml scene" in blocks:
        scene = kaju.Scene.from_toml(blocks["toml scene"])
        for part in re.split(r"^### ", source, flags=re.M)[1:]:
            own = dict(FENCE.findall(part))
            rows = re.findall(r"^(\S+) = (.+)$", own["toml try"], re.M)
            changes = {key: tomllib.loads(f"is = {value}")["is"] for key, value in rows}
            scenes.append(scene.with_overrides(changes) if changes else scene)
    kinds = tomllib.loads(blocks["toml questions"])["question"]
    told = tomllib.loads(blocks["toml lesson"])
    look = told.get("python", False), told.get("shown", ""), tuple(told.get("curves", ()))
    return Lesson(name, told["age"], *look, texts, tuple(scenes), tuple(kinds))


def _text(source: str, language: str) -> Text:
    """Read one language of a lesson."""
    parts = re.split(r"^## (.*)\n", source, flags=re.M)
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    sections = {
        english: found[own].strip()
        for english, own in zip(HEADINGS["en"], HEADINGS[language], strict=True)
    }
    notes = re.split(r"^### ", sections["Things to try"], flags=re.M)[1:]
    presets = [(part.partition("\n")[0], plain(part.partition("\n")[2])) for part in notes]
    points = [f"- **{name}**: {' '.join(note.split())}" for name, note in presets]
    plan = re.split(r"^1\. ", sections["For the teacher"], flags=re.M)[0]
    asks = re.search(r"^> (.*)$", parts[0], flags=re.M)
    assert asks, f"{language}: the line '> ...' that asks the lesson's question is missing"
    return Text(
        language=language,
        title=source.split("\n", 1)[0].removeprefix("# "),
        asks=asks[1],
        sections=sections,
        presets=tuple(presets),
        questions=tuple(_question(item) for item in items(sections["Worksheet (45 minutes)"])),
        plan="\n\n".join([plain(plan), "\n".join(points)]),
        answers=tuple(plain(item) for item in items(sections["For the teacher"])),
    )


def items(section: str) -> list[str]:
    """Return the items of a numbered list, without their numbers."""
    return [part.strip() for part in re.split(r"^\d+\. ", FENCE.sub("", section), flags=re.M)[1:]]


def _question(item: str) -> Question:
    """Read a question of the worksheet."""
    body, *hint = _HINT.split(item)
    fields = tuple((m["label"], m["unit"].strip()) for m in _FIELD.finditer(body))
    asked, *write = _WRITE.split(_FIELD.sub("", body).strip())
    read = _QUESTION.match(asked.strip())
    assert read, f"a question is '(10 min) **What?** ...', got {item!r:.60}"
    parts = (plain(part.replace("\n   ", "\n")) for part in (read[2], read[3], "".join(hint)))
    return Question(int(read[1]), *parts, fields, plain("".join(write)))
