"""What is to be known of an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. Here stands how
far it is from the body and the loads that were described.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import isfinite, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, first_largest
from kaju.errors import SingularPlaceError
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.bounds.uneven_loads import Portions, data_error, softest
from kaju.model.elastic.goals.quantities import DISPLACEMENT, Stress, ToleranceAt, quantities_of
from kaju.model.scene import Scene
from kaju.model.scene.box_kinds import relation
from kaju.model.scene.cell_types import AIR
from kaju.model.scene.lattice import Cells
from kaju.model.scene.shapes import Box, Shape

from .cell_loads import portions_of_cells
from .corners import sharp_corners, singular_at

if TYPE_CHECKING:
    from kaju.model.scene.loads import LoadTable
    from kaju.model.scene.selection import Selection

    from .elastic_result import ElasticResult

ROUGH = 0.1  # From this estimated error on an answer says what to do about it
STEPPED = 0.2
"""What steps change of the energy, as a share of the energy within a cell of them. Of rings, holes
and Cook's membrane the truth was 0.4 to 1.9 times this (tests/elasticity/test_caveats.py)."""
SAMPLES = {2: 4, 3: 2}  # Points along the edge of a cell by which an outline is found in it
LEFT_OUT = 1e-3
"""Share of the energy norm from which on it is told what agents do not take of loads."""
STEPS_OF_COUPLE = 0.01  # Share of a couple's moment from which on it is told that it acts by steps
ON_EDGE = 1e-6  # Of a cell: what is nearer to an edge lies on it


class Caveat(NamedTuple):
    """What is approximate, in a few words for pictures, and in full."""

    brief: str
    full: str


def refuse_singular(
    scene: Scene, tolerance_at: ToleranceAt, stage: int | None, name: str = "tolerance_at"
) -> None:
    """Refuse to look for a stress at a point where it has no limit."""
    if isinstance(tolerance_at, str) and tolerance_at == DISPLACEMENT:
        return
    h = scene.lattice.cell_size
    for quantity in quantities_of(tolerance_at):
        if not isinstance(quantity, Stress) or not isinstance(quantity.at, tuple):
            continue
        point = np.asarray(quantity.at)
        known = len(point) == scene.lattice.dimension
        reason = singular_at(scene, point, stage) if known else ""
        if reason:
            box = [(point - 2 * h).tolist(), (point + 2 * h).tolist()]
            raise SingularPlaceError(
                f"{name}: the stress at {_told(point)} m has no limit, since there {reason}; "
                f"ask for its mean over a stated region, such as Stress({{'box': {box}}}, "
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


@dataclass(frozen=True, eq=False)
class Caveats:
    """What is approximate beside the error that an answer estimates."""

    result: ElasticResult

    @cached_property
    def told(self) -> list[Caveat]:
        """All of it, in words."""
        return [*self._rough(), *self._loads(), *self._steps(), *self._no_limit()]

    def no_limit(self, agent: int) -> str:
        """Return why the stress of an agent has no limit under refinement; empty if it has."""
        result = self.result
        if result.scene.outlined:
            return "perhaps; corners are not looked at within true outlines"
        if self._near_steps[agent]:
            return "a step of an outline that is not along the axes"
        for corner in product((0.0, 1.0), repeat=result.scene.lattice.dimension):
            at = result.lower[agent] + result.size[agent] * np.array(corner)
            reason = singular_at(result.scene, at, result.stage)
            if reason:
                return reason
        return ""

    @cached_property
    def _stepped(self) -> Cells:
        return stepped_cells(self.result.grid)

    @cached_property
    def _near_steps(self) -> Flags:
        """Which agents lie in cells that an outline crosses, or in those beside them."""
        result, near = self.result, self._stepped
        lattice = result.grid.lattice
        if not len(near):
            return np.zeros(result.agents, dtype=np.bool_)
        for way in np.eye(lattice.dimension, dtype=np.int64):
            near = np.unique(np.concatenate([near - way, near, near + way]), axis=0)
        near = near[np.all((near >= 0) & (near < np.asarray(lattice.shape)), axis=1)]
        own = np.floor(result.middle / lattice.cell_size).astype(np.int64)
        return np.isin(lattice.key(own), lattice.key(near))

    def _rough(self) -> list[Caveat]:
        error = self.result.error_estimate
        # What is said of goals is about their own error, and a proof says more than an estimate.
        kept = self.result.tolerance_kept
        if self.result.tolerance_at is not None or kept == "proved" or not error > ROUGH:
            return []
        if not isfinite(error):
            told = "the energy is bounded by 0 from below, so its error cannot be told as a share: "
            told += "supports bear the loads where they act, and hardly any energy is left"
            return [Caveat("error not known", told)]
        told = f"the error is taken as {error:.0%} in the energy norm"
        if kept != "missed":  # else the notes tell what hinders, which no smaller tolerance mends
            name, value = "tolerance", f"{0.5 * min(self.result.tolerance or 0.1, error):.2g}"
            if self.result.found.storage == "solid":  # no tolerance can be asked of these
                name, value = "resolution", f"{2 * self.result.subdivision}"
            told += f": ask for less by {name}={value} (kaju solve FILE --{name} {value})"
        return [Caveat(f"error about {error:.0%}", told)]

    def _loads(self) -> list[Caveat]:
        """Say which loads do not act just where they are described, and how far off they are."""
        grid, found = self.result.grid, []
        for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
            told = _off_place(load, chosen, grid)
            found += [Caveat(f"loads.{number} spread by cells", f"loads.{number}: {told}")][
                : len(told)
            ]
        left = self.result.load_error_estimate
        if left > LEFT_OUT:
            found.append(
                Caveat(
                    "loads end within faces",
                    "loads end within faces, which take their force and moments; what that leaves "
                    f"out is at most {left:.1g} of the answer in the energy norm, and part of "
                    "`error_bound`; smaller cells, or a tolerance, lessen it",
                )
            )
        return found

    def _steps(self) -> list[Caveat]:
        result = self.result
        if not len(self._stepped):
            return []
        h, near = result.grid.lattice.cell_size, self._near_steps
        density = np.einsum("nij,nij->n", result.stress, result.strain)
        energy = density * result.size**result.scene.lattice.dimension
        share = STEPPED * float(energy[near].sum() / (energy.sum() or 1.0))
        said = (
            f"round and slanted outlines are steps of {h:.3g} m, and what is proved is proved for "
            "the body of cells: the energy of the body described differs by an estimated "
            f"{share:.1g} of it"
        )
        largest = result.largest_stress
        if near[first_largest(result.von_mises)]:
            said += (
                f"; the largest stress, at {_told(largest.at)} m, is an artefact of a step and "
                "grows with smaller agents"
            )
            if not near.all():
                stress = np.where(near, 0.0, result.von_mises)
                agent = first_largest(stress)
                said += (
                    f". More than a cell away from steps it is {stress[agent]:.3g} Pa, at "
                    f"{_told(result.middle[agent])} m (von Mises)"
                )
        return [Caveat(f"outlines are steps of {h:.3g} m", said)]

    def _no_limit(self) -> list[Caveat]:
        grid = self.result.grid
        corners, steps = sharp_corners(grid), self._stepped
        if len(corners) and len(steps):  # those of steps have a note of their own
            lattice = grid.lattice
            corner = np.rint(corners / lattice.cell_size).astype(np.int64)
            around = corner[:, None] - corner_ends(lattice.dimension)
            inside = np.all((around >= 0) & (around < np.asarray(lattice.shape)), axis=2)
            keys = lattice.key(
                np.where(inside[..., None], around, 0).reshape(-1, lattice.dimension)
            )
            stepped = inside & np.isin(keys, lattice.key(steps)).reshape(inside.shape)
            corners = corners[~stepped.any(axis=1)]
        if not len(corners):
            return []
        places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in corners[:3].tolist())
        more = f" and {len(corners) - 3} more" if len(corners) > 3 else ""
        many = f"{len(corners)} corner" + ("s" if len(corners) > 1 else "")
        return [
            Caveat(
                f"no limit of stress at {many}",
                f"stress grows without limit under refinement at the corner {places} m{more}",
            )
        ]


