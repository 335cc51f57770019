"""What is to be known of an answer stands in its notes, summary, picture and on the terminal."""

import json

import pytest
from artists import notes
from plates import plate

from kaju import LoadModel, load_result, load_scene, plot, solve
from kaju.errors import SupportError

ROUND = {"disk": {"centre": [0.0, 0.0], "radius": 0.043}, "material": "air"}
CORNER = {"box": [[0.04, 0.04], [0.08, 0.08]], "material": "air"}
PULLED = {"cell": [4, 7], "force": [0.0, 2.0]}
RULE = {"kind": "prescribed", "threshold": 0.1}
CREEPS = {"m": {"base": "steel", "rheology": {"K_f": 1.0, "D_f": 1.0, "D_d": 1.0}}}
SCENES = {
    "rough": ({"loads": [{"cell": [6, 7], "force": [0.0, -2.0]}]}, "error about"),
    "round": ({"regions": [ROUND]}, "outlines are steps"),
    "corner": ({"regions": [CORNER]}, "no limit of stress"),
    "pulled": ({"loads": [PULLED], "rule": RULE}, "pulls squeeze, too"),
    "idle": ({"material": "m", "materials": CREEPS, "rule": RULE}, "materials do not creep here"),
}


def scene_of(changes):
    usual = {"sides": {"left": "rigid"}, "loads": [{"side": "right", "pressure": -1e6}]}
    return plate([8, 8], None, **usual | changes)


@pytest.mark.parametrize("name", SCENES)
def test_a_warning_stands_everywhere_once(kaju, tmp_path, name):
    changes, brief = SCENES[name]
    scene = scene_of(changes)
    verb = "run" if "rule" in changes else "solve"
    result = LoadModel(scene).run() if verb == "run" else solve(scene)
    (short,) = [each for each in result.caveats_in_brief if each.startswith(brief)]
    assert len(result.caveats_in_brief) <= len(result.notes)
    for what in ("stress", "deformed", "agents"):
        shown = " ".join(notes(ax) for ax in plot(result, what).axes)
        assert shown.replace("\n", " ").count(short) == 1
    assert len(set(result.notes)) == len(result.notes)
    assert result.summary()["notes"] == list(result.notes)
    assert load_result(result.save(tmp_path / "stored.npz")).notes == result.notes
    scene.save(tmp_path / "s.toml")
    code, said, _ = kaju(verb, "s.toml", "--out", "out", "--no-pictures")
    assert code == 0
    assert [said.count(f"note: {note}\n") for note in result.notes] == [1] * len(result.notes)
    written = json.loads((tmp_path / "out" / "summary.json").read_text())["notes"]
    assert written == list(result.notes)
    assert load_scene(tmp_path / "s.toml") == scene


def test_what_has_no_proof_says_so_and_why():
    """In space a tolerance is kept by an estimate."""
    load = {"side": "top", "force": [0.0, 0.0, -2.0]}
    answer = solve(plate([2, 2, 2], None, loads=[load]), tolerance=0.3)
    assert answer.tolerance_kept == "estimated"
    assert sum(answer.no_bound in note for note in answer.notes) == 1


def test_a_corner_that_supports_tear_is_refused_by_name():
    """A moved side that meets the ground gives their corner two displacements: endless energy."""
    sides = {"left": {"displacement": [1e-6, 0.0]}, "bottom": "rigid"}
    with pytest.raises(SupportError, match=r"corner at \(0, 0\) m two displacements at once"):
        solve(scene_of({"sides": sides}), tolerance=0.3)
