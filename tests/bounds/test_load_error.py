"""Loads act where they are described, whatever the grid: bounds of all grids hold one truth."""

import numpy as np
import pytest
import skfem
from exact.graded_elements import graded_elements
from plates import loaded
from skfem.helpers import ddot, div, dot, sym_grad

import kaju
from kaju import Deflection, solve

EDGE, YOUNG, POISSON = 0.2, 210e9, 0.3
ELEMENTS = 1e-3
"""Share of the energy that the graded elements miss."""


def drawn(rng):
    """A load on the top or the right side of a square, that ends anywhere or grows along it."""
    side = rng.choice(["top", "right"])
    low, high = np.sort(rng.uniform(0.0, EDGE, 2)).tolist()
    low, high = (0.0 if rng.random() < 0.3 else low), max(high, low + 0.02)
    high = min(high, EDGE)
    ends = [[low, EDGE], [high, EDGE]] if side == "top" else [[EDGE, low], [EDGE, high]]
    slope = (1e4 * rng.normal(size=2)).tolist()
    return [
        {"region": {"box": ends}, "force": rng.normal(size=2).tolist()},
        {"region": {"box": ends}, "pressure": 1e3},
        {"region": {"box": ends}, "pressure": 1e3, "pressure_slope": slope},
        {"side": str(side), "pressure": 1e3, "pressure_slope": slope},
    ][rng.integers(4)]


def square(load, cells):
    m = {"youngs_modulus": YOUNG, "poissons_ratio": POISSON}
    return loaded([cells] * 2, load, size=[EDGE, EDGE], material="m", materials={"m": m})


def lines(ends):
    """Lines of a mesh, ever closer together towards some places and the corners."""
    towards = [0.0, EDGE, *ends]
    near = [x + sign * EDGE * 0.5**k for x in towards for k in range(2, 13) for sign in (-1, 1)]
    found = np.unique([*towards, *np.linspace(0.0, EDGE, 17), *near])
    found = found[(found >= 0.0) & (found <= EDGE)]
    return found[np.r_[True, np.diff(found) > 1e-6]] / EDGE


def energy_by_elements(load):
    """The energy (J) by quadratic triangles whose edges end where the load does."""
    box = load["region"]["box"] if "region" in load else None
    if box is None:
        box = [[0, EDGE], [EDGE, EDGE]] if load["side"] == "top" else [[EDGE, 0], [EDGE, EDGE]]
    along = 0 if box[0][1] == box[1][1] else 1
    low, high = box[0][along], box[1][along]
    axes = [lines([low, high] if axis == along else []) for axis in (0, 1)]
    mesh, element = skfem.MeshTri.init_tensor(*axes), skfem.ElementVector(skfem.ElementTriP2())
    basis = skfem.Basis(mesh, element)
    lame, mu = YOUNG * POISSON / (1 - POISSON**2), YOUNG / 2 / (1 + POISSON)

    @skfem.BilinearForm
    def stiffness(u, v, _):
        return lame * div(u) * div(v) + 2 * mu * ddot(sym_grad(u), sym_grad(v))

    def traction(x):
        if "force" in load:
            return np.multiply.outer(np.array(load["force"]) / (high - low), np.ones_like(x[0]))
        slope = load.get("pressure_slope", [0.0, 0.0])
        pressure = load["pressure"] + EDGE * (slope[0] * x[0] + slope[1] * x[1])
        return np.multiply.outer(-np.eye(2)[1 - along], pressure)

    def loaded(x):
        on = np.abs(x[1 - along] - 1.0) < 1e-9
        return on & (EDGE * x[along] > low) & (EDGE * x[along] < high)

    facets = skfem.FacetBasis(mesh, element, facets=mesh.facets_satisfying(loaded))
    right = EDGE * skfem.LinearForm(lambda v, w: dot(traction(w.x), v)).assemble(facets)
    held = basis.get_dofs(lambda x: x[1] == 0.0)
    moved = skfem.solve(*skfem.condense(stiffness.assemble(basis), right, D=held))
    return 0.5 * float(right @ moved)


def check(load, grids):
    truth = energy_by_elements(load)
    for cells, asked in grids:
        result = solve(square(load, cells), **asked)
        low, high = result.energy_bounds
        assert low <= truth * (1 + ELEMENTS)
        assert truth <= high
        if "tolerance" in asked:
            assert result.tolerance_kept == "proved"
            # What is left of a load widens the bounds in proportion, and errors by their squares.
            assert high < low * (1 + 6 * asked["tolerance"] ** 2 + 2e-3)


FEW = [(10, {"resolution": 1}), (10, {"tolerance": 0.05}), (40, {"resolution": 1})]
MANY = [*FEW, (40, {"tolerance": 0.05}), (160, {"tolerance": 0.05}), (160, {"resolution": 1})]


@pytest.mark.parametrize("seed", [0, 3, 4])
def test_bounds_on_all_grids_hold_the_truth_of_the_load_described(seed):
    check(drawn(np.random.default_rng(seed)), FEW)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5, 35))
def test_bounds_of_thirty_random_loads_on_all_grids_hold_the_truth(seed):
    check(drawn(np.random.default_rng(seed)), MANY)


@pytest.mark.parametrize("seed", [3, 8])
def test_finite_elements_take_loads_where_they_are_described(seed):
    load = drawn(np.random.default_rng(seed))
    energy = pytest.approx(energy_by_elements(load), rel=1e-3)
    assert graded_elements(square(load, 10), order=4).strain_energy == energy
    assert kaju.finite_elements(square(load, 10), split=4).strain_energy == energy


@pytest.mark.parametrize("seed", [3, 8])
def test_what_is_certain_of_a_goal_holds_for_the_load_described(seed):
    load = drawn(np.random.default_rng(seed))
    elements = graded_elements(square(load, 10), order=4)
    along = EDGE * (np.arange(400) + 0.5) / 400
    top = elements.displacement_at(np.stack([along, np.full(400, EDGE * (1 - 1e-9))], axis=1))
    for cells in (5, 10, 16):
        answer = solve(square(load, cells), tolerance=0.1, goal=Deflection("top", "y"))
        (goal,) = answer.goals
        assert abs(goal.value - top[:, 1].mean()) <= goal.error_bound
        assert (answer.tolerance_kept == "proved") == (goal.relative_error <= 0.1)
