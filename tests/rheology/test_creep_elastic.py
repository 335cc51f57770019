"""Elastic bodies of several creeping materials, on the staggered grid."""

import numpy as np
import pytest
from elastic_cases import make_problem

from kaju.agents.materials import Material
from kaju.model.elastic.equal.problem import CellLoads
from kaju.model.rheology import creeping_elastic as creep_elastic
from kaju.model.rheology import schemes as steps
from kaju.model.rheology.creep_result import CreepState
from kaju.model.rheology.creeping_elastic import CreepingBody
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Integrator, Loading, StepControl
from kaju.model.rheology.load_history import History

SOFT = ThreeElement(K_f=1e5, D_f=3e5, D_d=2e6)
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)
TIMES = np.array([0.2, 3.0, 5.2, 6.0, 10.0])
EDGE = 0.01


def body(kinds, materials, sides=None, plane="stress"):
    """Return a body that stands on its bottom and is pressed with 1 N on its whole top."""
    shape = kinds.shape
    grid = np.indices(shape[:-1]).reshape(len(shape) - 1, -1).T
    cells = np.concatenate([grid, np.full((len(grid), 1), shape[-1] - 1)], axis=1)
    force = np.zeros((len(cells), len(shape)))
    force[:, -1] = -1.0 / len(cells)
    top = np.full(len(cells), 2 * len(shape) - 1)
    problem = make_problem(
        kinds,
        [(m.youngs_modulus, m.poissons_ratio) for m in materials],
        EDGE,
        plane=plane if len(shape) == 2 else None,
        sides=sides or {"bottom": "rigid"},
        loads=CellLoads(cells, top, force),
    )
    return CreepingBody(problem, materials)


def run(system, history=BITE, times=TIMES, step=0.05, scheme="sdirk2"):
    """Return displacements (k, faces) and energies (k, 4): work, stored, dissipated, numerical."""
    control = StepControl(step, 1e-3, 10_000)
    integrator = Integrator(system, steps.scheme(scheme), Loading(history, history), control)
    faces, energies = [], []
    for state in integrator.states(CreepState(system.start()), np.asarray(times)):
        faces.append(system.record(state.fields)["faces"])
        stored = system.stored(state.fields)
        energies.append((state.work, stored, state.dissipated, state.numerical))
    return system.problem.scales.displacement * np.stack(faces), np.array(energies)


