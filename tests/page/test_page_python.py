"""Agents written in the page: the same code does the same in the page and in kaju."""

import sys

import pytest
from page_scenes import Leaky
from plates import PLATE

import kaju
import kaju.view.page.python as written
from kaju import LoadModel, MaterialAgent, Scene

CUBES = {"cells": [6, 6, 5], "cell_size": 0.01, "material": "oak"}
SCENES = {
    "sides": Scene(
        **PLATE
        | {
            "sides": {"bottom": "rigid", "right": "roller"},
            "loads": [{"cell": [16, 4], "force": [1.5, -2.0]}],
        }
    ),
    "two materials": Scene(
        body={
            "cells": [12, 8],
            "cell_size": 0.01,
            "thickness": 0.01,
            "material": "steel",
            "regions": [{"box": [[0.0, 0.0], [0.06, 0.08]], "material": "rubber"}],
        },
        sides={"bottom": "rigid"},
        loads=[{"cell": [6, 7], "force": [0.0, -2.0]}],
    ),
    "hexagons": Scene(
        body={
            "lattice": "hexagon",
            "cells": [10, 6],
            "cell_size": 0.01,
            "thickness": 0.01,
            "material": "steel",
        },
        sides={"bottom": "rigid"},
        loads=[{"cell": [5, 5], "force": [0.0, -2.0]}],
    ),
    "cubes": Scene(
        body=CUBES,
        sides={"bottom": "rigid"},
        loads=[{"cell": [3, 3, 4], "force": [0.0, 0.0, -2.0]}],
    ),
    "pulls": Scene(
        **PLATE
        | {
            "rule": {"kind": "prescribed", "sense": True, "threshold": 0.01},
            "loads": [{"cell": [10, 19], "force": [0.0, 2.0]}],
        }
    ),
}
READY = written.header({})["python"]["ready"]


def in_kaju(code, scene, **given):
    """Run the last class of a code in kaju."""
    names = {"__name__": "agent"}
    exec(compile(code, "agent", "exec"), names)
    cls = [c for c in names.values() if isinstance(c, type) and c.__module__ == "agent"][-1]
    if issubclass(cls, MaterialAgent):
        given["material_agent"] = cls
    else:
        given["boundary_agents"] = {cls.name: cls}
    return LoadModel(scene, seed=1, engine="agents", max_generations=4000, **given).run().last


def as_page_says(stage):
    ledger = stage.ledger
    return {
        "agents": len(stage.cells),
        "generations": stage.generations,
        "taken": ledger.taken,
        "kept": ledger.kept,
        "passed": float(stage.passed.sum()),
        "arrived": float(stage.arrived.sum()),
        "absorbed": ledger.absorbed,
        "pending": ledger.pending,
    }


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("python")
    return {
        name: kaju.export_page(scene, folder / f"{name}.html", python=True)
        for name, scene in SCENES.items()
    }


def runs(page, code):
    return page.js(f"window.kaju.runAgent({code!r})")


@pytest.mark.parametrize("name", SCENES)
def test_ready_agents_do_in_the_page_what_they_do_in_kaju(opened, pages, name):
    page = opened(pages[name])
    for title, agent in READY.items():
        found = runs(page, agent["code"])
        assert "error" not in found, (title, found)
        for what, value in as_page_says(in_kaju(agent["code"], SCENES[name])).items():
            assert found[what] == pytest.approx(value, rel=1e-12, abs=1e-12), (title, what)


MISTAKES = {
    "MaterialAgnt": ("from kaju import MaterialAgnt", "line 1: `kaju` has no `MaterialAgnt`"),
    "attribute": (
        "self.kept += load.magnitud",
        "`Load` has no `magnitud`; did you mean `magnitude`?",
    ),
    "name": ("self.kept += lod.total", "`lod` is not known; did you mean `load`?"),
    "division": ("self.kept += 1 / 0", "division by zero"),
    "recursion": ("self.take(load)", "calls itself without end"),
    "text": ("self.kept = 'much'", "line 6"),
    "infinite": ("self.kept = float('inf')", "take: Mine at cell"),
    "colon": ("if True\n            pass", "not Python"),
    "bracket": ("print('a'", "not Python"),
    "print": ("for i in range(1000000): print(i)", "more than 1000 lines printed"),
    "loop": ("while True: pass", "two seconds"),
    "key": ("{}[1]", "nothing under"),
    "index": ("[][1]", "not so long"),
    "set": ("load.magnitude = 1", "no setter"),
    "call": ("super().take()", "line 6"),
}
HEAD = """from kaju import MaterialAgent


class Mine(MaterialAgent):
    def take(self, load):
        """
