"""Every lesson: its page opens, each preset loads by one click, and what it says is seen."""

import sys
from pathlib import Path

import pytest

import kaju

DOCS = Path(__file__).parents[2] / "docs"
if not DOCS.exists():
    pytest.skip("the lessons are in docs/, which is not here", allow_module_level=True)
sys.path.insert(0, str(DOCS))

from lesson_measures import Seen  # noqa: E402
from lesson_texts import ORDER, lesson  # noqa: E402

RUNNABLE = [name for name in ORDER if lesson(name).scenes]
FEW = ("find-its-way", "blow-up", "walls-and-air")


def free_page(of, folder):
    """Write a lesson's scenes as a page without its questions: everything in it is free."""
    text, (first, *others) = of.texts["en"], of.scenes
    presets = {
        name: (scene, note) for scene, (name, note) in zip(others, text.presets[1:], strict=True)
    }
    words = text.words("What is it?", "How it works", "Things to notice")
    path = folder / f"{of.name}.html"
    return kaju.export_page(first, path, title=text.title, text=words, presets=presets)


@pytest.mark.parametrize(
    "lesson_name", [pytest.param(n, marks=() if n in FEW else pytest.mark.slow) for n in RUNNABLE]
)
def test_lesson_pages_show_the_same(lesson_name, opened, tmp_path):
    of = lesson(lesson_name)
    page = opened(free_page(of, tmp_path))
    page.tab.get_by_role("tab", name="About").click()
    assert page.tab.get_by_role("heading", name="What is it?").is_visible()
    for number, scene in enumerate(of.scenes):
        name = of.texts["en"].presets[number][0] if number else "As it was"
        page.press(name)
        seen = Seen(scene)
        page.until("!page.judging")
        assert page.js("page.certificate.stable") is seen.stable()
        told = seen.verdict().replace(" (accumulate = false)", "")
        assert page.text(".verdict").lower().splitlines()[0] == told.lower()
        if seen.stable():
            page.until("page.run.atRest")
            told = page.js("[page.run.generation, page.run.agents]")
            assert told == [seen.generations(), seen.agents()], name


def test_a_whole_lesson_by_keyboard(opened, tmp_path):
    """Read it, try every preset, find where it turns red, play, step back, read a story, save."""
    of = lesson("blow-up")
    page = opened(free_page(of, tmp_path))
    press = page.tab.keyboard.press

    def go_to(name):
        for _ in range(80):
            press("Tab")
            label = "((at) => at && (at.ariaLabel || (at.labels?.[0] ?? at).innerText))"
            if (page.js(f"{label}(page.root.activeElement)") or "").strip().startswith(name):
                return
        raise AssertionError(f"no key leads to {name!r}")

    def verdict():
        page.until("!page.judging && !page.due")
        return page.text(".verdict").lower().splitlines()[0]

    go_to("Rule")
    press("ArrowLeft")  # round to the last tab
    assert page.tab.get_by_role("heading", name="Things to notice").is_visible()
    for (name, _), scene in list(zip(of.texts["en"].presets, of.scenes, strict=True))[1:]:
        go_to(name)
        press("Enter")
        told = Seen(scene).verdict().replace(" (accumulate = false)", "")
        assert verdict() == told.lower()
    go_to("As it was")
    press("Enter")
    go_to("About")
    press("ArrowRight")
    go_to("α₂")
    for _ in range(10):
        press("ArrowRight")
    assert "every load ends" in verdict()  # 0.5 + 2 · 0.2 + 2 · 0.3 · 0.3 · 0.5 = 0.99
    press("ArrowRight")
    assert "loads stay as they are" in verdict()
    press("ArrowLeft")
    go_to("Picture of the body")
    press("Home")
    press("Space")
    page.until("page.g > 3")
    press(",")
    playing, shown = page.js("[page.playing, page.g]")  # who looks for a generation stays there
    press(",")
    assert (playing, page.js("page.g")) == (False, shown - 1)
    press("ArrowDown")  # to the load, and down from it
    press("ArrowDown")
    page.until("page.parts.story.innerText.includes('(7, 13)')", 20)
    go_to("Save")
    press("Enter")
    go_to("Scene")
    with page.tab.expect_download(timeout=120_000) as download:
        press("Enter")
    download.value.save_as(tmp_path / "mine.toml")
    assert kaju.load_scene(tmp_path / "mine.toml").rule.alpha[1] == pytest.approx(0.5)
