"""Problems with known solutions, for tests, documentation and benchmarks.

>>> from exact import Kirsch
>>> problem = Kirsch()
>>> result = problem.solve(16)
>>> problem.error(result, of="stress") < 0.05
True
"""

from .known_problem import convergence as convergence
from .plane_problems import Kirsch, Lame, LCorner, StripLoad, TimoshenkoCantilever
from .uniform_fields import (
    ConfinedCompression,
    DisplacementPatch,
    ForcePatch,
    RigidRotation,
    SolidDisplacementPatch,
    SolidForcePatch,
    UniformCompression,
)

EXACT_PROBLEMS = (
    UniformCompression,
    ConfinedCompression,
    RigidRotation,
    DisplacementPatch,
    ForcePatch,
    SolidDisplacementPatch,
    SolidForcePatch,
)
"""Problems whose solution the grid represents exactly."""

CONVERGING_PROBLEMS = (TimoshenkoCantilever, StripLoad, Kirsch, Lame, LCorner)
"""Problems whose error falls with the cell size."""
