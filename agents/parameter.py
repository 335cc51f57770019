"""What a class of agents declares: numbers to turn (`Parameter`), what agents know (`State`)."""

from __future__ import annotations

from math import isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

import numpy as np

from kaju.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable


class Parameter:
    """A number that all agents of a class share, and that is given to the model.

    Declared on the class, it is a keyword of `LoadModel`, a column of its data, a line in the
    summary of its results, and a slider. Agents read it as an attribute.

    Parameters
    ----------
    default : int, float or bool
        Its value, unless the model gets another. If it is a whole number, all values must be.
    low, high : int or float, optional
        The smallest and the largest value; not needed for a bool.
    text : str
        What it means, with its unit: the label of the slider.

    Raises
    ------
    ParameterError
        If the bounds are missing or do not enclose the default.

    Examples
    --------
    >>> import kaju
    >>> class Tired(kaju.MaterialAgent):
    ...     wear = kaju.Parameter(0.05, 0.0, 1.0, "softening by each load")
    ...     def shortening(self, axis):
    ...         return (1.0 + self.wear) * super().shortening(axis)
    >>> kaju.LoadModel.sliders(Tired)["wear"]["max"]
    1.0
    """

    def __init__(
        self,
        default: float,
        low: float | None = None,
        high: float | None = None,
        text: str = "",
    ) -> None:
        self.name = "parameter"
        self.default, self.low, self.high, self.text = default, low, high, text
        if isinstance(default, bool):
            return
        if low is None or high is None:
            raise ParameterError(
                f"low, high: a Parameter needs both bounds, as in Parameter({default!r}, 0, 10, "
                f'"what it means"), got {low!r} and {high!r}'
            )
        self.checked(default)

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, agent: None, owner: type) -> Self: ...
    @overload
    def __get__(self, agent: object, owner: type) -> Any: ...
    def __get__(self, agent: Any, owner: type) -> Any:
        return self if agent is None else agent.model.parameters[self.name]

    def __set__(self, agent: object, value: object) -> None:
        raise ParameterError(
            f"{self.name}: is a Parameter, one number for all agents, and cannot be set on one "
            f"of them; give it to the model, LoadModel(scene, {self.name}=...), or choose "
            "another name for the value of a single agent"
        )

    @property
    def whole(self) -> bool:
        """Whether only whole numbers will do."""
        return all(isinstance(value, Integral) for value in (self.default, self.low, self.high))

    def checked(self, value: Any) -> Any:
        """Return a value that the rule allows.

        Raises
        ------
        ParameterError
            If it is no number, not whole, or outside the bounds.
        """
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise ParameterError(f"{self.name}: must be True or False, got {value!r}")
            return value
        assert self.low is not None
        assert self.high is not None
        kind = "whole number" if self.whole else "number"
        number = isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
        fits = number and (not self.whole or value == int(value)) and self.low <= value <= self.high
        if not fits:
            raise ParameterError(
                f"{self.name}: must be a {kind} from {self.low} to {self.high}"
                f"{f' ({self.text})' if self.text else ''}, got {value!r}"
            )
        return int(value) if self.whole else float(value)

    def slider(self) -> dict[str, Any]:
        """Return what Mesa's SolaraViz takes for it among its `model_params`."""
        label = self.text or self.name
        if isinstance(self.default, bool):
            return {"type": "Checkbox", "value": self.default, "label": label}
        assert self.low is not None
        assert self.high is not None
        step = 1 if self.whole else (self.high - self.low) / 100.0 or 1.0
        ends = {"min": self.low, "max": self.high, "step": step}
        kind = "SliderInt" if self.whole else "SliderFloat"
        return {"type": kind, "value": self.default, "label": label, **ends}


class State:
    """What each agent of a class remembers; pictures, films, tables and stored results show it.

    Declared on the class, it is an attribute of every agent, each with its own value. The result
    keeps the values of every generation.

    Parameters
    ----------
    default : bool, int or float
        Its value when an agent wakes.
    meaning : str
        What it means, with its unit: the label of its colours.

    Raises
    ------
    ParameterError
        If the default is not a finite number.

    Examples
    --------
    >>> import kaju
    >>> class Breaking(kaju.MaterialAgent):
    ...     broken = kaju.State(False, "passes nothing on")
    ...     def pass_on(self, load):
    ...         self.broken = self.broken or load.total > 1.5
    ...         if not self.broken:
    ...             super().pass_on(load)
    >>> plate = kaju.Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> result = kaju.LoadModel(plate, material_agent=Breaking).run()
    >>> result.states["broken"].values().tolist()
    [True]
    """

    name = ""

    def __init__(self, default: Any, meaning: str = "") -> None:
        self.default, self.meaning = default, meaning
        if not is_number(default):
            raise ParameterError(
                f"State: its default must be a number, True or False, got {default!r:.60}"
            )

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, agent: None, owner: type) -> Self: ...
    @overload
    def __get__(self, agent: object, owner: type) -> Any: ...
    def __get__(self, agent: Any, owner: type) -> Any:
        return self if agent is None else self.default  # an agent's own value stands before it

    def allows(self, value: Any) -> bool:
        """Tell whether a value is of the kind of the default."""
        return is_number(value) and isinstance(self.default, bool) == isinstance(
            value, bool | np.bool_
        )


def is_number(value: object) -> bool:
    """Tell whether a value is a finite number, True or False."""
    return isinstance(value, Real | np.bool_) and isfinite(value)


Declared = TypeVar("Declared", Parameter, State)


def declared(classes: Iterable[type], kind: type[Declared]) -> dict[str, Declared]:
    """Return the parameters or states that classes of agents and their bases declare, by name."""
    found: dict[str, Declared] = {}
    for agent in classes:
        for name in dir(agent):
            one = getattr(agent, name, None)
            if isinstance(one, kind) and found.setdefault(name, one) is not one:
                raise ParameterError(
                    f"{name}: two classes of agents declare a {kind.__name__} of this name; rename "
                    "one, or declare it once on a common base"
                )
    return found
