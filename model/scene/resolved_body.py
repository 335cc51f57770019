"""A body made ready to be asked: the kind of any cell, or box of cells, when it is asked for.

Names become materials, shapes become cells. Boxes are those of a quadtree or octree: 2^k cells
along every edge, at multiples of 2^k. One that lies in one shape or outside of all of them is of
one kind; one that an edge may cross counts as mixed, and its parts have to be asked again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain, product
from math import prod

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import LIBRARY, Material, meant_material
from kaju.arrays import Flags, Ints
from kaju.errors import SceneError, SupportError, suggestion

from .cell_types import AIR, DISPLACED, FOUNDATION, NOT_BODY, PINNED, RIGID, ROLLER
from .description import FREE, HELD_AS, Body, Description, SideCondition, check_side
from .lattice import Cells, Lattice
from .pictures import Picture, check_count, check_size, from_array, from_drawing, from_image
from .regions import much_larger, reach_of
from .shapes import Points, Relation, Shape
from .validation import check_axes

CellBox = tuple[Ints, Ints]
"""Lower corner, included, and upper corner, not included, of a box of cells."""

MIXED = -99
"""A box that may hold cells of several kinds."""


@dataclass(frozen=True, eq=False)
class FilledShape:
    """A shape and the kind of the cells whose centres lie in it."""

    shape: Shape
    kind: int


@dataclass(frozen=True, eq=False)
class ResolvedBody:
    """The kinds of the cells of an array and of what lies beyond its sides."""

    lattice: Lattice
    base: int | NDArray[np.int16]  # kind of every cell under the regions: one for all, or one each
    regions: tuple[FilledShape, ...]  # what lies over it, the later over the earlier
    beyond: Ints  # kind of what lies beyond each of the lattice's sides
    materials: tuple[Material, ...]  # that kinds from 0 upwards stand for
    picture: Picture | None  # the body cell by cell, if it was given so

    @property
    def box(self) -> CellBox:
        """All cells of the array."""
        shape = np.asarray(self.lattice.shape, dtype=np.int64)
        return np.zeros_like(shape), shape

    @property
    def uniform(self) -> bool:
        """Whether every cell of the array is the same."""
        return isinstance(self.base, int) and not self.regions

    def kinds(self, cells: Cells) -> Ints:
        """Return the kind of each cell, those outside the array included."""
        side = self.lattice.side_beyond(cells)
        one = self.base if isinstance(self.base, int) else AIR
        kinds = np.append(self.beyond, one)[side]
        if self.uniform:
            return kinds
        inside = side < 0
        here = cells[inside]
        found = kinds[inside] if isinstance(self.base, int) else self.base[tuple(here.T)]
        if self.regions:
            centres = self.lattice.centres(here)
            for region in self.regions:
                found[region.shape.contains(centres)] = region.kind
        kinds[inside] = found
        return kinds

    def bounds(self) -> CellBox:
        """Return a box outside of which there is no body."""
        boxes = [self.cells_of(region.shape) for region in self.regions if region.kind >= 0]
        if not isinstance(self.base, int):
            from scipy.ndimage import find_objects

            for found in find_objects((self.base >= 0).astype(np.int8)):
                ends = np.array([(part.start, part.stop) for part in found], dtype=np.int64)
                boxes.append((ends[:, 0], ends[:, 1]))
        elif self.base >= 0:
            return self.box
        if not boxes:
            lower, _ = self.box
            return lower, lower
        lower = np.min([low for low, _ in boxes], axis=0)
        return lower, np.max([high for _, high in boxes], axis=0)

    def cells_of(self, shape: Shape) -> CellBox:
        """Return a box of cells outside of which a shape has no cell's centre."""
        corners = np.array(list(product(*zip(*shape.extent, strict=True))))
        places, last = self.lattice.coordinates(corners), np.asarray(self.lattice.shape)
        least, most = self.lattice.offsets
        low = np.clip(np.floor(places.min(axis=0)) - np.ceil(most), 0, last)
        high = np.clip(np.ceil(places.max(axis=0)) - np.floor(least) + 1, 0, last)
        return low.astype(np.int64), np.maximum(low, high).astype(np.int64)

    def layer(self, box: CellBox, side: int) -> CellBox:
        """Return the part of a box that lies in the array's outermost layer at one of its sides."""
        axis, upper_end = divmod(side, 2)
        lower, upper = (corner.copy() for corner in box)
        edge = self.lattice.shape[axis] - 1 if upper_end else 0
        lower[axis], upper[axis] = max(lower[axis], edge), min(upper[axis], edge + 1)
        return lower, np.maximum(lower, upper)

    def rasterise(self) -> NDArray[np.int16]:
        """Return the kinds of all cells, shape `lattice.shape`."""
        shape = self.lattice.shape
        check_size(shape, "body.cells")
        if isinstance(self.base, int):
            kinds = np.full(shape, self.base, dtype=np.int16)
        else:
            kinds = self.base.copy()
        for region in self.regions:
            for cells in slabs(self.cells_of(region.shape)):
                inside = region.shape.contains(self.lattice.centres(cells))
                kinds[tuple(cells[inside].T)] = region.kind
        return kinds

    @cached_property
    def _pyramid(self) -> list[NDArray[np.int16]]:
        """The kinds of boxes of 1, 2, 4, ... cells of a body given cell by cell, or MIXED."""
        levels = [] if isinstance(self.base, int) else [self.base]
        while levels and max(levels[-1].shape) > 1:
            values = levels[-1]
            for axis in range(values.ndim):
                pad = [(0, values.shape[a] % 2 if a == axis else 0) for a in range(values.ndim)]
                lines = np.moveaxis(np.pad(values, pad, constant_values=MIXED), axis, 0)
                pair = np.where(lines[0::2] == lines[1::2], lines[0::2], MIXED)
                values = np.moveaxis(pair, 0, axis).astype(np.int16)
            levels.append(values)
        return levels

    def box_kinds(self, lower: Cells, exponent: int) -> Ints:
        """Return the kind that fills each box of 2^exponent cells a side from `lower`, or MIXED."""
        shape = np.asarray(self.lattice.shape)
        upper = lower + (1 << exponent)
        inside = np.all((lower >= 0) & (upper <= shape), axis=1)
        beyond = (upper <= 0) | (lower >= shape)
        outside = np.any(beyond, axis=1)
        found = np.full(len(lower), MIXED, dtype=np.int64)
        found[outside] = self._outside(lower[outside], upper[outside], beyond[outside])
        found[inside] = self._inside(lower[inside], exponent)
        return found

    def _outside(self, lower: Cells, upper: Cells, beyond: Flags) -> Ints:
        """Beyond one side its condition holds, beyond two there is air."""
        shape = np.asarray(self.lattice.shape)
        axis = np.argmax(beyond, axis=1)
        each = np.arange(len(lower))
        index = 2 * axis + (lower[each, axis] >= shape[axis])
        along = np.ones_like(beyond)
        along[each, axis] = False
        straddles = np.any(along & ~beyond & ((lower < 0) | (upper > shape)), axis=1)
        kind = np.where(beyond.sum(axis=1) > 1, AIR, self.beyond[index])
        return np.where(straddles & (kind != AIR), MIXED, kind)

    def _inside(self, lower: Cells, exponent: int) -> Ints:
        h = self.lattice.cell_size
        if isinstance(self.base, int):
            kind = np.full(len(lower), self.base, dtype=np.int64)
        elif exponent < len(self._pyramid):
            kind = self._pyramid[exponent][tuple((lower >> exponent).T)].astype(np.int64)
        else:
            kind = np.full(len(lower), MIXED, dtype=np.int64)
        # A box is of a region's kind if the region holds the centres of all of its cells.
        low = np.asarray((lower + 0.5) * h)
        high = np.asarray((lower + (1 << exponent) - 0.5) * h)
        for region in self.regions:
            inside, apart = relation(region.shape, low, high)
            crossed = np.where(kind == region.kind, kind, MIXED)
            kind = np.where(inside, region.kind, np.where(apart, kind, crossed))
        return kind


