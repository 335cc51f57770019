"""Bodies that grow: against a peer's designs, known limits, and what must hold at every step."""

from pathlib import Path

import numpy as np
import pytest
from peers.optimality import POWER, VOID, Beam, Bilinear
from stored_files import rewritten

import kaju
from kaju.errors import ParameterError, ResultError, ResultFileError, SceneError
from kaju.model.growth.growing import Neighbours
from kaju.model.growth.growth_rules import Compliance, FullyStressed, GrowthRule, Remodelling

DESIGNS = Path(__file__).parents[1] / "data" / "half_beam_designs.npz"
SMALL = Beam("cantilever", (24, 16))
LIME = {"lime": {"youngs_modulus": 1e9, "poissons_ratio": 0.0}}


def small(**options):
    usual = {"volume": 0.4, "filter_radius": 1.5, "most_steps": 12, "at_rest": 0.0}
    return kaju.GrowthModel(SMALL.scene(), **usual | options)


def tie():
    """A bar that is pulled along x, without Poisson's ratio: its force is known everywhere."""
    return kaju.Scene(
        body={"cells": [8, 2], "cell_size": 0.01, "thickness": 0.01, "material": "lime"},
        materials=LIME,
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "right", "force": [100.0, 0.0]}],
    )


@pytest.mark.parametrize(("filter", "most"), [("density", 1.01), ("sensitivity", 1.02)])
def test_the_half_beam_is_as_stiff_as_the_peers_by_both_solvers(filter, most):
    beam = Beam("half beam", (150, 50))
    with np.load(DESIGNS) as designs:
        theirs = designs[filter] * 1e-4
    options = {"volume": 0.5, "filter_radius": 2.4, "most_steps": 60, "at_rest": 0.0}
    model = kaju.GrowthModel(beam.scene(), rule=Compliance(filter), **options)
    result = model.run()
    assert np.abs(result.volumes - 0.5).max() < 1e-12
    assert all(check.holds for check in result.checks())
    field = np.ones((150, 51))
    field[:, 1:] = VOID + (1.0 - VOID) * theirs**POWER
    peer = 2.0 * kaju.solve(beam.scene(), stiffness=field).strain_energy
    assert result.compliance < most * peer
    own = Bilinear(beam)
    ours = result.stiffness[:, 1:]
    stiffness = VOID + (1.0 - VOID) * theirs**POWER
    assert own.feel(ours)[0] < most * own.feel(stiffness)[0]


def test_without_a_filter_no_checkerboard_grows():
    beam = Beam("cantilever", (48, 30))
    options = {"volume": 0.4, "filter_radius": 1.0, "most_steps": 40}
    density = kaju.GrowthModel(beam.scene(), **options).run().density
    a, b, c, d = density[:-1, :-1], density[1:, 1:], density[1:, :-1], density[:-1, 1:]
    assert (density > 0.95).sum() > 200
    assert not (np.abs(a + b - c - d) > 1.6).any()


def test_the_last_design_is_solved_anew_and_proved():
    result = small().run()
    low, high = result.answer.energy_bounds
    # The bounds are of the design on ever smaller cells, to which these cells are too soft.
    finer = [kaju.solve(result.scene, stiffness=result.stiffness, resolution=n) for n in (2, 4)]
    energies = [result.answer.strain_energy, *(answer.strain_energy for answer in finer)]
    assert energies == sorted(energies, reverse=True)
    for inner in finer:
        assert 0.0 < low < inner.energy_bounds[0] < inner.energy_bounds[1] < high < energies[0]
    assert result.compliance == pytest.approx(2.0 * result.answer.strain_energy, rel=1e-9)
    assert result.answer.energy.sum() == pytest.approx(0.5 * result.compliance, rel=1e-6)


def test_loose_equations_lose_hardly_any_compliance():
    loose, tight = (small(tolerance=t).run().answer.strain_energy for t in (1e-2, 1e-9))
    assert loose == pytest.approx(tight, rel=1e-3)


