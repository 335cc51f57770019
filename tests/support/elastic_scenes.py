"""Small bodies for the elastic rule, random ones as Hypothesis strategies, and their truth."""

import numpy as np
import scipy.sparse as sp
from hypothesis import reject
from hypothesis import strategies as st
from plates import loaded
from plates import plate as pressed
from scipy.sparse.linalg import spsolve

from kaju import ElasticModel, ElasticRule
from kaju.errors import SceneError
from kaju.model.elastic.equal.staggered import Numbering, stiffness_matrix

STUFF = {
    "legend": {"a": "steel", "b": "soft", ".": "air", "=": "rigid"},
    "materials": {"soft": {"youngs_modulus": 2e10, "poissons_ratio": 0.45}},
}


def plate(cells=8, force=(0.0, -2.0), at=None, sides=None, **rule):
    """A square steel plate on rigid ground, pressed on by one cell of its top."""
    asked = {"size": [0.2, 0.2], "thickness": 0.002, "rule": ElasticRule(**rule)}
    asked |= {} if sides is None else {"sides": sides}
    return pressed([cells] * 2, at or [cells // 2, cells - 1], list(force), side="top", **asked)


def drawn(drawing, loads, sides=None, plane="stress", **rule):
    """A drawn body of cells of 10 mm."""
    parts = {"sides": sides or {}, "rule": ElasticRule(**rule), "plane": plane}
    return loaded(drawing, *loads, thickness=0.002, **parts, **STUFF)


RAGGED = """
..aaabb.
.aaaabbb
aaa..bbb
aaa..baa
aaaaaaaa
aaaaaaaa
===..===
"""


def ragged(plane="stress", **rule):
    """Two materials, a hole, steps, and ground under two feet."""
    loads = [
        {"cell": [3, 6], "side": "top", "force": [0.3, -2.0]},
        {"cell": [7, 5], "side": "right", "force": [-1.0, 0.2]},
    ]
    return drawn(RAGGED, loads, plane=plane, **rule)


def block(cells=(4, 3, 5), **rule):
    """A block of cubes on rigid ground, pressed on obliquely."""
    changes = {"side": "top", "rule": ElasticRule(**rule)}
    return pressed(list(cells), [1, 1, cells[2] - 1], [0.5, 0.2, -2.0], **changes)


def direct_solution(model):
    """Displacement (m) of the free faces by factorising the solver's own matrix."""
    problem = model.table.problem
    numbering = Numbering(problem.face_states)
    matrix = stiffness_matrix(problem, numbering)
    assert matrix.shape[0] == model.table.levels[0].size
    load = model.table.load[: matrix.shape[0]] / problem.scales.force
    solution = spsolve(sp.csc_array(matrix), load)
    return np.atleast_1d(solution) * problem.scales.displacement


def energy_norm(model, displacement):
    """√(u·Ku) (√J) of a field on the free faces."""
    finest = model.table.levels[0]
    left = displacement - finest.shares[:, : finest.size] @ displacement
    return float(np.sqrt(displacement @ (finest.stiffness * left)))


def displacement(model):
    """Displacement (m) of the free faces."""
    return model.state.levels[0].displacement


def relative_error(model):
    """Error of a run's field, as a share of the direct solution, in the norm of energy."""
    truth = direct_solution(model)
    return energy_norm(model, displacement(model) - truth) / energy_norm(model, truth)


@st.composite
def scenes(draw, order=None):
    """Small drawn bodies with feet on the ground, pressed on at random."""
    columns, rows = draw(st.integers(3, 7)), draw(st.integers(2, 5))
    letters = st.text("aaaab", min_size=columns, max_size=columns)
    upper = st.text("aaaabb..=", min_size=columns, max_size=columns)
    lines = [draw(upper) for _ in range(rows - 2)] + [draw(letters), draw(letters)]
    spots = [
        [column, rows - 1 - row]
        for row, line in enumerate(lines)
        for column, letter in enumerate(line)
        if letter in "ab"
    ]
    force = st.floats(-5.0, 5.0)
    loads = [
        {
            "cell": draw(st.sampled_from(spots)),
            "force": [draw(force), draw(force) or 1.0],
            "side": draw(st.sampled_from(["left", "right", "bottom", "top"])),
        }
        for _ in range(draw(st.integers(1, 3)))
    ]
    sides = {
        side: draw(st.sampled_from(["free", "free", "roller", {"stiffness": 1e12}]))
        for side in ("left", "right", "top")
    }
    sides["bottom"] = draw(st.sampled_from(["rigid", {"displacement": [1e-10, -2e-10]}]))
    how = {"plane": draw(st.sampled_from(["stress", "strain"])), "sides": sides, "thickness": 0.002}
    rule = ElasticRule(
        threshold=draw(st.sampled_from([0.03, 0.1, 0.4])),
        order=order or draw(st.sampled_from(["wave", "largest first", "multilevel"])),
    )
    return loaded("\n".join(lines), *loads, rule=rule, allow_floating=True, **how, **STUFF)


def run(scene, engine="arrays", **options):
    """Run a scene to the end and return model and run."""
    model = ElasticModel(scene, engine=engine, **options)
    return model, model.run()


def run_random(scene, engine="arrays", **options):
    """Run a random scene; those that could move without straining are left out."""
    try:
        return run(scene, engine, **options)
    except SceneError:
        reject()
