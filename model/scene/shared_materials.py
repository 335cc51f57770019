"""A file of materials that several scenes share: ``materials = "lab.toml"``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from kaju.agents.materials import Material
from kaju.errors import ParameterError, SceneError, SceneFileError
from kaju.files import text_of_file

from .places import with_lines

LONGEST = 100_000_000
"""Bytes of a scene's text; larger bodies come from images and arrays."""


def shared_materials(path: str | Path) -> dict[str, Material]:
    """Return the materials in a file, by name.

    The file holds what a scene has under ``[materials]``: a table for each name. A scene will do,
    too.
    """
    return _read(Path(path))[1]


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Material]]:
    """Return a file's tables, and the materials that they make."""
    from .description import MaterialTable

    text = text_of_file(path, SceneFileError, LONGEST, key="materials")
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"materials: {path} is not valid TOML: {error}") from None
    inside = "materials." if "materials" in table else ""
    tables = table.get("materials", table)
    if not (isinstance(tables, Mapping) and all(isinstance(t, Mapping) for t in tables.values())):
        raise SceneError(
            f"materials: {path} must hold a table for each material, such as [agar] with "
            "youngs_modulus = 30e3 and poissons_ratio = 0.49"
        )
    found = {}
    for name, entries in tables.items():
        try:
            found[name] = replace(MaterialTable(**entries).build(), name=name)
        except (SceneError, ParameterError) as error:
            told = with_lines(text, f"{inside}{name}.{error}")
            raise SceneError(f"materials: {path}: {told}") from None
    return dict(tables), found


def with_shared(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table in which tables stand for the file of materials that it names."""
    named = table.get("materials")
    if not isinstance(named, str):
        return table
    return table | {"materials": _read(folder / named)[0]}