def count(box: CellBox) -> int:
    """Return the number of cells in a box; exact, however large."""
    return prod(int(high) - int(low) for low, high in zip(*box, strict=True))


def grid(lower: Ints, upper: Ints) -> Cells:
    """Return all cells with lower <= cell < upper, the last axis running fastest."""
    return _combined([np.arange(a, b) for a, b in zip(lower, upper, strict=True)])


def _combined(places: Iterable[Ints]) -> Cells:
    return np.stack([axis.ravel() for axis in np.meshgrid(*places, indexing="ij")], axis=1)


def slabs(box: CellBox) -> Iterator[Cells]:
    """Yield all cells of a box, in the order of `grid`, in pieces of a million."""
    lower, upper = box
    for start in range(0, count(box), 1_000_000):
        number = np.arange(start, min(start + 1_000_000, count(box)))
        yield lower + np.stack(np.unravel_index(number, tuple(upper - lower)), axis=1)


def relation(shape: Shape, low: Points, high: Points) -> Relation:
    """Tell which boxes of centres lie surely inside a shape, and which surely outside.

    A centre on the edge is inside: `Shape.relation`, of boxes that touch, is asked a little wider.
    """
    if np.array_equal(low, high):
        inside = shape.contains(low)
        return inside, ~inside
    margin = 1e-6 * (high - low)
    return shape.relation(low - margin, high + margin)


