"""Numbers as people read them: with a sensible prefix, and grouped by thousands."""

from __future__ import annotations

from functools import partial
from math import floor, inf, isfinite, log10
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kaju.model import stepper

_PREFIXES = {
    -18: "a", -15: "f", -12: "p", -9: "n", -6: "µ", -3: "m",
    0: "", 3: "k", 6: "M", 9: "G", 12: "T", 15: "P", 18: "E",
}  # fmt: skip
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Scale(NamedTuple):
    """A prefixed unit: `value / factor` is the number to show before `unit`."""

    factor: float
    unit: str

    def text(self, value: float, _position: object = None) -> str:
        """Return the bare number of a value in base units, as tick labels need it."""
        number = value / self.factor
        power = round(log10(number)) if number > 0.0 else 0
        if power <= -4 and abs(number / 10.0**power - 1.0) < 1e-9:
            return f"$10^{{{power}}}$"
        return f"{number:.6g}".replace("-", "−")


def scale_for(values: ArrayLike, unit: str) -> Scale:
    """Return the prefixed unit in which the largest of some values reads 1 to 999."""
    sizes = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(sizes.max(initial=0.0))
    if largest == 0.0 or not isfinite(largest):
        return Scale(1.0, unit)
    # A value such as 0.9999999 kPa still reads as 1 kPa.
    power = 3 * floor(log10(largest * (1.0 + 1e-9)) / 3.0)
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    if not unit:  # of a mere number the power itself is said
        return Scale(10.0**power, f"10{str(power).translate(_RAISED)}" if power else "")
    return Scale(10.0**power, _PREFIXES[power] + unit)


def quantity(value: float, unit: str) -> str:
    """Return a value with its unit, such as ``"5.04 nm"`` or ``"0.01 N"``."""
    value = float(f"{value:.4g}")  # 9999.99 N are 10 kN
    everyday = unit == "N" and 1e-4 <= abs(value) < 1e4
    scale = Scale(1.0, unit) if everyday else scale_for(value, unit)
    between = " · " if not unit and scale.unit else " "
    return f"{value / scale.factor:.4g}{between}{scale.unit}".rstrip().replace("-", "−")


def grouped(number: float) -> str:
    """Return a whole number with its thousands set apart: ``"10 000"``."""
    return f"{round(number):,}".replace(",", "\u202f")  # narrow, and no line breaks there


counted = partial(stepper.counted, written=grouped)
"""Return a number of things with its thousands set apart."""


def times(magnification: float) -> str:
    """Return a magnification as it is stated beside a picture: ``"×10 000"``."""
    whole = magnification >= 1.0
    return f"×{grouped(magnification)}" if whole else f"×{magnification:.2g}"


def visible(span: float, farthest: float, most: float = inf) -> float:
    """Return a factor that makes displacements up to `farthest` (m) visible on a span (m).

    It is 1, 2, 5, 10 ... (or 0.2, 0.1 ...), 1 where they can be seen as they are, at most `most`.
    """
    wanted = 0.09 * span / farthest if farthest > 0.0 else 1.0
    wanted = min(max(wanted, 1.0) if wanted > 0.2 else wanted, most)
    power = 10.0 ** floor(log10(wanted))
    leading = wanted / power * (1.0 + 1e-12)
    return power * (5.0 if leading >= 5.0 else 2.0 if leading >= 2.0 else 1.0)
