"""The grid of cells: where they are, who lies beside whom, and along which directions.

Three lattices: squares, cubes and regular hexagons (rows of hexagons standing on a corner,
odd rows half a cell to the right). A *direction* is a number: the index of a face normal.
The neighbour that lies in that direction is reached over the *arm* of the same number.
Cells are named by integer coordinates that count from 0 at left, front and bottom. Nothing
here is ever as large as the body: cells come and go as arrays of the cells asked about.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import prod, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kaju.agents.shares import Beside, Way
from kaju.errors import ParameterError

Cells = NDArray[np.int64]
"""Integer cell coordinates, shape (n, dimension)."""

LatticeKind = Literal["square", "cube", "hexagon"]

_AXIS_SIDES = {
    2: ("left", "right", "bottom", "top"),
    3: ("left", "right", "front", "back", "bottom", "top"),
}

# Steps to the neighbour in direction k * 60 degrees, for even and for odd rows.
_HEXAGON_STEPS = (
    ((1, 0), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1)),
    ((1, 0), (1, 1), (0, 1), (-1, 0), (0, -1), (1, -1)),
)


@dataclass(frozen=True)
class Lattice:
    """A regular arrangement of equal cells.

    Parameters
    ----------
    kind : {"square", "cube", "hexagon"}
        Form of a cell.
    shape : tuple of int
        Number of cells along x and y (and z for cubes). For hexagons: per row, and rows.
    cell_size : float
        Distance between two opposite faces of a cell (m).
    """

    kind: LatticeKind
    shape: tuple[int, ...]
    cell_size: float

    def __post_init__(self) -> None:
        expected = 3 if self.kind == "cube" else 2
        if len(self.shape) != expected:
            raise ParameterError(
                f"shape: a lattice of kind {self.kind!r} has {expected} numbers of cells, "
                f"got {self.shape}"
            )
        if prod(self.shape) >= 2**62:
            raise ParameterError(
                f"shape: {self.shape} is more than 2**62 cells, which no integer can count; "
                "use larger cells"
            )

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of cells, those of air and ground included."""
        return prod(self.shape)

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Outward unit normals of a cell's faces, shape (directions, dimension)."""
        if self.kind == "hexagon":
            angle = np.deg2rad(60.0 * np.arange(6))
            return np.stack([np.cos(angle), np.sin(angle)], axis=1)
        signs = np.array([-1.0, 1.0])
        return np.concatenate([np.outer(signs, axis) for axis in np.eye(self.dimension)])

    @property
    def directions(self) -> int:
        """Number of faces of a cell: 4, 6 (cube) or 6 (hexagon)."""
        return len(self.normals)

    @cached_property
    def opposite(self) -> NDArray[np.int64]:
        """For every direction the one that points the other way."""
        if self.kind == "hexagon":
            return (np.arange(6) + 3) % 6
        return np.arange(self.directions) ^ 1

    @cached_property
    def mirrored(self) -> NDArray[np.int64]:
        """Directions mirrored at a wall: `mirrored[n, d]` is d seen in a wall with normal n."""
        cosine = self.normals @ self.normals.T
        image = self.normals[None] - 2.0 * cosine[:, :, None] * self.normals[:, None]
        nearest: NDArray[np.int64] = np.argmax(image @ self.normals.T, axis=2)
        return nearest

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        """Coordinate steps over each arm, shape (2, directions, dimension).

        The first index is the cell's parity, which counts for hexagons only.
        """
        if self.kind == "hexagon":
            return np.array(_HEXAGON_STEPS, dtype=np.int64)
        return np.stack([self.normals, self.normals]).astype(np.int64)

    @cached_property
    def key_steps(self) -> NDArray[np.int64]:
        """What a step over each arm adds to a cell's key, shape (2, directions)."""
        origin = np.zeros((1, self.dimension), dtype=np.int64)
        steps = self.steps.reshape(-1, self.dimension)
        return (self.key(steps) - self.key(origin)).reshape(2, self.directions)

    @cached_property
    def axes(self) -> NDArray[np.int64]:
        """One direction of each opposite pair: the positive sense of the cell's axes."""
        if self.kind == "hexagon":
            return np.arange(3)
        return np.arange(1, self.directions, 2)

    @cached_property
    def axis_of(self) -> NDArray[np.int64]:
        """For every direction the index of its axis in `axes`."""
        if self.kind == "hexagon":
            return np.arange(6) % 3
        return np.arange(self.directions) // 2

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Readable names: "-x", "+x", ... or "0°", "60°", ..."""
        if self.kind == "hexagon":
            return tuple(f"{60 * k}°" for k in range(6))
        return tuple(sign + axis for axis in "xyz"[: self.dimension] for sign in "-+")

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides of the array, lower before upper, axis by axis."""
        return _AXIS_SIDES[self.dimension]

    def way(self, direction: int, parity: int) -> Way:
        """Return the neighbours of a cell as a load sees them that travels in a direction.

        Across a square or a cube every face that is neither ahead nor behind takes the full
        friction and the full Poisson share. Of a hexagon's four faces beside, those at ±60°
        feel friction, and all four feel the Poisson expansion, by sin²60° = 3/4.
        """
        ahead, behind = ((direction, 1.0),), ((int(self.opposite[direction]), 1.0),)
        if self.kind == "hexagon":
            turns = ((1, 1.0), (2, 0.0), (4, 0.0), (5, 1.0))
            beside = [Beside((direction + turn) % 6, weight, 0.75) for turn, weight in turns]
        else:
            arms = [arm for arm in range(self.directions) if arm // 2 != direction // 2]
            beside = [Beside(arm, 1.0, 1.0) for arm in arms]
        return Way(ahead, behind, tuple(beside))

    def parity(self, cells: Cells) -> NDArray[np.int64]:
        """Tell which of two forms each cell has; of hexagons, whether its row is odd."""
        return cells[:, 1] & 1

    def neighbours(self, cells: Cells, arm: int) -> Cells:
        """Return the cells reached from `cells` over one arm (they may lie outside)."""
        reached: Cells = cells + self.steps[self.parity(cells), arm]
        return reached

    def contains(self, cells: Cells) -> NDArray[np.bool_]:
        """Tell which cells lie inside the array."""
        inside: NDArray[np.bool_] = np.all((cells >= 0) & (cells < np.asarray(self.shape)), axis=1)
        return inside

    def side_beyond(self, cells: Cells) -> NDArray[np.int64]:
        """Return for each cell the index in `sides` that it lies beyond, -1 inside.

        A cell beyond two sides (outside a corner) counts for the later of them in `sides`.
        """
        beyond = np.full(len(cells), -1, dtype=np.int64)
        for axis, count in enumerate(self.shape):
            beyond[cells[:, axis] < 0] = 2 * axis
            beyond[cells[:, axis] >= count] = 2 * axis + 1
        return beyond

    def key(self, cells: Cells) -> NDArray[np.int64]:
        """Give each cell a number of its own, those in the rim just outside included."""
        padded = np.asarray(self.shape, dtype=np.int64) + 2
        key = cells[:, 0] + 1
        for axis in range(1, self.dimension):
            key = key * padded[axis] + cells[:, axis] + 1
        return key

    def cells(self, key: NDArray[np.int64]) -> Cells:
        """Turn numbers made by `key` back into cell coordinates."""
        padded = np.asarray(self.shape, dtype=np.int64) + 2
        columns = []
        for axis in range(self.dimension - 1, 0, -1):
            key, column = np.divmod(key, padded[axis])
            columns.append(column - 1)
        columns.append(key - 1)
        return np.stack(columns[::-1], axis=1)

    def line(self, cells: Cells, axis: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the line along an axis that each cell lies on, and its position there.

        Lines are numbered; positions count cells along the axis' positive sense.
        """
        if self.kind == "hexagon":
            column, row = cells[:, 0], cells[:, 1]
            if axis == 0:
                return row.copy(), column.copy()
            slanted = column - (row - (row & 1)) // 2
            return (slanted if axis == 1 else slanted + row), row.copy()
        foot = cells.copy()
        foot[:, axis] = 0
        return self.key(foot), cells[:, axis].copy()

    def on_line(self, line: NDArray[np.int64], position: NDArray[np.int64], axis: int) -> Cells:
        """Return the cells at positions on lines: the inverse of `line`."""
        if self.kind == "hexagon":
            if axis == 0:
                return np.stack([position, line], axis=1)
            slanted = line if axis == 1 else line - position
            column = slanted + (position - (position & 1)) // 2
            return np.stack([column, position], axis=1)
        cells = self.cells(line)
        cells[:, axis] = position
        return cells

    def centres(self, cells: Cells) -> NDArray[np.float64]:
        """Return the middle points of cells (m), shape (n, dimension)."""
        if self.kind == "hexagon":
            x = cells[:, 0] + 0.5 + 0.5 * (cells[:, 1] & 1)
            y = (cells[:, 1] + 2.0 / 3.0) * (sqrt(3.0) / 2.0)
            return np.stack([self.cell_size * x, self.cell_size * y], axis=1)
        return self.cell_size * (cells.astype(np.float64) + 0.5)

    def locate(self, points: NDArray[np.float64]) -> Cells:
        """Return the cell that each point (m) lies in; outside the array too."""
        scaled = np.asarray(points, dtype=np.float64) / self.cell_size
        if self.kind != "hexagon":
            return np.floor(scaled).astype(np.int64)
        row = np.floor(scaled[:, 1] / (sqrt(3.0) / 2.0) - 1.0 / 6.0).astype(np.int64)
        column = np.floor(scaled[:, 0] - 0.5 * (row & 1)).astype(np.int64)
        guess = np.stack([column, row], axis=1)
        # The rows overlap by the corners: of the guess and its neighbours the nearest holds.
        candidates = np.stack([guess, *(self.neighbours(guess, arm) for arm in range(6))])
        offset = np.stack([self.centres(c) for c in candidates]) - points
        nearest = np.argmin((offset**2).sum(axis=2), axis=0)
        found: Cells = candidates[nearest, np.arange(len(points))]
        return found

    @property
    def extent(self) -> tuple[float, ...]:
        """Size of the bounding box of the array (m)."""
        if self.kind == "hexagon":
            width = self.shape[0] + (0.5 if self.shape[1] > 1 else 0.0)
            height = (self.shape[1] - 1) * sqrt(3.0) / 2.0 + 2.0 / sqrt(3.0)
            return (self.cell_size * width, self.cell_size * height)
        return tuple(self.cell_size * count for count in self.shape)

    def face_area(self, thickness: float = 1.0) -> float:
        """Return the area of a cell's face (m²); `thickness` (m) counts in two dimensions."""
        if self.kind == "cube":
            return self.cell_size**2
        edge = self.cell_size / (sqrt(3.0) if self.kind == "hexagon" else 1.0)
        return edge * thickness

    def cell_volume(self, thickness: float = 1.0) -> float:
        """Return the volume of a cell (m³); `thickness` (m) counts in two dimensions."""
        if self.kind == "cube":
            return self.cell_size**3
        area = self.cell_size**2 * (sqrt(3.0) / 2.0 if self.kind == "hexagon" else 1.0)
        return area * thickness
