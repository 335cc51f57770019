"""`kaju watch`: agents in Python, one session a browser, and nobody in another's way."""

import base64
import json
import re
import signal
import subprocess
import sys
import time
import zlib
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from itertools import pairwise
from statistics import median
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from live_pages import BrowserPage, asked, serving, session
from page_scenes import random_scenes
from plates import PLATE
from plates import plate as pressed
from websockets.exceptions import ConnectionClosed, InvalidStatus

import kaju
from kaju import ElasticModel, FaceAgent, LoadModel, MaterialAgent, PrescribedRule, Scene
from kaju.errors import ParameterError
from kaju.view.page import server
from kaju.view.page.live import LiveRun, scene_from, sessions_of
from kaju.view.page.packing import unpack
from kaju.view.page.scene_data import scene_data

IN_STAGES = [{"cell": [10, 19], "force": [0.0, -2.0], "steps": 4}]


def plate(**rule):
    return Scene(**PLATE | {"loads": IN_STAGES}, rule=PrescribedRule(**rule))


def changed(scene, generation=0, stage=1, **rule):
    """The message of a page in which the rule was changed."""
    data, columns = scene_data(scene)
    data["rule"] |= rule
    cells = base64.b64encode(columns["cells"].tobytes()).decode()
    message = {"type": "scene", "scene": data, "cells": cells}
    return json.dumps(message | {"generation": generation, "stage": stage})


def told(run, message):
    return unpack(run.answer(message if isinstance(message, str) else json.dumps(message)))


def steps(generations, **others):
    """The message of a page that is played on."""
    return {"type": "step", "generations": generations} | others


def history(answers, name=""):
    """All rows that answers hold: generation, state, load."""
    rows, generation = [], 0
    for _, columns in answers:
        offset, delta = columns[f"{name}offset"], columns[f"{name}delta"].astype(np.int64)
        for first, last in pairwise(offset):
            generation += 1
            states = np.cumsum(delta[first:last].astype(np.uint32), dtype=np.uint32)
            rows += [
                (generation, int(state), float(load))
                for state, load in zip(states, columns[f"{name}load"][first:last], strict=True)
            ]
    return rows


class Tired(MaterialAgent):
    def step(self):
        if self.model.generation > 3:
            raise ValueError("I am tired")
        super().step()


# ------------------------------------------------------------------------------- one session


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_answers_are_the_history_of_the_run(engine):
    scene = plate(threshold=1e-3)
    run = LiveRun(scene, lambda asked: LoadModel(asked, engine=engine))
    answers = [told(run, {"type": "hello"})]
    while not answers[-1][0]["at_rest"]:
        answers.append(told(run, steps(2)))
    last, lattice = LoadModel(scene).run().last, scene.lattice
    key, wanted = lattice.key(last.cells), last.history
    states = key[wanted.agent] * 4 + wanted.direction
    theirs = sorted(zip(wanted.generation, states, wanted.load, strict=True))
    mine = sorted(history(answers))
    assert [row[:2] for row in mine] == [row[:2] for row in theirs]
    np.testing.assert_allclose([row[2] for row in mine], [row[2] for row in theirs], rtol=1e-6)
    born = np.concatenate([columns["key"] for _, columns in answers])
    assert sorted(born) == sorted(key)
    order = {k: row for row, k in enumerate(key)}
    rows = [order[k] for k in born]
    spawn = np.concatenate([columns["spawn"] for _, columns in answers])
    woken = np.concatenate([columns["woken"] for _, columns in answers])
    np.testing.assert_array_equal(spawn, last.spawn_step[rows])
    np.testing.assert_array_equal(woken, last.woken_by[rows])
    for name, wanted in (("passed", last.passed[rows]), ("dropped", last.dropped[rows, None])):
        amounts = np.zeros(wanted.shape)
        for _, place, amount in history(answers, f"{name} "):
            row, column = divmod(place, wanted.shape[1])
            amounts[list(born).index(row), column] += amount
        np.testing.assert_allclose(amounts, wanted, rtol=1e-6, atol=1e-12)
    assert answers[0][0]["certificate"]["stable"] is True
    assert answers[-1][0]["outcome"] == last.outcome


