"""Lines whose change no other test noticed (see mutants.py): each would be wrong in silence."""

import numpy as np
import pytest
from plates import plate as pressed

import kaju
from kaju import LoadModel, PrescribedRule


def plate(**changes):
    return pressed([8, 8], [4, 7], **changes)


def test_what_is_left_of_a_face_carries_all_of_its_load():
    """Half of the loaded face turns out to be air when cells are halved."""
    air = {"box": [[0.02, 0.07], [0.0449, 0.08]], "material": "air"}
    finer = plate(force=[0.3, -2.0], side="top", regions=[air]).refine(2).applied()
    np.testing.assert_allclose(finer.force.sum(axis=0), [0.3, -2.0])
    assert len(finer.force) == 1


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_boundaries_spawn_when_they_give_a_load_back(engine):
    """The second generation reaches the ground, and the third takes what it gave back."""
    stage = LoadModel(pressed([1, 2], [0, 1]), engine=engine).run().last
    ground = stage.boundary_cells[:, 1] < 0
    assert stage.boundary_spawn_step[ground].tolist() == [3]
    assert stage.boundary_spawn_step.min() == 2


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_where_nothing_happens_no_boundary_wakes(engine):
    calm = LoadModel(plate(rule={"threshold": 10.0}), engine=engine).run()
    assert len(calm.last.boundary_cells) == len(calm.last.returned) == 0
    assert calm.summary()["boundary_agents"] == 0


def test_small_shares_count_for_growth_too():
    """Of one cell in the air everything comes back: loads grow by the sum of all shares."""
    rule = PrescribedRule((0.5, 0.3, 0.05))
    alone = pressed([1, 1], [0, 0], allow_floating=True, sides={}, rule=rule)
    shares = rule.shares(alone.cell_materials[0], 2)
    passed = shares.forward + shares.backward + 2 * (shares.friction + shares.poisson)
    assert kaju.stability(alone).spectral_radius == pytest.approx(passed)


def test_what_does_not_shorten_an_agent_widens_it():
    """β of the Poisson share is free to widen the agent, the rest presses on its neighbours."""
    gum = kaju.Material("gum", youngs_modulus=1e6, poissons_ratio=0.4)
    shares = PrescribedRule((0.5, 0.5, 0.25), beta=0.25).shares(gum, 2)
    assert shares.widening == pytest.approx(0.25 * 0.4)
    assert shares.poisson == pytest.approx(0.75 * 0.4 * 0.5)


def test_what_shrinks_when_pressed_needs_pulls():
    foam = {"foam": {"youngs_modulus": 1e6, "poissons_ratio": -0.2}}
    shrinking = {"material": "foam", "materials": foam}
    with pytest.raises(kaju.KajuError, match=r"poissons_ratio of 'foam': -0\.2 would pull"):
        LoadModel(plate(**shrinking, rule=PrescribedRule(beta=0.5)))
    LoadModel(plate(**shrinking, rule=PrescribedRule(beta=0.5, sense=True)))
    LoadModel(plate(rule=PrescribedRule(beta=0.5)))


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_the_history_tells_pulls_from_pushes(engine):
    ends = [{"cell": [4, 7], "force": [0.0, 2.0]}, {"cell": [1, 7], "force": [0.0, -2.0]}]
    rule = PrescribedRule((0.5, 0.5, 0.0), beta=1.0, sense=True)
    stage = LoadModel(plate(loads=ends, rule=rule), engine=engine).run().last
    first = stage.history.generation == 1
    column = stage.cells[stage.history.agent, 0]
    assert stage.history.pull[first & (column == 1)].tolist() == [False]
    assert stage.history.pull[first & (column == 4)].tolist() == [True]


@pytest.mark.parametrize(("force", "generations"), [(0.05, 0), (0.15, 1), (1.0, 4), (1.7, 5)])
def test_after_how_many_halves_a_load_is_below_the_threshold(force, generations):
    rule = PrescribedRule((0.5, 0.5, 0.0), beta=1.0, threshold=0.1)
    assert kaju.stability(plate(force=[0.0, -force], rule=rule)).generations == generations


def test_what_a_corner_keeps_of_its_shear_modulus_gives_the_energy_of_finite_elements():
    """Its weight, 1/2: with 1.1 the energy would be 1.4 % too small."""
    pytest.importorskip("skfem")
    from exact.graded_elements import graded_elements

    air = {"box": [[0.04, 0.04], [0.08, 0.08]], "material": "air"}
    bent = plate(regions=[air], loads=[{"side": "top", "force": [1.0, -2.0]}])
    truth = graded_elements(bent, order=4, levels=6).strain_energy
    assert kaju.solve(bent, resolution=4).strain_energy == pytest.approx(truth, rel=3e-3)


def test_the_largest_arrow_in_space_is_as_long_as_a_share_of_the_box():
    axes = kaju.plot(pressed([3, 3, 5], [1, 1, 4], [0.0, 0.0, -2.0], side="top")).axes[0]
    (arrows,) = (drawn for drawn in axes.get_children() if drawn.get_gid() == "forces")
    shaft = np.asarray(arrows._segments3d[0])
    assert np.linalg.norm(shaft[1] - shaft[0]) == pytest.approx(0.28 * 0.05)
    assert shaft[:, 2].min() == pytest.approx(0.05)  # it pushes from outside, up to the face
