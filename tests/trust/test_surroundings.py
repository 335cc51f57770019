"""Whatever a process stands in: odd names, threads, other processes, no assertions, cold caches."""

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from textwrap import dedent

import pytest
from plates import plate as pressed

from kaju import LoadModel, PrescribedRule, load_result, solve

LONG = "a b 🙂 'q' %s [é] " + "x" * 183
"""A name of 200 characters."""
SCENE = """
sides = { bottom = "rigid" }
loads = [{ cell = [2, 3], force = [0.0, -2.0] }]
rule = { kind = "prescribed", threshold = 0.5 }
[body]
cell_size = 0.01
cells = [4, 4]
material = "m"
[materials.m]
youngs_modulus = 1e9
poissons_ratio = 0.3
rheology = { K_f = 1e6, D_f = 1e6, D_d = 1e7 }
"""
HEXAGONS = """
sides = { bottom = "rigid", top = { displacement = [0.0, 1e-4] } }
[body]
lattice = "hexagon"
cell_size = 0.01
cells = [4, 4]
thickness = 0.005
material = "rubber"
"""
BARE = ("--no-pictures",)
COMMANDS = {
    "new": ("new", "{out}.toml"),
    "run": ("run", "{scene}.toml", "--out", "{out}"),
    "solve": ("solve", "{scene}.toml", "--out", "{out}", *BARE),
    "creep": ("creep", "{scene}.toml", "--hold", "1", "--out", "{out}", *BARE),
    "break": ("break", "{hexagons}.toml", "--strength", "0.1", "--out", "{out}", *BARE),
    "compare": ("compare", "{scene}.toml", "--fit", "20", "--out", "{out}", *BARE),
    "fit": ("fit", "{scene}.toml", "--runs", "20", "--out", "{out}.toml"),
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
    (place / "scene.toml").write_text(SCENE)
    (place / "hexagons.toml").write_text(HEXAGONS)
    (place / "scene.toml").rename(place / f"{LONG}.toml")
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


@pytest.mark.parametrize("how", ["fork", "spawn"])
def test_processes_get_the_answers_of_the_one_that_starts_them(how):
    if how not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {how} on this system")
    program = f"""
        import multiprocessing, kaju

        if __name__ == "__main__":
            scene = kaju.Scene(
                body=dict(cell_size=0.01, cells=[6, 6], material="steel"),
                sides=dict(bottom="rigid"),
                loads=[dict(cell=[3, 5], force=[0.1, -1.0])],
            )
            here = kaju.solve(scene)
            with multiprocessing.get_context("{how}").Pool(1) as pool:
                (there,) = pool.map(kaju.solve, [scene])
            print(there.stress.tobytes() == here.stress.tobytes())
        """
    words = [sys.executable, "-c", dedent(program)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr


COLD = """
    import hashlib, sys, threading
    from kaju import ElasticModel, ElasticRule, Scene

    def answer(got):
        body = dict(cell_size=0.01, cells=[6, 6], material="steel")
        load = dict(cell=[3, 5], force=[0.1, -1.0])
        rule = ElasticRule(threshold=0.1)
        scene = Scene(body=body, sides=dict(bottom="rigid"), loads=[load], rule=rule)
        found = ElasticModel(scene, engine="arrays").run().displacement
        got.append(b"".join(each.tobytes() for each in found))

    got, threads = [], []
    for _ in range(int(sys.argv[1])):
        threads.append(threading.Thread(target=answer, args=(got,)))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(len(got), *{hashlib.sha256(each).hexdigest() for each in got})
    """


@pytest.mark.slow
def test_threads_and_processes_may_compile_at_once(tmp_path):
    """They fill one cache that is empty."""
    cold = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    words = [sys.executable, "-c", dedent(COLD), "3"]
    both = [
        subprocess.Popen(words, env=cold, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    told = [each.communicate(timeout=300) for each in both]
    assert [each.returncode for each in both] == [0, 0], told
    assert all("Traceback" not in said for _, said in told), told
    assert told[0][0] == told[1][0]
    assert len(told[0][0].split()) == 2, "three threads, one answer"
    assert list(tmp_path.rglob("*.nbi"))


def test_without_assertions_and_docstrings_a_wrong_scene_is_refused_by_name(tmp_path):
    (tmp_path / "s.toml").write_text(SCENE.replace("[4, 4]", "[4, -4]"))
    words = [sys.executable, "-OO", "-m", "kaju", "solve", tmp_path / "s.toml"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "error: " in done.stderr
    assert "body.cells" in done.stderr


def test_materials_are_listed_on_an_ascii_terminal():
    run = subprocess.run(
        [sys.executable, "-m", "kaju", "materials"],
        env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"},
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert b"steel" in run.stdout
