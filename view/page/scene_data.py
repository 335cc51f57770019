"""A scene and a run as a page reads them, as README.md beside this file describes it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rules import Coefficients, PrescribedRule
from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.scene import Scene
from kaju.model.scene.lattices import BUILT_IN
from kaju.model.scene.selection import BY_SIDE, BY_SURFACE, PULL, PUSH
from kaju.model.scene.sides import SideCondition
from kaju.model.transfer.deformation import axial_strain
from kaju.model.transfer.stage import Stage, Totals
from kaju.model.transfer.transfer import Transfer

_SENSES = {PUSH: "push", PULL: "pull", BY_SIDE: "side", BY_SURFACE: "surface"}
Columns = dict[str, NDArray[Any]]

FORMAT = 1
"""Version of the data in pages."""
MOST_CELLS = 1_000_000
"""A page holds every cell of the array, so larger ones are refused."""


def scene_data(scene: Scene) -> tuple[dict[str, Any], Columns]:
    """Return the scene as plain data, and its cells as a column."""
    lattice = scene.lattice
    if lattice.kind not in BUILT_IN:
        raise SceneError(
            f"body.lattice: a page runs no {lattice.kind}s, which it does not know; export_page of "
            "their scene or result shows what their agents did"
        )
    if lattice.size > MOST_CELLS:
        raise SceneError(
            f"body: {lattice.size:.3g} cells are more than a page holds ({MOST_CELLS:,}); "
            "take larger cells"
        )
    told = ("name", "youngs_modulus", "poissons_ratio", "density")
    shape = {"kind": lattice.kind, "shape": list(lattice.shape), "cell_size": lattice.cell_size}
    data = {
        "lattice": shape,
        "thickness": scene.thickness,
        "plane": scene.plane,
        "materials": [{key: getattr(m, key) for key in told} for m in scene.cell_materials],
        "sides": {side: _side(scene.side_condition(side)) for side in lattice.sides},
        "rule": _rule(scene),
        "stages": scene.stages,
        "loads": _loads(scene),
    }
    return data, {"cells": scene.rasterise()}


def _side(condition: SideCondition) -> str | dict[str, Any]:
    """Return a side as a scene file has it."""
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
    """Return loads on single cells with their steps: the full force over the first stage's."""
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


def _amounts(rows: tuple[Ints, Ints, Floats], last: int, exact: bool, name: str = "") -> Columns:
    """Return the history's columns up to the last generation of rows: generation, place, amount.

    One row a generation and place: of loads taken the cell's key times the number of channels,
    plus the channel; of what agents did with them see `Account`. Amounts are newtons, of
    elongations metres.
    """
    generation, place, amount = rows
    order = np.lexsort((place, generation))
    generation, place = generation[order], place[order]
    offset = np.searchsorted(generation, np.arange(1, last + 2))
    # Places are stored as steps from the one before, but for the first of each generation.
    delta = np.diff(place, prepend=0)
    starts = offset[:-1][offset[:-1] < offset[1:]]
    delta[starts] = place[starts]
    return {
        f"{name}offset": offset.astype(np.uint32),
        f"{name}delta": delta.astype(np.uint32),
        f"{name}load": amount[order].astype(np.float64 if exact else np.float32),
    }