ATTACKS = (
    "import os", "import browser", "from browser import window", "from javascript import fetch",
    "eval('1')", "exec('1')", "open('/etc/passwd')", "window.location", "document.body",
    "().__class__.__bases__", "__import__('os')", "globals()",
)  # fmt: skip


def test_mistakes_are_named_with_their_line_and_the_page_lives_on(opened, pages):
    page = opened(pages["sides"])
    for mistake, (line, words) in MISTAKES.items():
        code = line if mistake == "MaterialAgnt" else HEAD + line + "\n"
        found = runs(page, code)
        assert words in found["error"], (mistake, found)
        assert found["line"] == (1 if mistake == "MaterialAgnt" else 6), (mistake, found)
    for attack in ATTACKS:
        found = runs(page, f"x = 1\n{attack}\n")
        if attack != "().__class__.__bases__" or "error" in found:
            assert found["line"] == 2, (attack, found)
    assert runs(page, READY["standard"]["code"])["agents"] > 30


def test_own_answers_are_judged_by_kajus_sentences(opened, pages):
    page = opened(pages["sides"])
    for answer in (
        "[(9, 2, 0.5, 'push')]",
        "[(1, 2, -0.5, 'push')]",
        "[(1, 2, float('nan'), 'push')]",
        "5",
        "[1]",
    ):
        code = HEAD.replace("take", "emissions") + f"return {answer}\n"
        with pytest.raises(kaju.KajuError) as wrong:
            in_kaju(code, SCENES["sides"])
        assert runs(page, code) == {"error": f"line 6: {wrong.value}", "line": 6}


def test_states_are_colours_and_step_back(opened, pages):
    page = opened(pages["sides"])
    runs(page, READY["tired"]["code"])
    assert "state loads" in page.js("page.colours")
    most = "page.look.colour = 'state loads', Math.max(...page.values().filter((v) => v >= 0))"
    last = page.js(most)
    page.js("page.seek(1)")
    assert (page.js(most), last > 1) == (2, True)  # of a force along two axes


def test_code_of_a_link_is_shown_and_runs_when_asked(opened, pages):
    page = opened(pages["sides"])
    page.js("page.studio.offer('print(1)')")
    assert "somebody else" in page.text(".body")
    assert page.js("page.studio.active") is False


def test_what_is_saved_runs_in_kaju(opened, pages, tmp_path, capsys):
    page = opened(pages["sides"])
    found = runs(page, READY["pillar"]["code"])
    page.tab.get_by_role("tab", name="Agent").click()
    with page.tab.expect_download() as download:
        page.press("Save as Python")
    saved = tmp_path / "agent.py"
    download.value.save_as(saved)
    exec(compile(saved.read_text(), "agent", "exec"), {"__name__": "__main__"})
    agents, generations, taken = map(float, capsys.readouterr().out.split())
    assert [agents, generations] == [found["agents"], found["generations"]]
    assert taken == pytest.approx(found["taken"], rel=1e-12)


def test_an_own_agent_opens_with_its_class_and_the_page_without_python_stays_small(
    tmp_path, opened
):
    path = kaju.export_page(
        LoadModel(Scene(**PLATE), material_agent=Leaky), tmp_path / "own.html", python=True
    )
    assert path.stat().st_size < 700_000
    page = opened(path)
    assert "class Leaky" in page.js("page.studio.code")
    assert kaju.export_page(Scene(**PLATE), tmp_path / "a.html").stat().st_size < 130_000


def test_the_editor_is_used_by_keys_alone_and_open_to_everybody(opened, pages):
    page = opened(pages["sides"], width=390, height=800)
    page.tab.get_by_role("tab", name="Agent").click()
    field = page.tab.get_by_label("The agent, in Python")
    field.focus()
    page.tab.keyboard.press("Control+End")
    page.tab.keyboard.type("class Two(Mine):")
    page.tab.keyboard.press("Enter")
    page.tab.keyboard.type("pass")
    assert field.input_value().endswith("class Two(Mine):\n    pass")
    page.tab.keyboard.press("Control+Enter")
    page.until("page.studio.result?.agents > 0")
    page.check_open_to_everybody(390)


def test_without_brython_the_error_says_what_to_install(monkeypatch, tmp_path):
    written.worker.cache_clear()
    monkeypatch.setitem(sys.modules, "brython", None)
    with pytest.raises(kaju.KajuError, match=r"pip install 'kaju\[page\]'"):
        kaju.export_page(Scene(**PLATE), tmp_path / "a.html", python=True)
    written.worker.cache_clear()
