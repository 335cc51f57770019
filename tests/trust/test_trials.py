"""Trials find what they are there to find, and survive it."""

import csv
import json
import runpy
import sys
from dataclasses import astuple, replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from kaju import solve
from kaju.__main__ import main
from kaju.errors import KajuError, ParameterError
from kaju.model.study.trials import trial, trial_workers
from kaju.model.study.trials.stability_map import stability_map
from kaju.model.study.trials.trial import ENGINES, FAILED, REFUSED, attempt
from kaju.model.study.trials.trial_workers import bounded, tally, trials


def elastic_scene(rng, name):
    """A scene of a family, drawn again until its parts are held and its loads lie free."""
    while True:
        try:
            return trial.elastic_scene(rng, name)
        except KajuError:
            continue


def number_of(engine, after=0):
    """The first trial of an engine from a number on."""
    return next(n for n in range(after, after + 100) if ENGINES[n % len(ENGINES)] == engine)


def test_a_number_is_the_same_trial_every_time():
    one, again = attempt(1), attempt(1)
    assert astuple(one)[:-1] == pytest.approx(astuple(again)[:-1], nan_ok=True)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda scene: 1 / 0, "raw ZeroDivisionError"),
        (lambda scene: np.log(np.float64(0.0)), "raw RuntimeWarning"),
        (lambda scene: {}["missing"], "raw KeyError"),
        (lambda scene: solve(scene, resolution=-1), None),
    ],
)
def test_raw_errors_and_warnings_fail_and_named_ones_do_not(monkeypatch, broken, message):
    monkeypatch.setitem(trial._TO, "equal cells", lambda *_: broken(trial.elastic_scene(*_[:2])))
    found = attempt(number_of("equal cells", after=20))
    if message is None:
        assert found.verdict == REFUSED
        assert "resolution" in found.what
    else:
        assert found.verdict == FAILED
        assert found.what.startswith(message)


def test_forces_that_do_not_balance_fail(monkeypatch):
    monkeypatch.setattr(trial, "BALANCE", 0.0)
    monkeypatch.setattr(trial, "BALANCE_OF_ERROR", 0.0)
    outcomes = [attempt(n) for n in range(30) if ENGINES[n % len(ENGINES)] == "equal cells"]
    assert any("supports and loads differ" in o.what for o in outcomes if o.verdict == FAILED)


def test_a_certificate_that_does_not_hold_fails(monkeypatch):
    from kaju.model.transfer import load_transfer

    certify = load_transfer.certify

    def boasting(scene, transfer):
        from dataclasses import replace

        return replace(certify(scene, transfer), generations=0, stable=True)

    monkeypatch.setattr(load_transfer, "certify", boasting)
    outcomes = [attempt(n) for n in range(40) if ENGINES[n % len(ENGINES)] == "prescribed rule"]
    assert any("where the certificate says at most 0" in o.what for o in outcomes)


def test_the_books_must_balance(monkeypatch):
    monkeypatch.setattr(trial, "BOOKS", -1.0)
    assert "the books are off" in attempt(number_of("prescribed rule")).what


def test_what_hangs_is_killed_and_the_rest_goes_on():
    numbers = [number_of("three elements", after=n) for n in (0, 10, 20)]
    hung = list(trials(numbers, workers=1, limit=1e-9, beyond=0.0))
    assert [o.verdict for o in hung] == [FAILED] * 3
    assert all("hung: killed after" in o.what for o in hung)
    assert all(o.engine == "three elements" for o in hung)
    whole = list(trials(numbers, workers=2, limit=60.0))
    assert sorted(o.number for o in whole) == numbers
    assert [row.answered for row in tally(whole)] == [3]


def test_who_works_for_too_long_is_killed_whatever_the_clock_says(monkeypatch):
    monkeypatch.setattr(trial_workers, "PATIENCE", 1e9)
    (outcome,) = trials([5162], workers=1, limit=1.0, beyond=0.0)
    assert outcome.verdict == FAILED
    assert "hung: killed after" in outcome.what


@pytest.mark.parametrize(("how", "message"), [({"workers": 0}, "workers"), ({"limit": 0}, "limit")])
def test_trials_need_workers_and_time(how, message):
    with pytest.raises(ParameterError, match=message):
        next(trials([1], **how))


def test_the_certificate_draws_the_line_where_loads_begin_to_grow():
    for beta, ratio in ((1.0, 0.3), (0.0, 0.45)):
        found = stability_map(beta, ratio, steps=4)
        assert found.contradicted == 0
        assert (found.growth > 1.0).any()
        assert (found.growth < 1.0).any()
        # One material, loads added up: α₂ + 2α₃ + 2(1−β)να₁ exactly.
        exact = found.forward[:, None] + 2 * found.friction + 2 * (1 - beta) * ratio * 0.5
        assert np.allclose(found.radius, exact, rtol=0, atol=1e-9)