def test_compliance_falls_by_what_cells_feel():
    model = small(rule=Compliance("sensitivity"), tolerance=1e-10)
    model.run(3)
    felt, before = model._felt(), model.compliance
    start, changed = model.design.copy(), model.design.copy()
    cell = int(np.argmin(felt.slope * (start > 0.2) * (start < 0.9)))
    changed[cell] += 1e-4
    model.design = changed
    model._feel(0.0, 1e-10)
    slope = (model.compliance - before) / 1e-4
    assert slope == pytest.approx(felt.slope[cell], rel=2e-3)


def test_runs_are_the_same_bit_by_bit():
    model = small()
    model.run(6, progress=False)
    assert (model.steps, model.running) == (6, True)
    np.testing.assert_array_equal(model.run().designs, small().run().designs)


def test_a_tie_gets_the_thickness_that_its_stress_asks_for():
    stress = 100.0 / (0.02 * 0.01)
    rule = FullyStressed(stress=2.5 * stress)
    model = kaju.GrowthModel(tie(), rule=rule, volume=0.9, tolerance=1e-10)
    result = model.run()
    np.testing.assert_allclose(result.density, 0.4, rtol=1e-5)
    assert result.outcome.startswith("at rest")


def test_bone_rests_where_its_stimulus_is_met():
    # p U / x with U = σ²/(2 E x^p): at p = 1 the density is σ over the root of 2 E S.
    stress = 100.0 / (0.02 * 0.01)
    stimulus = stress**2 / (2.0 * 1e9 * 0.3**2)
    rule = Remodelling(stimulus=stimulus, lazy=0.0, powers=(1.0, 1.0), gain=0.4)
    result = kaju.GrowthModel(tie(), rule=rule, at_rest=1e-9, most_steps=200, tolerance=1e-10).run()
    np.testing.assert_allclose(result.density, 0.3, rtol=1e-5)


def test_the_lazy_zone_is_lazy():
    stress = 100.0 / (0.02 * 0.01)
    stimulus = stress**2 / (2.0 * 1e9 * 0.3**2)
    rule = Remodelling(stimulus=stimulus, lazy=0.1, powers=(1.0, 1.0))
    start = np.full((8, 2), 0.3 * np.exp(0.04))  # the stimulus is off by e to the -0.08
    result = kaju.GrowthModel(tie(), rule=rule, start=start).run(1)
    assert result.changes[1] == 0.0


@pytest.mark.parametrize(("power", "share", "rests"), [(1, 0.8, 1), (3, 0.8, 1), (3, 1.2, 0)])
def test_the_gain_is_stable_below_its_limit_and_not_above(power, share, rests):
    stress = 100.0 / (0.02 * 0.01)
    stimulus = power * stress**2 / (2.0 * 1e9 * 0.3 ** (power + 1))
    gain = share * 2.0 / (power + 1.0)
    rule = Remodelling(stimulus, gain, 0.0, (power, power), allow_unstable=True)
    options = {"start": np.full((8, 2), 0.31), "at_rest": 0.0, "most_steps": 30}
    changes = kaju.GrowthModel(tie(), rule=rule, **options).run().changes
    assert (changes[-1] < 0.1 * changes[1]) == bool(rests)
    if not rests:
        with pytest.raises(ParameterError, match=r"gain: .*allow_unstable"):
            Remodelling(gain=gain)


def test_starts_lead_to_the_same_bone():
    beam = Beam("cantilever", (32, 20))
    starts = np.ones(beam.cells), np.full(beam.cells, 0.5)
    full, half = (
        kaju.GrowthModel(beam.scene(), rule=Remodelling(0.06), start=start, most_steps=160).run()
        for start in starts
    )
    common = np.minimum(full.density, half.density).sum()
    assert common / np.maximum(full.density, half.density).sum() > 0.95
    assert half.grey < 0.25


def test_means_know_nothing_beyond_the_surface():
    body = np.ones((7, 5), dtype=bool)
    body[3:, 3:] = False
    count, rng = np.count_nonzero(body), np.random.default_rng(0)
    for around in (Neighbours.within(body, 2.4), Neighbours.across_faces(body)):
        np.testing.assert_allclose(around.means(np.full(count, 0.3)), 0.3, rtol=1e-14)
        a, b = rng.random(count), rng.random(count)
        assert around.means(a) @ b == pytest.approx(a @ around.handed_back(b), rel=1e-12)
    alone = Neighbours.within(body, 1.0)
    np.testing.assert_array_equal(alone.means(a), a)


