"""Whose agents a page shows: their names, their source, and which controls act on them."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.agents.parameter import declared
from kaju.agents.rules import Coefficients, PrescribedRule
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel

PATIENCE = 2.0
"""Seconds of the processor to try controls in; those that were not tried are shown."""
_TRIED = 40  # generations, beyond which a control may go unnoticed


def own_parts(model: Any) -> list[type | Callable[..., Any]]:
    """Return what of a model is one's own: classes of agents and boundaries, order, rule."""
    parts: list[Any] = []
    for own in model.checkpoint_options()[1].values():
        parts += list(own.values()) if isinstance(own, Mapping) else [own]
    chosen = (part for part in parts if part is not None)
    named = [part if hasattr(part, "__name__") else type(part) for part in chosen]
    return list(dict.fromkeys(named))


def own_data(model: Any) -> dict[str, Any]:
    """Return names, source and parameters of agents of one's own; empty without any."""
    parts = own_parts(model)
    if not parts:
        return {}
    values = getattr(model, "parameters", {})
    classes = [part for part in parts if isinstance(part, type)]
    own = {
        "names": [part.__name__ for part in parts],
        "source": "\n\n".join(map(_source, parts)),
        "parameters": [
            {
                "name": name,
                "label": parameter.text or name,
                "low": parameter.low,
                "high": parameter.high,
                "whole": parameter.whole,
                "value": values[name],
            }
            for name, parameter in declared(classes).items()
            if name in values
        ],
    }
    return {"own": own}


def _source(part: type | Callable[..., Any]) -> str:
    """Return the source of a class or function, or why there is none."""
    try:
        return textwrap.dedent(inspect.getsource(part)).rstrip()
    except (OSError, TypeError):
        return f"# the source of {part.__name__} is not at hand"


def acting_controls(model: LoadModel) -> list[str]:
    """Return the controls of the rule that change what a model's agents do.

    They are found by trying: the model is begun anew with each number changed a little, and what
    its agents take, keep, pass on and yield by is compared.
    """
    began = process_time()
    usual = _outcome(model, model.scene)
    found = []
    for name, scene in _changed(model.scene):
        tried = process_time() - began <= PATIENCE
        if not (tried and _same(_outcome(model, scene), usual)):
            found.append(name)
    return found


def _changed(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """Yield the name of every control, and the scene with its number changed."""
    rule = scene.rule
    assert isinstance(rule, PrescribedRule)
    usual = rule.alpha_in(scene.lattice.dimension)

    def with_rule(changes_of: Callable[[Coefficients], dict[str, Any]]) -> Scene:
        own = {name: replace(of, **changes_of(of)) for name, of in rule.materials.items()}
        return scene.replace(rule=replace(rule, **changes_of(rule), materials=own))

    def less(value: float) -> float:
        return 0.9 * value or 0.1

    for number in range(3):

        def with_share(of: Coefficients, number: int = number) -> dict[str, Any]:
            shares = list(of.alpha or usual)
            shares[number] = less(shares[number])
            return {"alpha": tuple(shares)}

        yield f"alpha{number + 1}", with_rule(with_share)
    yield "beta", with_rule(lambda of: {"beta": less(of.beta)})
    for name, key in (("nu", "poissons_ratio"), ("modulus", "youngs_modulus")):
        changed = {}
        for material in scene.cell_materials:
            new: dict[str, Any] = {key: less(getattr(material, key))}
            changed[material.name] = replace(material, **new)
        yield name, scene.replace(materials=changed)
    for name, change in (
        ("gamma", {"threshold": 0.5 * rule.threshold}),
        ("accumulate", {"accumulate": not rule.accumulate}),
        ("sense", {"sense": not rule.sense}),
    ):
        yield name, scene.replace(rule=replace(rule, **change))


def _outcome(model: LoadModel, scene: Scene) -> list[NDArray[Any]] | None:
    """Return what agents did in a number of generations; None if they failed."""
    tried = model.again(scene)
    try:
        tried.run(until=lambda model: model.generation >= _TRIED)
    except Exception:  # of agents that somebody wrote
        return None
    done = tried.totals
    return [done.cells, done.kept, done.passed, done.dropped, done.shortened, done.widened]


def _same(one: list[NDArray[Any]] | None, other: list[NDArray[Any]] | None) -> bool:
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
