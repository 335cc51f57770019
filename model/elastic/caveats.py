"""What is approximate in an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. This module says
how far it is from the body and the loads that were described.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, first_largest
from kaju.errors import SingularPlaceError
from kaju.model.elastic.goals.quantities import AskedFor, Stress, quantities_of
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.results.mesh import corner_order
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR
from kaju.model.scene.resolved_body import relation
from kaju.model.scene.shapes import Box

from .corners import singular_at

if TYPE_CHECKING:
    from kaju.model.scene.description import LoadTable
    from kaju.model.scene.selection import Selection

    from .elastic_result import ElasticResult

STEPPED = 0.2
"""What steps change of the energy, as a share of the energy within a cell of them. Of rings, holes
and Cook's membrane the truth was 0.4 to 1.9 times this (tests/elasticity/test_caveats.py)."""


class Caveat(NamedTuple):
    """What is approximate, in a few words for pictures, and in full."""

    brief: str
    full: str


def refuse_singular(scene: Scene, goal: AskedFor, name: str = "goal") -> None:
    """Refuse to look for a stress at a point where it has no limit."""
    h = scene.lattice.cell_size
    for quantity in quantities_of(goal):
        if not isinstance(quantity, Stress) or not isinstance(quantity.at, tuple):
            continue
        point = np.asarray(quantity.at)
        fits = len(point) == scene.lattice.dimension
        if fits and (reason := singular_at(scene, point)):
            box = np.round([point - 2 * h, point + 2 * h], 9).tolist()
            raise SingularPlaceError(
                f"{name}: the stress at {_point(point)} m has no limit ({reason}); "
                f"ask for its mean over a region, such as Stress({{'box': {box}}}, "
                f"{quantity.component!r}), or, at a re-entrant corner, for result.intensity"
            )


def near_steps(grid: Scene, points: Floats) -> Flags:
    """Tell which points (m) lie in or beside cells that slanted or round outlines cross."""
    lattice, near = grid.lattice, np.zeros(len(points), dtype=np.bool_)
    h, within = lattice.cell_size, (np.arange(3) + 0.5) / 3  # Points along the edge of a cell
    own = np.floor(points / h).astype(np.int64)
    for number, region in enumerate(grid.body.regions):
        if region.image is not None:  # pixels lie along the axes, and a stored scene has none
            continue
        shape = region.shape_in(lattice, f"body.regions.{number}")
        if not isinstance(shape, Box):
            low, high = (np.asarray((own + step) * h) for step in (-1, 2))
            whole, apart = relation(shape, low, high)
            at = np.flatnonzero(~(whole | apart))
            for step in product((-1, 0, 1), repeat=lattice.dimension):
                cells = own[at] + step
                inside = [
                    shape.contains((cells + offset) * h)
                    for offset in product(within, repeat=lattice.dimension)
                ]
                crossed = np.any(inside, axis=0) & ~np.all(inside, axis=0)
                near[at] |= crossed & lattice.contains(cells)
    return near


def no_limit(result: ElasticResult, agent: int) -> str:
    """Return why stress of an agent has no limit; empty if it has, or it is unknown."""
    if result.scene.outlined:  # in space nobody looks
        away = result.sharp_corners - result.lower[agent]
        near = ((away >= 0.0) & (away <= result.size[agent])).all(axis=1)
        return "a sharp corner, or the end of a support" if near.any() else ""
    if near_steps(result.grid, result.middle[agent, None])[0]:
        return "a step of an outline that is not along the axes"
    ends = result.lower[agent] + result.size[agent] * corner_order(result.lower.shape[1])
    return next(filter(None, (singular_at(result.scene, end) for end in ends)), "")


def caveats_of(result: ElasticResult) -> tuple[Caveat, ...]:
    """Return what is not proved of an answer, or approximate beside the error it estimates."""
    return (*_of_error(result), *_of_loads(result.grid), *_of_outlines(result))


MISSED = {
    "": "agents of a run that is not finished leave",
    "agents": "more agents would be needed than are allowed: these leave",
    "rounding": "the two stresses differ by no more than rounding errors, which leave",
    "resolution": "the smallest agents allowed leave",
    "corners": "where stress grows without limit, even the smallest agents possible leave",
    "stalled": "more agents do not lower the error: these leave",
    "depth": "the smallest agents possible leave",
}
"""Who leaves an error above the tolerance, by why agents stopped."""


