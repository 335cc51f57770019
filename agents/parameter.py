"""What a class of agents declares: numbers to turn (`Parameter`), what agents know (`State`)."""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Integral, Real
from sys import float_info
from typing import Any, TypeVar

import numpy as np

from kaju.errors import ParameterError, brief, require


class Declaration:
    """What stands on a class of agents, under a name of its own."""

    name = ""

    def __init__(self, default: Any, low: Any = None, high: Any = None) -> None:
        self.default, self.is_bool = default, isinstance(default, bool | np.bool_)
        bounds: tuple[Any, Any] = (None, None) if self.is_bool else (low, high)
        self.low, self.high = bounds
        ends = [default] if self.low is None else [default, low, high]
        self.whole = not self.is_bool and all(isinstance(each, Integral) for each in ends)
        number = "whole number" if self.whole else "finite number"
        self.kind = "bool (True or False)" if self.is_bool else number

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def allows(self, value: Any) -> bool:
        """Tell whether a value is of this kind, and within the bounds."""
        if not is_number(value) or isinstance(value, bool | np.bool_) != self.is_bool:
            return False
        within = self.low is None or self.low <= value <= self.high
        return within and (not self.whole or (value == int(value) and abs(value) <= 2**53))


class Parameter(Declaration):
    """A number that all agents of a class share, and that is given to the model.

    Declared on the class, it is a keyword of `LoadModel`, a column of its data, a line in the
    summary of its results, and a slider. Agents read it as an attribute.

    Parameters
    ----------
    default : int, float or bool
        Its value, unless the model gets another. If it and the bounds are int, all values must be.
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
        self, default: float, low: float | None = None, high: float | None = None, text: str = ""
    ) -> None:
        super().__init__(default, low, high)
        self.name, self.text = f"Parameter({default!r}, {low!r}, {high!r})", text
        bounded = self.is_bool or (is_number(low) and is_number(high) and self.low <= self.high)
        example = f'Parameter({default!r}, 0, 10, "what it means")'
        told = f"low, high: two numbers are needed, the smaller first, as in {example}"
        require(bounded, f"{told}, got {low!r} and {high!r}")
        self.checked(default)

    def __get__(self, agent: Any, owner: type) -> Any:
        return self if agent is None else agent.model.parameters[self.name]

    def __set__(self, agent: object, value: object) -> None:
        told = f"{self.name}: is a Parameter, one number for all agents; give it to the model,"
        told += f" LoadModel(scene, {self.name}=...), or choose another name for the value of"
        raise ParameterError(f"{told} a single agent, on which it cannot be set")

    def checked(self, value: Any) -> Any:
        """Return a value that the rule allows; refuse any other."""
        within = "" if self.low is None else f" from {self.low} to {self.high}"
        means = f" ({self.text})" if self.text else ""
        told = f"{self.name}: must be a {self.kind}{within}{means}, got {brief(value)}"
        require(self.allows(value), told)
        return bool(value) if self.is_bool else int(value) if self.whole else float(value)

    def slider(self) -> dict[str, Any]:
        """Return what Mesa's SolaraViz takes for it among its `model_params`."""
        told = {"value": self.default, "label": self.text or self.name}
        if self.is_bool:
            return {"type": "Checkbox", **told}
        step = 1 if self.whole else (self.high - self.low) / 100.0 or 1.0
        ends = {"min": self.low, "max": self.high, "step": step}
        return {"type": "SliderInt" if self.whole else "SliderFloat", **told, **ends}


class State(Declaration):
    """What each agent of a class remembers; pictures, films, tables and stored results show it.

    Declared on the class of material agents, it is an attribute of each, with its own value. The
    result keeps the values of every generation.

    Parameters
    ----------
    default : bool, int or float
        Its value when an agent wakes. An int allows whole numbers only, so begin sums at 0.0.
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
    >>> scene = kaju.load_scene("plate.toml")
    >>> result = kaju.LoadModel(scene, material_agent=Breaking).run()
    >>> result.states["broken"].values().tolist()
    [True]
    """

    def __init__(self, default: Any, meaning: str = "") -> None:
        super().__init__(default)
        self.meaning = meaning
        self.kind += " up to 2**53 (State(0.0) takes any)" * self.whole
        told = "State: its default must be a number, True or False"
        require(is_number(default), f"{told}, got {brief(default)}")

    def __get__(self, agent: Any, owner: type) -> Any:
        return self if agent is None else self.default  # an agent's own value stands before it


def is_number(value: object) -> bool:
    """Tell whether a value is a finite number, True or False."""
    if type(value) is not float:  # what this takes is far longer
        value = value.item() if isinstance(value, np.generic) else value
        if not isinstance(value, Real):
            return False
    return bool(-float_info.max <= value <= float_info.max)  # type: ignore[operator]


Declared = TypeVar("Declared", bound=Declaration)


def declared(classes: Iterable[type], kind: type[Declared]) -> dict[str, Declared]:
    """Return what classes of agents and their bases declare, by name."""
    found: dict[str, Declared] = {}
    for agent in classes:
        for name in dir(agent):
            one = getattr(agent, name, None)
            if isinstance(one, kind) and found.setdefault(name, one) is not one:
                told = f"two classes of agents declare a {kind.__name__} of this name; rename one,"
                raise ParameterError(f"{name}: {told} or declare it once on a common base")
    return found
