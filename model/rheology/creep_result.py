"""What became in time of an element, and what all runs in time return."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from kaju import __version__
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.results.result import ROUNDING, BodyResult, Check, Curves, Result
from kaju.model.results.stored import Column
from kaju.model.scene import Scene

if TYPE_CHECKING:
    import pandas

OfTimes = Annotated[Floats, Column("times")]
"""One number for each of the times asked for."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TimeResult(Result):
    """What every run in time returns, at the times asked for."""

    kind: ClassVar[str]
    times: Annotated[Floats, Column("times", 0.0, order="rising")]
    factors: OfTimes
    """Times asked for (s) and the factor of the history there (at a jump, before it). Shape
    (k,)."""
    work: OfTimes
    stored: OfTimes
    dissipated: OfTimes
    numerical: OfTimes
    """Since time 0 (J): work from outside; energy that springs can give back;
    energy that went into the dampers, never falling; and what is neither. ``work = stored +
    dissipated + numerical`` but for rounding. Shape (k,)."""
    at_jumps: OfTimes
    """What of `numerical` (J) was set free where the load jumps. A load that is put on at once does
    twice the work that a spring can store; what no damper beside the spring takes up of it is set
    in motion in nature, and here has no place to go. A ramp leaves it out. The rest of `numerical`
    is the time stepping's own, and vanishes with the step. Shape (k,)."""
    steps: int
    """Number of time steps."""
    steps_rejected: int
    """Steps that were made again, shorter, because they missed the tolerance."""
    error_estimate: float
    """Sum of the estimated errors of all steps, as a share of the largest stretch."""
    seconds: float = 0.0
    """Time that the computation took (s)."""
    notes: tuple[str, ...] = ()
    """What a reader of the figures should know, in words."""

    @abstractmethod
    def largest_displacement(self) -> Floats:
        """Return how far what moves most has moved (m) at every time, shape (k,)."""

    @abstractmethod
    def largest_force(self) -> Curves:
        """Return the curve of what carries the load: a force (N) or a stress (Pa)."""

    def curves(self) -> list[Curves]:
        """Return displacement, force or stress, the history, and the energies over time."""
        time = ("time", "s", self.times)
        energies = {
            "work from outside": self.work,
            "stored": self.stored,
            "turned to heat": self.dissipated,
            "set free at jumps": self.at_jumps,
            "time stepping": self.numerical - self.at_jumps,
        }
        return [
            Curves("Displacement", *time, {"displacement": self.largest_displacement()}, "m"),
            self.largest_force(),
            Curves("History", *time, {"factor": self.factors}, ""),
            Curves("Energies", *time, energies, "J"),
        ]

    def what_stays(self) -> float | None:
        """Return the displacement (m) that is left at the end; None while anything acts."""
        return None if self.factors[-1] else float(self.largest_displacement()[-1])

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        moved, carried = self.largest_displacement(), self.largest_force()
        force = next(iter(carried.lines.values()))
        return {
            "model": self.kind,
            "duration": float(self.times[-1]),
            "times": len(self.times),
            "steps": self.steps,
            "steps_rejected": self.steps_rejected,
            "max_displacement": float(np.abs(moved).max(initial=0.0)),
            "displacement_left": self.what_stays(),
            f"largest_{carried.title.lower()}_{carried.unit}": float(np.abs(force).max(initial=0)),
            f"{carried.title.lower()}_at_the_end_{carried.unit}": float(force[-1]),
            "work_J": float(self.work[-1]),
            "stored_J": float(self.stored[-1]),
            "dissipated_J": float(self.dissipated[-1]),
            "set_free_at_jumps_J": float(self.at_jumps[-1]),
            "numerical_J": float(self.numerical[-1] - self.at_jumps[-1]),
            "error_estimate": self.error_estimate,
            "seconds": self.seconds,
            "kaju_version": __version__,
        } | ({"notes": list(self.notes)} if self.notes else {})

    def checks(self) -> list[Check]:
        """Return whether the work done is stored, turned to heat, or named as neither."""
        gap = np.abs(self.work - self.stored - self.dissipated - self.numerical)
        turned = np.abs([self.work, self.stored, self.dissipated, self.numerical]).max()
        off = float(gap.max() / turned) if turned > 0.0 else 0.0
        return [Check("the work done is accounted for", off, ROUNDING)]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per time asked for: what the curves show."""
        import pandas as pd

        columns: dict[str, Any] = {"time_s": self.times, "factor": self.factors}
        for curves in self.curves():
            for name, values in curves.lines.items() if curves.unit else ():
                columns[f"{name.replace(' ', '_')}_{curves.unit}"] = values
        return pd.DataFrame(columns)

    def record_at(self, time: float) -> int:
        """Return the index of a time asked for."""
        index = int(np.argmin(np.abs(self.times - time)))
        if abs(self.times[index] - time) > 1e-9 * max(time, self.times[0]):
            raise ResultError(
                f"time: {time} s was not asked for; the nearest is {self.times[index]} s "
                "(give creep(times=...) the times that matter)"
            )
        return index


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BodyTimeResult(TimeResult):
    """What became of the body of a scene in time."""

    static: BodyResult  # the same scene without time, at a factor of 1

    @property
    def scene(self) -> Scene:
        """The scene that was computed."""
        return self.static.scene

    @property
    def grid(self) -> Scene:
        """The scene on the cells that the fields belong to."""
        return self.static.grid

    @abstractmethod
    def displacement_at(self, points: Floats, record: int = -1) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""

    @abstractmethod
    def stress(self, record: int = -1) -> Floats:
        """Return stress tensors (Pa), shape (..., dimension, dimension)."""

    @abstractmethod
    def max_displacement(self, record: int = -1) -> float:
        """Return how far the point has moved that has moved most (m)."""

    def largest_displacement(self) -> Floats:
        """Return how far the point that has moved most has moved (m), at every time."""
        return np.array([self.max_displacement(record) for record in range(len(self.times))])

    def largest_force(self) -> Curves:
        """Return the largest stress of a cell over time, by the size of its components."""
        sizes = [np.abs(self.stress(record)) for record in range(len(self.times))]
        largest = np.array([np.nanmax(size, initial=0.0) for size in sizes])
        return Curves("Stress", "time", "s", self.times, {"largest stress": largest}, "Pa")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CreepResult(TimeResult):
    """What became of an element in time."""

    kind: ClassVar[str] = "element in time"
    displacement: OfTimes
    """Elongation (m). Shape (k,)."""
    force: OfTimes
    """Force (N). Shape (k,)."""

    def largest_displacement(self) -> Floats:
        """Return the elongation (m) at every time."""
        return self.displacement

    def largest_force(self) -> Curves:
        """Return the force (N) over time."""
        return Curves("Force", "time", "s", self.times, {"force": self.force}, "N")
