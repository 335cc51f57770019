"""Where a creeping body stands, to be taken up again, and what it went through."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ResultError, ResultFileError
from kaju.files import scratch_beside

Floats = NDArray[np.float64]

_NUMBERS = (
    "time",
    "next_step",
    "scale",
    "error_estimate",
    "work",
    "dissipated",
    "numerical",
    "steps",
    "rejected",
)


@dataclass(frozen=True, eq=False)
class CreepState:
    """Everything that a run needs to go on from a moment as if it had never paused.

    Attributes
    ----------
    fields : tuple of numpy.ndarray
        What creeps: stretches of the parts of every element, positions, velocities.
    time : float
        The moment (s).
    next_step : float
        Step to be tried next when a tolerance is kept (s); 0 before the first.
    scale : float
        Largest stretch so far (m, or strain), to which the tolerance refers; at first, what
        one step over the first piece of the history leads to.
    error_estimate : float
        Sum of the estimated errors of all steps, in units of the stretch.
    work, dissipated, numerical : float
        Work done from outside, energy that went into the dampers, and the scheme's own part
        (J), since time 0.
    steps, rejected : int
        Steps made, and steps that were made again because they missed the tolerance.
    """

    fields: tuple[Floats, ...]
    time: float = 0.0
    next_step: float = 0.0
    scale: float = 0.0
    error_estimate: float = 0.0
    work: float = 0.0
    dissipated: float = 0.0
    numerical: float = 0.0
    steps: int = 0
    rejected: int = 0

    def moved(
        self, time: float, fields: tuple[Floats, ...], booked: Floats, scale: float
    ) -> CreepState:
        """Return the state one step later; `booked` is work, dissipation, scheme's own."""
        work, dissipated, numerical = (float(energy) for energy in booked)
        return replace(
            self,
            fields=fields,
            time=time,
            scale=scale,
            work=self.work + work,
            dissipated=self.dissipated + dissipated,
            numerical=self.numerical + numerical,
            steps=self.steps + 1,
        )

    def save(self, path: str | Path) -> Path:
        """Write the state to one ``.npz`` file, whole or not at all."""
        target = Path(path)
        arrays = {f"field{i}": part for i, part in enumerate(self.fields)}
        numbers = {name: np.asarray(getattr(self, name)) for name in _NUMBERS}
        with scratch_beside(target, ResultFileError) as scratch, scratch.open("wb") as file:
            np.savez(file, **arrays, **numbers)  # type: ignore[arg-type]
        return target

    @classmethod
    def load(cls, path: str | Path) -> CreepState:
        """Read a state that `save` wrote."""
        try:
            with np.load(Path(path), allow_pickle=False) as file:
                count = sum(name.startswith("field") for name in file.files)
                fields = tuple(file[f"field{i}"] for i in range(count))
                numbers = {name: file[name].item() for name in _NUMBERS}
        except (OSError, KeyError, ValueError, BadZipFile, EOFError) as error:
            raise ResultFileError(
                f"creep state: {path} is not a file that CreepState.save wrote ({error})"
            ) from error
        return cls(fields, **numbers)


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """What every run in time returns, at the times asked for.

    Attributes
    ----------
    times, factors : (k,) floats
        Times asked for (s) and the factor of the history there (at a jump, before it).
    work, stored, dissipated, numerical : (k,) floats
        Since time 0 (J): work from outside; energy that springs (and moving masses) can give
        back; energy that went into the dampers, never falling; and what the time stepping
        itself makes of energy, which vanishes with the step. ``work = stored + dissipated +
        numerical`` but for rounding.
    state : CreepState
        Where the run stands at the last of the times; give it to `creep` as ``resume``. Also
        has the number of steps and the sum of the estimated errors.
    """

    times: Floats
    factors: Floats
    work: Floats
    stored: Floats
    dissipated: Floats
    numerical: Floats
    state: CreepState

    def record_at(self, time: float) -> int:
        """Return the index of a time asked for.

        Raises
        ------
        ResultError
            If it was not asked for.
        """
        index = int(np.argmin(np.abs(self.times - time)))
        if not np.isclose(self.times[index], time, rtol=1e-9, atol=1e-12 * self.times[-1]):
            raise ResultError(
                f"time: {time} s was not asked for; the nearest is {self.times[index]} s "
                "(give creep(times=...) the times that matter)"
            )
        return index


@dataclass(frozen=True, eq=False, kw_only=True)
class CreepResult(Course):
    """What became of an element in time.

    Attributes
    ----------
    displacement : (k,) floats
        Elongation (m).
    force : (k,) floats
        Force (N).
    """

    displacement: Floats
    force: Floats
