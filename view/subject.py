"""What pictures have to look up, and what may be said about them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from kaju.agents.materials import suggestion
from kaju.agents.rules import PrescribedRule
from kaju.errors import ParameterError

if TYPE_CHECKING:
    from kaju.model.propagation.transfer_result import TransferResult


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold


def check_options(name: str, draw: Callable[..., Any], options: Mapping[str, object]) -> None:
    """Refuse options that a picture or a film does not have.

    Raises
    ------
    ParameterError
        If there is one, with those that there are.
    """
    (_, *rest) = inspect.signature(draw).parameters.values()
    known = [each.name for each in rest if each.name not in ("ax", "what")]
    if inspect.Parameter.VAR_KEYWORD in {each.kind for each in rest}:
        return
    for option in options:
        if option not in known:
            raise ParameterError(
                f"{option}: {name!r} has no such option{suggestion(option, known)}; "
                f"it has {', '.join(known) or 'none'}"
            )
