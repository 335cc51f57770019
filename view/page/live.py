"""Agents in Python, watched in a page: one message in, one packed answer out.

What the messages and answers say is described in README.md beside this file. A scene that
comes with a message is plain numbers; nothing in it is a path or a program.
"""

from __future__ import annotations

import base64
import binascii
import json
import logging
from collections.abc import Callable, Mapping, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.errors import KajuError, ParameterError
from kaju.model.elastic.problem import ABSENT
from kaju.model.elastic.relaxation.elastic_model import ElasticModel
from kaju.model.elastic.relaxation.elastic_run import curves_of
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.stability import Certificate

from .motion_data import MovingFaces, Pictures, applied, curve_data, diamonds, picture_data
from .own import acting_controls, own_data, own_parts
from .packing import pack
from .scene_data import FORMAT, Account, amount_columns, scene_data

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.push_table import PushTable

    from .scene_data import Columns


log = logging.getLogger(__name__)

ModelOf = Callable[..., LoadModel]

MOST_GENERATIONS = 10_000
"""Of one message."""
MOST_LOADS = 50_000
MOST = 1e300
"""A number of a message is smaller than this."""
_AS_IT_IS = 0
"""Level of compression: time counts more than bytes that stay on one machine."""


def usual_model(scene: Scene) -> LoadModel:
    """Return the rule's own agents, as arrays; loads that grow are shown growing."""
    return LoadModel(scene, engine="arrays", allow_unstable=True)


class Session:
    """One page and the model behind it: messages in, packed answers out."""

    def answer(self, message: str | dict[str, Any]) -> bytes:
        """Return the packed answer to a JSON message: what has happened, and what went wrong."""
        header: dict[str, Any] = {}
        columns: Columns = {}
        try:
            asked = _read(message) if isinstance(message, str) else _table({"": message}, "")
            header, columns = self.reply(asked)
        except Exception as error:
            header = complaint(error)
        return pack(header, columns, level=_AS_IT_IS)

    def opening(self) -> bytes:
        """Return what the page gets before it asks anything."""
        raise NotImplementedError

    def reply(self, asked: dict[str, Any]) -> tuple[dict[str, Any], Columns]:
        """Return the header and the columns of the answer to a message."""
        raise NotImplementedError


