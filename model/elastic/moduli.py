"""Moduli of the elastic law, and how much of its shear modulus a corner of the body keeps."""

from kaju.agents.elastic_rule import Moduli, moduli_of

__all__ = ["REENTRANT_WEIGHT", "Moduli", "moduli_of"]

REENTRANT_WEIGHT = 0.5
"""Share of its shear modulus that a corner keeps when one of its four cells is air.

Free of traction it would have none, by area it would have 3/4. One half gives the smallest
error of the energy on an L-shaped body and on ragged ones, where 0 and 3/4 are off to opposite
sides.
"""
