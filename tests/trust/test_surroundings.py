"""Whatever a process stands in: odd names, threads, other processes, no assertions, cold caches."""

import multiprocessing
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from textwrap import dedent

import pytest
from plates import PLATE_TEXT
from plates import plate as pressed

from kaju import LoadModel, PrescribedRule, load_result, solve

LONG = "a b 🙂 'q' %s [é] " + "x" * 183
"""A name of 200 characters."""
CREEPING = {"m": {"base": "steel", "rheology": {"K_f": 1e6, "D_f": 1e6, "D_d": 1e7}}}
STRETCHED = {"bottom": "rigid", "top": {"displacement": [0.0, 1e-4]}}
BARE = ("--no-pictures",)
COMMANDS = {
    "new": ("new", "{out}.toml"),
    "run": ("run", "{scene}.toml", "--out", "{out}"),
    "solve": ("solve", "{scene}.toml", "--out", "{out}", *BARE),
    "creep": ("creep", "{scene}.toml", "--hold", "1", "--out", "{out}", *BARE),
    "break": ("break", "{hexagons}.toml", "--strength", "0.1", "--out", "{out}", *BARE),
    "compare": ("compare", "{scene}.toml", "--fit", "20", "--out", "{out}", *BARE),
    "sweep": ("sweep", "{scene}.toml", "--vary", "rule.threshold=0.5", "--out", "{out}"),
    "animate": ("animate", "{stored}.npz", "--out", "{out}.gif"),
    "page": ("page", "{scene}.toml", "--out", "{out}.html"),
    "page of a result": ("page", "{stored}.npz", "--out", "{out}.html"),
    "demo": ("demo", "--out", "{out}", *BARE),
}


def small(force):
    return pressed([6, 6], [3, 5], [0.1 * force, -force], rule=PrescribedRule(threshold=0.2))


def given(force, folder=None):
    """What a scene gives by three ways, as bytes; by way of stored files if there is a folder."""
    scene = small(force)
    found = [solve(scene), solve(scene, tolerance=0.2), LoadModel(scene).run(progress=False)]
    if folder is not None:
        found = [load_result(r.save(folder / f"{force} {n}")) for n, r in enumerate(found)]
    return [result.stress.tobytes() for result in found]


@pytest.mark.parametrize("name", COMMANDS)
def test_names_may_be_long_and_hold_anything(kaju, tmp_path, name):
    assert len(LONG) == 200
    place = tmp_path / LONG
    place.mkdir()
    rule = PrescribedRule(threshold=0.5)
    creeping = pressed([4, 4], [2, 3], material="m", materials=CREEPING, rule=rule)
    creeping.save(place / f"{LONG}.toml")
    changes = {"material": "rubber", "lattice": "hexagon", "thickness": 0.005, "loads": []}
    pressed([4, 4], None, sides=STRETCHED, **changes).save(place / "hexagons.toml")
    LoadModel(small(2.0)).run(progress=False).save(place / f"s {LONG}.npz")
    before = set(place.iterdir())
    names = {"scene": LONG, "stored": f"s {LONG}", "hexagons": "hexagons", "out": f"o {LONG}"}
    whole = {key: str(place / value) for key, value in names.items()}
    code, _, told = kaju(*(word.format(**whole) for word in COMMANDS[name]))
    assert (code, "Traceback" in told) == (0, False), told
    (made,) = set(place.iterdir()) - before
    assert made.stem == names["out"]


def test_threads_get_the_answers_that_each_gets_alone(tmp_path):
    forces = [1.0, 2.0, 3.0, 4.0]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda force: given(force, tmp_path), forces))
    assert together == [given(force) for force in forces]


def python(folder, *words, **options):
    options = {"cwd": folder, "capture_output": True, "text": True, "timeout": 300, **options}
    return subprocess.run([sys.executable, *words], **options)


@pytest.mark.parametrize("how", ["fork", "spawn"])
def test_processes_get_the_answers_of_the_one_that_starts_them(how, tmp_path):
    if how not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {how} on this system")
    program = f"""
        import multiprocessing, kaju

        if __name__ == "__main__":
            scene = kaju.load_scene("s.toml")
            here = kaju.solve(scene)
            with multiprocessing.get_context("{how}").Pool(1) as pool:
                (there,) = pool.map(kaju.solve, [scene])
            print(there.stress.tobytes() == here.stress.tobytes())
        """
    small(1.0).save(tmp_path / "s.toml")
    done = python(tmp_path, "-c", dedent(program))
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


def test_without_assertions_and_docstrings_a_wrong_scene_is_refused_by_name(tmp_path):
    (tmp_path / "s.toml").write_text(PLATE_TEXT.replace("[20, 20]", "[20, -20]"))
    done = python(tmp_path, "-OO", "-m", "kaju", "solve", "s.toml")
    assert done.returncode == 2
    assert "error: " in done.stderr
    assert "body.cells" in done.stderr
