"""Scenes as tables, TOML text and files: read, written, and changed by key paths."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ParameterError, SceneError, SceneFileError, brief
from kaju.files import atomic_file

from .description import LONGEST, TABLES, Body, Description, LoadTable, with_shared
from .pictures import Picture
from .validation import plain, read_toml


def table_from(text: str, folder: str | Path | None = None) -> dict[str, Any]:
    """Return the table in a TOML text; paths in it start from `folder`."""
    if not isinstance(text, str) or text.endswith(".toml"):
        raise ParameterError(
            f"text: the TOML of a scene is needed, got {brief(text)}; kaju.load_scene reads a file"
        )
    if len(text) > LONGEST:
        raise SceneError(
            f"is not a scene: {len(text)} characters are more than {LONGEST:.0e}; "
            "describe a large body by an image or an array"
        )
    table = read_toml(text)
    return table if folder is None else located(table, Path(folder))


def located(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table with the paths in it starting from `folder`."""
    moved = {key: _moved(part, folder) for key, part in table.items() if key != "materials"}
    return with_shared({**table, **moved}, folder)


def _moved(part: Any, folder: Path) -> Any:
    if isinstance(part, list):
        return [_moved(item, folder) for item in part]
    if not isinstance(part, dict):
        return part
    moved = {}
    for key, value in part.items():
        is_path = key in ("image", "array", "file", "surface") and isinstance(value, str)
        is_path = is_path and not value.startswith("data:")  # embedded (RFC 2397)
        moved[key] = str(folder / value) if is_path else _moved(value, folder)
    return moved


