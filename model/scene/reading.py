"""From TOML text to a scene's table."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kaju.errors import SceneError

from .images import EMBEDDED

LONGEST = 100_000_000
"""Characters of a scene's text; larger bodies come from images and arrays."""
DEEPEST = 16
"""Parts of a key path; a scene needs five."""
_WORDS = re.compile(
    r"""#[^\n]*|\"{3}.*?\"{3}|'{3}.*?'{3}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'""", re.DOTALL
)
_DEEP_KEY = re.compile(rf"[\w-]+(?:[ \t]*\.[ \t]*[\w-]+){{{DEEPEST},}}")


def table_from(text: str, folder: str | Path | None = None) -> dict[str, Any]:
    """Return the table in a TOML text; paths in it start from `folder`.

    Raises
    ------
    SceneError
        If the text is not TOML, or larger or deeper than any scene is.
    """
    if len(text) > LONGEST:
        raise SceneError(
            f"is not a scene: {len(text)} characters are more than {LONGEST:.0e}; "
            "describe a large body by an image or an array"
        )
    # The time that TOML's parser takes grows with the square of a key's depth.
    deep = _DEEP_KEY.search(_WORDS.sub(_blank, text))
    if deep:
        raise SceneError(f"is not a scene: the key {deep[0][:40]}… has too many parts")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"is not valid TOML: {error}") from None
    except RecursionError:
        raise SceneError("is not a scene: its lists are nested too deeply") from None
    return table if folder is None else located(table, Path(folder))


def _blank(word: re.Match[str]) -> str:
    """Return what stands for a comment or a quoted text where only the dots of keys count."""
    return "" if word[0].startswith("#") else "q"


def table_from_archive(text: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the table in a TOML text, its body's array taken from `arrays`."""
    table = table_from(text)
    name = table["body"].get("array")
    return table if name is None else {**table, "body": {**table["body"], "array": arrays[name]}}


def located(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table with the paths in it starting from `folder`."""
    located = {key: _moved(part, folder) for key, part in table.items() if key != "materials"}
    return {**table, **located}


def _moved(part: Any, folder: Path) -> Any:
    if isinstance(part, list):
        return [_moved(item, folder) for item in part]
    if not isinstance(part, dict):
        return part
    moved = {}
    for key, value in part.items():
        is_path = key in ("image", "array", "file") and isinstance(value, str)
        is_path = is_path and not value.startswith(EMBEDDED)
        moved[key] = str(folder / value) if is_path else _moved(value, folder)
    return moved
