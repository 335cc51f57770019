"""Moduli of the elastic law, and how much of its shear modulus a corner of the body keeps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kaju.agents.elastic_rule import Moduli, moduli_of
from kaju.arrays import Floats, Ints

if TYPE_CHECKING:
    from kaju.model.scene import Scene

__all__ = [
    "REENTRANT_WEIGHT",
    "Moduli",
    "by_law",
    "moduli_at",
    "moduli_of",
    "normal_stress",
    "scene_moduli",
]

REENTRANT_WEIGHT = 0.5
"""Share of its shear modulus that a corner keeps when one of its four cells is air.

Free of traction it would have none, by area it would have 3/4. One half gives the smallest
error of the energy on an L-shaped body and on ragged ones, where 0 and 3/4 are off to opposite
sides.
"""


def scene_moduli(scene: Scene, unit: float = 1.0) -> Moduli:
    """Return the moduli of a scene's materials, in units of so many Pa."""
    materials = scene.cell_materials
    youngs = np.array([material.youngs_modulus for material in materials])
    ratio = np.array([material.poissons_ratio for material in materials])
    return moduli_of(youngs / unit, ratio, scene.plane)


def moduli_at(moduli: Moduli, kinds: NDArray[np.integer] | slice) -> Moduli:
    """Return the moduli of what is of some kinds of material, an entry for each."""
    return Moduli(*(modulus[kinds] for modulus in moduli))


def by_law(law: Floats) -> list[tuple[Ints | slice, Floats]]:
    """Return which entries have each law, and its moduli, of moduli of shape (3, n)."""
    if not law.size:
        return []
    if np.all(law == law[:, :1]):
        return [(slice(None), law[:, 0])]
    laws, which = np.unique(law, axis=1, return_inverse=True)
    which = which.ravel()
    return [(np.flatnonzero(which == number), one) for number, one in enumerate(laws.T)]


def normal_stress(law: Moduli, strain: Floats) -> Floats:
    """Return normal stresses by normal strains, both axis by axis."""
    volume = law.lateral * strain.sum(axis=0)
    return np.asarray(volume + (law.stretch - law.lateral) * strain)
