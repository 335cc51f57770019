"""What a class of agents declares: numbers to turn (`Parameter`), what agents know (`State`)."""

from __future__ import annotations

from math import isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

import numpy as np

from kaju.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Iterable


class Declaration:
    """What stands on a class of agents, under a name of its own."""

    name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, agent: None, owner: type) -> Self: ...
    @overload
    def __get__(self, agent: object, owner: type) -> Any: ...
    def __get__(self, agent: Any, owner: type) -> Any:
        return self if agent is None else self.of(agent)

    def of(self, agent: Any) -> Any:
        """Return its value for an agent."""


class Parameter(Declaration):
    """A number that all agents of a class share, and that is given to the model.

    Declared on the class, it is a keyword of `LoadModel`, a column of its data, a line in the
    summary of its results, and a slider. Agents read it as an attribute.

    Parameters
    ----------
    default : int, float or bool
        Its value, unless the model gets another; if it and the bounds are whole, all values are.
    low, high : int or float, optional
        The smallest and the largest value; not needed for a bool.
    text : str
        What it means, with its unit: the label of the slider.

    Raises `ParameterError` if the bounds are missing or do not enclose the default.

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

    name = "Parameter, its default"

    def __init__(
        self, default: float, low: float | None = None, high: float | None = None, text: str = ""
    ) -> None:
        self.default, self.text = default, text
        self.low, self.high = (None, None) if isinstance(default, bool) else (low, high)
        if isinstance(default, bool):
            return
        if low is None or high is None:
            raise ParameterError(
                f"low, high: a Parameter needs both bounds, as in Parameter({default!r}, 0, 10, "
                f'"what it means"), got {low!r} and {high!r}'
            )
        self.checked(default)

    def of(self, agent: Any) -> Any:
        """Return the model's number."""
        return agent.model.parameters[self.name]

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
        """Return a value that the rule allows; refuse any other."""
        if self.low is None or self.high is None:
            if not isinstance(value, bool):
                raise ParameterError(f"{self.name}: must be True or False, got {value!r}")
            return value
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
        if self.low is None or self.high is None:
            return {"type": "Checkbox", "value": self.default, "label": label}
        step = 1 if self.whole else (self.high - self.low) / 100.0 or 1.0
        ends = {"min": self.low, "max": self.high, "step": step}
        kind = "SliderInt" if self.whole else "SliderFloat"
        return {"type": kind, "value": self.default, "label": label, **ends}


class State(Declaration):
    """What each agent of a class remembers; pictures, films, tables and stored results show it.

    Declared on the class of material agents, it is an attribute of each, with its own value. The
    result keeps the values of every generation.

    Parameters
    ----------
    default : bool, int or float
        Its value when an agent wakes. If it is whole, all values must be: begin sums at 0.0.
    meaning : str
        What it means, with its unit: the label of its colours.

    Raises `ParameterError` if the default is not a finite number.

    Examples
    --------
    >>> import kaju
    >>> class Breaking(kaju.MaterialAgent):
    ...     broken = kaju.State(False, "passes nothing on")
    ...     def pass_on(self, load):
    ...         self.broken = self.broken or load.total > 1.5
    ...         if not self.broken:
    ...             super().pass_on(load)
    >>> scene = kaju.load_scene("plate.toml")
    >>> result = kaju.LoadModel(scene, material_agent=Breaking).run()
    >>> result.states["broken"].values().tolist()
    [True]
    """

    def __init__(self, default: Any, meaning: str = "") -> None:
        self.default, self.meaning = default, meaning
        if not is_number(default):
            raise ParameterError(
                f"State: its default must be a number, True or False, got {default!r:.60}"
            )

    def of(self, agent: Any) -> Any:
        """Return the default; an agent's own value stands before it."""
        return self.default

    @property
    def kind(self) -> str:
        """What its values are."""
        if isinstance(self.default, bool | np.bool_):
            return "bool"
        whole = isinstance(self.default, Integral)
        return "whole number (State(0.0) takes any)" if whole else "finite number"

    def allows(self, value: Any) -> bool:
        """Tell whether a value is of the kind of the default."""
        fits = is_number(value) and isinstance(value, bool | np.bool_) == (self.kind == "bool")
        return fits and (not isinstance(self.default, Integral) or value == int(value))


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
