"""Elastic laws in the plane, the same along all directions, in order of stiffness."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats


class Law(NamedTuple):
    """Moduli in the plane. What has both no larger stores no more energy of any strain."""

    bulk: float  # half the sum of both normal stresses over the sum of their strains
    shear: float

    @classmethod
    def of(cls, modulus: float, ratio: float, plane: str) -> Law:
        """Return the law of a Young's modulus and a Poisson's ratio in plane stress or strain."""
        if plane == "strain":
            modulus, ratio = modulus / (1.0 - ratio**2), ratio / (1.0 - ratio)
        return cls(0.5 * modulus / (1.0 - ratio), 0.5 * modulus / (1.0 + ratio))

    @property
    def stiffness(self) -> Floats:
        """Stress (xx, yy, xy) of a strain (xx, yy, 2 xy)."""
        along, across = self.bulk + self.shear, self.bulk - self.shear
        return np.array([[along, across, 0.0], [across, along, 0.0], [0.0, 0.0, self.shear]])

    @property
    def compliance(self) -> Floats:
        """Strain (xx, yy, 2 xy) of a stress (xx, yy, xy)."""
        return np.asarray(np.linalg.inv(self.stiffness), dtype=np.float64)

    def with_other(self, other: Law, stiffer: bool) -> Law:
        """Return the softest law that is no softer than both, or the stiffest no stiffer."""
        choose = max if stiffer else min
        return Law(choose(self.bulk, other.bulk), choose(self.shear, other.shear))


AIR, UNIT = Law(0.0, 0.0), Law(1.0, 1.0)
