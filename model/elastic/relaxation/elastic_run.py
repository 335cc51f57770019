"""What a run of the elastic rule leaves behind, gathered from its model."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from kaju import __version__
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.relaxation.push_table import WaveCertificate
from kaju.model.elastic.relaxation.records import (
    BoundaryAgents,
    FaceAgents,
    Moments,
    PushLedger,
    StepRecord,
)
from kaju.model.results.cuts import Carrying
from kaju.model.results.result import BALANCE, BodyResult, Check, Curves, idle_rheology
from kaju.model.scene import Scene
from kaju.model.stepper import not_balanced

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False, repr=False)
class ElasticRun(BodyResult):
    """What the agents of the elastic rule have done."""

    kind: ClassVar[str] = "elastic agents"
    name: ClassVar[str] = "elastic agents"
    result: ElasticResult  # Displacements, stresses and reactions, as of `kaju.solve`
    outcome: str  # How the run ended, in words
    threshold: float  # γ (N)
    agents: FaceAgents  # Those that spawned
    boundary: BoundaryAgents  # Supports and air that loads have reached
    history: tuple[StepRecord, ...]  # How things stood after every step
    ledger: PushLedger  # The account of every newton
    certificate: WaveCertificate | None  # Of waves, before the run
    moments: Moments  # What was left on agents, and what they had taken, on the way
    seconds: float  # Time that the run took (s)

    stage = property(lambda run: run.result.stage, doc="Stage of loading; None is the last.")

    def __post_init__(self) -> None:
        beyond = np.asarray(self.grid.lattice.shape)
        if np.any(self.boundary.cells > beyond):
            raise ResultError("'boundary.cells' must lie in the grid, or beside it")

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
    def displacement(self) -> tuple[Floats, ...]:
        """Per axis the displacement (m) of the faces normal to it; NaN where there is no body."""
        found = cast(CellAgents, self.result.found)
        return tuple(found.scales.displacement * values for values in found.face_displacement)

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
        lost = not_balanced(f"{len(self.history)} steps", self.ledger.imbalance)
        kept = all(check.holds for check in self.checks())
        return (*([] if kept else [lost]), *idle_rheology(self.scene))

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
