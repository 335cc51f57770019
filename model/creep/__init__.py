"""Bodies, networks and elements in time: creep, relaxation, residual deformation."""

from .creeping import creep
from .state import CreepResult, CreepState

__all__ = ["CreepResult", "CreepState", "creep"]