def test_a_scene_comes_back_as_it_was_sent():
    """Squares, hexagons, cubes; what a page sends is the scene, at any stage of its loading."""
    for scene, _ in random_scenes(30, seed=3):
        data, columns = scene_data(scene)
        for stage in {1, scene.stages}:
            back = scene_from(json.loads(json.dumps(data)), columns["cells"].ravel(), stage)
            wanted, found = scene.applied(stage), back.applied()
            np.testing.assert_array_equal(found.cells, wanted.cells)
            np.testing.assert_allclose(found.force, wanted.force, rtol=1e-15)
            np.testing.assert_array_equal(back.rasterise() < 0, scene.rasterise() < 0)
            assert back.rule == scene.rule


def test_a_changed_rule_is_run_up_to_the_generation_that_is_shown():
    scene = plate()
    run = LiveRun(scene)
    header, columns = told(run, changed(scene, generation=3, stage=4, threshold=1e-4))
    assert header["fresh"]
    assert len(columns["offset"]) == 4
    finer = LoadModel(plate(threshold=1e-4)).run().last
    first = finer.history.generation <= 3
    assert columns["load"].sum() == pytest.approx(finer.history.load[first].sum(), rel=1e-6)
    assert len(columns["key"]) == (finer.spawn_step <= 4).sum()
    header, _ = told(run, changed(scene, accumulate=True))
    assert header["certificate"]["stable"] is False
    assert "loads grow" in header["certificate"]["verdict"]


def test_an_early_stage_takes_its_part_of_the_load():
    _, columns = told(LiveRun(plate()), changed(plate(), generation=1, stage=1))
    assert columns["load"].tolist() == [0.5]


def test_elasticity_is_answered_by_cell():
    scene = Scene(**PLATE)
    header, columns = told(LiveRun(scene), {"type": "elastic"})
    solved = kaju.solve(scene.replace(rule=kaju.ElasticRule()), strategy="uniform")
    key = scene.lattice.key(scene.lattice.locate(solved.middle))
    moved, stress = columns["displacement"].reshape(2, -1), columns["stress"].reshape(3, -1)
    np.testing.assert_allclose(moved[:, key].T, solved.displacement, rtol=1e-12)
    np.testing.assert_allclose(stress[2][key], solved.stress[:, 0, 1], rtol=1e-12)
    assert np.isnan(np.delete(moved, key, axis=1)).all()
    assert header["subdivision"] == 1


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        ("{", "is not JSON"),
        ("[1]", "a table is needed"),
        ({"type": "import os"}, "no message 'import os'"),
        (steps(0), "generations"),
        (steps(1e99), "generations"),
        (steps(True), "generations"),
        ({"type": "scene"}, "scene: a table"),
        (changed(plate(), threshold=-1.0), "threshold"),
        (changed(plate(), threshold="1"), "threshold"),
        (changed(plate(), file="/etc/passwd"), "file"),
        (changed(plate()).replace('"cells": "', '"cells": "%'), "base64"),
        (changed(plate()).replace('"shape": [20, 20]', '"shape": [20, 21]'), "do not fill"),
    ],
)
def test_what_is_no_question_is_refused_and_changes_nothing(message, complaint):
    run = LiveRun(plate())
    told(run, steps(2))
    header, columns = told(run, message)
    assert complaint in header["error"]
    assert not columns
    header, columns = told(run, {"type": "step"})
    assert "error" not in header
    assert len(columns["offset"]) == 2


def test_a_scene_can_name_no_file(tmp_path):
    """Nothing that a message holds is read as a path, wherever it stands."""
    secret = tmp_path / "secret.png"
    secret.write_bytes(b"mine")
    data, columns = scene_data(plate())
    data |= {"body": {"image": str(secret)}, "image": str(secret), "array": str(secret)}
    data["lattice"]["array"] = data["materials"][0]["file"] = str(secret)
    cells = base64.b64encode(columns["cells"].tobytes()).decode()
    header, _ = told(LiveRun(plate()), {"type": "scene", "scene": data, "cells": cells})
    assert "error" not in header
    data["sides"]["bottom"] = {"image": str(secret)}
    header, _ = told(LiveRun(plate()), {"type": "scene", "scene": data, "cells": cells})
    assert "sides" in header["error"]
    assert "mine" not in header["error"]


def test_agents_that_fail_are_reported_with_what_they_did_before(caplog):
    run = LiveRun(plate(), LoadModel(plate(), material_agent=Tired).again)
    header, columns = told(run, steps(9))
    assert header["error"] == "ValueError: I am tired"
    assert len(columns["offset"]) - 1 == run.model.generation
    assert "I am tired" in caplog.text
    assert told(run, {"type": "hello"})[0]["fresh"]


# ---------------------------------------------------------------------------- elastic agents


