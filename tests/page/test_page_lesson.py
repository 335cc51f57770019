"""A lesson in the page: asked before it is shown, kept, judged, printed; the rule in one cell."""

import numpy as np
import pytest
from page_scenes import described
from plates import PLATE

import kaju
from kaju import LoadModel, Scene

GUESS = {1: [(10, 19)], 2: [(9, 18), (10, 18), (11, 18)], 3: [(x, 17) for x in range(8, 13)]}
LESSON = {
    "key": "tested",
    "minutes": 45,
    "teacher": "Let them *guess* first.",
    "presets": [
        {"name": {"en": "As given", "de": "Wie gegeben", "ja": "そのまま"}, "note": ""},
        {"name": {"en": "Finer", "de": "Feiner", "ja": "細かく"}, "note": "A **tenth**."},
    ],
    "questions": [
        {
            "key": "wake",
            "step": "predict",
            "kind": "cells",
            "minutes": 10,
            "until": 3,
            "question": {"en": "Who wakes?", "de": "Wer erwacht?", "ja": "誰が目覚める？"},
            "answer": "Nine cells.",
        },
        {
            "key": "shares",
            "step": "step",
            "kind": "number",
            "minutes": 10,
            "question": "What does the loaded cell keep?",
            "note": "Click it. Say **why**.",
            "lines": 2,
            "draws": [[["s", -2, 8], ["mm", 0, 40]], [["root", 0, 6], ["cells", 0, 3]]],
            "fields": [{"label": "keeps", "unit": "N", "answer": 1.0, "tolerance": 0.01}],
            "show": {"mode": "cell", "cell": [10, 19], "generation": 1},
        },
        {"key": "why", "step": "explain", "kind": "text", "question": "Why?", "lines": 4},
        {"key": "sentence", "step": "try", "kind": "text", "question": "One sentence.", "lines": 4},
    ],
}


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "lesson.html"
    title = {"en": "A load's way", "de": "Der Weg einer Last", "ja": "荷重の道"}
    finer = Scene(**PLATE, rule={"kind": "prescribed", "threshold": 0.001})
    return kaju.export_page(
        Scene(**PLATE),
        path,
        title=title,
        text="## What is it?\n\nA plate with *one* load and **two** words.\n\n- one\n- two",
        presets={"Finer": (finer, "A **tenth**.")},
        lesson=LESSON,
    )


def tick_guess(page):
    for generation, cells in GUESS.items():
        page.tab.locator(".bar").get_by_role("button", name=str(generation), exact=True).click()
        for cell in cells:
            page.click(cell)


def test_a_lesson_opens_at_rest_and_hides_what_answers_it(opened, lesson):
    page = opened(lesson)
    assert page.text(".count") == "Generation 0"
    assert page.tab.locator(".verdict").count() == 0
    assert page.js("(page.seek(7), page.g)") == 0
    page.click((10, 19))
    page.press("Play")
    assert page.text(".saved").startswith("Still open: Generation 2 · Generation 3 – press again")
    assert page.js("[page.playing, (page.seek(1), page.g)]") == [False, 0]  # the same press
    page.press("One step on")
    assert page.js("[page.g, page.lesson.forget()]") == [1, None]
    tick_guess(page)
    assert page.js("(page.seek(7), page.g)") == 3
    page.tab.locator("summary", has_text="Teacher").click()
    page.tab.get_by_role("switch", name="Teacher").check()
    assert page.tab.get_by_text("Let them guess first.").is_visible()
    assert page.tab.get_by_text("Nine cells.").is_visible()
    assert page.js("(page.seek(Infinity), page.g)") == 8


def test_a_guess_is_laid_over_what_happens_and_kept(opened, lesson):
    """Of nine cells that wake by generation 3, three were ticked for it; six ticks are wrong."""
    page = opened(lesson)
    tick_guess(page)
    page.click((8, 17))  # a second click takes a tick back
    assert page.js("Object.keys(page.lesson.guess).length") == 8
    page.tab.keyboard.press("Control+z")
    assert page.js("Object.keys(page.lesson.guess).length") == 9
    page.js("page.look.speed = 30")
    page.press("Play")
    page.until("page.g === 3 && !page.playing")
    counts = page.tab.locator(".tally b").all_inner_texts
    assert counts() == ["3", "4", "6"]
    page.press("Generation 2", exact=False)
    page.until("page.g === 2 && (page.draw(), page.drawn)")
    assert counts() == ["2", "2", "2"]
    page.tab.get_by_role("textbox").fill("It goes sideways first")
    page.tab.reload()
    page.until("page?.drawn > 0")
    assert page.tab.get_by_role("textbox").input_value() == "It goes sideways first"
    assert page.js("Object.values(page.lesson.guess).length") == 9
    assert page.tab.get_by_text("Saved on this computer").is_visible()
    page.js("(page.lesson.go(1), page.draw())")
    assert "Passed on" not in page.text("aside")  # arrows say it: pushes outwards add up to none
    page.js("page.lesson.questions.map((q) => page.lesson.answer(q, q.fields ? [...'1x'] : 'x'))")
    page.js("(page.lesson.go(4), page.rebuild())")
    both = page.tab.locator("aside .grids figure")  # in the end the guess stands beside the truth
    assert [one.locator("rect:not([fill='#fff'])").count() for one in both.all()] == [9, 9]


