"""What models that step have in common, with Mesa or without: which agents act, when to stop."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from numbers import Integral
from typing import Any, Protocol, TypeVar

from kaju.errors import ParameterError
from kaju.stopping import Answer, interrupt_requested, interruptible

A = TypeVar("A")

Order = Callable[[list[A]], Iterable[A]]
"""Of the agents for which loads wait, those that act in this step, one after another."""
Until = Callable[[Any], bool] | int
"""A question about the model, asked before every step: whether to stop. Or a number of steps."""


class Steps(Protocol):
    """A model that steps."""

    running: bool

    def step(self) -> None:
        """Take one step."""


def chosen(order: Order[A], waiting: list[A]) -> list[A]:
    """Return the agents that an order of your own lets act, each once."""
    most = 10 * len(waiting) + 10  # an order may name an agent twice, but must come to an end
    answer = order(list(waiting))
    try:
        named = list(islice(answer, most))
        acting = list(dict.fromkeys(named))
        right = len(acting) > 0 and set(acting) <= set(waiting) and len(named) < most
    except TypeError:
        acting, right = [], False
    if not right:
        raise ParameterError(
            f"order: must return at least one of the {len(waiting)} agents that it gets, and no "
            f"others; it returned {len(acting)} ({answer!r:.60})"
        )
    return acting


def takes_objects(engine: str, agent: type, usual: type, small: bool) -> bool:
    """Tell whether agents are to be objects: asked for, of your own class, or few ("auto")."""
    own_class = agent is not usual
    if engine not in ("auto", "agents", "arrays"):
        raise ParameterError(f"engine: 'auto', 'agents' or 'arrays', got {engine!r}")
    if engine == "arrays" and own_class:
        raise ParameterError(
            f"engine: 'arrays' knows no {getattr(agent, '__name__', agent)}; "
            "agents of your own are objects, so take 'auto' or 'agents'"
        )
    return engine == "agents" or (engine == "auto" and (small or own_class))


def step_to_end(
    model: Steps,
    until: Until | None,
    result: Callable[[], Answer],
    after: Callable[[], None] | None = None,
) -> Answer:
    """Step until the end, so many times, or until a yes, `after` each; return what there is."""
    whole = isinstance(until, Integral) and not isinstance(until, bool) and until > 0
    if not (until is None or callable(until) or whole):
        raise ParameterError(
            f"until: a function of the model, or a number of steps, is needed, got {until!r}"
        )
    left = int(until) if isinstance(until, Integral) else None

    def steps() -> Answer:
        nonlocal left
        while model.running and left != 0 and not (callable(until) and until(model)):
            model.step()
            left = None if left is None else left - 1
            if after is not None:
                after()
            if interrupt_requested():
                break
        return result()

    return interruptible(steps)
