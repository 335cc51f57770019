"""Agents written in the page: the same code does the same in the page and in kaju."""

import ast
import math as m
import sys
from functools import partial
from math import floor
from pathlib import Path
from random import Random

import numpy as np
import pytest
from page_scenes import header_of
from plates import PLATE, plate

import kaju
import kaju.view.page.python as written
from kaju import LoadModel, MaterialAgent, Parameter, Scene
from kaju.view.page.export import packed_page

HALF_RUBBER = [{"box": [[0.0, 0.0], [0.06, 0.08]], "material": "rubber"}]
PULLED = {"rule": {"kind": "prescribed", "sense": True, "threshold": 0.01}}
SCENES = {
    "sides": plate([20, 20], [16, 4], (1.5, -2.0), sides={"bottom": "rigid", "right": "roller"}),
    "two materials": plate([12, 8], [6, 7], thickness=0.01, regions=HALF_RUBBER),
    "hexagons": plate([10, 6], [5, 5], thickness=0.01, lattice="hexagon"),
    "cubes": plate([6, 6, 5], [3, 3, 4], (0.0, 0.0, -2.0), material="oak"),
    "pulls": plate([20, 20], [10, 19], (0.0, 2.0), thickness=0.002, **PULLED),
}
READY = written.header({})["python"]["ready"]


EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "own_agents").glob("*.py"))


def in_kaju(code, scene):
    """Run the last class of a code, or its order, in kaju."""
    names, given = {"__name__": "agent"}, {}
    exec(compile(code, "agent", "exec"), names)
    own = [value for value in names.values() if getattr(value, "__module__", "") == "agent"]
    classes = [value for value in own if isinstance(value, type)]
    if not classes:
        given["order"] = next(
            f for f in reversed(own) if f.__code__.co_varnames[:1] == ("waiting",)
        )
    elif issubclass(classes[-1], MaterialAgent):
        given["material_agent"] = classes[-1]
    else:
        given["boundary_agents"] = {classes[-1].name: classes[-1]}
    return LoadModel(scene, seed=1, engine="agents", max_generations=4000, **given).run().last


def as_page_says(scene, stage):
    ledger, kinds = stage.ledger, scene.kinds(stage.boundary_cells)
    walls = {"air": -1, "ground": -2, "rollers": -3}
    return (
        {
            "agents": len(stage.cells),
            "generations": stage.generations,
            "passed": float(stage.passed.sum()),
            **{name: float(stage.arrived[kinds == kind].sum()) for name, kind in walls.items()},
        }
        | {
            n: getattr(ledger, n)
            for n in ("taken", "kept", "returned", "dropped", "absorbed", "pending")
        }
        | {"lost": ledger.imbalance}
    )


CELLS = """(() => {
  const { run } = page, sums = (log, size) => { const s = new Float64Array(size);
    for (let i = 0; i < log.n; i++) s[log.index[i]] += log.value[i]; return s; };
  const { size, D } = run.lattice, keys = [...run.spawn.keys()].filter((k) => run.spawn[k]);
  const taken = sums(run.taken, size * run.C), passed = sums(run.passed, size * D);
  return keys.map((k) => [k, run.spawn[k], run.woken[k],
    ...Array.from({ length: D }, (_, d) => taken[k * run.C + d]
      + (run.C > D ? taken[k * run.C + D + d] : 0)),
    ...passed.subarray(k * D, (k + 1) * D)]);
})()"""


def cells_of(scene, stage):
    key = scene.lattice.key(stage.cells)
    rows = np.column_stack([key, stage.spawn_step, stage.woken_by, stage.taken, stage.passed])
    return rows[np.argsort(key)]


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("python")
    return {
        name: kaju.export_page(scene, folder / f"{name}.html", python=True)
        for name, scene in SCENES.items()
    }


def runs(page, code):
    return page.js(f"window.kaju.runAgent({code!r})")


