"""Guards of agents of your own: classes before a run, and every answer of their hooks in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from dis import get_instructions as dis
from inspect import iscoroutinefunction, isgeneratorfunction, signature, unwrap
from itertools import islice, takewhile
from numbers import Integral
from types import CodeType, FunctionType
from typing import Any

from kaju.errors import AgentError, ParameterError, brief, no_such, require, takes

from .boundary_agent import BOUNDARIES, BoundaryAgent
from .face_agent import FaceAgent
from .material_agent import MaterialAgent, PlacedAgent
from .materials import Material
from .parameter import Declaration, State, declared, is_number
from .rules import PrescribedRule
from .shares import Load, Shares

HOOKS: dict[type, tuple[str, ...]] = {
    MaterialAgent: ("take", "emissions", "pass_on", "shortening", "step"),
    BoundaryAgent: ("give_back", "turn"),
    FaceAgent: ("due", "take", "pass_on"),
    PrescribedRule: ("shares",),
}
"""What a subclass may override, by its base; of a model its step."""
MEANT = {"emit": "emissions", "receive": "take"} | dict.fromkeys(("go", "tick", "advance"), "step")
"""What other frameworks call, and the hook that does the same."""
MOST_EMISSIONS = 1_000
"""An agent that sends out more for one load is taken to never end."""


# Classes, before a run.


def own_classes(material_agent: object, walls: Mapping[str, object] | None) -> tuple[type, ...]:
    """Return the classes of agents that a model is given; refuse what it cannot use."""
    check_class("material_agent", material_agent, MaterialAgent)
    rule = 'boundary_agents: must be a mapping such as {"rigid": MyWall}'
    require(isinstance(walls, Mapping | None), f"{rule}, got {brief(walls)}")
    for name, agent in (walls or {}).items():
        told = no_such(f"boundary {name!r}", name, BOUNDARIES)
        require(name in BOUNDARIES, f"boundary_agents: {told}")
        check_class(f"boundary_agents[{name!r}]", agent, BoundaryAgent)
    given: Any = (material_agent, *(walls or {}).values())
    return tuple(agent for agent in dict.fromkeys(given) if agent is not MaterialAgent)


def check_class(name: str, agent: object, base: type) -> None:
    """Refuse what is no class of agents, hooks with other arguments, and steps that take none."""
    if agent is base:
        return
    usual = BOUNDARIES["rigid"] if base is BoundaryAgent else base
    if not (isinstance(agent, type) and issubclass(agent, base)):
        cure = f"write `class Mine(kaju.{usual.__name__})` and give the class itself"
        if isinstance(agent, type) and hasattr(agent, "goes_into"):
            cure = f"it goes into {agent.goes_into.format(agent.__name__)}"
        needed = f"{name}: a subclass of {base.__name__} is needed, got {brief(agent)}"
        raise ParameterError(f"{needed}; {cure}")
    whose = f"{name}: {agent.__name__}"
    brought = check_methods(whose, agent, base, *BOUNDARIES.values())
    _check_names(name, agent, base, brought)
    behind = [
        one for one in agent.__mro__[agent.__mro__.index(base) :] if not issubclass(base, one)
    ]
    for one in (one for one in behind if not {*HOOKS[base]}.isdisjoint(vars(one))):
        told = f"{whose} names {one.__name__} last, so nothing of it is called; write class"
        raise ParameterError(f"{told} {agent.__name__}({one.__name__}, {usual.__name__})")
    own = {hook for hook in HOOKS[base] if isinstance(brought.get(hook), FunctionType)}
    for hook in own | {"__init__"}:
        function, start = getattr(agent, hook), tuple(signature(getattr(base, hook)).parameters)
        told = f"{whose}.{hook} takes {signature(function)}, but a model calls it with"
        cure = "; take *start and call super().__init__(*start) first" * (hook == "__init__")
        require(takes(function, *start), f"{told} ({', '.join(start)}){cure}")
        yields = hook != "emissions" and isgeneratorfunction(function)  # whose rows may be yielded
        told = f"{whose}.{hook} has a yield or is async, so calling it does nothing; take that out"
        require(not (yields or iscoroutinefunction(function)), told)
    told = f"{whose}.step never calls super().step(), so loads would wait for ever; call it,"
    names = _names_in(brought.get("step"))
    names = names.union(*(_names_in(brought[name]) for name in names & {*brought} - {"step"}))
    acts = "step" not in own or {"step", "inbox"} & names
    require(bool(acts), f"{told} or override take, emissions or pass_on instead")


def every_name(base: type) -> set[str]:
    """Return the names of a class's attributes, and those that its `__init__`s set."""
    starts = [vars(one).get("__init__") for one in base.__mro__]
    lines = [line for one in starts if isinstance(one, FunctionType) for line in dis(one)]
    return {*dir(base), *(line.argval for line in lines if line.opname == "STORE_ATTR")}


