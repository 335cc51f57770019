"""A tired agent: every load that it takes makes it softer."""

from kaju import LoadModel, MaterialAgent, PrescribedRule, Scene

WEAR = 0.05


class Tired(MaterialAgent):
    """Loses stiffness with every load: after n loads it yields 1 + WEAR·n times as far."""

    def __init__(self, model, cell, material, shares):
        super().__init__(model, cell, material, shares)
        self.loads = 0.0

    def take(self, load):
        super().take(load)
        self.loads += load.copies

    def shortening(self, axis):
        return (1.0 + WEAR * self.loads) * super().shortening(axis)


def scene(threshold=0.001):
    """The worked plate."""
    return Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
        rule=PrescribedRule(threshold=threshold, sense=True),
    )


def run(agent=Tired):
    """Return the result with a kind of agent."""
    return LoadModel(scene(), material_agent=agent).run()


if __name__ == "__main__":
    for agent in (MaterialAgent, Tired):
        sunk = -run(agent).displacement[:, 1].min()
        print(f"{agent.__name__:13}: the pressed cell sinks by {1e9 * sunk:.2f} nm")