class LiveRun(Session):
    """A model of the prescribed rule that a page steps, exchanged when its scene was changed."""

    def __init__(self, scene: Scene, model_of: ModelOf = usual_model) -> None:
        self.scene = scene
        self.model_of = model_of
        self._model: LoadModel | None = None

    def opening(self) -> bytes:
        """Return the scene, as the page draws it."""
        data, columns = scene_data(self.scene)
        header = {"format": FORMAT, "kind": "live", "scene": data, "presets": []}
        if own := own_data(self.model):
            header |= own | {"controls": acting_controls(self.model)}
        return pack(header, columns)

    @property
    def model(self) -> LoadModel:
        """What is stepped, begun when it is first asked for."""
        if self._model is None:
            self._begin(self.scene.in_one_step())
        assert self._model is not None
        return self._model

    def reply(self, asked: dict[str, Any]) -> tuple[dict[str, Any], Columns]:
        """Return the elastic answer if that is asked for, else what the agents did."""
        if asked.get("type") == "elastic":
            return self._elastic()
        fresh = self._prepare(asked)
        wrong = self._step(generations_of(asked))
        header, columns = self._news(fresh)
        return header | wrong, columns

    def _prepare(self, asked: dict[str, Any]) -> bool:
        """Begin anew if that is asked for; return whether it was."""
        match asked.get("type"):
            case "hello":
                self._begin(self.scene.in_one_step())
            case "scene":
                stage = whole(asked, "stage", 1, 100_000, 1)
                numbers = _table(asked, "parameters") if "parameters" in asked else {}
                self._begin(scene_from(_table(asked, "scene"), _cells(asked), stage), numbers)
            case "step":
                return False
            case other:
                raise ParameterError(f"type: there is no message {other!r}")
        return True

    def _begin(self, scene: Scene, numbers: Mapping[str, Any] | None = None) -> None:
        self._model = self.model_of(scene, **numbers or {})
        self._account = Account(scene, bool(own_parts(self._model)))
        self._sent = self._agents = 0

    def _step(self, generations: int) -> dict[str, Any]:
        """Let generations pass; agents that somebody wrote may fail, what was until then counts."""
        model = self.model
        for _ in range(generations):
            if not model.running:
                break
            wrong: dict[str, Any] = {}
            try:
                model.step()
            except Exception as error:
                wrong = complaint(error)
            self._account.note(model.generation, model.totals, model.engine.returned)
            if wrong:
                return wrong
        return {}

    def _news(self, fresh: bool) -> tuple[dict[str, Any], Columns]:
        """Return what has happened since the last answer."""
        model, lattice = self.model, self.model.lattice
        news = model.since(self._sent, self._agents)
        channels = lattice.directions * (2 if model.transfer.rule.sense else 1)
        place, span = news.key * channels + news.channel, (self._sent + 1, model.generation)
        columns = amount_columns(news.generation, place, news.load, span)
        columns |= self._account.columns(span)
        columns |= {
            "key": news.born.astype(np.uint32),
            "spawn": news.spawn_step.astype(np.uint32),
            "woken": news.woken_by.astype(np.uint8),
        }
        self._sent, self._agents = model.generation, self._agents + len(news.born)
        header: dict[str, Any] = {
            "fresh": fresh,
            "at_rest": not model.running,
            "outcome": model.outcome,
        }
        if fresh:
            header["certificate"] = certified(model.certificate)
        return header, columns

    def _elastic(self) -> tuple[dict[str, Any], Columns]:
        """Return the elastic answer to the scene: one row a component, by cell key."""
        from kaju.agents.elastic_rule import ElasticRule
        from kaju.model.study.solving import solve

        scene = self.model.scene.replace(rule=ElasticRule())
        result = solve(scene, strategy="uniform")
        lattice, d = scene.lattice, scene.lattice.dimension
        key = lattice.key(lattice.locate(result.middle))
        agents = np.bincount(key, minlength=prod(n + 2 for n in lattice.shape))

        def mean(values: Floats) -> Floats:
            total = np.bincount(key, values, minlength=len(agents))
            return np.where(agents > 0, total / np.maximum(agents, 1), np.nan)

        pairs = [(a, a) for a in range(d)] + [(a, b) for a in range(d) for b in range(a + 1, d)]
        header = {"elastic": True, "seconds": result.seconds, "subdivision": result.subdivision}
        return header, {
            "displacement": np.stack([mean(column) for column in result.displacement.T]),
            "stress": np.stack([mean(result.stress[:, a, b]) for a, b in pairs]),
        }


def scene_from(
    data: Mapping[str, Any], cells: NDArray[np.int16], stage: int | None = None
) -> Scene:
    """Return the scene that a page has changed, with a stage's loads at once."""
    lattice = _table(data, "lattice")
    kind, shape = lattice.get("kind"), _list(lattice, "shape")
    sizes = all(isinstance(n, int) and n > 0 for n in shape)
    if not sizes or prod(shape) != cells.size:
        raise ParameterError(f"cells: {cells.size} do not fill an array of shape {shape}")
    names = [str(_table({"": m}, "").get("name")) for m in _list(data, "materials")]
    if cells.max(initial=0) >= len(names):
        raise ParameterError(f"cells: {cells.max()} is no number of {len(names)} materials")
    body = {
        "array": cells.reshape(shape) + 3,
        "cell_size": lattice.get("cell_size"),
        "allow_floating": True,
    }
    if kind == "hexagon":
        body["lattice"] = "hexagon"
    if kind != "cube":
        body |= {"thickness": data.get("thickness"), "plane": data.get("plane") or "stress"}
    rule = _table(data, "rule")
    loads = _list(data, "loads")
    if len(loads) > MOST_LOADS:
        raise ParameterError(f"loads: {len(loads)} are more than {MOST_LOADS:,} in one message")
    legend = {str(number + 3): name for number, name in enumerate(names)}
    keys = ("youngs_modulus", "poissons_ratio", "density")
    return Scene(
        body=body,
        legend=legend | {"2": "air", "1": "rigid"},
        materials={
            name: {key: m[key] for key in keys if m.get(key) is not None}
            for name, m in zip(names, data["materials"], strict=True)
        },
        sides=dict(_table(data, "sides")),
        loads=[_load(load, kind, len(shape), stage) for load in loads],
        rule={key: value for key, value in rule.items() if value is not None},
    )


