"""Where two answers can be compared: points in both bodies, which must be the same body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ResultError
from kaju.model.reference import Reference
from kaju.model.result import Field, body_cells

if TYPE_CHECKING:
    from kaju.model.scene import Scene
    from kaju.model.scene.filling import CellBox

Floats = NDArray[np.float64]

MOST_POINTS = 2_000_000
"""Bodies of more cells than this are compared at points that the caller names."""

_SAME = 1e-9


@runtime_checkable
class Stressed(Protocol):
    """Whatever knows stresses."""

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""


def common_points(result: Field, other: Field | Reference) -> Floats:
    """Return where to compare: the middles of the larger cells, as far as both know them.

    Raises
    ------
    ResultError
        If the answers are of different bodies, or the body has too many cells.
    """
    if isinstance(other, Reference):
        centres = cell_centres(result.scene, result.grid)
        known = other.rows(centres) >= 0
        return centres if known.all() else other.points
    coarse, fine = sorted((result.scene, other.scene), key=lambda s: -s.lattice.cell_size)
    _same_body(coarse, fine)
    return cell_centres(coarse, result.grid, other.grid)


def cell_centres(scene: Scene, *others: Scene) -> Floats:
    """Return the middles (m) of a scene's cells of material that are body in others too."""
    cells = _cells_in(scene.bounds())
    cells = cells[scene.kinds(cells) >= 0]
    points = scene.lattice.centres(cells)
    for other in others:
        points = points[body_cells(other, points)[1]]
    return points


def _cells_in(box: CellBox) -> NDArray[np.int64]:
    lower, upper = box
    count = float(np.prod((upper - lower).astype(np.float64)))
    if count > MOST_POINTS:
        raise ResultError(
            f"points: the body has about {count:.2g} cells, more than {MOST_POINTS:.0e}; "
            "name the points to compare at with points=, such as the `middle` of spawned agents"
        )
    every = np.indices(tuple(upper - lower)).reshape(len(lower), -1).T
    cells: NDArray[np.int64] = every + lower
    return cells


def check_comparable(result: Field, other: Field | Reference) -> None:
    """Refuse what cannot be compared: other dimensions, materials, thickness or loads.

    Raises
    ------
    ResultError
        Naming what differs.
    """
    for answer in (result, other):
        if not isinstance(answer, (Field, Reference)):
            raise ResultError(
                f"compare: a {type(answer).__name__} has no body of cells; give "
                "results of load transfer or elasticity, or a Reference"
            )
    ours = result.scene.lattice.dimension
    theirs = other.dimension if isinstance(other, Reference) else other.scene.lattice.dimension
    if ours != theirs:
        raise ResultError(f"compare: a body in {ours} dimensions and one in {theirs} differ")
    if isinstance(other, Reference):
        return
    first, second = result.scene, other.scene
    if first.thickness != second.thickness:
        told = f"{first.thickness:g} and {second.thickness:g} m"
        raise ResultError(f"compare: the bodies differ in thickness: {told}")
    if first.plane != second.plane:
        raise ResultError(
            f"compare: one body is in plane {first.plane}, the other in plane {second.plane}"
        )
    _same_loads(result, other)


def _same_loads(result: Field, other: Field) -> None:
    totals = [_total_force(answer) for answer in (result, other)]
    largest = max(float(np.abs(total).max(initial=0.0)) for total in totals)
    if np.abs(totals[0] - totals[1]).max(initial=0.0) > 1e-6 * largest:
        told = [", ".join(f"{value:g}" for value in total) for total in totals]
        raise ResultError(
            f"compare: the loads differ: ({told[0]}) N and ({told[1]}) N in all; "
            "compare results of one load, at the same stage of loading"
        )


def _total_force(result: Field) -> Floats:
    total: Floats = result.scene.applied(result.stage).force.sum(axis=0)
    return total


def _same_body(coarse: Scene, fine: Scene) -> None:
    """Refuse bodies that differ by more than the steps that cells cut into a slanted surface.

    Such steps lie at a surface, or where materials meet, in both bodies.
    """
    if coarse is fine:
        return
    cell = coarse.lattice.cell_size
    for ours, theirs in zip(_corners(coarse), _corners(fine), strict=True):
        if np.abs(ours - theirs).max() > (1.0 + _SAME) * cell:
            told = [", ".join(f"{value:.4g}" for value in corner) for corner in (ours, theirs)]
            raise ResultError(
                f"compare: the bodies differ: one reaches to ({told[0]}) m, the other to "
                f"({told[1]}) m"
            )
    points = coarse.lattice.centres(_cells_in(coarse.bounds()))
    points = points[_differ(_constants(coarse, points), _constants(fine, points))]
    for scene in (coarse, fine):
        own = _constants(scene, points)
        step = np.zeros(len(points), dtype=np.bool_)
        for normal in coarse.lattice.normals:
            step |= _differ(own, _constants(scene, points + cell * normal))
        if not step.all():
            where = ", ".join(f"{value:.4g}" for value in points[np.argmin(step)])
            raise ResultError(f"compare: the bodies differ: by what is at ({where}) m")


def _corners(scene: Scene) -> tuple[Floats, Floats]:
    lower, upper = scene.bounds()
    ends = np.stack([lower, upper - 1])
    lowest, highest = scene.lattice.centres(ends)
    half = 0.5 * scene.lattice.cell_size
    return lowest - half, highest + half


def _constants(scene: Scene, points: Floats) -> Floats:
    """Return Young's modulus and Poisson's ratio at points, 0 where there is no body."""
    table = np.array([(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials])
    kinds = scene.kinds(scene.lattice.locate(points))
    found: Floats = np.where((kinds >= 0)[:, None], table[np.maximum(kinds, 0)], 0.0)
    return found


def _differ(one: Floats, other: Floats) -> NDArray[np.bool_]:
    different: NDArray[np.bool_] = np.any(np.abs(one - other) > _SAME * np.abs(one), axis=1)
    return different
