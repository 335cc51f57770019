"""Elastic agents in Python, watched in a page: every step a frame, as README.md describes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.elastic.problem import ABSENT
from kaju.model.elastic.settling.elastic_model import ElasticModel
from kaju.model.elastic.settling.run import curves_of
from kaju.model.propagation.load_model import LoadModel
from kaju.model.scene import Scene

from .live import LiveRun, Session, complaint, generations_of, whole
from .motion_data import Pictures, applied, curve_data, diamonds, picture_data
from .packing import pack
from .scene_data import FORMAT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from kaju.model.elastic.settling.table import PushTable

    from .scene_data import Columns


MOST_NUMBERS = 4_000_000
"""Of one answer, but for its first frame: a page asks for the rest."""
MOST_STEPS = 4096
"""From one frame to the next."""


class LiveFaces(Session):
    """A model of the elastic rule that a page steps.

    Parameters
    ----------
    begin : callable
        Returns the model; it is called when the model is first needed.
    """

    def __init__(self, begin: Callable[[], ElasticModel]) -> None:
        self._begin = begin
        self._model: ElasticModel | None = None

    @property
    def model(self) -> ElasticModel:
        """What is stepped."""
        if self._model is None:
            self._model = self._begin()
            self._moving = Moving(self._model.table)
        return self._model

    def opening(self) -> bytes:
        """Return where the faces are, and how things stand before the first step."""
        model = self.model
        h = model.table.grid.lattice.cell_size
        points, parts = diamonds(model.table.positions(0), h)
        units = {"load_left": "N", "load_taken": "N"}
        frame = self._frame()
        header, columns = picture_data(
            Pictures(
                points=points,
                parts=parts,
                at=[0.0],
                along="step",
                values={name: (unit, frame[name][None]) for name, unit in units.items()},
                moved=frame["moved"][None],
                born=self._born(),
                curves=curves_of([], 0, model.threshold),
                forces=applied(model.scene),
                visits=[0],
            )
        )
        return pack(header | {"format": FORMAT, "kind": "live"}, columns)

    def told(self, asked: dict[str, Any]) -> tuple[dict[str, Any], Columns]:
        """Return the frames of the steps that are asked for."""
        fresh = asked.get("type") == "hello"
        if not fresh and asked.get("type") != "step":
            raise ParameterError(f"type: there is no message {asked.get('type')!r} for this rule")
        model = self.model
        if fresh:
            model.reset()
        count, every = generations_of(asked), whole(asked, "every", 1, MOST_STEPS, 1)
        frames = [self._frame()] if fresh else []
        at, visits, known = [0.0] * fresh, [0] * fresh, len(model.history)
        wrong: dict[str, Any] = {}
        most = max(1, MOST_NUMBERS // (len(model.table.levels[0].stiffness) * 4))
        for _ in range(min(count, most)):
            if not model.running:
                break
            try:
                for _ in range(every):
                    model.step()
            except Exception as error:
                wrong = complaint(error)
            frames.append(self._frame())
            at.append(float(model.generation))
            visits.append(model.visit.level)
            if wrong:
                break
        curves = curves_of(model.history[known:], known, model.threshold)
        header = {
            "fresh": fresh,
            "at": at,
            "visits": visits,
            "at_rest": not model.running,
            "outcome": model.outcome,
            "curves": [curve_data(curve) for curve in curves],
        }
        if model.certificate is not None and not model.outcome:
            header["outcome"] = model.certificate.verdict
        return header | wrong, self._columns(frames)

    def _columns(self, frames: Sequence[dict[str, Floats]]) -> Columns:
        columns: Columns = {"born": self._born()}
        for name in ("load_left", "load_taken", "moved"):
            told = "moved" if name == "moved" else f"value {name}"
            values = [frame[name].ravel() for frame in frames]
            columns[told] = np.concatenate([np.empty(0), *values]).astype(np.float32)
        return columns

    def _frame(self) -> dict[str, Floats]:
        """Return how things stand now, face by face."""
        model = self.model
        ground, moved = model.state.grounds[0], self._moving.at(model.state.grounds[0].displacement)
        left = np.abs(ground.left[: len(moved)])
        return {"load_left": left, "load_taken": ground.taken.copy(), "moved": moved}

    def _born(self) -> NDArray[np.uint32]:
        """Return in which step each face's agent woke; those asleep: the largest number."""
        step = self.model.state.grounds[0].spawn_step
        return np.where(step > 0, step, 2**32 - 1).astype(np.uint32)


class Moving:
    """Displacements of the faces' middles in all directions.

    A face moves along its normal; across it goes with the mean of the faces round it.

    Parameters
    ----------
    table : PushTable
        Where the faces are.
    """

    def __init__(self, table: PushTable) -> None:
        self.table = table
        self.axis, index = table.levels[0].place
        states = table.problem.face_states()
        unit = np.eye(len(states), dtype=np.int64)
        self.round: dict[tuple[int, int], tuple[Any, Floats]] = {}
        for a in range(len(states)):
            at = index[self.axis == a]
            for b in set(range(len(states))) - {a}:
                places = [at, at + unit[b], at - unit[a], at - unit[a] + unit[b]]
                flat = np.stack([np.ravel_multi_index(p.T, states[b].shape) for p in places])
                there = states[b].ravel()[flat] != ABSENT
                self.round[a, b] = flat, there / np.maximum(there.sum(axis=0), 1)

    def at(self, displacement: Floats) -> Floats:
        """Return displacements (m), shape (faces, dimension), from those along the normals."""
        scale = self.table.problem.scales.displacement
        fields = tuple(values * scale for values in self.table.problem.fixed)
        self.table.levels[0].numbering.scatter(displacement, fields)
        moved = np.zeros((len(displacement), len(fields)))
        for a in range(len(fields)):
            moved[self.axis == a, a] = displacement[self.axis == a]
        for (a, b), (flat, weight) in self.round.items():
            moved[self.axis == a, b] = (weight * fields[b].ravel()[flat]).sum(axis=0)
        return moved


Watched = Scene | LoadModel | ElasticModel


def sessions_of(of: Watched) -> Callable[[], Session]:
    """Return what begins a session with a model of its own, that of `of` begun anew.

    Raises
    ------
    ParameterError
        If it cannot be watched.
    """
    if isinstance(of, LoadModel):
        return lambda: LiveRun(of.scene, of.again)
    if isinstance(of, ElasticModel):
        return lambda: LiveFaces(lambda: of.again(of.scene))
    if not isinstance(of, Scene):
        raise ParameterError(
            f"of: scenes, LoadModel and ElasticModel can be watched, got {type(of).__name__}; "
            "kaju.export_page shows what others have done"
        )
    if isinstance(of.rule, PrescribedRule):
        return lambda: LiveRun(of)
    return lambda: LiveFaces(lambda: ElasticModel(of, allow_unstable=True))
