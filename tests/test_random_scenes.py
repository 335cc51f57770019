"""Random and hard scenes are answered soundly, or refused by a named error.

`make test` tries a few random ones; `make stress` tries many, and prints how many were answered.
"""

import os
from math import isfinite
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, currently_in_test_context, event, given, settings
from strategies import elastic_scenes, outlined_scenes, scenes

import kaju

FAILED = sorted((Path(__file__).parent / "data" / "failed").glob("*.toml"))
LONG = ["described_tolerance_753", *(f"tolerance_{n}" for n in (2962, 5162, 5219, 732, 8529))]
LONG += ["true_outlines_44", "true_outlines_166", "true_outlines_8"]
CASES = [
    pytest.param(path, id=path.stem, marks=[pytest.mark.slow] * (path.stem in LONG))
    for path in FAILED
]
EXAMPLES = int(os.environ.get("KAJU_EXAMPLES", "8"))
TRIES = settings(
    max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)


def numbers(value):
    """Yield the numbers of a summary, at any depth."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, float):
        yield value


def check_sound(ask):
    """Ask for an answer, and check it; a refusal by name is an answer, too."""
    count = event if currently_in_test_context() else str
    try:
        result = ask()
    except kaju.KajuError as error:
        count(f"refused by {type(error).__name__}")
        return
    count("answered")
    assert all(map(isfinite, numbers(result.summary())))
    assert [check for check in result.checks() if not check.holds] == []
    if result.kind == "elastic" and result.generations and result.generations[0].lower is not None:
        lower, upper = zip(*((one.lower, one.upper) for one in result.generations), strict=True)
        assert max(lower) <= min(upper) * (1.0 + 1e-9)  # one truth lies within all


def run(scene):
    return kaju.LoadModel(
        scene, "arrays", rng=1, allow_unstable=True, max_generations=300
    ).run(progress=False)  # fmt: skip


def creep(scene):
    law = kaju.ThreeElement(K_f=1e9, D_f=1e9, D_d=1e11)
    materials = {
        name: kaju.Material(name, one.youngs_modulus, one.poissons_ratio, rheology=law)
        for name, one in scene.materials.items()
    }
    history = kaju.History.step().hold(1.0)
    return kaju.creep(scene.replace(materials=materials), history, times=[1.0], tolerance=1e-2)


@pytest.mark.parametrize("path", CASES)
def test_scenes_that_once_failed_are_answered_or_refused(path):
    words = path.read_text().splitlines()[1]
    scene = kaju.load_scene(path)
    verb, _, tolerance = words.removeprefix("# ").partition(", tolerance ")
    if verb == "run":
        check_sound(lambda: run(scene))
    elif verb == "creep":
        check_sound(lambda: creep(scene))
    elif verb == "settle":
        check_sound(lambda: kaju.ElasticModel(scene, max_steps=50).run())
    else:
        check_sound(lambda: kaju.solve(scene, tolerance=float(tolerance) if tolerance else None))


@given(scenes())
@TRIES
def test_loads_are_passed_on(scene):
    check_sound(lambda: run(scene))


@given(elastic_scenes())
@TRIES
def test_equal_cells_are_solved(scene):
    check_sound(lambda: kaju.solve(scene))


@given(elastic_scenes())
@TRIES
def test_a_tolerance_is_kept_or_refused(scene):
    assume(scene.lattice.dimension == 2)  # of solids, see the slow ones of the scenes that failed
    check_sound(lambda: kaju.solve(scene, tolerance=0.3))


@given(outlined_scenes())
@TRIES
def test_true_outlines_are_solved(scene):
    check_sound(lambda: kaju.solve(scene, tolerance=0.3))


@given(elastic_scenes(extreme=False))
@TRIES
def test_bodies_creep(scene):
    check_sound(lambda: creep(scene))
