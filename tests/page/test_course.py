"""A class's course: lessons held from their files alone, every answer typed, nothing fetched."""

import re
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
DOCS = Path(__file__).parents[2] / "docs"
if not DOCS.exists():
    pytest.skip("the lessons are in docs/, which is not here", allow_module_level=True)
sys.path.insert(0, str(DOCS))

from lesson_texts import ORDER, lesson  # noqa: E402
from make_pages import make_lesson, page_lesson  # noqa: E402

STEPS = ("predict", "step", "explain", "try")
SENTENCE = "It goes down, and to both sides."
A4 = {"format": "A4", "margin": dict.fromkeys(("top", "bottom", "left", "right"), "14mm")}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Pages of lessons, each made once."""
    folder, made = tmp_path_factory.mktemp("course"), {}

    def file(name):
        made[name] = made.get(name) or make_lesson(lesson(name), folder)
        most = 700_000 if name == "write-the-rule" else 260_000  # with Brython in it
        assert max(path.stat().st_size for path in made[name]) <= most, "it goes by mail"
        return next(path for path in made[name] if path.stem == name)

    return file


def said(question, field):
    """Return a number of the teacher's answer that is right in a field, as a pupil types it."""
    for text in re.findall(r"\d+(?:,\d{3})*(?:\.\d+)?", question["answer"]["en"]):
        typed = text.replace(",", "")
        if abs(float(typed) - field["answer"]) <= field["tolerance"] + 1e-9 * field["answer"]:
            return typed
    raise AssertionError(f"{field['label']['en']}: {question['answer']['en']}")


class ByMouse:
    """A pupil with a mouse."""

    def __init__(self, page):
        self.page = page

    def press(self, locator):
        locator.click()

    def tick(self, cell):
        self.page.click(cell)

    def type_into(self, field, text):
        self.press(field)
        field.press("Control+a")
        field.press("Delete")
        self.page.tab.keyboard.type(text)
        self.page.tab.keyboard.press("Tab")

    def play(self):
        self.press(self.page.tab.get_by_role("button", name="Play"))


def answer(pupil, question):
    """Answer a question of the page by hand: what is wrong is not taken, what is right is."""
    page, tab = pupil.page, pupil.page.tab
    assert tab.locator("h2.question").inner_text() == plain(question["question"]["en"])
    if question["kind"] == "number":
        inputs, told = tab.locator(".fields input"), tab.locator(".fields [role=status]")
        assert inputs.count() == len(question["fields"])
        for n, field in enumerate(question["fields"]):
            wrong = field["answer"] + 3.0 * field["tolerance"] + 0.1 * abs(field["answer"]) + 0.01
            right = said(question, field)
            for typed, verdict in (
                ("much", "a number is needed"),
                (f"{wrong:.6g}", "look again at"),
                (right.replace(".", ","), "as in the picture"),
                (f"{right} {field['unit']}", "as in the picture"),
            ):
                pupil.type_into(inputs.nth(n), typed)
                assert told.nth(n).inner_text().startswith(verdict), (field, typed)
        return
    if question["kind"] == "cells":
        assert page.js("page.limit") == question["until"]
        load = page.js("page.scene.loads[0].cell")
        pupil.tick(load)
        pupil.play()
        page.until(f"page.g === {question['until']} && !page.playing")
        counts = [int(n) for n in tab.locator(".tally b").all_inner_texts()]
        awake = page.js(f"page.run.alive[{question['until']} - 1]")
        assert counts == [1, awake - 1, 0]
    box = tab.get_by_role("textbox")
    pupil.type_into(box, SENTENCE)
    assert tab.get_by_text("as in the picture").count() == 0


def plain(markdown):
    """Return a sentence without its marks."""
    return re.sub(r"\*|\[([^\]]*)\]\([^)]*\)", r"\1", markdown)


def hold(pupil, name):
    """Hold a lesson from its first question to its last, and print it."""
    page, tab, told = pupil.page, pupil.page.tab, page_lesson(lesson(name))
    questions = told["questions"]
    assert page.js("page.g") == 0
    for number, question in enumerate(questions):
        assert page.js("page.lesson.step") == question["step"]
        if question["step"] != "predict":  # what is to be loaded can be
            names = [preset["name"]["en"] for preset in told["presets"]]
            for preset in names:
                assert tab.get_by_role("button", name=preset, exact=True).is_visible()
        answer(pupil, question)
        if number + 1 < len(questions):
            pupil.press(tab.locator(".foot button.main"))
    assert page.js("page.lesson.questions.every((q) => page.lesson.answered(q))")
    assert tab.locator(".steps .done").count() == len(STEPS) - 1
    tab.reload()
    page.until("page?.drawn > 0")
    assert page.js("page.lesson.questions.every((q) => page.lesson.answered(q))")


@pytest.mark.parametrize("name", ORDER)
def test_every_answer_of_a_lesson_is_typed_and_taken(opened, files, name):
    page = opened(files(name))
    hold(ByMouse(page), name)
    paper = page.tab.pdf(**A4)
    assert paper.count(b"/Type /Page\n") <= 2