def _load(given: object, kind: object, dimension: int, stage: int | None) -> dict[str, Any]:
    load = _table({"load": given}, "load")
    steps, face, force = load.get("steps", 1), load.get("face", -1), load.get("force")
    if not (isinstance(steps, int) and steps >= 1 and isinstance(face, int)):
        raise ParameterError(f"loads: steps from 1 and a face are needed, got {steps!r}, {face!r}")
    if not (isinstance(force, list) and all(isinstance(f, (int, float)) for f in force)):
        raise ParameterError(f"loads: force: numbers are needed, got {force!r}")
    share = 1.0 if stage is None else min(1.0, stage / steps)
    found: dict[str, Any] = {
        "cell": load.get("cell"),
        "force": [share * f for f in force],
        "steps": steps if stage is None else 1,
    }
    if face >= 0 and kind != "hexagon":  # a side of a hexagon is two of its faces
        sides = ("left", "right", "front", "back", "bottom", "top")
        names = sides if dimension == 3 else (*sides[:2], *sides[4:])
        if face >= len(names):
            raise ParameterError(f"loads: there is no face {face}")
        found["side"] = names[face]
    if load.get("sense") in ("push", "pull"):
        found["sense"] = load["sense"]
    return found


def complaint(error: Exception) -> dict[str, Any]:
    """Return the text of an error; where agents of one's own failed, the log has its trace."""
    if isinstance(error, KajuError):
        return {"error": str(error)}
    log.error("agents or the scene failed", exc_info=error)
    return {"error": f"{type(error).__name__}: {error}"}


def certified(certificate: Certificate) -> dict[str, Any]:
    """Return whether loads end (None: unknown, of agents of one's own), and why."""
    stable = bool(certificate.stable) if certificate.known else None
    return {"stable": stable, "verdict": certificate.verdict}


def generations_of(asked: Mapping[str, Any]) -> int:
    """Return how many generations a message asks for."""
    if asked["type"] == "step":
        return whole(asked, "generations", 1, MOST_GENERATIONS, 1)
    return whole(asked, "generation", 0, MOST_GENERATIONS, 0)


def _read(message: str) -> dict[str, Any]:
    try:
        asked = json.loads(message, parse_int=_number, parse_float=_number, parse_constant=_number)
    except (ValueError, RecursionError) as error:
        raise ParameterError(f"message: is not JSON ({error})") from error
    return _table({"message": asked}, "message")


def _number(text: str) -> int | float:
    """Return a number of a message: a finite one, and no larger than arrays can hold."""
    if not abs(float(text)) < MOST:
        raise ValueError(f"{text[:20]} is not a number below {MOST:.0e}")
    return int(text) if text.lstrip("-").isdigit() else float(text)


def _table(of: Mapping[str, Any], name: str) -> dict[str, Any]:
    value = of.get(name)
    if not isinstance(value, dict):
        raise ParameterError(f"{name}: a table is needed, got {value!r:.60}")
    return value


def _list(of: Mapping[str, Any], name: str) -> list[Any]:
    value = of.get(name)
    if not isinstance(value, list):
        raise ParameterError(f"{name}: a list is needed, got {value!r:.60}")
    return value


def whole(of: Mapping[str, Any], name: str, low: int, high: int, usual: int) -> int:
    """Return a whole number of a message, between two bounds."""
    value = of.get(name, usual)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (number and low <= value <= high and value == int(value)):
        raise ParameterError(f"{name}: a whole number from {low} to {high} is needed, got {value}")
    return int(value)


