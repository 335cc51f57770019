"""From TOML text to a scene's table, and single values of it changed by their key path."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from kaju.errors import SceneError

from .pictures import EMBEDDED

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


def overridden(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scene's table with some values replaced.

    Parameters
    ----------
    table : mapping
        A scene's table; it is not changed.
    changes : mapping of str to value
        New values by key path, list items by their index. A text is read as TOML writes
        values; what TOML does not understand stays a text. A new ``rule.kind`` starts a new
        rule, since each kind has keys of its own.

    Raises
    ------
    SceneError
        If a path leads through something that has no parts, or to a missing list item.
    """
    result: Any = _copied(table)
    kind = changes.get("rule.kind")
    if kind is not None and kind != result.get("rule", {}).get("kind", "prescribed"):
        result["rule"] = {}
    for path, value in changes.items():
        keys = path.split(".")
        if not all(keys):
            raise SceneError(f"{path!r}: is not a key path such as loads.0.steps")
        place = result
        for depth, key in enumerate(keys[:-1]):
            place = _part(place, key, keys[: depth + 1])
        _put(place, keys, _parsed(value))
    return dict(result)


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_copied(part) for part in value]
    return value


def _part(place: Any, key: str, path: list[str]) -> Any:
    if isinstance(place, list):
        return place[_index(place, key, path)]
    if isinstance(place, dict):
        return place.setdefault(key, {})
    raise _no_parts(place, path)


def _put(place: Any, keys: list[str], value: Any) -> None:
    if isinstance(place, list):
        place[_index(place, keys[-1], keys)] = value
    elif isinstance(place, dict):
        place[keys[-1]] = value
    else:
        raise _no_parts(place, keys)


def _no_parts(place: Any, path: list[str]) -> SceneError:
    return SceneError(
        f"{'.'.join(path)}: {'.'.join(path[:-1])} is {place!r}, which has no parts of its own"
    )


def _index(items: list[Any], key: str, path: list[str]) -> int:
    if not key.isdecimal() or int(key) >= len(items):
        have = f"0 to {len(items) - 1}" if items else "none"
        raise SceneError(
            f"{'.'.join(path)}: {'.'.join(path[:-1])} is a list; its items are {have}, "
            f"there is no item {key!r}"
        )
    return int(key)


def _parsed(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        table = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        return value
    return table["value"] if len(table) == 1 else value
