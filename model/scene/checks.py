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
    """Refuse whatever a body with true outlines is not proved with."""
    for refusals in (_of_body, _of_regions, _of_materials, _of_sides, _of_loads):
        for told in refusals(scene, body):
            joint = ", or" if ";" in told else ";"
            raise SceneError(f'{told}{joint} take outline = "cells" instead')


Unproved = Iterator[str]
"""What cells would take, each with its other remedies; plain mistakes are raised."""


def _of_body(scene: Description, body: ResolvedBody) -> Unproved:
    if body.lattice.kind not in ("square", "cube"):
        yield "body.lattice: true outlines go with squares and cubes"
    if (key := scene.body.picture_key) is not None:
        told = "is a body of cells, which true outlines do not cut; give cells and material"
        yield f"body.{key}: {told}"
    if scene.history is not None:
        yield "history: time goes with cells"


def _of_regions(scene: Description, body: ResolvedBody) -> Unproved:
    names: list[str] = []
    for number, region in enumerate(scene.body.regions):
        where = f"body.regions.{number}"
        if region.outline != "true":
            raise SceneError(
                f"{where}.outline: all regions of a body have true outlines or none; give it "
                'outline = "true", or leave it out everywhere'
            )
        if region.material in ("rigid", "roller"):
            told = "would hold the body along its outline, which is not proved yet"
            yield f"{where}.material: {region.material} {told}; hold it by [sides]"
        if region.name in names:
            raise SceneError(f"{where}.name: {region.name!r} is another region's name")
        names += [region.name] if region.name is not None else []


def _of_materials(scene: Description, body: ResolvedBody) -> Unproved:
    if scene.body.material in ("rigid", "roller"):
        yield f"body.material: {scene.body.material} is no body with true outlines"
    materials = {scene.body.material, *(region.material for region in scene.body.regions)}
    count = len(materials - set(NOT_BODY))
    if count == 0:
        raise SceneError("body.regions: all is air; give a region, or the body, a material")
    rigid = [one.name for one in body.materials if one.poissons_ratio == 0.5]
    if rigid and body.lattice.dimension == 2 and scene.body.plane == "strain":
        told = "of 1/2 is not known in plane strain with true outlines; take less"
        yield f"materials.{rigid[0]}.poissons_ratio: {told}"
    if count > 1 and body.lattice.dimension == 3:
        told = "with true outlines in space there is one material, beside air"
        yield f"body.regions: {told}; two that meet are not proved yet. Leave one out"
    if count > 1 and any(scene.body.gravity or ()):
        told = "the weight of two materials is not proved with true outlines yet"
        yield f"body.gravity: {told}; leave it out"


def _of_sides(scene: Description, body: ResolvedBody) -> Unproved:
    solid = body.lattice.dimension == 3
    words = ("free", "rigid", "roller", *(["displaced"] if solid else []))
    for name, side in scene.sides.items():
        if side.kind not in words:
            known = f"{', '.join(words[:-1])} or {words[-1]}"
            yield f"sides.{name}: with true outlines a side is {known}, not {side.kind}"
        if side.kind == "displaced" and scene.loads:
            told = "is moved, or loads act; which bounds hold for both is not known"
            yield f"sides.{name}: with true outlines a side {told}. Leave loads out"
    if solid and any(scene.body.gravity or ()):
        yield "body.gravity: is not known with true outlines in space; leave it out"


def _of_loads(scene: Description, body: ResolvedBody) -> Unproved:
    regions = [region.name for region in scene.body.regions if region.name is not None]
    dimension = body.lattice.dimension
    for number, load in enumerate(scene.loads):
        where = f"loads.{number}"
        if load.outline is not None and load.outline not in regions:
            raise SceneError(
                f"{where}.outline: there is no region called {load.outline!r}"
                f"{suggestion(load.outline, regions)}; give a region name = {load.outline!r}"
            )
        for key in ("cell", "point", "region"):
            if getattr(load, key) is not None:
                yield f"{where}.{key}: with true outlines loads act on a side or on an outline"
        for key in ("couple", "pressure_slope"):
            if getattr(load, key) is not None:
                told = "is not proved with true outlines yet; take force or pressure"
                yield f"{where}.{key}: {told}"
        if load.outline is not None and dimension == 3:
            raise SceneError(
                f"{where}.outline: loads on outlines are not proved in space; load a side"
            )
        if load.force is not None:
            check_axes(load.force, dimension, f"{where}.force")
        if load.side is not None:
            if load.side not in body.lattice.sides:
                raise unknown_side(load.side, body.lattice.sides, f"{where}.side")
            if scene.sides.get(load.side, FREE).kind != "free":
                raise SceneError(f"{where}.side: {load.side} is held; load a side that is free")
        if load.steps != 1:
            yield f"{where}.steps: true outlines are answered for the whole load; leave it out"
