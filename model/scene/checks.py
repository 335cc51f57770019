"""What a scene is refused for: a body that is not there or floats, and outlines not proved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import suggestion
from kaju.arrays import Flags
from kaju.errors import SceneError, SupportError

from . import cell_types
from .cell_types import NOT_BODY
from .description import Description
from .resolved_body import CellBox, ResolvedBody, count, sample, slabs
from .sides import FREE, unknown_side
from .validation import check_axes

MOST_EXAMINED = 10_000_000
"""Up to this many cells a body is examined cell by cell, above by samples."""

_HOLDS = (cell_types.RIGID, cell_types.ROLLER, cell_types.FOUNDATION, cell_types.DISPLACED)
_REMEDY = (
    'hold it by a rigid cell or region, or by [sides] such as bottom = "rigid" (to watch a '
    "prescribed rule alone, which needs no support, set body.allow_floating = true)"
)


def check_body(resolved: ResolvedBody, allow_floating: bool) -> None:
    """Refuse a body that is not there or floats; parts are sought up to `MOST_EXAMINED` cells."""
    if resolved.uniform or resolved.lattice.size > MOST_EXAMINED:
        _check_samples(resolved, allow_floating)
    else:
        _check_parts(resolved, allow_floating)


def _check_samples(resolved: ResolvedBody, allow_floating: bool) -> None:
    boxes = [resolved.box] + [resolved.cells_of(region.shape) for region in resolved.regions]
    if not any(_has_body(resolved, box) for box in boxes):
        raise _nothing_there(resolved)
    inside = [resolved.base, *(part.kind for part in resolved.regions)]
    if allow_floating or any(bool(np.isin(np.asarray(kind), _HOLDS).any()) for kind in inside):
        return
    for side in np.flatnonzero(np.isin(resolved.beyond, _HOLDS)):
        if any(_has_body(resolved, resolved.layer(box, int(side))) for box in boxes):
            return
    raise SupportError(f"sides: nothing holds the body; {_REMEDY}")


def _has_body(resolved: ResolvedBody, box: CellBox) -> bool:
    """Tell whether a box holds a cell of body; of large boxes only samples are looked at."""
    if count(box) == 0:
        return False
    if np.any(resolved.kinds(sample(box)) >= 0):
        return True
    small = count(box) <= MOST_EXAMINED
    return small and any(np.any(resolved.kinds(cells) >= 0) for cells in slabs(box))


def _check_parts(resolved: ResolvedBody, allow_floating: bool) -> None:
    raster = resolved.rasterise()
    if not (raster >= 0).any():
        raise _nothing_there(resolved)
    if allow_floating:
        return
    # in a frame of what lies beyond the sides
    framed = np.pad(raster, 1, constant_values=resolved.beyond.reshape(-1, 2))
    parts, held = _parts_of_boxes(framed) if resolved.lattice.boxes else _parts(resolved, framed)
    loose = np.flatnonzero(~held[1:]) + 1
    if len(loose) == len(held) - 1:
        raise SupportError(f"sides: nothing holds the body; {_REMEDY}")
    if len(loose):
        raise SupportError(
            f"body: {len(loose)} of its {len(held) - 1} parts touch nothing that holds them, "
            f"first the one with cell {np.argwhere(parts == loose[0])[0].tolist()} (cells that "
            f"touch only at a corner do not hold each other); {_REMEDY}"
        )


Parts = tuple[NDArray[np.integer], Flags]
"""The number of each cell's part, from 1 (0: no body), and which numbers something holds."""


def _parts_of_boxes(framed: NDArray[np.int16]) -> Parts:
    """Return the connected parts of squares or cubes."""
    from scipy.ndimage import binary_dilation, label

    parts, number = label(framed >= 0)
    held = np.zeros(number + 1, dtype=np.bool_)
    held[parts[binary_dilation(np.isin(framed, _HOLDS))]] = True
    return parts[(slice(1, -1),) * framed.ndim], held


