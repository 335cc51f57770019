"""Springs between nodes: any graph, loaded in increments, in large deformation.

In comes a `SpringNetwork`, out goes a `NetworkResult`: positions and tensions, record by record.
Read `springs` (what is loaded), `assembler` (forces and stiffness of all springs), `equilibrium`
(one balance), `increments` (the way to it), then `spring_lattices` for networks to begin with.
"""

from .hexagon_body import hexagon_body
from .increments import NetworkModel, solve
from .network_result import NetworkResult
from .spring_lattices import cut, jittered, pulled, triangular
from .springs import SpringNetwork, spring_lengths_and_directions

__all__ = [
    "NetworkModel", "NetworkResult", "SpringNetwork", "cut", "hexagon_body", "jittered",
    "pulled", "solve", "spring_lengths_and_directions", "triangular",
]  # fmt: skip
