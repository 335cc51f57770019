"""The compiled loops against the law in plain NumPy, and the law against itself."""

import numpy as np
import pytest
from spawning_bodies import drawn, laws

from kaju.model.elastic.equal import row_kernels as kernels
from kaju.model.elastic.equal.grid import problem_of_scene
from kaju.model.elastic.equal.hierarchy import Hierarchy
from kaju.model.elastic.equal.staggered import internal_force

MATERIALS = laws((1.0, 0.3), (50.0, -0.2), (1e3, 0.4))


def make_problem(codes, sides):
    """A problem from an array of codes: 0 is air, 4 is rigid."""
    scene = drawn(codes, MATERIALS, [], cell_size=1.0, sides=sides, allow_floating=True)
    return problem_of_scene(scene)[0]


def bed(stiffness):
    return {"stiffness": stiffness}


PLAIN = [
    make_problem(np.ones(shape, int), sides)
    for shape, sides in (
        ((32, 16), {"bottom": "rigid"}),
        ((16, 48), {"left": "rigid", "right": "roller", "top": bed(0.3)}),
        ((16, 16), {"top": "rigid", "right": "rigid", "bottom": "roller"}),
        ((60, 36), {"bottom": "rigid", "right": bed(0.3)}),
        ((16, 32, 16), {"bottom": "rigid"}),
        ((16, 16, 32), {"left": "rigid", "right": "roller", "top": bed(0.3)}),
        ((16, 16, 16), {"back": "rigid", "front": "roller", "bottom": bed(2.0)}),
    )
]


def ragged(shape, sides):
    """A body of three materials with holes and rigid cells, held in every way there is."""
    rng = np.random.default_rng(5)
    return make_problem(rng.choice([4, 0, 1, 1, 1, 2, 3], size=shape).repeat(2, axis=0), sides)


RAGGED = {
    "plane": ragged((9, 13), {"bottom": "rigid", "left": "roller", "right": bed(0.7)}),
    "moved": ragged((12, 9), {"top": {"displacement": (0.1, 0.2)}, "bottom": bed(3.0)}),
    "space": ragged((5, 7, 6), {"bottom": "rigid", "back": "roller", "left": bed(0.7)}),
    "bed": ragged((6, 5, 9), {"top": bed(0.3), "front": bed(0.1)}),
}


@pytest.fixture(params=[*RAGGED.values(), *PLAIN])
def both(request):
    return request.param, Hierarchy(request.param)


def random(problem, multigrid, seed):
    """A vector of the faces that can move, and its fields."""
    rng = np.random.default_rng(seed)
    fields = tuple(rng.standard_normal(f.shape) for f in problem.force)
    vector = multigrid.gather(fields)
    fields = tuple(np.zeros(f.shape) for f in problem.force)
    multigrid.scatter(vector, fields)
    return vector, fields


def test_the_stiffness_is_that_of_the_plain_law(both):
    problem, multigrid = both
    x, u = random(problem, multigrid, 1)
    expected = multigrid.gather(internal_force(problem, u))
    size = np.abs(expected).max()
    np.testing.assert_allclose(multigrid.apply(x), expected, atol=1e-13 * size)


def test_the_cycle_is_symmetric_and_positive(both):
    problem, multigrid = both
    x, y = random(problem, multigrid, 1)[0], random(problem, multigrid, 2)[0]
    ahead, back = multigrid.precondition(x), multigrid.precondition(y)
    assert ahead @ y == pytest.approx(back @ x, abs=1e-10 * np.sqrt((ahead @ x) * (back @ y)))
    assert ahead @ x > 0


def residual(hierarchy, at, x, load=None, share=0.0):
    """share·load − Ax on a level: on the smallest one as if it were not."""
    out, load = np.empty_like(x), x if load is None else load
    level, coarse = hierarchy.levels[at], hierarchy.levels[min(at + 1, len(hierarchy.levels) - 1)]
    kernels.write_residual(x, load, out, level.level, coarse.level.box, share)
    return out


@pytest.mark.parametrize("name", RAGGED)
def test_parents_feel_what_their_children_feel_when_they_follow(name):
    hierarchy = Hierarchy(RAGGED[name])
    rng = np.random.default_rng(1)
    for at, coarse in enumerate(hierarchy.levels[1:]):
        parents = rng.standard_normal(len(coarse.u)) * moves(coarse)
        restricted = hierarchy.restrict(at, residual(hierarchy, at, hierarchy.prolong(at, parents)))
        felt = residual(hierarchy, at + 1, parents)
        np.testing.assert_allclose(felt, restricted, atol=1e-13 * np.abs(restricted).max())


def moves(grid):
    """Which faces of a level can move."""
    level = grid.level
    inverse = level.inverse.reshape(level.box.components, -1, level.box.shape[2])
    return (inverse[:, level.rows] > 0.0).ravel()