def test_a_checkerboard_is_not_felt_as_its_opposite():
    board = (np.indices((8, 8)).sum(axis=0) % 2).astype(float)
    felt = Neighbours.across_faces(np.ones((8, 8), dtype=bool)).means(board.ravel())
    inside = felt.reshape(8, 8)[1:-1, 1:-1]
    np.testing.assert_allclose(inside, 0.5, rtol=1e-14)


def test_cubes_grow_too():
    scene = kaju.Scene(
        body={"cells": [8, 4, 4], "cell_size": 0.01, "material": "steel"},
        sides={"left": "rigid"},
        loads=[{"region": {"box": [[0.06, 0, 0], [0.08, 0.02, 0.02]]}, "force": [0, 0, -1.0]}],
    )
    result = kaju.GrowthModel(scene, volume=0.3, filter_radius=1.5).run(8)
    assert result.density.shape == (8, 4, 4)
    assert result.compliance < 0.5 * result.compliances[0]
    assert np.abs(result.volumes - 0.3).max() < 1e-12


def test_it_is_stored_and_looked_at(tmp_path):
    result = small().run()
    again = kaju.load_result(result.save(tmp_path / "grown"))
    assert again.history.equals(result.history)
    for name in ("density", "stiffness", "designs"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert again.summary() == result.summary()
    np.testing.assert_allclose(again.density_at(12), again.cells, atol=1e-7)
    assert np.ptp(again.density_at(0)) < 1e-6
    with pytest.raises(ParameterError, match="step: 0 to 12, got 13"):
        again.density_at(13)
    with pytest.raises(ResultError, match="stiffness"):
        kaju.compare(again, kaju.solve(SMALL.scene()))


def test_densities_that_were_not_kept_are_missed_by_name():
    result = small(keep=False).run(2)
    assert result.designs.shape == (0, 24 * 16)
    with pytest.raises(ParameterError, match="keep=True"):
        result.density_at(1)


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays, about: arrays.update(cells=arrays["cells"][:-1]),
        lambda arrays, about: arrays.update(cells=arrays["cells"] + 1.0),
        lambda arrays, about: arrays.update(volumes=arrays["volumes"][:-1]),
        lambda arrays, about: arrays.update(designs=arrays["designs"][:-1]),
        lambda arrays, about: about.update(stage=7),
        lambda arrays, about: [arrays.update({n: arrays[n][:0]}) for n in _BY_STEP],
    ],
)
def test_damaged_files_are_refused(tmp_path, change):
    path = small().run(2).save(tmp_path / "grown")
    with pytest.raises(ResultFileError):
        kaju.load_result(rewritten(path, change))


_BY_STEP = ("compliances", "volumes", "changes", "iterations", "designs")


@pytest.mark.parametrize(
    ("key", "options"),
    [
        ("rule", {"rule": "bone"}),
        ("rule", {"rule": 3}),
        ("volume", {"volume": 0.0}),
        ("filter_radius", {"filter_radius": -1.0}),
        ("filter_radius", {"filter_radius": 1e6}),
        ("most_steps", {"most_steps": 0}),
        ("at_rest", {"at_rest": -1.0}),
        ("tolerance", {"tolerance": 2.0}),
        ("start", {"start": np.ones((3, 3))}),
        ("start", {"start": np.full((24, 16), 1.5)}),
    ],
)
def test_arguments_that_break_a_rule_are_named(key, options):
    with pytest.raises(ParameterError, match=f"^{key}: "):
        small(**options)


