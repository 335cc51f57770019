"""What a run of the elastic rule leaves behind: agents, supports, history and ledger."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju import __version__

from .elastic_result import ElasticResult
from .engine import Solution
from .push_stability import WaveCertificate
from .staggered import strain_energy

if TYPE_CHECKING:
    from kaju.model.scene import Scene

    from .elastic_model import ElasticModel
    from .elastic_result import ElasticResult

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class StepRecord(NamedTuple):
    """One step: what it was, and how things stood after it.

    Attributes
    ----------
    level : int
        Level that was visited.
    way : str
        "up" if loads were handed up to parents afterwards, "down" if what parents yielded
        was handed down, "" in orders without levels.
    energy : float
        Energy of body and loads (J), 0 at the start.
    loudest : float
        Largest load left, as it counts against γ (N); as of the last visit to level 0.
    error_estimate : float
        √(Σ P²/k) over √(load · displacement), then.
    pushes : int
        How often agents have yielded so far.
    """

    level: int
    way: str
    energy: float
    loudest: float
    error_estimate: float
    pushes: int


@dataclass(frozen=True)
class FaceAgents:
    """The face agents, ordered by level, spawn step and number.

    Attributes
    ----------
    level, spawn_step, number : arrays of int, shape (agents,)
        Level, 0 for the cells' own faces; step of spawning, from 1; number of the face.
    axis : array of int, shape (agents,)
        Axis of the face's normal.
    position : array, shape (agents, dimension)
        Middle of the face (m).
    taken : array, shape (agents,)
        Sum of the sizes of the loads taken (N).
    left : array, shape (agents,)
        Load left (N).
    displacement : array, shape (agents,)
        Displacement (m) along the axis; of parents, in their last visit.
    """

    level: Integers
    spawn_step: Integers
    number: Integers
    axis: Integers
    position: Floats
    taken: Floats
    left: Floats
    displacement: Floats


@dataclass(frozen=True)
class BoundaryAgents:
    """The boundary agents: supports, then air; each ordered by spawn step and cell.

    Attributes
    ----------
    cells : array of int, shape (agents, dimension)
        Where they are.
    kind : array of int, shape (agents,)
        What they are, from `kaju.model.scene.kinds`.
    spawn_step : array of int, shape (agents,)
        Step in which a load first reached them.
    reaction : array, shape (agents, dimension)
        Force on the body (N); none from air.
    returned : array, shape (agents,)
        Sum of the sizes of the loads (N) that air gave back; none by supports.
    """

    cells: Integers
    kind: Integers
    spawn_step: Integers
    reaction: Floats
    returned: Floats


@dataclass(frozen=True)
class PushLedger:
    """An account of every newton, per axis (N).

    Attributes
    ----------
    applied : array, shape (dimension,)
        Sum of the applied forces.
    resting : array
        Sum of the loads left on faces.
    carried : array
        Sum of what the supports carry.
    turnover : float
        Sum of the sizes of all these loads, to compare the imbalance with.
    """

    applied: Floats
    resting: Floats
    carried: Floats
    turnover: float

    @property
    def imbalance(self) -> float:
        """What the books do not account for, as a share of the turnover."""
        gap = np.abs(self.applied - self.resting - self.carried).max()
        return float(gap / self.turnover) if self.turnover > 0.0 else 0.0


@dataclass(frozen=True)
class ElasticRun:
    """What the agents of the elastic rule have done.

    Attributes
    ----------
    scene : Scene
        What was asked.
    result : ElasticResult
        Displacements, stresses and reactions, as of `kaju.solve`.
    outcome : str
        How the run ended, in words.
    threshold : float
        γ (N).
    agents : FaceAgents
        Who spawned.
    boundary : BoundaryAgents
        Supports and air that loads have reached.
    history : tuple of StepRecord
        How things stood after every step.
    ledger : PushLedger
        The account of every newton.
    most_pushes : float
        What the order "largest first" cannot exceed: load·displacement·k₀/γ².
    certificate : WaveCertificate or None
        What was known of waves before the run.
    seconds : float
        Time that the run took (s).
    """

    scene: Scene
    result: ElasticResult
    outcome: str
    threshold: float
    agents: FaceAgents
    boundary: BoundaryAgents
    history: tuple[StepRecord, ...]
    ledger: PushLedger
    most_pushes: float
    certificate: WaveCertificate | None
    seconds: float

    @property
    def displacement(self) -> tuple[Floats, ...]:
        """Per axis the displacement (m) of the faces normal to it; NaN where there is no body."""
        return self.result.face_displacement

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

    def to_result(self) -> ElasticResult:
        """Return what the agents have settled to, with displacement and stress anywhere."""
        from .settled import settled

        return settled(self)

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        levels = np.bincount(self.agents.level)
        last = self.history[-1] if self.history else None
        return {
            "rule": "elastic",
            "order": self.scene.rule.order,  # type: ignore[union-attr]
            "plane": self.scene.plane,
            "outcome": self.outcome,
            "threshold": self.threshold,
            "steps": len(self.history),
            "pushes": self.pushes,
            "agents": len(self.agents.level),
            "agents_by_level": levels.tolist(),
            "levels": len(levels),
            "boundary_agents": len(self.boundary.cells),
            "energy": last.energy if last else 0.0,
            "residual": last.loudest if last else 0.0,
            "error_estimate": last.error_estimate if last else 0.0,
            "reaction": self.reaction.tolist(),
            "max_displacement": self.result.max_displacement,
            "seconds": self.seconds,
            "kaju_version": __version__,
        }


def collect(model: ElasticModel) -> ElasticRun:
    """Gather what a model has done so far."""
    state, table = model.state, model.table
    work = -2.0 * state.energy
    outcome = model.outcome or f"interrupted after {model.generation} steps"
    return ElasticRun(
        scene=model.scene,
        result=_elastic_result(model, outcome),
        outcome=outcome,
        threshold=model.threshold,
        agents=_face_agents(model),
        boundary=_boundary_agents(model),
        history=tuple(model.history),
        ledger=_ledger(model),
        most_pushes=max(work, 0.0) * table.reference / model.threshold**2,
        certificate=model.certificate,
        seconds=model.seconds,
    )


def _elastic_result(model: ElasticModel, outcome: str) -> ElasticResult:
    """Return the faces' displacements as the answer of an elastic solver."""
    table, scales = model.table, model.table.problem.scales
    fields = tuple(values.copy() for values in table.problem.fixed)
    moved = model.state.grounds[0].displacement / scales.displacement
    table.levels[0].numbering.scatter(moved, fields)
    meters = [record.error_estimate for record in model.history]
    solution = Solution(
        displacement=fields,
        energy=strain_energy(table.problem, fields),
        method=f"agents, {table.rule.order}",
        discretisation=0.0,
        algebraic=model.error_estimate,
        levels=len(table.levels),
        residuals=meters,
        converged=model.at_rest,
        notes=[outcome, "the error estimate is of the loads left; the grid's own is not in it"],
    )
    return ElasticResult(
        model.scene,
        table.grid,
        model.stage,
        table.subdivision,
        table.problem,
        table.origin,
        solution,
        model.seconds,
    )