def _of_error(result: ElasticResult) -> Iterator[Caveat]:
    """Say what is missed of a tolerance or not proved; without one, that an error is large."""
    found, error, tolerance = result.found, result.error_estimate, result.tolerance
    if isinstance(found, PairAgents) and result.tolerance_kept == "missed":
        why, agent = found.stopped, first_largest(result.gap)
        reason = no_limit(result, agent)
        hint = f"most of it lies at {_point(result.middle[agent])} m"
        hint += f": {reason}" if reason else ""
        if why in ("corners", "stalled", "depth") and found.ground.resolution is not None:
            why, hint = "resolution", "a larger resolution allows smaller ones"
        proved = not (found.no_bound or any(goal.no_bound for goal in found.goals))
        of = f"{'a proved' if proved else 'an estimated'} error of {result.goal_error:.2g}"
        said = f"{MISSED[why]} {of}, above the tolerance of {tolerance:g}; {hint}"
        yield Caveat(f"tolerance missed: error {result.goal_error:.2g}", said)
    if tolerance is not None:  # pictures do not tell
        yield from (Caveat("", said) for goal in result.goals if (said := goal.doubt(tolerance)))
        if result.no_bound and not result.goals:
            yield Caveat("", f"the error is estimated, not proved: {result.no_bound}")
    elif not isfinite(error):
        said = "sides that meet are moved apart: the energy has no limit as cells shrink"
        yield Caveat("error not known", said)
    elif error > 0.1:  # a choice
        name, value = "tolerance", f"{0.5 * min(0.1, error):.2g}"
        if found.storage == "solid":  # no tolerance can be asked of these
            name, value = "resolution", f"{2 * result.subdivision}"
        said = f"the error is about {error:.0%} in the energy norm; for a smaller one take "
        said += f"{name}={value} (kaju solve FILE --{name} {value})"
        yield Caveat(f"error about {error:.0%}", said)


def _of_loads(grid: Scene) -> Iterator[Caveat]:
    """Say which loads do not act just where they are described, and how far off they are."""
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        if off := _off_place(load, chosen, grid):
            yield Caveat(f"loads.{number} spread by cells", f"loads.{number}: {off}")
        normal = np.unique(chosen.direction[chosen.direction >= 0]) // 2
        drag = load.force and len(normal) and np.delete(load.force, normal).any()
        if drag and _ends_on_surface(grid, chosen):
            said = "its force along the surface ends there, where stress grows without limit"
            yield Caveat(f"loads.{number} ends", f"loads.{number}: {said} as cells shrink")


def _of_outlines(result: ElasticResult) -> Iterator[Caveat]:
    """Say what steps of cells change of the body described, and where it has sharp corners."""
    h, corners = result.grid.lattice.cell_size, result.sharp_corners
    near = near_steps(result.grid, result.middle)
    if near.any():
        corners = corners[~near_steps(result.grid, corners)]
        density = np.einsum("nij,nij->n", result.stress, result.strain)
        energy = density * result.size**result.scene.lattice.dimension
        share = STEPPED * float(energy[near].sum() / (energy.sum() or 1.0))
        said = (
            f"round and slanted outlines are steps of {h:.3g} m: proofs hold for this stepped "
            "body, whose energy differs from that of the body described by an estimated "
            f"{100 * share:.1g} %, and whose stress at the steps grows with smaller agents; a "
            'region with outline = "true" has no steps'
        )
        yield Caveat(f"outlines are steps of {h:.3g} m", said)
    if many := len(corners):
        at, more = "corners" if many > 1 else "corner", f" and {many - 3} more" * (many > 3)
        places = ", ".join(map(_point, corners[:3].tolist()))
        said = f"with smaller cells the stress grows without limit at the {at} {places} m{more}"
        yield Caveat(f"no limit of stress at {many} {at}", said)


def _off_place(load: LoadTable, chosen: Selection, grid: Scene) -> str:
    """Say how far a load on some cells is from what is described; nothing if it is not."""
    h, inside = grid.lattice.cell_size, bool(np.all(chosen.direction < 0))
    if load.point is not None:
        return (
            f"a force at a point would have infinite energy, so it is spread over the {h:.3g} m "
            "of its cell; smaller cells make it sharper"
        )
    if load.region is not None and load.region.box is None:
        edge = 0.5 * h if inside or _ends_on_surface(grid, chosen) else 0.0
    else:
        edge = h if inside and chosen.part is not None else 0.0
    told = (
        f"takes whole {'cells' if inside else 'faces'}, which moves the edge of its region by up "
        f"to {edge:.3g} m; take smaller cells or a larger resolution"
    )
    return told if edge else ""


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


def _point(point: Floats | tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
