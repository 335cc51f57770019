"""What is asked: as people hand it over (answers, models, files), and as files keep it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kaju.model.scene import Scene, load_scene

from .archive import Archive
from .result import load_result

_SCENE = "scene_"


def from_file(subject: Any) -> Any:
    """Return the scene or result in a file; what is no path is returned as it is."""
    if not isinstance(subject, (str, Path)):
        return subject
    return load_scene(subject) if Path(subject).suffix == ".toml" else load_result(subject)


def answer_of(subject: Any) -> Any:
    """Return what can be drawn: of a model the answer as far as it has come, of a file its own."""
    subject = from_file(subject)
    if hasattr(subject, "step") and hasattr(subject, "result"):
        return subject.result() if callable(subject.result) else subject.result
    return subject


def question_of(subject: Any) -> Any:
    """Return what can be solved: the scene or network of a model or a file, or the subject."""
    subject = from_file(subject)
    if hasattr(subject, "step"):
        return getattr(subject, "scene", None) or getattr(subject, "network", subject)
    return subject


def subject_archive(subject: Any) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return what files keep of a scene, a network or an element: arrays, and plain values."""
    from kaju.model.network.network_result import network_archive
    from kaju.model.network.springs import SpringNetwork

    if isinstance(subject, SpringNetwork):
        return network_archive(subject)
    if not isinstance(subject, Scene):
        return {}, {"element": asdict(subject)}
    text, arrays = subject.to_archive()
    return {_SCENE + name: array for name, array in arrays.items()}, {"scene": text}


def subject_from(archive: Archive) -> Any:
    """Return what `subject_archive` took apart."""
    from kaju.model.network.network_result import network_from
    from kaju.model.rheology.element import ThreeElement

    if "element" in archive.about:
        return ThreeElement(**archive.value("element", dict[str, float]))
    if "scene" not in archive.about:
        return network_from(archive)
    return Scene.from_archive(archive.value("scene", str), archive.part(_SCENE))
