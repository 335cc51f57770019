"""How a load or a displacement changes in time: ramps, holds, releases and cycles in a row.

A `History` is a chain of straight pieces. Its value is a factor without unit: whatever it drives
(the forces and given displacements of a network, the loads of a scene, the force on one element) is
multiplied by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import require


@dataclass(frozen=True)
class History:
    """A factor over time, linear between its corners.

    It is 0 up to time 0, where it may jump, and keeps its last factor for ever. Two corners at one
    time are a jump; exactly there it has the factor *before* the jump.

    Raises
    ------
    ParameterError
        If the times fall, do not start at 0, or a number is not finite.

    Examples
    --------
    >>> from kaju import History
    >>> pressed = History().ramp(to=1.0, duration=2.0).hold(3.0).release()
    >>> pressed.at([1.0, 4.0, 6.0]).tolist()
    [0.5, 1.0, 0.0]
    """

    times: tuple[float, ...] = (0.0,)
    """Times of the corners (s), in order, the first 0."""
    factors: tuple[float, ...] = (0.0,)
    """Factor at each corner."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", tuple(float(time) for time in self.times))
        object.__setattr__(self, "factors", tuple(float(factor) for factor in self.factors))
        count = len(self.times)
        require(
            0 < count == len(self.factors),
            f"history: {count} times need as many factors (at least one), got {len(self.factors)}",
        )
        finite = all(isfinite(number) for number in (*self.times, *self.factors))
        require(finite, "history: every time and factor must be a finite number")
        require(
            self.times[0] == 0.0 and bool(np.all(np.diff(self.times) >= 0.0)),
            f"history: times must start at 0 and never fall, got {self.times}; a jump is written "
            "as the same time twice",
        )

    @classmethod
    def step(cls, factor: float = 1.0) -> History:
        """Jump to `factor` at time 0 and stay there."""
        return cls((0.0, 0.0), (0.0, factor))

    @property
    def duration(self) -> float:
        """Time of the last corner (s)."""
        return self.times[-1]

    def ramp(self, to: float, duration: float) -> History:
        """Go on in a straight line to the factor `to`; duration 0 is a jump."""
        lasts = isfinite(duration) and duration >= 0.0
        require(lasts, f"duration: must be a time from 0 s upwards, got {duration}")
        return History((*self.times, self.duration + duration), (*self.factors, float(to)))

    def hold(self, duration: float) -> History:
        """Keep the last factor."""
        return self.ramp(self.factors[-1], duration)

    def release(self, duration: float = 0.0) -> History:
        """Go back to 0, at once by default."""
        return self.ramp(0.0, duration)

    def cycles(self, count: int, period: float, high: float = 1.0, low: float = 0.0) -> History:
        """Rise to `high` and fall to `low`, `count` times, half a period each way."""
        # Each takes some 50 steps: so many of a spring network of 23 nodes take minutes.
        few = count in range(1, 10_001)
        require(few, f"cycles: a whole number from 1 to 10,000 is needed, got {count}")
        lasts = isfinite(period) and period >= 0.0
        require(lasts, f"period: must be a time from 0 s upwards, got {period}")
        turns = self.duration + 0.5 * period * np.arange(1, 2 * count + 1)
        return History((*self.times, *turns.tolist()), (*self.factors, *((high, low) * int(count))))

    def scaled(self, factor: float) -> History:
        """Multiply all factors."""
        return History(self.times, tuple(factor * value for value in self.factors))

    def at(self, times: ArrayLike) -> Floats:
        """Return the factor at each of `times`; at a jump, the one before it."""
        return self._value(times, "left")

    def after(self, times: ArrayLike) -> Floats:
        """Return the factor right after each of `times`; at a jump, the one it jumps to."""
        return self._value(times, "right")

    def _value(self, times: ArrayLike, side: Literal["left", "right"]) -> Floats:
        asked = np.asarray(times, dtype=np.float64)
        corners = np.array((0.0, *self.times))
        factors = np.array((0.0, *self.factors))
        # The first corner that is not before the time asked for ends the piece it lies on.
        end = np.searchsorted(corners, asked, side=side)
        right = np.clip(end, 1, len(corners) - 1)
        length = corners[right] - corners[right - 1]
        share = np.divide(
            asked - corners[right - 1], length, out=np.zeros_like(asked), where=length > 0.0
        )
        inside = factors[right - 1] + share * (factors[right] - factors[right - 1])
        values = np.where(end == len(corners), factors[-1], inside)
        return np.asarray(np.where(end == 0, 0.0, values))

    def corners(self) -> tuple[Floats, Floats, Floats]:
        """Return the times of the corners, and how much factor and slope change there.

        These jumps and bends superpose to the history.
        """
        times, first, count = np.unique(self.times, return_index=True, return_counts=True)
        factors = np.array(self.factors)
        before, after = factors[first], factors[first + count - 1]
        slopes = (before[1:] - after[:-1]) / np.diff(times)
        before[0] = 0.0
        return times, after - before, np.diff(slopes, prepend=0.0, append=0.0)
