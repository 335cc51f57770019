"""What is asked: as people hand it over (answers, models, files), and as files keep it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kaju.model.scene import load_scene

from .result import load_result


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
