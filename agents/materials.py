"""What a body is made of: elastic constants by name, each with its source.

All materials are taken as isotropic and linear. Where nature is neither (wood, bone, food),
the entry is a stand-in for one direction and small strains, and its source says so.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from math import inf

from kaju.errors import ParameterError, require, suggestion
from kaju.model.rheology.element import ThreeElement


@dataclass(frozen=True)
class Material:
    """An isotropic, linear elastic material.

    Raises
    ------
    ParameterError
        If a number is out of its range or not a number.

    Examples
    --------
    >>> from kaju import Material, Scene, solve
    >>> resin = Material("resin", youngs_modulus=3e9, poissons_ratio=0.35)
    >>> body = {"cells": [5, 5], "cell_size": 0.01, "material": "resin"}
    >>> sides, loads = {"left": "roller", "bottom": "roller"}, [{"side": "top", "pressure": 3e6}]
    >>> pressed = Scene(body=body, sides=sides, loads=loads, materials={"resin": resin})
    >>> round(float(solve(pressed).strain[0, 1, 1]), 9)
    -0.001
    """

    name: str
    """What scenes call it."""
    youngs_modulus: float
    """E (Pa), above 0."""
    poissons_ratio: float
    """ν, above -1 (a body would gain volume under pressure) and at most 0.5 (incompressible)."""
    density: float | None = None
    """Mass per volume (kg/m³), above 0; only gravity asks for it."""
    source: str = ""
    """Where the numbers come from."""
    rheology: ThreeElement | None = None
    """How it gives in time: K_f (Pa), D_f and D_d (Pa s). Only creep asks for it, and then instead
    of E; without one the material is elastic."""

    def __post_init__(self) -> None:
        modulus, ratio, density = self.youngs_modulus, self.poissons_ratio, self.density
        stiff = 0.0 < modulus < inf
        require(stiff, f"youngs_modulus: must be above 0 Pa, got {modulus}; steel has 206e9")
        rule = "poissons_ratio: must lie above -1 and up to 0.5"
        require(-1.0 < ratio <= 0.5, f"{rule}, got {ratio}; most solids have 0.2 to 0.4")
        heavy = density is None or 0.0 < density < inf
        rule = f"density: must be above 0 kg/m³, got {density}"
        require(heavy, f"{rule}; leave it out where no gravity acts")


_tables = tomllib.loads(files("kaju.agents").joinpath("materials.toml").read_text("utf-8"))
_ALSO = {w.lower(): name for name, table in _tables.items() for w in table.pop("also", ())}
LIBRARY = {name: Material(name, **entries) for name, entries in _tables.items()}
"""The named materials, by name."""


def meant_material(name: str, known: Iterable[str]) -> str:
    """Return " (did you mean 'steel'?)" of a slip or another word; bronze is no bone."""
    meant = _ALSO.get(name.lower(), name)
    return suggestion(meant, [one for one in known if abs(len(one) - len(meant)) < 2], 0.8)


def material(name: str, key: str = "material") -> Material:
    """Return the `Material` that the library has under a name; `kaju materials` lists them.

    Raises
    ------
    ParameterError
        If the library has no such material.

    Examples
    --------
    >>> from kaju import material
    >>> material("steel").youngs_modulus  # Pa
    206000000000.0
    """
    try:
        return LIBRARY[name]
    except (KeyError, TypeError):
        told = f"{key}: the library has no {name!r}{meant_material(str(name), LIBRARY)}; it has"
        raise ParameterError(f"{told} {', '.join(LIBRARY)}") from None
