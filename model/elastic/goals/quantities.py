"""What a tolerance can be about: the deflection here, the stress there.

A place is a point, (x, y) or (x, y, z) in metres; a box, such as ``{"box": [[0, 0], [0.1, 0.2]]}``,
over which the mean counts (without thickness along one axis it is a section, or a surface); or the
name of a side, such as ``"top"``: all of the body's surface there; ``"top,y"`` means along y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import hypot, isfinite
from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ParameterError, suggestion
from kaju.model.elastic.scales import Scales
from kaju.model.results.result import finite

Place = tuple[float, ...] | dict[str, Any] | str
AXES = "xyz"
HOOP = "hoop"
"""The largest stress along a true outline."""
VON_MISES = "von_mises"


class _Parsed:
    """A quantity whose parts are checked; its place and direction become tuples."""

    def __post_init__(self) -> None:
        for name, parse in {"at": _place, "along": _direction, "component": _component}.items():
            if hasattr(self, name):
                object.__setattr__(self, name, parse(getattr(self, name)))


@dataclass(frozen=True)
class Deflection(_Parsed):
    """The displacement of a place.

    Parameters
    ----------
    at : point, box or side
        Where; over a box or a side the mean is taken.
    along : str or sequence of float, optional
        An axis such as "y", or a direction such as (1, -1) of any length. By default the
        displacement as a vector.

    Examples
    --------
    >>> import kaju
    >>> down = kaju.Deflection((0.105, 0.2), along="y")
    >>> answer = kaju.solve(kaju.load_scene("plate.toml"), tolerance=0.02, goal=down)
    >>> round(1e9 * answer.value_of(down), 1)  # nm
    -13.8
    """

    at: Place
    along: str | tuple[float, ...] | None = None


@dataclass(frozen=True)
class Stress(_Parsed):
    """A stress at a place.

    Parameters
    ----------
    at : point, box or side
        The mean counts, unless it is a point.
    component : str
        Such as "yy" or "xy", or "von_mises": the equivalent stress; or "hoop": the largest by
        amount along the true outline of the region that `at` names; below 0 it is pressed. Of
        such an outline "von_mises" is the largest, too.

    Examples
    --------
    >>> from kaju import Stress, load_scene, solve
    >>> lower_half = Stress({"box": [[0.0, 0.0], [0.2, 0.1]]}, "yy")
    >>> round(solve(load_scene("plate.toml")).value_of(lower_half))  # Pa
    -5000
    """

    at: Place
    component: str = ""  # refused by a KajuError that names the components


@dataclass(frozen=True)
class Reaction(_Parsed):
    """The force of a support on the body.

    Parameters
    ----------
    side : str
        Such as "bottom", or the name of a region that holds the body; "rigid" are the rigid cells
        inside the array that have no name.
    along : str or sequence of float, optional
        An axis or a direction, as for a `Deflection`. By default the force as a vector.

    Examples
    --------
    >>> from kaju import Reaction, load_scene, solve
    >>> round(solve(load_scene("plate.toml")).value_of(Reaction("bottom", "y")), 6)  # N
    2.0
    """

    side: str
    along: str | tuple[float, ...] | None = None


Quantity = Deflection | Stress | Reaction
UNITS = {Deflection: ("m", "displacement"), Stress: ("Pa", "stress"), Reaction: ("N", "force")}
"""Their units, and the scales that these are told by."""


@dataclass(frozen=True)
class Goal:
    """What has been found of a quantity."""

    quantity: Quantity
    components: tuple[float, ...]  # Along each of its directions, in m, Pa or N
    error_estimate: float  # Of a vector in length; proved if there is a bound
    # What the error is relative to: the value or, where that is smaller, a hundredth of the largest
    # displacement, stress or reaction of all
    scale: float
    no_bound: str = ""  # Why nothing is proved; empty if the error is
    place: tuple[float, ...] = ()  # Where a largest stress along an outline is (m)

    @property
    def value(self) -> float | Floats:
        """The quantity (m, Pa or N); a vector has shape (dimension,)."""
        return plain(np.array(self.components))

    @property
    def relative_error(self) -> float:
        """The error as a share of the scale: of the value, or of `relative_to`."""
        return self.error_estimate / (self.scale or 1.0)

    @property
    def relative_to(self) -> float | None:
        """The scale (m, Pa or N), if it is not the value; else None."""
        return self.scale if self.scale > 1.000001 * np.linalg.norm(self.components) else None

    @property
    def error_bound(self) -> float | None:
        """What the error of the value is at most, a theorem; None if nothing is proved."""
        return None if self.no_bound else self.error_estimate

    def in_units(self, scales: Scales) -> Goal:
        """Return it in m, Pa or N."""
        unit = unit_of(self.quantity, scales)
        components = tuple(unit * x for x in self.components)
        error, scale = unit * self.error_estimate, unit * self.scale
        place = tuple(scales.length * x for x in self.place)
        return Goal(self.quantity, components, error, scale, self.no_bound, place)

    def figures(self) -> dict[str, Any]:
        """Return its entry in a summary."""
        return {
            "quantity": named(self.quantity),
            "value": np.asarray(self.value).tolist(),
            "unit": UNITS[type(self.quantity)][0],
            "at_m": list(self.place) or None,
            "error_estimate": finite(self.error_estimate),
            "relative_error": finite(self.relative_error),
            "relative_to": self.relative_to,
            "error_bound": self.error_bound,
        }

    @property
    def doubt(self) -> str:
        """That its error is estimated, and why; empty if it is proved."""
        error = f"the error is estimated as {self.relative_error:.2g}, without a proof"
        return f"{named(self.quantity)}: {error}: {self.no_bound}" if self.no_bound else ""


def unit_of(quantity: Quantity, scales: Scales) -> float:
    """Return the unit of a quantity's scaled value: m, Pa or N."""
    return float(getattr(scales, UNITS[type(quantity)][1]))


