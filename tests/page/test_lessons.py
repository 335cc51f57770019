"""The pages of the lessons: made, opened and played; the texts themselves are doctests."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def lessons():
    spec = importlib.util.spec_from_file_location("make_pages", DOCS / "make_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_lesson_s_page_tells_no_program_and_no_answers(lessons):
    for lesson in lessons.PAGES:
        title, text = lessons.told(lesson)
        assert title
        for heading in ("# What is it?", "# How it works", "# Things to notice", "# Things to try"):
            assert f"{heading}\n" in text
        for foreign in ("```", ">>>", "|", "](", "Worksheet", "For the teacher"):
            assert foreign not in text


def test_every_page_that_a_lesson_points_to_is_made(lessons):
    made = {
        f"{'-'.join(filter(None, (lesson, name)))}.html"
        for lesson, pages in lessons.PAGES.items()
        for name in pages
    }
    for lesson in lessons.PAGES:
        text = (DOCS / "lessons" / f"{lesson}.md").read_text("utf-8")
        pointed = {part.split(")")[0] for part in text.split("](../pages/")[1:]}
        assert pointed
        assert pointed <= made
        assert {name for name in made if name.startswith(lesson)} == pointed


@pytest.mark.slow
def test_every_page_is_played_to_its_end(lessons, opened, tmp_path):
    for path in lessons.make(tmp_path):
        page = opened(path)
        page.tab.keyboard.press("Home")
        first = page.js("page.canvas.toDataURL()")
        page.tab.keyboard.press("End")
        page.tab.wait_for_timeout(200)
        words = page.tab.locator(".count").inner_text()
        end, count = words.split(" · ")[1].split(" of ")
        assert end == count
        assert int(count) >= 4
        assert page.js("(page.draw(), page.canvas.toDataURL())") != first
        assert page.messages == []
        assert page.requests == [path.as_uri()]
