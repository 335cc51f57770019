"""Problems with known solutions, for tests, documentation and benchmarks.

>>> from exact import Kirsch
>>> problem = Kirsch()
>>> result = problem.solve(16)
>>> problem.error(result, of="stress") < 0.05
True
"""

from .bars import BimaterialBar, TimoshenkoCantilever
from .eigenfields import LCorner, SaintVenantDecay
from .half_space import Boussinesq, Cerruti, Flamant, StripLoad
from .holes import BrazilianDisk, Kirsch, Lame
from .known_problem import convergence as convergence
from .uniform_fields import (
    ConfinedCompression,
    DisplacementPatch,
    ForcePatch,
    PureShear,
    RigidRotation,
    SolidDisplacementPatch,
    SolidForcePatch,
    UniformCompression,
)

EXACT_PROBLEMS = (
    UniformCompression,
    ConfinedCompression,
    PureShear,
    RigidRotation,
    DisplacementPatch,
    ForcePatch,
    SolidDisplacementPatch,
    SolidForcePatch,
    BimaterialBar,
)
"""Problems whose solution the grid represents exactly."""

CONVERGING_PROBLEMS = (
    TimoshenkoCantilever,
    StripLoad,
    Flamant,
    Boussinesq,
    Cerruti,
    SaintVenantDecay,
    Kirsch,
    Lame,
    BrazilianDisk,
    LCorner,
)
"""Problems whose error falls with the cell size."""