class Slow(FaceAgent):
    """Yields by half of what it should."""

    def due(self, asked):
        return 0.5 * asked


def elastic(order="multilevel", **options):
    rule = {"kind": "elastic", "order": order, "tolerance": 1e-2, **options}
    body = {"size": [0.1, 0.1], "thickness": 0.002, "rule": rule}
    return pressed([8, 8], [4, 7], [1.0, -2.0], **body)


@pytest.mark.parametrize("order", ["multilevel", "wave", "largest first"])
def test_frames_are_the_steps_of_elastic_agents(order):
    run, model = sessions_of(elastic(order))(), ElasticModel(elastic(order))
    faces = model.table.levels[0].size
    header, columns = told(run, {"type": "hello"})
    assert (header["fresh"], header["at"]) == (True, [0.0])
    total = 0
    for generations in (1, 3, 2):
        header, columns = told(run, steps(generations))
        left = columns["value load_left"].reshape(generations, faces)
        taken = columns["value load_taken"].reshape(generations, faces)
        moved = columns["moved"].reshape(generations, faces, 2)
        for frame in range(generations):
            model.step()
            ground = model.state.levels[0]
            np.testing.assert_allclose(left[frame], abs(ground.left[:faces]), rtol=1e-6)
            np.testing.assert_allclose(taken[frame], ground.taken, rtol=1e-6)
            along = np.take_along_axis(moved[frame], model.table.levels[0].place[0][:, None], 1)
            np.testing.assert_allclose(along[:, 0], ground.displacement, rtol=1e-6)
            total += 1
            assert (header["at"][frame], header["visits"][frame]) == (total, model.visit.level)
        awake = columns["born"] <= total
        assert (awake == (ground.spawn_step > 0)).all()
        pushes = header["curves"][3]["lines"]["pushes"]
        assert pushes == [record.pushes for record in model.history[-generations:]]


def test_what_lies_across_a_face_moves_with_its_neighbours():
    """At the end faces move as the answer says they do, along and across."""
    run, model = sessions_of(elastic(tolerance=1e-9))(), ElasticModel(elastic(tolerance=1e-9))
    answer = model.run().result
    while not (last := told(run, steps(64)))[0]["at_rest"]:
        pass
    middle = model.table.positions(0)
    moved = last[1]["moved"].reshape(-1, len(middle), 2)[-1]
    wanted = answer.displacement_at(middle)
    assert abs(moved - wanted).mean() < 0.02 * abs(wanted).max()
    assert abs(moved - wanted).max() < 0.2 * abs(wanted).max()  # beside the load


def test_many_steps_make_a_frame_where_a_page_asks_for_it():
    run = sessions_of(elastic("largest first"))()
    header, columns = told(run, steps(3, every=16))
    assert header["at"] == [16.0, 32.0, 48.0]
    assert len(columns["value load_left"]) % 3 == 0
    assert len(header["curves"][0]["at"]) == 48


def test_elastic_agents_of_ones_own_are_watched():
    model = ElasticModel(elastic("wave"), face_agent=Slow)
    run = sessions_of(model)()
    told(run, steps(4))
    assert isinstance(next(iter(run.model.agents)), Slow)
    assert model.generation == 0
    header, columns = told(run, {"type": "scene"})
    assert "no message 'scene' for this rule" in header["error"]
    assert not columns


# ------------------------------------------------------------------------------- the server


@pytest.fixture(scope="module")
def port():
    with serving(plate()) as found:
        yield found


def get(port, path, **headers):
    with closing(HTTPConnection("127.0.0.1", port)) as connection:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer, answer.read().decode()


def test_the_page_may_talk_to_its_server_only(port):
    answer, text = get(port, "/")
    assert answer.status == 200
    assert answer.headers["x-frame-options"] == "DENY"
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', text)[1]
    assert policy.startswith("default-src 'none'; connect-src 'self'; script-src 'sha256-")


@pytest.mark.parametrize("path", ["/etc/passwd", "/../pyproject.toml", "/plate.toml", "/static/"])
def test_no_file_is_served(port, path):
    assert get(port, path)[0].status == 404


@pytest.mark.parametrize("name", ["evil.example", "10.0.0.1"])
def test_other_names_of_this_machine_are_refused(port, name):
    assert get(port, "/", Host=f"{name}:{port}")[0].status == 400
    with pytest.raises(InvalidStatus, match="400"):
        session(port, name)


