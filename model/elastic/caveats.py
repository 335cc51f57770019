"""What is to be known of an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. Here stands how
far it is from the body and the loads that were described.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, first_largest
from kaju.errors import SingularPlaceError
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Cells
from kaju.model.scene.shapes import Box, Shape

from .corners import singular_at
from .spawning.quantities import DISPLACEMENT, Stress, ToleranceAt, quantities_of

if TYPE_CHECKING:
    from .elastic_result import ElasticResult

ROUGH = 0.1
"""From this estimated error on an answer says what to do about it."""
STEPPED = 0.2
"""What steps change of the energy, as a share of the energy within a cell of them. Of rings, holes
and Cook's membrane the truth was 0.4 to 1.9 times this (tests/elasticity/test_caveats.py)."""
SAMPLES = 4
"""Points along the edge of a cell by which an outline is found in it."""
MOST_CELLS = 1_000_000
"""Outlines of more cells are not looked through."""
ON_EDGE = 1e-6
"""Of a cell: what is nearer to an edge lies on it."""


def caveats(result: ElasticResult) -> list[str]:
    """Return, in words, what is approximate beside the error that the answer estimates."""
    return [*_rough(result), *_off_the_faces(result.grid), *_steps(result), *_no_limit(result)]


def refuse_singular(scene: Scene, tolerance_at: ToleranceAt) -> None:
    """Refuse to look for a stress at a point where it has no limit.

    Raises
    ------
    SingularPlaceError
        With the point, the reason and the way out.
    """
    if isinstance(tolerance_at, str) and tolerance_at == DISPLACEMENT:
        return
    h = scene.lattice.cell_size
    for quantity in quantities_of(tolerance_at):
        if not isinstance(quantity, Stress) or not isinstance(quantity.at, tuple):
            continue
        point = np.asarray(quantity.at)
        reason = singular_at(scene, point) if len(point) == scene.lattice.dimension else ""
        if reason:
            box = [(point - 2 * h).tolist(), (point + 2 * h).tolist()]
            raise SingularPlaceError(
                f"tolerance_at: the stress at {_told(point)} m has no limit, since there {reason}; "
                f"ask for its mean over a stated region, such as Stress({{'box': {box}}}, "
                f"{quantity.component!r}), or round the corner"
            )


def stepped_cells(scene: Scene) -> Cells:
    """Return the cells that slanted and round outlines of regions cross, shape (n, dimension)."""
    lattice = scene.lattice
    found = [np.empty((0, lattice.dimension), dtype=np.int64)]
    for number, region in enumerate(scene.body.regions):
        if region.image is not None:  # pixels lie along the axes, and a stored scene has none
            continue
        shape = region.shape_in(lattice, f"body.regions.{number}")
        if not isinstance(shape, Box):
            found.append(_crossed(shape, scene))
    return np.unique(np.concatenate(found), axis=0)


def largest_von_mises(result: ElasticResult, but: Flags | None = None) -> tuple[float, Floats]:
    """Return the largest equivalent stress (Pa) of an agent, and the agent's middle (m).

    The agents `but` are left out, unless none is left.
    """
    stress = result.von_mises
    if but is not None and not but.all():
        stress = np.where(but, 0.0, stress)
    agent = first_largest(stress)
    return float(stress[agent]), result.middle[agent]


def _rough(result: ElasticResult) -> list[str]:
    error = result.error_estimate
    if result.tolerance is not None or not error > ROUGH:
        return []
    return [
        f"the estimated error is {error:.0%} in the energy norm: ask for less by tolerance=0.05 "
        "(kaju solve FILE --tolerance 0.05)"
    ]


def _off_the_faces(grid: Scene) -> list[str]:
    """Say which loads end inside a face, or grow along it, and act on it evenly all the same."""
    found, h = [], grid.lattice.cell_size
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        if np.any(chosen.share < 1.0 - ON_EDGE) and load.region is not None:
            found.append(
                f"loads.{number}: its region ends inside cells, and acts on the whole of each, "
                f"which moves its edge by up to {h:.3g} m; smaller cells or a resolution lessen it"
            )
        elif load.point is not None and not _in_middle(load.point, chosen.cells, grid):
            found.append(
                f"loads.{number}: acts at a point, and is spread evenly over the {h:.3g} m of its "
                "cell, which moves it by up to half of that; smaller cells lessen it"
            )
        elif load.pressure_slope is not None:
            change = 0.5 * h * float(np.abs(load.pressure_slope).max())
            found.append(
                f"loads.{number}: its pressure changes by up to {change:.3g} Pa from the middle "
                "of a face to its edge, and acts evenly on each; smaller cells lessen it"
            )
    return found


