"""What a run of the elastic rule leaves behind, gathered from its model.

Its parts come first: steps, agents, ledger, and moments on the way.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.relaxation.push_state import PushState
from kaju.model.elastic.relaxation.push_table import WaveCertificate
from kaju.model.results.cuts import Carrying
from kaju.model.results.result import BALANCE, BodyResult, Check, Curves, idle_rheology
from kaju.model.results.stored import Column
from kaju.model.scene import Scene
from kaju.model.stepper import counted, not_balanced

if TYPE_CHECKING:
    import pandas


class StepRecord(NamedTuple):
    """One step: what it was, and how things stood after it."""

    level: int  # Level that was visited
    way: str  # Then loads were restricted ("up"), displacements prolonged ("down"); "" on one level
    energy: float  # Energy of body and loads (J), 0 at the start
    loudest: float  # Largest load left, as it counts against γ (N), at the last visit to level 0
    error_estimate: float  # √(Σ P²/k) over √(load · displacement), then
    pushes: int  # How often agents have yielded so far


@dataclass(frozen=True, eq=False)
class FaceAgents:
    """The face agents, ordered by level, spawn step and number; one row for each."""

    level: Annotated[Ints, Column("agents", 0, 64)]  # 0 for the cells' own faces
    spawn_step: Annotated[Ints, Column("agents", 0)]  # From 1
    number: Annotated[Ints, Column("agents", 0)]  # Of the face on its level
    axis: Annotated[Ints, Column("agents", 0, "dimension")]  # Of the face's normal
    position: Annotated[Floats, Column("agents dimension")]  # Middle of the face (m)
    taken: Annotated[Floats, Column("agents", 0.0)]  # Sum of the sizes of the loads taken (N)
    left: Annotated[Floats, Column("agents")]  # Load left (N)
    # Along the axis (m); of parents, in their last visit
    displacement: Annotated[Floats, Column("agents")]

    @classmethod
    def of(cls, state: PushState) -> Self:
        """Return the agents that have spawned."""
        rows = []
        for number, (level, faces) in enumerate(zip(state.table.levels, state.levels, strict=True)):
            awake = np.flatnonzero(faces.spawn_step)  # in the order of their steps
            awake = awake[np.argsort(faces.spawn_step[awake], kind="stable")]
            at = state.table.positions(number)
            columns = (level.place[0], at, faces.taken, faces.left, faces.displacement)
            named = np.full(len(awake), number), faces.spawn_step[awake], awake
            rows.append((*named, *(values[awake] for values in columns)))
        return cls(*map(np.concatenate, zip(*rows, strict=True)))


@dataclass(frozen=True)
class PushLedger:
    """An account of every newton, per axis (N)."""

    applied: Annotated[Floats, Column("dimension")]  # Sum of the applied forces
    resting: Annotated[Floats, Column("dimension")]  # Sum of the loads left on faces
    carried: Annotated[Floats, Column("dimension")]  # Sum of what the supports carry
    turnover: float  # Sum of the sizes of all these loads, to compare the imbalance with

    @classmethod
    def of(cls, state: PushState) -> Self:
        """Return how the account stands."""
        table, left = state.table, state.levels[0].left
        axes, dimension = table.levels[0].place[0], table.problem.dimension
        resting, carried = np.zeros(dimension), np.zeros(dimension)
        np.add.at(resting, axes, left[: len(axes)])
        np.add.at(carried, table.support_axes, left[len(axes) :])
        turnover = float(np.abs(left).sum() + np.abs(table.load).sum())
        force = table.problem.scales.force
        applied = force * np.array([values.sum() for values in table.problem.force])
        return cls(applied, resting, carried, turnover)

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of the turnover."""
        gap = np.abs(self.applied - self.resting - self.carried).max()
        return float(gap / self.turnover) if self.turnover > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Moments:
    """How things stood after some of the steps, from before the first to the last."""

    step: Annotated[Ints, Column("moments", 0)]  # Steps taken; 0 is before the first
    # Of each agent, as in the run's table: load left (N), where parents hold the last that was
    # restricted to them, sum of the sizes of the loads taken (N), and displacement (m)
    left: Annotated[NDArray[np.float32], Column("moments agents")]
    taken: Annotated[NDArray[np.float32], Column("moments agents", 0.0)]
    displacement: Annotated[NDArray[np.float32], Column("moments agents")]