def _cells(asked: Mapping[str, Any]) -> NDArray[np.int16]:
    text = asked.get("cells")
    try:
        raw = base64.b64decode(text, validate=True) if isinstance(text, str) else b""
    except binascii.Error as error:
        raise ParameterError(f"cells: are not base64 ({error})") from error
    whole = len(raw) % 2 == 0
    cells = np.frombuffer(raw if whole else b"", dtype="<i2").astype(np.int16)
    if not len(cells) or cells.min() < -2:
        raise ParameterError("cells: materials from 0, -1 for air and -2 for rigid are needed")
    return cells


MOST_NUMBERS = 4_000_000
"""Of one answer, but for its first frame: a page asks for the rest."""
MOST_STEPS = 4096
"""From one frame to the next."""


class LiveFaces(Session):
    """A model of the elastic rule that a page steps, begun when it is first needed."""

    def __init__(self, begin: Callable[[], ElasticModel]) -> None:
        self._begin = begin
        self._model: ElasticModel | None = None

    @property
    def model(self) -> ElasticModel:
        """What is stepped."""
        if self._model is None:
            self._model = self._begin()
            self._moving = _moving_faces(self._model.table)
        return self._model

    def opening(self) -> bytes:
        """Return where the faces are, and how things stand before the first step."""
        model = self.model
        h = model.table.grid.lattice.cell_size
        units = {"load_left": "N", "load_taken": "N"}
        frame = self._frame()
        header, columns = picture_data(
            Pictures(
                **diamonds(model.table.positions(0), h),
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
        return pack(header | own_data(model) | {"format": FORMAT, "kind": "live"}, columns)

    def reply(self, asked: dict[str, Any]) -> tuple[dict[str, Any], Columns]:
        """Return the frames of the steps that are asked for."""
        fresh = asked.get("type") == "hello"
        if not fresh and asked.get("type") != "step":
            raise ParameterError(f"type: there is no message {asked.get('type')!r} for this rule")
        model = self.model
        if fresh:
            model.reset()
        count, every = generations_of(asked), whole(asked, "every", 1, MOST_STEPS, 1)
        frames = [self._frame()] if fresh else []
        at, visits, first = [0.0] * fresh, [0] * fresh, len(model.history)
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
        curves = curves_of(model.history[first:], first, model.threshold)
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
            column = "moved" if name == "moved" else f"value {name}"
            values = [frame[name].ravel() for frame in frames]
            columns[column] = np.concatenate([np.empty(0), *values]).astype(np.float32)
        return columns

    def _frame(self) -> dict[str, Floats]:
        """Return how things stand now, face by face."""
        model = self.model
        ground, moved = model.state.levels[0], self._moving.at(model.state.levels[0].displacement)
        left = np.abs(ground.left[: len(moved)])
        return {"load_left": left, "load_taken": ground.taken.copy(), "moved": moved}

    def _born(self) -> NDArray[np.uint32]:
        """Return in which step each face's agent woke; those asleep: the largest number."""
        step = self.model.state.levels[0].spawn_step
        return np.where(step > 0, step, 2**32 - 1).astype(np.uint32)


def _moving_faces(table: PushTable) -> MovingFaces:
    """Return the faces of a table as they move; those that are given their place hold it."""
    problem = table.problem
    fields = [
        np.where(states == ABSENT, np.nan, problem.scales.displacement * fixed)
        for states, fixed in zip(problem.face_states, problem.fixed, strict=True)
    ]
    return MovingFaces(*table.levels[0].place, fields)


Watched = Scene | LoadModel | ElasticModel


def sessions_of(of: Watched) -> Callable[[], Session]:
    """Return what begins a session with a model of its own, that of `of` begun anew."""
    if isinstance(of, LoadModel):
        return lambda: LiveRun(of.scene, of.again)
    if isinstance(of, ElasticModel):
        return lambda: LiveFaces(lambda: of.again(of.scene))
    if not isinstance(of, Scene):
        raise ParameterError(
            "of: scenes, LoadModel, ElasticModel and CreepModel can be watched, got "
            f"{type(of).__name__}; kaju.export_page shows what others have done"
        )
    if isinstance(of.rule, PrescribedRule):
        return lambda: LiveRun(of)
    return lambda: LiveFaces(lambda: ElasticModel(of, allow_unstable=True))