@pytest.mark.parametrize(
    ("key", "make"),
    [
        ("filter", lambda: Compliance("both")),
        ("penalty", lambda: Compliance(penalty=0.5)),
        ("move", lambda: Compliance(move=0.0)),
        ("stimulus", lambda: Remodelling(stimulus=-1.0)),
        ("lazy", lambda: Remodelling(lazy=-0.1)),
        ("powers", lambda: Remodelling(powers=(0.0, 3.0))),
        ("while_rising", lambda: Remodelling(while_rising=(10, 5))),
        ("stress", lambda: FullyStressed(stress=0.0)),
        ("gain", lambda: FullyStressed(gain=2.0)),
    ],
)
def test_rules_name_what_breaks_theirs(key, make):
    with pytest.raises(ParameterError, match=f"^{key}: "):
        make()


def test_what_cannot_grow_says_why():
    scene = SMALL.scene()
    with pytest.raises(SceneError, match="loads: "):
        kaju.GrowthModel(scene.replace(loads=()))
    with pytest.raises(SceneError, match="sides: "):
        kaju.GrowthModel(scene.replace(sides={"left": {"displacement": [0.0, 1e-3]}}))
    with pytest.raises(SceneError, match="one cell wide"):
        kaju.GrowthModel(
            kaju.Scene(
                body={"cells": [8, 1], "cell_size": 0.01, "material": "steel"},
                sides={"left": "rigid"},
                loads=[{"side": "right", "force": [0.0, 1.0]}],
            )
        )
    heavy = dict(scene.body) | {"gravity": (0.0, -9.81)}
    dense = {"unit": {"youngs_modulus": 1.0, "poissons_ratio": 0.3, "density": 1.0}}
    with pytest.raises(SceneError, match="gravity: "):
        kaju.GrowthModel(scene.replace(body=heavy, materials=dense))


class Fading(GrowthRule):
    """Cells lose a tenth a step."""

    def grow(self, felt):
        return 0.9 * felt.design


class Rude(GrowthRule):
    """Answers what is no density."""

    def grow(self, felt):
        return felt.design + 1.0


@pytest.mark.parametrize("what", ["design", "history"])
def test_pictures(what):
    figure = kaju.plot(small().run(3), what)
    assert figure.axes[0].get_title(loc="left")


def test_a_picture_of_a_step_and_a_film(tmp_path):
    result = small().run(3)
    shown = kaju.plot(result, step=0).axes[0].collections
    (drawn,) = [collection for collection in shown if collection.get_gid() == "densities"]
    np.testing.assert_allclose(drawn.get_array(), 0.4, rtol=1e-6)
    assert kaju.animate(result, tmp_path / "grown.gif").stat().st_size > 1000


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("along", [0, 1])
def test_a_symmetric_scene_grows_symmetric(axis, along):
    """Loads along the mirror's axis turn round in it, those across do not: both are symmetric."""
    size = (40, 20) if axis == 1 else (20, 40)
    box = [[0.38, 0.09], [0.4, 0.11]] if axis == 1 else [[0.09, 0.38], [0.11, 0.4]]
    force = [0.0, 0.0]
    force[along] = -1.0
    scene = kaju.Scene(
        body={"cells": list(size), "cell_size": 0.01, "material": "steel"},
        sides={"left" if axis == 1 else "bottom": "rigid"},
        loads=[{"region": {"box": box}, "force": force}],
    )
    grown = kaju.GrowthModel(scene, volume=0.3, filter_radius=1.0, most_steps=40).run()
    assert grown.density.max() > 0.9
    np.testing.assert_allclose(grown.density, np.flip(grown.density, axis), atol=1e-9)
    uneven = np.full(size, 0.3)
    uneven[:10, :10] = 0.2
    other = kaju.GrowthModel(scene, volume=0.3, start=uneven, most_steps=3).run().density
    assert np.abs(other - np.flip(other, axis)).max() > 1e-3


def test_a_rule_of_ones_own():
    class Fading(GrowthRule):
        def grow(self, felt):
            return felt.design * 0.9

    rule = Fading()
    result = small(rule=rule).run(3)
    assert result.rule == "own"
    np.testing.assert_allclose(result.density[result.body], 0.4 * 0.9**3)

    class Wrong(GrowthRule):
        def grow(self, felt):
            return felt.design + 2.0

    with pytest.raises(ParameterError, match=r"Wrong\.grow must return 384 densities"):
        small(rule=Wrong()).step()