def load_error(result: ElasticResult) -> float:
    """Return what agents do not take of the loads, relative, in the energy norm, at most."""
    found, applied = result.found, result.grid.applied(result.stage)
    if applied.uneven is None or not len(applied.uneven.row) or not found.solution.energy > 0.0:
        return 0.0
    if found.storage == "tree":
        ground = found.tree.ground
        portions = ground.forces(found.tree.leaves).uneven or Portions.none(ground.dimension)
        size, kind = result.size / result.grid.lattice.cell_size, result.material
    else:
        portions = portions_of_cells(applied, found.scales.force)
        size, kind = np.ones(len(applied.cells)), np.zeros(len(applied.cells), dtype=np.int64)
        uneven = applied.uneven.row
        kind[uneven] = found.moduli_of_cells(applied.cells[uneven])
    least = softest(*found.moduli, result.grid.lattice.dimension)[kind]
    return data_error(portions, size, least) / sqrt(2.0 * found.solution.energy)


def _off_place(load: LoadTable, chosen: Selection, grid: Scene) -> str:
    """Say how far a load on some cells is from what is described; nothing if it is not."""
    h, inside = grid.lattice.cell_size, bool(np.all(chosen.direction < 0))
    shaped = load.region is not None and load.region.box is None
    edge = f"which moves the edge of its region by up to {0.5 * h:.3g} m"
    told = []
    if load.point is not None:
        how = "with its moment" if chosen.offset is not None else "round its middle"
        told.append(
            f"a force at a point has no limit of energy; it is spread over the {h:.3g} m of its "
            f"cell, {how}, and smaller cells make it sharper"
        )
    elif shaped and inside:
        told.append(f"takes whole cells, {edge}")
    elif shaped and _ends_on_surface(grid, chosen):
        told.append(f"takes whole faces, {edge}; a box without thickness ends within them")
    elif inside and chosen.part is not None:
        told.append(
            "its region ends inside cells, and acts on the whole of each, which moves its edge by "
            f"up to {h:.3g} m; smaller cells or a resolution lessen it"
        )
    steps = chosen.steps_of_couple(grid.lattice) if load.couple is not None else 0.0
    if steps > STEPS_OF_COUPLE:
        told.append(
            f"a couple acts evenly on each face, where it would grow across it: steps that are "
            f"{steps:.2g} of its moment; smaller cells lessen them"
        )
    return "; ".join(told)


def _ends_on_surface(grid: Scene, chosen: Selection) -> bool:
    """Tell whether a free face that is not among some goes on from one of them in its plane."""
    lattice = grid.lattice
    for way, axis, step in product(np.unique(chosen.direction), range(lattice.dimension), (-1, 1)):
        cells = chosen.cells[chosen.direction == way]
        beside = cells + step * (np.arange(lattice.dimension) == axis)
        beside = beside[lattice.contains(beside)]
        beside = beside[~np.isin(lattice.key(beside), lattice.key(cells))]
        beside = beside[grid.kinds(beside) >= 0]
        if axis != way // 2 and np.any(grid.kinds(lattice.neighbours(beside, int(way))) == AIR):
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


def _told(point: Floats | tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