@pytest.mark.parametrize("origin", ["http://evil.example", "https://127.0.0.1", "null", None])
def test_other_pages_are_refused(port, origin):
    with pytest.raises(InvalidStatus, match="403"):
        session(port, origin=origin)


def test_localhost_is_this_machine_too(port):
    with session(port, "localhost") as websocket:
        assert asked(websocket, {"type": "hello"})[0]["fresh"]


def test_sessions_do_not_see_each_other(port):
    with session(port) as one, session(port) as other:
        asked(one, steps(5))
        _, columns = asked(other, {"type": "step"})
        assert columns["load"].tolist() == [2.0]
        header, _ = asked(one, changed(plate(), generation=2, stage=4, threshold=1e-4))
        assert header["fresh"]
        header, _ = asked(other, steps(9))
        assert header["at_rest"]
        assert header["outcome"] == "at rest after 8 generations"


def test_one_that_fails_hurts_nobody():
    of = LoadModel(plate(), material_agent=Tired)
    with serving(of) as port, session(port) as one, session(port) as other:
        assert "tired" in asked(one, steps(9))[0]["error"]
        assert "error" not in asked(other, {"type": "step"})[0]
        assert "is not JSON" in asked(one, "\x00")[0]["error"]
        assert asked(one, {"type": "hello"})[0]["fresh"]


def test_idle_sessions_are_dropped():
    with serving(plate(), idle=0.3) as port, session(port) as websocket:
        assert asked(websocket, {"type": "hello"})[0]["fresh"]
        with pytest.raises(ConnectionClosed, match="load the page again") as closed:
            websocket.recv(timeout=120)
        assert closed.value.rcvd.code == server.GONE


def test_there_is_an_end_to_sessions(port, monkeypatch):
    monkeypatch.setattr(server, "MOST_SESSIONS", 2)
    with session(port) as one, session(port) as other:
        asked(one, {"type": "hello"})
        asked(other, {"type": "hello"})
        with session(port) as third, pytest.raises(ConnectionClosed, match="close one") as closed:
            third.recv(timeout=120)
        assert closed.value.rcvd.code == server.FULL


def test_who_does_not_know_the_token_stays_out():
    with serving(plate(), token="secret") as port:
        for path in ("/", "/?token=guess", "/?token=", "/?token=%ff"):
            answer, text = get(port, path)
            assert answer.status == 403
            assert "open the address" in text
        for query in ("", "?token=guess"):
            with pytest.raises(InvalidStatus, match="403"):
                session(port, query=query)
        answer, text = get(port, "/?token=secret")
        assert answer.status == 200
        code = re.search(r'id="kaju-code">([^<]+)<', text)[1]
        assert b"/session${location.search}" in zlib.decompress(base64.b64decode(code))
        with session(port, query="?token=secret") as websocket:
            assert asked(websocket, {"type": "hello"})[0]["fresh"]


def test_frames_and_numbers_that_no_page_sends_get_an_answer(port):
    with session(port) as websocket:
        websocket.send(b"\0")
        assert "is not JSON" in unpack(websocket.recv(timeout=120))[0]["error"]
        websocket.send(b'{"type": "step"}')
        assert "error" not in unpack(websocket.recv(timeout=120))[0]
        for number in ("9" * 400, "9" * 5000, "1e999", "NaN", "-Infinity", "1" + "0" * 320):
            text = f'{{"type": "step", "generations": {number}}}'
            assert "is not JSON" in asked(websocket, text)[0]["error"]
        assert "a whole number from 1 to 10000" in asked(websocket, steps(10**200))[0]["error"]


def test_what_creeps_is_played_from_its_start_to_its_last_time():
    history = kaju.History.step().hold(10.0)
    dough = kaju.ThreeElement(K_f=2.0, D_f=1.0, D_d=20.0)
    model = kaju.CreepModel(dough, history, times=[0, 1, 5, 10])
    model.run(1)
    with serving(model) as port:
        _, page = get(port, "/")
    data = re.search(r'id="kaju-data"[^>]*>([^<]+)<', page)[1]
    shown, _ = unpack(base64.b64decode(data))
    assert shown["kind"] == "pictures"
    assert shown["at"] == [0.0, 1.0, 5.0, 10.0]
    assert model.moment == 1.0


def test_what_cannot_be_watched_is_told():
    with pytest.raises(ParameterError, match=r"got SpawningModel; kaju\.export_page"):
        server.watch_app(kaju.SpawningModel(Scene(**PLATE)))
    with pytest.raises(ParameterError, match="port: 99999"):
        kaju.watch(plate(), 99999, browser=False)


