"""What breaks: a network or a scene, and how many parts it has."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats
from kaju.model.network import SpringNetwork
from kaju.model.scene import Scene

from .strength import Measure
from .weakening import WeakeningBody


def body_of(subject: SpringNetwork | Scene, strengths: Floats, measure: str) -> WeakeningBody:
    """Return the unbroken body, of springs or of cells."""
    if isinstance(subject, Scene):
        from .breaking_cells import BreakingCells

        return BreakingCells(subject, strengths, measure)
    from .breaking_network import BreakingNetwork

    return BreakingNetwork(subject, strengths, measure)


def parts_of(subject: SpringNetwork | Scene) -> int:
    """Return how many springs, or cells of material, there are."""
    if isinstance(subject, Scene):
        return int(np.count_nonzero(subject.rasterise() >= 0))
    return len(subject.springs)


def default_measure(subject: SpringNetwork | Scene) -> Measure:
    """Return what is exceeded unless something else is asked for."""
    return "stress" if isinstance(subject, Scene) else "force"
