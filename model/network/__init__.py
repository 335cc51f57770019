"""Springs between nodes: any graph, loaded in increments, in large deformation."""

from .assembler import Assembler, Geometry
from .equilibrium import NetworkBalance, SpringLaw, elastic_law, find_balance
from .hexagon_body import hexagon_body
from .increments import IncrementalLoading, load_in_increments, solve
from .linear import tangent_solver
from .network_result import NetworkResult
from .spring_lattices import (
    cut,
    face_centred,
    jittered,
    pulled,
    random_geometric,
    square_braced,
    triangular,
)
from .springs import Method, SpringNetwork, spring_lengths_and_directions

__all__ = [
    "Assembler", "Geometry", "IncrementalLoading", "Method", "NetworkBalance", "NetworkResult",
    "SpringLaw", "SpringNetwork", "cut", "elastic_law", "face_centred", "find_balance",
    "hexagon_body", "jittered", "load_in_increments", "pulled", "random_geometric", "solve",
    "spring_lengths_and_directions", "square_braced", "tangent_solver", "triangular",
]  # fmt: skip
