"""Agents, boundaries, orders, steps and lattices that answer nonsense: each is told, none hangs."""

from itertools import repeat
from math import inf, nan

import numpy as np
import pytest
from plates import plate

import kaju
from kaju import ElasticModel, FaceAgent, KajuError, Load, LoadModel, MaterialAgent, State


def scene(lattice="square"):
    return plate([4, 3], [1, 2], [0.3, -2.0], lattice=lattice, rule={"threshold": 0.01})


def material(**methods):
    return {"material_agent": type("Mine", (MaterialAgent,), methods)}


def wall(base=kaju.RigidBoundaryAgent, **methods):
    return {"boundary_agents": {"rigid": type("Wall", (base,), methods)}}


def face(**methods):
    return {"face_agent": type("Face", (FaceAgent,), methods)}


def each(change):
    """Return agents that change each of their emissions."""
    usual = MaterialAgent.emissions
    return material(emissions=lambda self, load: tuple(change(*e) for e in usual(self, load)))


def over(one, value):
    """Return agents that put a plain value over what their base declares."""
    base = type("Base", (MaterialAgent,), {"worn": one})
    return {"material_agent": type("Mine", (base,), {"worn": value})}


def passes(pass_on):
    return material(pass_on=pass_on)


def hands(arm, load):
    """Return agents that hand a load of their own over an arm."""
    return passes(lambda self, own: self.model.hand_over(self, arm, load))


def after_take(act):
    def take(self, load):
        MaterialAgent.take(self, load)
        act(self, load)

    return material(take=take)


def sets(**values):
    def begin(self, model, cell, stuff, shares):
        MaterialAgent.__init__(self, model, cell, stuff, shares._replace(**values))

    return material(__init__=begin)


def gives(back):
    return wall(give_back=lambda self, load, arm: back)


def run(own, order="wave", **limits):
    rule = {"kind": "elastic", "threshold": 0.05, "order": order}
    if "face_agent" in own:
        return ElasticModel(scene().replace(rule=rule), **own).run()
    return LoadModel(scene(), **own, **limits).run(progress=False)


class Takes:
    def take(self, load):
        super().take(load)


