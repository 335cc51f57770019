"""Every lesson: its page opens, each preset loads by one click, and what it says is seen."""

import importlib.util
import sys

import pytest

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
