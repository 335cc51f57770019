"""From a described body to what is where: names become materials, shapes become cells."""

from __future__ import annotations

import json
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
    if body.drawing is not None:
        return from_drawing(body.drawing, legend)
    if body.image is not None:
        return from_image(body.image, legend, body.nearest_colour)
    assert body.array is not None
    return from_array(body.array, legend)


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
        if name not in found and name not in NOT_BODY:
            names = list(dict.fromkeys([*described, *LIBRARY, *NOT_BODY]))
            written = name if name.isidentifier() else json.dumps(name)  # as TOML quotes keys
            raise SceneError(
                f"{key}: there is no material {name!r}{suggestion(name, names)}; describe it under "
                f"[materials.{written}] or use {', '.join(names)}"
            )
    return {name: found[name] for name in keys if name not in NOT_BODY}


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
                f"sides.{name}.displacement: give a number for every axis; or one for "
                f'{"xyz"[across]}, and "free" for '
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