def resolve(
    body: Body,
    legend: Mapping[str, str],
    materials: Mapping[str, Material],
    sides: Mapping[str, SideCondition],
) -> ResolvedBody:
    """Return a body whose names are materials, and whose regions are shapes."""
    picture = _picture(body, legend)
    shape = body.cells if picture is None else picture.codes.shape
    assert shape is not None
    lattice = body.lattice_of(shape)
    for name in [region.name for region in body.regions if region.name in sides]:
        raise SceneError(
            f"sides.{name}: {name!r} is an outline, and only sides of the array can be held; hold "
            "a side, or load the outline instead ([[loads]] with its name as outline)"
        )
    for number, region in enumerate(body.regions):
        if region.name in lattice.sides:
            told = "is what a side of the array is called; take another"
            raise SceneError(f"body.regions.{number}.name: {region.name!r} {told}")
    _check_sides(sides, lattice.sides)
    found = _materials(body, picture, materials)
    check_count(len(found))
    kind_of = NOT_BODY | {name: index for index, name in enumerate(found)}
    base: int | NDArray[np.int16]
    if picture is None:
        assert body.material is not None
        base = kind_of[body.material]
    else:
        kinds_of_codes = np.array([kind_of[name] for name in picture.names], dtype=np.int16)
        base = kinds_of_codes[picture.codes]
    regions = tuple(
        FilledShape(region.shape_in(lattice, f"body.regions.{number}"), kind_of[region.material])
        for number, region in enumerate(body.regions)
    )
    beyond = np.array([sides.get(side, FREE).code for side in lattice.sides], dtype=np.int64)
    resolved = ResolvedBody(lattice, base, regions, beyond, tuple(found.values()), picture)
    if not body.outlined:
        _check_regions(resolved)
    return resolved


def _picture(body: Body, legend: Mapping[str, str]) -> Picture | None:
    if body.picture_key is None:
        if legend:
            raise SceneError("legend: explains a drawing, an image or an array; the body has none")
        return None
    if not legend:
        raise SceneError(
            f"legend: is needed to explain the {body.picture_key}, such as "
            '{"." = "air", "#" = "steel"}'
        )
    readers = {"drawing": from_drawing, "array": from_array}
    readers["image"] = partial(from_image, nearest=body.nearest_colour)
    return readers[body.picture_key](getattr(body, body.picture_key), legend)


def _materials(
    body: Body, picture: Picture | None, described: Mapping[str, Material]
) -> dict[str, Material]:
    """Return the materials that a body is made of, by name."""
    if picture is not None:
        keys = dict.fromkeys(picture.names, "legend")
    else:
        assert body.material is not None
        keys = {body.material: "body.material"}
    for number, region in enumerate(body.regions):
        keys.setdefault(region.material, f"body.regions.{number}.material")
    found = LIBRARY | dict(described)
    for name, key in keys.items():
        if name == PINNED and not body.outlined:
            told = 'in the plane a region with outline = "true" can be pinned; give it, or "rigid"'
            raise SceneError(f"{key}: {told}")
        if name not in found and name not in NOT_BODY:
            names = list(dict.fromkeys([*described, *LIBRARY, *NOT_BODY]))
            bare = name.isascii() and name.isidentifier()  # else TOML quotes keys
            written = name if bare else json.dumps(name, ensure_ascii=False)
            near = meant_material(HELD_AS.get(name, name), names)
            told = f"{key}: there is no material {name!r}{near}; describe it under"
            raise SceneError(f"{told} [materials.{written}] or use {', '.join(names)}")
    return {name: found[name] for name in keys if name not in NOT_BODY}


