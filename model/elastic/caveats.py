"""What is approximate in an elastic answer beside its error on its cells.

The cells are the body that is solved, and its bounds are theorems about that body. This module says
how far it is from the body and the loads that were described.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Floats, first_largest, nearest
from kaju.errors import SingularPlaceError
from kaju.model.elastic.goals.quantities import Quantity, Stress
from kaju.model.elastic.named_supports import regions_that_hold
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.outline.true_shapes import KINK, SLIGHT
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import NOT_BODY, ROLLER
from kaju.model.scene.shapes import Box
from kaju.model.scene.surfaces import ClosedSurface

from .corners import ON_EDGE, singular_at

if TYPE_CHECKING:
    from .elastic_result import ElasticResult


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


def is_stepped(result: ElasticResult) -> bool:
    """Whether curved or slanted outlines are steps of cells, or cut cells that count whole."""
    if result.found.storage == "solid":
        return bool(np.any(result.stiffness < 1.0))
    grid = result.grid
    every = zip(grid.body.regions, grid.region_shapes, strict=True)
    shapes = [shape for region, shape in every if region.image is None]  # pixels lie along the axes
    if grid.lattice.dimension == 3:
        if not all(isinstance(shape, Box | ClosedSurface) for shape in shapes):
            return True
        faces = (shape.corners for shape in shapes if isinstance(shape, ClosedSurface))
    else:
        faces = (arcs[..., :2] / arcs[..., 2:] for shape in shapes for arcs in shape.outline())
    slants = [np.ptp(points, axis=1).min(axis=1).max() for points in faces]
    return max(slants, default=0.0) > ON_EDGE * grid.lattice.cell_size


LOW = "beside curved edges it may be off by a third or more"
"""Of a hole of a radius of 2 to 32 cells steps tell 22 to 36 of 31 MPa; cells that are cut less."""


MUCH = 0.1
"""An error above which an answer without a tolerance is doubtful: a choice."""


def doubt_of(result: ElasticResult) -> str | None:
    """Say why the largest stress is doubtful, if it is."""
    if result.stepped:
        return LOW
    error = result.error_estimate
    if result.spawned and result.scene.lattice.dimension == 3:
        error *= 2.0  # of beams of 0.03 in the energy norm the largest stress was off by 0.07
    elif result.tolerance is not None or error <= MUCH:
        return None
    return f"may be off by {f'about {error:.0%}' if isfinite(error) else 'any amount'} or more"


def caveats_of(result: ElasticResult) -> tuple[str, ...]:
    """Return what is approximate of an answer: in a few words, for pictures, a colon, and why."""
    held = _of_blocks(result) if result.cut_agents is None else _of_bolts(result)
    return (*_of_error(result), *_of_loads(result), *held, *_of_beds(result), *_of_outlines(result))


def unproved(result: ElasticResult) -> tuple[str, ...]:
    """Return what an answer with a tolerance does not prove; pictures do not tell."""
    if result.tolerance is None:
        return ()
    if result.goals:
        return tuple(filter(None, (goal.doubt for goal in result.goals)))
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
        hint = f"; most of it lies at {_point(result.middle[agent])} m"
        if result.goals:  # whose errors lie elsewhere
            hint, cut = "", result.cut_agents
            if why == "stalled" and cut is not None and result.goals[0].place:
                part = any(np.isfinite(load.box).all() for load in cut.ground.loads)
                leaps = "stress may leap there, where a load begins or ends: let it end elsewhere"
                hint = f"; {leaps if part else 'another tolerance may lead further'}"
        if why in ("corners", "stalled", "depth") and found.ground.resolution is not None:
            why, hint = "resolution", "; a larger resolution allows smaller ones"
        proved = not (found.no_bound or any(goal.no_bound for goal in found.goals))
        of = f"{'a proved' if proved else 'an estimated'} error of {result.goal_error:.2g}"
        limit = f"above the tolerance of {result.tolerance:g}"
        yield f"tolerance missed: {MISSED[why]} {of}, {limit}{hint}"
    if result.tolerance is not None:
        return
    if not isfinite(error):
        yield "error not known: sides that meet are moved apart, which takes endless energy"
    elif error > MUCH:
        name, value = "tolerance", f"{0.5 * min(0.1, error):.2g}"
        if found.storage == "solid":  # no tolerance can be asked of these
            name, value = "resolution", f"{2 * result.subdivision}"
        told = f"take {name}={value} (kaju solve FILE --{name} {value})"
        # The work of loads is off by the square; of bars two cells high by less than twice that.
        moved = f"deflections may be off by about {2.0 * error**2:.0%}, as may what supports share"
        yield f"error about {error:.0%}: for a smaller one, in the energy norm, {told}; {moved}"


def _of_loads(result: ElasticResult) -> Iterator[str]:
    """Say which loads need not act just where they are described, or act on ever fewer cells."""
    grid, h = result.grid, result.grid.lattice.cell_size
    if grid.loads and not result.max_displacement:
        yield "the loads cancel each other, so all is 0: is it meant so?"
    for number, (load, chosen) in enumerate(zip(grid.loads, grid.selections, strict=True)):
        inside, region = bool(np.all(chosen.direction < 0)), load.region
        if load.point is not None:
            yield (
                f"loads.{number} is spread over the {h:.3g} m of its cell: at a point it would "
                "have infinite energy; smaller cells make it sharper"
            )
        elif region is not None and (region.box is None or (inside and chosen.part is not None)):
            edge = h if region.box else 0.5 * h
            yield (
                f"loads.{number} takes whole faces or cells: the edge of its region moves by up "
                f"to {edge:.3g} m; take smaller cells or a larger resolution"
            )
        if load.couple is not None and not result.scene.plane:
            at = grid.lattice.face_middles(chosen.cells, chosen.direction)
            depth = float(np.sort(np.ptp(at, axis=0))[1]) + h
            if nearest(at, np.array([result.largest_stress.at]))[0][0] < depth:
                yield (
                    f"largest von Mises within {depth:.3g} m of the couple of loads.{number}: it "
                    "acts evenly on each face of a cell, so there stress hangs on the cells; "
                    "farther away it does not"
                )
        drag = not inside and load.force and np.delete(load.force, chosen.direction // 2).any()
        if drag and (load.side is None or load.cell is not None):
            where = "where it ends on a flat face, stress grows without limit"
            yield f"loads.{number} drags the surface: {where}"


def _of_bolts(result: ElasticResult) -> Iterator[str]:
    """Say which rigid holes bear couples that bolts do not."""
    assert result.cut_agents is not None
    if not (names := result.cut_agents.ground.rigid.values()):
        return
    least = max(result.scene.lattice.extent) * _small(result)
    found = [(name, result.couples[name]) for name in names]
    if told := [f"{name!r} {couple:.4g} N·m" for name, couple in found if abs(couple) > least]:
        couples = f"rigid holes bear couples ({', '.join(told)})"
        yield f'{couples}; for bolts, which let the part turn, take material = "pinned"'


def _of_blocks(result: ElasticResult) -> Iterator[str]:
    """Say which regions of cells hold the body more than simple supports do."""
    scene = result.scene
    found: list[str] = []
    borne, least = result.reactions, _small(result)
    for number, name in regions_that_hold(scene).items():
        if name not in borne:
            continue
        couple = float(np.linalg.norm(result.couples[name]))
        if len(borne) > 1 and couple > least * max(scene.lattice.extent):
            found.append(f"{name!r} bears a couple of {couple:.4g} N·m")
        axes = [axis for axis, force in zip("xyz", borne[name], strict=False) if abs(force) > least]
        if NOT_BODY[scene.body.regions[number].material] == ROLLER and len(axes) > 1:
            found.append(f"the roller {name!r} holds along {' and '.join(axes)}")
    if told := "; ".join(dict.fromkeys(found)):
        pin = 'take a pinned hole (material = "pinned", outline = "true")'
        if any(side.stiffness for side in scene.sides.values()):
            pin = "leave them out: what no load pushes along its bed need not be held there"
        elif not scene.plane:  # where holes are not pinned
            pin = "hold less of it"
        yield (
            f"cells hold the body by every face that they touch ({told}): where it may turn, "
            f"{pin}; where it may slide, take a roller side"
        )


def _of_beds(result: ElasticResult) -> Iterator[str]:
    """Say which beds pull."""
    lattice = result.scene.lattice
    for name, side in result.scene.sides.items():
        if side.stiffness is None:
            continue
        axis, upper = divmod(lattice.sides.index(name), 2)
        lines = [(np.arange(50) + 0.5) / 50 * long for long in lattice.extent]
        lines[axis] = np.array([lattice.extent[axis] * upper])
        points = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, lattice.dimension)
        points = points[result.holds(points)]
        lifted = (1 - 2 * upper) * result.displacement_at(points)[:, axis]
        share = float(np.mean(lifted > 0.01 * np.abs(lifted).max(initial=0.0)))
        if share > 0.0:
            of = "length" if result.scene.plane else "area"
            pulls = f"the bed at {name} pulls over about {share:.0%} of its {of}"
            yield f"{pulls}: contact that opens, and presses more on the rest, is not modelled"


def _small(result: ElasticResult) -> float:
    """Return the force (N) below which supports bear little: a hundredth of the largest."""
    return 0.01 * max((float(np.linalg.norm(one)) for one in result.reactions.values()), default=0)


def _of_outlines(result: ElasticResult) -> Iterator[str]:
    """Say that cells make steps of outlines, and where the body has sharp corners."""
    grid, corners, stepped = result.grid, result.sharp_corners, result.stepped
    h, solid = grid.lattice.cell_size, grid.lattice.dimension == 3
    if result.cut_agents is not None:
        body = result.cut_agents.ground
        slight = body.edge * body.true.without_limit(SLIGHT, body.shape, most=KINK)
        for at in map(_point, slight[:1]):
            yield f"no limit of stress at a slight corner, {at} m: does a radius not fit its ends?"
    if stepped and result.scene.outlined:
        yield (
            "outlines cut cells: these count by the share of them that is body, and stress and "
            "displacement are means over all of each, which is an estimate; of the largest stress, "
            f"{LOW}"
        )
    elif stepped:
        yield (
            f"outlines are steps of {h:.3g} m: the answer is that of the stepped body, not of the "
            "round or slanted one described; stress at the steps grows with smaller agents, as at "
            f"other re-entrant corners; of the largest stress, {LOW}; in the plane a region with "
            'outline = "true" has no steps'
        )
    elif many := len(corners) * (not solid):
        at, more = "corners" if many > 1 else "corner", f" and {many - 3} more" * (many > 3)
        places = ", ".join(map(_point, corners[:3].tolist()))
        grows = f"it grows with smaller cells at {places} m{more}"
        yield f"no limit of stress at {many} {at}: {grows}{_left_out(result)}"
    if stepped or solid:
        # of a stepped body only what is no step: where supports and rollers end
        every = sorted(set(result.sharp_cells[1]))
        if reasons := [one for one in every if not stepped or one.endswith(" ends")]:
            at = f"{'along edges' if solid else 'at points'} ({'; '.join(reasons)})"
            yield f"no limit of stress {at}: it grows there with smaller cells{_left_out(result)}"


def _left_out(result: ElasticResult) -> str:
    """Say how far from places without a limit the largest stress is looked for."""
    if not (far := (found := result.largest_stress).left_out):
        return ""
    beside = nearest(result.sharp_corners, np.array([found.at]))[0][0] < 1.5 * far
    lies = ", and lies there: nearer it is larger" if beside and found.value else ""
    return f"; largest von Mises leaves out {far:.2g} m round them{lies}"


def _point(point: Floats | tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
