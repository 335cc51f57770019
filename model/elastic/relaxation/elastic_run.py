"""What a run of the elastic rule leaves behind, gathered from its model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.relaxation.push_stability import WaveCertificate
from kaju.model.elastic.relaxation.records import (
    BoundaryAgents,
    FaceAgents,
    Moments,
    PushLedger,
    StepRecord,
)
from kaju.model.elastic.solver import Solution
from kaju.model.elastic.staggered import strain_energy
from kaju.model.results.archive import Archive
from kaju.model.results.cuts import Carrying
from kaju.model.results.formats import BOUNDARY_AGENTS, FACE_AGENTS, MOMENTS, LedgerRecord, sizes_of
from kaju.model.results.result import BALANCE, BodyResult, Check, Curves, idle_rheology

if TYPE_CHECKING:
    import pandas

    from kaju.model.elastic.relaxation.elastic_model import ElasticModel
    from kaju.model.scene import Scene


ROUGH = 1e4  # Contrast of moduli from which on the meter of the error left is not to be relied on


@dataclass(frozen=True, eq=False, repr=False)
class ElasticRun(BodyResult):
    """What the agents of the elastic rule have done."""

    kind: ClassVar[str] = "elastic agents"
    name: ClassVar[str] = "elastic agents"
    scene: Scene  # What was asked
    result: ElasticResult  # Displacements, stresses and reactions, as of `kaju.solve`
    outcome: str  # How the run ended, in words
    threshold: float  # γ (N)
    agents: FaceAgents  # Who spawned
    boundary: BoundaryAgents  # Supports and air that loads have reached
    history: tuple[StepRecord, ...]  # How things stood after every step
    ledger: PushLedger  # The account of every newton
    most_pushes: float  # What the order "largest first" cannot exceed: load·displacement·k₀/γ²
    certificate: WaveCertificate | None  # What was known of waves before the run
    moments: Moments  # What was left, and who had taken how much, on the way
    seconds: float  # Time that the run took (s)

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
    def stage(self) -> int | None:
        """Stage of loading; None is the last."""
        return self.result.stage

    @property
    def displacement(self) -> tuple[Floats, ...]:
        """Per axis the displacement (m) of the faces normal to it; NaN where there is no body."""
        return self.result.cells().face_displacement

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
        return tuple(idle_rheology(self.scene))

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        levels = np.bincount(self.agents.level)
        last = self.history[-1] if self.history else None
        return {
            "rule": "elastic",
            "order": self.result.found.solution.method.removeprefix("agents, "),
            "plane": self.scene.plane,
            "outcome": self.outcome,
            "threshold": self.threshold,
            "steps": len(self.history),
            "pushes": self.pushes,
            "agents": len(self.agents.level),
            "agents_by_level": levels.tolist(),
            "levels": len(levels),
            "boundary_agents": len(self.boundary.cells),
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
        # What moves along passes loads on that cancel, larger than their sum by as much as the
        # stiffest stretch is beside the softest shear; every visit rounds them.
        moduli = scene_moduli(self.scene)
        cancelling = np.finfo(float).eps * moduli.stretch.max() / moduli.shear.min()
        allowed = max(BALANCE, float(cancelling * len(self.history)))
        return [Check("every newton is accounted for", self.ledger.imbalance, allowed)]

    def curves(self) -> list[Curves]:
        """Return energy, largest load left, and the error meter after every step."""
        return curves_of(self.history, 0, self.threshold)

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

        columns: dict[str, Any] = {}
        for field in fields(self.agents):
            values = getattr(self.agents, field.name)
            if values.ndim == 1:
                columns[field.name] = values
            else:
                columns |= {f"{field.name}_{a}": c for a, c in zip("xyz", values.T, strict=False)}
        return pd.DataFrame(columns)

    def _archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, answer = self.result._archive()
        arrays = {f"answer.{name}": values for name, values in arrays.items()}
        tables = ("agents", self.agents), ("boundary", self.boundary), ("moments", self.moments)
        for name, table in tables:
            told = {field.name: getattr(table, field.name) for field in fields(table)}
            arrays |= {f"{name}.{key}": at for key, at in told.items() if at is not None}
        ledger = {name: np.asarray(value).tolist() for name, value in asdict(self.ledger).items()}
        return arrays, {
            "answer": answer,
            "answer_seconds": self.result.seconds,
            "outcome": self.outcome,
            "threshold": self.threshold,
            "history": [list(record) for record in self.history],
            "ledger": ledger,
            "most_pushes": self.most_pushes,
            "certificate": asdict(self.certificate) if self.certificate else None,
        }

    @classmethod
    def _from_archive(cls, scene: Scene, archive: Archive) -> Self:
        plain = {"kind": "elastic", "seconds": archive.value("answer_seconds", float)}
        answer = {**archive.value("answer", dict[str, Any]), **plain}
        result = ElasticResult._from_archive(
            scene, Archive(archive.path, archive.part("answer."), answer)
        )
        sizes = sizes_of(result.grid)  # cells are halved where a member is one wide
        agents = FaceAgents(**archive.columns(FACE_AGENTS, sizes, "agents."))
        sizes["agents"] = len(agents.level)
        ledger = archive.value("ledger", LedgerRecord)
        applied, resting, carried = (
            np.array(total) for total in (ledger["applied"], ledger["resting"], ledger["carried"])
        )
        if not {(scene.lattice.dimension,)} == {applied.shape, resting.shape, carried.shape}:
            raise ResultError("its ledger has other axes than the scene")
        return cls(
            scene=scene,
            result=result,
            outcome=archive.value("outcome", str),
            threshold=archive.value("threshold", float),
            agents=agents,
            boundary=BoundaryAgents(**archive.columns(BOUNDARY_AGENTS, sizes, "boundary.")),
            history=tuple(archive.value("history", list[StepRecord])),
            ledger=PushLedger(applied, resting, carried, ledger["turnover"]),
            most_pushes=archive.value("most_pushes", float),
            certificate=archive.value("certificate", WaveCertificate | None),
            moments=Moments(**archive.columns(MOMENTS, sizes, "moments.")),
            seconds=archive.value("seconds", float),
        )


def curves_of(history: Sequence[StepRecord], known: int, threshold: float) -> list[Curves]:
    """Return energy, largest load left, and the error meter after `known` and these steps."""
    step = np.arange(known + 1.0, known + len(history) + 1.0)
    every = np.array([(r.energy, r.loudest, r.error_estimate, r.pushes) for r in history])
    energy, loudest, meter, pushes = every.reshape(-1, 4).T
    told = (meter > 0.0) & np.isfinite(meter)  # no work is done yet in the first visits
    return [
        Curves("Energy of body and loads", "step", "", step, {"energy": energy}, "J"),
        Curves(
            "Largest load left",
            *("step", "", step[told]),
            {"load left": loudest[told], "threshold": np.full(told.sum(), threshold)},
            "N",
            logarithmic=True,
        ),
        Curves("Error left", "step", "", step[told], {"meter": meter[told]}, "", True),
        Curves("Pushes", "step", "", step, {"pushes": pushes}, ""),
    ]


def collect(model: ElasticModel) -> ElasticRun:
    """Gather what a model has done so far."""
    state, table = model.state, model.table
    work = -2.0 * state.energy
    outcome = model.outcome or f"interrupted after {model.generation} steps"
    agents, left = _face_agents(model), state.grounds[0].left
    n, dimension = table.levels[0].size, table.problem.dimension
    resting, carried = np.zeros(dimension), np.zeros(dimension)
    np.add.at(resting, table.levels[0].place[0], left[:n])
    np.add.at(carried, table.place_axes, left[n:])
    turnover = float(np.abs(left).sum() + np.abs(table.load).sum())
    starts = np.cumsum([0, *(level.size for level in table.levels)])
    return ElasticRun(
        scene=model.scene,
        result=_elastic_result(model, outcome),
        outcome=outcome,
        threshold=model.threshold,
        agents=agents,
        boundary=_boundary_agents(model),
        history=tuple(model.history),
        ledger=PushLedger(table.applied, resting, carried, turnover),
        most_pushes=max(work, 0.0) * table.reference / model.threshold**2,
        certificate=model.certificate,
        moments=model.recorder.moments(model.visit.level, starts[agents.level] + agents.number),
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
        method=f"agents, {table.order}",
        discretisation=0.0,
        algebraic=model.error_estimate,
        levels=len(table.levels),
        residuals=meters,
        converged=model.at_rest,
        notes=[outcome, "the error estimate is of the loads left; the grid's own is not in it"],
    )
    moduli = [material.youngs_modulus for material in model.scene.cell_materials]
    contrast = max(moduli) / min(moduli)
    if contrast >= ROUGH:
        solution.notes.append(
            f"moduli differ by a factor of {contrast:.0e}: loads left on soft cells may hide an "
            "error tens of times the estimate; a smaller threshold or `kaju solve` tells"
        )
    found = CellAgents(table.grid, model.stage, table.problem, table.origin, solution)
    return ElasticResult(model.scene, model.stage, found, model.seconds)


def _face_agents(model: ElasticModel) -> FaceAgents:
    rows = []
    for number, level in enumerate(model.table.levels):
        ground, at = model.state.grounds[number], model.table.positions(number)
        awake = _awake(ground.spawn_step)
        step, axis = ground.spawn_step[awake], level.place[0][awake]
        carried = (values[awake] for values in (ground.taken, ground.left, ground.displacement))
        rows.append((np.full(len(awake), number), step, awake, axis, at[awake], *carried))
    return FaceAgents(*map(np.concatenate, zip(*rows, strict=True)))


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
    cells: Ints = np.concatenate([holding.cells[orders[0]], air.cells[orders[1]]])
    cells = cells + np.asarray(table.origin, dtype=np.int64)
    nothing = np.zeros((len(orders[1]), dimension))
    return BoundaryAgents(
        cells=cells,
        kind=table.grid.kinds(cells),
        spawn_step=np.concatenate([step[o] for step, o in zip(steps, orders, strict=True)]),
        reaction=np.concatenate([reaction[orders[0]], nothing]),
        returned=np.concatenate([np.zeros(len(orders[0])), returned[orders[1]]]),
    )


def _awake(step: Ints) -> Ints:
    awake = np.flatnonzero(step)
    return awake[np.argsort(step[awake], kind="stable")]
