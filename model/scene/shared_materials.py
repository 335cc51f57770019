"""Materials as scenes and files write them, and files of materials that several scenes share."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from kaju.agents.materials import LIBRARY, Material, suggestion
from kaju.errors import ParameterError, SceneError, SceneFileError
from kaju.files import text_of_file
from kaju.model.rheology.element import ThreeElement

from .validation import Described, Number, Text, built_by, optional, with_lines

LONGEST = 100_000_000
"""Bytes of a scene's text; larger bodies come from images and arrays."""


class RheologyTable(Described):
    """``[materials.NAME.rheology]``: how a material gives in time, as in `ThreeElement`."""

    K_f: Number = Field(description="stiffness of the spring (Pa)")
    D_f: Number = Field(default=0.0, description="damper beside the spring (Pa s)")
    D_d: Number = Field(default=inf, description="damper in series (Pa s); left out: none")


class MaterialTable(Described):
    """``[materials.NAME]``: numbers as in `Material`, or a material of the library with some."""

    base: Text | None = optional("the name of a material of the library")
    youngs_modulus: Number | None = optional("E (Pa)")
    poissons_ratio: Number | None = optional("ν")
    density: Number | None = optional("mass per volume (kg/m³)")
    source: Text | None = optional("where the numbers come from")
    rheology: RheologyTable | None = optional("how it gives in time")

    def build(self) -> Material:
        """Return the material; whoever keeps it by name gives it that name."""
        given = self.model_dump(exclude={"base", "rheology"}, exclude_none=True)
        if self.rheology is not None:
            given["rheology"] = ThreeElement(**self.rheology.model_dump())
        if self.base is not None:
            if self.base not in LIBRARY:
                raise ParameterError(
                    f"base: the library has no {self.base!r}{suggestion(self.base, LIBRARY)}; "
                    f"it has {', '.join(LIBRARY)}"
                )
            return replace(LIBRARY[self.base], **given)
        for key in ("youngs_modulus", "poissons_ratio"):
            if key not in given:
                raise ParameterError(f"{key}: is needed, or a base from the library")
        return Material(name="", **given)


MaterialEntry = Annotated[
    Material,
    built_by(
        MaterialTable, Material, "a table of youngs_modulus, poissons_ratio, ... or a Material"
    ),
]


def shared_materials(path: str | Path) -> dict[str, Material]:
    """Return the materials in a file, by name.

    The file holds what a scene has under ``[materials]``: a table for each name. A scene will do,
    too.
    """
    return _read(Path(path))[1]


def with_shared(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table in which tables stand for the file of materials that it names."""
    named = table.get("materials")
    if not isinstance(named, str):
        return table
    return table | {"materials": _read(folder / named)[0]}


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Material]]:
    """Return a file's tables, and the materials that they make."""
    text = text_of_file(path, SceneFileError, LONGEST, key="materials")
    try:
        table = tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or a number of too many digits
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
            message = with_lines(text, f"{inside}{name}.{error}")
            raise SceneError(f"materials: {path}: {message}") from None
    return dict(tables), found
