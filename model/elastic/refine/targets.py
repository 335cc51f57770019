"""Marking: how often each cell is halved for an error to fall below its budget.

A part of the cells is marked, as by Doerfler (1996): those whose refinement takes the share of the
squared error that one generation is to lose. Beside them cells may be halved several times at once,
towards equidistribution of the error that is left.
"""

from __future__ import annotations

from math import ceil, inf, log
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints

STEP = 5.0  # The squared error is to fall by this factor at most from one generation to the next
LEAST = 1e-9  # The error budget is this share of the error at least
DEPTH = 8  # Halvings ahead whose gains are summed
SPARE = 0.95  # The last generation aims at this share of the tolerance
ALIKE = 0.01
"""Cells that contribute less than the last one marked only by this share are marked, too, so that
marks keep the symmetry of the body."""
GAIN = 0.72  # Share of a cell's contribution that its halving is expected to remove


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
    halvings: Ints  # How often every cell is to be halved (0 if not marked). Shape (cells,)
    allowed: float  # Error budget: sum of the contributions that keeps the tolerance
    answers: tuple[Answer, ...] = ()  # The goals, if there are any


def mark(part: Floats, allowed: float, depth: Ints, dimension: int) -> Ints:
    """Return how often every cell is to be halved, at most `depth`, by its contribution `part`."""
    # The smallest cells keep their contributions: the others share the remaining budget, or all of
    # it where the smallest alone exceed it.
    fixed = float(part[depth == 0].sum())
    part = np.where(depth > 0, part, 0.0)
    total = float(part.sum())
    budget = allowed - fixed if fixed < allowed else allowed
    if not budget < total < inf:
        return np.zeros(len(part), dtype=np.int64)
    # Equidistribution: cells are halved until none contributes more than a common threshold, the
    # largest one that keeps the error budget, or takes this generation's even part of the way to
    # it. `gain[i]` is what the error loses with the i-th largest contribution as the threshold; a
    # child contributes 2^-(d + 2) of its parent, so the (k + 1)-th halving is for cells with at
    # least 2^(k (d + 2)) times the threshold, and removes GAIN of what the halvings before left.
    falls = 2.0 ** (dimension + 2)
    ordered = np.sort(part)[::-1]
    sums = np.append(0.0, np.cumsum(ordered))
    gain, rate = np.zeros(len(part)), GAIN
    for halving in range(DEPTH):
        more = np.searchsorted(-ordered, -ordered * falls**halving, side="right")
        gain += rate * sums[more]
        rate *= 1.0 - GAIN
    steps = max(ceil(log(total / max(budget, LEAST * total)) / log(STEP)), 1)
    wanted = total - total * max(budget / total, LEAST) ** (1.0 / steps)
    at = min(int(np.searchsorted(gain, wanted)), len(part) - 1)
    threshold = (1.0 - ALIKE) * max(ordered[at], np.finfo(np.float64).tiny)
    times = 1 + np.floor(np.log2(np.maximum(part, threshold) / threshold) / (dimension + 2))
    return np.where(part >= threshold, np.minimum(times, depth), 0).astype(np.int64)
