"""Regular and random networks, held and pressed, ready to load.

Positions are in m, stiffnesses in N/m, forces in N; the defaults of 1 make a model whose
forces are shares of stiffness times spacing. `spacing` is the distance between neighbours,
`stiffness` K of every spring, `force` the total one from above; the same `seed` gives the same
network. Every spring starts at its rest length. Too few nodes, or a number outside its rule, raise
`ParameterError`.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ParameterError, require
from kaju.model.scene.curves import cross

from .springs import SpringNetwork, with_some


def triangular(
    width: int,
    rows: int | None = None,
    *,
    spacing: float = 1.0,
    stiffness: float = 1.0,
    force: float = 0.1,
) -> SpringNetwork:
    """Return the triangular lattice pressed between two points.

    Rows of `width` and `width - 1` nodes in turn, joined along and across: 3 `rows` of width 3, as
    many unless given, have 3 + 2 + 3 nodes. The ends of the long rows stick out on both sides and
    are held; a force presses on the middle of the top row from above, and as strongly on the middle
    of the bottom row from below. Where a row has two middle nodes they share the force. A node is
    named by its row, counted from the bottom, and its place in it.
    """
    rows = width if rows is None else rows
    row, place, positions = _nodes(width, rows, spacing)
    length = width - row % 2
    held = (row % 2 == 0) & ((place == 0) | (place == length - 1))
    forces = np.zeros_like(positions)
    for pressed, sense in ((row == rows - 1, -1.0), (row == 0, 1.0)):
        middle = pressed & (np.abs(2 * place - (length - 1)) <= 1)
        forces[middle, 1] = sense * force / middle.sum()
    forces[held] = 0.0
    if force and not forces.any():
        raise ParameterError(f"width: at {width} only held nodes are pressed; take 3 or more")
    return SpringNetwork.build(
        positions,
        _triangular_springs(row, place),
        stiffness,
        held=held,
        forces=forces,
        names=list(zip(row.tolist(), place.tolist(), strict=True)),
    )


def jittered(
    width: int,
    rows: int | None = None,
    *,
    jitter: float = 0.3,
    seed: int = 0,
    spacing: float = 1.0,
    stiffness: float = 1.0,
    force: float = 0.1,
) -> SpringNetwork:
    """Return a triangular lattice whose inner nodes were moved by chance, joined anew.

    It has no rows along which cracks would rather run. Springs are the edges of a Delaunay
    triangulation, as stiff as bars of one cross-section: `stiffness` is that of a spring as long as
    the `spacing`, and falls with the length. It stands on its bottom row and is pressed from above.
    `width`, `rows`: as of `triangular`; `jitter`: largest shift along x and y, as a share of the
    spacing, from 0 to below 0.5.
    """
    rows = width if rows is None else rows
    right = 0.0 <= jitter < 0.5
    require(right, f"jitter: must be a share from 0 to below 0.5, got {jitter}")
    row, place, positions = _nodes(width, rows, spacing)
    last = width - 1 - row % 2
    inner = (row > 0) & (row < rows - 1) & (place > 0) & (place < last)
    shift = np.random.default_rng(seed).uniform(-jitter, jitter, positions.shape)
    positions += spacing * inner[:, None] * shift
    corners = Delaunay(positions).simplices.astype(np.int64)
    edges = _pairs(corners[:, [0, 0, 1]], corners[:, [1, 2, 2]])
    springs = np.unique(np.sort(edges, axis=1), axis=0)
    length = np.linalg.norm(np.diff(positions[springs], axis=1)[:, 0], axis=1)
    ends = (place == 0) | (place == last)
    share = np.where(ends, 0.5, 1.0)
    top = row == rows - 1
    forces = np.zeros_like(positions)
    forces[top, 1] = -force * share[top] / share[top].sum()
    return SpringNetwork.build(
        positions,
        springs,
        stiffness * spacing / length,
        held=row == 0,
        forces=forces,
        names=list(zip(row.tolist(), place.tolist(), strict=True)),
    )


def cut(network: SpringNetwork, start: ArrayLike, end: ArrayLike) -> SpringNetwork:
    """Return a plane network without the springs that cross the line from `start` to `end` (m)."""
    require(network.dimension == 2, "network: only plane networks can be cut along a line")
    tips = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    first, second = network.positions[network.springs].transpose(1, 0, 2)
    return with_some(network, ~(_apart(*tips, first, second) & _apart(first, second, *tips)))


def _apart(start: Floats, end: Floats, one: Floats, other: Floats) -> Flags:
    """Tell where two points lie on different sides of the line through two others."""
    along = end - start
    return np.asarray(cross(along, one - start) * cross(along, other - start) < 0.0)


def pulled(
    network: SpringNetwork, force: float = 1.0, *, displacement: float | None = None
) -> SpringNetwork:
    """Return a plane network that is pulled up by its top, and stands on rollers below.

    `force`: in total (N), as a constant stress along the highest nodes; `displacement`: how far
    these are moved up (m) instead.
    """
    require(network.dimension == 2, "network: only plane networks can be pulled at their top")
    across, height = network.positions.T
    low, high = (np.flatnonzero(height == level) for level in (height.min(), height.max()))
    held = np.zeros_like(network.held)
    held[low, 1] = True
    held[low[np.argmin(np.abs(across[low] - across[low].mean()))]] = True
    load, nothing = np.zeros_like(network.positions), np.zeros_like(network.positions)[None]
    if displacement is not None:
        held[high, 1] = True
        load[high, 1] = displacement
        return replace(network, held=held, forces=nothing, displacements=load[None])
    order = high[np.argsort(across[high])]
    width = np.diff(across[order])
    load[order[1:], 1] += 0.5 * width
    load[order[:-1], 1] += 0.5 * width
    load *= force / width.sum()
    return replace(network, held=held, forces=load[None], displacements=nothing)


def _nodes(width: int, rows: int, spacing: float) -> tuple[Ints, Ints, Floats]:
    """Return row, place in its row, and position (m) of every node of a triangular lattice."""
    for name, value in (("width", width), ("rows", rows)):
        require(value >= 2, f"{name}: must be at least 2, got {value}")
    right = isfinite(spacing) and spacing > 0.0
    require(right, f"spacing: must be a length above 0 m, got {spacing}")
    row, place = (index.ravel() for index in np.indices((rows, width)))
    exists = place < width - row % 2
    row, place = row[exists], place[exists]
    across, height = place + 0.5 * (row % 2), row * (np.sqrt(3.0) / 2.0)
    return row, place, spacing * np.stack([across, height], axis=1)


def _triangular_springs(row: Ints, place: Ints) -> Ints:
    """Return the springs along the rows, and from each row to the next."""
    number = np.full((row.max() + 2, place.max() + 2), -1, dtype=np.int64)  # -1: beyond the lattice
    number[row, place] = np.arange(len(row))
    left = place - 1 + row % 2  # place of the upper left neighbour in the next row
    upper_left = np.where(left >= 0, number[row + 1, left], -1)
    ends = [number[row, place + 1], upper_left, number[row + 1, left + 1]]
    every = np.concatenate([_pairs(np.arange(len(row)), end) for end in ends])
    return every[every[:, 1] >= 0]


def _pairs(first: Ints, second: Ints) -> Ints:
    return np.stack([first.ravel(), second.ravel()], axis=1)
