"""Loads that cover faces in part, or not evenly: the tractions that agents take, and the rest.

An agent's side takes the linear traction of the same force and moments. What is left over of the
load on the side, r, is orthogonal to linear displacements, so that its work on a displacement v is
at most c √s ‖r‖ ‖ε(v)‖ within the agent alone, s its edge: the energy norm of what it causes is
known to be below that (`data_error`).
"""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import Moduli

LARGEST = {2: 0.5, 3: 0.9}
"""Square of c, rounded up: 0.483 and 0.785 by elements (tests/bounds/test_load_error.py)."""


def portions(
    side: Ints, force: Floats, part: Floats, growth: Floats, lower: Floats, size: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return forces, first moments and the rest of loads on faces that act on sides of agents.

    One by one, shape (n, d), (n, d, d) and (n,): moments are of each component along each axis
    about the middle of the side, the rest is the norm of the traction that is neither. Loads as in
    `Uneven`; lower corners and edges of agents, one number or one an axis, count in cells from the
    cell's own lower corner on.
    """
    n, d = force.shape
    size = np.broadcast_to(size.T, (d, n)).T
    across = np.arange(d) != (side // 2)[:, None]
    low = np.maximum(part[:, 0], lower)
    high = np.minimum(part[:, 1], lower + size)
    length = np.where(across, np.maximum(high - low, 0.0), 1.0)
    area = length.prod(axis=1)
    own = np.where(across, part[:, 1] - part[:, 0], 1.0).prod(axis=1)
    away = np.where(across, 0.5 * (low + high) - part.mean(axis=1), 0.0)
    mean = force / own[:, None] + np.einsum("nik,nk->ni", growth, away)
    arm = np.where(across, 0.5 * (low + high) - lower - 0.5 * size, 0.0)
    total = area[:, None] * mean
    spread = growth * (area[:, None] * length**2 / 12.0)[:, None]
    moment = total[:, :, None] * arm[:, None] + spread
    square = area * (mean**2).sum(axis=1) + (growth * spread).sum(axis=(1, 2))
    whole = np.where(across, size, 1.0).prod(axis=1)
    slopes = moment**2 / np.where(across, size, 1.0)[:, None] ** 2
    linear = (total**2).sum(axis=1) + 12.0 * slopes.sum(axis=(1, 2))
    rest = np.sqrt(np.maximum(square - linear / whole, 0.0))
    rest[rest <= 1e-7 * np.sqrt(square)] = 0.0  # rounding
    return total, moment, rest


def data_error(leaf: Ints, rest: Floats, size: Floats, law: Moduli, d: int) -> float:
    """Return the energy norm, at most, of what leaves do not take of loads."""
    each = np.bincount(leaf, rest, len(size))
    # The least modulus of each leaf: energy over ‖ε‖²/2
    softest = np.minimum(2.0 * law.shear, law.stretch + (d - 1) * law.lateral)
    return float(np.sqrt((LARGEST[d] * size / softest * each**2).sum()))
