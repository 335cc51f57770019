"""The command, as a person types it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from kaju import TransferResult, load_scene
from kaju.cli.console import Console

EXAMPLES = Path(__file__).parents[2] / "examples"
PLATE = str(EXAMPLES / "plate.toml")
LUG = ["solve", str(EXAMPLES / "lug.toml"), "--goal"]
ROLLER = ["--set", "rule.kind=elastic", "--set", "sides.bottom=roller"]


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def test_run_writes_summary_and_result(kaju):
    code, out, _ = kaju("run", PLATE, "--out", "here", "--no-pictures")
    assert (code, "at rest after 8 generations" in out) == (0, True)
    assert "max displacement             6.409 nm" in out
    assert "load taken                   12.88 N" in out
    assert names("here") == ["result.npz", "summary.json"]
    summary = json.loads(Path("here/summary.json").read_text())
    assert (summary["generations"], summary["material_agents"]) == (8, 34)
    assert summary["load_taken"] == pytest.approx(12.879375)
    assert len(TransferResult.load("here/result.npz").stages) == 20
    assert names(".") == ["here"], "nothing is left beside it"


def test_set_changes_the_scene(kaju):
    settings = ["rule.threshold=0.001", "loads.0.steps=1", "sides.left=rigid"]
    words = [word for setting in settings for word in ("--set", setting)]
    assert kaju("run", PLATE, "--out", "here", "--no-pictures", *words)[0] == 0
    assert json.loads(Path("here/summary.json").read_text())["generations"] == 11
    stored = TransferResult.load("here/result.npz").scene
    assert stored.side_condition("left").kind == "rigid"


def test_results_are_not_overwritten_unless_forced(kaju):
    kaju("run", PLATE, "--out", "here", "--no-pictures")
    Path("here/notes.txt").write_text("mine")
    before = Path("here/summary.json").read_bytes()
    code, _, err = kaju("run", PLATE, "--out", "here", "--no-pictures")
    assert (code, err.startswith("error: here: is not empty")) == (2, True)
    assert Path("here/summary.json").read_bytes() == before
    assert kaju("run", PLATE, "--out", "here", "--no-pictures", "--force")[0] == 0
    assert Path("here/notes.txt").read_text() == "mine"


@pytest.mark.parametrize(("words", "message"), [
    (["run", "missing.toml"], "missing.toml"),
    (["run", PLATE, "--set", "threshold"], "--set: KEY=VALUE is needed, got 'threshold'"),
    (["run", PLATE, "--set", "rule.treshold=1"], "threshold"),
    (["run", PLATE, "--set", "body.thickness=nan"], "thickness"),
    (["run", PLATE, "--set", "rule.accumulate=true"], "loads grow by 15 %"),
    (["solve", PLATE, "--tolerance", "0"], "tolerance"),
    (["check", PLATE, *ROLLER], "plate.toml: line 15: sides: the supports do not hold"),
    ([*LUG, '{"box": [[0, 0], [1, 1]]}'], "goal: {'box': [[0, 0], [1, 1]]}: within true"),
    (["solve", str(EXAMPLES / "pore.toml"), "--goal", "top,z"], "goal: is not taken within true"),
    ([*LUG, "0.1,0.1"], "read it by answer.value_of (not proved)"),
    ([*LUG, "bore,misses"], "(did you mean 'bore,von_mises'?)"),
    (["animate", PLATE], "is a scene; run it first"),
    (["animate", "nothing.npz"], "cannot be read: No such file"),
])  # fmt: skip
def test_what_is_mistyped_is_one_line_and_exit_code_2(kaju, words, message):
    code, out, err = kaju(*words)
    assert code == 2
    assert message in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err
    assert names(".") == [], "nothing half-written"


@pytest.mark.slow
def test_the_commands_work_in_their_order(kaju):
    text = (EXAMPLES.parent / "docs" / "commands.md").read_text()
    block = text.partition("## A first session")[2].split("```")[1]
    commands = [line.partition("#")[0].split() for line in block.strip().splitlines()]
    assert len(commands) >= 10
    drawn = set()
    for words in commands:
        assert words[0] == "kaju"
        again = words[1] in drawn and words[1] in ("run", "solve")
        fitted = words[1:] == ["compare", "my.toml"]
        code, _, err = kaju(*words[1:], *["--no-pictures"] * again, *["--fit", "20"] * fitted)
        assert (code, err) == (0, ""), words
        drawn.add(words[1])
    assert {"summary.json", "result.npz", "agents.png"} <= set(names("my-result"))


def test_new_writes_a_scene_that_runs(kaju):
    assert kaju("new", "mine.toml")[0] == 0
    assert load_scene("mine.toml") == load_scene(PLATE)
    assert "kaju solve part.toml" in kaju("new", "part.toml", "--bracket")[1]
    assert "\nno mistake was found" in kaju("check", "part.toml")[1]
    stepped = ["part.toml", "--set", "body.regions[0].outline=cells"]
    stepped += ["--set", "body.regions[0].disk.radius=0.03"]
    assert "note: outlines are steps of 0.0125 m" in kaju("check", *stepped)[1]
    told = kaju("solve", *stepped, "--no-pictures")[1]
    assert "MPa     beside curved edges it may be" in told
    assert told.count("off by a third or more") == 2  # there, and in a note
    for line in ("agent                0.0125 m", "von Mises at         0.1 m, 0.075 m"):
        assert f"  largest {line}\n" in told
    assert "did you mean 'hole'" in kaju("solve", "part.toml", "--goal", "hol")[2]
    code, _, err = kaju("new", "mine.toml")
    assert (code, "exists already" in err) == (2, True)
    far = ["check", str(EXAMPLES / "lug.toml"), "--set", "loads[0].force=[1e12, 0.0]"]
    assert "a note asks a question" in kaju(*far)[1].splitlines()[-1]
    assert kaju("check", "mine.toml", "--set", "rule.accumulate=true")[0] == 1  # loads grow


def test_figures_are_printed_once_without_rounding_and_apart_from_quoted_names(kaju, capsys):
    assert "; estimated error about " in kaju("solve", PLATE, "--no-pictures")[1].splitlines()[0]
    _, out, _ = kaju("solve", PLATE, "--tolerance", "0.1", "--no-pictures", "--force")
    assert " reaction bottom              0 N, 2 N " in out
    assert "error bound" in out
    assert "error estimate" not in out
    goal = {"quantity": "hoop stress at eye", "value": 2e6, "unit": "Pa", "at_m": [0.1, 0.2]}
    goal |= {"error_estimate": 2e4, "relative_error": 0.01, "error_bound": None}
    told = {"largest_hoop_stress_Pa": {"upper bolt": -1.717e7}, "agents": 5, "goals": [goal]}
    Console().figures(told | {"notes": ["a fact", "is it meant so?"]})
    asked, *of_goal, first, second, fact = capsys.readouterr().out.splitlines()
    assert (asked, fact) == ("  note: is it meant so?", "  note: a fact")
    heads = "goal", "goal value", "goal at", "goal error estimate", "goal relative error"
    assert [line[2:30].strip() for line in of_goal] == [*heads]
    assert first.startswith("  largest hoop stress 'upper bolt' −17.17 MPa")
    assert first.index("−") == second.index("5")


def test_demo_runs_the_worked_plate_and_says_where_the_pictures_are(kaju):
    code, out, _ = kaju("demo", "--out", "demo")
    assert code == 0
    for line in ("demo/plate.html", "demo/agents.png", "demo/spawning.gif"):
        assert str(Path(line)) in out
        assert Path(line).stat().st_size > 1000


def test_importing_kaju_stays_light():
    """Also with a scene."""
    heavy = {"matplotlib", "pandas", "mesa", "numba", "networkx", "scipy", "skfem", "PIL"}
    words = [sys.executable, "-c", "import kaju; kaju.Scene; import sys; print(*sys.modules)"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert heavy.isdisjoint(done.stdout.split())