def overridden(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a new scene's table with values replaced by key path, list items by their index.

    A text is read as TOML writes values, else it stays a text. A new ``rule.kind`` starts a new
    rule.
    """
    for path in changes:
        if "." not in path:
            _check_first(path)
    result: Any = plain(table)
    kind = changes.get("rule.kind")
    if kind is not None and kind != result.get("rule", {}).get("kind", "prescribed"):
        result["rule"] = {}
    for path, value in changes.items():
        keys = path.split(".")
        if not all(keys):
            raise SceneError(f"{path!r}: is not a key path such as loads.0.steps")
        place = result
        for depth in range(1, len(keys)):
            key = _key_in(place, keys[:depth])
            place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]
        place[_key_in(place, keys)] = _parsed(value)
    return dict(result)


def _check_first(key: str) -> None:
    """Say where a key belongs that stands alone but is no part of a scene."""
    if key in Description.model_fields:
        return
    homes = {
        "rule.": {key for table in TABLES.values() for key in table.model_fields},
        "body.": set(Body.model_fields),
        "loads.0.": set(LoadTable.model_fields),
    }
    whole = {key: home + key for home, keys in homes.items() for key in keys}
    near = get_close_matches(key, list(whole), n=1, cutoff=0.7)
    if near:
        raise SceneError(f"{key}: unknown key; did you mean {whole[near[0]]}?")


def _key_in(place: Any, path: list[str]) -> str | int:
    """Return the last part of a key path as a key of the table, or index of the list, `place`."""
    key, whole, parent = path[-1], ".".join(path), ".".join(path[:-1])
    if isinstance(place, dict):
        return key
    if not isinstance(place, list):
        raise SceneError(f"{whole}: {parent} is {place!r}, which has no parts of its own")
    if not key.isdecimal() or int(key) >= len(place):
        have = f"0 to {len(place) - 1}" if place else "none"
        raise SceneError(
            f"{whole}: {parent} is a list; its items are {have}, there is no item {key!r}"
        )
    return int(key)


def _parsed(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        table = tomllib.loads(f"value = {value}")
    except ValueError:  # TOMLDecodeError, or too many digits
        return value
    return table["value"] if len(table) == 1 else value


def table_of(scene: Description) -> dict[str, Any]:
    """Return the table that describes a scene; an array stays an array in it."""
    body = scene.body.model_dump(mode="json", exclude_defaults=True, exclude={"array"})
    if scene.body.array is not None:
        body["array"] = scene.body.array
    if scene.body.regions:
        body["regions"] = [{"material": one["material"], **one} for one in body["regions"]]
    rule = {"kind": scene.rule.kind, **_entries(scene.rule)}
    if rule.get("sense") is False:
        del rule["sense"]  # the literal reading goes without saying
    table = {
        **({"loading": scene.loading} if scene.loading == "continue" else {}),
        "body": body,
        "legend": dict(scene.legend),
        "materials": {name: _entries(material) for name, material in scene.materials.items()},
        "sides": {name: side.to_value() for name, side in scene.sides.items()},
        "loads": [load.model_dump(mode="json", exclude_defaults=True) for load in scene.loads],
        "rule": rule,
        "history": _entries(scene.history) if scene.history else {},
    }
    return {key: part for key, part in table.items() if part}


def _entries(described: Any) -> dict[str, Any]:
    """Return a dataclass as a table, without its name and what is not given or endless."""
    entries = {}
    for field in fields(described):
        value = getattr(described, field.name)
        if is_dataclass(value):
            value = _entries(value)
        elif isinstance(value, Mapping):
            value = {key: _entries(part) for key, part in value.items()}
        if field.name != "name" and value is not None and value not in ("", {}, inf):
            entries[field.name] = list(value) if isinstance(value, tuple) else value
    return entries


def written(
    table: Mapping[str, Any], picture: Picture | None, array: str | None = None
) -> tuple[str, NDArray[np.int16] | None]:
    """Return a scene's table as TOML, and the cells that it names `array`: too many for a drawing.

    Without such a name an image stays the path that it is.
    """
    body, codes = table["body"], None
    if picture is not None and "drawing" not in body and (picture.drawable or array):
        if picture.drawable:
            drawing, legend = picture.drawing()
            made: dict[str, str | None] = {"drawing": drawing}
        else:
            made, codes = {"array": array}, picture.codes
            legend = {str(code): name for code, name in enumerate(picture.names)}
        given = {k: v for k, v in body.items() if k not in ("image", "array", "nearest_colour")}
        given |= made
        body = {name: given[name] for name in Body.model_fields if name in given}
        table = {**table, "body": body, "legend": legend}
    if isinstance(body.get("array"), np.ndarray):
        raise SceneError(
            "body.array: is too large, or has too many axes, to be written as a drawing; "
            "scene.save writes it beside the scene's file"
        )
    return dumps(table), codes


def save(path: str | Path, table: Mapping[str, Any], picture: Picture | None) -> None:
    """Write a scene to a file at once or not at all; large arrays go into a file beside it."""
    path = Path(path)
    beside = path.with_name(f"{path.stem}.cells.npy")
    for region in table["body"].get("regions", []):
        for key in {"image", "surface", "path"} & set(region):
            if isinstance(region[key], dict) and not region[key]["file"].startswith("data:"):
                region[key]["file"] = os.path.relpath(region[key]["file"], path.parent)
    text, codes = written(table, picture, beside.name)
    if codes is not None:
        with atomic_file(beside, SceneFileError) as scratch:
            np.save(scratch, codes, allow_pickle=False)
    with atomic_file(path, SceneFileError) as scratch:
        scratch.write_text(text, encoding="utf-8")


def dumps(table: Mapping[str, Any]) -> str:
    """Return a scene's table as TOML text."""
    blocks: list[str] = []
    for name, part in table.items():
        blocks.extend(_blocks(_key(name), part))
    return "\n".join(blocks)


def _blocks(name: str, part: Any) -> Iterator[str]:
    """Yield a section and the sections inside it, or the line of a plain value."""
    if isinstance(part, str):
        yield f"{name} = {_value(part)}\n"
        return
    if isinstance(part, list):
        for item in part:
            yield "\n".join([f"[[{name}]]", *_entries_of(item), ""])
        return
    own = {key: value for key, value in part.items() if not _is_section(name, value)}
    if own:
        yield "\n".join([f"[{name}]", *_entries_of(own), ""])
    for key, value in part.items():
        if key not in own:
            yield from _blocks(f"{name}.{_key(key)}", value)


def _is_section(name: str, value: Any) -> bool:
    if isinstance(value, Mapping):
        return name.split(".")[-1] in ("materials", "rule")  # in others a table gets a line
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _entries_of(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(_entries_of(value))}}}"
    import tomli_w

    written = tomli_w.dumps({"value": value}, multiline_strings=True)
    return written.removeprefix("value = ").removesuffix("\n")