def test_the_command_writes_a_row_a_trial(monkeypatch, capsys, tmp_path):
    first = number_of("three elements")
    words = ["stress", "--first", str(first), "--count", "1", "--workers", "1", "--out", "here"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["kaju", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None)
    (row,) = csv.DictReader((tmp_path / "here/stress.csv").read_text().splitlines())
    assert (row["number"], row["verdict"]) == (str(first), "answered")
    assert (tmp_path / "here/outcomes.png").stat().st_size > 10_000
    assert "answered" in capsys.readouterr().out
    told = json.loads((tmp_path / "here/summary.json").read_text())
    assert told["engines"] == {"three elements": [1, 0, 0]}


def test_the_document_tells_the_record_of_all_trials(tmp_path):
    docs = Path(__file__).parents[2] / "docs"
    teller = runpy.run_path(str(docs / "draw_stability.py"))
    record = json.loads((docs / "stress.json").read_text())
    assert sum(map(sum, record["engines"].values())) == record["trials"] == 10_000
    refused = sum(refused for _, refused, _ in record["engines"].values())
    assert sum(record["refused"].values()) == refused
    assert record["refused"].get("others", 0) < 10
    assert teller["table_of"](record) in (docs / "stability.md").read_text()
    made = [attempt(number_of("network", after=n)) for n in (20, 60)]
    again = teller["outcomes_of"](_stored(made, tmp_path / "stress.csv"))
    assert [astuple(o)[:5] for o in again] == [astuple(o)[:5] for o in made]


def _stored(outcomes, table):
    list(trial_workers.record(outcomes, table))
    return table


WITH_TRUTH = 164
"""A pierced plate on equal cells whose truth finite elements tell."""


def test_a_bound_below_the_truth_fails(monkeypatch):
    pytest.importorskip("skfem")
    sound = attempt(WITH_TRUTH)
    assert sound.verdict == "answered"
    assert 0.0 < sound.true_error < 2.0 * sound.estimate
    assert sound.lower < sound.truth < sound.upper
    assert bounded([sound]) == (1, 1, 1)
    assert bounded([replace(sound, truth=2.0 * sound.truth)]) == (1, 1, 0)
    truth = trial._true_energy
    for wrong in (0.5, 1.5):
        monkeypatch.setattr(trial, "_true_energy", lambda scene, wrong=wrong: wrong * truth(scene))
        assert "lies outside of its bounds" in attempt(WITH_TRUTH).what


def test_the_truth_of_solids_is_not_asked_of_plane_elements():
    solid = attempt(324)
    assert (solid.family, solid.verdict) == ("comb", "answered")
    assert np.isnan(solid.true_error)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (1124, ""),  # factors refined to the digits that a part on a soft bed leaves
        (287, "SceneError: body: it resists its loads so little that rounding leaves all of them"),
        pytest.param(5162, "", marks=pytest.mark.slow),  # forces that do not balance are noted
        (1262, ""),  # a moved side's forces, beside which those applied are hardly digits
        (5219, ""),  # leftovers that no side passes on
        (6589, ""),
    ],
)
def test_bodies_at_the_end_of_the_digits_are_answered_or_named(number, words):
    outcome = attempt(number)
    assert outcome.verdict == (REFUSED if words else "answered")
    assert not words or outcome.what.startswith(words)


@pytest.mark.parametrize(
    ("number", "verdict"),
    [(732, "answered"), (2962, REFUSED), (8529, REFUSED)],
)
def test_solids_that_hardly_balance_or_ask_for_millions_of_cells_end_soon(number, verdict):
    began = process_time()
    assert attempt(number).verdict == verdict
    assert process_time() - began < 60  # with all that may have to be compiled


@pytest.mark.parametrize(
    ("number", "error", "seconds"),
    [(796, "ConvergenceError: creep: at 0.01947", 10), (5036, "BucklingError: creep: at 6.77", 15)],
)
def test_networks_that_creep_until_they_give_way_end_soon(number, error, seconds):
    began = process_time()
    outcome = attempt(number)
    assert outcome.verdict == REFUSED
    assert outcome.what.startswith(error)
    assert process_time() - began < seconds


def test_agents_of_ones_own_are_tried_too():
    outcomes = [attempt(n) for n in range(3, 60, 10)]
    own = [o for o in outcomes if o.family == "square, own agents"]
    assert own
    assert all(o.verdict == "answered" for o in own)


def test_every_kind_of_scene_is_among_the_first():
    from kaju.model.study.trials.trial_scenes import BODIES, hexagon_scene, transfer_scene

    rng = np.random.default_rng(0)
    bodies = [elastic_scene(rng, name) for name in BODIES for _ in range(40)]
    loads = [load for scene in bodies for load in scene.loads]
    assert any(load.couple is not None for load in loads)
    assert any(load.side and load.cell for load in loads)
    kinds = {c.kind for scene in bodies for c in scene.sides.values()}
    assert kinds >= {"rigid", "roller", "displaced"}
    ratios = [m.poissons_ratio for scene in bodies for m in scene.cell_materials]
    assert max(ratios) > 0.4999
    assert min(ratios) < -0.99
    stiff = [[m.youngs_modulus for m in scene.cell_materials] for scene in bodies]
    assert max(max(e) / min(e) for e in stiff) > 1e7
    assert min(scene.lattice.cell_size for scene in bodies) < 1e-7
    assert max(scene.lattice.cell_size for scene in bodies) > 1e4
    assert hexagon_scene(rng).lattice.kind == "hexagon"
    thresholds = [transfer_scene(rng).rule.threshold for _ in range(200)]
    assert min(thresholds) < 1e-200
    assert max(thresholds) > 1e20
