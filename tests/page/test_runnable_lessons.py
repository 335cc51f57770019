"""Every lesson: its page opens, each preset loads by one click, and what it says is seen."""

import importlib.util
import sys

import pytest

import kaju

HEADINGS = [
    "What is it?",
    "How it works",
    "Things to notice",
    "Things to try",
    "Extending it",
    "Related",
    "Sources",
    "Worksheet (45 minutes)",
    "For the teacher",
]


@pytest.fixture(scope="module")
def builder(pytestconfig):
    path = pytestconfig.rootpath / "docs" / "runnable_lessons.py"
    if not path.exists():
        pytest.skip("the lessons are in docs/, which is not here")
    spec = importlib.util.spec_from_file_location("runnable_lessons", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["runnable_lessons"] = module
    spec.loader.exec_module(module)
    return module


def test_lessons_say_what_is_seen(builder):
    lessons = builder.lessons()
    assert len(lessons) >= 5
    for lesson in lessons:
        text = (builder.LESSONS / f"{lesson.name}.md").read_text("utf-8")
        headings = [line[3:] for line in text.splitlines() if line.startswith("## ")]
        assert headings == HEADINGS, lesson.name
        assert len(lesson.presets) >= 2
        for preset in lesson.presets:
            seen = builder.observe(preset.scene)
            assert preset.see, preset.name
            for key, value in preset.see.items():
                wanted = pytest.approx(value, rel=0.01) if isinstance(value, float) else value
                assert seen[key] == wanted, (lesson.name, preset.name, key)


def test_lesson_pages_show_the_same(builder, opened, tmp_path):
    for lesson in builder.lessons():
        page = opened(path := builder.build(lesson, tmp_path))
        about = page.tab.get_by_role("tab", name="About")
        about.click()
        assert page.tab.get_by_role("heading", name="What is it?").is_visible()
        for preset in lesson.presets:
            first = preset is lesson.presets[0]
            name = "As it was" if first else preset.name
            page.tab.get_by_role("button", name=name, exact=True).click()
            seen = builder.observe(preset.scene)
            page.until("!page.judging")
            assert page.js("page.certificate.stable") is seen["stable"]
            verdict = page.tab.locator(".verdict").inner_text()
            assert verdict.lower() == seen["verdict"].lower()
            if seen["stable"]:
                page.until("page.run.atRest")
                told = page.js("[page.run.generation, page.run.agents]")
                assert told == [seen["generations"], seen["agents"]], (lesson.name, preset.name)
        page.tab.get_by_role("button", name="As it was").click()
        page.tab.get_by_role("button", name="Play").click()
        page.until("page.g > 1")
        assert page.requests == [path.as_uri()]
        assert page.messages == []


def test_a_whole_lesson_by_keyboard(builder, opened, tmp_path):
    """Read it, try every preset, find where it turns red, play, step back, read a story, save."""
    lesson = next(lesson for lesson in builder.lessons() if lesson.name == "blow-up")
    page = opened(builder.build(lesson, tmp_path))
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
        return page.tab.locator(".verdict").inner_text().lower()

    go_to("Rule")
    press("ArrowLeft")  # round to the last tab
    assert page.tab.get_by_role("heading", name="Things to notice").is_visible()
    for preset in lesson.presets[1:]:
        go_to(preset.name)
        press("Enter")
        assert verdict() == builder.observe(preset.scene)["verdict"].lower()
    go_to("As it was")
    press("Enter")
    go_to("About")
    press("ArrowRight")
    go_to("α₂")
    for _ in range(10):
        press("ArrowRight")
    assert "every load ends" in verdict()  # 0.5 + 2 · 0.2 + 2 · 0.3 · 0.3 · 0.5 = 0.99
    press("ArrowRight")
    assert "loads grow by 0 %" in verdict()
    press("ArrowLeft")
    go_to("Picture of the body")
    press("Home")
    press("Space")
    page.until("page.g > 3")
    press("Space")
    shown = page.js("page.g")
    press(",")
    assert page.js("page.g") == shown - 1
    press("ArrowDown")  # to the load, and down from it
    press("ArrowDown")
    page.until("page.parts.story.querySelector('dl')")
    assert page.tab.locator(".story").inner_text().startswith("Cell (7, 13), steel")
    go_to("Save")
    press("Enter")
    go_to("Scene")
    with page.tab.expect_download() as download:
        press("Enter")
    download.value.save_as(tmp_path / "mine.toml")
    assert kaju.load_scene(tmp_path / "mine.toml").rule.alpha[1] == pytest.approx(0.5)
    assert page.messages == []