@pytest.mark.slow
def test_a_click_is_answered_at_once_on_forty_thousand_cells():
    """Median of 20 steps with ten sessions open, of which one fails; processor time of all."""
    rule = PrescribedRule(alpha=(0.5, 0.6, 0.12), threshold=1e-5, accumulate=True)
    body = {"size": [0.2, 0.2], "thickness": 0.002, "rule": rule}
    scene = pressed([200, 200], None, loads=[{"side": "top", "force": [0.0, -400.0]}], **body)
    with serving(scene) as port, ExitStack() as open_sessions:
        sessions = [open_sessions.enter_context(session(port)) for _ in range(10)]
        for websocket in sessions:
            asked(websocket, {"type": "hello"})
        assert "error" in asked(sessions[0], "no message")[0]
        asked(sessions[1], steps(30))
        spent = []
        for number in range(20):
            began = time.process_time()
            header, columns = asked(sessions[1 + number % 9], {"type": "step"})
            spent.append(time.process_time() - began)
            assert "error" not in header
            assert len(columns["load"]) > 0
    assert median(spent) < 0.1


# ---------------------------------------------------------------- the command, and a browser


def test_the_command_serves_until_it_is_interrupted():
    words = [sys.executable, "-m", "kaju", "watch", "--port", "0", "--no-browser"]
    pipe = subprocess.PIPE
    started = subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True)
    try:
        address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", started.stdout.readline())[0]
        with urlopen(address) as answer:  # the server listens before it says so
            assert b'id="kaju"' in answer.read()
        with pytest.raises(HTTPError, match="400"):
            urlopen(Request(address, headers={"Host": "evil.example"}))
    finally:
        started.send_signal(signal.SIGINT)
        _, errors = started.communicate(timeout=120)
    assert errors == ""
    assert started.returncode == 0


@pytest.fixture
def watched(chromium):
    """Open the page of a server of something, which says nothing to the console."""
    with ExitStack() as servers:
        pages = []

        def watch(of):
            port = servers.enter_context(serving(of))
            page = BrowserPage(chromium, f"http://127.0.0.1:{port}/")
            servers.callback(page.context.close)
            pages.append(page)
            page.until("page.g === 1")
            return page

        yield watch
    for page in pages:
        assert page.messages == []


TOTAL = "page.sums.taken.sum.reduce((a, b) => a + b)"


def test_a_browser_steps_plays_and_changes_what_python_computes(watched):
    page = watched(plate())
    page.tab.keyboard.press("ArrowRight")
    page.until("page.g === 2")
    page.press("Play")
    page.until("page.run.atRest && page.g === 8")
    last = LoadModel(plate()).run().last
    assert page.js("page.run.agents") == len(last.cells)
    assert page.js(TOTAL) == pytest.approx(last.ledger.taken, rel=1e-6)
    page.js("page.change(() => { page.scene.rule.threshold = 0.001; })")
    page.until("page.run.atRest && page.run.agents === 85")
    assert "11 generations" in page.js("page.parts.verdict.textContent")


def test_a_browser_tells_during_the_run_what_own_agents_did(watched):
    scene = Scene(**PLATE)
    page = watched(LoadModel(scene, material_agent=Tired))
    page.js("page.seek(2)")
    page.until("page.g === 2")
    model = LoadModel(scene, material_agent=Tired)
    model.run(until=lambda model: model.generation == 2)
    key, last = plate().lattice.key(np.array([[10, 19]]))[0], model.result().last
    story = page.js(f"page.storyOf({key})")
    assert story["passed"] == pytest.approx(last.passed[0].tolist(), rel=1e-6)
    assert story["kept"] == pytest.approx(abs(last.kept[0]).sum(), rel=1e-6)
    total = TOTAL.replace("taken", "passed")
    assert page.js(total) == pytest.approx(last.passed.sum(), rel=1e-6)
    assert page.js(f"(page.seek(1), {total})") == pytest.approx(last.passed[0].sum(), rel=1e-6)
    page.tab.keyboard.press("End")
    page.until("page.parts.verdict.textContent.includes('I am tired')")


class Wearing(MaterialAgent):
    """Hands on less with its wear, after so many loads."""

    wear = kaju.Parameter(0.1, 0.0, 1.0, "wear of what it hands on")
    spared = kaju.Parameter(0, 0, 5, "loads that wear nothing")

    def emissions(self, load):
        share = 1.0 if self.n_loads <= self.spared else 1.0 - self.wear
        return [one._replace(share=share * one.share) for one in super().emissions(load)]

    def take(self, load):
        super().take(load)
        self.n_loads = getattr(self, "n_loads", 0) + 1


