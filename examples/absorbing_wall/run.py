"""A wall that absorbs: it gives back a part of what runs into it, and keeps the rest."""

from kaju import LoadModel, PrescribedRule, RigidBoundaryAgent, Scene


class Felt(RigidBoundaryAgent):
    """Gives back three tenths."""

    part = 0.3

    def give_back(self, load, arm):
        back = self.turn(load, arm)
        return back._replace(magnitude=self.part * back.magnitude)


def scene():
    """A bar that stands on the wall and is pressed from above."""
    return Scene(
        body={"cell_size": 0.01, "cells": [1, 8], "thickness": 0.01, "material": "rubber"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, -1.0]}],
        rule=PrescribedRule(alpha=(0.5, 0.9, 0.0), beta=1.0, threshold=0.01, sense=True),
    )


def run(wall=Felt):
    """Return the result with a kind of wall."""
    return LoadModel(scene(), boundary_agents={"rigid": wall}).run()


if __name__ == "__main__":
    for wall in (RigidBoundaryAgent, Felt):
        ledger = run(wall).last.ledger
        print(
            f"{wall.__name__:18}: {ledger.taken:.2f} N taken in the bar, {ledger.absorbed:.2f} N "
            f"absorbed, books out of balance by {ledger.imbalance:.0e}"
        )
