"""What holds the sentences of lessons: expressions beside them, worked out by the tests.

Behind a sentence stands ``<!-- ... -->``: expressions of `lesson_measures`, set apart by
semicolons. What is true or false must be true; of all else the values must hold the numbers of the
sentence, to the digits that it gives. A number that stands in an expression is a setting. A field
to fill in is held by the answer in ``toml questions``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import lesson_measures
from lesson_texts import FENCE, MARK, Lesson, lesson

NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?!\w)")
_SENTENCE = re.compile(r".+?(?:[.?!](?=\s|<!--|$)|$)(?:\s*<!--.*?-->)?", re.S)


@dataclass(frozen=True)
class Claim:
    """A sentence of a lesson, the preset that it is said of, and the expressions that hold it."""

    lesson: str
    preset: int
    text: str
    held_by: tuple[str, ...]


def claims(of: Lesson) -> Iterator[Claim]:
    """Return the sentences of a lesson's English text that something holds."""
    for section, text in of.texts["en"].sections.items():
        preset = -1 if section == "Things to try" and of.scenes else 0
        for line in _blocks(section, text):
            preset += line.startswith("### ")
            if line.startswith("### "):
                continue
            for sentence in _SENTENCE.findall(line):
                if marks := MARK.findall(sentence):
                    bare = MARK.sub("", sentence).replace("(1 − β)", "").strip()
                    parts = (part.strip() for mark in marks for part in mark[4:-3].split(";"))
                    yield Claim(of.name, max(preset, 0), bare, tuple(filter(None, parts)))


def _blocks(section: str, text: str) -> Iterator[str]:
    """Return headings, paragraphs, list items and rows of tables; the worksheet has its fields."""
    if section.startswith("Worksheet"):
        return
    text = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", FENCE.sub("\n", text))
    text = re.sub(r"^(?:\d+\.|-) ", "\n", text, flags=re.M)
    text = re.sub(r"^\|[ \w%,]*\|.*\n\|---.*$", "", text, flags=re.M)
    text = re.sub(r"^(\||### .*$)", r"\n\1", text, flags=re.M)
    text = re.sub(r"^(### .*)$", r"\1\n", text, flags=re.M)
    for block in re.split(r"\n\s*\n", text):
        if block.strip():
            yield " ".join(block.split())


def words(of: Lesson, preset: int = 0) -> dict[str, Any]:
    """Return the words in which claims and answers of a lesson are written."""
    if of.scenes:
        return lesson_measures.words_of(_seen(of.name), preset)
    return lesson_measures.recorded(of.name)


@cache
def _seen(name: str) -> list[lesson_measures.Seen]:
    return [lesson_measures.Seen(scene) for scene in lesson(name).scenes]


def value(of: Lesson, expression: str, preset: int = 0) -> Any:
    """Return what an expression says: it is the repository's own text."""
    return eval(expression, words(of, preset))  # noqa: S307


def fault(of: Lesson, claim: Claim) -> str | None:
    """Return why a claim is not held, None if it is."""
    settings, found = list(NUMBER.findall(" ".join(claim.held_by))), []
    for expression in claim.held_by:
        try:
            got = value(of, expression, claim.preset)
        except Exception as error:  # whatever is wrong with it, the sentence is not held
            return f"{expression}: {error!r}"
        if got is False:
            return f"not true: {expression}"
        if not isinstance(got, (bool, str)):
            found += _flat(got)
    for number in NUMBER.findall(claim.text):
        if number not in settings and not any(fits(number, got) for got in found):
            return f"{number} is none of {found}"
    return None


def _flat(value: Any) -> list[float]:
    if isinstance(value, (list, tuple)):
        return [number for part in value for number in _flat(part)]
    return [float(value)]


def fits(number: str, value: float) -> bool:
    """Tell whether a written number is a value, rounded to the digits that are given."""
    whole, _, part = number.replace(",", "").partition(".")
    rounded = len(whole) - len(whole.rstrip("0")) if not part and len(whole) > 2 else 0
    step = 10.0 ** (rounded - len(part))
    return abs(float(number.replace(",", "")) - abs(value)) <= 0.5000001 * step


def answers(of: Lesson, question: int) -> list[float]:
    """Return the answers to the fields of a question, worked out."""
    expressions = of.kinds[question].get("answers", [])
    return _flat([value(of, expression) for expression in expressions])
