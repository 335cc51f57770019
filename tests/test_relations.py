"""Scenes that are turned, mirrored, scaled, split, renamed or shifted have the same answers so."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import kaju

CELL, SIDES = 0.01, ("left", "bottom", "right", "top")  # counter-clockwise
MATERIALS = {
    "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "b": {"youngs_modulus": 1e8, "poissons_ratio": 0.1},
}
LAW = {"K_f": 1e8, "D_f": 1e8, "D_d": 1e10}
FEW = settings(
    max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
MANY = settings(FEW, max_examples=100)


@st.composite
def bodies(draw):
    """A body of cells (0: air), its held sides, and loads (cell, force)."""
    shape = draw(st.integers(3, 6)), draw(st.integers(3, 6))
    codes = np.array(draw(st.lists(st.sampled_from([1, 1, 1, 2]), min_size=36, max_size=36)))
    codes = codes[: shape[0] * shape[1]].reshape(shape)
    if min(shape) > 3:
        codes[1, 1] = 0
    cells = st.tuples(st.integers(0, shape[0] - 1), st.just(shape[1] - 1))
    force = st.integers(-5, 5)
    loads = draw(
        st.lists(
            st.tuples(cells, st.tuples(force, force.map(lambda f: f or -1))),
            min_size=1,
            max_size=3,
            unique_by=lambda load: load[0],
        )
    )
    return codes, {"bottom": "rigid"}, [(list(c), list(map(float, f))) for c, f in loads]


def scene_of(codes, sides, loads, cell=CELL, names=("a", "b"), rheology=None, **others):
    legend = {0: "air", 1: names[0], 2: names[1]}
    law = {} if rheology is None else {"rheology": rheology}
    return kaju.Scene.from_array(
        codes,
        legend={code: legend[code] for code in np.unique(codes).tolist()},
        cell_size=cell,
        thickness=CELL,
        materials={n: MATERIALS[k] | law for n, k in zip(names, "ab", strict=True)},
        sides=sides,
        loads=[{"cell": cell, "force": force} for cell, force in loads],
        **others,
    )


def turned(codes, sides, loads):
    """A quarter turn counter-clockwise: (x, y) becomes (-y, x)."""
    wide = codes.shape[1]
    return (
        np.rot90(codes),
        {SIDES[(SIDES.index(side) + 1) % 4]: kind for side, kind in sides.items()},
        [([wide - 1 - y, x], [-g, f]) for (x, y), (f, g) in loads],
    )


def mirrored(codes, sides, loads):
    wide = codes.shape[0]
    names = {"left": "right", "right": "left"}
    return (
        codes[::-1],
        {names.get(side, side): kind for side, kind in sides.items()},
        [([wide - 1 - x, y], [-f, g]) for (x, y), (f, g) in loads],
    )


def shifted(codes, sides, loads):
    """Further to the right, with air on its left."""
    return np.pad(codes, ((2, 0), (0, 0))), sides, [([x + 2, y], force) for (x, y), force in loads]


def reordered(codes, sides, loads):
    return codes, sides, loads[::-1]


def split(codes, sides, loads):
    """Each load in two halves."""
    halves = [(cell, [0.5 * f for f in force]) for cell, force in loads]
    return codes, sides, halves + halves


CHANGES = {
    "turned": (turned, {}),
    "mirrored": (mirrored, {}),
    "shifted": (shifted, {}),
    "reordered": (reordered, {}),
    "split": (split, {}),
    "renamed": (lambda *body: body, {"names": ("x", "y")}),
    "twice as large": (lambda *body: body, {"cell": 2 * CELL}),
}
"""How the body changes, and how its description does.

A plane body of the same thickness, twice as large under the same forces, moves as much; it bears
twice the force.
"""


def of_solve(body, **how):
    answer = kaju.solve(scene_of(*body, rule={"kind": "elastic"}, **how))
    return {"energy": answer.strain_energy, "moves": answer.max_displacement}


def of_tolerance(body, **how):
    answer = kaju.solve(scene_of(*body, rule={"kind": "elastic"}, **how), tolerance=0.2)
    return {"energy": answer.strain_energy}


def of_creep(body, **how):
    scene = scene_of(*body, rule={"kind": "elastic"}, rheology=LAW, **how)
    answer = kaju.creep(scene, kaju.History.step().hold(2.0), times=[2.0])
    return {"work": answer.summary()["work_J"], "moves": answer.summary()["max_displacement"]}


def of_grow(body, **how):
    # The radius is in cells, and so follows the scale.
    answer = kaju.GrowthModel(scene_of(*body, **how), volume=0.6, tolerance=1e-8).run(2)
    return {"compliance": answer.compliance, "grey": answer.grey}


def of_break(body, **how):
    # Strengths that scatter are drawn cell by cell.
    answer = kaju.FractureModel(scene_of(*body, **how), strength=1e6, scatter=0.0).run(1)
    return {"force": answer.summary()["largest_force_N"]}


VERBS = {
    "solve": (of_solve, 1e-6),
    "tolerance": (of_tolerance, 0.08),  # twice the square of what is asked for
    "creep": (of_creep, 2e-3),
    "grow": (of_grow, 1e-5),
    "break": (of_break, 1e-6),
}


def check(verb, body, changes):
    ask, near = VERBS[verb]
    before = ask(body)
    for change in changes:
        move, how = CHANGES[change]
        factor = 2.0 if (verb, change) == ("break", "twice as large") else 1.0
        after = ask(move(*body), **how)
        for name, value in before.items():
            expected = pytest.approx(factor * value, rel=near, abs=1e-300)
            assert after[name] == expected, (change, name)


def check_run(body, changes):
    """Loads passed on: to the same cells, the same newtons."""

    def ask(body, **how):
        scene = scene_of(*body, rule={"threshold": 0.05}, allow_floating=True, **how)
        run = kaju.LoadModel(scene, rng=1, allow_unstable=True, max_generations=200)
        result = run.run(progress=False)
        return result.last.generations, [result.last.ledger.taken, float(len(result.last.cells))]

    before = ask(body)
    for change in changes:
        if change == "split":  # halves are judged by themselves
            continue
        move, how = CHANGES[change]
        after = ask(move(*body), **how)
        assert after[0] == before[0]
        assert after[1] == pytest.approx(before[1], rel=1e-9)


@pytest.mark.parametrize("verb", VERBS)
@given(body=bodies(), change=st.sampled_from(sorted(CHANGES)))
@FEW
def test_the_answer_changes_as_the_scene_does(verb, body, change):
    check(verb, body, [change])


@given(body=bodies(), change=st.sampled_from(sorted(CHANGES)))
@FEW
def test_loads_are_passed_on_as_the_scene_changes(body, change):
    check_run(body, [change])


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
@given(body=bodies())
@MANY
def test_the_answer_changes_as_the_scene_does_in_every_way(verb, body):
    check(verb, body, CHANGES)
