"""Agents with a three-element memory: what they keep deforms them by and by, and partly stays."""

import numpy as np

from kaju import LoadModel, MaterialAgent, PrescribedRule, Scene, ThreeElement

SECONDS = 0.5  # A generation lasts so long
ELEMENT = ThreeElement(K_f=1.0, D_f=2.0, D_d=40.0)
"""In units of the cell's own stiffness, so that K_f = 1 is Young's modulus."""


class Remembering(MaterialAgent):
    """Creeps under every share that it has kept, from the moment at which it kept it."""

    def __init__(self, model, cell, material, shares):
        super().__init__(model, cell, material, shares)
        self.memory = []

    def take(self, load):
        before = self.kept
        super().take(load)
        pressed = (self.kept - before) * (1.0 if load.sense == "push" else -1.0)
        axis = self.model.axis_of(load.direction)
        self.memory.append((self.model.generation, axis, pressed))

    def shortening(self, axis):
        kept = [(since, force) for since, along, force in self.memory if along == axis]
        if not kept:
            return 0.0
        now = max(self.model.generation, self.model.until)
        ages = SECONDS * (now - np.array([since for since, _ in kept]))
        forces = np.array([force for _, force in kept])
        stiffness = self.model.cross_section * self.material.youngs_modulus
        return float(forces @ compliance(ages)) / stiffness


def compliance(ages):
    """Return how far the element creeps under 1 N in these times (s); exact."""
    voigt = -np.expm1(-ages * ELEMENT.K_f / ELEMENT.D_f) / ELEMENT.K_f
    return voigt + ages / ELEMENT.D_d


class Patient(LoadModel):
    """Waits until a generation before anybody measures."""

    until = 0


def run(until):
    """Return how far the pressed end of a bar has moved (m) in a generation."""
    scene = Scene(
        body={"cell_size": 0.01, "cells": [1, 6], "thickness": 0.01, "material": "rubber"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, -1.0]}],
        rule=PrescribedRule(alpha=(0.5, 0.8, 0.0), beta=1.0, threshold=0.05, sense=True),
    )
    model = Patient(scene, material_agent=Remembering)
    model.until = until
    return -float(model.run().displacement[:, 1].min())


if __name__ == "__main__":
    for until in (0, 20, 40, 80, 160):
        print(f"{max(until, 14) * SECONDS:5.0f} s: {1e6 * run(until):.3f} µm")
