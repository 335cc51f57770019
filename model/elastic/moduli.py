"""Moduli of the elastic law, and how much of its shear modulus a corner of the body keeps."""

import numpy as np
from numpy.typing import NDArray

from kaju.agents.elastic_rule import Moduli, moduli_of
from kaju.arrays import Floats

__all__ = ["REENTRANT_WEIGHT", "Moduli", "moduli_at", "moduli_of", "normal_stress"]

REENTRANT_WEIGHT = 0.5
"""Share of its shear modulus that a corner keeps when one of its four cells is air.

Free of traction it would have none, by area it would have 3/4. One half gives the smallest
error of the energy on an L-shaped body and on ragged ones, where 0 and 3/4 are off to opposite
sides.
"""


def moduli_at(moduli: Moduli, kinds: NDArray[np.integer] | slice) -> Moduli:
    """Return the moduli of what is of some kinds of material, an entry for each."""
    return Moduli(*(modulus[kinds] for modulus in moduli))


def normal_stress(law: Moduli, strain: Floats) -> Floats:
    """Return normal stresses by normal strains, both axis by axis."""
    volume = law.lateral * strain.sum(axis=0)
    return np.asarray(volume + (law.stretch - law.lateral) * strain)
