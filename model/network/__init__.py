"""Springs between nodes."""

from .assembler import Assembler, Geometry
from .equilibrium import Balance, SpringLaw, elastic_law, find_balance
from .linear import Method, tangent_solver
from .springs import SpringNetwork, spring_lengths_and_directions

__all__ = [
    "Assembler",
    "Balance",
    "Geometry",
    "Method",
    "SpringLaw",
    "SpringNetwork",
    "elastic_law",
    "find_balance",
    "spring_lengths_and_directions",
    "tangent_solver",
]
