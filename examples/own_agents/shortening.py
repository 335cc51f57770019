"""`shortening`: agents that harden. After so many loads they yield half as far."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene


class Hardening(MaterialAgent):
    """Counts the loads that it takes, and is twice as stiff after the given number."""

    loads = Parameter(3, 1, 10, "loads before it hardens")
    seen = 0

    def take(self, load):
        super().take(load)
        self.seen += load.copies

    def shortening(self, axis):
        return super().shortening(axis) / (2.0 if self.seen > self.loads else 1.0)


def sinks(loads):
    """Return how far the pressed cell of a steel plate sinks (m)."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    model = LoadModel(plate, material_agent=Hardening, threshold=0.001, loads=loads)
    return -float(model.run().displacement[:, 1].min())


if __name__ == "__main__":
    for loads in (1, 3, 10):
        print(
            f"hardens after {loads:2} loads: the pressed cell sinks by {1e9 * sinks(loads):.3f} nm"
        )
