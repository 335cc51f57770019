"""Units in which a body's numbers are near one."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, log2, log10
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.errors import SceneError
from kaju.model.scene import Scene
from kaju.model.scene.description import SideCondition

ROUNDED = 1e-13
"""Of a sum of many numbers: a share that is as small is rounding."""
HELD = 250
"""Powers of ten that leave room for squares and sums of what is of that order."""


class Scales(NamedTuple):
    """Units of the scaled problem in SI: modulus (Pa), force (N), length and displacement (m)."""

    modulus: float
    force: float
    length: float
    displacement: float

    @classmethod
    def of(cls, modulus: float, force: float, length: float, stretch: float) -> Scales:
        """Return the units of a body that a force moves by force / stretch."""
        force = force if force > 0.0 else stretch * length
        moved = _order(force) - _order(stretch)
        found = {
            "modulus times thickness (N/m)": _order(stretch),
            "displacement (m)": moved,
            "stress (Pa)": _order(modulus) + moved - _order(length),
            "energy (J)": _order(force) + moved,
        }
        for name, size in found.items():
            if not abs(size) <= HELD:
                raise SceneError(
                    f"body, loads: {name} is of the order of 1e{size:.0f}, outside of what can "
                    "be computed; choose other units of force or length, so that it lies "
                    f"between 1e-{HELD} and 1e{HELD}"
                )
        # A power of two: what moves the supports is then scaled without rounding, and so are its
        # small differences in bodies that move by much more than they stretch.
        displacement = 2.0 ** round(log2(force / stretch))
        return cls(modulus, displacement * stretch, length, displacement)

    @classmethod
    def of_cells(
        cls, scene: Scene, modulus: float, force: Floats, sides: Iterable[SideCondition]
    ) -> Scales:
        """Return the units of a scene's cells under forces (N), of which some sides are moved."""
        length = scene.lattice.cell_size
        stretch = modulus * (scene.thickness if scene.lattice.dimension == 2 else length)
        moved = max((abs(u) for side in sides for u in side.displacement or ()), default=0.0)
        peak = float(np.abs(force).max(initial=0.0))
        return cls.of(modulus, max(peak, stretch * moved), length, stretch)

    @property
    def stress(self) -> float:
        """Unit of stress (Pa)."""
        return self.modulus * self.displacement / self.length

    @property
    def energy(self) -> float:
        """Unit of energy (J)."""
        return self.force * self.displacement


def _order(size: float) -> float:
    return log10(size) if size > 0.0 else -inf
