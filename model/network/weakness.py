"""Say which nodes give way when the tangent is singular or indefinite."""

from __future__ import annotations

import numpy as np

from kaju.errors import BucklingError, MechanismError, TangentError

from .assembler import Assembler
from .geometry import Geometry, along_springs
from .springs import Floats

_NAMED = 8
"""How many of the moving nodes a message names."""


class GivesWayError(ArithmeticError):
    """The tangent has a direction that meets no resistance, or less than none.

    Internal to the network's engines, which turn it into a `TangentError` that names nodes.
    """

    def __init__(self, direction: Floats) -> None:
        super().__init__("the tangent is not positive definite")
        self.direction = direction


def tangent_error(
    assembler: Assembler, geometry: Geometry, stiffness: Floats, direction: Floats, stage: float
) -> TangentError:
    """Return the error that describes what gives way.

    Parameters
    ----------
    assembler : Assembler
        Of the network at hand.
    geometry, stiffness
        State of the springs and their stiffness (N/m).
    direction : (f,) floats
        Direction of the free coordinates that meets no resistance.
    stage : float
        Point of the load path, for the message.
    """
    network = assembler.network
    mode = assembler.expand(direction)
    moved = np.linalg.norm(mode, axis=1)
    most = np.argsort(-moved, kind="stable")[:_NAMED]
    most = most[moved[most] > 0.05 * moved.max()]
    names = tuple(network.names[int(node)] for node in most)
    place = np.round(network.positions[most[0]], 6).tolist()
    shown = ", ".join(repr(name) for name in names)
    where = f"the nodes {shown} (the first lies at {place} before any load)"
    if _stretches_springs(assembler, geometry, stiffness, mode):
        return BucklingError(
            f"at stage {stage:.6g} the network buckles: under its pressed springs {where} give "
            "way without resistance; press less, hold these nodes, or brace them by springs",
            names,
        )
    return MechanismError(
        f"at stage {stage:.6g} the network is a mechanism: {where} can move without any spring "
        "changing its length; add springs there, or hold more coordinates",
        names,
    )


def _stretches_springs(
    assembler: Assembler, geometry: Geometry, stiffness: Floats, mode: Floats
) -> bool:
    """Tell whether a direction changes any spring's length to first order."""
    ends = along_springs(assembler.network, mode)
    along = np.einsum("ij,ij->i", ends, geometry.direction)
    stretched = float(stiffness @ along**2)
    return stretched > 1e-10 * float(stiffness @ np.einsum("ij,ij->i", ends, ends))
