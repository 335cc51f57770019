"""`take`: agents that yield. Above a limit they keep no more, so their stress ends there."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene


class Yielding(MaterialAgent):
    """Keeps its share of a load only until it holds so much."""

    limit = Parameter(0.2, 0.0, 10.0, "the most that an agent keeps (N)")

    def take(self, load):
        super().take(load)
        self.kept = min(self.kept, self.limit)


def largest_stress(limit):
    """Return the largest stress (Pa) in a steel plate under 2 N."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    model = LoadModel(plate, material_agent=Yielding, limit=limit)
    return float(abs(model.run().stress).max())


if __name__ == "__main__":
    for limit in (10.0, 0.5, 0.2):
        print(f"up to {limit:4} N each: largest stress {largest_stress(limit):.0f} Pa")
