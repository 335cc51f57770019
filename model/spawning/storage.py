"""Results of spawning in one file: the scene, the agents and their displacements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene import Scene

from .aims import Aimed, Answer
from .balance import Balance
from .composite import Composite
from .generations import Generation, Spawning
from .goals import told
from .ground import ground_of
from .indicator import indicate
from .leaves import Leaves

if TYPE_CHECKING:
    from .spawned_result import SpawnedResult

_HISTORY = ("code", "size", "load", "chosen")
_ARRAYS = ("lower", "size", "kind", "step", "cause")


def taken_apart(result: SpawnedResult) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return what is stored of a result: arrays, and plain values."""
    spawning, leaves = result.spawning, result.spawning.balance.grid.leaves
    arrays = {name: getattr(leaves, name) for name in _ARRAYS}
    arrays["displacement"] = spawning.displacement
    arrays["part"] = spawning.aimed.part
    for name in _HISTORY:
        arrays[f"history.{name}"] = np.concatenate(
            [getattr(generation, name) for generation in spawning.generations]
        )
    history = {
        name: getattr(spawning, name)
        for name in (
            "energy",
            "error",
            "residuals",
            "levels",
            "reached",
            "stopped",
            "notes",
            "retired",
        )
    }
    about = {
        "stage": result.stage,
        "tolerance": result.tolerance,
        "tolerance_at": told(result.tolerance_at),
        "resolution": result.resolution,
        "spawning": history,
        "aimed": [spawning.aimed.error, spawning.aimed.allowed],
        "answers": [[a.value.tolist(), *a[1:]] for a in spawning.aimed.answers],
        "generations": [list(g[:5]) for g in spawning.generations],
    }
    return arrays, about


def spawning_of(scene: Scene, arrays: dict[str, NDArray[Any]], about: dict[str, Any]) -> Spawning:
    """Return what was taken apart; all that follows from the agents is worked out again."""
    ground = ground_of(scene, about["stage"], about["resolution"])
    leaves = Leaves.of(*(arrays[name] for name in _ARRAYS))
    balance = Balance(Composite(ground, leaves))
    u = arrays["displacement"]
    ends = np.cumsum([entry[0] for entry in about["generations"]])[:-1]
    parts = [np.split(arrays[f"history.{name}"], ends) for name in _HISTORY]
    generations = [
        Generation(*entry, *part) for entry, *part in zip(about["generations"], *parts, strict=True)
    ]
    error, allowed = about["aimed"]
    answers = tuple(Answer(np.array(value), *rest) for value, *rest in about["answers"])
    nobody = np.zeros(len(leaves), dtype=np.bool_)
    return Spawning(
        balance,
        u,
        indicate(balance, u),
        aimed=Aimed(error, arrays["part"], nobody, allowed, answers),
        generations=generations,
        **about["spawning"],
    )
