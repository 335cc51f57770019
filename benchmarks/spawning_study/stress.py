"""The error of the stress in the energy norm, integrated over the elements of the truth."""

from __future__ import annotations

import numpy as np

from kaju.model.validation.graded_elements import solve_graded
from kaju.model.validation.scene_elements import cells_of, scene_moduli, surroundings


class StressTruth:
    """True stresses of a plane case at the points of a quadrature that resolves them."""

    def __init__(self, case, levels=12):
        answer, scene = solve_graded(case.scene, levels), case.scene
        basis, h = answer.basis, scene.lattice.cell_size
        kind = surroundings(scene)[tuple(cells_of(basis.mesh) + 1)]
        moduli, ones = scene_moduli(scene), np.ones_like(basis.dx)
        self.lateral = (moduli.lateral[kind][:, None] * ones).ravel()
        self.shear = (moduli.shear[kind][:, None] * ones).ravel()
        self.points = h * np.asarray(basis.global_coordinates()).reshape(2, -1).T
        self.volume = scene.thickness * h**2 * basis.dx.ravel()
        gradient = np.asarray(basis.interpolate(answer.displacement).grad).reshape(2, 2, -1) / h
        strain = 0.5 * (gradient + gradient.swapaxes(0, 1)).transpose(2, 0, 1)
        change = np.trace(strain, axis1=1, axis2=2) * self.lateral
        self.stress = 2.0 * self.shear[:, None, None] * strain + change[:, None, None] * np.eye(2)
        self.energy = answer.energy

    def error(self, result) -> float:
        """Return √(∫ Δσ : ε(Δσ) / ∫ σ : ε(σ)) of a result."""
        away = result.stress_at(self.points) - self.stress
        trace = np.trace(away, axis1=1, axis2=2)
        share = self.lateral / (2.0 * self.shear + 2.0 * self.lateral)
        density = ((away**2).sum(axis=(1, 2)) - share * trace**2) / (2.0 * self.shear)
        return float(np.sqrt((density * self.volume).sum() / (2.0 * self.energy)))
