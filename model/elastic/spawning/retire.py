"""Who retires and who spawns, if all are to leave alike.

An agent that leaves much spawns children; a family that leaves little retires, and its
parent comes back. Where no agent leaves more than any returning parent would, one agent
more or less changes the error alike wherever it is: no others, as many, leave less.
"""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints

from .leaves import Leaves

RETURN = 4.0
"""A parent leaves this many times what its children leave together: errors in the energy norm
fall like the edge, their squares like its square."""


def even_share(leaves: Leaves, part: Floats, allowed: float, smallest: int = 1) -> float:
    """Return what an agent may leave, for all together to leave what is allowed."""
    # Parts of an error add up; at least a quarter of them has to be allowed, since children leave
    # that much of their parents' parts. Agents of the smallest edge (units) spawn no children.
    large = leaves.size > smallest
    shares = [part[large]]
    left = float(part[large].sum()) / RETURN + float(part[~large].sum())
    while True:
        start = leaves.families()
        if not len(start):
            break
        expected = _expected(leaves, part, start)
        shares.append(expected)
        leaves, part = _come_back(leaves, part, start, expected)
    return share_of(np.concatenate(shares), left, allowed)


def share_of(parts: Floats, left: float, allowed: float) -> float:
    """Return the even share, from the parts of agents that may spawn and of their forebears."""
    # If all may leave up to a share s, then those above it spawn and the parents below it come
    # back: together they leave what would be `left` if all spawned, a quarter, and ¾ of every part
    # and parent's part up to s.
    ordered = np.sort(parts)
    up_to = left + (1.0 - 1.0 / RETURN) * np.cumsum(ordered)
    count = int(np.searchsorted(up_to, allowed, side="right"))
    return float(ordered[count - 1]) if count else 0.0


def retired(leaves: Leaves, part: Floats, share: float) -> tuple[Leaves, Floats]:
    """Return the leaves, and their parts, with every parent back that would leave up to a share."""
    while True:
        start = leaves.families()
        expected = _expected(leaves, part, start)
        few = expected <= share
        if not few.any():
            return leaves, part
        leaves, part = _come_back(leaves, part, start[few], expected[few])


def _expected(leaves: Leaves, part: Floats, start: Ints) -> Floats:
    family = start[:, None] + np.arange(1 << leaves.dimension)
    return np.asarray(RETURN * part[family].sum(axis=1))


def _come_back(
    leaves: Leaves, part: Floats, start: Ints, expected: Floats
) -> tuple[Leaves, Floats]:
    part = part.copy()
    part[start] = expected
    return leaves.merged(start), part[leaves.without_siblings(start)]