def plain(value: Floats) -> float | Floats:
    """Return a single component as a number."""
    return value if len(value) > 1 else float(value[0])


AskedFor = str | Quantity | Mapping[str, Any] | Sequence[Any]
"""What `goal` may be."""


def quantities_of(goal: AskedFor) -> tuple[Quantity, ...]:
    """Return the quantities that `goal` asks for: of places the displacement."""
    if isinstance(goal, Quantity):
        return (goal,)
    if isinstance(goal, str) and "," in goal:  # "top,y"
        at, _, last = map(str.strip, goal.rpartition(","))
        if last in (*AXES, VON_MISES, HOOP):
            return (Deflection(at, last) if last in AXES else Stress(at, last),)
    if isinstance(goal, (str, Mapping)) or is_point(goal):
        return (Deflection(goal),)  # type: ignore[arg-type]
    if isinstance(goal, (Sequence, np.ndarray)) and len(goal):
        return tuple(quantity for item in goal for quantity in quantities_of(item))
    raise ParameterError(
        'goal: a point, a box such as {"box": [[0, 0], [0.1, 0.2]]}, a side, a Deflection, '
        f"Stress or Reaction, or a list of these is needed, got {goal!r}"
    )


def asked(goal: AskedFor | None) -> tuple[Quantity, ...]:
    """Return the quantities that a tolerance is about, none if it is about the energy norm."""
    if goal is None:
        return ()
    quantities = quantities_of(goal)
    if any(isinstance(one, Stress) and one.component == HOOP for one in quantities):
        raise ParameterError(
            f"goal: {HOOP!r} is the stress along a true outline; give the region one "
            '(outline = "true")'
        )
    most = 50
    if len(quantities) > most:
        raise ParameterError(
            f"goal: {len(quantities)} quantities are more than {most}, and each needs its own "
            "solution; ask for the mean over a box"
        )
    return quantities


def described(quantity: Quantity) -> dict[str, Any]:
    """Return a quantity as plain values."""
    return {"quantity": type(quantity).__name__, **vars(quantity)}


def named(quantity: Quantity) -> str:
    """Return a quantity in a word or two."""
    values = [value for value in described(quantity).values() if value is not None]
    kind, at, *rest = values
    if isinstance(quantity, Stress):
        return f"{quantity.component} stress at {at}"
    return " ".join(
        [str(kind).lower(), f"at {at}" if kind != "Reaction" else str(at), *map(str, rest)]
    )


def directions_of(along: str | tuple[float, ...] | None, dimension: int) -> Floats:
    """Return the directions that are asked for, shape (components, dimension)."""
    axes = list(AXES[:dimension])
    if along is None:
        return np.eye(dimension)
    if along in axes:
        return np.eye(dimension)[[axes.index(along)]]
    if isinstance(along, str) or len(along) != dimension:
        raise ParameterError(
            f"goal: along must be {', '.join(axes)} or a direction of {dimension} "
            f"numbers, got {along!r}"
        )
    return np.array([along])


def _component(name: Any) -> str:
    known = [*map("".join, product(AXES, repeat=2)), VON_MISES, HOOP]
    if name not in known:
        near = suggestion(2 * str(name) if str(name) in AXES else str(name), known)
        wrong = f"there is no {name!r}{near}" if name else "is needed"
        raise ParameterError(
            f"component: {wrong}; there is xx, yy, xy and the like, von_mises, and {HOOP} along "
            "true outlines"
        )
    return str(name)


def is_point(value: object) -> bool:
    """Tell whether a value is a row of numbers."""
    numbers = isinstance(value, (Sequence, np.ndarray)) and len(value) > 0
    return numbers and all(isinstance(x, (int, float, np.number)) for x in value)  # type: ignore[attr-defined]


def _place(at: Any) -> Place:
    if isinstance(at, str):
        return at
    if isinstance(at, Mapping):
        return dict(at)
    if not is_point(at):
        raise ParameterError(
            'at: a point (m), a box such as {"box": [[0, 0], [0.1, 0.2]]} or a side such as '
            f"'top' is needed, got {at!r}"
        )
    return tuple(float(x) for x in at)


def _direction(along: Any) -> str | tuple[float, ...] | None:
    if along is None or isinstance(along, str):
        return along
    length = hypot(*along) if is_point(along) else 0.0
    if not (isfinite(length) and length > 0.0):
        raise ParameterError(f"along: an axis such as 'y' or a direction is needed, got {along!r}")
    return tuple(float(x) / length for x in along)
