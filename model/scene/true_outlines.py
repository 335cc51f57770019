"""What a scene with true outlines may hold: what is not proved is refused by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kaju.agents.materials import suggestion
from kaju.errors import SceneError

from .contents import NOT_BODY

if TYPE_CHECKING:
    from .scene import Scene

_HOLDS = ("rigid", "roller")
TAKES = 'take outline = "cells" instead'


def check_no_outlines(scene: Scene) -> None:
    """Refuse a load on an outline that is a staircase."""
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            raise SceneError(
                f"loads.{number}.outline: no region called {load.outline!r} has a true outline; "
                'give one outline = "true"'
            )


def check_outlines(scene: Scene) -> None:
    """Refuse whatever a body with true outlines is not proved with."""
    solid = scene.lattice.dimension == 3
    if scene.lattice.kind not in ("square", "cube"):
        raise SceneError(f"body.lattice: true outlines go with squares and cubes; {TAKES}")
    if scene.body.picture_key is not None:
        raise SceneError(
            f"body.{scene.body.picture_key}: is a body of cells, which true outlines do not cut; "
            f"give cells and material, or {TAKES}"
        )
    if scene.history is not None:
        raise SceneError(f"history: time goes with cells; {TAKES}")
    _check_regions(scene)
    known = ("free", "rigid", "roller", *(["displaced"] if solid else []))
    for name, side in scene.sides.items():
        if side.kind not in known:
            raise SceneError(
                f"sides.{name}: with true outlines a side is {', '.join(known[:-1])} or "
                f"{known[-1]}, not {side.kind}; {TAKES}"
            )
        if side.kind == "displaced" and scene.loads:
            raise SceneError(
                f"sides.{name}: with true outlines a side is moved, or loads act; which bounds "
                f"hold for both is not known. Leave loads out, or {TAKES}"
            )
    if solid and scene.body.gravity is not None and any(scene.body.gravity):
        raise SceneError(
            f"body.gravity: is not known with true outlines in space; leave it out, or {TAKES}"
        )
    _check_loads(scene)


def _check_regions(scene: Scene) -> None:
    names: list[str] = []
    for number, region in enumerate(scene.body.regions):
        where = f"body.regions.{number}"
        if region.outline != "true":
            raise SceneError(
                f"{where}.outline: all regions of a body have true outlines or none; give it "
                'outline = "true", or leave it out everywhere'
            )
        if region.material in _HOLDS:
            raise SceneError(
                f"{where}.material: {region.material} would hold the body along its outline, "
                f"which is not proved yet; hold it by [sides], or {TAKES}"
            )
        if region.name is not None and region.name in names:
            raise SceneError(f"{where}.name: {region.name!r} is another region's name")
        names += [region.name] if region.name is not None else []
    if scene.body.material in _HOLDS:
        raise SceneError(
            f"body.material: {scene.body.material} is no body with true outlines; {TAKES}"
        )
    materials = {scene.body.material, *(region.material for region in scene.body.regions)}
    solid = materials - set(NOT_BODY)
    if not solid:
        raise SceneError("body.regions: all is air; give a region, or the body, a material")
    rigid = [one.name for one in scene.cell_materials if one.poissons_ratio == 0.5]
    if rigid and scene.plane == "strain":
        raise SceneError(
            f"materials.{rigid[0]}.poissons_ratio: of 1/2 is not known in plane strain with true "
            f"outlines; take less, or {TAKES}"
        )
    if len(solid) == 1:
        return
    if scene.lattice.dimension == 3:
        raise SceneError(
            "body.regions: with true outlines in space there is one material, beside air; two "
            f"that meet are not proved yet; {TAKES}"
        )
    if scene.body.gravity is not None and any(scene.body.gravity):
        raise SceneError(
            "body.gravity: the weight of two materials is not proved with true outlines yet; "
            f"leave it out, or {TAKES}"
        )


def _check_loads(scene: Scene) -> None:
    regions = {region.name: region for region in scene.body.regions if region.name is not None}
    for number, load in enumerate(scene.loads):
        where = f"loads.{number}"
        if load.outline is not None and load.outline not in regions:
            raise SceneError(
                f"{where}.outline: there is no region called {load.outline!r}"
                f"{suggestion(load.outline, list(regions))}; give a region name = {load.outline!r}"
            )
        for key in ("cell", "point", "region"):
            if getattr(load, key) is not None:
                raise SceneError(
                    f"{where}.{key}: with true outlines loads act on a side or on an outline; "
                    f"{TAKES}"
                )
        for key in ("couple", "pressure_slope"):
            if getattr(load, key) is not None:
                raise SceneError(
                    f"{where}.{key}: is not proved with true outlines yet; take force or "
                    f"pressure, or {TAKES}"
                )
        dimension = scene.lattice.dimension
        if load.outline is not None and dimension == 3:
            raise SceneError(
                f"{where}.outline: loads on outlines are not proved in space; load a side"
            )
        if load.force is not None and len(load.force) != dimension:
            raise SceneError(
                f"{where}.force: {dimension} numbers (N) are needed, got {list(load.force)}"
            )
        if load.side is not None:
            if load.side not in scene.lattice.sides:
                known = scene.lattice.sides
                raise SceneError(
                    f"{where}.side: there is no side {load.side!r}{suggestion(load.side, known)}; "
                    f"there is {', '.join(known)}"
                )
            if scene.side_condition(load.side).kind != "free":
                raise SceneError(f"{where}.side: {load.side} is held; load a side that is free")
        if load.steps != 1:
            raise SceneError(
                f"{where}.steps: true outlines are answered for the whole load; leave it out"
            )
