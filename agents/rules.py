"""By which rule a `MaterialAgent` passes load on; a `FaceAgent` works by an `ElasticRule`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import ClassVar, Literal, Protocol

from kaju.errors import require

from .materials import Material
from .shares import Shares


class ShareRule(Protocol):
    """What `LoadModel` asks of a rule; any object that answers will do."""

    @property
    def threshold(self) -> float:
        """γ (N)."""

    @property
    def accumulate(self) -> bool:
        """Whether loads that meet are added up."""

    @property
    def sense(self) -> bool:
        """Whether loads push or pull."""

    def shares(self, material: Material, dimension: int) -> Shares:
        """Return what an agent of a material keeps and passes on."""


@dataclass(frozen=True)
class Coefficients:
    """The four numbers of the prescribed rule for one material.

    Raises
    ------
    ParameterError
        If a share is negative or not a number, or beta lies outside [0, 1].

    Examples
    --------
    >>> from kaju import Coefficients, PrescribedRule, material
    >>> rule = PrescribedRule(materials={"rubber": Coefficients(alpha=(0.6, 0.3, 0.1))})
    >>> [rule.shares(material(name), dimension=2).forward for name in ("rubber", "steel")]
    [0.3, 0.5]
    """

    alpha: tuple[float, float, float] | None = None
    """Shares kept, passed ahead and passed beside by friction: α₁, α₂, α₃. None takes (0.5, 0.5,
    0.25) in two dimensions and (0.5, 0.5, 0.125) in three: α₂ + 2 (dimension - 1) α₃ = 1."""
    beta: float = 0.5
    """Part of the lateral (Poisson) expansion that is free, in [0, 1]; the rest pushes the
    neighbours beside."""

    def __post_init__(self) -> None:
        if self.alpha is not None:
            require(len(self.alpha) == 3, f"alpha: α₁, α₂ and α₃ are needed, got {self.alpha}")
            for name, part in zip(("α₁", "α₂", "α₃"), self.alpha, strict=True):
                require(0.0 <= part < inf, f"alpha: {name} must be a number, 0 or more, got {part}")
        require(0.0 <= self.beta <= 1.0, f"beta: must lie between 0 and 1, got {self.beta}")

    def alpha_in(self, dimension: int) -> tuple[float, float, float]:
        """Return α₁, α₂ and α₃: those given, or the usual ones in two or three dimensions."""
        return self.alpha or (0.5, 0.5, 0.25 if dimension == 2 else 0.125)


@dataclass(frozen=True)
class PrescribedRule(Coefficients):
    """Load transfer by coefficients that the user chooses.

    `alpha` and `beta`, as in `Coefficients`, hold for every material not named in `materials`.

    Raises
    ------
    ParameterError
        If a coefficient is out of range or the threshold is not above 0.

    Examples
    --------
    >>> from kaju import PrescribedRule, material
    >>> rule = PrescribedRule(alpha=(0.5, 0.4, 0.2), beta=1.0, threshold=1e-3)
    >>> rule.shares(material("steel"), dimension=2)
    Shares(own=0.5, forward=0.4, backward=0.0, friction=0.2, poisson=0.0, widening=0.3)
    """

    threshold: float = 0.01
    """γ (N): an agent spawns only for a load above it, an emission up to it is dropped."""
    accumulate: bool = False
    """False: each load is compared with γ by itself. True: loads that meet in one agent in one
    generation and along one direction are added up first."""
    materials: Mapping[str, Coefficients] = field(default_factory=dict)
    """Coefficients of single materials, by name."""
    sense: bool = False
    """False: every load squeezes, in whichever direction it points. True: loads push or pull. A
    push travels along its force, a pull against it; pushes shorten a cell, pulls lengthen it, and
    at a free surface one comes back as the other."""
    kind: ClassVar[Literal["prescribed"]] = "prescribed"

    def __post_init__(self) -> None:
        super().__post_init__()
        told = f"threshold: must be a load above 0 N, got {self.threshold}"
        require(0.0 < self.threshold < inf, f"{told}; without it loads would be halved for ever")

    def shares(self, material: Material, dimension: int) -> Shares:
        """Return what an agent keeps and passes on; only Poisson's ratio of its material counts."""
        by = self.materials.get(material.name, self)
        own, forward, friction = by.alpha_in(dimension)
        poisson = (1.0 - by.beta) * material.poissons_ratio * own
        told = f"poissons_ratio of {material.name!r}: {material.poissons_ratio} would pull the"
        told += " neighbours beside, and this rule has no pulls; set sense = true or beta = 1,"
        pushes = poisson >= 0.0 or self.sense  # a blocked expansion below 0 pulls
        require(pushes, f"{told} or take the elastic rule")
        return Shares(own, forward, 0.0, friction, poisson, by.beta * material.poissons_ratio)
