"""Runs that the page replays, as a header and columns of numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from kaju.errors import ParameterError
from kaju.model.results.result import Curves, Result, solved_scene
from kaju.model.scene import Scene
from kaju.result_kinds import KINDS, fetch
from kaju.view.body_plots import SUPPORTS
from kaju.view.motion import Motion, chosen_frames

from .scene_data import MOST_CELLS, Columns

SHARES = 21
"""An answer at rest is told once, and shown at so many shares of its load."""


def motion_data(result: Result) -> tuple[dict[str, Any], Columns]:
    """Return the header and the columns of a page that replays a result."""
    page = KINDS[result.kind].page
    if page is None:
        raise ParameterError(
            f"of: {type(result).__name__} has nothing that a page can show; it shows scenes, "
            "models and their results"
        )
    motion = _thinned(fetch(page)(result))
    columns: Columns = {
        "points": motion.points.astype(np.float32),
        "parts": motion.parts.astype(np.uint32),
        "held": np.asarray(() if motion.held is None else motion.held, dtype=np.uint32),
    }
    if motion.moved is not None:
        columns["moved"] = motion.moved.astype(np.float32)
    for name, column in (("born", motion.born), ("gone", motion.gone)):
        if column is not None:
            columns[name] = column.astype(np.uint32)
    for name, (_, values) in motion.values.items():
        columns[f"value {name}"] = values.astype(np.float32)
    scene = getattr(result, "scene", getattr(result, "subject", None))
    if isinstance(scene, Scene) and scene.outlined:
        scene = solved_scene(result)
    header = {
        "dimension": motion.points.shape[1],
        "corners": motion.parts.shape[1],
        "at": np.asarray(motion.at, dtype=float).tolist(),
        "along": motion.along,
        "colours": {name: unit for name, (unit, _) in motion.values.items()},
        "curves": [_curve_data(curves) for curves in motion.curves],
        "forces": [{"place": place, "force": force} for place, force in motion.forces],
        "shares": [] if motion.shares is None else np.round(motion.shares, 9).tolist(),
        "visits": list(motion.visits),
        "outcome": motion.outcome,
        "ground": ground_of(scene) if isinstance(scene, Scene) else [],
        "outlines": list(motion.outlines),
    }
    return header, columns


def _thinned(motion: Motion) -> Motion:
    """Return a motion with as few frames as a page shows."""
    count, rows = len(motion.at), chosen_frames(len(motion.at))
    at = np.asarray(motion.at)[rows]
    if motion.along == "share":
        at, rows = np.linspace(0.0, 1.0, SHARES), np.array([count - 1])
    values = {
        name: (unit, of[rows] if of.ndim == 2 else of) for name, (unit, of) in motion.values.items()
    }
    moved = None if motion.moved is None else motion.moved[rows]
    shares = None if motion.shares is None else motion.shares[rows]
    return replace(motion, at=at, values=values, moved=moved, shares=shares)


def _curve_data(curves: Curves) -> dict[str, Any]:
    return {
        "title": curves.title,
        "unit": curves.unit,
        "at": curves.at.tolist(),
        "lines": {name: line.tolist() for name, line in curves.lines.items()},
        "logarithmic": curves.logarithmic,
        "axis": curves.along_unit if curves.along in ("displacement", "place") else "",
        "course": curves.along == "displacement",  # a point a moment, there and back
        "place": curves.along == "place",  # no moments at all
    }


def ground_of(scene: Scene) -> list[dict[str, Any]]:
    """Return the lines (m) along which a body of squares is held, with the way out of it."""
    lattice = scene.lattice
    if scene.outlined or lattice.kind != "square" or lattice.size > MOST_CELLS:
        return []
    cells, lines = np.argwhere(scene.rasterise() >= 0), []
    for arm, normal in enumerate(lattice.normals):
        axis = int(np.abs(normal).argmax())
        kinds, step = scene.kinds(lattice.neighbours(cells, arm)), np.eye(2, dtype=int)[1 - axis]
        for kind, (name, _) in SUPPORTS.items():
            held = cells[kinds == kind]
            held = held[np.lexsort((held[:, 1 - axis], held[:, axis]))]
            begins = np.ones(len(held), dtype=np.bool_)
            begins[1:] = np.any(np.diff(held, axis=0) != step, axis=1)
            first = np.flatnonzero(begins)
            last = np.append(first[1:], len(held))[: len(first)] - 1
            side = 0.5 * (1.0 - step) + 0.5 * normal  # of a cell: where its face lies
            for one, other in zip(held[first], held[last], strict=True):
                ends = lattice.cell_size * np.array([one + side, other + side + step])
                line = {"from": ends[0].tolist(), "to": ends[1].tolist()}
                lines.append(line | {"out": normal.tolist(), "kind": name})
    return lines
