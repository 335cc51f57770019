"""Choosing what to show of a body: the surroundings of what matters, or a layer of cubes."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from kaju.errors import ParameterError

from .section import Ints, Section

if TYPE_CHECKING:
    from kaju.model.scene import Scene

MOST_ACROSS = 240
"""At most this many tiles lie side by side."""
WHOLE_UP_TO = 64
"""Bodies of up to this many cells across are never cropped."""


def section_of(
    scene: Scene,
    cells: Ints | None = None,
    cut: Mapping[str, float] | None = None,
    crop: bool | None = None,
    most_across: int = MOST_ACROSS,
    whole_up_to: int = WHOLE_UP_TO,
) -> Section:
    """Choose what to show: the given cells with a margin, or the whole body.

    Parameters
    ----------
    scene : Scene
        The body.
    cells : array of int, shape (n, dimension), optional
        What the picture is about; the whole body unless given. Of a three-dimensional body
        the layer that holds most of them is shown unless `cut` is given.
    cut : dict of one axis to a place (m), optional
        Shows the layer of a three-dimensional body there, such as ``{"y": 0.05}``.
    crop : bool, optional
        Whether to leave out the body far from the cells; unless given, bodies of more than
        `whole_up_to` cells across are cropped.
    most_across : int
        Where more cells than this lie side by side, tiles are blocks of cells.
    whole_up_to : int
        Bodies of up to this many cells across are shown as a whole.

    Raises
    ------
    ParameterError
        If the cut names no axis, or lies outside the body.
    """
    if cells is None:
        cells, crop = np.empty((0, scene.lattice.dimension), dtype=np.int64), False
    where = _cut_of(scene, cells, cut)
    axes = (0, 1)
    if where is not None:
        first, second = (axis for axis in range(3) if axis != where[0])
        axes = (first, second)
        cells = cells[cells[:, where[0]] == where[1]]
    shape = np.array(scene.lattice.shape)[[*axes]]
    lower, upper = np.zeros(2, dtype=np.int64), shape
    if shape.max() > WHOLE_UP_TO:
        lower, upper = (corner[[*axes]] for corner in scene.bounds())
    whole = (upper - lower).max() <= whole_up_to if crop is None else not crop
    near_lower, near_upper = _around(cells[:, axes], lower, upper)
    cropped = not whole and bool(len(cells)) and _saves(near_upper - near_lower, upper - lower)
    if cropped:
        lower, upper = near_lower, near_upper
    block = ceil(int((upper - lower).max()) / most_across)
    rim = max(1, round(0.04 * int((upper - lower).max())))
    return Section(scene, lower - rim, upper + rim, axes, where, block, cropped)


def _around(flat: Ints, lower: Ints, upper: Ints) -> tuple[Ints, Ints]:
    if not len(flat):
        return lower, upper
    first, last = flat.min(axis=0), flat.max(axis=0) + 1
    span = last - first
    margin = np.maximum(3, np.rint(np.maximum(0.15 * span, 0.05 * span.max())).astype(np.int64))
    return np.maximum(first - margin, lower), np.minimum(last + margin, upper)


def _saves(part: Ints, whole: Ints) -> bool:
    """Tell whether a crop is worth its trouble."""
    return bool(np.prod(part / whole) <= 0.6)


def _cut_of(scene: Scene, cells: Ints, cut: Mapping[str, float] | None) -> tuple[int, int] | None:
    shape = scene.lattice.shape
    if len(shape) == 2:
        if cut is not None:
            raise ParameterError(f"cut: only bodies of cubes can be cut, got {dict(cut)!r}")
        return None
    if cut is None:
        return _fullest_layer(scene, cells)
    if len(cut) != 1 or next(iter(cut)) not in ("x", "y", "z"):
        raise ParameterError(
            f"cut: one of the axes 'x', 'y' and 'z' with a place in m, such as {{'y': 0.05}}, "
            f"got {dict(cut)!r}"
        )
    ((name, place),) = cut.items()
    axis = "xyz".index(name)
    return axis, layer_at(scene, axis, place)


def layer_at(scene: Scene, axis: int, place: float) -> int:
    """Return the layer of cells that a plane through a body lies in.

    Raises
    ------
    ParameterError
        If the place (m) along the axis lies outside of the array of cells.
    """
    edge, count = scene.lattice.cell_size, scene.lattice.shape[axis]
    number = isinstance(place, (int, float, np.number)) and not isinstance(place, bool)
    if not (number and 0.0 <= place <= edge * count):
        raise ParameterError(f"cut: {'xyz'[axis]} runs from 0 to {edge * count:g} m, got {place!r}")
    # On a plane between two layers rounding must not decide which of them is shown.
    return min(int(place / edge + 1e-9), count - 1)


def _fullest_layer(scene: Scene, cells: Ints) -> tuple[int, int]:
    """Return the layer with most of the cells, out of those that the loads run along.

    Layers lie across y, or across x if the loads mainly run along y. Of layers with about as
    many cells it is the middle one; without cells that of the body.
    """
    along = np.abs(scene.applied().force).sum(axis=0)
    axis = 0 if along[1] > along[[0, 2]].max() else 1
    if not len(cells):
        return axis, scene.lattice.shape[axis] // 2
    layers, counts = np.unique(cells[:, axis], return_counts=True)
    full = layers[counts >= 0.95 * counts.max()]
    return axis, int(full[len(full) // 2])
