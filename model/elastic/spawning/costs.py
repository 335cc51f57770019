"""What equal cells and agents are expected to cost, in seconds.

The figures come from `benchmarks/costs.py`. Only their ratios count, and answers do not
depend on them: they decide which way to the tolerance is tried first.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from kaju.model.elastic.moduli import moduli_of
from kaju.model.elastic.problem import STIFF_PRESSURE
from kaju.model.scene import Scene

Method = Literal["box", "matrices", "pressures"]
"""Equal cells without matrices, with them, and with pressures of their own (rubber)."""


class Cost(NamedTuple):
    """Seconds for a run, and for each of its cells or agents."""

    fixed: float
    each: float

    def of(self, count: float) -> float:
        """Return the seconds for so many."""
        return self.fixed + self.each * count


CELLS: dict[tuple[Method, int], Cost] = {
    ("box", 2): Cost(0.03, 0.35e-6),
    ("box", 3): Cost(0.08, 1.6e-6),
    ("matrices", 2): Cost(0.015, 1.3e-6),
    ("matrices", 3): Cost(0.05, 8e-6),
    ("pressures", 2): Cost(0.02, 100e-6),
    ("pressures", 3): Cost(0.02, 450e-6),
}
MOST_CELLS: dict[Method, int] = {
    "box": 40_000_000,
    "matrices": 8_000_000,
    "pressures": 1_000_000,
}
"""More equal cells do not fit in some 10 GB, and are not considered."""
AGENTS = {2: Cost(0.04, 22e-6), 3: Cost(0.08, 72e-6)}
MIXED_AGENTS = {2: Cost(0.04, 33e-6), 3: Cost(0.03, 140e-6)}
"""Where materials differ, the parents' matrices are projected from their children's."""


def method_of(scene: Scene) -> Method:
    """Return the method that equal cells of a scene need."""
    materials = scene.cell_materials
    youngs = np.array([material.youngs_modulus for material in materials])
    ratio = np.array([material.poissons_ratio for material in materials])
    moduli = moduli_of(youngs, ratio, scene.plane)
    if scene.plane != "stress" and np.any(moduli.lateral > STIFF_PRESSURE * moduli.shear):
        return "pressures"
    return "box" if scene.uniform else "matrices"


def cost_of_agents(scene: Scene) -> Cost:
    """Return what agents that spawn in a scene cost."""
    table = AGENTS if len(scene.cell_materials) == 1 else MIXED_AGENTS
    return table[scene.lattice.dimension]
