"""`cell.neighborhood`: agents that look at their neighbours. A crack weakens those beside it."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene, State


class Weakened(MaterialAgent):
    """Cracks when it keeps too much; beside a crack a part of that is enough.

    Agents act one after another, so each counts only cracks of generations before this one: then
    it does not matter who acts first.
    """

    strength = Parameter(0.5, 0.1, 5.0, "the most that it can keep (N)")
    left = Parameter(0.2, 0.0, 1.0, "part of its strength beside a crack")
    cracked = State(0, "generation in which it cracked (0: whole)")

    def step(self):
        now, limit = self.model.generation, self.strength
        if any(0 < agent.cracked < now for agent in self.cell.neighborhood.agents):
            limit *= self.left
        if not self.cracked and self.kept > limit:
            self.cracked = now
        super().step()


def cracks(left, order=None):
    """Return the generation in which each agent of a steel plate under 2 N cracks."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    model = LoadModel(plate, material_agent=Weakened, left=left, order=order)
    return model.run().states["cracked"].values().astype(int).tolist()


if __name__ == "__main__":
    for left in (1.0, 0.5, 0.2):
        when = cracks(left)
        print(f"{left:.0%} left beside a crack: {sum(map(bool, when))} crack in {max(when)} steps")
