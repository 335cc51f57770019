"""Bodies given cell by cell: a drawing in letters, an image in colours, an array in codes.

All three become a `Picture`: one small integer per cell and the names these stand for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneError

MOST_CELLS = 200_000_000
"""Bodies above this many cells are never held cell by cell."""


@dataclass(frozen=True)
class Picture:
    """A body given cell by cell.

    Attributes
    ----------
    codes : ndarray of int
        For every cell an index into `names`; first index along x from the left, second
        along y from the bottom (front in 3-D), third along z from the bottom.
    names : tuple of str
        Materials, "air" and "rigid" that the codes stand for.
    """

    codes: NDArray[np.integer]
    names: tuple[str, ...]


def from_drawing(drawing: str, legend: Mapping[str, str]) -> Picture:
    """Read a drawing: one letter a cell, the top row first."""
    for letter in legend:
        if len(letter) != 1:
            raise SceneError(f"legend.{letter}: a drawing's legend explains single letters")
    rows = _rows(drawing, legend)
    names = tuple(dict.fromkeys(legend.values()))
    code = {letter: names.index(name) for letter, name in legend.items()}
    upwards = [[code[letter] for letter in row] for row in reversed(rows)]
    return Picture(np.array(upwards, dtype=np.int16).T, names)


def _rows(drawing: str, legend: Mapping[str, str]) -> list[str]:
    lines = drawing.strip("\n").splitlines()
    rows = lines if " " in legend else [line.strip() for line in lines]
    if not rows or not rows[0]:
        raise SceneError("body.drawing: is empty; draw one letter a cell, the top row first")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(rows[0]):
            raise SceneError(
                f"body.drawing: line {number} has {len(row)} letters, line 1 has "
                f"{len(rows[0])}; all rows must be equally long, with a letter for air"
            )
        for column, letter in enumerate(row, start=1):
            if letter not in legend:
                raise SceneError(
                    f"body.drawing: line {number}, letter {column} is {letter!r}, which [legend] "
                    f"does not explain; it explains {', '.join(map(repr, legend)) or 'nothing'}"
                )
    return rows