def test_parameters_of_own_agents_are_told_and_changed_in_a_message():
    run = LiveRun(plate(), LoadModel(plate(), material_agent=Wearing).again)
    own = unpack(run.opening())[0]["own"]
    by_name = {parameter["name"]: parameter for parameter in own["parameters"]}
    assert by_name["spared"]["whole"]
    wear = {"name": "wear", "label": "wear of what it hands on", "low": 0.0, "high": 1.0}
    assert by_name["wear"] == wear | {"whole": False, "value": 0.1}
    message = json.loads(changed(plate(), generation=40, stage=4))
    for wear in (0.0, 0.4):
        told(run, message | {"parameters": {"wear": wear, "spared": 1}})
        alone = LoadModel(run.model.scene, material_agent=Wearing, wear=wear, spared=1).run()
        np.testing.assert_array_equal(run.model.result().last.taken, alone.last.taken)
    header, _ = told(run, message | {"parameters": {"wear": 2.0}})
    assert header["error"].startswith("wear: must be a number from 0.0 to 1.0")


def test_a_slider_of_a_parameter_runs_the_agents_anew(watched):
    scene = Scene(**PLATE)
    page = watched(LoadModel(scene, material_agent=Wearing))
    page.tab.keyboard.press("End")
    page.until("page.run.atRest && page.g === page.run.generation")
    field = page.tab.get_by_role("textbox", name="wear of what it hands on")
    field.fill("0.5")
    field.press("Enter")
    last = LoadModel(scene, material_agent=Wearing, wear=0.5).run().last
    page.until(f"page.run.atRest && page.run.agents === {len(last.cells)}")
    assert page.js(f"(page.seek(Infinity), {TOTAL})") == pytest.approx(last.ledger.taken, rel=1e-6)
    page.press("Undo")
    first = LoadModel(scene, material_agent=Wearing).run().last
    page.until(f"page.run.atRest && page.run.agents === {len(first.cells)}")


def test_a_browser_steps_elastic_agents_and_goes_back(watched):
    page = watched(elastic())
    for g in (2, 3, 4):
        page.tab.keyboard.press("ArrowRight")
        page.until(f"page.g === {g}")
    page.until("page.drawn > 3")
    seen = page.js("(page.draw(), page.canvas.toDataURL())")
    page.tab.keyboard.press("ArrowLeft")
    assert page.js("page.at[page.g]") == 3
    assert page.js("(page.draw(), page.canvas.toDataURL())") != seen
    page.tab.keyboard.press("End")
    page.until("page.run.atRest && page.g === page.run.generation")
    model = ElasticModel(elastic())
    run = model.run()
    assert page.js("page.at.at(-1)") == model.generation
    page.tab.mouse.click(*page.spot(f"page.view.point(page.middle({run.agents.number[0]}))"))
    left, taken, _, born = page.told()
    assert left == pytest.approx(abs(run.agents.left[0]), rel=1e-5)
    assert taken == pytest.approx(run.agents.taken[0], rel=1e-5)
    assert born == run.agents.spawn_step[0]
    assert page.js("page.parts.verdict.textContent") == run.outcome


def test_frames_that_are_too_many_are_thinned_and_steps_double(watched):
    page = watched(elastic("largest first"))
    page.js("(page.channel.most = 30 * page.count * 4, page.seek(Infinity))")
    page.until("page.at.at(-1) > 200 && page.channel.every > 1")
    at = page.js("page.at")
    assert len(at) <= 100
    assert at == sorted(at)
    assert at[0] == 0


def test_python_answers_with_elasticity_for_cubes(watched):
    scene = pressed([4] * 3, None, loads=[{"side": "top", "force": [0.0, 0.0, -50.0]}])
    page = watched(scene)
    page.press("Elasticity")
    page.until("page.elastic.answer || page.elastic.why", 120)
    solved = kaju.solve(scene.replace(rule=kaju.ElasticRule()), strategy="uniform")
    key = scene.lattice.key(np.array([[1, 2, 3]]))[0]
    at = page.js(f"page.elastic.answer.displacement.map((u) => u[{key}])")
    assert at == pytest.approx(solved.cells().displacement[1, 2, 3], rel=1e-9)
    assert "on average they differ by" in page.js("(page.draw(), page.parts.cards.innerText)")
