"""What is approximate in an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. This module says
how far it is from the body and the loads that were described.
"""

from __future__ import annotations

from itertools import product
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, first_largest
from kaju.errors import SingularPlaceError
from kaju.model.elastic.goals.quantities import AskedFor, Stress, quantities_of
from kaju.model.elastic.pair.leaves import corner_ends
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR
from kaju.model.scene.lattice import Cells
from kaju.model.scene.resolved_body import relation
from kaju.model.scene.shapes import Box, Shape

from .corners import sharp_corners, singular_at

if TYPE_CHECKING:
    from kaju.model.scene.loads import LoadTable
    from kaju.model.scene.selection import Selection

    from .elastic_result import ElasticResult

ROUGH = 0.1  # From this estimated error on an answer says what to do about it: a choice
STEPPED = 0.2
"""What steps change of the energy, as a share of the energy within a cell of them. Of rings, holes
and Cook's membrane the truth was 0.4 to 1.9 times this (tests/elasticity/test_caveats.py)."""
SAMPLES = {2: 4, 3: 2}  # Points along the edge of a cell by which an outline is found in it
STEPS_OF_COUPLE = 0.01  # Share of a couple's moment from which on its steps are a caveat: a choice


class Caveat(NamedTuple):
    """What is approximate, in a few words for pictures, and in full."""

    brief: str
    full: str


def refuse_singular(scene: Scene, goal: AskedFor, stage: int | None, name: str = "goal") -> None:
    """Refuse to look for a stress at a point where it has no limit."""
    h = scene.lattice.cell_size
    for quantity in quantities_of(goal):
        if not isinstance(quantity, Stress) or not isinstance(quantity.at, tuple):
            continue
        point = np.asarray(quantity.at)
        fits = len(point) == scene.lattice.dimension
        if fits and (reason := singular_at(scene, point, stage)):
            box = [(point - 2 * h).tolist(), (point + 2 * h).tolist()]
            raise SingularPlaceError(
                f"{name}: the stress at {_point(point)} m has no limit, because there {reason}; "
                f"ask for its mean over a region, such as Stress({{'box': {box}}}, "
                f"{quantity.component!r}), or, at a re-entrant corner, for result.intensity"
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


def steps_near(grid: Scene, middle: Floats) -> tuple[Cells, Flags]:
    """Return the cells that outlines cross, and which agents lie in them or beside them."""
    lattice, stepped = grid.lattice, stepped_cells(grid)
    if not len(stepped):
        return stepped, np.zeros(len(middle), dtype=np.bool_)
    near = stepped
    for step in np.eye(lattice.dimension, dtype=np.int64):
        near = np.unique(np.concatenate([near - step, near, near + step]), axis=0)
    near = near[lattice.contains(near)]
    own = np.floor(middle / lattice.cell_size).astype(np.int64)
    return stepped, np.isin(lattice.key(own), lattice.key(near))


def no_limit(result: ElasticResult, agent: int, *, near_step: bool) -> str:
    """Return why the stress of an agent has no limit under refinement; empty if it has."""
    if result.scene.outlined and result.scene.lattice.dimension == 3:
        return "perhaps; corners are not looked at within true outlines"
    if result.scene.outlined:
        away = result.sharp_corners - result.lower[agent]
        near = ((away >= 0.0) & (away <= result.size[agent])).all(axis=1)
        return "a sharp corner of an outline" if near.any() else ""
    if near_step:
        return "a step of an outline that is not along the axes"
    for corner in corner_ends(result.scene.lattice.dimension):
        at = result.lower[agent] + result.size[agent] * corner
        if reason := singular_at(result.scene, at, result.stage):
            return reason
    return ""


def caveats_of(result: ElasticResult, stepped: Cells, near: Flags) -> tuple[Caveat, ...]:
    """Return what is approximate beside the error that an answer estimates."""
    found = [*_rough(result), *_loads(result)]
    if result.scene.outlined and result.scene.lattice.dimension == 2:
        return (*found, *_at_corners(result.sharp_corners))
    if len(stepped):
        found.append(_steps(result, near))
    return (*found, *_no_limit(result.grid, stepped))


def _rough(result: ElasticResult) -> list[Caveat]:
    error = result.error_estimate
    # What is said of goals is about their own error, and a proof says more than an estimate.
    kept = result.tolerance_kept
    if result.goal or kept == "proved" or not error > ROUGH:
        return []
    if not isfinite(error):
        said = "the lower bound of the energy is 0, so it has no relative error: "
        said += "supports bear the loads where they act, and hardly any energy is stored"
        return [Caveat("error not known", said)]
    said = f"the error is about {error:.0%} in the energy norm"
    if kept != "missed":  # else the notes tell what hinders, which no smaller tolerance mends
        name, value = "tolerance", f"{0.5 * min(result.tolerance or 0.1, error):.2g}"
        if result.found.storage == "solid":  # no tolerance can be asked of these
            name, value = "resolution", f"{2 * result.subdivision}"
        said += f"; for a smaller one take {name}={value} (kaju solve FILE --{name} {value})"
    return [Caveat(f"error about {error:.0%}", said)]


def _loads(result: ElasticResult) -> list[Caveat]:
    """Say which loads do not act just where they are described, and how far off they are."""
    grid, found = result.grid, []
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        if off := _off_place(load, chosen, grid):
            found.append(Caveat(f"loads.{number} spread by cells", f"loads.{number}: {off}"))
    uneven = None if result.spawned else grid.applied(result.stage).uneven
    if uneven is not None and np.any(uneven.part % 1.0):
        said = "loads end within faces, which take their force and moments alone; smaller cells, "
        said += "or a tolerance, take them as they are"
        found.append(Caveat("loads end within faces", said))
    return found


def _steps(result: ElasticResult, near: Flags) -> Caveat:
    h = result.grid.lattice.cell_size
    density = np.einsum("nij,nij->n", result.stress, result.strain)
    energy = density * result.size**result.scene.lattice.dimension
    share = STEPPED * float(energy[near].sum() / (energy.sum() or 1.0))
    said = (
        f"round and slanted outlines are steps of {h:.3g} m, and proofs are about the body of "
        "cells: its energy differs from that of the body described by an estimated "
        f"{100 * share:.1g} %"
    )
    if near[first_largest(result.von_mises)]:
        said += (
            f"; the largest stress, at {_point(result.largest_stress.at)} m, lies at a step: it "
            "is not real, and grows with smaller agents"
        )
        if not near.all():
            stress = np.where(near, 0.0, result.von_mises)
            agent = first_largest(stress)
            said += (
                f". More than a cell away from steps it is {stress[agent]:.3g} Pa, at "
                f"{_point(result.middle[agent])} m (von Mises)"
            )
    return Caveat(f"outlines are steps of {h:.3g} m", said)


def _no_limit(grid: Scene, stepped: Cells) -> list[Caveat]:
    corners = sharp_corners(grid)
    if len(corners) and len(stepped):  # those of steps have a note of their own
        lattice = grid.lattice
        corner = np.rint(corners / lattice.cell_size).astype(np.int64)
        around = (corner[:, None] - corner_ends(lattice.dimension)).reshape(-1, lattice.dimension)
        inside = lattice.contains(around)
        inside[inside] = np.isin(lattice.key(around[inside]), lattice.key(stepped))
        corners = corners[~inside.reshape(len(corners), -1).any(axis=1)]
    return _at_corners(corners)


def _at_corners(corners: Floats) -> list[Caveat]:
    if not len(corners):
        return []
    places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in corners[:3].tolist())
    more = f" and {len(corners) - 3} more" if len(corners) > 3 else ""
    many = f"{len(corners)} corner" + ("s" if len(corners) > 1 else "")
    said = f"with smaller cells the stress grows without limit at the corner {places} m{more}"
    return [Caveat(f"no limit of stress at {many}", said)]


