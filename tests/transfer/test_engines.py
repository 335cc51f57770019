"""Objects and arrays are two tellings of one story."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from plates import plate
from strategies import Triangles, scenes
from transfer_answers import assert_same

from kaju import LoadModel, MaterialAgent, stability
from kaju.errors import StabilityError
from kaju.model.transfer import array_engine
from kaju.model.transfer.agent_engine import AgentEngine
from kaju.model.transfer.array_engine import ArrayEngine
from kaju.model.transfer.stage import Ledger


def assert_same_stage(one, other):
    """To twelve digits; the books to twelve digits of all that enters them: their sums cancel."""
    assert_same(one, replace(other, ledger=one.ledger), 1e-12)
    entered = 1e-12 * max(one.ledger.applied + one.ledger.emitted, 1.0)
    assert asdict(other.ledger) == pytest.approx(asdict(one.ledger), rel=1e-12, abs=entered)


def run_both(scene):
    """Run a scene on both engines: same loads, balanced ledgers, a certificate that is right."""
    certificate = stability(scene)
    if not certificate.stable:
        if certificate.known:
            with pytest.raises(StabilityError, match="lower"):
                LoadModel(scene)
        return
    models = [LoadModel(scene, engine=engine) for engine in ("agents", "arrays")]
    one, other = (model.run() for model in models)
    agents, ledger = one.last, one.last.ledger
    assert_same_stage(agents, other.last)
    assert ledger.imbalance < 1e-12
    assert ledger.pending == 0.0
    assert ledger.taken == pytest.approx(agents.taken.sum(), rel=1e-12)
    assert ledger.returned == pytest.approx(agents.returned.sum(), rel=1e-12, abs=1e-12)
    assert np.isfinite(other.displacement).all()
    assert agents.generations <= models[0].certificate.generations


@settings(max_examples=30)
@given(scene=scenes())
def test_both_engines_give_the_same_loads_and_balanced_ledgers(scene):
    run_both(scene)


@pytest.mark.slow
@settings(max_examples=700)
@given(scene=scenes() | scenes(senses=st.just(True)))
def test_both_engines_agree_on_hundreds_of_scenes(scene):
    assume(stability(scene).stable)
    run_both(scene)


class Quiet(MaterialAgent):
    """Keeps everything."""

    def pass_on(self, load):
        self.dropped += load.total


def test_an_agent_of_ones_own_switches_to_objects():
    scene = plate([200, 200], [3, 7])
    assert isinstance(LoadModel(scene).engine, ArrayEngine)
    model = LoadModel(scene, material_agent=Quiet)
    assert isinstance(model.engine, AgentEngine)
    stage = model.run().last
    assert stage.cells.tolist() == [[3, 7]]
    assert stage.ledger == Ledger(2.0, 2.0, 1.0, 2.0, 0.0, 0.0, 2.0, 0.0)


@pytest.mark.parametrize("accumulate", [False, True])
@pytest.mark.parametrize("lattice", ["square", "hexagon", Triangles])
def test_many_loads_in_parts_and_sparse_tables_give_the_same(monkeypatch, accumulate, lattice):
    rule = {"threshold": 1e-3, "accumulate": accumulate, "alpha": [0.5, 0.4, 0.1], "sense": True}
    sides = {"bottom": "rigid", "left": "roller"}
    scene = plate([8, 6], [3, 5], [0.3, -2.0], lattice=lattice, sides=sides, rule=rule)
    few = LoadModel(scene, engine="arrays").run().last
    for name, value in {"ROWS_AT_ONCE": 5, "MOST_EMPTY": -1e9, "LOOKED_AT_ONCE": 4}.items():
        monkeypatch.setattr(array_engine, name, value)
    many = LoadModel(scene, engine="arrays").run().last
    assert_same_stage(few, many)
    assert many.ledger.imbalance < 1e-12


@pytest.mark.parametrize("engine", ["agents", "arrays"])
def test_a_load_that_ended_has_woken_nobody(engine):
    """The cell below is woken from the left; what the one above presses down on it is too small."""
    rule = {"alpha": [0.5, 0.5, 0.0], "beta": 0.0, "accumulate": True, "threshold": 0.1}
    scene = plate([3, 2], [0, 0], [1.0, 0.0], rule=rule)
    above = scene.loads[0].model_copy(update={"cell": (1, 1), "force": (0.3, 0.0)})
    stage = LoadModel(scene.replace(loads=[*scene.loads, above]), engine=engine).run().last
    woken = dict(zip(map(tuple, stage.cells.tolist()), stage.woken_by.tolist(), strict=True))
    assert woken[1, 0] == 1 << scene.lattice.direction_names.index("-x")


@pytest.mark.parametrize("accumulate", [False, True])
def test_cells_whose_numbers_no_integer_holds_are_named_anew(accumulate):
    """A corner of a body of 4·10¹⁸ cells does what the same corner of a small one does."""
    rule = {"threshold": 0.02, "accumulate": accumulate, "alpha": [0.5, 0.4, 0.15]}

    def corner(cells):
        sides = {"bottom": "rigid", "left": "rigid"}
        scene = plate(cells, [2, 1], [0.5, -2.0], sides=sides, rule=rule)
        return LoadModel(scene, engine="arrays").run().last

    small, giant = corner([40, 40]), corner([10**9, 4 * 10**9])
    assert small.cells.max() < 39
    assert_same_stage(small, giant)
