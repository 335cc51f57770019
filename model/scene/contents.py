"""From a described body to what is where: names become materials, shapes become cells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import LIBRARY, Material, suggestion
from kaju.errors import SceneError
from kaju.model.scene import cell_types

from .body import Body
from .filling import FilledShape, Filling, count, grid
from .pictures import Picture, check_count, from_array, from_drawing, from_image
from .sides import FREE, SideCondition

# Whatever does not carry load beside the body gives loads back alike.
MEDIA = ("air", "water", "gas", "vacuum")
NOT_BODY = dict.fromkeys(MEDIA, cell_types.AIR) | {
    "rigid": cell_types.RIGID,
    "roller": cell_types.ROLLER,
}
_FEW = 10_000


@dataclass(frozen=True, eq=False)
class Contents:
    """A body made ready to be asked."""

    filling: Filling
    """What is where."""
    materials: tuple[Material, ...]
    """The materials that kinds from 0 upwards stand for."""
    picture: Picture | None
    """The body cell by cell, if it was given so."""


def contents_of(
    body: Body,
    legend: Mapping[str, str],
    materials: Mapping[str, Material],
    sides: Mapping[str, SideCondition],
) -> Contents:
    """Return what a described body consists of."""
    picture = _picture(body, legend)
    shape = body.cells if picture is None else picture.codes.shape
    assert shape is not None
    lattice = body.lattice_of(shape)
    _check_sides(sides, lattice.sides)
    names = _names(body, picture)
    found = {
        name: _material(name, key, materials) for name, key in names.items() if name not in NOT_BODY
    }
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
    filling = Filling(lattice, base, regions, beyond)
    _check_regions(filling, body.outlined)
    return Contents(filling, tuple(found.values()), picture)


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
    if body.drawing is not None:
        return from_drawing(body.drawing, legend)
    if body.image is not None:
        return from_image(body.image, legend, body.nearest_colour)
    assert body.array is not None
    return from_array(body.array, legend)


def _names(body: Body, picture: Picture | None) -> dict[str, str]:
    """Return what the body is made of, by name, and where each name is used first."""
    if picture is not None:
        names = dict.fromkeys(picture.names, "legend")
    else:
        assert body.material is not None
        names = {body.material: "body.material"}
    for number, region in enumerate(body.regions):
        names.setdefault(region.material, f"body.regions.{number}.material")
    return names


def _material(name: str, key: str, materials: Mapping[str, Material]) -> Material:
    if name in materials:
        return materials[name]
    if name in LIBRARY:
        return LIBRARY[name]
    known = list(dict.fromkeys([*materials, *LIBRARY, *NOT_BODY]))
    raise SceneError(
        f"{key}: there is no material {name!r}{suggestion(name, known)}; describe it under "
        f"[materials.{name}] or use {', '.join(known)}"
    )


def _check_sides(sides: Mapping[str, SideCondition], known: tuple[str, ...]) -> None:
    for name, side in sides.items():
        if name not in known:
            raise SceneError(
                f"sides.{name}: there is no such side{suggestion(name, known)}; there is "
                f"{', '.join(known)}"
            )
        if side.displacement is not None and len(side.displacement) != len(known) // 2:
            raise SceneError(
                f"sides.{name}.displacement: {len(known) // 2} numbers are needed, one for each "
                f"axis, got {list(side.displacement)}"
            )
        across = known.index(name) // 2
        along = tuple(axis for axis in range(len(known) // 2) if axis != across)
        if side.free_axes not in ((), along):
            raise SceneError(
                f"sides.{name}.displacement: a side is moved along all axes, or across itself "
                f'alone: {"xyz"[across]} is a number then, and "free" stands for '
                f"{' and '.join('xyz'[axis] for axis in along)}"
            )


def _check_regions(filling: Filling, outlined: bool) -> None:
    """Refuse a region so small that no cell's centre lies in it: it would do nothing."""
    for number, region in enumerate(() if outlined else filling.regions):
        box = filling.cells_of(region.shape)
        if count(box) > _FEW:
            continue
        centres = filling.lattice.centres(grid(*box))
        if not region.shape.contains(centres).any():
            raise SceneError(
                f"body.regions.{number}: holds no cell's centre; cells are "
                f"{filling.lattice.cell_size:g} m wide. Make it larger or the cells smaller"
            )
