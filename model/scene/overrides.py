"""Single values of a scene changed by their key path, as ``--set loads.0.steps=1`` does."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from kaju.errors import SceneError


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
