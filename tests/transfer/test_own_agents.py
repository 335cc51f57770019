"""Agents, boundaries, orders and rules of one's own."""

import random
import traceback

import numpy as np
import pytest
from plates import loaded, plate
from transfer_answers import ENGINES

from kaju import ElasticRule, FreeBoundaryAgent, LoadModel, MaterialAgent, PrescribedRule, Shares
from kaju.agents.shares import Load
from kaju.errors import AgentError, ParameterError, ResultError
from kaju.view.plots import plot


def column(force=-1.0, cells=6, threshold=0.05, alpha=(0.5, 0.8, 0.0), **rule):
    rule = PrescribedRule(alpha=alpha, beta=1.0, threshold=threshold, **rule)
    return loaded([1, cells], {"side": "top", "force": [0.0, force]}, rule=rule)


class Growing(MaterialAgent):
    """Passes on 1.3 times what it takes, to and fro."""

    def emissions(self, load):
        return [e._replace(share=1.3) for e in super().emissions(load)]


def test_of_own_agents_nothing_is_known_and_growth_is_watched():
    model = LoadModel(column(), material_agent=Growing)
    assert not model.certificate.known
    assert model.certificate.verdict.startswith("not known whether loads end: agents of your")
    stage = model.run().last
    assert "the loads have grown to" in stage.outcome
    assert "allow_unstable=True" in stage.outcome
    assert 1e3 < stage.ledger.pending < 2e3
    assert stage.ledger.imbalance < 1e-12
    further = LoadModel(column(), material_agent=Growing, allow_unstable=True)
    assert further.run().last.ledger.pending > 1e12


def test_a_class_is_given_and_not_an_agent():
    for given in ((), (LoadModel(column()),)):
        with pytest.raises(AgentError, match="without brackets: Growing"):
            LoadModel(column(), material_agent=Growing(*given))
    with pytest.raises(ParameterError, match="it goes into LoadModel, boundary_agents="):
        LoadModel(column(), material_agent=Felt)
    with pytest.raises(ParameterError, match="goes into material_agent="):
        LoadModel(column(), Growing)
    with pytest.raises(AgentError, match=r"load\.total"):
        0.5 * Load(direction=2, magnitude=1.0)


class Felt(FreeBoundaryAgent):
    """Gives back half, and nothing of what is small."""

    def give_back(self, load, arm):
        back = self.turn(load, arm)
        return back._replace(magnitude=0.5 * back.magnitude) if load.magnitude > 0.2 else None


@pytest.mark.parametrize("accumulate", [False, True])
def test_a_boundary_that_absorbs(accumulate):
    scene = column(alpha=(0.5, 0.6, 0.1), accumulate=accumulate)
    model = LoadModel(scene, boundary_agents={"free": Felt})
    stage = model.run().last
    assert model.figures()["load_absorbed"] == stage.ledger.absorbed > 0.0
    assert stage.ledger.imbalance < 1e-12
    felt = model.agents_by_type[Felt]
    assert stage.ledger.absorbed == pytest.approx(sum(agent.kept for agent in felt))
    entries = plot(model.result()).axes[0].get_legend().get_texts()
    assert "Felt: free boundary agent of your own" in [entry.get_text() for entry in entries]
    for agent in felt:
        assert sum(agent.taken.values()) == pytest.approx(agent.returned + agent.kept)
    assert not model.certificate.known
    idle = LoadModel(scene, boundary_agents={"roller": Felt})
    assert "roller boundary: no Felt acted" in idle.run().notes[1]
    assert len(idle.agents_by_type[Felt]) == 0
    with pytest.raises(ResultError, match="no load reached a support"):
        idle.result().reactions["botom"]


def test_an_order_of_ones_own():
    """One agent a step, the one with most to take; what is taken in the end is the same."""
    scene = plate([4, 4], [1, 3], [0.3, -1.0], rule=PrescribedRule(threshold=0.05, sense=True))
    together = LoadModel(scene, engine="agents").run().last

    def heaviest(agents):
        return [max(agents, key=lambda agent: sum(load.total for load in agent.waiting()))]

    model = LoadModel(scene, order=heaviest)
    alone = model.run().last
    assert model.certificate.known
    assert alone.generations > together.generations
    for generation in range(1, alone.generations + 1):
        assert len(set(alone.history.agent[alone.history.generation == generation])) == 1
    by_place = [stage.taken[np.lexsort(stage.cells.T)] for stage in (alone, together)]
    np.testing.assert_allclose(*by_place, rtol=1e-12)
    assert alone.ledger.imbalance < 1e-12


def test_an_order_that_shuffles_a_list_in_place_is_told_what_to_return():
    for order in (lambda waiting: waiting.shuffle(), random.shuffle):
        with pytest.raises((AttributeError, ParameterError)) as told:
            LoadModel(column(), order=order).run()
        lines = "".join(traceback.format_exception_only(told.value))
        assert "return waiting[0].random.sample(waiting, len(waiting))" in lines
    mixed = LoadModel(column(), order=lambda w: w[0].random.sample(w, len(w)), seed=3)
    assert mixed.run().seed == 3


class AsElastic:
    """Answers with the shares that follow from the material."""

    threshold, accumulate, sense = 0.01, False, True

    def shares(self, material, dimension):
        derived = ElasticRule.shares(material, dimension)
        return Shares(*(0.9 * s for s in (derived.own, derived.forward, 0.2, derived.friction, 0)))


@ENGINES
def test_a_rule_of_ones_own(engine):
    scene = column(cells=3)
    model = LoadModel(scene, engine=engine, rule=AsElastic())
    assert model.certificate.known
    assert model.certificate.stable
    stage = model.run().last
    assert stage.ledger.imbalance < 1e-12
    assert stage.pulled.sum() > 0.0, "the load pulls at what it leaves"
    own = ElasticRule.shares(scene.cell_materials[0]).own
    np.testing.assert_allclose(
        stage.kept[:, 1], 0.9 * own * (stage.taken - 2 * stage.pulled)[:, 2:].sum(axis=1)
    )