class Recorder:
    """Notes moments while a model steps, from before the first step on: evenly, and few.

    A run may take tens of thousands of steps. When there are too many moments, every second one
    is forgotten, and from then on only every second step is noted.
    """

    def __init__(self, state: PushState) -> None:
        self._state = state
        faces = sum(len(level.weight) for level in state.levels)
        # As many as a film shows, in up to 32 MB.
        self._most = max(8, min(400, 32_000_000 // (12 * faces)))
        self._every = 1
        self._kept = [self._look()]

    def note(self) -> None:
        """Keep the step that has just been taken, if its turn has come."""
        if self._state.generation % self._every:
            return
        self._kept.append(self._look())
        if len(self._kept) > self._most:
            self._kept = self._kept[::2]
            self._every *= 2

    def moments(self, agents: FaceAgents) -> Moments:
        """Return what was kept, and how things stand now."""
        kept = self._kept
        if kept[-1][0] != self._state.generation:
            kept = [*kept, self._look()]
        starts = np.cumsum([0, *(level.size for level in self._state.table.levels)])
        row = starts[agents.level] + agents.number
        steps, *columns = zip(*kept, strict=True)
        return Moments(np.array(steps), *(np.stack(column)[:, row] for column in columns))

    def _look(self) -> tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        state = self._state
        columns = (
            [faces.left[: len(faces.weight)] for faces in state.levels],
            [faces.taken for faces in state.levels],
            [faces.displacement for faces in state.levels],
        )
        left, taken, moved = (np.concatenate(column).astype(np.float32) for column in columns)
        return state.generation, left, taken, moved


@dataclass(frozen=True, eq=False, repr=False)
class ElasticRun(BodyResult):
    """What the agents of the elastic rule have done."""

    kind: ClassVar[str] = "elastic agents"
    name: ClassVar[str] = "elastic agents"
    result: ElasticResult  # Displacements, stresses and reactions, as of `kaju.solve`
    outcome: str  # How the run ended, in words
    threshold: float  # γ (N)
    agents: FaceAgents  # Those that spawned
    history: tuple[StepRecord, ...]  # How things stood after every step
    ledger: PushLedger  # The account of every newton
    certificate: WaveCertificate | None  # Of waves, before the run
    moments: Moments  # What was left on agents, and what they had taken, on the way
    seconds: float  # Time that the run took (s)
    own_agents: tuple[str, ...] = ()  # Names of the classes of agents of your own

    stage = property(lambda run: run.result.stage, doc="Stage of loading; None is the last.")

    @property
    def scene(self) -> Scene:
        """The scene that was computed."""
        return self.result.scene

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures of it, the usual one first."""
        first, *others = self.result.pictures
        return (first, "curves", *others[:-1], "left", "scene")

    @property
    def grid(self) -> Scene:
        """The scene on the cells whose faces the agents stand on."""
        return self.result.grid

    @property
    def energy(self) -> Floats:
        """Energy of body and loads (J) after every step."""
        return np.array([record.energy for record in self.history])

    @property
    def pushes(self) -> int:
        """How often agents have yielded."""
        return self.history[-1].pushes if self.history else 0

    @property
    def reaction(self) -> Floats:
        """Sum of the supports' forces on the body (N), shape (dimension,)."""
        return -self.ledger.carried

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the figures should know, in words."""
        lost = not_balanced(counted(len(self.history), "step"), self.ledger.imbalance)
        kept = all(check.holds for check in self.checks())
        return (*([] if kept else [lost]), *idle_rheology(self.scene))

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        levels = np.bincount(self.agents.level)
        last = self.history[-1] if self.history else None
        return {
            "rule": "elastic",
            **({"own_agents": ", ".join(self.own_agents)} if self.own_agents else {}),
            "order": self.result.found.solution.method.removeprefix("agents, "),
            "plane": self.scene.plane,
            "outcome": self.outcome,
            "threshold": self.threshold,
            "steps": len(self.history),
            "pushes": self.pushes,
            "agents": len(self.agents.level),
            "agents_by_level": levels.tolist(),
            "levels": len(levels),
            "strain_energy": self.result.strain_energy,
            "potential_energy": last.energy if last else 0.0,  # body and loads: below 0
            "residual_load": last.loudest if last else 0.0,
            "error_estimate": last.error_estimate if last else 0.0,
            "reaction": self.reaction.tolist(),
            "max_displacement": self.result.max_displacement,
            "seconds": self.seconds,
            "kaju_version": __version__,
        } | ({"notes": list(self.notes)} if self.notes else {})

    def checks(self) -> list[Check]:
        """Return whether every newton is accounted for, as far as rounding allows."""
        return [books(self.ledger, self.scene, len(self.history))]

    def curves(self) -> list[Curves]:
        """Return energy, largest load left, and the error meter after every step."""
        step = np.arange(1.0, len(self.history) + 1.0)
        every = np.array([(r.energy, r.loudest, r.error_estimate, r.pushes) for r in self.history])
        energy, loudest, meter, pushes = every.reshape(-1, 4).T
        worked = (meter > 0.0) & np.isfinite(meter)  # no work is done yet in the first visits
        left = {"load left": loudest[worked], "threshold": np.full(worked.sum(), self.threshold)}
        return [
            Curves("Energy of body and loads", "step", "", step, {"energy": energy}, "J"),
            Curves("Largest load left", "step", "", step[worked], left, "N", logarithmic=True),
            Curves("Error left", "step", "", step[worked], {"meter": meter[worked]}, "", True),
            Curves("Pushes", "step", "", step, {"pushes": pushes}, ""),
        ]

    def _carrying(self, axis: int) -> Carrying:
        return self.result._carrying(axis)

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        return self.result.displacement_at(points)

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""
        return self.result.stress_at(points)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per face agent: level, spawn step, place, loads and displacement."""
        import pandas as pd

        columns = {field.name: getattr(self.agents, field.name) for field in fields(self.agents)}
        position = columns.pop("position")
        table = pd.DataFrame(columns)
        for axis, values in enumerate(position.T):  # after the axis of the normal
            table.insert(4 + axis, f"position_{'xyz'[axis]}", values)
        return table


def books(ledger: PushLedger, scene: Scene, steps: int) -> Check:
    """Return whether every newton is accounted for, as far as the rounding of steps allows."""
    # What moves along passes loads on that cancel, larger than their sum by as much as the
    # stiffest stretch is beside the softest shear; every visit rounds them.
    moduli = scene_moduli(scene)
    cancelling = np.finfo(float).eps * moduli.stretch.max() / moduli.shear.min()
    allowed = max(BALANCE, float(cancelling * steps))
    return Check("every newton is accounted for", ledger.imbalance, allowed)
