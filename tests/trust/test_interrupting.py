"""Ctrl-C ends a computation between two steps; what was computed is kept and marked."""

import json
import os
import signal
import threading
import time
from pkgutil import resolve_name

import numpy as np
import pytest
from plates import plate as pressed

import kaju
from kaju import ElasticModel, History, LoadModel, SpawningModel, ThreeElement, creep, load_result
from kaju.model.elastic.equal import krylov
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.rheology.integrate import Integrator
from kaju.stepping import NOTE, Interrupted


def plate(**changes):
    return pressed([20, 20], [10, 19], **changes)


def interrupting(monkeypatch, home, name, at):
    """Press Ctrl-C when a function has been called so often."""
    usual, passed = getattr(home, name), []

    def pressed(*args, **keywords):
        passed.append(1)
        if len(passed) == at:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0)  # where Python looks for signals
        return usual(*args, **keywords)

    monkeypatch.setattr(home, name, pressed)


@pytest.mark.parametrize(("model", "kind"), [(LoadModel, "prescribed"), (ElasticModel, "elastic")])
def test_a_run_keeps_the_steps_that_were_taken(monkeypatch, model, kind, capfd):
    run = model(plate(rule={"kind": kind}))
    interrupting(monkeypatch, model, "act_once", 4)
    with pytest.raises(Interrupted) as stop:
        run.run()
    assert "interrupted after 4" in stop.value.best.outcome
    assert run.steps == 4
    assert "once more" in capfd.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_agents_that_spawn_keep_their_generation(monkeypatch):
    whole = kaju.solve(plate(), tolerance=0.03)
    run = SpawningModel(plate(), tolerance=0.03)
    interrupting(monkeypatch, SpawningModel, "act_once", 2)
    with pytest.raises(Interrupted) as stop:
        run.run()
    assert len(stop.value.best.generations) == 2 < len(whole.generations)


@pytest.mark.parametrize(
    ("asked", "answer"),
    [({}, "cells"), ({"tolerance": 0.02}, "tree"), ({"tolerance": 0.02, "goal": "top"}, "tree")],
)
def test_solve_keeps_what_was_found_and_says_so(monkeypatch, tmp_path, asked, answer):
    hole = {"disk": {"centre": [0.1, 0.1], "radius": 0.04}, "material": "air"}
    # Few cells and agents are iterated here as many are.
    monkeypatch.setattr("kaju.model.elastic.equal.solver.FEW", {2: 0, 3: 0})
    interrupting(monkeypatch, krylov, "interrupt_requested", 3)
    interrupting(monkeypatch, PairLoop, "step", 2)
    with pytest.raises(KeyboardInterrupt) as stop:
        kaju.solve(plate(regions=[hole]), **asked)
    best = stop.value.best
    assert best.found.storage == answer
    assert NOTE in best.notes
    assert NOTE in kaju.load_result(best.save(tmp_path / "part.npz")).notes


def test_time_ends_where_it_was(monkeypatch, tmp_path):
    law = ThreeElement(K_f=2e6, D_f=3e6, D_d=4e7)
    times = np.linspace(0.1, 1.0, 10)
    whole = creep(law, History.step(), 1.0, times=times)
    interrupting(monkeypatch, Integrator, "take_step", 26)
    with pytest.raises(Interrupted) as stop:
        creep(law, History.step(), 1.0, times=times)
    best = kaju.load_result(stop.value.best.save(tmp_path / "part.npz"))
    assert best.notes == (NOTE,)
    seen = np.isin(best.times, times).sum()
    assert 0 < seen < len(times)
    np.testing.assert_array_equal(best.displacement[:seen], whole.displacement[:seen])


def test_a_second_time_ends_at_once(monkeypatch):
    run = LoadModel(plate())
    interrupting(monkeypatch, LoadModel, "act_once", 3)
    interrupting(monkeypatch, LoadModel, "act_once", 3)
    with pytest.raises(KeyboardInterrupt) as stop:
        run.run()
    assert not isinstance(stop.value, Interrupted)


def test_only_who_is_in_charge_of_signals_listens():
    found = []
    thread = threading.Thread(target=lambda: found.append(LoadModel(plate()).run()))
    thread.start()
    thread.join()
    assert found[0].outcome.startswith("at rest")


RUNS = {  # the rule, words, and what takes a step
    "run": ({"threshold": 1e-9}, [], "transfer.load_transfer.LoadTransfer.step"),
    "solve": ({"kind": "elastic"}, ["--tolerance", "0.003"], "elastic.pair.loop.PairLoop.step"),
    "creep": ({"threshold": 1e-5}, ["--hold", "10"], "rheology.integrate.Integrator.take_step"),
}


@pytest.mark.parametrize("verb", RUNS)
@pytest.mark.parametrize("kept", [False, True])
def test_what_an_interrupted_command_leaves(kaju, monkeypatch, tmp_path, verb, kept):
    """Before there is anything to keep there is no folder, later a whole one."""
    rule, more, step = RUNS[verb]
    pressed([8, 8], [4, 7], size=[0.2, 0.2], rule=rule).save(tmp_path / "scene.toml")
    place, _, name = f"kaju.model.{step if kept else 'scene.load_scene'}".rpartition(".")
    interrupting(monkeypatch, resolve_name(place), name, 3 if kept else 1)
    code, _, told = kaju(verb, "scene.toml", "--out", "answer", *more, "--no-pictures")
    assert (code, "Traceback" in told, "answer" in told) == (130, False, kept)
    folder = tmp_path / "answer"
    assert folder.exists() == kept
    if kept:
        summary = json.loads((folder / "summary.json").read_text())
        words = [summary.get("outcome", ""), *summary.get("notes", [])]
        words += [getattr(load_result(folder), "outcome", "")]
        assert any("interrupted" in word for word in words)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
