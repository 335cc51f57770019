"""Reading results, and telling what people hand over: a scene, a model, an answer, or a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from kaju.errors import ResultFileError
from kaju.files import is_there
from kaju.model.scene import load_scene
from kaju.result_kinds import KINDS, fetch

from .archive import open_archive, reading
from .result import Result
from .stored import put_together


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
    file = Path(path)
    if file.suffix == ".xdmf" or is_there(file / "result.xdmf"):
        return cast(Result, fetch(KINDS["elasticity in pieces"].result).load(file))
    if is_there(file) and file.is_dir():
        file = file / "result.npz"
    arrays, about = open_archive(file)
    if about["kind"] not in KINDS:
        told = f"holds a result of kind {about['kind']!r}, which this kaju cannot read"
        raise ResultFileError(f"{file}: {told}")
    with reading(file):
        return cast(Result, put_together(fetch(KINDS[about["kind"]].result), arrays, about))


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
