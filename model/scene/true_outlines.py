"""What a scene with true outlines may hold: what is not proved is refused by name."""

from __future__ import annotations

from collections.abc import Iterator

from kaju.agents.materials import suggestion
from kaju.errors import SceneError

from .cell_types import NOT_BODY
from .description import Description
from .resolved_body import ResolvedBody
from .sides import FREE, unknown_side

_HOLDS = ("rigid", "roller")
TAKES = 'take outline = "cells" instead'


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
        for refusal in refusals(scene, body):
            raise SceneError(refusal)


def _of_body(scene: Description, body: ResolvedBody) -> Iterator[str]:
    if body.lattice.kind not in ("square", "cube"):
        yield f"body.lattice: true outlines go with squares and cubes; {TAKES}"
    if scene.body.picture_key is not None:
        yield (
            f"body.{scene.body.picture_key}: is a body of cells, which true outlines do not cut; "
            f"give cells and material, or {TAKES}"
        )
    if scene.history is not None:
        yield f"history: time goes with cells; {TAKES}"


def _of_regions(scene: Description, body: ResolvedBody) -> Iterator[str]:
    names: list[str] = []
    for number, region in enumerate(scene.body.regions):
        where = f"body.regions.{number}"
        if region.outline != "true":
            yield (
                f"{where}.outline: all regions of a body have true outlines or none; give it "
                'outline = "true", or leave it out everywhere'
            )
        if region.material in _HOLDS:
            yield (
                f"{where}.material: {region.material} would hold the body along its outline, "
                f"which is not proved yet; hold it by [sides], or {TAKES}"
            )
        if region.name in names:
            yield f"{where}.name: {region.name!r} is another region's name"
        names += [region.name] if region.name is not None else []


def _of_materials(scene: Description, body: ResolvedBody) -> Iterator[str]:
    if scene.body.material in _HOLDS:
        yield f"body.material: {scene.body.material} is no body with true outlines; {TAKES}"
    materials = {scene.body.material, *(region.material for region in scene.body.regions)}
    count = len(materials - set(NOT_BODY))
    if count == 0:
        yield "body.regions: all is air; give a region, or the body, a material"
    rigid = [one.name for one in body.materials if one.poissons_ratio == 0.5]
    if rigid and body.lattice.dimension == 2 and scene.body.plane == "strain":
        yield (
            f"materials.{rigid[0]}.poissons_ratio: of 1/2 is not known in plane strain with true "
            f"outlines; take less, or {TAKES}"
        )
    if count > 1 and body.lattice.dimension == 3:
        yield (
            "body.regions: with true outlines in space there is one material, beside air; two "
            f"that meet are not proved yet; {TAKES}"
        )
    if count > 1 and any(scene.body.gravity or ()):
        yield (
            "body.gravity: the weight of two materials is not proved with true outlines yet; "
            f"leave it out, or {TAKES}"
        )


def _of_sides(scene: Description, body: ResolvedBody) -> Iterator[str]:
    solid = body.lattice.dimension == 3
    words = ("free", "rigid", "roller", *(["displaced"] if solid else []))
    for name, side in scene.sides.items():
        if side.kind not in words:
            yield (
                f"sides.{name}: with true outlines a side is {', '.join(words[:-1])} or "
                f"{words[-1]}, not {side.kind}; {TAKES}"
            )
        if side.kind == "displaced" and scene.loads:
            yield (
                f"sides.{name}: with true outlines a side is moved, or loads act; which bounds "
                f"hold for both is not known. Leave loads out, or {TAKES}"
            )
    if solid and any(scene.body.gravity or ()):
        yield f"body.gravity: is not known with true outlines in space; leave it out, or {TAKES}"


def _of_loads(scene: Description, body: ResolvedBody) -> Iterator[str]:
    regions = [region.name for region in scene.body.regions if region.name is not None]
    dimension = body.lattice.dimension
    for number, load in enumerate(scene.loads):
        where = f"loads.{number}"
        if load.outline is not None and load.outline not in regions:
            yield (
                f"{where}.outline: there is no region called {load.outline!r}"
                f"{suggestion(load.outline, regions)}; give a region name = {load.outline!r}"
            )
        for key in ("cell", "point", "region"):
            if getattr(load, key) is not None:
                yield (
                    f"{where}.{key}: with true outlines loads act on a side or on an outline; "
                    f"{TAKES}"
                )
        for key in ("couple", "pressure_slope"):
            if getattr(load, key) is not None:
                yield (
                    f"{where}.{key}: is not proved with true outlines yet; take force or "
                    f"pressure, or {TAKES}"
                )
        if load.outline is not None and dimension == 3:
            yield f"{where}.outline: loads on outlines are not proved in space; load a side"
        if load.force is not None and len(load.force) != dimension:
            yield f"{where}.force: {dimension} numbers (N) are needed, got {list(load.force)}"
        if load.side is not None:
            if load.side not in body.lattice.sides:
                raise unknown_side(load.side, body.lattice.sides, f"{where}.side")
            if scene.sides.get(load.side, FREE).kind != "free":
                yield f"{where}.side: {load.side} is held; load a side that is free"
        if load.steps != 1:
            yield f"{where}.steps: true outlines are answered for the whole load; leave it out"
