"""What is approximate in an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. This module says
how far it is from the body and the loads that were described.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Flags, Floats, first_largest
from kaju.errors import SingularPlaceError
from kaju.model.elastic.goals.quantities import Quantity, Stress
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.results.mesh import corner_order
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR
from kaju.model.scene.resolved_body import relation
from kaju.model.scene.shapes import Box

from .corners import singular_at

if TYPE_CHECKING:
    from kaju.model.scene.selection import Selection

    from .elastic_result import ElasticResult

STEPPED = 0.2
"""What steps change of the energy, as a share of the energy within a cell of them. Of rings, holes
and Cook's membrane the truth was 0.4 to 1.9 times this (tests/elasticity/test_caveats.py)."""


def refuse_singular(scene: Scene, goals: Iterable[Quantity], name: str = "goal") -> None:
    """Refuse to look for a stress at a point where it has no limit."""
    h = scene.lattice.cell_size
    for quantity in goals:
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


def caveats_of(result: ElasticResult) -> tuple[str, ...]:
    """Return what is approximate of an answer: in a few words, for pictures, a colon, and why."""
    return (*_of_error(result), *_of_loads(result.grid), *_of_outlines(result))


def unproved(result: ElasticResult) -> tuple[str, ...]:
    """Return what an answer with a tolerance does not prove; pictures do not tell."""
    if result.tolerance is None:
        return ()
    if result.goals:
        return tuple(filter(None, (goal.doubt(result.tolerance) for goal in result.goals)))
    why = result.no_bound
    return (f"the error is estimated, not proved: {why}",) if why else ()


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


def _of_error(result: ElasticResult) -> Iterator[str]:
    """Say why a tolerance is missed; without one, what to do about a large error."""
    found, error = result.found, result.error_estimate
    if isinstance(found, PairAgents) and result.tolerance_kept == "missed":
        why, agent = found.stopped, first_largest(result.gap)
        reason = no_limit(result, agent)
        hint = f"most of it lies at {_point(result.middle[agent])} m"
        hint += f": {reason}" if reason else ""
        if why in ("corners", "stalled", "depth") and found.ground.resolution is not None:
            why, hint = "resolution", "a larger resolution allows smaller ones"
        proved = not (found.no_bound or any(goal.no_bound for goal in found.goals))
        of = f"{'a proved' if proved else 'an estimated'} error of {result.goal_error:.2g}"
        limit = f"above the tolerance of {result.tolerance:g}"
        yield f"tolerance missed: {MISSED[why]} {of}, {limit}; {hint}"
    if result.tolerance is not None:
        return
    if not isfinite(error):
        yield "error not known: sides that meet are moved apart, which takes endless energy"
    elif error > 0.1:  # a choice
        name, value = "tolerance", f"{0.5 * min(0.1, error):.2g}"
        if found.storage == "solid":  # no tolerance can be asked of these
            name, value = "resolution", f"{2 * result.subdivision}"
        told = f"take {name}={value} (kaju solve FILE --{name} {value})"
        yield f"error about {error:.0%}: for a smaller one, in the energy norm, {told}"


def _of_loads(grid: Scene) -> Iterator[str]:
    """Say which loads do not act just where they are described, and how far off they are."""
    h = grid.lattice.cell_size
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        inside = bool(np.all(chosen.direction < 0))
        shaped = load.region is not None and load.region.box is None
        normal = np.unique(chosen.direction[chosen.direction >= 0]) // 2
        drag = load.force and len(normal) and np.delete(load.force, normal).any()
        ends = not inside and (drag or shaped) and _ends_on_surface(grid, chosen)
        if load.point is not None:
            yield (
                f"loads.{number} is spread over the {h:.3g} m of its cell: at a point it would "
                "have infinite energy; smaller cells make it sharper"
            )
        elif (shaped and ends) or (inside and (shaped or chosen.part is not None)):
            edge = 0.5 * h if shaped else h
            yield (
                f"loads.{number} takes whole {'cells' if inside else 'faces'}: the edge of its "
                f"region moves by up to {edge:.3g} m; take smaller cells or a larger resolution"
            )
        if drag and ends:
            yield f"loads.{number} ends along the surface: there stress grows without limit"


def _of_outlines(result: ElasticResult) -> Iterator[str]:
    """Say what steps of cells change of the body described, and where it has sharp corners."""
    h, corners = result.grid.lattice.cell_size, result.sharp_corners
    near = near_steps(result.grid, result.middle)
    if near.any():
        corners = corners[~near_steps(result.grid, corners)]
        density = np.einsum("nij,nij->n", result.stress, result.strain)
        energy = density * result.size**result.scene.lattice.dimension
        share = STEPPED * float(energy[near].sum() / (energy.sum() or 1.0))
        yield (
            f"outlines are steps of {h:.3g} m: proofs hold for this stepped body, whose energy "
            "differs from that of the body described, round or slanted, by an estimated "
            f"{100 * share:.1g} %, and whose stress at the steps grows with smaller agents; a "
            'region with outline = "true" has no steps'
        )
    if many := len(corners):
        at, more = "corners" if many > 1 else "corner", f" and {many - 3} more" * (many > 3)
        places = ", ".join(map(_point, corners[:3].tolist()))
        yield f"no limit of stress at {many} {at}: it grows with smaller cells at {places} m{more}"


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
