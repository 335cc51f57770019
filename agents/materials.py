"""What a body is made of: elastic constants by name, each with its source.

All materials are taken as isotropic and linear. Where nature is neither (wood, bone, food),
the entry is a stand-in for one direction and small strains, and its source says so.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite

from kaju.errors import ParameterError
from kaju.model.rheology.element import ThreeElement


@dataclass(frozen=True)
class Material:
    """An isotropic, linear elastic material.

    Parameters
    ----------
    name : str
        What scenes call it.
    youngs_modulus : float
        E (Pa), above 0.
    poissons_ratio : float
        ν, above -1 (below that a body would gain volume under pressure) and at most 0.5
        (incompressible).
    density : float, optional
        Mass per volume (kg/m³), above 0; only gravity asks for it.
    source : str
        Where the numbers come from.
    rheology : ThreeElement, optional
        How it gives in time: K_f (Pa), D_f and D_d (Pa s). Only creep asks for it, and then
        instead of E; without one the material is elastic.

    Raises
    ------
    ParameterError
        If a number is out of its range or not a number.

    Examples
    --------
    >>> from kaju import Material
    >>> mine = Material("resin", youngs_modulus=3e9, poissons_ratio=0.35)
    >>> mine.density is None
    True
    """

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float | None = None
    source: str = ""
    rheology: ThreeElement | None = None

    def __post_init__(self) -> None:
        if not (isfinite(self.youngs_modulus) and self.youngs_modulus > 0.0):
            raise ParameterError(
                f"youngs_modulus: must be above 0 Pa, got {self.youngs_modulus}; steel has 206e9"
            )
        if not -1.0 < self.poissons_ratio <= 0.5:
            raise ParameterError(
                f"poissons_ratio: must lie above -1 and up to 0.5, got {self.poissons_ratio}; "
                "most solids have 0.2 to 0.4"
            )
        if self.density is not None and not (isfinite(self.density) and self.density > 0.0):
            raise ParameterError(
                f"density: must be above 0 kg/m³, got {self.density}; leave it out where no "
                "gravity acts"
            )


_KAYE_LABY = "G. W. C. Kaye, T. H. Laby, Tables of Physical and Chemical Constants, 2.2.2"
_WOOD = "USDA Forest Products Laboratory, Wood Handbook (FPL-GTR-190), tables 5-2 and 5-3"

_ENTRIES = (
    Material("steel", 206e9, 0.3, 7850.0, "JSME Mechanical Engineers' Handbook: mild steel"),
    Material("aluminium", 70.3e9, 0.345, 2700.0, _KAYE_LABY),
    Material("copper", 129.8e9, 0.343, 8960.0, _KAYE_LABY),
    Material("lead", 16.1e9, 0.44, 11340.0, _KAYE_LABY),
    Material("glass", 71.3e9, 0.22, 2500.0, _KAYE_LABY + ": crown glass"),
    Material(
        "concrete", 33e9, 0.2, 2400.0, "EN 1992-1-1 table 3.1: class C30/37, secant, uncracked"
    ),
    Material(
        "granite",
        73.8e9,
        0.22,
        2650.0,
        "R. E. Goodman, Introduction to Rock Mechanics, table 6.1: Nevada Test Site granite",
    ),
    Material(
        "ice",
        9.33e9,
        0.325,
        917.0,
        "P. H. Gammon et al., Journal of Glaciology 29 (1983) 433: polycrystal at -16 °C",
    ),
    Material(
        "oak",
        12.3e9,
        0.369,
        760.0,
        _WOOD + ": white oak, 12 % moisture; along the grain, an isotropic stand-in",
    ),
    Material(
        "cork",
        20e6,
        0.05,
        170.0,
        "L. J. Gibson, K. E. Easterling, M. F. Ashby, Proceedings of the Royal Society A 377 "
        "(1981) 99: radial direction, an isotropic stand-in",
    ),
    Material(
        "rubber",
        2e6,
        0.499,
        930.0,
        "M. F. Ashby, Materials Selection in Mechanical Design, appendix A: natural rubber, "
        "small strains",
    ),
    Material(
        "bone",
        17e9,
        0.3,
        1900.0,
        "D. T. Reilly, A. H. Burstein, Journal of Biomechanics 8 (1975) 393: compact bone along "
        "its axis, with the customary ν; an isotropic stand-in",
    ),
    Material(
        "cartilage",
        0.68e6,
        0.1,
        1100.0,
        "K. A. Athanasiou et al., Journal of Orthopaedic Research 9 (1991) 330: human lateral "
        "condyle drained of fluid (aggregate modulus 0.70 MPa)",
    ),
    Material(
        "soft tissue",
        10e3,
        0.49,
        1050.0,
        "P. N. T. Wells, H.-D. Liang, Journal of the Royal Society Interface 8 (2011) 1521: "
        "order of magnitude of relaxed tissue and of gelatine phantoms",
    ),
    Material(
        "noodle",
        70e3,
        0.49,
        1100.0,
        "Studies on the Rheological Property of Korean Noodles I (1983): cooked wheat flour "
        "noodle in creep, 7.0e5 dyn/cm²; ν and density of mostly water",
    ),
)

LIBRARY: dict[str, Material] = {entry.name: entry for entry in _ENTRIES}
"""The named materials, by name."""


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return " (did you mean 'steel'?)" if a known name is spelt much like `name`, else ""."""
    near = get_close_matches(name.lower(), list(known), n=1, cutoff=0.6)
    return f" (did you mean {near[0]!r}?)" if near else ""


def material(name: str) -> Material:
    """Return the library's material of that name.

    Parameters
    ----------
    name : str
        A key of `LIBRARY`, such as "steel".

    Raises
    ------
    ParameterError
        If the library has no such material; the message suggests a near spelling.

    Examples
    --------
    >>> from kaju import material
    >>> material("steel").youngs_modulus  # Pa
    206000000000.0
    """
    try:
        return LIBRARY[name]
    except (KeyError, TypeError):
        raise ParameterError(
            f"material: the library has no {name!r}{suggestion(str(name), LIBRARY)}; "
            f"it has {', '.join(LIBRARY)}"
        ) from None