def _in_middle(point: tuple[float, ...], cells: Cells, grid: Scene) -> bool:
    """Tell whether a point is the middle of what carries its load, but for the load's own axis."""
    lower, upper = cells.min(axis=0), cells.max(axis=0) + 1
    off = np.asarray(point) / grid.lattice.cell_size - 0.5 * (lower + upper)
    return int((np.abs(off) > ON_EDGE).sum()) <= int(np.any(np.abs(np.abs(off) - 0.5) <= ON_EDGE))


def _steps(result: ElasticResult) -> list[str]:
    grid = result.grid
    steps = stepped_cells(grid)
    if not len(steps):
        return []
    h = grid.lattice.cell_size
    near = _near(result, steps)
    share = _energy_of(result, near)
    _, at = largest_von_mises(result)
    said = (
        f"round and slanted outlines are steps of {h:.3g} m, and what is proved is proved for the "
        f"body of cells: the energy of the body described differs by an estimated {share:.1g} of it"
    )
    if near[first_largest(result.von_mises)]:
        value, place = largest_von_mises(result, near)
        said += (
            f"; the largest stress, at {_told(at)} m, is an artefact of a step and grows with "
            f"smaller agents. More than a cell away from steps it is {value:.3g} Pa, at "
            f"{_told(place)} m (von Mises)"
        )
    return [said]


def _no_limit(result: ElasticResult) -> list[str]:
    corners = result.sharp_corners
    steps = stepped_cells(result.scene)
    if len(corners) and len(steps):  # those of steps have a note of their own
        from_steps = np.abs(corners[:, None] / result.scene.lattice.cell_size - steps - 0.5)
        corners = corners[np.all(from_steps.max(axis=2) > 0.5 + ON_EDGE, axis=1)]
    if not len(corners):
        return []
    places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in corners[:3].tolist())
    more = f" and {len(corners) - 3} more" if len(corners) > 3 else ""
    return [f"stress grows without limit under refinement at the corner {places} m{more}"]


def has_limit(result: ElasticResult, agent: int) -> str:
    """Return why the stress of an agent has no limit under refinement; empty if it has."""
    steps = stepped_cells(result.grid)
    if len(steps) and _near(result, steps)[agent]:
        return "a step of an outline that is not along the axes"
    for corner in product((0.0, 1.0), repeat=result.scene.lattice.dimension):
        reason = singular_at(
            result.scene, result.lower[agent] + result.size[agent] * np.array(corner)
        )
        if reason:
            return reason
    return ""


def _energy_of(result: ElasticResult, near: Flags) -> float:
    """Return what steps are expected to change of the energy, by that of the agents near them."""
    dimension = result.scene.lattice.dimension
    density = np.einsum("nij,nij->n", result.stress, result.strain)
    energy = density * result.size**dimension
    return STEPPED * float(energy[near].sum() / (energy.sum() or 1.0))


def _near(result: ElasticResult, cells: Cells) -> Flags:
    """Tell which agents lie in some cells of the grid, or in those beside them."""
    lattice = result.grid.lattice
    around = np.array(list(product((-1, 0, 1), repeat=lattice.dimension)))
    ring = (cells[:, None] + around).reshape(-1, lattice.dimension)
    ring = ring[np.all((ring >= 0) & (ring < np.asarray(lattice.shape)), axis=1)]
    own = np.floor(result.middle / lattice.cell_size).astype(np.int64)
    return np.isin(lattice.key(own), lattice.key(ring))


def _crossed(shape: Shape, scene: Scene) -> Cells:
    """Return the cells of the array that have points inside and outside of a shape."""
    lattice = scene.lattice
    h, extent = lattice.cell_size, np.asarray(lattice.shape)
    lower, upper = (np.floor(corner / h).astype(np.int64) for corner in shape.extent)
    lower, upper = np.maximum(lower - 1, 0), np.minimum(upper + 2, extent)
    none = np.empty((0, lattice.dimension), dtype=np.int64)
    if np.prod(np.maximum(upper - lower, 0), dtype=np.float64) > MOST_CELLS:
        return none
    ranges = [np.arange(low, high) for low, high in zip(lower, upper, strict=True)]
    cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, lattice.dimension)
    within = (np.arange(SAMPLES) + 0.5) / SAMPLES
    inside = np.zeros(len(cells), dtype=np.int64)
    for offset in product(within, repeat=lattice.dimension):
        inside += shape.contains((cells + np.array(offset)) * h)
    crossed: Cells = cells[(inside > 0) & (inside < SAMPLES**lattice.dimension)]
    return crossed


def _told(point: Floats) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
