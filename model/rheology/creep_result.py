"""Where a creeping body stands, to be taken up again, and what it went through."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats
from kaju.errors import ResultError
from kaju.model.results.archive import Archive, open_archive, plain_of, reading, write_archive
from kaju.model.results.formats import COURSE, CREEP_STATE, ELEMENT_IN_TIME
from kaju.model.results.result import ROUNDING, BodyResult, Check, Curves, Result
from kaju.model.scene import Scene

if TYPE_CHECKING:
    import pandas


STATE = "state in time"


@dataclass(frozen=True, eq=False)
class CreepState:
    """Everything that a run needs to go on from a moment as if it had never paused."""

    fields: tuple[Floats, ...]  # stretches of the parts of every element, positions, velocities
    time: float = 0.0  # the moment (s)
    next_step: float = 0.0  # to be tried next when a tolerance is kept (s); 0 before the first
    # Largest stretch so far (m, or strain), to which the tolerance refers; at first, that of one
    # step over the first piece of the history.
    scale: float = 0.0
    error_estimate: float = 0.0  # sum of the estimated errors of all steps, in units of the stretch
    work: float = 0.0  # done from outside since time 0 (J)
    dissipated: float = 0.0  # into the dampers (J)
    numerical: float = 0.0  # of the work, in neither springs nor dampers (J)
    steps: int = 0
    rejected: int = 0  # steps that were made again because they missed the tolerance
    at_jumps: float = 0.0  # part of `numerical` of steps that take up a jump (J)

    def save(self, path: str | Path) -> Path:
        """Write the state to one ``.npz`` file, whole or not at all."""
        arrays = {f"field{i}": part for i, part in enumerate(self.fields)}
        numbers = {name: np.asarray(getattr(self, name)) for name in CREEP_STATE}
        return write_archive(path, STATE, arrays | numbers, {})

    @classmethod
    def load(cls, path: str | Path) -> CreepState:
        """Read a state that `save` wrote."""
        archive = open_archive(path, STATE)
        with reading(path):
            count = len(archive.part("field"))
            fields = tuple(archive.array(f"field{i}", "f", None) for i in range(count))
            numbers = archive.columns(CREEP_STATE, {})
            return cls(fields, **{name: value.item() for name, value in numbers.items()})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TimeResult(Result):
    """What every run in time returns, at the times asked for."""

    kind: ClassVar[str]
    times: Floats
    factors: Floats
    """Times asked for (s) and the factor of the history there (at a jump, before it). Shape
    (k,)."""
    work: Floats
    stored: Floats
    dissipated: Floats
    numerical: Floats
    """Since time 0 (J): work from outside; energy that springs can give back;
    energy that went into the dampers, never falling; and what is neither. ``work = stored +
    dissipated + numerical`` but for rounding. Shape (k,)."""
    at_jumps: Floats
    """What of `numerical` (J) was set free where the load jumps. A load that is put on at once does
    twice the work that a spring can store; what no damper beside the spring takes up of it is set
    in motion in nature, and here has no place to go. A ramp leaves it out. The rest of `numerical`
    is the time stepping's own, and vanishes with the step. Shape (k,)."""
    state: CreepState
    """Where the run stands at the last of the times; give it to `creep` as ``resume``. Also has the
    number of steps and the sum of the estimated errors."""
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

    @abstractmethod
    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return what is stored besides the course itself: arrays, and plain values."""

    @classmethod
    @abstractmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        """Return the fields that `_own` took apart."""

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
            "steps": self.state.steps,
            "steps_rejected": self.state.rejected,
            "max_displacement": float(np.abs(moved).max(initial=0.0)),
            "displacement_that_stays": self.what_stays(),
            f"largest_{carried.title.lower()}_{carried.unit}": float(np.abs(force).max(initial=0)),
            f"{carried.title.lower()}_at_the_end_{carried.unit}": float(force[-1]),
            "work_J": float(self.work[-1]),
            "stored_J": float(self.stored[-1]),
            "dissipated_J": float(self.dissipated[-1]),
            "set_free_at_jumps_J": float(self.at_jumps[-1]),
            "numerical_J": float(self.numerical[-1] - self.at_jumps[-1]),
            "error_estimate": self.state.error_estimate,
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

    def _stored(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, about = self._own()
        arrays |= {f"course.{name}": getattr(self, name) for name in COURSE}
        arrays |= {f"state.{i}": part for i, part in enumerate(self.state.fields)}
        course = {"course_seconds": self.seconds, "course_notes": self.notes}
        return arrays, {**about, **course, "state": plain_of(self.state)}

    @classmethod
    def _restored(cls, archive: Archive) -> Self:
        course = archive.columns(COURSE, {}, "course.")
        if "at_jumps" not in course:  # written before it was kept apart
            course["at_jumps"] = np.zeros_like(course["times"])
            archive.value("state", dict[str, Any]).setdefault("at_jumps", 0.0)
        count = len(archive.part("state."))
        fields = tuple(archive.array(f"state.{i}", "f", None) for i in range(count))
        state = CreepState(fields, **archive.record("state", CreepState))
        archive.about.setdefault("course_notes", [])  # written before there were notes
        return cls(
            **course,
            state=state,
            seconds=archive.value("course_seconds", float),
            notes=tuple(archive.value("course_notes", list[str])),
            **cls._from_own(archive),
        )

    def record_at(self, time: float) -> int:
        """Return the index of a time asked for."""
        index = int(np.argmin(np.abs(self.times - time)))
        if not np.isclose(self.times[index], time, rtol=1e-9, atol=1e-12 * self.times[-1]):
            raise ResultError(
                f"time: {time} s was not asked for; the nearest is {self.times[index]} s "
                "(give creep(times=...) the times that matter)"
            )
        return index


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BodyTimeResult(TimeResult):
    """What became of the body of a scene in time."""

    static: BodyResult  # the same scene without time, at a factor of 1
    _static: ClassVar[type[BodyResult]]

    @property
    def scene(self) -> Scene:
        """What was asked."""
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
    def _sizes(self, record: int) -> Floats:
        """Return how far cells or agents have moved (m)."""

    def largest_displacement(self) -> Floats:
        """Return how far the cell that has moved most has moved (m), at every time."""
        sizes = [self._sizes(record) for record in range(len(self.times))]
        return np.array([np.nanmax(size, initial=0.0) for size in sizes])

    def largest_force(self) -> Curves:
        """Return the largest stress of a cell over time, by the size of its components."""
        sizes = [np.abs(self.stress(record)) for record in range(len(self.times))]
        largest = np.array([np.nanmax(size, initial=0.0) for size in sizes])
        return Curves("Stress", "time", "s", self.times, {"largest stress": largest}, "Pa")

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        text, scene_arrays = self.scene.to_archive()
        arrays, about = self.static._archive()
        parts = {f"static.{name}": values for name, values in arrays.items()}
        parts |= {f"scene.{name}": values for name, values in scene_arrays.items()}
        about = {**about, "seconds": self.static.seconds}
        return parts, {"scene": text, "static": about}

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        scene = Scene.from_archive(archive.value("scene", str), archive.part("scene."))
        about = {**archive.value("static", dict[str, Any]), "kind": cls._static.kind}
        static = Archive(archive.path, archive.part("static."), about)
        return {"static": cls._static._from_archive(scene, static)}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class CreepResult(TimeResult):
    """What became of an element in time."""

    kind: ClassVar[str] = "element in time"
    displacement: Floats
    """Elongation (m). Shape (k,)."""
    force: Floats
    """Force (N). Shape (k,)."""

    def largest_displacement(self) -> Floats:
        """Return the elongation (m) at every time."""
        return self.displacement

    def largest_force(self) -> Curves:
        """Return the force (N) over time."""
        return Curves("Force", "time", "s", self.times, {"force": self.force}, "N")

    def _own(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        return {"displacement": self.displacement, "force": self.force}, {}

    @classmethod
    def _from_own(cls, archive: Archive) -> dict[str, Any]:
        return archive.columns(ELEMENT_IN_TIME, times_of(archive))


def times_of(archive: Archive) -> dict[str, int]:
    """Return how many times were asked for, which all arrays of a course share."""
    return {"times": len(archive.arrays["course.times"])}
