"""Agents with random shares from a seed: no two cells are alike, and every run is the same."""

from kaju import LoadModel, MaterialAgent, PrescribedRule, Scene


class Grain(MaterialAgent):
    """Draws how much it passes ahead; the rest of what it passes goes to both sides."""

    def __init__(self, model, cell, material, shares):
        forward = float(model.rng.uniform(0.3, 0.7))
        drawn = shares._replace(forward=forward, friction=0.5 * (1.0 - forward))
        super().__init__(model, cell, material, drawn)


def scene():
    """The worked plate."""
    return Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
        rule=PrescribedRule(threshold=0.001),
    )


def run(seed):
    """Return the result for a seed."""
    return LoadModel(scene(), material_agent=Grain, seed=seed).run()


if __name__ == "__main__":
    for seed in range(5):
        result = run(seed)
        sideways = result.scene.lattice.centres(result.last.cells)[:, 0] - 0.105
        lean = (result.last.taken.sum(axis=1) @ sideways) / result.last.taken.sum()
        print(f"seed {seed}: {len(result.last.cells)} agents, leaning by {1e3 * lean:+.2f} mm")
