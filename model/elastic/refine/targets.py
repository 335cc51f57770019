"""What the tolerance is about: how far off the answer is, and who spawns to mend it."""

from __future__ import annotations

from math import ceil, inf, log
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints

STEP = 5.0
"""The energy of the error is to fall by this factor at most from one generation to the next."""
LEAST = 1e-9  # Share of an error that is asked for at least
DEPTH = 8  # Halvings ahead that a share of the error budget is worked out for
SPARE = 0.95  # The last generation aims at this share of the tolerance
ALIKE = 0.01
"""Who contributes as much as the last one marked, but for this share, spawns as well.

So children keep the symmetry of their parents."""
GAIN = 0.72  # Share of its part of the error that an agent's children are expected to take away


class Answer(NamedTuple):
    """What has been found of a quantity; scaled."""

    value: Floats  # Shape (components,)
    error: float
    relative_error: float
    """Estimated; the latter is the share of the scale."""
    scale: float = 1.0
    bound: float | None = None
    """What the error is at most."""
    no_bound: str = ""  # Why that is not known


class Aimed(NamedTuple):
    """How far off a generation is."""

    error: float  # Estimated error, relative: what the tolerance is compared with
    part: Floats  # What every agent contributes to it. Shape (agents,)
    halvings: Ints
    """How often every agent has to be halved, if the tolerance is to be kept; never, if none may.
    Shape (agents,)."""
    allowed: float  # What all may contribute together
    answers: tuple[Answer, ...] = ()
    """The quantities that the tolerance is about, if it is about any."""


def mark(part: Floats, allowed: float, depth: Ints, dimension: int) -> Ints:
    """Return how often every agent is to be halved, at most `depth`, by its part in an error."""
    # What the smallest leave cannot be helped: the others make up for it, unless it is more than
    # what is allowed of them all.
    helpless = float(part[depth == 0].sum())
    part = np.where(depth > 0, part, 0.0)
    total = float(part.sum())
    left = allowed - helpless if helpless < allowed else allowed
    if not left < total < inf:
        return np.zeros(len(part), dtype=np.int64)
    # Equidistribution: agents are halved until none contributes more than a common share, which is
    # the largest one that keeps the error budget, or the even part of it that one step is to take.
    # `gain` is what the error loses by each of the contributions as that share.
    falls = 2.0 ** (dimension + 2)
    ordered = np.sort(part)[::-1]
    sums = np.append(0.0, np.cumsum(ordered))
    gain, rate = np.zeros(len(part)), GAIN
    for halving in range(DEPTH):
        more = np.searchsorted(-ordered, -ordered * falls**halving, side="right")
        gain += rate * sums[more]
        rate *= 1.0 - GAIN
    steps = max(ceil(log(total / max(left, LEAST * total)) / log(STEP)), 1)
    wanted = total - total * max(left / total, LEAST) ** (1.0 / steps)
    at = min(int(np.searchsorted(gain, wanted)), len(part) - 1)
    share = (1.0 - ALIKE) * max(ordered[at], np.finfo(np.float64).tiny)
    times = 1 + np.floor(np.log2(np.maximum(part, share) / share) / (dimension + 2))
    return np.where(part >= share, np.minimum(times, depth), 0).astype(np.int64)