ELSEWHERE = ("passOn", "on_take", "emit", "go", "receive", "advance", "step_agent")
ADDS = material(emissions=lambda self, load: self.go(load), go=lambda self, load: () + [load])
APPENDS = material(emissions=lambda self, load: MaterialAgent.emissions(self, load).append(load))
ASKS = material(emissions=lambda self, load: self.model.agent_at((0, 0)).kept)
THERE = "pass_on of Mine at cell (1, 2) in generation 1"
AHEAD = kaju.Emission(0, 0, 0.1, "push")
REFUSED = {
    "share NaN": each(lambda a, d, s, t: (a, d, nan, t)),
    "share a word": each(lambda a, d, s, t: (a, d, "half", t)),
    "sense unknown": each(lambda a, d, s, t: (a, d, s, "hug")),
    "direction too large": each(lambda a, d, s, t: (a, 4, s, t)),
    "arm too large": each(lambda a, d, s, t: (9, d, s, t)),
    "arm of numbers": each(lambda a, d, s, t: (np.array([a, a]), d, s, t)),
    "direction a float": each(lambda a, d, s, t: (a, float(d), s, t)),
    "emission of three": each(lambda a, d, s, t: (a, d, s)),
    "attribute misspelt": after_take(lambda self, load: setattr(self, "squezed", 1.0)),
    "state misspelt": material(broke=State(0), take=lambda self, load: setattr(self, "broken", 1)),
    "states mixed up": material(worn=State(0), take=lambda self, load: setattr(self, "wron", 1)),
    "state set": after_take(lambda self, load: setattr(self, "worn", State(0.0))),
    "mixin last": {"material_agent": type("Mine", (MaterialAgent, Takes), {})},
    "state bare": material(worn=State),
    "state lost": over(State(0.0), 0.5),
    "parameter lost": over(kaju.Parameter(0.1, 0, 1), 0.5),
    "emissions None": material(emissions=lambda self, load: None),
    "emissions one row": material(emissions=lambda self, load: AHEAD),
    "emissions without end": material(emissions=lambda self, load: repeat(AHEAD)),
    "hands NaN": hands(0, Load(0, nan)),
    "hands below 0": hands(0, Load(0, -1.0)),
    "hands over no arm": hands(7, Load(0, 1.0)),
    "hands None": hands(0, None),
    "hides a method": material(waiting=0),
    "keeps less than nothing": after_take(lambda self, load: setattr(self, "kept", -1.0)),
    "keeps NaN": after_take(lambda self, load: setattr(self, "kept", nan)),
    "forgets its books": after_take(lambda self, load: setattr(self, "taken", [0.0] * 4)),
    "has no material left": after_take(lambda self, load: setattr(self, "material", None)),
    "leaves": after_take(lambda self, load: self.remove()),
    "makes another": after_take(
        lambda self, load: type(self)(self.model, self.cell, self.material, self.shares)
    ),
    "yields its loads": material(take=lambda self, load: (yield)),
    "hands over for nobody": passes(lambda self, load: self.model.hand_over(None, 0, load)),
    "yields NaN": material(shortening=lambda self, axis: nan),
    "shares NaN": sets(forward=nan),
    "shares below 0": sets(friction=-0.1),
    "shares no Shares": after_take(lambda self, load: setattr(self, "shares", None)),
    "begins without super": material(__init__=lambda self, model, cell, stuff, shares: None),
    "gives back beyond floats": gives(Load(3, 10**400)),
    "gives back more than it took": gives(Load(3, 4.0)),
    "turns nowhere": wall(kaju.BoundaryAgent),
    "turns nothing": wall(turn=lambda self, load, arm: None),
    "gives back a row": gives((3, 0.01, "push")),
    "wall remembers": wall(wet=State(0)),
    "pass_on twice": passes(lambda self, load: [MaterialAgent.pass_on(self, load) for _ in "ab"]),
    "passes rows on": passes(lambda self, load: self.emissions(load)),
    "steps without super": material(step=lambda self: [self.take(o) for o in self.waiting()]),
    **{f"hook {name}": material(**{name: lambda self, load: None}) for name in ELSEWHERE},
    "answers loads under another name": material(respond=lambda self, load: None),
    "gives back under another name": wall(soak=lambda self, load, arm: None),
    "takes a number": material(take=lambda self, load: MaterialAgent.take(self, load.magnitude)),
    "gives back inside": material(give_back=lambda self, load, arm: load),
    "rule takes none": {"rule": type("Mine", (kaju.PrescribedRule,), {"shares": lambda m: 0})()},
    "rule misspelt": {"rule": type("Mine", (kaju.PrescribedRule,), {"share": lambda *of: 0})()},
    "order takes two": {"order": lambda model, agents: agents},
    "order chooses nobody": {"order": lambda agents: []},
    "order chooses others": {"order": lambda agents: [object()]},
    "order without end": {"order": lambda agents: repeat(agents[0])},
    "face due NaN": face(due=lambda self, asked: nan),
    "face due nothing": face(due=lambda self, asked: None),
    "face due beyond floats": face(due=lambda self, asked: 10**400),
    "face takes NaN": face(take=lambda self, load: FaceAgent.take(self, nan)),
    "face passes to nobody": face(pass_on=lambda self, load: self.model.hand_over(self, -1, load)),
    "face passes NaN": face(pass_on=lambda self, load: self.model.hand_over(self, 0, nan)),
    "face returns shares": face(pass_on=lambda self, load: self.place.links),
    "face begins without super": face(__init__=lambda self, *start: None),
    "face hook misspelt": face(dues=lambda self, asked: asked),
    "face Parameter": face(relax=kaju.Parameter(1.4, 1, 2)),
    "face State": face(worn=State(0.0)),
    "face steps": face(step=lambda self: None),
}


if not hasattr(LoadModel, "scenario"):  # from 3.5 on Mesa itself takes no step within a step
    REFUSED["steps its model"] = after_take(lambda self, load: self.model.step())


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_no_answer_is_refused_by_name(kind):
    with pytest.raises(KajuError) as told:
        run(REFUSED[kind])
    names = {"boundary_agents": "Wall", "order": "order", "face_agent": "Face"}
    name = {"steps its model": "step:", "hands over for nobody": "hand_over:"}.get(kind)
    part = kind.partition(" ")[0]
    assert part not in ("arm", "direction", "share", "sense") or f"wrong: {part}" in str(told.value)
    assert (name or names.get(next(iter(REFUSED[kind])), "Mine")) in str(told.value)