class Account:
    """What agents did with the loads they took, noted generation by generation.

    What each passed on, by arm; what it let end; what boundaries gave back to it; and, of agents or
    a rule of your own, what it kept along each axis of the lattice and by how much it lengthened
    along it. The place of a row is the cell's key times the number of these, plus its number.
    """

    def __init__(self, scene: Scene, own: bool) -> None:
        self.scene, self.own = scene, own
        self.key: Ints = np.empty(0, dtype=np.int64)
        self._outside = np.empty((0, scene.lattice.directions), dtype=np.bool_)
        self._last: dict[str, Floats] = {}
        self._rows: dict[str, list[tuple[Ints, Ints, Floats]]] = {}
        self._returns = True

    def note(self, generation: int, totals: Totals | Stage, returned: float) -> None:
        """Note what was done since the last time, when boundaries have returned so much (N)."""
        lattice = self.scene.lattice
        new = totals.cells[len(self.key) :]
        self.key = np.append(self.key, lattice.key(new))
        arms = range(lattice.directions)
        beyond = [self.scene.kinds(lattice.neighbours(new, arm)) < 0 for arm in arms]
        self._outside = np.concatenate([self._outside, np.stack(beyond, axis=1)])
        for name, now in self._sums(totals, returned).items():
            change = now.copy()
            if name in self._last:
                change[: len(self._last[name])] -= self._last[name]
            self._last[name] = now.copy()
            row, column = np.nonzero(change)
            place = self.key[row] * now.shape[1] + column
            when = np.full(len(row), generation)
            self._rows.setdefault(name, []).append((when, place, change[row, column]))

    def _sums(self, totals: Totals | Stage, returned: float) -> dict[str, Floats]:
        """Return all sums so far, one row an agent.

        Loads one by one are handed over only above the threshold, so what went to a boundary
        came back; where they are added up, or boundaries are one's own, some may have ended
        there, and the shares of the agents cannot be separated: from then on they are left out.
        """
        found = {"passed": totals.passed, "dropped": totals.dropped[:, None]}
        sent = np.where(self._outside, totals.passed, 0.0).sum(axis=1, keepdims=True)
        self._returns &= bool(np.isclose(sent.sum(), returned, rtol=1e-12))
        if self._returns:
            found["returned"] = sent
        if self.own:
            axes = range(len(self.scene.lattice.axes))
            squeezed = axial_strain(self.scene, totals)
            found["kept"] = totals.kept
            found["stretch"] = np.stack([squeezed.elongation(axis) for axis in axes], axis=1)
        return found

    def columns(self, last: int, exact: bool) -> Columns:
        """Return the history's columns up to the last generation."""
        columns: Columns = {}
        names = ["passed", "dropped"]
        names += ["returned"] * self._returns + ["kept", "stretch"] * self.own
        none = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0)
        for name in names:
            every = zip(none, *self._rows.get(name, []), strict=True)
            when, place, amount = map(np.concatenate, every)
            columns |= _amounts((when, place, amount), last, exact, f"{name} ")
        return columns


def history_columns(
    scene: Scene, stage: Stage, exact: bool = False, account: Account | None = None
) -> Columns:
    """Return what a recorded page needs of a stage, by generation as far as an account tells."""
    lattice, history = scene.lattice, stage.history
    key = lattice.key(stage.cells)
    sense = isinstance(scene.rule, PrescribedRule) and scene.rule.sense
    states = lattice.directions * (2 if sense else 1)
    state = history.direction + lattice.directions * history.pull
    place, last = key[history.agent] * states + state, stage.generations
    if account is None:
        account = Account(scene, not _by_shares(scene, stage))
        account.note(stage.generations, stage, float(stage.returned.sum()))
    return {
        **_amounts((history.generation, place, history.load), last, exact),
        "key": key.astype(np.uint32),
        "spawn": stage.spawn_step.astype(np.uint32),
        "woken": stage.woken_by.astype(np.uint8),
        **account.columns(last, exact),
        **_state_columns(stage, key, exact),
    }


def _state_columns(stage: Stage, key: Ints, exact: bool) -> Columns:
    """Return what agents of one's own knew: from waking on the default, then what changed it."""
    columns: Columns = {}
    for course in stage.states:
        agent = np.append(np.arange(len(key)), course.agent)
        when = np.maximum(np.append(stage.spawn_step, course.generation), 1)
        value = np.append(np.full(len(key), float(course.default)), course.value)
        order = np.argsort(agent, kind="stable")
        agent, when, value = agent[order], when[order], value[order]
        change = np.where(np.diff(agent, prepend=-1) != 0, value, np.diff(value, prepend=0.0))
        name = f"state {course.name} "
        columns |= _amounts((when, key[agent], change), stage.generations, exact, name)
    return columns


def _by_shares(scene: Scene, stage: Stage) -> bool:
    """Tell whether agents kept, and yielded by, what the scene's rule says."""
    transfer = Transfer(scene)
    taken = stage.taken
    if transfer.rule.sense:
        taken = np.concatenate([taken - stage.pulled, stage.pulled], axis=1)
    kept = transfer.kept(stage.material, taken)
    modulus = np.array([material.youngs_modulus for material in transfer.materials])
    shortened = kept / (transfer.cross_section * modulus[stage.material, None])
    pairs = ((stage.kept, kept), (stage.shortened, shortened))
    return all(np.allclose(a, b, 1e-9, 1e-12 * np.abs(b).max(initial=0.0)) for a, b in pairs)