def _face_agents(model: ElasticModel) -> FaceAgents:
    columns: list[list[NDArray[Any]]] = [[] for _ in range(8)]
    for number, (level, ground) in enumerate(
        zip(model.table.levels, model.state.grounds, strict=True)
    ):
        awake = np.flatnonzero(ground.spawn_step)
        awake = awake[np.argsort(ground.spawn_step[awake], kind="stable")]
        values = (
            np.full(len(awake), number),
            ground.spawn_step[awake],
            awake,
            level.place[0][awake],
            model.table.positions(number)[awake],
            ground.taken[awake],
            ground.left[awake],
            ground.displacement[awake],
        )
        for column, value in zip(columns, values, strict=True):
            column.append(value)
    return FaceAgents(*(np.concatenate(column) for column in columns))


def _boundary_agents(model: ElasticModel) -> BoundaryAgents:
    table, state = model.table, model.state
    dimension = table.problem.dimension
    holding, air = table.holding, table.open_air
    left, faces = state.grounds[0].left, table.levels[0].size
    reaction = np.zeros((len(holding.cells), dimension))
    for axis in range(dimension):
        carried = np.where(table.place_axes == axis, left[faces:], 0.0)
        reaction[:, axis] = -(holding.links @ carried)
    returned: Floats = np.asarray(air.links @ state.grounds[0].taken)
    steps = holding.first(state.place_step), air.first(state.grounds[0].spawn_step)
    orders = [_awake(step) for step in steps]
    cells: Integers = np.concatenate([holding.cells[orders[0]], air.cells[orders[1]]])
    cells = cells + np.asarray(table.origin, dtype=np.int64)
    nothing = np.zeros((len(orders[1]), dimension))
    return BoundaryAgents(
        cells=cells,
        kind=table.grid.kinds(cells),
        spawn_step=np.concatenate([step[o] for step, o in zip(steps, orders, strict=True)]),
        reaction=np.concatenate([reaction[orders[0]], nothing]),
        returned=np.concatenate([np.zeros(len(orders[0])), returned[orders[1]]]),
    )


def _awake(step: Integers) -> Integers:
    awake = np.flatnonzero(step)
    return awake[np.argsort(step[awake], kind="stable")]


def _ledger(model: ElasticModel) -> PushLedger:
    table, left = model.table, model.state.grounds[0].left
    n, dimension = table.levels[0].size, table.problem.dimension
    axis = table.levels[0].place[0]
    resting, carried = np.zeros(dimension), np.zeros(dimension)
    np.add.at(resting, axis, left[:n])
    np.add.at(carried, table.place_axes, left[n:])
    turnover = float(np.abs(left).sum() + np.abs(table.load).sum())
    return PushLedger(table.applied, resting, carried, turnover)
