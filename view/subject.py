"""What a picture is about: cells, the fields on them, and the stage of loading they show.

Results differ in what they know. A run of load transfer is looked at where its agents are,
an elastic result on all cells that were solved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from kaju.agents.rules import PrescribedRule
from kaju.errors import ParameterError
from kaju.model.propagation.transfer_result import TransferResult

if TYPE_CHECKING:
    from kaju.model.elasticity.elastic_result import ElasticResult
    from kaju.model.network.network_result import NetworkResult
    from kaju.model.result import Result
    from kaju.model.scene import Scene
    from kaju.model.spawning.spawned_result import SpawnedResult

    from .section import Floats, Ints


def focus_of(result: Result) -> Ints | None:
    """Return the cells that a picture is about; None for all of the body."""
    if not isinstance(result, TransferResult):
        return None
    stage = result.last
    if len(stage.cells):
        return np.concatenate([stage.cells, stage.boundary_cells])
    return result.scene.applied().cells


def stage_number(result: Result) -> int | None:
    """Return the stage of loading that a result stands at, counted from 1; None: the last."""
    if isinstance(result, TransferResult):
        return len(result.stages)
    return result.stage if is_spawned(result) else _elastic(result).stage


def threshold_of(result: TransferResult) -> float:
    """Return γ (N)."""
    rule = result.scene.rule
    assert isinstance(rule, PrescribedRule)
    return rule.threshold


def is_network(result: object) -> TypeGuard[NetworkResult]:
    """Tell whether a result is that of a spring network."""
    if isinstance(result, TransferResult):
        return False
    from kaju.model.network.network_result import NetworkResult

    return isinstance(result, NetworkResult)


def is_spawned(result: object) -> TypeGuard[SpawnedResult]:
    """Tell whether a result is one of agents of many sizes."""
    if isinstance(result, TransferResult):
        return False
    from kaju.model.spawning.spawned_result import SpawnedResult

    return isinstance(result, SpawnedResult)


def grid_of(result: Result) -> Scene:
    """Return the scene on the cells that a result's fields belong to."""
    if isinstance(result, TransferResult):
        return result.scene
    return result.grid if is_spawned(result) else _elastic(result).grid


def cells_of(result: Result) -> Ints:
    """Return the cells that a result's fields belong to, in their order."""
    if isinstance(result, TransferResult):
        return result.last.cells
    elastic = _elastic(result)
    cells: Ints = np.argwhere(elastic.body) + np.asarray(elastic.origin)
    return cells


def field_of(result: Result, name: str) -> Floats:
    """Return "displacement", "strain", "stress" or "von_mises" of cells or agents, in order."""
    values: Floats
    if isinstance(result, TransferResult):
        values = getattr(result, name)
    elif is_spawned(result):
        values = getattr(result, "agent_displacement" if name == "displacement" else name)
    else:
        elastic = _elastic(result)
        own = "cell_displacement" if name == "displacement" else name
        values = getattr(elastic, own)[elastic.body]
    return values


def taken_of(result: Result) -> Floats:
    """Return the loads taken by direction (N), shape (agents, directions)."""
    assert isinstance(result, TransferResult)
    return result.last.taken


def _elastic(result: Result) -> ElasticResult:
    # The solver's modules are large; whoever has such a result has loaded them already.
    from kaju.model.elasticity.elastic_result import ElasticResult

    if not isinstance(result, ElasticResult):
        raise ParameterError(f"a {type(result).__name__} has no fields over cells to be drawn")
    return result
