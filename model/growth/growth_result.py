"""What growing a body returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints, spread
from kaju.errors import ResultError, require
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.solve import solve_cells
from kaju.model.results.cuts import Carrying
from kaju.model.results.result import BOOKS, BodyResult, Check
from kaju.model.results.stored import Column
from kaju.model.scene import Scene

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False, repr=False)
class GrowthResult(BodyResult):
    """A body that has grown: densities and compliance, step by step.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml")
    >>> grown = kaju.GrowthModel(scene, rule="stress", volume=0.5).run(10)
    >>> grown.history.columns.tolist()
    ['step', 'compliance_J', 'volume', 'change', 'iterations']
    >>> round(grown.answer.strain_energy * 2.0 / grown.compliance, 6)  # of the last design
    1.0
    """

    kind: ClassVar[str] = "growth"
    name: ClassVar[str] = "growth"
    scene: Scene
    """The scene that was computed."""
    stage: int | None
    """Stage of loading; None is the last."""
    rule: str
    """Name of the rule; "own" of one of your own."""
    cells: Annotated[Floats, Column("agents", 0.0, 1.0)]
    """Density from 0 to 1 of each cell of material, row by row. Shape (n,)."""
    stiffness_of_cells: Annotated[Floats, Column("agents", 0.0, 1.0)]
    """Stiffness of each as a share of its material's. Shape (n,)."""
    designs: Annotated[NDArray[np.float32], Column("steps agents", 0.0, 1.0)]
    """Densities at first and after every step, in single precision. Shape (steps + 1, n)."""
    pulled: Annotated[Flags, Column("steps agents")]
    """Whether a cell is pulled more than pressed, so that it grows. Shape (steps + 1, n)."""
    compliances: Annotated[Floats, Column("steps", 0.0)]
    """Work of the forces F·u (J). Shape (steps + 1,)."""
    volumes: Annotated[Floats, Column("steps", 0.0, 1.0)]
    """Mean density. Shape (steps + 1,)."""
    changes: Annotated[Floats, Column("steps", 0.0, 1.0)]
    """Largest change of a density. Shape (steps + 1,)."""
    iterations: Annotated[Ints, Column("steps", 0)]
    """That the equations took. Shape (steps + 1,)."""
    volume: float
    """Share of the body's volume that was asked for."""
    holds_volume: bool
    """Whether the rule keeps it."""
    filter_radius: float
    """In cells."""
    outcome: str
    """Why growth ended; "" if nobody asked."""
    seconds: float
    """Time that the computation took (s)."""

    def __post_init__(self) -> None:
        self.scene.applied(self.stage)  # refuses a stage that there is not
        if np.count_nonzero(self.body) != len(self.cells):
            raise ResultError("'cells' must hold one density for each cell of material")
        if not len(self.compliances):
            raise ResultError("'compliances' must be of one step or more")

    @cached_property
    def body(self) -> Flags:
        """Which of the scene's cells are of material, in the shape of the array."""
        return np.asarray(self.scene.rasterise() >= 0)

    def spread(self, values: Floats) -> Floats:
        """Return values of the cells of material in the shape of the scene's cells; 0 elsewhere."""
        return spread(values, self.body)

    @property
    def density(self) -> Floats:
        """Densities in the shape of the scene's cells; 0 where there is no material."""
        return self.spread(self.cells)

    @property
    def stiffness(self) -> Floats:
        """Shares of the materials' stiffness in the shape of the scene's cells, for `solve`."""
        return self.spread(self.stiffness_of_cells)

    @property
    def compliance(self) -> float:
        """F·u of the last design: work of the forces on the displacements (J)."""
        return float(self.compliances[-1])

    @property
    def pulled_shares(self) -> Floats:
        """Share of the material that is pulled, at first and after every step."""
        return np.asarray((self.pulled * self.designs).sum(axis=1) / self.designs.sum(axis=1))

    @property
    def grey(self) -> float:
        """Mean of 4 ρ (1 - ρ): 0 where every cell is full or empty, 1 where all are half full."""
        return float(4.0 * (self.cells * (1.0 - self.cells)).mean())

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.compliances) - 1

    @cached_property
    def answer(self) -> ElasticResult:
        """The last design, solved anew and exactly, with bounds of its error."""
        return solve_cells(self.scene, stiffness=self.stiffness, stage=self.stage)

    def density_at(self, step: int | None = None) -> Floats:
        """Return the densities of the cells of material after a step, from 0; none: the last."""
        if step is None:
            return self.cells
        require(0 <= step <= self.steps, f"step: 0 to {self.steps}, got {step}")
        return np.asarray(self.designs[step], dtype=np.float64)

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) of the last design, at points (m)."""
        return self.answer.displacement_at(points)

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) of the last design, at points (m)."""
        return self.answer.stress_at(points)

    def _carrying(self, axis: int) -> Carrying:
        return self.answer._carrying(axis)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per step, the start included: compliance, volume, change, iterations."""
        import pandas

        columns = {"step": np.arange(self.steps + 1), "compliance_J": self.compliances}
        columns |= {"volume": self.volumes, "change": self.changes}
        return pandas.DataFrame(columns | {"iterations": self.iterations})

    history = property(to_dataframe)

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        total = np.linalg.norm(self.scene.applied(self.stage).force, axis=1).sum()
        notes = self.scene.notes_on(self.compliance / float(total))  # displaced by so much at least
        return {
            "model": "growth",
            "kaju_version": __version__,
            "rule": self.rule,
            "cells": len(self.cells),
            "filter_radius": self.filter_radius,
            "volume_asked": self.volume,
            "volume": float(self.volumes[-1]),
            "steps": self.steps,
            "compliance_J": self.compliance,
            "compliance_at_first_J": float(self.compliances[0]),
            "grey": self.grey,
            "largest_change": float(self.changes[-1]),
            "outcome": self.outcome,
            "seconds": self.seconds,
        } | ({"notes": list(notes)} if notes else {})

    def checks(self) -> list[Check]:
        """Return whether every step has the volume asked for, if the rule keeps it."""
        if not self.holds_volume:
            return []
        off = float(np.abs(self.volumes[1:] / self.volume - 1.0).max(initial=0.0))
        return [Check("the volume is held", off, BOOKS)]
