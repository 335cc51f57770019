"""Whose agents a page shows: their names, their source and their numbers."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Mapping
from typing import Any

from kaju.agents.parameter import Parameter, declared


def own_parts(model: Any) -> list[type | Callable[..., Any]]:
    """Return what of a model is one's own: classes of agents and boundaries, order, rule."""
    parts: list[Any] = []
    for own in model.arguments()[1].values():
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
            for name, parameter in declared(classes, Parameter).items()
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
