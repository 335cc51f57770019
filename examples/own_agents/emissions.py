"""`emissions`: agents in a wind. Of each newton they hand a part to one neighbour alone."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene


class Leaning(MaterialAgent):
    """Hands on what the rule says, less a part that goes to the right (direction 1 is +x)."""

    wind = Parameter(0.2, 0.0, 0.9, "part of every share that goes to the right")

    def emissions(self, load):
        rows = super().emissions(load)
        kept = [(arm, way, (1.0 - self.wind) * share, sense) for arm, way, share, sense in rows]
        blown = self.wind * sum(share for _, _, share, _ in rows)
        return [*kept, (1, load.direction, blown, load.sense)]


def lean(wind):
    """Return how far the loads have drifted to the right on the average (m)."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    result = LoadModel(plate, material_agent=Leaning, wind=wind).run()
    taken = result.last.taken.sum(axis=1)
    drift = result.scene.lattice.centres(result.last.cells)[:, 0] - 0.105
    return float(taken @ drift / taken.sum())


if __name__ == "__main__":
    for wind in (0.0, 0.2, 0.5):
        print(f"wind {wind}: the loads drift by {1e3 * lean(wind):.2f} mm")
