"""`give_back`: a wall of felt. It gives back a part of what runs into it and keeps the rest."""

from kaju import LoadModel, Parameter, RigidBoundaryAgent, Scene


class Felt(RigidBoundaryAgent):
    """Turns a load round as rigid ground does, and makes it smaller."""

    part = Parameter(0.3, 0.0, 1.0, "what it gives back of each newton")

    def give_back(self, load, arm):
        back = self.turn(load, arm)
        return back._replace(magnitude=self.part * back.magnitude) if self.part else None


def absorbed(part):
    """Return what the wall below a bar under 1 N keeps (N)."""
    bar = Scene(
        body={"cell_size": 0.01, "cells": [1, 8], "thickness": 0.01, "material": "rubber"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, -1.0]}],
    )
    rule = {"alpha": (0.5, 0.9, 0.0), "beta": 1.0, "sense": True}
    model = LoadModel(bar, boundary_agents={"rigid": Felt}, part=part, **rule)
    return model.run().last.ledger.absorbed


if __name__ == "__main__":
    for part in (1.0, 0.3, 0.0):
        print(f"gives {part:.0%} back: {absorbed(part):.3f} N stay in the wall")
