"""`State`: what agents know, to be seen. Who keeps too much cracks: nothing goes sideways."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene, State


class Cracking(MaterialAgent):
    """Cracks for good when it keeps more than its strength."""

    strength = Parameter(0.2, 0.0, 5.0, "the most that it can keep (N)")
    cracked = State(False, "cracked")

    def emissions(self, load):
        self.cracked = self.cracked or self.kept > self.strength
        rows = super().emissions(load)
        return [row for row in rows if row.arm == load.direction] if self.cracked else rows


def cracks(strength):
    """Return how many agents of a steel plate under 2 N crack."""
    plate = Scene(
        body={"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [10, 19], "force": [0.0, -2.0]}],
    )
    result = LoadModel(plate, material_agent=Cracking, strength=strength).run()
    return int(result.states["cracked"].values().sum())


if __name__ == "__main__":
    for strength in (0.05, 0.2, 1.2):
        print(f"strength {strength} N: {cracks(strength)} agents crack")
