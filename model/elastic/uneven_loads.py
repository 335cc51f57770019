"""Loads that cover faces in part, or not evenly: the tractions that agents take, and the rest.

An agent's side takes the linear traction of the same force and moments. What is left over of the
load on the side, r, is orthogonal to linear displacements, so that its work on a displacement v is
at most c √s ‖r‖ ‖ε(v)‖ within the agent alone, s its edge: the energy norm of what it causes is
known to be below that (`data_error`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.scene.selection import Uneven

LARGEST = {2: 0.5, 3: 0.9}
"""Square of c, rounded up: 0.483 and 0.785 by elements (tests/bounds/test_load_error.py)."""


class Portions(NamedTuple):
    """The uneven loads on sides of agents, one entry for each load on a side."""

    box: Ints  # box, side: Agent and side; shape (n,)
    side: Ints
    force: Floats  # Shape (n, d)
    # First moment of each component along each axis, about the middle of the side; shape (n, d, d)
    moment: Floats
    rest: Floats  # Norm of the traction that is neither; shape (n,)

    @classmethod
    def none(cls, d: int) -> Portions:
        """Return no loads."""
        nothing = np.zeros(0, dtype=np.int64)
        return cls(nothing, nothing, np.zeros((0, d)), np.zeros((0, d, d)), np.zeros(0))

    @classmethod
    def of(
        cls, box: Ints, side: Ints, force: Floats, uneven: Uneven, lower: Floats, size: Floats
    ) -> Portions:
        """Return what sides have of loads on faces of cells, whose rows are taken one by one."""
        # Lower corners and edges of the agents count in cells, from the cell's own lower corner on;
        # edges are one number for each, or one along every axis.
        n, d = force.shape
        size = np.broadcast_to(size.T, (d, n)).T
        across = np.ones((n, d), dtype=np.bool_)
        across[np.arange(n), side // 2] = False
        low = np.maximum(uneven.part[:, 0], lower)
        high = np.minimum(uneven.part[:, 1], lower + size)
        length = np.where(across, np.maximum(high - low, 0.0), 1.0)
        area = length.prod(axis=1)
        own = np.where(across, uneven.part[:, 1] - uneven.part[:, 0], 1.0).prod(axis=1)
        away = np.where(across, 0.5 * (low + high) - uneven.part.mean(axis=1), 0.0)
        mean = force / own[:, None] + np.einsum("nik,nk->ni", uneven.growth, away)
        arm = np.where(across, 0.5 * (low + high) - lower - 0.5 * size, 0.0)
        total = area[:, None] * mean
        spread = uneven.growth * (area[:, None] * length**2 / 12.0)[:, None]
        moment = total[:, :, None] * arm[:, None] + spread
        square = area * (mean**2).sum(axis=1) + (uneven.growth * spread).sum(axis=(1, 2))
        whole = np.where(across, size, 1.0).prod(axis=1)
        slopes = moment**2 / np.where(across, size, 1.0)[:, None] ** 2
        linear = (total**2).sum(axis=1) + 12.0 * slopes.sum(axis=(1, 2))
        rest = np.sqrt(np.maximum(square - linear / whole, 0.0))
        rest[rest <= 1e-7 * np.sqrt(square)] = 0.0  # rounding
        return cls(box, side, total, moment, rest)


def softest(stretch: Floats, lateral: Floats, shear: Floats, d: int) -> Floats:
    """Return the least modulus of materials: energy over ‖ε‖²/2."""
    return np.minimum(2.0 * shear, stretch + (d - 1) * lateral)


def data_error(portions: Portions, size: Floats, softest: Floats) -> float:
    """Return the energy norm of what the loads cause that agents do not take, at most."""
    # `softest` is the least modulus of each: energy over ‖ε‖²/2.
    if not len(portions.rest):
        return 0.0
    d = portions.force.shape[1]
    each = np.zeros(len(size))
    np.add.at(each, portions.box, portions.rest)
    return float(np.sqrt((LARGEST[d] * size / softest * each**2).sum()))