def _check_sides(sides: Mapping[str, SideCondition], names: tuple[str, ...]) -> None:
    axes = range(len(names) // 2)
    for name, side in sides.items():
        check_side(name, names, f"sides.{name}")
        if side.displacement is not None:
            check_axes(side.displacement, len(axes), f"sides.{name}.displacement")
        across = names.index(name) // 2
        along = tuple(axis for axis in axes if axis != across)
        if side.free_axes not in ((), along):
            raise SceneError(
                f"sides.{name}.displacement: give a number for every axis; or one for "
                f'{"xyz"[across]}, and "free" for '
                f"{' and '.join('xyz'[axis] for axis in along)}"
            )


def _check_regions(resolved: ResolvedBody) -> None:
    """Refuse a region so small that no cell's centre lies in it: it would do nothing."""
    for number, region in enumerate(resolved.regions):
        box = resolved.cells_of(region.shape)
        if count(box) > 10_000:  # such a region is not small
            continue
        if not region.shape.contains(resolved.lattice.centres(grid(*box))).any():
            where, lattice = f"body.regions.{number}: holds no cell's centre; ", resolved.lattice
            if much_larger(region.shape, lattice):
                raise SceneError(f"{where}it {reach_of(region.shape, lattice)}")
            raise SceneError(
                f"{where}cells are {lattice.cell_size:g} m wide. Make it larger or the cells "
                'smaller, or give all regions outline = "true"'
            )


# What a scene is refused for: a body that is not there or floats, and outlines not proved.

MOST_EXAMINED = 10_000_000
"""Up to this many cells a body is examined cell by cell, above by samples."""

_HOLDS = (RIGID, ROLLER, FOUNDATION, DISPLACED)
_REMEDY = (
    'hold it by [sides] such as bottom = "rigid", or by a rigid cell or region (a prescribed rule '
    "alone needs no support: body.allow_floating = true)"
)


def check_body(resolved: ResolvedBody, allow_floating: bool) -> None:
    """Refuse a body that is not there or floats; parts are sought up to `MOST_EXAMINED` cells."""
    boxes = [resolved.box] + [resolved.cells_of(region.shape) for region in resolved.regions]
    if not any(_has_body(resolved, box) for box in boxes):
        raise SceneError(nothing_left(resolved))
    if allow_floating:
        return
    if resolved.uniform or resolved.lattice.size > MOST_EXAMINED:
        _check_samples(resolved, boxes)
    else:
        _check_parts(resolved)


def nothing_left(resolved: ResolvedBody) -> str:
    """Say that there is no body, and which region leaves none if one covers the array."""
    for number, part in reversed([*enumerate(resolved.regions)]):
        low, high = part.shape.extent
        if part.kind < 0 and np.all(low <= 0.0) and np.all(high >= resolved.lattice.extent):
            told = reach_of(part.shape, resolved.lattice)
            return f"body.regions.{number}: leaves nothing of the body: it {told}"
    return "body: none of its cells is body; at least one must be of a material"


def _check_samples(resolved: ResolvedBody, boxes: list[CellBox]) -> None:
    inside = [resolved.base, *(part.kind for part in resolved.regions)]
    if any(np.isin(kind, _HOLDS).any() for kind in inside):
        return
    for side in np.flatnonzero(np.isin(resolved.beyond, _HOLDS)):
        if any(_has_body(resolved, resolved.layer(box, int(side))) for box in boxes):
            return
    raise SupportError(f"sides: nothing holds the body; {_REMEDY}")


def _has_body(resolved: ResolvedBody, box: CellBox) -> bool:
    """Tell whether a box holds a cell of body; of large boxes only samples are looked at."""
    if count(box) == 0:
        return False
    lower, upper = box
    most = int(100_000 ** (1.0 / len(lower)))  # along an axis, corners included
    places = np.linspace(lower, upper - 1, min(most, int((upper - lower).max())), dtype=np.int64)
    small = slabs(box) if count(box) <= MOST_EXAMINED else ()
    return any(np.any(resolved.kinds(c) >= 0) for c in chain([_combined(places.T)], small))


def _check_parts(resolved: ResolvedBody) -> None:
    # in a frame of what lies beyond the sides
    framed = np.pad(resolved.rasterise(), 1, constant_values=resolved.beyond.reshape(-1, 2))
    parts, held = _parts_of_boxes(framed) if resolved.lattice.boxes else _parts(resolved, framed)
    loose = np.flatnonzero(~held[1:]) + 1
    if len(loose) == len(held) - 1:
        raise SupportError(f"sides: nothing holds the body; {_REMEDY}")
    if len(loose):
        raise SupportError(
            f"body: nothing holds {len(loose)} of its {len(held) - 1} parts "
            f"(first the one with cell {np.argwhere(parts == loose[0])[0].tolist()}; cells that "
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


def check_outlines(scene: Description, body: ResolvedBody) -> None:
    """Refuse what contradicts true outlines, or is not proved with them."""
    names = [region.name or "" for region in scene.body.regions]
    for number, region in enumerate(scene.body.regions):
        where = f"body.regions.{number}"
        if region.outline != "true":
            raise SceneError(
                f"{where}.outline: all regions of a body have true outlines or none; give it "
                'outline = "true", or leave it out everywhere'
            )
        if region.name and region.name in names[:number]:
            raise SceneError(f"{where}.name: {region.name!r} is another region's name")
    for number, load in enumerate(scene.loads):
        where = f"loads.{number}"
        if load.outline is not None and load.outline not in names:
            raise SceneError(
                f"{where}.outline: there is no region called {load.outline!r}"
                f"{suggestion(load.outline, names)}; give a region name = {load.outline!r}"
            )
        load.check_in(body.lattice, where)
        if load.side is not None and scene.sides.get(load.side, FREE).kind != "free":
            raise SceneError(f"{where}.side: {load.side} is held; load a side that is free")
    for refused, told in _unproved(scene, body):
        if refused:
            key, _, remedy = told.partition(": ")
            what = f'is not possible within true outlines; {remedy}, or take outline = "cells"'
            raise SceneError(f"{key}: {what}")


def _unproved(scene: Description, body: ResolvedBody) -> Iterator[tuple[object, str]]:
    """Yield whether a scene has what cells take alone, and what is to be done about it."""
    solid, own, walls = body.lattice.dimension == 3, scene.body, ("rigid", PINNED, "roller")
    fills = {own.material, *(region.material for region in own.regions)} - set(NOT_BODY)
    yield body.lattice.kind not in ("square", "cube"), "body.lattice: take squares or cubes"
    yield own.picture_key, f"body.{own.picture_key}: give cells and material"
    yield scene.history is not None, "history: leave it out"
    yield own.material in walls, f"body.material: {own.material} is no body; take a material"
    for number, region in enumerate(own.regions):
        where = f"body.regions.{number}.material"
        yield region.material in walls[0 if solid else 2 :], f"{where}: hold the body by [sides]"
    if not fills:
        raise SceneError("body.regions: all is air; give a region, or the body, a material")
    yield solid and len(fills) > 1, "body.regions: in space take one material, beside air"
    weighs = any(own.gravity or ())
    yield weighs and (solid or len(fills) > 1), "body.gravity: leave it out, or the second material"
    for material in body.materials:
        soft = solid or own.plane != "strain" or material.poissons_ratio < 0.5
        yield not soft, f"materials.{material.name}.poissons_ratio: take less than 1/2"
    for name, side in scene.sides.items():
        moved, where = side.displacement is not None, f"sides.{name}.displacement"
        yield side.stiffness is not None, f"sides.{name}.stiffness: take rigid or roller"
        yield moved and not solid, f"{where}: take rigid or roller"
        yield moved and scene.loads, f"{where}: leave the loads out"
    for number, load in enumerate(scene.loads):
        uneven = [key for key in ("couple", "pressure_slope") if solid or not load.side]
        boxed = load.region is not None and load.region.box is not None and not solid
        for key in ("cell", "point", *([] if boxed else ["region"]), *uneven):
            told = "load a side (in the plane also an outline, or region = { box = ... } round the "
            told += "place) by a force or a pressure"
            told += ", for a couple two boxes by opposite forces" * (key == "couple" and not solid)
            yield getattr(load, key) is not None, f"loads.{number}.{key}: {told}"
        yield solid and load.outline is not None, f"loads.{number}.outline: load a side"
        yield load.steps != 1, f"loads.{number}.steps: leave it out"
