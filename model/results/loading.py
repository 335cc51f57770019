"""Reading results, and telling what people hand over: a scene, a model, an answer, or a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from kaju.files import is_there
from kaju.model.scene import load_scene
from kaju.result_kinds import KINDS, fetch

from .archive import read_stored
from .result import Result


def load_result(path: str | Path) -> Result:
    """Read a result that some result's `save` wrote.

    `path`: an ``.npz`` file, or the folder of a run with ``result.npz`` in it, or one in pieces
    with ``result.xdmf``.

    Raises `ResultFileError` if the file is missing, or is no result of kaju's.

    Examples
    --------
    >>> import kaju
    >>> result = kaju.LoadModel(kaju.load_scene("plate.toml")).run()
    >>> kaju.load_result(result.save("plate.kaju")).last.generations
    8
    """
    return cast(Result, stored_at(path))


def stored_at(path: str | Path, **others: type) -> Any:
    """Return the result in a file or folder, or what is of one of the `others`, by their kinds."""
    file = Path(path)
    if file.suffix == ".xdmf" or is_there(file / "result.xdmf"):
        return fetch(KINDS["elasticity in pieces"].result).load(file)
    if is_there(file) and file.is_dir():
        file = file / "result.npz"

    def class_of(kind: str) -> Any:
        return fetch(KINDS[kind].result) if kind in KINDS else others.get(kind)

    return read_stored(file, class_of, "which this kaju cannot read")


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
