"""What a page reads: scenes, runs and what moves, as README.md beside this file describes it."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError, SceneError
from kaju.model.results.result import Curves, Result, solved_scene
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, HOLDING
from kaju.model.scene.curves import flattened
from kaju.model.scene.lattice import BUILT_IN, area_of
from kaju.model.scene.selection import BY_SIDE, BY_SURFACE, PULL, PUSH
from kaju.model.transfer.deformation import axial_strain
from kaju.model.transfer.stage import Stage, Totals
from kaju.model.transfer.transfer import Transfer
from kaju.result_kinds import KINDS, fetch
from kaju.view.body_plots import SUPPORTS
from kaju.view.films import evenly
from kaju.view.motion import MOST_FRAMES, Motion

_SENSES = {PUSH: "push", PULL: "pull", BY_SIDE: "side", BY_SURFACE: "surface"}
Columns = dict[str, NDArray[Any]]

FORMAT = 1
"""Version of the data in pages."""
MOST_CELLS = 1_000_000
"""A page holds every cell of the array, so larger ones are refused."""


def pack(header: Mapping[str, Any], columns: Mapping[str, NDArray[Any]]) -> bytes:
    """Write a JSON header, and columns of integers or floats, as one deflated block.

    Bytes of one significance stand together, for deflate then finds far more to leave out.
    """
    arrays = {name: np.ascontiguousarray(column).ravel() for name, column in columns.items()}
    listed = [[name, array.dtype.name, array.size] for name, array in arrays.items()]
    text = json.dumps({**header, "columns": listed}, separators=(",", ":"), allow_nan=False)
    head = text.encode()
    body = b"".join(
        array.view(np.uint8).reshape(-1, array.dtype.itemsize).T.tobytes()
        for array in arrays.values()
    )
    return zlib.compress(len(head).to_bytes(4, "little") + head + body, 9)


def scene_data(scene: Scene) -> tuple[dict[str, Any], Columns]:
    """Return the scene as plain data, and its cells as a column."""
    lattice = scene.lattice
    if lattice.kind not in BUILT_IN:
        raise SceneError(
            f"body.lattice: a page cannot run agents of {lattice.kind}s; give export_page a model "
            "or a result, and it shows what they did"
        )
    if lattice.size > MOST_CELLS:
        raise SceneError(
            f"body: {lattice.size:.3g} cells are more than a page holds ({MOST_CELLS:,}); "
            "take larger cells"
        )
    told = ("name", "youngs_modulus", "poissons_ratio", "density")
    shape = {"kind": lattice.kind, "shape": list(lattice.shape), "cell_size": lattice.cell_size}
    rule, shares = scene.rule, dict[str, Any]()
    if isinstance(rule, PrescribedRule):
        shares = asdict(replace(rule, materials=dict(rule.materials)))
    data = {
        "lattice": shape,
        "thickness": scene.thickness,
        "plane": scene.plane,
        "materials": [{key: getattr(m, key) for key in told} for m in scene.cell_materials],
        "sides": {side: scene.side_condition(side).to_value() for side in lattice.sides},
        "rule": {"kind": rule.kind} | shares,
        "stages": scene.stages,
        "loads": _loads(scene),
    }
    return data, {"cells": scene.rasterise()}


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


def _amounts(rows: tuple[Ints, Ints, Floats], last: int, name: str = "") -> Columns:
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
        f"{name}load": amount[order],
    }


LENGTHENED = ("kept", "stretch")


class Account:
    """What agents did with the loads they took, noted generation by generation.

    What each passed on, by arm; what it let end; what boundaries gave back to it; what it kept
    along each axis of the lattice and by how much it lengthened along it. The place of a row is
    the cell's key times the number of these, plus its number.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
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
            last = self._last.get(name, now[:0])
            change = now - np.pad(last, [(0, len(now) - len(last)), (0, 0)])
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
        axes = range(len(self.scene.lattice.axes))
        squeezed = axial_strain(self.scene, totals)
        found["kept"] = totals.kept
        found["stretch"] = np.stack([squeezed.elongation(axis) for axis in axes], axis=1)
        return found

    def columns(self, last: int) -> Columns:
        """Return the history's columns up to the last generation."""
        columns: Columns = {}
        names = ["passed", "dropped", *["returned"] * self._returns, *LENGTHENED]
        none = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0)
        for name in names:
            every = zip(none, *self._rows.get(name, []), strict=True)
            when, place, amount = map(np.concatenate, every)
            columns |= _amounts((when, place, amount), last, f"{name} ")
        return columns