def _names_in(of: Any) -> set[Any]:
    """Return the names and texts in a function or a property, and in functions that it makes."""
    code = getattr(unwrap(getattr(of, "fget", getattr(of, "func", of))), "__code__", of)
    if isinstance(code, CodeType):
        return {*code.co_names}.union(*map(_names_in, code.co_consts))
    return {code} if isinstance(code, str) else set()


def _check_names(name: str, agent: type, base: type, brought: dict[str, Any]) -> None:
    """Refuse names that the base uses itself, and Parameters and States that get lost."""
    used, every = every_name(base), ((n, one) for o in agent.__mro__ for n, one in vars(o).items())
    kinds = {key: type(one).__name__ for key, one in every if isinstance(one, Declaration)}
    for key, value in brought.items():
        plain = not hasattr(value, "__get__") and hasattr(getattr(base, key, None), "__get__")
        hides = key in used if isinstance(value, Declaration) else plain
        told = f"{key}: {base.__name__} uses this name; take another in {agent.__name__}"
        require(not hides, told)
        kind, ends = kinds.get(key), "" if isinstance(value, bool) else ", low, high"
        cure = f"write {key} = kaju.{kind}({brief(value)}{ends * (kind == 'Parameter')})"
        told = f"{key}: {agent.__name__} makes it {brief(value)}, but its base makes it a {kind};"
        require(not kind or isinstance(value, Declaration), f"{told} {cure}, or take another name")
        bare = isinstance(value, type) and issubclass(value, Declaration)
        require(not bare, f"{key}: {agent.__name__} makes it a class; call it, as kaju.State(0.0)")
    declares = declared([agent], Declaration if base is FaceAgent else State)
    for key, one in declares.items() if base is not MaterialAgent else ():
        state = "a State is kept of material agents only" * isinstance(one, State)
        told = f"{name}: {state or 'ElasticModel takes no Parameter'}; let {agent.__name__} have"
        cure = f"a plain attribute, {key} = {one.default!r}, seen in model.agents"
        raise ParameterError(f"{told} {cure}")


def _near(name: str, known: Iterable[str], cutoff: float) -> list[str]:
    """Return the known name that is spelt much like `name`, or with the same letters, if any."""
    mixed = [one for one in known if one[0] == name[0] and sorted(one) == sorted(name)]
    return get_close_matches(name, known, n=1, cutoff=cutoff) or mixed


