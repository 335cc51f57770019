"""What breaks: a network or a scene, how many parts it has, and how it is kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.model.network import SpringNetwork
from kaju.model.network.network_result import network_archive, network_from
from kaju.model.results.archive import Archive
from kaju.model.scene import Scene

from .strength import Measure
from .weakening import WeakeningBody

_SCENE = "scene_"


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


def subject_archive(
    subject: SpringNetwork | Scene,
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return what a file keeps of what breaks: arrays, and plain values."""
    if not isinstance(subject, Scene):
        return network_archive(subject)
    text, arrays = subject.to_archive()
    return {_SCENE + name: array for name, array in arrays.items()}, {"scene": text}


def subject_from(archive: Archive) -> SpringNetwork | Scene:
    """Return what `subject_archive` took apart."""
    if "scene" in archive.about:
        return Scene.from_archive(archive.value("scene", str), archive.part(_SCENE))
    return network_from(archive)
