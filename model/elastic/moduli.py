"""The elastic law of materials: moduli, and what follows from stresses by them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kaju.agents.elastic_rule import Moduli as Moduli
from kaju.agents.elastic_rule import moduli_of as moduli_of
from kaju.arrays import Floats, Ints

if TYPE_CHECKING:
    from kaju.model.scene import Scene


def constants_of(scene: Scene) -> Floats:
    """Return Young's modulus (Pa) and Poisson's ratio of every material, shape (n, 2)."""
    return np.array([(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials])


def scene_moduli(scene: Scene, unit: float = 1.0) -> Moduli:
    """Return the moduli of a scene's materials, in units of so many Pa."""
    youngs, ratio = constants_of(scene).T
    return moduli_of(youngs / unit, ratio, scene.plane)


def moduli_at(moduli: Moduli, kinds: NDArray[np.integer] | slice) -> Moduli:
    """Return the moduli of what is of some kinds of material, an entry for each."""
    return Moduli(*(modulus[kinds] for modulus in moduli))


def by_law(law: Floats) -> list[tuple[Ints | slice, Floats]]:
    """Return which entries have each law, and its moduli, of moduli of shape (3, n)."""
    if np.all(law == law[:, :1]):
        return [(slice(None), law[:, 0])]
    laws, which = np.unique(law, axis=1, return_inverse=True)
    which = which.ravel()
    return [(np.flatnonzero(which == number), one) for number, one in enumerate(laws.T)]


def is_rubber(moduli: Moduli, plane: str | None) -> bool:
    """Tell whether a material is so nearly incompressible that pressure needs its own unknown."""
    # From 0.45 in ν on the mixed form is the quicker one.
    return plane != "stress" and bool(np.any(moduli.lateral / moduli.shear > 9.0))


def strain_of(stress: Floats, moduli: Moduli, kinds: Ints | slice) -> Floats:
    """Return the strain tensors that belong to stress tensors (scaled) in materials."""
    d = stress.shape[-1]
    stretch, lateral, shear = moduli_at(moduli, kinds)
    trace = np.trace(stress, axis1=-2, axis2=-1)
    # In d dimensions the trace of σ is (C₁₁ + (d−1)C₁₂) times the trace of ε.
    volume = trace / (stretch + (d - 1) * lateral)
    identity = np.eye(d)
    return np.asarray(
        (stress - (lateral * volume)[..., None, None] * identity) / (2 * shear)[..., None, None]
    )


def equivalent_stress(
    stress: Floats, moduli: Moduli, kinds: Ints | slice, plane: str | None
) -> Floats:
    """Return the equivalent stress of von Mises, in plane strain with what acts across."""
    trace, across = np.trace(stress, axis1=-2, axis2=-1), 0.0
    if plane == "strain":
        lateral, shear = moduli.lateral[kinds], moduli.shear[kinds]
        across = lateral / (2 * (lateral + shear)) * trace
    mean, d = (trace + across) / 3.0, stress.shape[-1]
    square = ((stress - mean[..., None, None] * np.eye(d)) ** 2).sum(axis=(-2, -1))
    return np.asarray(np.sqrt(1.5 * (square + ((across - mean) ** 2 if d == 2 else 0.0))))


def least_equivalent(
    stresses: Iterable[Floats], moduli: Moduli, kinds: Ints, plane: str | None
) -> Floats:
    """Return the equivalent stress that all of some opinions on the same places reach."""
    reached = [equivalent_stress(one, moduli, kinds, plane) for one in stresses]
    return np.asarray(np.min(reached, axis=0))
