"""The elastic rule: shares that follow from Young's modulus and Poisson's ratio.

An agent stands on every face between two square or cubic cells. If it moves by δ along its normal
while all others hold still, it presses on the cell ahead and pulls at the cell behind with C₁₁δ,
drags each neighbour beside with μδ, and the faces round both cells feel ±(C₁₂ + μ)δ (forces per
thickness in two dimensions, per edge in three). All but the last add up to kδ with k = 2C₁₁ +
2(dimension − 1)μ. So an agent moves by P/k under a load P and passes all of it on, in shares that
depend on ν alone. When no load is left, the agents have solved elasticity on the staggered grid of
Harlow & Welch (1965) and Virieux (1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import check_type, require

from .materials import Material
from .shares import Shares

Plane = Literal["stress", "strain"]
Order = Literal["wave", "largest first", "multilevel"]


class Moduli(NamedTuple):
    """C₁₁, C₁₂ and μ of each material, shape (materials,) each.

    With σ_xx = C₁₁ε_xx + C₁₂(ε_yy + ε_zz) and τ = μγ: plane stress has C₁₁ = E/(1−ν²) and
    C₁₂ = νC₁₁; plane strain and three dimensions have C₁₁ = λ + 2μ and C₁₂ = λ, where
    λ = Eν/((1+ν)(1−2ν)) and μ = E/2(1+ν) (Timoshenko & Goodier, Theory of Elasticity, ch. 1-2).
    """

    stretch: Floats
    lateral: Floats
    shear: Floats


def moduli_of(youngs_modulus: ArrayLike, poissons_ratio: ArrayLike, plane: Plane | None) -> Moduli:
    """Return the moduli for plane stress, plane strain or (None) three dimensions."""
    youngs = np.asarray(youngs_modulus, dtype=np.float64)
    ratio = np.asarray(poissons_ratio, dtype=np.float64)
    finite = plane == "stress" or bool(np.all(ratio < 0.5))
    told = f"poissons_ratio: must be below 0.5 except in plane stress, got {ratio}; the stiffness"
    require(finite, f"{told} of an incompressible material is infinite; for rubber take 0.4999")
    shear = youngs / (2 * (1 + ratio))
    if plane == "stress":
        stretch = youngs / (1 - ratio**2)
        return Moduli(stretch, ratio * stretch, shear)
    lateral = youngs * ratio / ((1 + ratio) * (1 - 2 * ratio))
    return Moduli(lateral + 2 * shear, lateral, shear)


@dataclass(frozen=True)
class ElasticRule:
    """Load transfer by shares that follow from the material: linear elasticity.

    Loads that meet on a face are added up, with their sign. A load up to the threshold stays where
    it is, and more may be added to it.

    Raises
    ------
    ParameterError
        If a number is out of its range, or `share` is given with an order other than "wave".

    Examples
    --------
    >>> from kaju import ElasticRule, material
    >>> shares = ElasticRule.shares(material("steel"))
    >>> round(shares.forward, 4), round(shares.friction, 4)
    (0.3704, 0.1296)
    """

    threshold: float | None = None
    """γ (N): an agent spawns, and acts, only if the load left on it exceeds γ. A load P on a face
    of stiffness k counts as |P|·√(k₀/k), where k₀ is the stiffness inside the stiffest material of
    the body: on softer faces, which yield further, a load counts more. None chooses γ from
    `tolerance`."""
    order: Order = "multilevel"
    """Who acts: all agents at once; the one with the largest load; or one level after another, with
    parent agents that stand for blocks of cells."""
    share: float | None = None
    """ω: by which share of P/k agents yield in a wave; None chooses a stable one."""
    tolerance: float = 1e-4
    """Relative error in energy to reach: √(Σ P²/k) over √(load · displacement)."""
    kind: ClassVar[Literal["elastic"]] = "elastic"

    def __post_init__(self) -> None:
        if self.threshold is not None:
            told = f"threshold: must be a load above 0 N, got {self.threshold}; leave it out"
            require(0.0 < self.threshold < inf, f"{told} to have it chosen from the tolerance")
        check_type("order", self.order, Order)
        if self.share is not None:
            told = f"share: belongs to the order 'wave'; in the order {self.order!r} an agent takes"
            require(self.order == "wave", f"{told} all of its load, so leave share out")
            require(0.0 < self.share < inf, f"share: must be a number above 0, got {self.share}")
        rule = f"tolerance: must lie between 0 and 1, got {self.tolerance}"
        require(0.0 < self.tolerance < 1.0, f"{rule}; 1e-4 is one part in ten thousand")

    @staticmethod
    def shares(material: Material, dimension: int = 2, plane: Plane | None = None) -> Shares:
        """Return what an agent inside a body of a material passes on.

        Only Poisson's ratio counts. `plane`: "stress" (unless given) or "strain" in two
        dimensions, none in three. The own share means the same as α₁: the cells beside the face are
        strained by own·P/(A E). The Poisson share goes outwards to the faces round the cell ahead,
        and inwards, with the opposite sign, to those round the cell behind.
        """
        told = f"dimension: must be 2, or 3 without a plane, got {dimension} and plane {plane!r}"
        require(dimension == 2 or (dimension == 3 and plane is None), told)
        state = (plane or "stress") if dimension == 2 else None
        law = moduli_of(material.youngs_modulus, material.poissons_ratio, state)
        stretch, lateral, shear = map(float, law)
        k = 2.0 * stretch + 2.0 * (dimension - 1) * shear
        own, straight, poisson = material.youngs_modulus / k, stretch / k, (lateral + shear) / k
        return Shares(own, straight, straight, friction=shear / k, poisson=poisson)
