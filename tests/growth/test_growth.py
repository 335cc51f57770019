"""Bodies that grow: against a peer's designs, known limits, and what must hold at every step."""

import json
from pathlib import Path

import numpy as np
import pytest
from peers.optimality import POWER, VOID, Beam, Bilinear
from plates import loaded
from stored_files import rewritten

import kaju
from kaju.errors import ParameterError, ResultError, ResultFileError
from kaju.model.growth.growth_rules import Compliance, FullyStressed, GrowthRule, Remodelling

ROOT = Path(__file__).parents[2]
BRIDGE = ROOT / "examples" / "bridge" / "bridge.toml"
DESIGNS = ROOT / "tests" / "data" / "half_beam_designs.npz"
SMALL = Beam("cantilever", (24, 16))
STRESS = 100.0 / (0.02 * 0.01)


def small(**options):
    usual = {"volume": 0.4, "filter_radius": 1.5, "most_steps": 12, "at_rest": 0.0}
    return kaju.GrowthModel(SMALL.scene(), **usual | options)


def tie(**options):
    """A bar that is pulled along x, without Poisson's ratio: its force is known everywhere."""
    lime = {"lime": {"youngs_modulus": 1e9, "poissons_ratio": 0.0}}
    of = {"thickness": 0.01, "material": "lime", "materials": lime}
    of |= {"sides": {"left": "roller", "bottom": "roller"}}
    scene = loaded([8, 2], {"side": "right", "force": [100.0, 0.0]}, **of)
    return kaju.GrowthModel(scene, tolerance=1e-10, **options).run()


@pytest.mark.parametrize(("filter", "most"), [("density", 1.01), ("sensitivity", 1.02)])
def test_the_half_beam_is_as_stiff_as_the_peers_by_both_solvers(filter, most):
    beam = Beam("half beam", (150, 50))
    with np.load(DESIGNS) as designs:
        theirs = VOID + (1.0 - VOID) * (designs[filter] * 1e-4) ** POWER
    options = {"volume": 0.5, "filter_radius": 2.4, "most_steps": 60, "at_rest": 0.0}
    result = kaju.GrowthModel(beam.scene(), rule=Compliance(filter), **options).run()
    assert np.abs(result.volumes - 0.5).max() < 1e-12
    assert all(check.holds for check in result.checks())
    field = np.ones((150, 51))
    field[:, 1:] = theirs
    peer = 2.0 * kaju.solve(beam.scene(), stiffness=field).strain_energy
    assert result.compliance < most * peer
    own = Bilinear(beam)
    assert own.feel(result.stiffness[:, 1:])[0] < most * own.feel(theirs)[0]


def test_without_a_filter_no_checkerboard_grows():
    beam = Beam("cantilever", (48, 30))
    options = {"volume": 0.4, "filter_radius": 1.0, "most_steps": 40}
    density = kaju.GrowthModel(beam.scene(), **options).run().density
    a, b, c, d = density[:-1, :-1], density[1:, 1:], density[1:, :-1], density[:-1, 1:]
    assert (density > 0.95).sum() > 200
    assert not (np.abs(a + b - c - d) > 1.6).any()


def test_a_body_with_a_hole_on_one_side_grows_otherwise_on_the_other():
    loads = [{"cell": [i, 4], "side": "top", "force": [0.0, -0.3]} for i in (1, 7)]
    hole = {"box": [[0.05, 0.02], [0.06, 0.03]], "material": "air"}
    options = {"volume": 0.5, "most_steps": 6, "filter_radius": 1.5}
    for regions in ([], [hole]):
        model = kaju.GrowthModel(loaded([9, 5], *loads, regions=regions), **options)
        density = model.run().density
        assert np.allclose(density[:3], density[:-4:-1]) == (not regions)


def test_compliance_falls_by_what_cells_feel():
    """The slope that rules are told, against the difference between two designs."""

    class Looking(GrowthRule):
        def grow(self, felt):
            self.felt = felt
            return felt.design

    start = np.random.default_rng(0).uniform(0.3, 0.9, (24, 16))
    first = small(rule=Looking(), start=start, tolerance=1e-10)
    first.step()
    felt = first.rule.felt
    cell = np.unravel_index(np.argmin(felt.slope), start.shape)
    changed = start.copy()
    changed[cell] += 1e-4
    second = small(rule=Looking(), start=changed, tolerance=1e-10)
    slope = (second.compliance - first.compliance) / 1e-4
    assert slope == pytest.approx(felt.slope.min(), rel=2e-3)


def test_a_tie_gets_the_thickness_that_its_stress_asks_for():
    result = tie(rule=FullyStressed(stress=2.5 * STRESS), volume=0.9)
    np.testing.assert_allclose(result.density, 0.4, rtol=1e-5)
    assert np.all(result.pulled_shares == 1.0)
    assert result.outcome.startswith("at rest")


