"""A muscle: agents whose stiffness follows their load, so that it gives less and less."""

import argparse

import matplotlib.pyplot as plt
import numpy as np

from kaju import LoadModel, MaterialAgent, Parameter, PrescribedRule, Scene


class Tensing(MaterialAgent):
    """Is stiffer by a part `gain` for every newton that it keeps, as active muscle is."""

    gain = Parameter(2.0, 0.0, 20.0, "growth of stiffness with the load (1/N)")

    def shortening(self, axis):
        return super().shortening(axis) / (1.0 + self.gain * abs(self.squeezed.get(axis, 0.0)))


def stretch(force, gain):
    """Return by how much a strip of tissue pulled at its top becomes longer (m)."""
    strip = Scene(
        body={"cell_size": 0.01, "cells": [3, 10], "thickness": 0.01, "material": "soft tissue"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, force]}],
        rule=PrescribedRule(alpha=(0.5, 0.9, 0.0), beta=1.0, threshold=1e-4, sense=True),
    )
    model = LoadModel(strip, material_agent=Tensing, gain=gain)
    return float(model.run().displacement[:, 1].max())


def draw(path):
    """Draw the stretch over the force, slack and tense."""
    forces = np.linspace(0.05, 1.0, 12)
    figure, ax = plt.subplots(figsize=(5.0, 3.4))
    for gain, name in ((0.0, "slack"), (2.0, "tense"), (10.0, "very tense")):
        ax.plot(forces, [1e3 * stretch(force, gain) for force in forces], label=name)
    ax.set(xlabel="pull (N)", ylabel="longer by (mm)")
    ax.legend()
    figure.savefig(path, dpi=120, bbox_inches="tight")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", nargs="?", help="a file to draw it into")
    path = parser.parse_args().picture
    for gain in (0.0, 2.0, 10.0):
        once, twice = stretch(0.5, gain), stretch(1.0, gain)
        print(f"gain {gain:4}: {1e3 * once:.2f} mm under 0.5 N, {twice / once:.2f} times under 1 N")
    if path:
        draw(path)