@pytest.mark.parametrize("more", [
    {"eager": property(lambda self: self.answer)}, {"_tell": lambda self: self.answer},
    {"_all": lambda self: [each.answer for each in self.model.agents]},
    {"take": MaterialAgent.take}, {"answer": lambda self, much: None}, {"answer": 0.5},
    {"step": lambda self: self._act(), "_act": lambda self: MaterialAgent.step(self)},
])  # fmt: skip
def test_a_method_that_something_calls_or_that_takes_no_load_is_let_alone(more):
    assert "at rest" in run(material(**{"answer": lambda self, load: None} | more)).outcome


@pytest.mark.parametrize(("name", "slip"), [
    ("wearing", "werning"), ("wear", "wears"), ("limit", "limits"), ("limit", "limt"),
])  # fmt: skip
def test_a_slip_beside_a_state_or_parameter_is_told_when_it_happens(name, slip):
    def take(self, load):
        MaterialAgent.take(self, load)
        if self.model.generation == 2:
            setattr(self, slip, 3)

    declared = kaju.Parameter(3, 1, 9) if name == "limit" else State(0)
    model = LoadModel(scene(), **material(**{name: declared, "take": take}))
    if slip == f"{name}s":
        assert "at rest" in model.run().outcome
    else:
        with pytest.raises(kaju.errors.AgentError, match=f"in generation 2 .*{name!r}.* the class"):
            model.run()
        assert model.result().outcome == "interrupted after 2 generations"


@pytest.mark.parametrize(("kind", "told"), [
    ("wall remembers", "only; let Wall have a plain attribute, wet = 0, seen"),
    ("face Parameter", "^[^;]*no Parameter;"),
    ("state lost", r"^worn: Mine makes it 0.5, .* a State; write worn = kaju.State\(0.5\), or"),
    ("parameter lost", r"a Parameter; write worn = kaju.Parameter\(0.5, low, high\), or"),
    ("mixin last", r"Mine names Takes last, .* write class Mine\(Takes, MaterialAgent\)"),
    ("state set", "^worn: .*; declare it on a class"),
    ("state bare", "^worn: Mine makes it a class; call it"),
])  # fmt: skip
def test_what_is_not_kept_is_told_of_that_kind_alone(kind, told):
    with pytest.raises(KajuError, match=told):
        run(REFUSED[kind])


def forgets(agent, load):
    MaterialAgent.pass_on(agent, load)
    agent.passed.clear()


def puts(agent, load):
    if agent.spawn_step > 1:
        agent.engine.boxes[1, 2][2, 0.02, "push"] += 1.0
    MaterialAgent.pass_on(agent, load)


UNBALANCED = {
    "takes without booking": material(take=lambda self, load: None),
    "books twice": after_take(lambda self, load: MaterialAgent.take(self, load)),
    "forgets what it took": after_take(lambda self, load: self.taken.clear()),
    "forgets what it passed": passes(forgets),
    "puts loads into boxes": passes(puts),
    "grows": each(lambda a, d, s, t: (a, d, 3.0 * s, t)),
    "goes round for ever": each(lambda a, d, s, t: (a, d, 1.0 if a == d else 0.0, t)),
    "face keeps all": face(pass_on=lambda self, load: None),
    "face takes nothing": face(take=lambda self, load: None),
}


class Mine(MaterialAgent):
    def take(self, load):
        load.magnitude *= 2.0


class Reads(MaterialAgent):
    def emissions(self, load):
        return (int(word) for word in ["x"])


class Sums(MaterialAgent):
    def step(self):
        self.much = sum(load.total for load in self.inbox)


class Yields(MaterialAgent):
    def shortening(self, axis):
        return self.wear


class Wall(kaju.RigidBoundaryAgent):
    def give_back(self, load, arm):
        return 1.0 / 0.0


class Face(FaceAgent):
    def due(self, asked):
        return {}["asked"]


