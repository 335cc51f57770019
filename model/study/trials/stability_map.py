"""The map of stable coefficients: where the certificate draws its line, and what then happens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaju.agents.materials import Material
from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.model.scene import Scene
from kaju.model.transfer.load_model import LoadModel

CELLS = 9
GENERATIONS = 400
FIRST = 300  # generations in which the slowest of the other modes fades


@dataclass(frozen=True)
class StabilityMap:
    """Growth of loads that are added up, over the coefficients of a rule."""

    forward: Floats  # α₂, shape (n,)
    friction: Floats  # α₃, shape (m,)
    beta: float
    poissons_ratio: float
    radius: Floats  # spectral radius by the certificate, shape (n, m)
    growth: Floats  # of the loads' sum a generation, in a run; 0 where all had ended

    @property
    def contradicted(self) -> int:
        """How many runs grew that the certificate calls stable, or faded that it calls not."""
        clear = np.abs(self.radius - 1.0) > 1e-9
        return int(np.count_nonzero(clear & ((self.growth > 1.0) != (self.radius > 1.0))))


def stability_map(
    beta: float, poissons_ratio: float, steps: int = 13, own: float = 0.5
) -> StabilityMap:
    """Run a small plate under pairs of α₂ (0 to 1) and α₃ (0 to ½), and ask their certificates.

    `steps`: values of either; `own`: α₁.
    """
    forward, friction = np.linspace(0.0, 0.99, steps), np.linspace(0.0, 0.495, steps)
    plate = Scene(
        body={"cell_size": 0.01, "cells": [CELLS, CELLS], "material": "m"},
        materials={"m": Material("m", youngs_modulus=1e9, poissons_ratio=poissons_ratio)},
        sides={"bottom": "rigid"},
        loads=[{"cell": [CELLS // 2, CELLS - 1], "force": [0.3, -1.0]}],
    )
    radius, growth = np.zeros((2, steps, steps))
    for i, j in np.ndindex(steps, steps):
        alpha = own, float(forward[i]), float(friction[j])
        rule = PrescribedRule(alpha=alpha, beta=beta, threshold=1e-280, accumulate=True)
        radius[i, j], growth[i, j] = _growth(plate.replace(rule=rule))
    return StabilityMap(forward, friction, beta, poissons_ratio, radius, growth)


def _growth(scene: Scene) -> tuple[float, float]:
    """Return the certificate's radius, and by how much the loads grew a generation."""
    model = LoadModel(scene, engine="arrays", allow_unstable=True, max_generations=GENERATIONS)
    first, early = 0, model.engine.applied
    while model.running:
        model.step()
        generation, late = model.generation, model.engine.pending
        if generation == FIRST and late:
            first, early = generation, late
    radius = model.certificate.spectral_radius
    if radius is None:
        radius = model.certificate.upper
    return radius, float((late / early) ** (1.0 / (generation - first))) if late else 0.0
