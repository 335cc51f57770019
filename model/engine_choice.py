"""Objects or arrays, and who acts: what the models of agents choose."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from kaju.errors import ParameterError

A = TypeVar("A")

Order = Callable[[list[A]], Iterable[A]]
"""Of the agents for which loads wait, those that act in this step, one after another."""


def chosen(order: Order[A], waiting: list[A]) -> list[A]:
    """Return whom an order of one's own lets act, each once.

    Raises
    ------
    ParameterError
        If it chooses nobody, or others than it was given.
    """
    acting = list(dict.fromkeys(order(list(waiting))))
    if not acting or not set(acting) <= set(waiting):
        raise ParameterError(
            f"order: must choose at least one of the {len(waiting)} agents that it is given, "
            f"and no others; it chose {len(acting)}"
        )
    return acting


def takes_objects(engine: str, agent: type, usual: type, small: bool) -> bool:
    """Tell whether agents are to be objects.

    Parameters
    ----------
    engine : {"auto", "agents", "arrays"}
        What was asked for.
    agent, usual : type
        Class of the agents, and the one that arrays know.
    small : bool
        Whether "auto" can afford objects.

    Raises
    ------
    ParameterError
        If there is no such engine, or arrays are to run agents of one's own.
    """
    own_class = agent is not usual
    if engine not in ("auto", "agents", "arrays"):
        raise ParameterError(f"engine: 'auto', 'agents' or 'arrays', got {engine!r}")
    if engine == "arrays" and own_class:
        raise ParameterError(
            f"engine: 'arrays' knows no {getattr(agent, '__name__', agent)}; "
            "agents of your own are objects, so take 'auto' or 'agents'"
        )
    return engine == "agents" or (engine == "auto" and (small or own_class))
