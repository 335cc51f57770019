"""Histories as scenes write them: ``[history]`` with corners, or with steps one after another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from kaju.agents.history import History
from kaju.errors import ParameterError

from .described import Count, Described, Number

_WORDS = ("ramp", "hold", "release", "cycles")


class HistoryStep(Described):
    """A step of a history, in one of four words.

    ``{ramp = 1.0, duration = 0.2}``, ``{hold = 5.0}``, ``{release = 0.1}``, or
    ``{cycles = 3, period = 0.6}``.

    Parameters
    ----------
    ramp : float, optional
        The factor to go to in a straight line, within `duration`.
    hold : float, optional
        How long the factor is kept (s).
    release : float, optional
        Within which time it goes back to 0 (s); 0 is at once.
    cycles : int, optional
        How often it rises to `high` and falls to `low`, each time within `period`.
    duration, period, high, low : float
        As above.
    """

    ramp: Number | None = Field(default=None, description="the factor to go to")
    hold: Number | None = Field(default=None, description="how long the factor is kept (s)")
    release: Number | None = Field(default=None, description="the time to go back to 0 in (s)")
    cycles: Count | None = Field(default=None, description="how often it rises and falls")
    duration: Number | None = Field(default=None, description="how long a ramp takes (s)")
    period: Number | None = Field(default=None, description="how long a cycle takes (s)")
    high: Number = Field(default=1.0, description="the factor at the top of a cycle")
    low: Number = Field(default=0.0, description="the factor at the bottom of a cycle")

    @model_validator(mode="after")
    def _one_word(self) -> HistoryStep:
        given = [word for word in _WORDS if getattr(self, word) is not None]
        if len(given) != 1:
            raise ParameterError(
                f"ramp: a step is one of {', '.join(_WORDS)}; got {', '.join(given) or 'none'}"
            )
        if (self.cycles is not None) != (self.period is not None):
            raise ParameterError("period: belongs to cycles, and cycles need it")
        if self.duration is not None and self.ramp is None:
            raise ParameterError("duration: belongs to a ramp; hold and release are times already")
        return self

    def after(self, history: History) -> History:
        """Return a history that goes on with this step."""
        if self.ramp is not None:
            return history.ramp(self.ramp, self.duration or 0.0)
        if self.hold is not None:
            return history.hold(self.hold)
        if self.release is not None:
            return history.release(self.release)
        assert self.cycles is not None
        assert self.period is not None
        return history.cycles(self.cycles, self.period, self.high, self.low)


class HistoryTable(Described):
    """``[history]``: ``times`` and ``factors`` of its corners, or ``steps``."""

    times: tuple[Number, ...] | None = Field(
        default=None, description="the times of the corners (s), the first 0"
    )
    factors: tuple[Number, ...] | None = Field(
        default=None, description="the factor at each corner"
    )
    steps: tuple[HistoryStep, ...] | None = Field(
        default=None, description="a list such as [{ramp = 1.0, duration = 0.2}, {hold = 5.0}]"
    )

    def build(self) -> History:
        """Return the history, which refuses what is out of its range."""
        if (self.steps is None) == (self.times is None) or (self.times is None) != (
            self.factors is None
        ):
            raise ParameterError("times: give either times and factors, or steps")
        if self.steps is None:
            assert self.times is not None
            assert self.factors is not None
            return History(self.times, self.factors)
        history = History()
        for step in self.steps:
            history = step.after(history)
        return history


def history_from(value: Any) -> Any:
    """Return the history that a table describes; a history is returned as it is."""
    if isinstance(value, History):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a table of times and factors, or of steps, got {value!r}")
    return HistoryTable.model_validate(value).build()
