"""Scenes written down: as tables, as TOML text, as files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError, SceneFileError
from kaju.files import scratch_beside

from .body import Body
from .description import Description
from .pictures import EMBEDDED, Picture

_DRAWN = ("body", "legend")


def table_of(scene: Description) -> dict[str, Any]:
    """Return the table that describes a scene; an array stays an array in it."""
    body = scene.body.model_dump(mode="json", exclude_defaults=True, exclude={"array"})
    if scene.body.array is not None:
        body["array"] = scene.body.array
    rule = {"kind": scene.rule.kind, **_entries(scene.rule)}
    if rule.get("sense") is False:
        del rule["sense"]  # the literal reading goes without saying
    table = {
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


def text_of(table: Mapping[str, Any], picture: Picture | None) -> str:
    """Return a scene's table as TOML.

    Raises
    ------
    SceneError
        If the body is an array too large for a drawing, which only a file can take.
    """
    table = _drawn(table, picture)
    if isinstance(table["body"].get("array"), np.ndarray):
        raise SceneError(
            "body.array: is too large, or has too many axes, to be written as a drawing; "
            "scene.save writes it beside the scene's file"
        )
    return dumps(table)


def archive_of(
    table: Mapping[str, Any], picture: Picture | None
) -> tuple[str, dict[str, NDArray[np.int16]]]:
    """Return a scene's table as TOML and, by name, the arrays that do not fit in it."""
    table = _drawn(table, picture)
    if picture is None or "drawing" in table["body"]:
        return dumps(table), {}
    return dumps(_arrayed(table, picture, "cells")), {"cells": picture.codes}


def _drawn(table: Mapping[str, Any], picture: Picture | None) -> dict[str, Any]:
    """Return the table with an image or array turned into a drawing if that is short."""
    if picture is None or "drawing" in table["body"] or not picture.drawable:
        return dict(table)
    drawing, legend = picture.drawing()
    return _with_picture(table, "drawing", drawing, legend)


def _arrayed(table: Mapping[str, Any], picture: Picture, name: str) -> dict[str, Any]:
    """Return the table with its picture turned into an array of that name."""
    legend = {str(code): filling for code, filling in enumerate(picture.names)}
    return _with_picture(table, "array", name, legend)


def _with_picture(
    table: Mapping[str, Any], key: str, picture: str, legend: dict[str, str]
) -> dict[str, Any]:
    """Return the table with its image or array replaced, the keys in their usual order."""
    given = {**table["body"], key: picture}
    others = {"drawing", "image", "array", "nearest_colour"} - {key}
    body = {name: given[name] for name in Body.model_fields if name in given.keys() - others}
    return {"body": body, "legend": legend} | {k: v for k, v in table.items() if k not in _DRAWN}


def save(path: str | Path, table: Mapping[str, Any], picture: Picture | None) -> None:
    """Write a scene to a file at once or not at all; large arrays go into a file beside it.

    Raises
    ------
    SceneFileError
        If the file cannot be written.
    """
    path = Path(path)
    table = _drawn(table, picture)
    if picture is not None and "drawing" not in table["body"]:
        beside = path.with_name(f"{path.stem}.cells.npy")
        with scratch_beside(beside, SceneFileError) as scratch:
            np.save(scratch, picture.codes, allow_pickle=False)
        table = _arrayed(table, picture, beside.name)
    for region in table["body"].get("regions", []):
        if "image" in region and not region["image"]["file"].startswith(EMBEDDED):
            region["image"]["file"] = os.path.relpath(region["image"]["file"], path.parent)
    with scratch_beside(path, SceneFileError) as scratch:
        scratch.write_text(dumps(table), encoding="utf-8")


_OWN_SECTIONS = ("materials", "rule")  # tables in these get a section, in others a line


def dumps(table: Mapping[str, Any]) -> str:
    """Return a scene's table as TOML text."""
    blocks: list[str] = []
    for name, part in table.items():
        blocks.extend(_blocks(_key(name), part))
    return "\n".join(blocks)


def _blocks(name: str, part: Any) -> Iterator[str]:
    """Yield a section and the sections inside it."""
    if isinstance(part, list):
        for item in part:
            yield f"[[{name}]]\n{_lines(item)}"
        return
    own = {key: value for key, value in part.items() if not _is_section(name, value)}
    if own:
        yield f"[{name}]\n{_lines(own)}"
    for key, value in part.items():
        if key not in own:
            yield from _blocks(f"{name}.{_key(key)}", value)


def _is_section(name: str, value: Any) -> bool:
    if isinstance(value, Mapping):
        return name.split(".")[-1] in _OWN_SECTIONS
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_key(key)} = {_value(part)}' for key, part in value.items())}}}"
    import tomli_w

    written = tomli_w.dumps({"value": value}, multiline_strings=True)
    return written.removeprefix("value = ").removesuffix("\n")
