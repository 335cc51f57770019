"""Networks that break spring by spring: bundles with known answers, cuts, and ledgers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scattered import scattered

import kaju
from kaju.model.network import cut, pulled, triangular


def cut_network(width, rows, half, given=False):
    """Return a lattice of springs of 1 N/m, a cut of 2·half spacings, and its true half length."""
    whole = triangular(width, rows)
    middle, level = 0.5 * (width - 1), 0.5 * np.sqrt(3.0) * (rows // 2 + 0.5)
    slit = cut(whole, (middle - half, level), (middle + half, level))
    load = {"displacement": 1.0} if given else {"force": width - 1.0}
    return pulled(slit, **load), (len(whole.springs) - len(slit.springs)) / 4.0


def bundle(count):
    """Return fibres side by side, each of 1 N/m, under 1 N."""
    return kaju.SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0]],
        np.tile([[0, 1]], (count, 1)),
        held=[[True, True], [False, True]],
        forces=[[0.0, 0.0], [1.0, 0.0]],
    )


def test_three_fibres():
    broken = kaju.FractureModel(bundle(3), strength=[1.0, 2.0, 3.0], scatter=0.0).run()
    assert broken.broken.tolist() == [0, 1, 2]
    np.testing.assert_allclose(broken.load_factor, [3.0, 4.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(broken.displacement, [1.0, 2.0, 3.0], rtol=1e-14)
    # Two fibres at 3 N hold 2.25 J, one at 4 N holds 8 J; the last one's 4.5 J are set free.
    np.testing.assert_allclose(broken.stored, [2.25, 8.0, 0.0], rtol=1e-14)
    np.testing.assert_allclose(broken.work, broken.stored + broken.released, rtol=1e-14)
    assert broken.avalanche.tolist() == [0, 1, 1]
    assert broken.largest_load_factor == pytest.approx(4.0)
    assert broken.outcome.startswith("parted")
    told = broken.summary()
    assert [told["work_J"], told["stored_J"]] == pytest.approx([broken.work[-1], 0.0])
    assert told["released_J"] == pytest.approx(told["work_J"]) == pytest.approx(9.25)
    assert (told["avalanches"], told["largest_avalanche"]) == (2, 2)
    assert (told["breaks"], told["breaks_before_the_largest_load"]) == (3, 1)


@pytest.mark.parametrize("weibull", [None, 5.0])
def test_fibres_share_the_load_equally(weibull):
    count = 600
    model = kaju.FractureModel(bundle(count), scatter=0.9, weibull=weibull, seed=3)
    broken = model.run()
    strength = np.sort(model.strengths)
    assert weibull or 0.1 < strength[0] < strength[-1] < 1.9  # spread by 0.9 about 1
    force = strength * (count - np.arange(count))
    np.testing.assert_allclose(broken.load_factor, force, rtol=1e-9)
    records = np.flatnonzero(force >= np.maximum.accumulate(force))
    np.testing.assert_array_equal(broken.avalanche_sizes, np.diff([*records, count]))


@pytest.mark.parametrize("moved", [False, True])
def test_every_break_is_what_the_network_left_says(moved):
    network, _ = cut_network(25, 25, 3.0, given=moved)
    model = kaju.FractureModel(network, strength=1e-5, scatter=0.4, seed=1)  # small strain
    broken = model.run()
    assert broken.outcome.startswith("parted")
    assert broken.breaks > 25
    for count in (0, 1, 7, broken.breaks // 2, broken.breaks - 1):
        left = broken.state(count)
        kept = np.delete(np.arange(len(network.springs)), broken.broken[:count])
        share = left.tension[-1] / model.strengths[kept]
        weakest = int(np.argmax(share))
        assert kept[weakest] == broken.broken[count]
        before = broken.load_factor[max(count - 1, 0)]
        assert before / share[weakest] == pytest.approx(broken.load_factor[count], rel=1e-8)
        if count:
            energy = 0.5 * (left.tension[-1] ** 2 / left.network.stiffness).sum()
            assert energy == pytest.approx(broken.stored[count - 1], rel=1e-8)
            load = 0.0 if moved else broken.load_factor[count - 1] * network.forces.sum()
            assert left.reactions().sum() == pytest.approx(-load, rel=1e-3, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["force", "strain", "energy"]))
def test_random_networks_keep_their_ledger(seed, measure):
    network = scattered(25, seed=seed % 50)
    broken = kaju.FractureModel(network, measure=measure, scatter=0.5, seed=seed).run()
    assert len(set(broken.broken.tolist())) == broken.breaks
    if broken.breaks:
        error = np.abs(broken.work - broken.stored - broken.released)
        # On the way to a mechanism up to nine digits are lost.
        assert error.max() <= 1e-6 * np.abs(broken.work).max()


def test_a_cut_weakens_by_its_stress_intensity():
    """G from two lengths of a cut against the handbook's K²/E (Tada, finite width)."""
    width, youngs_modulus = 80.0, 2.0 / np.sqrt(3.0)
    for half in (12, 20):
        compliance = []
        for change in (-0.5, 0.5):
            network, _ = cut_network(81, 141, half + change + 0.01)
            broken = kaju.FractureModel(network, scatter=0.0).run(1)
            compliance.append(broken.displacement[0] / broken.force[0])
        force = network.forces.sum()
        released = 0.5 * force**2 * (compliance[1] - compliance[0]) / 2.0  # of two tips
        found = np.sqrt(released * youngs_modulus)
        _, true_half = cut_network(81, 141, half + 0.01)
        share = 2.0 * true_half / width
        factor = 1.0 - 0.025 * share**2 + 0.06 * share**4
        wanted = factor * np.sqrt(np.pi * true_half / np.cos(0.5 * np.pi * share))
        assert found == pytest.approx(wanted, rel=0.025)


@pytest.mark.parametrize("change", [
    {"strength": 0.0}, {"strength": [1.0, 2.0]}, {"strength": np.nan}, {"scatter": 1.0},
    {"weibull": -1.0}, {"measure": "stress"}, {"most_breaks": 0},
])  # fmt: skip
def test_what_is_outside_its_rule_is_named(change):
    with pytest.raises(kaju.KajuError, match=next(iter(change))):
        kaju.FractureModel(bundle(3), **change)