def inclusion(n=16):
    kinds = np.zeros((n, n), dtype=np.int64)
    kinds[n // 4 : 5 * n // 8, n // 4 : 5 * n // 8] = 1
    return kinds


@pytest.mark.parametrize(
    ("shape", "plane"), [((12, 12), "stress"), ((12, 12), "strain"), ((5, 5, 5), None)]
)
def test_one_material_follows_the_correspondence_principle(shape, plane):
    kinds = np.zeros(shape, dtype=np.int64)
    elastic = body(kinds, [Material("a", 1e5, 0.3)], plane=plane)
    still, _ = run(elastic, History.step(), [1.0], step=1.0)
    crept, _ = run(body(kinds, [Material("a", 1e5, 0.3, rheology=SOFT)], plane=plane))
    growth = 1e5 * SOFT.creep(force=BITE, times=TIMES, scheme="exact")
    np.testing.assert_allclose(crept, growth[:, None] * still, atol=5e-6 * np.abs(still).max())


def test_the_discrete_scheme_corresponds_to_rounding():
    kinds = np.zeros((8, 8), dtype=np.int64)
    elastic = body(kinds, [Material("a", 1e5, 0.3)])
    still, _ = run(elastic, History.step(), [1.0], step=1.0)
    times = np.linspace(0.5, 5.0, 10)
    for scheme in ("backward_euler", "sdirk2"):
        crept, _ = run(
            body(kinds, [Material("a", 1e5, 0.3, rheology=SOFT)]),
            History.step(), times, step=0.5, scheme=scheme,
        )  # fmt: skip
        growth = 1e5 * SOFT.creep(force=1.0, times=times, scheme=scheme)
        np.testing.assert_allclose(crept, growth[:, None] * still, atol=1e-8 * np.abs(still).max())


def test_two_layers_in_a_row_add_up_their_own_creep():
    kinds = np.zeros((4, 8), dtype=np.int64)
    kinds[:, 4:] = 1
    other = ThreeElement.maxwell(4e4, 1e5)
    materials = [Material("a", 1e5, 0.0, rheology=SOFT), Material("b", 4e4, 0.0, rheology=other)]
    system = body(kinds, materials)
    crept, _ = run(system)
    top = system.numbering.number[1][1:-1, -2]
    stress = BITE.scaled(1.0 / (4 * EDGE))
    expected = (
        4
        * EDGE
        * sum(law.creep(force=stress, times=TIMES, scheme="exact") for law in (SOFT, other))
    )
    np.testing.assert_allclose(crept[:, top], -expected[:, None] * np.ones(4), rtol=1e-5)


@pytest.mark.parametrize(("scheme", "order"), [("backward_euler", 1.0), ("sdirk2", 2.0)])
def test_measured_order_with_an_inclusion(scheme, order):
    materials = [
        Material("a", 1e5, 0.4, rheology=SOFT),
        Material("b", 4e6, 0.2, rheology=ThreeElement(4e6, 1e6, 1e8)),
    ]
    history = History().ramp(1.0, 0.8).hold(1.6)

    def crept(step):
        return run(body(inclusion(), materials), history, [0.8, 2.4], step, scheme)[0]

    fine, finer, finest = crept(0.1), crept(0.05), crept(0.025)
    slope = np.log2(np.abs(finer - fine).max() / np.abs(finest - finer).max())
    assert slope == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("scheme", ["backward_euler", "sdirk2"])
def test_work_is_stored_dissipated_or_the_schemes_own(scheme):
    materials = [Material("a", 1e5, 0.4, rheology=SOFT), Material("b", 4e6, 0.2)]
    sides = {"bottom": "rigid", "left": ("foundation", 1e6)}
    _, energies = run(body(inclusion(), materials, sides), scheme=scheme)
    work, stored, dissipated, numerical = energies.T
    np.testing.assert_allclose(work - stored - dissipated - numerical, 0.0, atol=1e-12 * work.max())
    assert np.all(np.diff(dissipated) >= 0.0)
    if scheme == "backward_euler":
        assert np.all(np.diff(numerical) >= 0.0)


def test_multigrid_and_factorisation_agree(monkeypatch):
    materials = [Material("a", 1e5, 0.3, rheology=SOFT), Material("b", 1e6, 0.3)]
    direct, _ = run(body(inclusion(32), materials), times=[0.2, 1.0], step=0.1)
    for limit in ("DIRECT_LIMIT", "_FACTORISED_UP_TO"):
        monkeypatch.setattr(creep_elastic, limit, {2: 0, 3: 0})
    multigrid, _ = run(body(inclusion(32), materials), times=[0.2, 1.0], step=0.1)
    np.testing.assert_allclose(multigrid, direct, atol=1e-8 * np.abs(direct).max())


def test_what_geometric_multigrid_cannot_do_is_handed_on(monkeypatch):
    for limit in ("DIRECT_LIMIT", "_FACTORISED_UP_TO"):
        monkeypatch.setattr(creep_elastic, limit, {2: 0, 3: 0})
    frame = np.full((40, 40), -1)
    frame[:3], frame[-3:], frame[:, :3], frame[:, -3:] = 0, 0, 0, 0
    system = body(frame, [Material("a", 1e5, 0.3, rheology=SOFT)])
    crept, _ = run(system, History.step(), [1.0], step=0.5)
    monkeypatch.undo()
    direct, _ = run(
        body(frame, [Material("a", 1e5, 0.3, rheology=SOFT)]), History.step(), [1.0], 0.5
    )
    np.testing.assert_allclose(crept, direct, atol=1e-7 * np.abs(direct).max())