@pytest.mark.parametrize("teacher", [False, True])
def test_the_worksheet_is_paper_with_what_was_typed(opened, lesson, teacher):
    page = opened(lesson)
    tick_guess(page)
    assert page.tab.get_by_role("textbox").count() == 0  # nothing surprises before it is seen
    page.press("What happened")
    page.tab.get_by_role("textbox").fill("Mine")
    page.js(f"(page.lesson.teacher = {str(teacher).lower()}, page.load(page.presets[1]))")
    paper = page.tab.pdf(format="A4", margin=dict.fromkeys(("top", "left", "right"), "14mm"))
    assert paper.count(b"/Type /Page\n") == 1 + teacher
    sheet = page.js("page.root.querySelector('.sheet').textContent")
    words = (
        "Name",
        "A load's way",
        "Mine",
        "P comes in",
        "ahead 0.5 P",
        "= 10 mN",
        "Who wakes?",
        "One sentence.",
    )
    for x in *words, "−2−1012345678 s", "40 mm", "3 cells√depth":  # axes with units to draw at
        assert x in sheet
    assert ("Nine cells." in sheet) is teacher
    assert page.tab.locator(".sheet figure:first-child rect:not([fill='#fff'])").count() == 9


@pytest.mark.parametrize("dark", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_lessons_are_open_to_everybody(opened, lesson, dark):
    page = opened(lesson, dark=dark)
    tick_guess(page)
    for step in range(4):
        page.js(f"(page.lesson.open({step}), page.draw())")
        page.check_open_to_everybody(1280)


BESIDE = """[...page.root.querySelectorAll(
  'button, select, label, h1, h2, summary, .verdict, td, .card, .count, .bar > *')]
  .filter((e) => e.clientWidth && !e.closest('.tries') && getComputedStyle(e).overflow !== 'hidden'
    && (e.scrollWidth > e.clientWidth + 1
      || e.getBoundingClientRect().right > innerWidth + 1)).map((e) => e.outerHTML.slice(0, 90))"""


@pytest.mark.parametrize(
    "language", ["de-DE", *(pytest.param(x, marks=pytest.mark.slow) for x in ("en-GB", "ja-JP"))]
)
def test_nothing_is_cut_in_any_window(opened, lesson, language):
    page = opened(lesson, language=language)
    for width, height in [(390, 844), (768, 1024), (880, 720), (1280, 800), (1920, 1080)]:
        page.tab.set_viewport_size({"width": width, "height": height})
        for step in range(4):
            page.js(f"(page.lesson.open({step}), page.draw())")
            assert page.js("document.documentElement.scrollWidth") <= width
            assert page.js(BESIDE) == [], (width, step)
            assert page.js("page.canvas.clientHeight") >= (500 if width > 768 else 150)
            assert page.js("page.root.querySelector('.body').clientHeight") >= 90


# ------------------------------------------------------------------------- the rule in one cell

ARRIVALS = """
import { arrivals, leaving } from "./cell.js";
import { Twin } from "./rule.js";
tell(data.map(({ scene, cells, keys }) => {
  const run = new Twin(scene, Int8Array.from(cells)).run();
  return keys.map((k) => ({ rows: arrivals({ scene, cells: Int8Array.from(cells) }, k, 1e9),
    out: leaving(scene, run, k, 2, 1).list }));
}));
"""


@pytest.mark.parametrize("accumulate", [False, True])
def test_what_came_in_is_what_the_agent_took(node, accumulate):
    """By sender and direction, boundaries and applied loads included: the sums of Python's run."""
    wall = PLATE | {"sides": {"bottom": "rigid", "right": "rigid"}}
    wall["loads"] = [{"cell": [17, 19], "force": [0.4, -2.0]}]
    rule = {"kind": "prescribed", "threshold": 0.004, "accumulate": accumulate}
    rule |= {"alpha": [0.5, 0.4, 0.2]} if accumulate else {}
    scene = Scene(**wall, rule=rule)
    last = LoadModel(scene).run().last
    keys = scene.lattice.key(last.cells)
    chosen = np.arange(0, len(keys), 7)
    (told,) = node(ARRIVALS, [described(scene, keys=keys[chosen].tolist())])
    for number, agent in zip(chosen, told, strict=True):
        taken = np.zeros(4)
        for row in agent["rows"]:
            if not row["ends"]:
                taken[row["channel"]] += row["each"] * row["copies"]
        np.testing.assert_allclose(taken, last.taken[number], rtol=1e-9, atol=1e-12)


def test_a_click_opens_the_cell_and_a_slider_moves_its_arrows(shown):
    page = shown(Scene(**PLATE))
    page.click((10, 18))
    page.js("(page.seek(4), page.draw())")
    row = page.tab.locator(".cards table").first.locator("tr").nth(1).inner_text()
    assert row.split("\t") == ["↓", "1 N", "1", "(10, 19): woke it"]
    assert "from neighbours it woke\t325 mN" in page.text(".cards")
    assert "becomes 1.15 N that" in page.text(".cards")
    assert page.text(".cap b") == "(10, 18): Took 1.45 N"
    assert page.text(".cards").startswith("In all it took 1.45 N, and is squeezed by 725 mN")
    field = page.tab.get_by_role("textbox", name="α₂ passed ahead")
    field.fill("0,4")
    field.press("Enter")
    page.until("!page.due && (page.draw(), page.drawn)")
    assert "α₂P\t320 mN" in page.text(".cards")  # 0.8 N come in, 0.32 go ahead
    page.tab.keyboard.press("Escape")
    page.tab.locator("canvas").first.focus()
    page.tab.keyboard.press("Escape")
    assert page.js("page.look.mode") == "body"
    assert page.js("(page.touch([10, 18]), page.load(page.start), page.look.mode)") == "body"


def test_a_pull_stretches_a_cell(shown):
    column = {"cell_size": 0.01, "cells": [1, 4], "thickness": 0.01, "material": "steel"}
    rule = {"kind": "prescribed", "alpha": [0.5, 0.9, 0.0], "beta": 1.0, "sense": True}
    loads = [{"cell": [0, 3], "side": "top", "force": [0.0, 1.0]}]
    page = shown(
        Scene(body=column, sides={"bottom": "rigid"}, loads=loads, rule=rule | {"threshold": 0.35})
    )
    page.click((0, 3))
    page.js("(page.seek(99), page.draw())")
    rows = page.tab.locator(".cards table tr").all_inner_texts()
    assert rows[1] == "↑ pull\t1 N\t1\tthe applied load"
    assert "stretched by\tα₁P\t0.5 N" in rows
    told = "and is squeezed by 215 mN. It passed on 1.72 N. Pulls stretch it by 739 mN."
    assert told in page.text(".cards")
    page.js("(page.seek(1), page.refresh())")
    assert "is stretched by 500 mN. It passed on 900 mN." in page.text(".cards")
    assert "Stretched by" in page.text(".story")


# -------------------------------------------------------------------------------- direct loads


def test_loads_are_moved_turned_added_deleted_and_everything_undone(shown):
    page = shown(Scene(**PLATE))
    mouse = page.tab.mouse

    def loads():
        return page.js("page.scene.loads.map((l) => [l.cell, l.force])")

    def drag(part, dx, dy):
        x, y = page.spot(f"page.loads.spots[0].{part}")
        mouse.move(x, y - 4)
        mouse.down()
        mouse.move(x + dx, y + dy, steps=3)
        mouse.up()
        page.js("page.draw()")

    drag("tail", -4 * page.js("page.view.u"), -60)  # far above the surface: nothing is ignored
    assert loads() == [[[6, 19], [0, -2]]]
    head, tail = page.js("[page.loads.spots[0].head, page.loads.spots[0].tail]")
    drag("head", head[1] - tail[1], 0)  # a right angle of as long legs: half a right angle
    [[cell, force]] = loads()
    assert (cell, force[0]) == ([6, 19], pytest.approx(-force[1]))
    assert np.hypot(*force) == pytest.approx(4.0, rel=0.15)  # twice its length squared
    mouse.dblclick(*page.spot("page.view.at(15.5, 21.2)"))
    assert [load[0] for load in loads()] == [[6, 19], [15, 19]]
    page.tab.locator("canvas").first.focus()
    page.tab.keyboard.press("Delete")
    assert [load[0] for load in loads()] == [[6, 19]]
    for _ in range(4):
        page.tab.keyboard.press("Control+z")
    assert loads() == [[[10, 19], [0, -2]]]
    page.until("!page.due && page.run.agents === 34")
    page.tab.keyboard.press("Control+Shift+z")
    assert loads() == [[[6, 19], [0, -2]]]
    mouse.dblclick(*page.spot("page.view.at(6.5, 17.5)"))  # the close-up, before it is drawn
    assert page.js("page.mode.name") == "cell"
