"""A stored run as a mesh in motion, for programs that draw in their own way.

Points stay the same from frame to frame, so that a moving body is its rest form and one
displacement field a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints

from .section import CORNERS

if TYPE_CHECKING:
    from kaju.model.creep.body import TransferCreepResult
    from kaju.model.creep.elastic_result import ElasticCreepResult
    from kaju.model.creep.network_result import NetworkCreepResult
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.network.network_result import NetworkResult
    from kaju.model.propagation.transfer_result import TransferResult
    from kaju.model.result import BodyResult

    MovedAt = Callable[[Floats], Floats]

_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
_CUBE = np.vstack([np.pad(_SQUARE, [(0, 0), (0, 1)], constant_values=z) for z in (0, 1)])
_FORMS = {2: _SQUARE, 3: _CUBE}
_WITHIN = 1e-6
"""Corners are asked for this share inside the cell, where they belong to no other."""


def corners_of(dimension: int) -> Floats:
    """Return the corners of a unit square or cube from its lower one, shape (4 or 8, dim)."""
    return _FORMS[dimension]


class Frame(NamedTuple):
    """A moment: its number or time (s), displacements (m) of the points, values of the parts."""

    time: float
    moved: Floats
    values: dict[str, Floats]


@dataclass(frozen=True, eq=False)
class Motion:
    """Points, what they are the corners of, and where they are in every frame.

    Attributes
    ----------
    points : array, shape (n, dimension)
        Places at rest (m).
    parts : array of int, shape (parts, corners)
        Springs (2 corners), triangles (3), squares (4) or hexagons (6) in turn, or cubes (8, as
        VTK has them).
    frames : sequence of Frame
        From rest to the end.
    """

    points: Floats
    parts: Ints
    frames: Sequence[Frame]

    @property
    def farthest(self) -> float:
        """Largest displacement of all frames (m)."""
        return max(
            float(np.linalg.norm(frame.moved, axis=1).max(initial=0.0)) for frame in self.frames
        )


class _Cells(NamedTuple):
    """Cells of a body as parts, and how to find the displacement of their corners."""

    points: Floats
    parts: Ints
    inside: Floats

    def moved(self, moved_at: MovedAt) -> Floats:
        """Return the displacement of the points: the mean of what their cells say."""
        own = moved_at(self.inside)
        number = self.parts.ravel()
        share = np.bincount(number)
        return np.stack([np.bincount(number, column) / share for column in own.T], axis=1)


def _cells(corners: Floats, apart: Floats) -> _Cells:
    """Join cells, corners of shape (n, corners, dimension), where they touch.

    Corners that are farther from each other than a share of `apart` are two; see `CORNERS`.
    """
    flat = corners.reshape(-1, corners.shape[2])
    place = np.rint(CORNERS * flat / apart).astype(np.int64)
    place -= place.min(axis=0)
    key = np.ravel_multi_index(tuple(place.T), tuple(place.max(axis=0) + 1))
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    middles = np.repeat(corners.mean(axis=1), corners.shape[1], axis=0)
    inside = flat + _WITHIN * (middles - flat)
    return _Cells(flat[first], number.reshape(corners.shape[:2]), inside)


def _body(result: BodyResult) -> tuple[_Cells, Ints]:
    """Return the cells of a result's grid, and where they are."""
    lattice = result.grid.lattice
    cells = np.argwhere(result.grid.rasterise() >= 0)
    if lattice.boxes:
        forms = lattice.cell_size * (_FORMS[lattice.dimension] - 0.5)[None]
    else:
        forms = np.stack([lattice.outline(form) for form in range(lattice.forms)])
    corners = lattice.centres(cells)[:, None] + forms[lattice.form(cells)]
    return _cells(corners, np.diag(lattice.pitch)), cells


def _on(cells: Ints, shape: tuple[int, ...], where: Ints, values: Floats) -> Floats:
    """Spread the values of some cells over all, 0 elsewhere."""
    field = np.zeros(shape)
    field[tuple(where.T)] = values
    found: Floats = field[tuple(cells.T)]
    return found


def so_far(result: TransferResult, generation: int) -> TransferResult:
    """Return a run with what its last stage had taken up to a generation."""
    stage = result.last
    history = stage.history
    then = history.generation <= generation
    taken = np.zeros_like(stage.taken)
    np.add.at(taken, (history.agent[then], history.direction[then]), history.load[then])
    # What deforms a cell grows with the loads along each axis, pulls counted against pushes.
    axis = result.scene.lattice.axis_of[history.direction]
    load = np.where(history.pull, -history.load, history.load)
    grown, whole = np.zeros_like(stage.kept), np.zeros_like(stage.kept)
    np.add.at(whole, (history.agent, axis), load)
    np.add.at(grown, (history.agent[then], axis[then]), load[then])
    share = np.divide(grown, whole, out=np.zeros_like(grown), where=whole != 0.0)
    deforming = {n: share * getattr(stage, n) for n in ("kept", "shortened", "widened")}
    return replace(result, stages=(*result.stages[:-1], replace(stage, taken=taken, **deforming)))


def generations(result: TransferResult) -> Motion:
    """Return the last stage of a run, generation by generation."""
    states = [so_far(result, number) for number in range(result.last.generations + 1)]
    return _transfer(result, states)


def stages(result: TransferResult) -> Motion:
    """Return a run at rest, and at the end of every stage of loading."""
    ended = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    return _transfer(result, [so_far(ended[0], 0), *ended])


def _transfer(result: TransferResult, states: Sequence[TransferResult]) -> Motion:
    body, cells = _body(result)
    shape = result.scene.lattice.shape
    frames = []
    for number, state in enumerate(states):
        taken = _on(cells, shape, state.last.cells, state.last.taken.sum(axis=1))
        frames.append(Frame(number, body.moved(state.displacement_at), {"load_taken": taken}))
    return Motion(body.points, body.parts, frames)


def loaded(result: ElasticResult) -> Motion:
    """Return an elastic body at rest and under its load."""
    d = result.lower.shape[1]
    places = result.lower[:, None] + result.size[:, None, None] * _FORMS[d]
    body = _cells(places, np.full(d, result.size.min()))
    values = {"von_mises": result.von_mises, "level": result.level.astype(np.float64)}
    moved = body.moved(result.displacement_at)
    rest = Frame(0.0, np.zeros_like(moved), {name: np.zeros_like(v) for name, v in values.items()})
    return Motion(body.points, body.parts, [rest, Frame(1.0, moved, values)])


def increments(result: NetworkResult) -> Motion:
    """Return the states of a spring network along its load path."""
    return _springs(result, result.stage)


def _springs(result: NetworkResult, times: Floats) -> Motion:
    frames = [
        Frame(float(time), moved, {"tension": tension})
        for time, moved, tension in zip(times, result.displacement, result.tension, strict=True)
    ]
    return Motion(result.network.positions, result.network.springs, frames)


def network_times(result: NetworkCreepResult) -> Motion:
    """Return a spring network in time."""
    return _springs(result.to_network_result(), result.times)


def times(result: TransferCreepResult | ElasticCreepResult) -> Motion:
    """Return a creeping body, one frame a time asked for."""
    body, _ = _body(result.static)
    frames = [
        Frame(float(time), body.moved(lambda at, k=k: result.displacement_at(at, k)), {})  # type: ignore[misc]
        for k, time in enumerate(result.times)
    ]
    return Motion(body.points, body.parts, frames)
