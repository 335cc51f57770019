"""The peer of growth: bilinear elements, a sparse direct solver, optimality criteria by bisection.

The method of E. Andreassen et al., "Efficient topology optimization in MATLAB using 88 lines of
code", Structural and Multidisciplinary Optimization 43 (2011) 1-16, written anew: the pattern of
the matrix is kept, SuperLU eliminates in minimum degree order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import correlate

from kaju import Scene
from kaju.arrays import Floats
from kaju.factors import factors_of

from .bilinear import local_stiffness

POISSON, VOID, POWER, MOVE = 0.3, 1e-9, 3, 0.2


@dataclass(frozen=True)
class Beam:
    """A plane body of unit cells under a unit force, spread over a square of cells.

    "half beam": symmetric on the left, on a smooth wall below its last cells, pressed at its upper
    left; "cantilever": clamped on the left, pulled down in the middle of its right side.
    """

    kind: Literal["half beam", "cantilever"]
    cells: tuple[int, int]
    patch: int = 2  # Cells along each axis that take the force, or stand on the wall

    @property
    def pressed(self) -> tuple[slice, slice]:
        """The cells that take the force."""
        (columns, rows), w = self.cells, self.patch
        if self.kind == "half beam":
            return slice(0, w), slice(rows - w, rows)
        return slice(columns - w, columns), slice(rows // 2 - w // 2, rows // 2 + w - w // 2)

    def scene(self) -> Scene:
        """Return the same for kaju: below the half beam lies a row of air with a wall in it."""
        below = int(self.kind == "half beam")
        codes = np.zeros((self.cells[0], self.cells[1] + below), dtype=np.int64)
        codes[:, below:] = 1
        if below:
            codes[-self.patch :, 0] = 2
        x, y = self.pressed
        box = [[x.start, y.start + below], [x.stop, y.stop + below]]
        return Scene.from_array(
            codes,
            legend={0: "air", 1: "unit", 2: "roller"} if below else {1: "unit"},
            cell_size=1.0,
            thickness=1.0,
            materials={"unit": {"youngs_modulus": 1.0, "poissons_ratio": POISSON}},
            sides={"left": "roller" if below else "rigid"},
            loads=[{"region": {"box": box}, "force": [0.0, -1.0]}],
        )


class Bilinear:
    """Compliance of a beam by bilinear elements, whose stiffness differs element by element."""

    def __init__(self, beam: Beam) -> None:
        columns, rows = beam.cells
        node = np.arange((columns + 1) * (rows + 1)).reshape(columns + 1, rows + 1)
        corners = [node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]]
        unknown = np.stack([2 * c[..., None] + np.arange(2) for c in corners], axis=-2)
        unknown = unknown.reshape(-1, 8)
        lateral = POISSON / (1.0 - POISSON**2)
        self._element = local_stiffness(2, lateral, 0.5 / (1.0 + POISSON))
        load, held = np.zeros((node.size, 2)), np.zeros((node.size, 2), dtype=np.bool_)
        for corner in corners:
            np.add.at(load[:, 1], corner[beam.pressed].ravel(), -0.25 / beam.patch**2)
        held[node[0], 0] = True
        if beam.kind == "half beam":
            held[node[-beam.patch - 1 :, 0], 1] = True
        else:
            held[node[0], 1] = True
        free = ~held.ravel()
        self._number = np.where(free, np.cumsum(free) - 1, -1)[unknown]
        size = int(free.sum())
        row, column = (np.repeat(self._number, 8, 1), np.tile(self._number, (1, 8)))
        self._inside = ((row >= 0) & (column >= 0)).ravel()
        entry = (row.ravel() * size + column.ravel())[self._inside]
        places, self._place = np.unique(entry, return_inverse=True)
        start = np.searchsorted(places // size, np.arange(size + 1))
        self._pattern = (places % size).astype(np.int32), start.astype(np.int32)
        self._load, self._cells = load.ravel()[free], beam.cells

    def feel(self, stiffness: Floats) -> tuple[float, Floats]:
        """Return the compliance, and minus its derivative by every element's stiffness."""
        values = np.outer(stiffness.ravel(), self._element.ravel()).ravel()[self._inside]
        matrix = sp.csr_array(
            (np.bincount(self._place, values), *self._pattern), shape=(len(self._load),) * 2
        )
        moved = np.asarray(factors_of(matrix).solve(self._load))
        own = np.append(moved, 0.0)[self._number]
        saved = np.einsum("ei,ij,ej->e", own, self._element, own).reshape(self._cells)
        return float(self._load @ moved), saved


def optimised(
    beam: Beam,
    volume: float,
    radius: float,
    filter: Literal["density", "sensitivity"] = "density",
    steps: int = 60,
) -> Floats:
    """Return the densities of least compliance that the peer finds."""
    reach = int(np.ceil(radius)) - 1
    x, y = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    cone = np.maximum(radius - np.hypot(x, y), 0.0)

    def summed(values: Floats) -> Floats:
        return np.asarray(correlate(values, cone, mode="constant"))

    body, whole = Bilinear(beam), summed(np.ones(beam.cells))
    design = np.full(beam.cells, volume)
    density = design
    for _ in range(steps):
        _, saved = body.feel(VOID + (1.0 - VOID) * density**POWER)
        gain = POWER * (1.0 - VOID) * density ** (POWER - 1) * saved
        if filter == "density":
            gain, price = summed(gain / whole), summed(1.0 / whole)
        else:
            gain = summed(design * gain) / (whole * np.maximum(design, 1e-3))
            price = np.ones_like(design)
        low, high = 0.0, 1e9
        while high - low > 1e-3 * (high + low):
            middle = 0.5 * (low + high)
            grown = design * np.sqrt(gain / (price * middle))
            grown = np.clip(grown, np.maximum(design - MOVE, 0.0), np.minimum(design + MOVE, 1.0))
            density = summed(grown) / whole if filter == "density" else grown
            low, high = (middle, high) if density.mean() > volume else (low, middle)
        design = grown
    return density
