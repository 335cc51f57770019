"""What changes along a run, as curves: of the same form whatever has run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curves:
    """Some quantities of one unit over one other quantity.

    Attributes
    ----------
    title : str
        What it is about.
    along : str
        What they are drawn over, such as "time".
    along_unit : str
        Its unit, "" if it is a number.
    at : array, shape (k,)
        Values of that.
    lines : mapping of str to array, shape (k,)
        The quantities, by what they are called.
    unit : str
        Their unit, "" if they are numbers.
    logarithmic : bool
        Whether they are told by their orders of magnitude; all are above 0 then.
    """

    title: str
    along: str
    along_unit: str
    at: Floats
    lines: Mapping[str, Floats]
    unit: str
    logarithmic: bool = False
