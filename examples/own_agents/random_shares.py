"""`self.random`: agents that differ. Each draws once which side it likes; a seed gives it again."""

from kaju import LoadModel, MaterialAgent, Scene, State


class Fickle(MaterialAgent):
    """Hands what goes beside to its two sides in parts that it drew when it woke."""

    left = State(0.5, "part that goes to the left")

    def __init__(self, *start):
        super().__init__(*start)
        self.left = self.random.uniform(0.2, 0.8)

    def emissions(self, load):
        part = {0: 2.0 * self.left, 1: 2.0 * (1.0 - self.left)}  # 0 and 1 are left and right
        return [
            row._replace(share=row.share * part.get(row.arm, 1.0)) if load.direction > 1 else row
            for row in super().emissions(load)
        ]


def drift(seed):
    """Return how far the loads lie to the right of the pressed cell on the average (mm)."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    stage = LoadModel(plate, material_agent=Fickle, seed=seed).run().last
    taken = stage.taken.sum(axis=1)
    return float(10.0 * taken @ (stage.cells[:, 0] - 10) / taken.sum())


if __name__ == "__main__":
    for seed in (1, 2, 3):
        print(f"seed {seed}: the loads drift by {drift(seed):+.2f} mm")
