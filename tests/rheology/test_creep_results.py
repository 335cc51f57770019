"""Runs in time are results like any other: told, drawn, filmed, stored; and written in scenes."""

import json

import pytest
from PIL import Image
from plates import plate

from kaju import History, Scene, ThreeElement, animate, creep, load_result, plot
from kaju.model.network import triangular

LAW = ThreeElement(K_f=2.0, D_f=3.0, D_d=15.0)
BITE = History().ramp(1.0, 0.5).hold(2.0).release().hold(4.0)
TIMES = [0.25, 0.5, 2.5, 3.0, 6.5]
JELLY = {
    "youngs_modulus": 1e4,
    "poissons_ratio": 0.4,
    "rheology": {"K_f": 1e4, "D_f": 1e4, "D_d": 5e4},
}
CREAM = {
    "youngs_modulus": 1e3,
    "poissons_ratio": 0.3,
    "rheology": {"K_f": 1e3, "D_f": 5e3, "D_d": 1e4},
}


def block(kind, *regions):
    parts = {"materials": {"jelly": JELLY, "cream": CREAM}, "rule": {"kind": kind}, "history": BITE}
    parts |= {"thickness": 0.1, "material": "jelly", "regions": regions}
    return plate([6, 6], [3, 5], [0.0, -0.1], **parts)


LAYER = {"material": "cream", "box": [[0.0, 0.0], [0.06, 0.03]]}
COURSES = {
    "element": lambda: creep(LAW, BITE, times=TIMES),
    "network": lambda: creep(triangular(3), BITE, times=TIMES, rheology=LAW),
    "prescribed body": lambda: creep(block("prescribed"), times=TIMES),
    "elastic body": lambda: creep(block("elastic"), times=TIMES),
    "layers": lambda: creep(block("elastic", LAYER), times=TIMES),
}  # fmt: skip


@pytest.fixture(scope="module", params=sorted(COURSES))
def course(request):
    return COURSES[request.param]()


def test_a_stored_course_is_the_same(course, tmp_path):
    stored = load_result(course.save(tmp_path / "course"))
    assert type(stored) is type(course)
    assert stored.summary() == course.summary()
    assert stored.to_dataframe().equals(course.to_dataframe())
    told = course.summary()
    kept = sum(told[f"{p}_J"] for p in ("stored", "dissipated", "set_free_at_jumps", "numerical"))
    assert kept == pytest.approx(told["work_J"], rel=1e-6)
    for ours, theirs in zip(stored.curves(), course.curves(), strict=True):
        assert (ours.title, ours.unit, list(ours.lines)) == (
            theirs.title,
            theirs.unit,
            list(theirs.lines),
        )


def test_it_is_drawn_and_filmed(tmp_path, coarse):
    for make in COURSES.values():
        assert len(plot(make()).axes) == 4
    course = COURSES["layers"]()
    with Image.open(animate(course, tmp_path / "film.gif", fps=20.0)) as film:
        assert film.n_frames == len(course.times)


STEPS = plate([4, 4], [2, 3], [0.0, -1.0]).to_toml() + "[history]\n"


@pytest.mark.parametrize(("text", "expected"), [
    ("times = [0, 2]\nfactors = [0, 1]", History((0, 2), (0, 1))),
    ("steps = [{ramp = 1.0, duration = 0.5}, {hold = 2.0}, {release = 0.0}, {hold = 4.0}]", BITE),
    ("steps = [{cycles = 2, period = 1.0, high = 3.0}]", History().cycles(2, 1.0, 3.0)),
])  # fmt: skip
def test_a_history_is_written_in_the_scene(text, expected):
    scene = Scene.from_toml(STEPS + text)
    assert scene.history == expected
    again = Scene.from_toml(scene.to_toml())
    assert again == scene
    assert again.history == expected
    assert scene != scene.replace(history=None)


def test_the_command_lets_a_scene_creep(tmp_path, typed):
    scene = tmp_path / "jelly.toml"
    block("elastic").save(scene)
    done = typed("creep", scene, "--out", tmp_path / "here", "--json", "--pictures", "all")
    told = json.loads(done.output)
    assert told == json.loads((tmp_path / "here" / "summary.json").read_text())
    assert {p.name for p in (tmp_path / "here").glob("*.png")} == {"curves.png", "deformed.png"}
    expected = creep(block("elastic"))
    assert told["displacement_left"] == pytest.approx(expected.what_stays())
    assert load_result(tmp_path / "here").what_stays() == told["displacement_left"]
    block("prescribed").save(scene)
    own = typed("creep", scene, "--out", tmp_path / "own", "--no-pictures")
    assert "by the prescribed rule" in own.output
    run = typed("run", scene, "--out", tmp_path / "run", "--no-pictures")
    assert "rheology takes no part" in run.output
    notes = load_result(tmp_path / "run").summary()["notes"]
    assert any("rheology takes no part" in note for note in notes)
