"""The compiled sweeps against the law in plain NumPy, and the law against itself."""

import numpy as np
import pytest

from kaju.model.elasticity.box_multigrid import BoxMultigrid, face_count
from kaju.model.elasticity.problem import ACTIVE, make_problem
from kaju.model.elasticity.staggered import Numbering, internal_force, stiffness_matrix
from kaju.model.elasticity.transfer import coarsen

CASES = [
    ((32, 16), {"bottom": "rigid"}),
    ((16, 48), {"left": "rigid", "right": "roller", "top": ("foundation", 0.3)}),
    ((16, 16), {"top": "rigid", "right": "rigid", "bottom": "roller"}),
    ((16, 32, 16), {"bottom": "rigid"}),
    ((16, 16, 32), {"left": "rigid", "right": "roller", "top": ("foundation", 0.3)}),
    ((16, 16, 16), {"back": "rigid", "front": "roller", "bottom": ("foundation", 2.0)}),
]


class Box:
    def __init__(self, shape, sides):
        self.problem = make_problem(np.zeros(shape, int), [(1.0, 0.3)], 1.0, sides=sides)
        self.multigrid = BoxMultigrid(self.problem)
        self.level, self.below = self.multigrid.levels[:2]
        self.kernels = self.multigrid._kernels
        self.sides = (
            self.level.law,
            self.multigrid.wall,
            self.multigrid.held,
            self.level.spring,
        )
        self.weights = (self.multigrid.own, self.multigrid.far)
        self.rng = np.random.default_rng(1)

    def random(self):
        x = self.rng.standard_normal(face_count(self.problem.shape))
        self.multigrid.clear_fixed(0, x)
        return x

    def padded(self, x):
        u = tuple(np.zeros(self.problem.face_shape(a)) for a in range(self.problem.dimension))
        for field, view in zip(u, self.level.views(x), strict=True):
            field[self.problem.inner] = view
        return u


@pytest.fixture(
    params=CASES, ids=lambda case: "x".join(map(str, case[0])) + "-" + "-".join(case[1])
)
def box(request):
    return Box(*request.param)


def test_the_stiffness_is_that_of_the_plain_law(box):
    x = box.random()
    expected = np.concatenate(
        [f[box.problem.inner].ravel() for f in internal_force(box.problem, box.padded(x))]
    )
    box.multigrid.clear_fixed(0, expected)
    np.testing.assert_allclose(box.multigrid.apply(x), expected, atol=1e-13)


def test_the_fused_passes_are_sweeps_one_after_the_other(box):
    load, level, kernels = box.random(), box.level, box.kernels
    plain, fused = np.zeros_like(load), np.full_like(load, np.nan)
    kernels.smooth(level.views(plain), level.views(load), *box.sides, 2, False)
    coarse = np.empty(face_count(box.below.shape))
    kernels.descend(
        level.views(fused),
        level.views(load),
        box.below.views(coarse),
        *box.sides,
        *box.weights,
        2,
    )
    np.testing.assert_allclose(fused, plain, atol=1e-13)
    left = load - box.multigrid.apply(plain)
    box.multigrid.clear_fixed(0, left)
    handed = np.empty_like(coarse)
    kernels.restrict(level.views(left), box.below.views(handed), *box.weights)
    np.testing.assert_allclose(coarse, handed, atol=1e-13)

    kernels.prolong(level.views(plain), box.below.views(coarse), *box.weights)
    kernels.smooth(level.views(plain), level.views(load), *box.sides, 2, True)
    kernels.ascend(
        level.views(fused),
        level.views(load),
        box.below.views(coarse),
        *box.sides,
        *box.weights,
        2,
    )
    np.testing.assert_allclose(fused, plain, atol=1e-13)


def test_interpolation_is_that_of_ragged_bodies(box):
    numbering = Numbering(box.problem.face_states())
    parents, matrix = coarsen(numbering)
    inner = box.problem.inner
    children = np.concatenate([(s[inner] == ACTIVE).ravel() for s in numbering.states])
    active = np.concatenate([(s[inner] == ACTIVE).ravel() for s in parents.states])
    coarse = box.rng.standard_normal(len(active)) * active
    fine = np.zeros(len(children))
    box.kernels.prolong(box.level.views(fine), box.below.views(coarse), *box.weights)
    np.testing.assert_allclose(fine[children], matrix @ coarse[active], atol=1e-13)
    load = box.random()
    handed = np.empty_like(coarse)
    box.kernels.restrict(box.level.views(load), box.below.views(handed), *box.weights)
    np.testing.assert_allclose(handed[active], matrix.T @ load[children], atol=1e-13)


def test_the_cycle_is_symmetric_and_positive(box):
    x, y = box.random(), box.random()
    ahead, back = box.multigrid.precondition(x), box.multigrid.precondition(y)
    assert ahead @ y == pytest.approx(back @ x, abs=1e-10 * np.sqrt((ahead @ x) * (back @ y)))
    assert ahead @ x > 0


@pytest.mark.parametrize("shape", [(7, 5), (4, 5, 3)])
def test_the_matrix_is_the_plain_law_on_ragged_bodies(shape):
    rng = np.random.default_rng(5)
    kinds = rng.choice([-2, -1, 0, 0, 0, 1], size=shape)
    sides = {"bottom": "rigid", "left": "roller", "right": ("foundation", 0.7)}
    problem = make_problem(kinds, [(1.0, 0.3), (50.0, -0.2)], 1.0, sides=sides)
    numbering = Numbering(problem.face_states())
    matrix = stiffness_matrix(problem, numbering)
    x = rng.standard_normal(numbering.size)
    u = tuple(np.zeros(problem.face_shape(a)) for a in range(problem.dimension))
    numbering.scatter(x, u)
    expected = numbering.gather(internal_force(problem, u))
    np.testing.assert_allclose(matrix @ x, expected, atol=1e-12)
    assert abs(matrix - matrix.T).max() < 1e-14
    assert np.linalg.eigvalsh(matrix.toarray())[0] > -1e-12


@pytest.mark.parametrize("shape", [(8, 8), (9, 6), (8, 6, 7)])
def test_rigid_motions_of_the_parents_are_rigid_motions_of_the_children(shape):
    problem = make_problem(np.zeros(shape, int), [(1.0, 0.3)], 1.0)
    numbering = Numbering(problem.face_states())
    from kaju.model.elasticity.fallback import rigid_motions

    _, matrix = coarsen(numbering)
    modes = rigid_motions(numbering)
    best = np.linalg.lstsq(matrix.toarray(), modes, rcond=None)[0]
    even = all(n % 2 == 0 for n in shape)
    missed = np.abs(matrix @ best - modes).max()
    assert missed < (1e-10 if even else 1.0)
