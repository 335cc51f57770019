"""What the tolerance is about: how far off the answer is, and who spawns to mend it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats

BULK = {2: 0.85, 3: 0.75}
"""The agents that spawn children stand for this share of the error (Dörfler 1996)."""
SPARE = 0.9  # The last generation aims at this share of the tolerance
ALIKE = 0.01
"""Who contributes as much as the last one marked, but for this share, spawns as well.

So children keep the symmetry of their parents."""
GAIN = 0.7  # Share of its part of the error that an agent's children are expected to take away


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
    marked: Flags
    """Who has to spawn children, if the tolerance is to be kept; nobody, if none may. Shape
    (agents,)."""
    allowed: float  # What all may contribute together
    answers: tuple[Answer, ...] = ()
    """The quantities that the tolerance is about, if it is about any."""


def mark_largest(part: Floats, allowed: float, smallest: Flags, bulk: float) -> Flags:
    """Choose who spawns: those with the largest parts in an error, but none of the smallest."""
    # What the smallest leave cannot be helped: the others make up for it, unless it is more than
    # what is allowed of them all. Those marked stand for a share `bulk` of the error.
    helpless = float(part[smallest].sum())
    part = np.where(smallest, 0.0, part)
    total = float(part.sum())
    excess = total - (allowed - helpless if helpless < allowed else allowed)
    goal = max(min(bulk * total, excess / GAIN), 0.0)
    order = np.argsort(-part, kind="stable")
    count = int(np.searchsorted(np.cumsum(part[order]), goal)) + 1
    enough = part[order[count - 1]] if count <= len(part) else 0.0
    return (part >= (1.0 - ALIKE) * enough) & (part > 0.0) & (excess > 0.0)
