"""What hexagons hand on, what limits them, and books that do not balance."""

from dataclasses import replace

import pytest
from plates import plate

from kaju import LoadModel, PrescribedRule
from kaju.errors import StabilityError


def sheet(alpha, beta=1.0, **rule):
    rule = PrescribedRule(alpha, beta, threshold=1e-6, **rule)
    how = {"lattice": "hexagon", "sides": {}, "allow_floating": True}
    return plate([11, 12], [5, 6], [1.0, 0.0], rule=rule, **how)


def test_friction_reaches_two_of_the_four_neighbours_beside():
    model = LoadModel(sheet((0.5, 0.0, 0.1)))
    model.step()
    model.step()
    stage = model.result().last
    second = stage.history.generation == 2
    assert stage.cells[stage.history.agent[second]].tolist() == [[5, 5], [5, 7]]
    assert stage.history.load[second] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("beta", "words"),
    [
        # 2 α₃ + 3 α₁ν(1 - β) go sideways: 0.3 without a Poisson's share, 0.75 with all of it.
        (1.0, r"lower forward \(α₂\) below 0.7 or friction \(α₃\) below 0.125"),
        (0.0, r"lower forward \(α₂\) below 0.25, or judge"),
    ],
)
def test_what_grows_on_hexagons_is_told_how_far_to_lower_its_shares(beta, words):
    with pytest.raises(StabilityError, match=words):
        LoadModel(sheet((0.5, 0.75, 0.15), beta, accumulate=True))
    ahead = 0.7 if beta else 0.25
    LoadModel(sheet((0.5, ahead - 0.01, 0.15), beta, accumulate=True))


def test_books_tell_of_loads_handed_on_that_nobody_sent():
    ledger = LoadModel(sheet((0.5, 0.2, 0.1))).run().last.ledger
    assert ledger.imbalance < 1e-12
    entered = ledger.applied + ledger.emitted
    more = replace(ledger, returned=ledger.returned + 2.0 * entered)
    missing = entered - (ledger.applied + ledger.passed + ledger.returned)
    assert more.imbalance == pytest.approx(2.0 - missing / entered)
    assert replace(ledger, taken=ledger.taken + entered).imbalance == pytest.approx(1.0)
