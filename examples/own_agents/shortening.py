"""`shortening`: agents that harden. After so much load they yield half as far."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene


class Hardening(MaterialAgent):
    """Adds up the loads that it takes, and is twice as stiff above a limit."""

    limit = Parameter(1.0, 0.1, 10.0, "load taken before it hardens (N)")
    borne = 0.0

    def take(self, load):
        super().take(load)
        self.borne += load.total

    def shortening(self, axis):
        return super().shortening(axis) / (2.0 if self.borne > self.limit else 1.0)


def sinks(limit):
    """Return how far the pressed cell of a steel plate sinks (m)."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    model = LoadModel(plate, material_agent=Hardening, threshold=0.001, limit=limit)
    return -float(model.run().displacement[:, 1].min())


if __name__ == "__main__":
    for limit in (0.2, 1.0, 10.0):
        print(f"hardens above {limit:4} N: the pressed cell sinks by {1e9 * sinks(limit):.3f} nm")