def check_alike(page, name, title, code):
    """The page's run is kaju's: its sums, and every cell of it."""
    found, stage = runs(page, code), in_kaju(code, SCENES[name])
    assert "error" not in found, (title, found)
    for what, value in as_page_says(SCENES[name], stage).items():
        assert found[what] == pytest.approx(value, rel=1e-12, abs=1e-12), (title, what)
    np.testing.assert_allclose(
        page.js(CELLS), cells_of(SCENES[name], stage), rtol=1e-12, atol=1e-12, err_msg=title
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_ready_agents_do_in_the_page_what_they_do_in_kaju(opened, pages, name):
    page = opened(pages[name])
    for title, agent in READY.items():
        check_alike(page, name, title, agent["code"])


@pytest.mark.slow
def test_examples_pasted_unchanged_run_or_name_what_is_missing(opened, pages):
    page = opened(pages["sides"])
    lacks = {"lattice_in_the_plane": "no `numpy`; it has kaju", "lattice_in_space": "no `Cubes`"}
    for file in EXAMPLES:
        code = file.read_text()
        if file.stem in lacks:
            found = runs(page, code)
            assert (lacks[file.stem] in found["error"], found["line"]) == (True, 3), file
        else:
            check_alike(page, "sides", file.stem, code)
    assert len(EXAMPLES) - len(lacks) >= 8
    lost = runs(page, CLASS + "def take(self, load): pass")
    assert (round(lost["taken"], 9), round(lost["lost"], 2)) == (0.0, 0.77)
    rows = "return super().emissions(load)[: 1 + round(1e5 * sum(self.position)) % 3]"
    wall = "from kaju import RollerBoundaryAgent\nclass Ice(RollerBoundaryAgent): pass\n"
    other = f"{CLASS}pass\n".replace("Mine", "Other")
    two = f"{wall}{other}{CLASS}def emissions(self, load): {rows}"
    page = opened(pages["hexagons"])
    check_alike(page, "hexagons", "two classes", two)
    told = "No load reached a boundary of Ice. Other did not run: of several classes"
    assert told in page.text("aside")


TAKE = """from kaju import MaterialAgent, State

class Mine(MaterialAgent):
    broken = State(False)
    def take(self, load):
        super().take(load)
        """
SEND = TAKE.replace("take(self", "emissions(self").replace(
    "super().take", "rows = super().emissions"
)
CLASS = "from kaju import MaterialAgent, Parameter, State\nclass Mine(MaterialAgent):\n    "
KIND, VALUE, PYTHON, INDENT = "dieser Art passt", "dieser Wert passt", "kein Python", "Leerzeichen"
MISTAKES = [  # what comes before, what is written, the line, and words of the sentence
    (TAKE, "self.kept += load.magnitud", 7, "kein `magnitud`; meinst du `magnitude`?"),
    (SEND, "super().emission(load)", 7, "kein `emission`; meinst du `emissions`?"),
    (TAKE, "self.model.treshold", 7, "meinst du `threshold`?"),
    (TAKE, "self.positon", 7, "meinst du `position`?"),
    (TAKE, "Load(1, 2.0)", 7, "`Load` ist nicht bekannt; schreibe zuerst `from kaju import Load`"),
    (TAKE, "math.sqrt(2)", 7, "`math` ist nicht bekannt"),
    (TAKE, "1 / 0", 7, "Division durch null"),
    (TAKE, "self.cell.get_neighborhood(2)", 7, "Seite nicht; self.model.agent_at(place) gibt"),
    (TAKE, "self.taken['-y']", 7, "model.lattice.direction_names.index('-y')"),
    (TAKE, "self.model.agent_at((-1, 22))", 7, "(-1, 22) liegt weit außerhalb der 20 x 20 Zellen"),
    (TAKE, "self.random()", 7, "schreibe self.random.random()"),
    (TAKE, "import random; random.choice([1])", 7, "schreibe self.random.choice"),
    (TAKE, "self.model.agent_at((-1, 20))\n        self.brocken = 1", 8, "meinst du `broken`?"),
    (TAKE, "while True: pass", 7, "eine Schleife ohne Ende?"),
    (TAKE, "self.kept = 'much'", 7, "hat 'much' N behalten"),
    (TAKE, "self.kept += '1'", 7, KIND),
    (TAKE, "self.kept = float('inf')", 7, "hat inf N behalten"),
    (TAKE, "load.magnitude = 1", 7, "nimm eine andere: load._replace(magnitude=1)"),
    (TAKE, "2 * load", 7, "eine Last ist keine Zahl; nimm load.total (N)"),
    (TAKE, "self.kept += load", 7, "eine Last ist keine Zahl; nimm load.total (N)"),
    (TAKE, "load > 0.5", 7, "eine Last ist keine Zahl; nimm load.total (N)"),
    (SEND, "return [0.5 * row for row in rows]", 7, "eine Zeile ist keine Zahl; nimm row._rep"),
    (SEND, "rows[0].share = 1", 7, "nimm eine andere: row._replace(share=1)"),
    (TAKE, "load[7]", 7, "so lang ist die Liste nicht"),
    (TAKE, "int('a')", 7, VALUE),
    (TAKE, "x = [r for r in [] if r.arm = 1]", 7, "kein Python: invalid syntax; meinst du `==`?"),
    (TAKE, "return self.kept +", 7, PYTHON),
    (TAKE, "x = 1\n          y = 2", 8, INDENT),
    (SEND, "return None", 7, "gab None zurück; nötig ist eine Liste"),
    (SEND, "return rows * 500", 7, "gab mehr als 1000 Emissionen"),
    (SEND, "return [rows[0]._replace(arm=7)]", 7, "falsch ist: arm; möglich sind die Arme (0, 1,"),
    ("", "from kaju import MaterialAgnt", 1, "kein `MaterialAgnt`; meinst du `MaterialAgent`?"),
    ("", "from dataclasses import dataclass", 1, "Zeile 1: `dataclasses` hat kein `dataclass`"),
    ("class Np: pass\n", "np.sqrt(2)", 2, "Zeile 2: `np` ist nicht bekannt"),
    ("", "x = 1", 1, "there is no class of agents"),
    (CLASS, "def respond(self, load): pass", 3, "niemand ruft `respond` auf; meinst du `take`?"),
    (CLASS, "def step(self):\n\n        self.take(None)", 3, "ruft nie `super().step()` auf"),
    (CLASS, "def on_tick(self): pass", 3, "niemand ruft `on_tick` auf; meinst du `step`?"),
    (CLASS, "def take(self, load): self.model.threshold = 1", 3, "`threshold` gehört zum Modell"),
    (CLASS, "def passOn(self, load): pass", 3, "niemand ruft `passOn` auf; meinst du `pass_on`?"),
    (CLASS, "def __init__(self, *start):\n        self.x = 1", 4, "muss super().__init__ mit"),
    ("from kaju import *\n", "class Own(PrescribedRule): pass", 2, "PrescribedRule gibt es in der"),
    (CLASS, "state = State('x')", 3, "its default must be a number"),
]


def test_mistakes_are_named_with_their_line_and_the_page_lives_on(opened, pages):
    page = opened(pages["sides"], language="de-DE")
    for before, line, number, words in MISTAKES:
        found = runs(page, before + line + "\n")
        assert (found.get("line"), words in found.get("error", "")) == (number, True), (line, found)
        assert found["error"].startswith(f"Zeile {number}: ")
        assert words[:5] != "Zeile" or found["error"] == words  # no odd suggestion
        assert page.js("page.own === null") == page.text(".verdict").startswith("Jede Last")
    growing = SEND + "return [row._replace(share=3.0) for row in rows]\n"
    assert runs(page, growing)["grew"] == 7
    assert "Zeile 7: die Lasten sind auf das Tausendfache" in page.text("aside")
    assert runs(page, READY["standard"]["code"])["agents"] > 30


ATTACKS = (
    "import os", "import browser", "from browser import window", "from javascript import fetch",
    "eval('1')", "exec('1')", "open('/etc/passwd')", "window.location", "document.body",
    "().__class__.__bases__", "__import__('os')", "globals()", "from kaju import _page",
    "import kaju; kaju._page", "getattr(1, 'a')", "vars()", "compile('1', '', 'eval')",
)  # fmt: skip
TOUCHES = """(async () => {
  const names = ["fetch", "XMLHttpRequest", "WebSocket", "importScripts", "indexedDB"];
  const touch = async () => {
    const found = names.map((name) => typeof globalThis[name]);
    try { await import("https://kaju.invalid/a.js"); found.push("came"); }
    catch { found.push("shut"); }
    postMessage(found);
  };
  const begin = page.studio.blob.replace(/onmessage = [^]*$/, "");
  const text = `${begin}\\n${"const names = "}${JSON.stringify(names)};onmessage = ${touch};`;
  const worker = new Worker(URL.createObjectURL(new Blob([text])));
  return new Promise((done) => {
    worker.onmessage = ({ data }) => { if (data.ready) worker.postMessage(0); else done(data); };
  });
})()"""


def test_nothing_reaches_out_of_an_agent(opened, pages):
    page = opened(pages["sides"])
    for attack in ATTACKS:
        found = runs(page, f"x = 1\n{attack}\n")
        assert found.get("line") == 2, (attack, found)
    with page.tab.expect_event("requestfailed") as shut:
        assert page.js(TOUCHES) == ["undefined"] * 5 + ["shut"]
    assert shut.value.failure == "csp"
    policy = page.tab.locator("meta[http-equiv]").get_attribute("content")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "connect-src" not in policy
    page.messages.clear()  # the browser says that its policy has shut the import out
    page.requests.remove("https://kaju.invalid/a.js")


def test_what_comes_from_others_runs_only_when_asked(opened, tmp_path):
    """A link's code is shown; names of a scene and texts of a file are words, nothing else."""
    bad, name = "<img src=x onerror='document.title=1'>", 'a"""\nprint("has run")\n"""\\'
    materials = {name: {"youngs_modulus": 1e9, "poissons_ratio": 0.3}}
    scene = Scene(**PLATE | {"body": PLATE["body"] | {"material": name}, "materials": materials})
    path = kaju.export_page(scene, tmp_path / "page.html", title=bad, text=bad, python=True)
    page = opened(path)
    code = "from kaju import MaterialAgent\nclass A(MaterialAgent): pass\nprint('has run')\n"
    page.js(f"page.studio.code = {code!r}")
    page.js("page.studio.best = 0.25, page.studio.values = {strength: 1.16}")  # of another agent
    page.press("Copy link")
    page.until("location.hash.includes('s=')")
    page.tab.get_by_role("tab", name="Agent").click()
    with page.tab.expect_download() as download:
        page.press("Save as Python")
    download.value.save_as(tmp_path / "agent.py")
    tree = ast.parse((tmp_path / "agent.py").read_text())
    assert ast.unparse(tree.body[-1]).count("material_agent=A, seed=1)") == 1
    kinds = [type(node) for node in tree.body]
    assert kinds == [ast.ImportFrom, ast.ClassDef, ast.Expr, ast.Assign, ast.If]
    assert tree.body[2].value.args[0].value == "has run"  # the pupil's own line, not the name's
    saved = Scene.from_toml(tree.body[3].value.value)
    assert saved.cell_materials[0].name == name
    other = opened(path)
    other.tab.goto(page.tab.url)
    other.tab.reload()
    other.until("page?.drawn > 0 && page.studio.foreign")
    studio = other.js("[page.studio.active, page.studio.printed, page.studio.code]")
    assert studio == [False, "", code]
    assert "somebody else" in other.text(".body")
    assert "best of the class 0.25 N" in other.text("header")
    assert other.tab.title() == bad
    assert bad in other.text("h1")


def test_states_are_colours_and_lines_of_the_story_and_step_back(opened, pages):
    page = opened(pages["sides"])
    runs(page, READY["tired"]["code"])
    stage = in_kaju(READY["tired"]["code"], SCENES["sides"])
    (course,) = stage.states
    most = "page.look.colour = 'state count', Math.max(...page.values().filter((v) => v >= 0))"
    for generation in (stage.generations, 3, 1):
        page.js(f"page.seek({generation})")
        assert page.js(most) == max(course.values(generation))
    page.js("page.seek(Infinity)")
    page.js(f"page.pick(page.run.lattice.key({[int(i) for i in stage.cells[0]]}))")
    page.js("page.draw()")
    assert f"loads taken so far\n{course.values()[0]:g}" in page.text(".story")


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
    page.tab.get_by_label("Begin with").select_option("pillar")
    page.until("!page.studio.pending")
    field.press("Control+End")
    page.tab.keyboard.type("garbage(")
    page.tab.keyboard.press("Control+Enter")
    page.until("page.studio.problem")
    field.press("Control+z")  # nothing was typed since it ran: the run before
    page.until("!page.studio.pending")
    pillar, standard = (READY[name]["code"] for name in ("pillar", "standard"))
    assert field.input_value() == pillar
    for begin, code in (("Start this agent again", pillar), ("Standard rule", standard)):
        field.press("Control+End")
        page.tab.keyboard.type("garbage(")
        page.press(begin)
        assert field.input_value() == code
        page.js("page.past.go(-1)")  # what was typed and did not run comes back
        assert field.input_value() == f"{pillar}garbage("
        page.until("page.studio.problem")
        assert ("standard rule" in page.text(".body")) == (code == standard)
        page.press("Start this agent again")
        page.until("!page.studio.pending")


WHOLE, Base = 1.0, MaterialAgent


def left_of(agent):
    return floor(1e9 * m.fabs(WHOLE - agent.part * agent.random.random())) / 1e9


class Losing:
    def emissions(self, load):
        left = left_of(self)
        return [row._replace(share=left * row.share) for row in super().emissions(load)]


class Fickle(Losing, Base):
    part = Parameter(0.1, 0.0, 1.0, "largest part that is lost")


def by_column(agents):
    drawn = agents[0].random.sample(agents, len(agents))
    agents[0].random.shuffle(drawn)
    return drawn[:2]


class Stopped(LoadModel):
    def step(self):
        super().step()
        self.running = self.generation < 3


def test_a_page_that_runs_another_model_than_was_recorded_says_so(opened, tmp_path):
    model = Stopped(SCENES["sides"], material_agent=Fickle, rng=7)
    page = opened(kaju.export_page(model, tmp_path / "page.html", python=True))
    runs(page, page.js("page.studio.code"))
    told = page.js("page.studio.score()")
    result = opened(kaju.export_page(model.result(), tmp_path / "result.html", python=True))
    assert "is that of Fickle, not of the class below" in result.text("aside")
    assert f"3 generations and {model.result().last.ledger.taken:.4g} N taken. The page" in told
    code = page.js("page.studio.code") + "\n"  # another code than that of the record
    runs(page, code + "def mine(waiting): print(waiting[0].random.sample(range(99), 3))\n")
    assert page.js("page.studio.printed").startswith(f"{Random(7).sample(range(99), 3)}\n")


def test_a_models_order_numbers_and_seed_are_those_of_its_page_and_of_what_is_saved(
    opened, tmp_path
):
    model = LoadModel(SCENES["sides"], material_agent=Fickle, order=by_column, part=0.8, rng=7)
    page = opened(kaju.export_page(model, tmp_path / "page.html", python=True))
    with page.tab.expect_download() as saved:
        page.press("Save as Python")
    code = saved.value.path().read_text("utf-8")
    assert "material_agent=Fickle, order=by_column, part=0.8, seed=7)" in code
    found, last = runs(page, page.js("page.studio.code")), model.again(model.scene).run().last
    assert (found["taken"], found["generations"]) == pytest.approx(
        (last.ledger.taken, last.generations), rel=1e-12
    )
    runs(
        page,
        "from kaju import *\n\nclass A(MaterialAgent): pass\norder = lambda waiting: waiting[:1]",
    )
    alone = runs(page, "from kaju import *\n\nclass A(MaterialAgent): pass")  # no order is left
    usual = kaju.LoadModel(SCENES["sides"], engine="agents").run().last.generations
    assert alone["generations"] == usual
    with pytest.raises(kaju.KajuError, match="python: should be a valid boolean"):
        kaju.export_page(model, tmp_path / "page.html", python=Fickle)


class Switched(MaterialAgent):
    on = kaju.Parameter(False, text="passes on")

    def pass_on(self, load):
        if self.on:
            super().pass_on(load)


def test_a_parameter_that_is_true_or_false_is_a_tick(opened, tmp_path):
    model = LoadModel(SCENES["sides"], material_agent=Switched, on=True)
    page = opened(kaju.export_page(model, tmp_path / "page.html", python=True))
    assert runs(page, page.js("page.studio.code"))["agents"] == len(model.run().last.cells) > 1
    assert page.tab.get_by_text("A challenge:").count() == 0  # of an agent of one's own
    page.tab.get_by_label("passes on").click()
    page.until("page.studio.result?.agents === 1")


class Damped(kaju.RigidBoundaryAgent):
    def give_back(self, load, arm):
        return self.turn(load, arm)._replace(magnitude=0.5 * load.magnitude)


class Unbooked(MaterialAgent):
    def take(self, load):
        pass


@pytest.mark.parametrize(("own", "told"), [
    ({"boundary_agents": {"rigid": Damped}}, "met rigid cells and sides. 0.3 N met rollers. Bo"),
    ({"material_agent": Unbooked}, "The books do not balance: 76.6 % of all"),
])  # fmt: skip
def test_a_page_tells_of_its_own_run_what_the_recorded_one_told(opened, tmp_path, own, told):
    model = LoadModel(SCENES["sides"], **own)
    page = opened(kaju.export_page(model, tmp_path / "page.html", python=True, exact=True))
    curves = "[page.run.absorbed ?? [], page.run.ended ?? []]"
    recorded = page.js(curves)
    runs(page, page.js("page.studio.code"))
    assert page.js(curves) == [pytest.approx(curve, rel=1e-12) for curve in recorded]
    score = page.js("page.studio.score()")
    assert told in score
    assert "Recorded in Python" not in score
    assert page.js("page.studio.challenge()") == ["", ""]
    assert ("Boundaries absorbed" in score) == bool(recorded[0])


LOOKS = (
    CLASS
    + """def pass_on(self, load):
        super().pass_on(load)
        if self.spawn_step == self.model.generation == 3:
            near = [(agent.index, round(agent.kept, 9)) for agent in self.cell.neighborhood.agents]
            places = [cell.coordinate for cell in self.cell.neighborhood]
            print(near, places, self.cell.agents[0].index)
"""
)


@pytest.mark.parametrize("name", ["sides", "hexagons", "cubes"])
def test_agents_of_a_page_see_the_same_neighbours_in_the_same_order(opened, pages, capsys, name):
    in_kaju(LOOKS, SCENES[name])
    told = capsys.readouterr().out
    page = opened(pages[name])
    assert runs(page, LOOKS)["agents"] > len(told.splitlines()) > 2
    assert page.js("page.studio.printed") == told


def test_what_has_no_source_at_hand_leaves_code_that_python_reads():
    for own in (
        {"material_agent": type("Mine", (MaterialAgent,), {})},
        {"order": lambda waiting: waiting[:1]},
        {"order": partial(sorted, key=id)},
    ):
        told = header_of(packed_page(LoadModel(SCENES["sides"], **own), python=True))
        assert ast.parse(told["python"]["code"]).body == []


def test_the_timeline_of_many_stages_keeps_to_the_picture_beside_the_editor(shown):
    page = shown(plate([8, 8], [4, 7], steps=20), python=True)
    foot, last = (page.tab.locator(of).last.bounding_box() for of in ("footer", "footer select"))
    assert last["x"] + last["width"] <= foot["x"] + foot["width"]
    assert last["y"] + last["height"] <= foot["y"] + foot["height"] <= 720


def test_without_brython_the_error_says_what_to_install(monkeypatch, tmp_path):
    written.worker.cache_clear()
    monkeypatch.setitem(sys.modules, "brython", None)
    with pytest.raises(kaju.KajuError, match=r"pip install 'kaju\[page\]'"):
        kaju.export_page(Scene(**PLATE), tmp_path / "a.html", python=True)
    written.worker.cache_clear()
