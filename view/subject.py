"""What pictures of load transfer have to look up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kaju.agents.rules import PrescribedRule

if TYPE_CHECKING:
    from kaju.model.propagation.transfer_result import TransferResult


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold
