"""A lattice in space: cubes with a grain. Beside a load they pass on along the grain alone."""

from kaju import Cubes, LoadModel, Scene


class Grained(Cubes):
    """Cubes of wood whose grain runs along x: nothing rubs or presses across it."""

    kind = "grained cube"

    def way(self, direction, form):
        usual = super().way(direction, form)
        along = tuple(row for row in usual.beside if self.axis_of[row.arm] == 0)
        return usual._replace(beside=along)


def run(lattice):
    """Return what becomes of 2 N on the middle of the top of a block."""
    block = Scene(
        body={"lattice": lattice, "cells": [7, 7, 7], "cell_size": 0.01, "material": "oak"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [3, 3, 6], "force": [0.0, 0.0, -2.0]}],
    )
    return LoadModel(block).run()


def spread(result):
    """Return over how many cells loads have come along x, and along y."""
    return tuple(int(cells.max() - cells.min() + 1) for cells in result.last.cells.T[:2])


if __name__ == "__main__":
    for lattice in (Cubes, Grained):
        along, across = spread(run(lattice))
        print(f"{lattice.kind:12}: {along} cells along x, {across} along y")