def test_bone_rests_where_its_stimulus_is_met():
    # p U / x with U = σ²/(2 E x^p): at p = 1 the density is σ over the root of 2 E S.
    stimulus = STRESS**2 / (2.0 * 1e9 * 0.3**2)
    rule = Remodelling(stimulus=stimulus, lazy=0.0, powers=(1.0, 1.0), gain=0.4)
    assert (rule.patience, Remodelling().patience) == (0, 100)
    result = tie(rule=rule, at_rest=1e-9, most_steps=200)
    np.testing.assert_allclose(result.density, 0.3, rtol=1e-5)
    lazy = Remodelling(stimulus=stimulus, lazy=0.1, powers=(1.0, 1.0))
    start = np.full((8, 2), 0.3 * np.exp(0.04))  # the stimulus is off by e to the -0.08
    assert tie(rule=lazy, start=start).changes[1] == 0.0


def test_it_is_stored_and_shown(tmp_path):
    result = small().run()
    again = kaju.load_result(result.save(tmp_path / "grown"))
    assert again.history.equals(result.history)
    assert again.summary() == result.summary()
    for name in ("density", "stiffness", "designs", "pulled"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    np.testing.assert_allclose(again.density_at(12), again.cells, atol=1e-7)
    with pytest.raises(ParameterError, match="step: 0 to 12, got 13"):
        again.density_at(13)
    with pytest.raises(ResultError, match="stiffness"):
        kaju.compare(again, kaju.solve(SMALL.scene()))
    shown = kaju.plot(result, step=0).axes[0].collections
    (drawn,) = [collection for collection in shown if collection.get_gid() == "densities"]
    np.testing.assert_allclose(drawn.get_array(), 0.4, rtol=1e-6)
    assert kaju.plot(result, "history").axes
    assert kaju.animate(small().run(3), tmp_path / "grown.gif").stat().st_size > 1000


_BY_STEP = ("compliances", "volumes", "changes", "iterations", "designs", "pulled")


@pytest.mark.parametrize("change", [
    lambda arrays, about: arrays.update(cells=arrays["cells"][:-1]),
    lambda arrays, about: arrays.update(cells=arrays["cells"] + 1.0),
    lambda arrays, about: arrays.update(designs=arrays["designs"][:-1]),
    lambda arrays, about: about.update(stage=7),
    lambda arrays, about: about.pop("kind"),
    lambda arrays, about: [arrays.update({n: arrays[n][:0]}) for n in _BY_STEP],
])  # fmt: skip
def test_damaged_files_are_refused(tmp_path, change):
    path = small().run(2).save(tmp_path / "grown")
    with pytest.raises(ResultFileError):
        kaju.load_result(rewritten(path, change))


class Rude(GrowthRule):
    def grow(self, felt):
        return felt.design + 2.0  # no density


BROKEN = {
    "rule": [lambda: small(rule="bone"), lambda: small(rule=3), lambda: small(rule=Rude()).run()],
    "volume": [lambda: small(volume=0.0)],
    "filter_radius": [lambda: small(filter_radius=-1.0), lambda: small(filter_radius=1e6)],
    "most_steps": [lambda: small(most_steps=0)],
    "at_rest": [lambda: small(at_rest=-1.0)],
    "tolerance": [lambda: small(tolerance=2.0)],
    "start": [lambda: small(start=np.ones((3, 3))), lambda: small(start=np.full((24, 16), 1.5))],
    "filter": [lambda: Compliance("both")],
    "penalty": [lambda: Compliance(penalty=0.5)],
    "move": [lambda: Compliance(move=0.0)],
    "stimulus": [lambda: Remodelling(stimulus=-1.0)],
    "lazy": [lambda: Remodelling(lazy=-0.1)],
    "powers": [lambda: Remodelling(powers=(0.0, 3.0))],
    "while_rising": [lambda: Remodelling(while_rising=(10, 5))],
    "stress": [lambda: FullyStressed(stress=0.0)],
    "gain": [lambda: FullyStressed(gain=2.0)],
}


@pytest.mark.parametrize("key", BROKEN)
def test_arguments_that_break_a_rule_are_named(key):
    for make in BROKEN[key]:
        with pytest.raises(ParameterError, match=f"^{key}: "):
            make()


def test_the_command_grows_a_bridge(tmp_path, typed):
    out = tmp_path / "grown"
    words = ["grow", BRIDGE, "--out", out, "--volume", "30%", "--radius", 2, "--steps", 12]
    told = typed(*words, "--json")
    figures, result = json.loads(told.stdout), kaju.load_result(out)
    assert figures["outcome"] == "ended after 12 steps, as asked"
    assert figures["volume"] == pytest.approx(0.3, rel=1e-12)
    assert figures["compliance_J"] < 0.2 * figures["compliance_at_first_J"]
    assert result.compliance == figures["compliance_J"]
    # The right abutment slides, so a tie holds the feet of the arch together.
    assert result.density[30:50, 1].min() > 0.9
    assert result.density[20:60, 5:12].mean() < 0.2 < result.density[20:60, 25:].mean()
    assert {path.name for path in out.iterdir()} == {"design.png", "result.npz", "summary.json"}