def check_methods(whose: str, kind: type, *bases: type) -> dict[str, Any]:
    """Return what a class has beyond bases of kaju's; refuse methods that nobody calls."""
    own = [*takewhile(lambda one: one not in bases, kind.__mro__)]
    brought = {key: value for one in reversed(own) for key, value in vars(one).items()}
    # Any method of a model may be called from elsewhere, but not one that was meant to be a step.
    words, hooks = (MEANT, HOOKS[bases[0]]) if bases[0] in HOOKS else ({}, ("step",))
    methods = {k for k, one in brought.items() if isinstance(one, FunctionType) and k[0] != "_"}
    usual = methods.isdisjoint(hooks)  # then a method that takes loads was meant to be one
    never = {"step", "advance"} - {*hooks}  # Mesa's; kaju calls steps of cells only
    for key in sorted(methods - (set(dir(bases[0])) - never)):
        bare = key.lower().removeprefix("on_").removeprefix("do_").removesuffix("_agent")
        lost = words and usual and "load" in " ".join(signature(brought[key]).parameters)
        near = _near(words.get(bare, bare), hooks, 0.81) if words or usual else []  # no intake
        meant = [f"did you mean {one!r}?" for one in near]
        meant += [f"should it be a {one.__name__}?" for one in HOOKS if words and key in HOOKS[one]]
        meant += [f"it calls {', '.join(hooks)}."] * bool(lost)
        called = any(key in _names_in(one) for name, one in brought.items() if name != key)
        told = f"{whose} has a method {key!r}, which kaju never calls; {''.join(meant[:1])} If the"
        require(called or not meant, f"{told} name is intended, begin it with _")
    return brought


# Answers, in a run.


