"""The lessons: what they say is what is seen, in three languages, and their pages are made."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import kaju.view.page

DOCS = Path(__file__).parents[2] / "docs"
if not DOCS.exists():
    pytest.skip("the lessons are in docs/, which is not here", allow_module_level=True)
sys.path.insert(0, str(DOCS))

import lesson_measures  # noqa: E402
import lesson_runs  # noqa: E402
import make_pages  # noqa: E402
from lesson_texts import HEADINGS, LESSONS, ORDER, lesson  # noqa: E402

from kaju.model.fracture.fracture_model import PARTED  # noqa: E402
from kaju.view.page.python import header  # noqa: E402

LONG = dict.fromkeys(["a-noodle-remembers", "bones-and-bridges", "blow-up"], pytest.mark.slow)


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(name, ())) for name in ORDER])
def test_what_a_lesson_claims_is_seen(name):
    of = lesson(name)
    claims = list(lesson_measures.claims(of))
    assert len(claims) > 10
    faults = {claim.text: why for claim in claims if (why := lesson_measures.fault(of, claim))}
    assert faults == {}
    for number in range(len(of.kinds)):
        fields = {len(text.questions[number].fields) for text in of.texts.values()}
        assert fields == {len(lesson_measures.answers(of, number))}


def test_a_sentence_that_is_untrue_is_found():
    of = lesson("find-its-way")
    claims = list(lesson_measures.claims(of))
    rows = next(claim for claim in claims if "9, 7, 5, 5" in claim.text)
    assert lesson_measures.fault(of, rows) is None
    wrong = replace(rows, text=rows.text.replace("9, 7", "9, 8"))
    assert "do not tell" in lesson_measures.fault(of, wrong)
    shape = next(claim for claim in claims if "closes downwards" in claim.text)
    assert "not true" in lesson_measures.fault(of, replace(shape, held_by=("not narrows()",)))


@pytest.mark.parametrize("name", ORDER)
def test_a_worksheet_is_whole(name):
    of = lesson(name)
    for text in of.texts.values():
        begin, end = map(int, re.findall(r"\((\d+) (?:min|Min\.|分)\)", text.plan))
        minutes = [begin, *(question.minutes for question in text.questions), end]
        (told,) = re.findall(r"^\*\*(?:Minutes\.|Minuten\.|時間（分）。)\*\* (.*)", text.plan, re.M)
        assert list(map(int, re.findall(r"\d+", told))) == minutes
        assert sum(minutes) == 45
        assert len(text.questions) == len(text.answers) == len(of.kinds)
        assert len(text.presets) == len(of.scenes)
        assert all(question.hint for question in text.questions)
    steps = [kind["step"] for kind in of.kinds]
    assert list(dict.fromkeys(steps)) == ["predict", "step", "explain", "try"]
    assert len({kind["key"] for kind in of.kinds}) == len(of.kinds)


def figures(text):
    """The numbers of a text, whatever its language writes between their digits."""
    text = re.sub(r"(?<=\d)[,.](?=\d{3}(?!\d))|(?<=\d) (?=%)", "", text)
    found = re.findall(r"(?<![\w.])\d+(?:[.,]\d+)?", text.replace("(1 − β)", ""))
    return sorted(float(number.replace(",", ".")) for number in found)


@pytest.mark.parametrize("name", ORDER)
def test_all_languages_tell_the_same_numbers(name):
    of = lesson(name)
    told = of.texts["en"]
    for language, text in of.texts.items():

        def same(one, other, where, language=language):
            assert figures(one) == figures(other), (language, where)

        for heading in HEADINGS["en"][:3] + ([] if of.scenes else HEADINGS["en"][3:4]):
            same(text.words(heading), told.words(heading), heading)
        for number, (preset, english) in enumerate(zip(text.presets, told.presets, strict=True)):
            same(preset[1], english[1], f"preset {number}")
        for number, (ours, theirs) in enumerate(zip(text.questions, told.questions, strict=True)):
            same(ours.asks + ours.note, theirs.asks + theirs.note, f"question {number}")
            same(ours.hint, theirs.hint, f"hint {number}")
            for field, english in zip(ours.fields, theirs.fields, strict=True):
                same(field[0], english[0], f"question {number}: {english[0]}")
        same(text.plan, told.plan, "plan")
        for number, answer in enumerate(text.answers):
            same(answer, told.answers[number], f"answer {number}")
            assert language != "de" or not re.search(r"\d\.\d", re.sub("`.*`|25.600", "", answer))


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(name, ())) for name in ORDER])
def test_a_page_is_told_words_and_no_programs(name):
    of = lesson(name)
    for language, text in of.texts.items():
        words = text.words(*HEADINGS["en"][:4])
        for heading in HEADINGS[language][:4]:
            assert f"# {heading}\n" in words
        for foreign in ("```", ">>>", "<!--", "../", HEADINGS[language][4]):
            assert foreign not in words
    told = make_pages.page_lesson(of)
    assert "../" not in json.dumps(told)  # the files stand side by side, in whatever folder
    for question in told["questions"]:
        assert set(question["question"]) == set(of.texts)
        for field in question.get("fields", []):
            assert field["tolerance"] >= 0.0


@pytest.mark.parametrize("name", lesson_runs.PAGES)
def test_every_page_that_a_lesson_points_to_is_made(name):
    made = {f"{'-'.join(filter(None, (name, page)))}.html" for page in lesson_runs.PAGES[name]}
    for language in lesson(name).texts:
        text = (LESSONS / language.replace("en", "") / f"{name}.md").read_text("utf-8")
        pointed = {part.split(")")[0] for part in text.split("pages/")[1:]}
        assert pointed <= made
        assert made - pointed <= {f"{name}.html"}
    steps = {lesson(name).kinds[make_pages.asked_for(lesson(name), page)]["step"] for page in made}
    assert steps <= {"explain", "try"}


def test_the_index_shows_every_lesson(tmp_path, chromium, request):
    tab = chromium.new_page(offline=True, locale="en-GB")
    tab.set_default_timeout(120_000)
    request.addfinalizer(tab.close)
    tab.goto(make_pages.write_index(tmp_path).as_uri())
    cards = tab.locator(".card")
    assert sorted(ORDER) == sorted(path.stem for path in LESSONS.glob("*.md"))
    for name, card in zip(ORDER, cards.all(), strict=True):
        assert card.get_attribute("href") == f"{name}.html"
        assert card.get_by_role("heading", name=lesson(name).texts["en"].title).is_visible()
        assert card.locator("img").evaluate("image => image.naturalWidth") > 100
    assert len(set(cards.locator("img").evaluate_all("l => l.map((i) => i.src)"))) == len(ORDER)
    tab.get_by_role("button", name="12 – 13", exact=True).click()
    assert [c.get_attribute("data-age") for c in cards.all() if c.is_visible()] == ["12"] * 5
    tab.get_by_role("button", name="日本語").click()
    assert "1 のあと" in cards.nth(1).inner_text()


@pytest.mark.slow
def test_a_guess_is_not_judged_and_what_a_question_looks_at_is_there(opened, tmp_path):
    page = opened(*make_pages.make_lesson(lesson("who-holds-the-load"), tmp_path))
    assert "stands on firm ground" in page.text("aside .flow")
    page.tab.get_by_role("tab", name="Step").click()  # locked until there is a guess
    assert page.js("page.lesson.step") == "predict"
    assert page.tab.get_by_role("button", name="Elasticity").count() == 0
    page.tab.get_by_role("textbox").fill("2")
    page.tab.keyboard.press("Tab")
    assert page.tab.get_by_text("correct").count() == 0
    page.press("Next: Step")
    page.js("page.speak('de')")
    page.tab.reload()  # it opens where the reader was, in the language chosen
    page.until("page?.drawn && page.lesson.step === 'step' && page.lesson.done[0] === 'predict'")
    assert page.js("page.language") == "de"
    made = make_pages.make_lesson(lesson("how-things-break"), tmp_path)
    (finer,) = (file for file in made if file.stem.endswith("break-fine"))
    page = opened(finer, language="de-DE")  # it opens where it is asked for, at rest
    assert page.text("h1") == "Ein doppelt so feines Netz mit dem Schnitt · Wie Dinge brechen"
    assert page.js("[page.lesson.step, page.g === 0]") == ["explain", True]
    assert make_pages.asked_for(lesson("how-things-break"), "how-things-break-fine-whole.html") == 2
    assert page.text("a[aria-current]") == "mit dem Schnitt"  # this page
    assert page.text(".recalled").startswith("Du hast noch nicht vermutet: Beginne mit")
    page.js("(page.lesson.answers.warning = ['', '', '2 cm'], page.lesson.open(3))")
    assert "bitte in %" in page.text("aside .flow")
    page.press("Zurück")  # this page is one of those that question 3 asks for
    assert page.js("[page.lesson.at, page.lesson.here]") == [2, finer.name]
    page.press("Zurück")  # question 2 is about the first net
    page.until("page?.drawn && page.lesson?.here === 'how-things-break.html'")
    assert page.js("page.lesson.at") == 1
    assert page.requests.pop() == (tmp_path / "how-things-break.html").as_uri()  # and no other
    page = opened(finer, width=390, height=844, touch=True)  # on a phone nothing is covered

    def side(part, edge):
        return page.js(f"page.root.querySelector('{part}').getBoundingClientRect().{edge}")

    assert side(".recalled a", "right") < side(".grip", "left")
    page.tab.locator("input.field").first.fill("9")
    page.tab.keyboard.press("Tab")
    assert side("small.bad", "bottom") < side(".foot", "top")
    assert side(".charts", "bottom") < side(".fields", "top")
    page = opened(*make_pages.make_lesson(lesson("who-holds-the-load"), tmp_path))
    page.js("(page.lesson.answers = { guess: ['2'], cuts: ['0.125', '82', '15', '11'] })")
    for question, shown in (1, False), (2, False), (3, False), (3, True):  # what answers the next
        page.js(f"page.lesson.open({question})")
        if shown:
            page.js("page.lesson.answers.numbers = ['2.93', '0.18', '2', '0.18', 'no']")
        page.press("Equilibrium")
        page.js("page.draw()")
        assert page.js("!page.cutCards[1].hidden") == shown
    halved = make_pages.make_lesson(lesson("agents-of-many-sizes"), tmp_path)[0]
    page = opened(halved, language="de-DE")
    page.js("(page.lesson.answers.guess = 'x', page.lesson.answers.hole = ['2 cm'])")
    page.js("page.lesson.open(2)")
    assert "bitte in mal" in page.text("aside .flow")
    page = opened(make_pages.make_lesson(lesson("a-lattice-bends"), tmp_path)[0])
    for question in 0, 2:  # who has guessed sees what the next question shows, no more
        page.js(f"(page.lesson.answers.guess = 'x', page.lesson.go({question}), page.seek(1 / 0))")
        assert page.js("[page.at[page.g], page.forces[1].force[1]]") == pytest.approx([0.75, -0.3])
    assert page.js("(page.draw(), page.parts.charts.isConnected)")  # as far as the question goes
    page = opened(*make_pages.make_lesson(lesson("blow-up"), tmp_path))
    curves = "page.parts.charts.childElementCount"  # what is read, and no other
    assert page.js(f"(page.lesson.go(1), page.draw(), {curves})") == 1
    page.js("dispatchEvent(new Event('beforeprint'))")  # the sheet's rule is that of question 1
    assert "β = 0.5" in page.js("page.root.querySelector('.sheet').textContent")
    page.js("page.lesson.go(2)")
    assert "Every load ends" in page.text(".verdict")


@pytest.mark.slow
def test_a_number_tells_its_run_and_a_tap_on_the_divider_reads_the_cell(opened, tmp_path):
    page = opened(*make_pages.make_lesson(lesson("the-right-numbers"), tmp_path))
    page.js("(page.lesson.go(2), page.rebuild())")
    for question, typed, verdict in [
        (2, "51.5", "look again · Numbers are marked for the run “Fitted”."),
        (4, "35", "as a share of 1, please"),
    ]:
        page.js(f"(page.lesson.go({question}), page.rebuild())")
        page.tab.locator("input.field").first.fill(typed)
        page.tab.locator("input.field").first.press("Tab")
        assert page.text(".fields [role=status] >> nth=0") == verdict
    page.press("Swipe")
    page.js("(page.look.twin.split = 5.5, page.draw())")
    page.click((5, 9))
    page.until("(page.draw(), page.parts.cap.textContent.startsWith('(5, 9): rule 6.05 nm'))")
    shown = "page.stageBox.querySelectorAll('canvas').length"
    assert [page.js(f"(page.lesson.go({n}), {shown})") for n in (2, 3)] == [3, 1]  # a guess first
    page.press("Fitted, pressed elsewhere")
    assert page.text(".saved") == "Please fill in first: Your guess"
    page.tab.locator("textarea").first.fill("less")
    page.press("Fitted, pressed elsewhere")
    assert page.js(shown) == 3


@pytest.mark.slow
def test_other_pages_print_the_drawing_of_the_first_and_tell_an_agents_side(opened, tmp_path):
    first, *_, fine, _ = make_pages.make_lesson(lesson("a-round-hole"), tmp_path)
    kept = "localStorage[page.lesson.drawing(page.lesson.questions[0])]"
    drawn = opened(first).js(f"(page.lesson.to('#'), {kept})")
    assert drawn.startswith("data:image/png")
    page = opened(fine)
    page.js(f"({kept} = {drawn!r}, dispatchEvent(new Event('beforeprint')))")
    assert page.js("page.root.querySelector('.sheet img').src") == drawn
    page.js("(page.lesson.teacher = true, page.seek(9), page.look.colour = 'von_mises')")
    most = "(best, v, i, all) => (v > (all[best] || 0) ? i : best)"
    worst = f"page.fields.von_mises.at(-1).reduce({most}, 0)"
    assert page.js(f"(page.picked = {worst}, page.reading)").endswith("· side 39.06 µm")


@pytest.mark.slow
def test_a_drawing_is_a_guess_and_a_number_rounded_well_is_nearly_right(opened, tmp_path):
    page = opened(*make_pages.make_lesson(lesson("arching"), tmp_path))
    page.press("Next: Step")
    assert page.text(".saved").startswith("Draw it on paper and press")
    page.tab.get_by_role("textbox").fill("Above")
    page.press("Drawn on paper")  # what was typed stays
    page.press("Next: Step")
    assert page.text(".recalled").startswith("You guessed at first: Above · Drawn on paper")
    field = page.tab.locator("input.field").nth(3)
    told = {"15.4": "correct", "30.8/2": "correct", "15": "rounded too far: give more digits"}
    told |= {"15.5": "look again · right within ± ", "15400": "check the unit: is it in N?"}
    told |= {"14.2": "look again", "1540": "look again"}
    told |= {"9": "look again"}  # of nothing every thousandth is right
    page.js("page.load(page.presets[1])")  # the run that it is read from
    for typed, verdict in told.items():
        page.js(f"(page.lesson.question.fields[3].answer *= {float(typed != '9')})")
        field.fill(typed)
        field.press("Tab")
        said = page.text(".fields label:nth-child(4) [role=status]")
        assert said.split("± ")[0] == verdict.split("± ")[0]
    page.js("Object.assign(page.lesson.question.fields[3], { answer: 14, tolerance: 0.0474 })")
    field.fill("14.08")  # what is right within odd digits helps nobody
    field.press("Tab")
    assert page.text(".fields label:nth-child(4) [role=status]") == "look again"
    page.js("page.lesson.go(2)")
    page.press("Play")
    assert page.text(".saved") == "Please fill in first: Your guess"
    page.tab.locator("textarea").first.fill("Higher")
    page.js("(page.load(page.presets[2]), page.seek(1e9), page.rebuild())")
    assert page.js("page.shownAt(page.run.lattice.key([15, 0]))") == ["asleep"]
    order = "[...page.root.querySelectorAll('aside .fields, aside textarea')].map((e) => e.tagName)"
    assert page.js(order) == ["TEXTAREA", "DIV", "TEXTAREA"]  # a guess stays, a finding is apart
    page.tab.locator("canvas").first.focus()
    page.tab.keyboard.press("c")  # no question asks for cuts: no key leads there
    assert page.js("(page.lesson.go(3), page.look.mode)") == "body"
    page.js("page.lesson.next.go()")
    assert page.text("aside .flow").count("is still open") == 4  # the guess waits for all
    all_of = "page.lesson.questions.flatMap((q) => (q.guess ? [q.guess, q] : [q]))"
    page.js(f"({all_of}.map((q) => page.lesson.answer(q, [...'abcde'])), page.rebuild())")
    assert page.text("aside .flow").count("Your guess: a · b · c · d · e\n") == 2
    drawn = "(({ width, height }) => height / width)(page.unmarked(page.presets[1], true))"
    assert page.js(drawn) > 1  # a wall wider than high, and a strip for what the ground takes
    assert re.search(r"a · b · c · d · e\n+Less below.*with it\.\n+2\. ", page.text("aside .flow"))
    right = page.js(
        "page.lesson.go(1), page.lesson.question.fields.map((field) => String(field.answer))"
    )
    for number, typed in enumerate([right[1], right[0]]):
        page.tab.locator("input.field").nth(number).fill(typed)
        page.tab.keyboard.press("Tab")
    assert page.text(".fields").count("are two answers exchanged?") == 2
    page = opened(make_pages.make_lesson(lesson("how-things-break"), tmp_path)[0])
    page.press("Drawn on paper")
    assert page.js("(page.seek(1), page.draw(), page.breaking.length)") == 1
    assert not page.tab.locator("textarea").is_editable()  # it has been seen
    page.press("Change my guess")
    assert (page.tab.locator("textarea").is_editable(), page.js("page.g")) == (True, 0)
    page.js("(page.lesson.open(1), page.seek(Infinity), page.draw())")
    assert "parted: all that is left bears" in page.text(".cap")
    assert all(f"told_{PARTED}" in words for words in WORDS.values())


def test_the_strength_at_which_nothing_breaks_is_found_by_the_slider(opened, tmp_path):
    page = opened(*make_pages.make_lesson(lesson("write-the-rule"), tmp_path), language="de-DE")
    page.js("page.lesson.go(2)")
    chosen, guess = page.tab.get_by_label("Beginne mit"), page.tab.get_by_label("Deine Vermutung")
    chosen.select_option("oneway")  # it waits for the guesses
    page.until("page.root.activeElement?.ariaLabel === 'Deine Vermutung'")
    assert not page.js("page.studio.result || page.studio.pending")
    guess.fill("17, 17, 1, 34")
    top = page.js("page.root.querySelector('aside .body').scrollTop = 200")
    chosen.select_option("standard")
    page.until("page.studio.result?.agents === 34")
    assert page.js("page.root.querySelector('aside .body').scrollTop") == top
    page.js("page.lesson.open(3)")
    chosen.select_option("breaking")
    field = page.tab.get_by_label("Festigkeit (N): Zahl")
    tried = [("1,15", "Enter", 1.15, 1), ("", "ArrowUp", 1.16, 1), ("", "ArrowUp", 1.17, 0)]
    for typed, key, strength, broken in [*tried, ("0,6", "Enter", 0.6, 1)]:
        field.fill(typed or field.input_value())
        field.press(key)
        page.until("!page.studio.pending")
        assert page.js("page.studio.values") == {"strength": strength}
        assert f", {broken} gebrochen." in page.text("aside .flow")
        assert page.js("page.values('state broken').filter((v) => v === 1).length") == broken
    assert "1 Agent, 1 Generation, 2 N aufgenommen, 1 gebrochen" in page.text("aside .flow")
    assert "Wettbewerb" not in page.text("aside .flow")  # it is that of the last question
    page.js("page.lesson.go(4)")
    page.tab.get_by_label("Beginne mit").select_option("leaking")  # a load at the foot wins nothing
    page.until("page.studio.result?.agents === 34")
    page.js("page.loads.edit(0, {cell: [3, 0], force: [0, -2]})")
    page.until("!page.due && !page.studio.pending")
    assert "linker Fuß 2,01 N · Es gilt nur mit Last" in page.text("aside .flow")
    assert not page.js("page.studio.best")
    page.tab.get_by_label("Der Agent, in Python").press("End")
    page.tab.keyboard.type("  # so")
    assert "noch nicht gestartet. Vorher: 18 Agenten" in page.text("aside .flow")
    field = page.tab.get_by_label("γ Schwelle: Zahl")
    for typed, invalid in (("10 µN", "false"), ("1 µN", "true")):  # its least value is in reach
        field.evaluate(f"(field) => {{ field.value = '{typed}'; field.onblur(); }}")
        assert field.get_attribute("aria-invalid") == invalid
    told = page.js("page.root.querySelector('.wrong:not([hidden])').textContent")
    assert told == "1 µN liegt nicht zwischen 10 µN und 10 N: Es bleibt bei 10 µN."


@pytest.mark.slow
@pytest.mark.parametrize("name", lesson_runs.PAGES)
def test_every_recorded_page_is_played_to_its_end(name, opened, tmp_path):
    for path in make_pages.make_lesson(lesson(name), tmp_path):
        page = opened(path)
        page.js("(page.lesson.teacher = true, page.lesson.open(3))")  # who may see all
        page.tab.keyboard.press("Home")
        first = page.js("(page.draw(), page.canvas.toDataURL())")
        page.until("page.run.atRest")
        page.tab.keyboard.press("End")
        page.tab.wait_for_timeout(200)
        end, count = page.js("[page.g, page.run.generation]")
        assert (end == count >= 2, "energy" in page.text(".cap")) == (True, False)
        assert page.js("(page.draw(), page.canvas.toDataURL())") != first


WORDS = json.loads((Path(kaju.view.page.__file__).parent / "words.json").read_text("utf-8"))
READY = header({})["python"]["ready"]


@pytest.mark.parametrize("name", ORDER)
def test_what_a_lesson_tells_to_press_is_there(name):
    """Names in italics are presets, other lessons, or words of the page."""
    of = lesson(name)
    for language, text in of.texts.items():
        known = {preset for preset, _ in text.presets} | set(WORDS[language].values())
        known |= {lesson(other).texts[language].title for other in ORDER}
        known |= {agent["name"][language] for agent in READY.values()}
        known |= {word for heading in HEADINGS.values() for word in heading}
        for question in text.questions:
            known |= set(re.findall(r"\[([^]]+)\]\(", question.asks))  # pages that it opens
            told = f"{question.note}\n{question.hint}"
            named = set(re.findall(r"(?<!\*)\*([^*\n]+)\*(?!\*)", told))
            assert named <= known, (language, named - known)