def history_columns(scene: Scene, stage: Stage, account: Account | None = None) -> Columns:
    """Return what a recorded page needs of a stage, by generation as far as an account tells."""
    lattice, history = scene.lattice, stage.history
    key = lattice.key(stage.cells)
    sense = isinstance(scene.rule, PrescribedRule) and scene.rule.sense
    states = lattice.directions * (2 if sense else 1)
    state = history.direction + lattice.directions * history.pull
    place, last = key[history.agent] * states + state, stage.generations
    known = account or Account(scene)
    if account is None:  # then what agents kept is known at the end alone, but by their shares
        known.note(stage.generations, stage, float(stage.returned.sum()))
    told = known.columns(last)
    if account is None and _by_shares(scene, stage):
        told = {name: one for name, one in told.items() if name.split()[0] not in LENGTHENED}
    return {
        **_amounts((history.generation, place, history.load), last),
        "key": key.astype(np.uint32),
        "spawn": stage.spawn_step.astype(np.uint32),
        "woken": stage.woken_by.astype(np.uint8),
        **told,
        **_state_columns(stage, key),
    }


def _by_shares(scene: Scene, stage: Stage) -> bool:
    """Tell whether agents kept, and yielded by, what the scene's rule says."""
    transfer, taken = Transfer(scene), stage.taken
    if transfer.rule.sense:
        taken = np.concatenate([taken - stage.pulled, stage.pulled], axis=1)
    kept = transfer.kept(stage.material, taken)
    modulus = np.array([material.youngs_modulus for material in transfer.materials])
    shortened = kept / (transfer.cross_section * modulus[stage.material, None])
    pairs = ((stage.kept, kept), (stage.shortened, shortened))
    return all(np.allclose(a, b, 1e-9, 1e-12 * np.abs(b).max(initial=0.0)) for a, b in pairs)


def _state_columns(stage: Stage, key: Ints) -> Columns:
    """Return what agents of one's own knew: from waking on the default, then what changed it."""
    columns: Columns = {}
    for course in stage.states:
        agent = np.append(np.arange(len(key)), course.agent)
        when = np.append(stage.spawn_step, course.generation)
        value = np.append(np.full(len(key), float(course.default)), course.value)
        order = np.argsort(agent, kind="stable")
        agent, when, value = agent[order], when[order], value[order]
        change = np.where(np.diff(agent, prepend=-1) != 0, value, np.diff(value, prepend=0.0))
        name = f"state {course.name} "
        columns |= _amounts((when, key[agent], change), stage.generations, name)
    return columns


def motion_data(result: Result) -> tuple[dict[str, Any], Columns]:
    """Return the header and the columns of a page that replays a result."""
    page = KINDS[result.kind].page
    if page is None:
        raise ParameterError(
            f"of: {type(result).__name__} has nothing that a page can show; it shows scenes, "
            "models and their results"
        )
    motion = _thinned(fetch(page)(result))
    columns: Columns = {"held": np.empty(0, dtype=np.uint32)}
    for name in ("points", "moved", "parts", "held", "born", "gone"):
        column = getattr(motion, name)
        if column is not None:
            number = np.float32 if name in ("points", "moved") else np.uint32
            columns[name] = np.asarray(column, dtype=number)
    for name, (_, values) in motion.values.items():
        columns[f"value {name}"] = values.astype(np.float32)
    scene = getattr(result, "scene", getattr(result, "subject", None))
    forces = []
    if arrows := motion.forces:
        wide = np.broadcast_to(arrows.wide, len(arrows.force))
        rows = zip(arrows.place.tolist(), arrows.force.tolist(), wide.tolist(), strict=True)
        forces = [dict(zip(("place", "force", "wide"), row, strict=True)) for row in rows]
    header = {
        "dimension": motion.points.shape[1],
        "corners": motion.parts.shape[1],
        "at": np.asarray(motion.at, dtype=float).tolist(),
        "along": motion.along,
        "colours": {name: unit for name, (unit, _) in motion.values.items()},
        "curves": [_curve_data(curves) for curves in motion.curves],
        "forces": forces,
        "shares": [] if motion.shares is None else np.round(motion.shares, 9).tolist(),
        "visits": list(motion.visits),
        "outcome": motion.outcome,
        "ground": [*ground_of(scene, result)] if isinstance(scene, Scene) else [],
        "outlines": list(motion.outlines),
    }
    return header, columns


