"""What the page is told of a scene and of a run, as README.md beside this file describes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rules import PrescribedRule
from kaju.errors import SceneError
from kaju.model.scene.applied import BY_SIDE, BY_SURFACE, PULL, PUSH

if TYPE_CHECKING:
    from kaju.agents.rules import Coefficients
    from kaju.model.propagation.stage import Stage
    from kaju.model.scene import Scene
    from kaju.model.scene.sides import SideCondition

_SENSES = {PUSH: "push", PULL: "pull", BY_SIDE: "side", BY_SURFACE: "surface"}
Columns = dict[str, NDArray[Any]]

MOST_CELLS = 1_000_000
"""A page holds every cell of the array, so larger ones are refused."""


def scene_data(scene: Scene) -> tuple[dict[str, Any], Columns]:
    """Return the scene as plain data, and its cells as a column.

    Raises
    ------
    SceneError
        If the array has more than a million cells.
    """
    lattice = scene.lattice
    if lattice.size > MOST_CELLS:
        raise SceneError(
            f"body: {lattice.size:.3g} cells are more than a page holds ({MOST_CELLS:,}); "
            "take larger cells"
        )
    data = {
        "lattice": {
            "kind": lattice.kind,
            "shape": list(lattice.shape),
            "cell_size": lattice.cell_size,
        },
        "thickness": scene.thickness,
        "plane": scene.plane,
        "materials": [
            {
                "name": material.name,
                "youngs_modulus": material.youngs_modulus,
                "poissons_ratio": material.poissons_ratio,
                "density": material.density,
            }
            for material in scene.cell_materials
        ],
        "sides": {side: _side(scene.side_condition(side)) for side in lattice.sides},
        "rule": _rule(scene),
        "stages": scene.stages,
        "loads": _loads(scene),
    }
    return data, {"cells": scene.rasterise().astype(np.int8)}


def _side(condition: SideCondition) -> str | dict[str, Any]:
    """Return a side as a scene file writes it."""
    if condition.stiffness is not None:
        return {"stiffness": condition.stiffness}
    if condition.displacement is not None:
        return {"displacement": list(condition.displacement)}
    return condition.kind


def _rule(scene: Scene) -> dict[str, Any]:
    rule = scene.rule
    if not isinstance(rule, PrescribedRule):
        return {"kind": rule.kind}
    return {
        "kind": rule.kind,
        **_coefficients(rule),
        "threshold": rule.threshold,
        "accumulate": rule.accumulate,
        "sense": rule.sense,
        "materials": {name: _coefficients(own) for name, own in rule.materials.items()},
    }


def _coefficients(given: Coefficients) -> dict[str, Any]:
    return {"alpha": list(given.alpha) if given.alpha else None, "beta": given.beta}


def _loads(scene: Scene) -> list[dict[str, Any]]:
    """Return the loads on single cells, each with the number of its steps.

    A load grows by equal steps, so its full force over that of the first stage counts them.
    """
    full, first = scene.applied(), scene.applied(1).force
    rows = np.arange(len(full.force))
    largest = np.abs(full.force).argmax(axis=1) if len(rows) else rows
    whole, part = full.force[rows, largest], first[rows, largest]
    steps = np.divide(whole, part, out=np.ones(len(rows)), where=part != 0.0)
    assert full.sense is not None
    columns = (full.cells, full.force, full.direction, np.rint(steps).astype(int), full.sense)
    return [
        {"cell": cell, "force": force, "face": face, "steps": number, "sense": _SENSES[sense]}
        for cell, force, face, number, sense in zip(*(c.tolist() for c in columns), strict=True)
    ]


@dataclass(frozen=True)
class Rows:
    """Loads taken, ready to be sent: one row a generation, cell and channel.

    Attributes
    ----------
    generation, state : arrays of int
        When, and the cell's key times the number of channels, plus the channel.
    load : array of float
        Newtons.
    """

    generation: NDArray[np.int64]
    state: NDArray[np.int64]
    load: NDArray[np.float64]

    def columns(self, first: int, last: int, exact: bool = False) -> Columns:
        """Return the history's columns for the generations `first` to `last`."""
        order = np.lexsort((self.state, self.generation))
        generation, state = self.generation[order], self.state[order]
        offset = np.searchsorted(generation, np.arange(first, last + 2))
        delta = np.diff(state, prepend=0)
        starts = offset[:-1][offset[:-1] < offset[1:]]
        delta[starts] = state[starts]
        return {
            "offset": offset.astype(np.uint32),
            "delta": delta.astype(np.uint32),
            "load": self.load[order].astype(np.float64 if exact else np.float32),
        }


def history_columns(scene: Scene, stage: Stage, exact: bool = False) -> Columns:
    """Return all that a recorded page needs of a stage of loading.

    Parameters
    ----------
    scene : Scene
        What was asked.
    stage : Stage
        What its agents took, passed on and let end.
    exact : bool
        Loads as 64-bit numbers; a quarter larger.
    """
    lattice, history = scene.lattice, stage.history
    key = lattice.key(stage.cells)
    sense = isinstance(scene.rule, PrescribedRule) and scene.rule.sense
    states = lattice.directions * (2 if sense else 1)
    state = history.direction + lattice.directions * history.pull
    rows = Rows(history.generation, key[history.agent] * states + state, history.load)
    real = np.float64 if exact else np.float32
    return {
        **rows.columns(1, stage.generations, exact),
        "key": key.astype(np.uint32),
        "spawn": stage.spawn_step.astype(np.uint32),
        "woken": stage.woken_by.astype(np.uint8),
        "passed": stage.passed.astype(real),
        "dropped": stage.dropped.astype(real),
        "returned": _given_back(scene, stage, key).astype(real),
    }


def _given_back(scene: Scene, stage: Stage, key: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return what boundaries gave back to each agent (N).

    Loads one by one are handed over only above the threshold, so what went to a boundary came
    back; where they are added up a boundary may have let some end, and the shares of its
    agents are not told apart: then NaN.
    """
    lattice = scene.lattice
    sent = np.zeros(len(key))
    for arm in range(lattice.directions):
        outside = scene.kinds(lattice.neighbours(stage.cells, arm)) < 0
        sent[outside] += stage.passed[outside, arm]
    some_ended = not np.isclose(sent.sum(), stage.returned.sum(), rtol=1e-12)
    return np.full(len(key), np.nan) if some_ended else sent
