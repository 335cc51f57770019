"""Many runs of one scene: what is varied, who computes them, where their rows are kept."""

from .parts import load_sweep
from .sensitivity import sensitivity
from .sweeping import sweep

__all__ = ["load_sweep", "sensitivity", "sweep"]