def _parts(resolved: ResolvedBody, framed: NDArray[np.int16]) -> Parts:
    """Return the connected parts of any cells, from face to face."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lattice, kind = resolved.lattice, framed.ravel()  # a cell's key is its place in the frame
    body = np.flatnonzero(kind >= 0)
    form, count = lattice.form(lattice.cells(body)), len(body)
    number = np.zeros(len(kind), dtype=np.int32)
    number[body] = np.arange(count)
    touching, links = np.zeros(count, dtype=np.bool_), []
    for arm in range(lattice.directions):
        reached = body + lattice.key_steps[form, arm]
        beyond = kind[reached]
        touching |= np.isin(beyond, _HOLDS)
        if arm < lattice.opposite[arm]:  # each face once
            inside = beyond >= 0
            links.append(np.stack([number[body[inside]], number[reached[inside]]]))
    pairs = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(pairs.shape[1], dtype=np.bool_), tuple(pairs)), (count, count))
    some, part = connected_components(graph, directed=False)
    parts = np.zeros(len(kind), dtype=np.int32)
    parts[body] = part + 1
    held = np.zeros(some + 1, dtype=np.bool_)
    held[part[touching] + 1] = True
    return parts.reshape(framed.shape)[1:-1, 1:-1], held


def _nothing_there(resolved: ResolvedBody) -> SceneError:
    shape = " x ".join(map(str, resolved.lattice.shape))
    return SceneError(
        f"body: none of the {shape} cells is body; at least one must be of a material"
    )


def check_no_outlines(scene: Description) -> None:
    """Refuse a load on an outline that is a staircase."""
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            raise SceneError(
                f"loads.{number}.outline: no region called {load.outline!r} has a true outline; "
                'give one outline = "true"'
            )


def check_outlines(scene: Description, body: ResolvedBody) -> None:
    """Refuse what contradicts true outlines, or is not proved with them."""
    names: list[str] = []
    for number, region in enumerate(scene.body.regions):
        where = f"body.regions.{number}"
        if region.outline != "true":
            raise SceneError(
                f"{where}.outline: all regions of a body have true outlines or none; give it "
                'outline = "true", or leave it out everywhere'
            )
        if region.name in names:
            raise SceneError(f"{where}.name: {region.name!r} is another region's name")
        names += [region.name] if region.name is not None else []
    for number, load in enumerate(scene.loads):
        where = f"loads.{number}"
        if load.outline is not None and load.outline not in names:
            raise SceneError(
                f"{where}.outline: there is no region called {load.outline!r}"
                f"{suggestion(load.outline, names)}; give a region name = {load.outline!r}"
            )
        if load.force is not None:
            check_axes(load.force, body.lattice.dimension, f"{where}.force")
        if load.side is not None:
            if load.side not in body.lattice.sides:
                raise unknown_side(load.side, body.lattice.sides, f"{where}.side")
            if scene.sides.get(load.side, FREE).kind != "free":
                raise SceneError(f"{where}.side: {load.side} is held; load a side that is free")
    for refused, told in _unproved(scene, body):
        if refused:
            raise SceneError(
                f'{told}, or take outline = "cells"; true outlines are not proved with it'
            )


def _unproved(scene: Description, body: ResolvedBody) -> Iterator[tuple[object, str]]:
    """Yield whether a scene has what cells take alone, and what is to be done about it."""
    solid, own, walls = body.lattice.dimension == 3, scene.body, ("rigid", "roller")
    fills = {own.material, *(region.material for region in own.regions)} - set(NOT_BODY)
    if not fills:
        raise SceneError("body.regions: all is air; give a region, or the body, a material")
    yield body.lattice.kind not in ("square", "cube"), "body.lattice: take squares or cubes"
    yield own.picture_key, f"body.{own.picture_key}: give cells and material"
    yield scene.history is not None, "history: leave it out"
    yield own.material in walls, f"body.material: {own.material} is no body; take a material"
    yield solid and len(fills) > 1, "body.regions: in space take one material, beside air"
    weighs = any(own.gravity or ())
    yield weighs and (solid or len(fills) > 1), "body.gravity: leave it out, or the second material"
    for material in body.materials:
        soft = solid or own.plane != "strain" or material.poissons_ratio < 0.5
        yield not soft, f"materials.{material.name}.poissons_ratio: take less than 1/2"
    for number, region in enumerate(own.regions):
        where = f"body.regions.{number}.material"
        yield region.material in walls, f"{where}: {region.material} holds; hold it by [sides]"
    for name, side in scene.sides.items():
        moved = side.kind == "displaced"
        where = f"sides.{name}: is {side.kind}"
        yield side.kind == "foundation" or (moved and not solid), f"{where}; take rigid or roller"
        yield moved and scene.loads, f"{where}; leave the loads out"
    for number, load in enumerate(scene.loads):
        for key in ("cell", "point", "region", "couple", "pressure_slope"):
            told = "load a side or an outline by a force or a pressure"
            yield getattr(load, key) is not None, f"loads.{number}.{key}: {told}"
        yield solid and load.outline is not None, f"loads.{number}.outline: load a side"
        yield load.steps != 1, f"loads.{number}.steps: leave it out"
