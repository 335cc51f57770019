"""What a picture is about: the cells to look at, and the stage of loading they show.

Results differ in what they know. Whatever has `stages` of agents is looked at where these
are; any other result where it is loaded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaju.agents.rules import PrescribedRule
from kaju.errors import ResultError
from kaju.model.propagation.transfer_result import TransferResult

if TYPE_CHECKING:
    from .section import Floats, Ints


def focus_of(result: object) -> Ints | None:
    """Return the cells that a picture is about; None for all of the body."""
    if not isinstance(result, TransferResult):
        return None
    stage = result.last
    if len(stage.cells):
        return np.concatenate([stage.cells, stage.boundary_cells])
    return result.scene.applied().cells


def stage_number(result: object) -> int | None:
    """Return the stage of loading that a result stands at, counted from 1; None: the last."""
    return len(result.stages) if isinstance(result, TransferResult) else None


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold


def cells_of(result: object) -> Ints:
    """Return the cells that a result's fields belong to, in their order."""
    cells: Ints = result.last.cells if isinstance(result, TransferResult) else result.cells  # type: ignore[attr-defined]
    return cells


def taken_of(result: object) -> Floats:
    """Return the loads taken by direction (N), shape (agents, directions).

    Raises
    ------
    ResultError
        If the result knows no agents that take loads.
    """
    if not isinstance(result, TransferResult):
        raise ResultError(
            f"taken: a {type(result).__name__} has no loads taken; it is no run of load transfer"
        )
    return result.last.taken
