"""Scenes in files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kaju.errors import SceneError, SceneFileError

from .reading import located, overridden, table_from
from .scene import Scene


def load_scene(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene that a file describes.

    Parameters
    ----------
    path : str or path
        A TOML file. Images and arrays that it names are looked for beside it.
    overrides : mapping of str to value, optional
        Values that replace the file's, by key path: ``{"loads.0.steps": "1"}``.

    Raises
    ------
    SceneFileError
        If the file, or one that it names, cannot be read.
    SceneError
        If the scene breaks a rule; the message starts with the file's name.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise SceneFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise SceneFileError(
            f"{path}: is not a text; a scene is a TOML file (images: Scene.from_image, arrays: "
            "Scene.from_array)"
        ) from None
    try:
        table = overridden(table_from(text), overrides or {})
        return Scene(**located(table, path.parent))
    except SceneError as error:
        raise type(error)(f"{path}: {error}") from None
