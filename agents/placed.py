"""What the agents of cells have in common: they know where they stand."""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju._mesa import FixedAgent
from kaju.arrays import Floats


class PlacedAgent(FixedAgent):
    """An agent that stands for a cell of the scene, or for one just beside the body.

    Mesa's space is one cell wider than the scene on every side, so ``cell.coordinate``
    counts from there; `index` counts as the scene does.
    """

    model: Any

    @property
    def index(self) -> tuple[int, ...]:
        """The scene's cell: column, row (and layer), from 0; -1 is beside the first."""
        return tuple(count - 1 for count in self.cell.coordinate)

    @property
    def position(self) -> Floats:
        """Middle of the cell (m), shape (dimension,)."""
        return np.asarray(self.model.lattice.centres(np.array([self.index]))[0])
