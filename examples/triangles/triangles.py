"""A lattice of one's own: rows of equilateral triangles, in turn on a side and on a corner."""

from math import sqrt

import numpy as np

from kaju import Lattice


class Triangles(Lattice):
    """Form 0 stands on a side, form 1 on a corner; `cell_size` is their height (m)."""

    kind = "triangle"
    forms = 2

    def form(self, cells):
        """Which form each cell has."""
        return (cells[:, 0] + cells[:, 1]) % 2

    def outline(self, form):
        """Corners about the middle (m), counter-clockwise."""
        standing = np.array([[-1 / sqrt(3), -1 / 3], [1 / sqrt(3), -1 / 3], [0, 2 / 3]])
        return self.cell_size * (-standing if form else standing)

    def centres(self, cells):
        """Middles (m): half a side from one to the next, a third or two thirds up their row."""
        x = (cells[:, 0] + 1) / sqrt(3)
        y = cells[:, 1] + (1 + self.form(cells)) / 3
        return self.cell_size * np.stack([x, y], axis=1)
