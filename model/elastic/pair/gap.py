"""What an agent disagrees in with itself: the gap between its two opinions, and what it proves.

    gap of an agent = integral of (s - C e(v)) : C^-1 : (s - C e(v))

with s the stress that balances and e(v) the strain that fits. Summed over agents it is twice the
distance of the two energies; the error of the mean of both stresses is half its root, exactly
(Prager and Synge 1947).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.arguments import SMALLEST_TOLERANCE

from .elements import rule

ROUNDING = 0.1
"""Of the gap: energies whose difference misses it by more are lost in rounding."""


def stress_of(strain: Floats, law: Floats) -> Floats:
    """Return stresses by strains, along the last axis: normal ones, then shear (strains twice)."""
    d = {3: 2, 6: 3}[strain.shape[-1]]
    stretch, lateral, shear = (modulus.reshape(-1, *[1] * (strain.ndim - 1)) for modulus in law)
    normal = (stretch - lateral) * strain[..., :d]
    normal += lateral * strain[..., :d].sum(axis=-1, keepdims=True)
    return np.concatenate([normal, shear * strain[..., d:]], axis=-1)


def tensors(stress: Floats) -> Floats:
    """Return stresses, normal ones and then shear, as tensors along the last two axes."""
    at = np.array([[0, 2], [2, 1]] if stress.shape[-1] == 3 else [[0, 3, 4], [3, 1, 5], [4, 5, 2]])
    return np.asarray(stress[..., at])


def roots_of(law: Floats, d: int) -> tuple[Floats, Floats]:
    """Return roots of a law and of its inverse: squares of root times strain, or stress, add up."""
    value, vector = np.linalg.eigh(stress_of(np.eye(d * (d + 1) // 2), law[:, None]))
    return (vector * np.sqrt(value)).T, (vector / np.sqrt(value)).T


def at_points(root: Floats, rows: Floats, d: int) -> Floats:
    """Return a root of the energy of a unit square or cube by its unknowns: rows for points."""
    return (np.sqrt(rule(d)[1])[:, None, None] * (root @ rows)).reshape(-1, rows.shape[2])


@dataclass(frozen=True)
class Bounds:
    """What the two opinions prove; scaled."""

    lower: float  # Energy
    upper: float
    error: float
    """Error of the mean of both stresses, in the energy norm, relative to the true one, at most."""
    lost: bool  # Whether rounding is as large as the gap

    @property
    def energy(self) -> float:
        """The middle of both."""
        return 0.5 * (self.lower + self.upper)


def bounds_of(cases: Floats, gap: float, rest: float) -> Bounds:
    """Return what the energies of both opinions prove, case by case: loads, and moved supports."""
    # A case has a lower and an upper bound of its energy, and its gap. Work of the loads in one
    # case is none on what the other moves: their energies add up.
    lower, upper, _ = cases.sum(axis=1).tolist()
    miss = float(np.abs(cases[1] - cases[0] - 0.5 * cases[2]).sum())
    rounding = max(miss, 1e-14 * float(np.abs(cases[:2]).sum()))
    lower, upper = lower - rounding, upper + rounding
    lower = max(sqrt(max(lower, 0.0)) - sqrt(0.5) * rest, 0.0) ** 2
    upper = (sqrt(max(upper, 0.0)) + sqrt(0.5) * rest) ** 2
    radius = 0.5 * sqrt(gap + 2.0 * rounding) + rest
    norm = sqrt(2.0 * lower)
    error = radius / norm if norm > 0.0 else (inf if radius > 0.0 and upper > 0.0 else 0.0)
    lost = rounding > ROUNDING * 0.5 * gap and error > SMALLEST_TOLERANCE
    return Bounds(lower, upper, error, lost)
