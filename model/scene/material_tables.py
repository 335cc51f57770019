"""Materials as scenes write them: ``[materials.NAME]`` with numbers or a base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any

from pydantic import Field

from kaju.agents.materials import LIBRARY, Material, suggestion
from kaju.agents.rheology import ThreeElement
from kaju.errors import ParameterError

from .described import Described, Number, Text


class RheologyTable(Described):
    """``[materials.NAME.rheology]``: how a material gives in time, as in `ThreeElement`."""

    K_f: Number = Field(description="stiffness of the spring (Pa)")
    D_f: Number = Field(default=0.0, description="damper beside the spring (Pa s)")
    D_d: Number = Field(default=inf, description="damper in series (Pa s); left out: none")


class MaterialTable(Described):
    """``[materials.NAME]``: numbers, or a material of the library with some of its own.

    Parameters
    ----------
    base : str, optional
        A material of the library, from which what is not given is taken.
    youngs_modulus, poissons_ratio, density, source, rheology
        As in `Material`.
    """

    base: Text | None = Field(default=None, description="the name of a material of the library")
    youngs_modulus: Number | None = Field(default=None, description="E (Pa)")
    poissons_ratio: Number | None = Field(default=None, description="ν")
    density: Number | None = Field(default=None, description="mass per volume (kg/m³)")
    source: Text | None = Field(default=None, description="where the numbers come from")
    rheology: RheologyTable | None = Field(default=None, description="how it gives in time")

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


def material_from(value: Any) -> Any:
    """Return the material that a table describes; a material is returned as it is."""
    if isinstance(value, Material):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(
            f"must be a table of youngs_modulus, poissons_ratio, ... or a Material, got {value!r}"
        )
    return MaterialTable.model_validate(value).build()