def _thinned(motion: Motion) -> Motion:
    """Return a motion with as few frames as a page shows."""
    count, rows = len(motion.at), evenly(len(motion.at), MOST_FRAMES)
    at = np.asarray(motion.at)[rows]
    if motion.along == "share":
        # An answer at rest is told once, and shown at so many shares of its load.
        at, rows = np.linspace(0.0, 1.0, 21), np.array([count - 1])
    values = {
        name: (unit, of[rows] if of.ndim == 2 else of) for name, (unit, of) in motion.values.items()
    }
    moved = None if motion.moved is None else motion.moved[rows]
    shares = None if motion.shares is None else motion.shares[rows]
    return replace(motion, at=at, values=values, moved=moved, shares=shares)


def _curve_data(curves: Curves) -> dict[str, Any]:
    place = curves.along if curves.along.startswith("0 = ") else ""
    return {
        "title": curves.title,
        "unit": curves.unit,
        "at": curves.at.tolist(),
        "lines": {name: line.tolist() for name, line in curves.lines.items()},
        "logarithmic": curves.logarithmic,
        "bars": curves.bars,
        "axis": curves.along_unit if place or curves.along in ("displacement", "time") else "",
        "course": curves.along == "displacement",  # a point a moment, there and back
        "place": place,  # where the way begins: no moments at all
    }


def ground_of(asked: Scene, result: Result) -> Iterator[dict[str, Any]]:
    """Yield the lines (m) along which a body of squares is held, with the way out of it."""
    scene = solved_scene(result) if asked.outlined else asked
    lattice = scene.lattice
    if scene.outlined or lattice.kind != "square" or lattice.size > MOST_CELLS:
        return
    for number, region in enumerate(asked.body.regions if asked.outlined else ()):
        shape = region.shape_in(asked.lattice, f"body.regions.{number}")
        lines = shape.outline() if region.material in HOLDING else ()
        for ring in [flattened(arcs, max(1, 24 // len(arcs))) for arcs in lines]:
            way = np.roll(ring, -1, axis=0) - ring
            out = np.sign(area_of(ring)) * np.stack([-way[:, 1], way[:, 0]], axis=1)
            out /= np.linalg.norm(way, axis=1)[:, None]
            for line in zip(ring.tolist(), (ring + way).tolist(), out.tolist(), strict=True):
                yield dict(zip(("from", "to", "out"), line, strict=True), kind="rigid")
    cut = getattr(result, "cut_agents", None)
    pivots = np.empty((0, 2)) if cut is None else cut.ground.edge * cut.ground.pivots
    for at in pivots[np.isfinite(pivots).all(axis=1)].tolist():  # a ring round each pin's middle
        yield {"from": at, "to": at, "out": [0, 0], "kind": "roller"}
    cells = np.argwhere(scene.rasterise() >= 0)
    for arm, normal in enumerate(lattice.normals):
        axis = int(np.abs(normal).argmax())
        beside, step = lattice.neighbours(cells, arm), np.eye(2, dtype=int)[1 - axis]
        # within outlines rigid holes are held along these, not along cells
        kinds = np.where(asked.outlined & lattice.contains(beside), AIR, scene.kinds(beside))
        side = 0.5 * (1.0 - step) + 0.5 * normal  # of a cell: where its face lies
        for kind, (name, _) in SUPPORTS.items():
            held = cells[kinds == kind]
            held = held[np.lexsort((held[:, 1 - axis], held[:, axis]))]
            ends = np.flatnonzero(np.any(np.diff(held, axis=0) != step, axis=1)) + 1
            for row in np.split(held, ends) if len(held) else ():
                first, last = (
                    lattice.cell_size * (row[[0, -1]] + side + [0 * step, step])
                ).tolist()
                yield {"from": first, "to": last, "out": normal.tolist(), "kind": name}
