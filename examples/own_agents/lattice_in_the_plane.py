"""A lattice in the plane: squares that stand on a corner, so that a load always has two ahead."""

import numpy as np

from kaju import Lattice, LoadModel, Scene


class Diamonds(Lattice):
    """Rows of them overlap by half; odd rows stand half a cell to the right."""

    kind, forms = "diamond", 2

    def form(self, cells):
        return cells[:, 1] % 2

    def outline(self, form):
        half = self.cell_size / np.sqrt(2.0)
        return half * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])

    def centres(self, cells):
        half = self.cell_size / np.sqrt(2.0)
        return half * np.stack([2 * cells[:, 0] + 1 + self.form(cells), cells[:, 1] + 1], axis=1)


def run():
    """Return what becomes of 2 N on the middle of the top."""
    sheet = Scene(
        body={"lattice": Diamonds, "cells": [9, 16], "cell_size": 0.01, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [4, 15], "side": "top", "force": [0.0, -2.0]}],
    )
    return LoadModel(sheet).run()


if __name__ == "__main__":
    stage = run().last
    print(f"{len(stage.cells)} diamonds took {stage.ledger.taken:.3f} N in all")