def _off_place(load: LoadTable, chosen: Selection, grid: Scene) -> str:
    """Say how far a load on some cells is from what is described; nothing if it is not."""
    h, inside = grid.lattice.cell_size, bool(np.all(chosen.direction < 0))
    shaped = load.region is not None and load.region.box is None
    edge = f"which moves the edge of its region by up to {0.5 * h:.3g} m"
    said = []
    if load.point is not None:
        how = "with its moment" if chosen.offset is not None else "round its middle"
        said.append(
            f"a force at a point would have infinite energy, so it is spread over the {h:.3g} m "
            f"of its cell, {how}; smaller cells make it sharper"
        )
    elif shaped and inside:
        said.append(f"takes whole cells, {edge}")
    elif shaped and _ends_on_surface(grid, chosen):
        said.append(f"takes whole faces, {edge}; a box without thickness ends within them")
    elif inside and chosen.part is not None:
        said.append(
            "its region ends inside cells, and the load acts on the whole of each, which moves "
            f"its edge by up to {h:.3g} m; take smaller cells or a larger resolution"
        )
    steps = chosen.steps_of_couple(grid.lattice) if load.couple is not None else 0.0
    if steps > STEPS_OF_COUPLE:
        said.append(
            "a couple acts evenly on each face, although its traction changes across a face: "
            f"the difference is {steps:.2g} of its moment; take smaller cells"
        )
    return "; ".join(said)


def _ends_on_surface(grid: Scene, chosen: Selection) -> bool:
    """Tell whether a free face that is not among some goes on from one of them in its plane."""
    lattice = grid.lattice
    directions = np.unique(chosen.direction).tolist()
    for direction, axis, step in product(directions, range(lattice.dimension), (-1, 1)):
        cells = chosen.cells[chosen.direction == direction]
        beside = cells + step * (np.arange(lattice.dimension) == axis)
        beside = beside[lattice.contains(beside)]
        beside = beside[~np.isin(lattice.key(beside), lattice.key(cells))]
        beside = beside[grid.kinds(beside) >= 0]
        if axis != direction // 2 and np.any(
            grid.kinds(lattice.neighbours(beside, direction)) == AIR
        ):
            return True
    return False


def _crossed(shape: Shape, scene: Scene) -> Cells:
    """Return the cells of the array that have points inside and outside of a shape."""
    # Boxes of cells that lie inside of it, or apart, are not looked into.
    lattice = scene.lattice
    h, d, extent = lattice.cell_size, lattice.dimension, np.asarray(lattice.shape)
    exponent = int(extent.max()).bit_length()
    cells, ends = np.zeros((1, d), dtype=np.int64), corner_ends(d)
    while exponent:
        exponent -= 1
        cells = (cells[:, None] + (ends << exponent)).reshape(-1, d)
        cells = cells[np.all(cells < extent, axis=1)]
        lower, upper = (np.asarray(corner * h) for corner in (cells, cells + (1 << exponent)))
        whole, apart = relation(shape, lower, upper)
        cells = cells[~(whole | apart)]
    within = (np.arange(SAMPLES[d]) + 0.5) / SAMPLES[d]
    inside = np.zeros(len(cells), dtype=np.int64)
    for offset in product(within, repeat=d):
        inside += shape.contains((cells + np.array(offset)) * h)
    crossed: Cells = cells[(inside > 0) & (inside < SAMPLES[d] ** d)]
    return crossed


def _point(point: Floats | tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