class OwnAgents:
    """Checks what agents of your own answer."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self.names: dict[type, list[str]] = {}  # of attributes that agents of a class wake with

    def called(self, agent: PlacedAgent | FaceAgent) -> str:
        """Return how errors call an agent: its class, and where and when it acts."""
        if isinstance(agent, PlacedAgent):
            where = f"cell {agent.index} in generation {self.model.generation}"
        else:
            level, axis, index = agent.level, "xyz"[agent.place.axis], agent.place.index
            kind = f"block {index} of level {level}" if level else f"cell {index}"
            where = f"the lower {axis} face of {kind} in step {self.model.generation + 1}"
        return f"{type(agent).__name__} at {where}"

    def wrong(self, agent: PlacedAgent | FaceAgent, hook: str, what: str) -> AgentError:
        """Return the error of a wrong answer."""
        return AgentError(f"{hook}: {self.called(agent)} {what}")

    def check_begun(self, agent: PlacedAgent | FaceAgent, place: tuple[int, ...]) -> None:
        """Refuse an agent whose `__init__` has not called that of its base."""
        if not hasattr(agent, "spawn_step"):
            where = f"cell {place} in generation {self.model.generation}"
            told = f"{type(agent).__name__} at {where} must call super().__init__ with all of its"
            raise AgentError(f"__init__: {told} arguments")
        if type(agent) not in self.names:
            known = {*vars(agent), *declared([type(agent)], Declaration)}
            self.names[type(agent)] = sorted(n for n in known if n[0] != "_")
            for name in [name for name in vars(agent) if callable(getattr(type(agent), name, 0))]:
                raise self.wrong(agent, name, "has set a method of this name; take another name")
            self.check_books(agent)

    def check_books(self, agent: PlacedAgent | FaceAgent) -> None:
        """Refuse an agent whose books are not what results are made of."""
        for name in [name for name, one in vars(agent).items() if isinstance(one, Declaration)]:
            told = "sets a State or Parameter in a method, where it is none; declare it on a class"
            raise self.wrong(agent, name, told)
        books: dict[str, type] = dict.fromkeys(("taken", "pulled", "passed", "squeezed"), dict)
        books |= {"material": Material, "shares": Shares}
        for name, kind in books.items() if isinstance(agent, MaterialAgent) else ():
            if not isinstance(getattr(agent, name), kind):
                raise self.wrong(agent, name, f"has become {brief(getattr(agent, name))}")

    def check_names(self, agent: PlacedAgent | FaceAgent) -> None:
        """Refuse an attribute that an agent has set, and that is spelt much like another."""
        known = self.names[type(agent)]
        for name in sorted(n for n in {*vars(agent)} - {*known, *dir(type(agent))} if n[0] != "_"):
            for near in _near(name, known, 0.85):
                unset = near in {*declared([type(agent)], Declaration)} - {*vars(agent)}
                more = name.removeprefix(near)  # limits and limit2 are no slips of limit
                if more == name or (unset and more.isalpha() and more != "s"):
                    told = f"has this attribute; did you mean {near!r}? If not, begin it in"
                    raise self.wrong(agent, name, f"{told} __init__ or on the class")

    def emissions(self, agent: MaterialAgent, sent: Any) -> list[Any]:
        """Return the emissions that an agent answers; refuse anything else."""
        checked: list[Any] = []
        rows = sent if hasattr(sent, "__iter__") else [sent]
        for row in islice(rows, MOST_EMISSIONS + 1):  # what a generator raises is the agent's own
            try:
                arm, direction, share, sense = row
            except (TypeError, ValueError):
                told = f"returned {brief(sent)}: {brief(row)} is no row (arm, direction, share, "
                told += "sense); return a list of such rows, or [] to pass nothing on"
                raise self.wrong(agent, "emissions", told) from None
            parts = {"arm": arm, "direction": direction, "sense": sense, "share": share}
            self._check_fit(agent, "emissions", row, parts)
            checked.append((int(arm), int(direction), float(share), sense))  # True masks an array
        if len(checked) > MOST_EMISSIONS:
            raise self.wrong(agent, "emissions", f"returned more than {MOST_EMISSIONS} for a load")
        return checked

    def load(self, agent: PlacedAgent, hook: str, load: Any, arm: int) -> Load:
        """Return a load of an agent's own making; refuse anything else."""
        try:
            direction, magnitude, copies, sense = load
        except (TypeError, ValueError):
            told = "a kaju.Load is needed, such as load._replace(magnitude=0.5)"
            told += ", or None" * isinstance(agent, BoundaryAgent)
            raise self.wrong(agent, hook, f"hands over {brief(load)}; {told}") from None
        parts = {"direction": direction, "sense": sense, "magnitude": magnitude, "copies": copies}
        self._check_fit(agent, hook, load, {"arm": arm, **parts})
        return Load(int(direction), float(magnitude), float(copies), sense)

    def shortening(self, agent: MaterialAgent, axis: int) -> float:
        """Return how far an agent yields along an axis; refuse what is no number."""
        far = agent.shortening(axis)
        if not is_number(far):
            raise self.wrong(agent, "shortening", f"must return a finite number, got {brief(far)}")
        return float(far)

    def _check_fit(self, agent: PlacedAgent, hook: str, sent: Any, parts: dict[str, Any]) -> None:
        """Refuse what an agent sends if a part of it does not fit this body; say what does."""
        lattice, senses = self.model.lattice, self.model.engine.senses
        every = range(lattice.directions)  # a boundary, which has no form, may give back over any
        arms = lattice.arms[agent._form] if isinstance(agent, MaterialAgent) else every
        known = {"arm": arms, "direction": every, "sense": senses}
        fits = {n: isinstance(parts[n], Integral | str) and parts[n] in known[n] for n in known}
        sizes = [name for name in parts if name not in known]
        fits |= {name: is_number(parts[name]) and parts[name] >= 0.0 for name in sizes}
        if not (unfit := ", ".join(name for name in fits if not fits[name])):
            return
        does = "returned" if hook == "emissions" else "hands over"
        own = f"an arm of {arms}, " if isinstance(agent, MaterialAgent) else ""
        over = f" over arm {parts['arm']!r}" if own and hook != "emissions" else ""
        pull = "or 'pull'" if "pull" in senses else "('pull' needs sense = true in the rule)"
        told = f"{does} {brief(sent)}{over}; wrong: {unfit}; it must have {own}a direction from 0"
        told += f" to {every[-1]} ({', '.join(lattice.direction_names)}), "
        sized = f"a finite {' and '.join(sizes)} of at least 0, and the sense 'push' {pull}"
        raise self.wrong(agent, hook, told + sized)
