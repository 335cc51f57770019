"""Marking: which cells are split for an error to fall below its budget.

Those with the largest contributions are, until they hold a share of the squared error (Dörfler
1996), or what has to go if that is less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats

DORFLER = {2: 0.85, 3: 0.75}  # Share of the squared error that marked cells hold
SPARE = 0.9  # The last generation aims at this share of the tolerance
ALIKE = 0.01
"""Cells that contribute less than the last one marked only by this share are marked, too, so that
marks keep the symmetry of the body."""
GAIN, GAIN_OF_BOUNDS = 0.7, 0.9
"""Share of a cell's contribution that its halving is expected to remove: of an estimate's of first
order, and of a bound's in the plane."""


class Answer(NamedTuple):
    """The value of a goal and its error; scaled."""

    value: Floats  # Shape (components,)
    error: float  # Estimated
    relative_error: float  # The same as a share of the scale
    scale: float = 1.0
    bound: float | None = None  # Upper bound of the error
    no_bound: str = ""  # Why there is none


class Aimed(NamedTuple):
    """The error of a generation that the tolerance limits, and the marks for the next one."""

    error: float  # Estimated, relative: compared with the tolerance
    part: Floats  # Contribution of every cell to it. Shape (cells,)
    marked: Flags  # Cells to be halved; none once the tolerance is kept. Shape (cells,)
    allowed: float  # Error budget: sum of the contributions that keeps the tolerance
    answers: tuple[Answer, ...] = ()  # The goals, if there are any
    more_halvings: int = 0  # Of the cells at singular points, in the same generation


def mark_largest(
    part: Floats, allowed: float, smallest: Flags, share: float, gain: float = GAIN
) -> Flags:
    """Mark the cells with the largest contributions `part`, but none of the smallest."""
    # The smallest cells keep their contributions: the others share the remaining budget, or all of
    # it where the smallest alone exceed it. Marked cells hold a `share` of the error (Dörfler), or
    # what has to go if that is less.
    fixed = float(part[smallest].sum())
    part = np.where(smallest, 0.0, part)
    total = float(part.sum())
    excess = total - (allowed - fixed if fixed < allowed else allowed)
    wanted = max(min(share * total, excess / gain), 0.0)
    order = np.argsort(-part, kind="stable")
    count = int(np.searchsorted(np.cumsum(part[order]), wanted)) + 1
    threshold = part[order[count - 1]] if count <= len(part) else 0.0
    return (part >= (1.0 - ALIKE) * threshold) & (part > 0.0) & (excess > 0.0)
