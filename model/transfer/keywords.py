"""Arguments of `LoadModel` besides the scene: numbers of the rule, parameters, own classes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from inspect import Parameter as Argument
from inspect import signature
from types import FunctionType
from typing import Any

from kaju.agents.boundary_agent import BoundaryAgent
from kaju.agents.material_agent import MaterialAgent
from kaju.agents.materials import suggestion
from kaju.agents.parameter import Parameter as ParameterOfAgents
from kaju.agents.parameter import declared
from kaju.errors import ParameterError
from kaju.model.scene import Scene
from kaju.model.scene.description import TABLES

from .agent_engine import BOUNDARY_AGENTS

AGENTS_START = ("model", "cell", "material", "shares")
BOUNDARIES_START = ("model", "cell")
"""What a model makes its agents of."""


def own_classes(
    material_agent: object, boundary_agents: Mapping[str, object] | None
) -> tuple[type, ...]:
    """Return the classes of agents of one's own."""
    _check_class("material_agent", material_agent, MaterialAgent, AGENTS_START)
    if not isinstance(boundary_agents, Mapping | None):
        raise ParameterError(
            'boundary_agents: must be a mapping such as {"rigid": MyWall}, got '
            f"{boundary_agents!r:.80}"
        )
    names = [each.name for each in BOUNDARY_AGENTS.values()]
    for name, agent in (boundary_agents or {}).items():
        if name not in names:
            raise ParameterError(
                f"boundary_agents: there is no boundary {name!r}{suggestion(str(name), names)}; "
                f"there is {', '.join(names)}"
            )
        _check_class(f"boundary_agents[{name!r}]", agent, BoundaryAgent, BOUNDARIES_START)
    return tuple(dict.fromkeys([material_agent, *(boundary_agents or {}).values()]))  # type: ignore[list-item]


OF_MESA = {"model", "rng", "seed", "scenario_id", "replication_id"}
"""What a Scenario of Mesa's holds besides the numbers of a model."""


def numbers_of(scenario: Any) -> dict[str, Any]:
    """Return the numbers that a Scenario of Mesa's gives a model."""
    if scenario is None:
        return {}
    held = scenario.to_dict() if hasattr(scenario, "to_dict") else vars(scenario)
    return {n: value for n, value in held.items() if n not in OF_MESA and not n.startswith("_")}


def keywords_into(
    scene: Scene, classes: Iterable[type], given: Mapping[str, Any], model: type, own_rule: bool
) -> tuple[Scene, dict[str, Any]]:
    """Return the scene with numbers of its rule replaced, and the agents' parameters.

    Parameters belong to own `classes` of agents, and none may be called as an argument of `model`
    is; with `own_rule` another rule stands in for the scene's.
    """
    parameters = declared(classes, ParameterOfAgents)
    rule = {field.name for field in fields(scene.rule)}
    own = set(signature(model.__init__).parameters) | {"kind"}  # type: ignore[misc]
    for name in parameters.keys() & (rule | own):
        whose = "the rule" if name in rule else model.__name__
        raise ParameterError(
            f"{name}: {whose} has a number of this name already; call the parameter otherwise"
        )
    for name in given.keys() - parameters.keys() - rule:
        known = sorted({*parameters, *rule, *own} - {"self", "kind", "kwargs"})
        raise ParameterError(
            f"{name}: {model.__name__} has no such argument{suggestion(name, known)}; there is "
            f"{', '.join(known)}"
        )
    values = {
        name: each.checked(given.get(name, each.default)) for name, each in parameters.items()
    }
    changed = {name: value for name, value in given.items() if name in rule}
    if changed and own_rule:
        raise ParameterError(
            f"{next(iter(changed))}: is a number of the scene's rule, and rule= brings another; "
            "give one of them"
        )
    if changed:
        # Checked as the numbers of a scene's file are; materials have no place there.
        numbers = {name: value for name, value in changed.items() if name != "materials"}
        table = TABLES[scene.rule.kind](**numbers)
        changed |= {name: getattr(table, name) for name in numbers}
        scene = scene.replace(rule=replace(scene.rule, **changed))
    return scene, values


HOOKS = {
    MaterialAgent: ("take", "emissions", "pass_on", "shortening", "step"),
    BoundaryAgent: ("give_back", "turn"),
}
"""What a subclass may override, by its base."""


def _check_hooks(name: str, agent: type, base: type) -> None:
    """Refuse a method that is nearly called as a hook, and a `step` in which nothing is taken."""
    own = {
        key: value
        for each in agent.__mro__[: agent.__mro__.index(base)]
        for key, value in vars(each).items()
        if not key.startswith("_") and isinstance(value, FunctionType)
    }
    for key in own.keys() - set(dir(base)):
        near = get_close_matches(key, HOOKS[base], n=1, cutoff=0.8)
        if near:
            raise ParameterError(
                f"{name}: {agent.__name__} has a method {key!r}, which nobody calls; did you mean "
                f"{near[0]!r}? A method of your own that is meant begins with _"
            )
    step = own.get("step")
    if step is not None and not {"step", "take", "pass_on"} & set(step.__code__.co_names):
        raise ParameterError(
            f"{name}: {agent.__name__}.step never calls super().step(), so its agents would take "
            "no load; call it, or override take, emissions or pass_on instead"
        )


def _check_class(name: str, agent: object, base: type, start: tuple[str, ...]) -> None:
    """Refuse what is no class of agents, or one that a model cannot make of its `start`."""
    if not (isinstance(agent, type) and issubclass(agent, base)):
        raise ParameterError(
            f"{name}: a subclass of {base.__name__} is needed, got {agent!r:.80}; write "
            f"`class Mine({base.__name__})` and give the class itself"
        )
    _check_hooks(name, agent, base)
    every = list(signature(agent).parameters.values())
    rest = any(argument.kind is Argument.VAR_POSITIONAL for argument in every)
    places = [a for a in every if a.kind in (a.POSITIONAL_ONLY, a.POSITIONAL_OR_KEYWORD)]
    needed = sum(a.default is Argument.empty for a in places)
    alone = [
        a.name for a in every if a.kind is Argument.KEYWORD_ONLY and a.default is Argument.empty
    ]
    if alone or needed > len(start) or not (rest or len(places) >= len(start)):
        raise ParameterError(
            f"{name}: {agent.__name__}.__init__ takes ({', '.join(map(str, every))}), but a model "
            f"makes its agents of ({', '.join(start)}); take *start and call "
            "super().__init__(*start) first"
        )
