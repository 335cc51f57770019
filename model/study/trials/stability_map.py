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
FIRST = 300
"""Generations that are left for the slowest of the other modes to fade."""


@dataclass(frozen=True)
class StabilityMap:
    """Growth of loads that are added up, over the coefficients of a rule."""

    forward: Floats
    friction: Floats
    """α₂ and α₃. Shape (n,), (m,)."""
    beta: float
    poissons_ratio: float
    radius: Floats
    """Spectral radius by the certificate. Shape (n, m)."""
    growth: Floats
    """What the loads' sum was multiplied by a generation, in a run; 0 where all had ended. Shape
    (n, m)."""

    @property
    def contradicted(self) -> int:
        """How many runs grew that the certificate calls stable, or faded that it calls not."""
        clear = np.abs(self.radius - 1.0) > 1e-9
        return int(np.count_nonzero(clear & ((self.growth > 1.0) != (self.radius > 1.0))))


def stability_map(
    beta: float, poissons_ratio: float, steps: int = 13, own: float = 0.5
) -> StabilityMap:
    """Run a small plate under every pair of α₂ and α₃, and ask the certificate of each.

    Parameters
    ----------
    beta : float
        Free part of the Poisson expansion.
    poissons_ratio : float
    steps : int
        Values of either coefficient, from 0 to 1 and from 0 to ½.
    own : float
        α₁.
    """
    forward, friction = np.linspace(0.0, 0.99, steps), np.linspace(0.0, 0.495, steps)
    radius, growth = np.zeros((steps, steps)), np.zeros((steps, steps))
    for i, j in np.ndindex(steps, steps):
        scene = _plate((own, float(forward[i]), float(friction[j])), beta, poissons_ratio)
        radius[i, j], growth[i, j] = _grown(scene)
    return StabilityMap(forward, friction, beta, poissons_ratio, radius, growth)


def _plate(alpha: tuple[float, float, float], beta: float, poissons_ratio: float) -> Scene:
    material = Material("m", youngs_modulus=1e9, poissons_ratio=poissons_ratio)
    return Scene(
        body={"cell_size": 0.01, "cells": [CELLS, CELLS], "material": "m"},
        materials={"m": material},
        sides={"bottom": "rigid"},
        loads=[{"cell": [CELLS // 2, CELLS - 1], "force": [0.3, -1.0]}],
        rule=PrescribedRule(alpha=alpha, beta=beta, threshold=1e-280, accumulate=True),
    )


def _grown(scene: Scene) -> tuple[float, float]:
    """Return the certificate's radius, and by how much the loads grew a generation."""
    model = LoadModel(scene, engine="arrays", allow_unstable=True, max_generations=GENERATIONS)
    early = late = None
    while model.running:
        model.step()
        if model.generation == FIRST:
            early = model.engine.pending
        late = model.generation, model.engine.pending
    assert late is not None
    generation, pending = late
    certificate = model.certificate.spectral_radius
    radius = certificate if certificate is not None else model.certificate.upper
    if pending == 0.0:
        return radius, 0.0
    if early:
        return radius, float((pending / early) ** (1.0 / (generation - FIRST)))
    return radius, float((pending / model.engine.applied) ** (1.0 / generation))
