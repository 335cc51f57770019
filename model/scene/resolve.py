"""From a described body to what is where: names become materials, shapes become cells."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import LIBRARY, Material, suggestion
from kaju.errors import SceneError
from kaju.model.scene.cell_types import NOT_BODY

from .body import Body
from .pictures import Picture, check_count, from_array, from_drawing, from_image
from .resolved_body import FilledShape, ResolvedBody, count, grid
from .sides import FREE, SideCondition, unknown_side

_FEW = 10_000


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


def _check_sides(sides: Mapping[str, SideCondition], names: tuple[str, ...]) -> None:
    axes = range(len(names) // 2)
    for name, side in sides.items():
        if name not in names:
            raise unknown_side(name, names, f"sides.{name}")
        if side.displacement is not None and len(side.displacement) != len(axes):
            raise SceneError(
                f"sides.{name}.displacement: {len(axes)} numbers are needed, one for each "
                f"axis, got {list(side.displacement)}"
            )
        across = names.index(name) // 2
        along = tuple(axis for axis in axes if axis != across)
        if side.free_axes not in ((), along):
            raise SceneError(
                f"sides.{name}.displacement: a side is moved along all axes, or across itself "
                f'alone: {"xyz"[across]} is a number then, and "free" stands for '
                f"{' and '.join('xyz'[axis] for axis in along)}"
            )


def _check_regions(resolved: ResolvedBody) -> None:
    """Refuse a region so small that no cell's centre lies in it: it would do nothing."""
    for number, region in enumerate(resolved.regions):
        box = resolved.cells_of(region.shape)
        if count(box) > _FEW:
            continue
        if not region.shape.contains(resolved.lattice.centres(grid(*box))).any():
            raise SceneError(
                f"body.regions.{number}: holds no cell's centre; cells are "
                f"{resolved.lattice.cell_size:g} m wide. Make it larger or the cells smaller"
            )