@pytest.mark.parametrize(("own", "told", "note"), [
    ({"material_agent": Mine}, "load._replace.magnitude=", "take of Mine at cell (1, 2) in gener"),
    ({"material_agent": Reads}, "invalid literal", "pass_on of Reads at cell (1, 2) in gener"),
    (after_take(lambda self, load: self.taken["-y"]), "direction_names.index", "take of Mine"),
    (after_take(lambda self, load: load + load), "take load.total", "take of Mine at cell (1, 2)"),
    (each(lambda *row: 0.5 * kaju.Emission(*row)), "row._replace", "pass_on of Mine at cell"),
    ({"material_agent": Sums}, "'total'", "step of Sums at cell (1, 2) in generation 1; self.inb"),
    (ADDS, "tuple", f"{THERE}; [*super().emissions(load), row] adds a row"),
    (APPENDS, "append", f"{THERE}; [*super().emissions(load), row] adds a row"),
    (ASKS, "kept", f"{THERE}; agent_at of a cell that sleeps is None"),
    ({"material_agent": Yields}, "no attribute 'wear'", "shortening of Yields at cell (1, 2)"),
    ({"boundary_agents": {"rigid": Wall}}, "zero", "give_back of Wall at cell (1, -1) in gener"),
    ({"face_agent": Face}, "asked", "due of Face at the lower x face of cell (1, 2) in step"),
])  # fmt: skip
def test_an_error_of_an_agents_own_is_not_hidden_and_its_agent_named(own, told, note):
    with pytest.raises(Exception, match=told) as raised:
        run(own)
    (noted,) = raised.value.__notes__
    assert noted.startswith(f"in {note}")


@pytest.mark.parametrize("kind", UNBALANCED)
def test_what_does_not_balance_or_end_is_not_called_at_rest(kind, tmp_path):
    result = run(UNBALANCED[kind], max_generations=60)
    lost = "does not balance" in result.outcome
    assert lost or "stopped" in result.outcome
    assert not lost or "e+" not in result.outcome.partition("%")[0]
    again = kaju.load_result(result.save(tmp_path / "result.npz"))
    assert again.summary()["outcome"] == result.outcome
    assert again.own_agents in [("Mine",), ("Face",)]
    told = any("does not balance" in note for note in again.summary().get("notes", []))
    assert told or (not lost and again.checks()[0].holds)


def test_a_run_in_which_nobody_takes_any_more_says_so():
    def step(self):
        if self.model.generation < 3:
            MaterialAgent.step(self)

    told = run(material(step=step), max_generations=60).outcome
    assert told.endswith("way; in the last generation no agent took what waits for it")


def test_what_does_not_balance_in_every_step_is_told_once():
    books = scene().replace(loads=[{"cell": [1, 2], "force": [0.3, -2.0], "steps": 5}])
    notes = LoadModel(books, **UNBALANCED["books twice"]).run().notes
    (note,) = (note for note in notes if "does not balance" in note)
    assert note.startswith("in 5 of 5 steps, of which the worst ended after ")


@pytest.mark.parametrize("order", ["largest first", "multilevel"])
def test_faces_that_lose_loads_are_never_at_rest(order):
    lost = run(face(pass_on=lambda self, load: FaceAgent.pass_on(self, 0.5 * load)), order)
    assert "does not balance" in lost.outcome


@pytest.mark.parametrize("number", [nan, inf, -inf])
def test_what_could_not_be_read_again_is_not_saved(number, tmp_path):
    own = after_take(lambda self, load: setattr(self, "dropped", number))
    result = LoadModel(scene(), **own).run(progress=False)
    assert "at rest" not in result.last.outcome
    with pytest.raises(KajuError, match="save"):
        result.save(tmp_path / "result.npz")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("step", [
    lambda self: self.agents.shuffle_do("step"),
    lambda self: [LoadModel.step(self) for _ in "ab"],
])  # fmt: skip
def test_a_step_of_ones_own_gives_the_same_loads(step):
    model = type("Steps", (LoadModel,), {"step": step})
    usual, own = (kind(scene(), engine="agents", seed=3).run().last for kind in (LoadModel, model))
    assert own.outcome == usual.outcome
    assert own.ledger.taken == pytest.approx(usual.ledger.taken, rel=1e-12)
    assert own.ledger.imbalance < 1e-12
    assert sorted(own.cells.tolist()) == sorted(usual.cells.tolist())
