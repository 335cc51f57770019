"""The scene: one description of body, supports, loads and rule that every model takes."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cached_property
from itertools import product
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from kaju.agents.materials import Material
from kaju.agents.rules import PrescribedRule
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ParameterError, SceneError, SceneFileError, brief
from kaju.files import atomic_file, text_of_file
from kaju.result_kinds import html_in_notebook

from . import cell_types, description
from .curves import flattened
from .description import LONGEST, Body, Description, LoadTable, SideCondition, with_shared
from .lattice import Cells, Lattice, check_boxes
from .pictures import Picture, check_size
from .regions import PIXELS, PathShape, Region, covers, much_larger, reach_of
from .resolved_body import CellBox, ResolvedBody, check_body, check_outlines, nothing_left, resolve
from .selection import AppliedLoads, Selection, at_stage, check_gravity, select
from .shapes import Ball, Box, Polygon, RoundedBox, Shape
from .surfaces import ClosedSurface
from .validation import key_path, plain, read_toml, with_lines


class Scene(Description):
    """A body, how it is held, how it is loaded, and the rule by which agents pass load on.

    What a scene file writes as tables may be given as dictionaries too. Scenes are equal if they
    describe the same cells, supports, loads and rule, even in other words.

    Parameters
    ----------
    body : Body
        The cells and what fills them.
    legend : dict of str to str
        What the letters, colours or codes of a drawn body stand for: a material's name,
        "air", "rigid" or "roller".
    materials : dict of str to Material, or path
        Materials by name; names of the library need no entry. A path is that of a TOML file that
        holds them, which several scenes may share.
    sides : dict of str to SideCondition
        How the sides of the array are held; free unless given.
    loads : tuple of Load
        What presses on the body.
    loading : {"afresh", "continue"}
        Whether agents start anew at each step of the loads ("afresh"), or live on and take what the
        step adds ("continue").
    rule : PrescribedRule
        How agents pass load on.
    history : History, optional
        How the loads change in time, for `creep`; all other models ignore it.

    Raises
    ------
    SceneError
        If the description breaks a rule; the message names key, rule, value and remedy.
    SupportError
        If nothing holds the body, or a part of it.

    Examples
    --------
    >>> from kaju import Scene
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> scene.lattice.size, scene.with_overrides({"loads.0.force.1": -3.0}).loads[0].force
    (25, (0.0, -3.0))
    """

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        description.check_rule(self.rule, [*self.materials, *(m.name for m in self.cell_materials)])
        with self.misplaced():
            if self.outlined:
                check_outlines(self, self._resolved)
                return self
            check_body(self._resolved, self.body.allow_floating)
            check_gravity(self._resolved, self.body.gravity)
            _ = self.selections
        return self

    @classmethod
    def from_toml(cls, text: str, folder: str | Path | None = None) -> Scene:
        """Return the scene that a TOML text describes; its paths start from `folder`."""
        return cls(**table_from(text, folder))

    @classmethod
    def from_drawing(
        cls, drawing: str, *, legend: Mapping[str, str], cell_size: float, **others: Any
    ) -> Scene:
        """Return the scene of a body drawn in letters, one a cell, the top row first.

        The legend says what each stands for: a material's name, "air", "rigid" or "roller".
        `others` are further parts of the body (`thickness`, `plane`, `regions`, ...) or of the
        scene (`materials`, `sides`, `loads`, `rule`).
        """
        return cls._pictured("drawing", drawing, legend, cell_size, others)

    @classmethod
    def from_image(
        cls, path: str | Path, *, legend: Mapping[str, str], cell_size: float, **others: Any
    ) -> Scene:
        """Return the scene of a body painted in an image, one pixel a cell; see `from_drawing`.

        The legend explains colours, "#rrggbb" or names, and "transparent".
        """
        return cls._pictured("image", path, legend, cell_size, others)

    @classmethod
    def from_array(
        cls,
        array: NDArray[np.integer] | str | Path,
        *,
        legend: Mapping[int, str] | Mapping[str, str],
        cell_size: float,
        **others: Any,
    ) -> Scene:
        """Return the scene of a body in an array of codes, or in an ``.npy`` file of it.

        It is indexed [x, y] or [x, y, z] from left, front and bottom; see `from_drawing`.
        """
        return cls._pictured("array", array, legend, cell_size, others)

    @classmethod
    def _pictured(
        cls, key: str, picture: object, legend: object, cell_size: float, others: dict[str, Any]
    ) -> Scene:
        body = {name: value for name, value in others.items() if name not in cls.model_fields}
        rest = {name: value for name, value in others.items() if name in cls.model_fields}
        return cls(body={key: picture, "cell_size": cell_size, **body}, legend=legend, **rest)

    _repr_html_ = html_in_notebook

    @property
    def outlined(self) -> bool:
        """Whether the body has true outlines, which only elasticity can use."""
        return self.body.outlined

    @property
    def _of_cells(self) -> ResolvedBody:
        """The body of cells; refused where true outlines say what the body is."""
        if self.outlined:
            raise SceneError(
                'body.regions: outline = "true" is for kaju solve alone, and in the plane for '
                "SpawningModel; for agents that pass loads on, creep and growth take outline = "
                '"cells" and small cells'
            )
        return self._resolved

    @property
    def lattice(self) -> Lattice:
        """The grid of cells."""
        return self._resolved.lattice

    @property
    def region_shapes(self) -> tuple[Shape, ...]:
        """Shapes of the body's regions, in their order, as they were read."""
        return tuple(one.shape for one in self._resolved.regions)

    @property
    def plane(self) -> Literal["stress", "strain"] | None:
        """Two-dimensional state; None for cubes."""
        return None if self.lattice.dimension == 3 else self.body.plane or "stress"

    @property
    def thickness(self) -> float:
        """Thickness of a two-dimensional body (m); 1 in three dimensions."""
        return self.body.thickness or 1.0

    @property
    def stages(self) -> int:
        """Number of stages of loading: the largest number of steps of a load, at least 1."""
        return max((load.steps for load in self.loads), default=1)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know about the body, in words."""
        found, h = [], self.lattice.cell_size
        moved = any(any(side.displacement or ()) for side in self.sides.values())
        moved |= self.outlined and self.lattice.dimension == 2  # which is refused without a load
        if not (self.loads or moved or any(self.body.gravity or ())):
            found.append(
                "nothing is applied, so all is 0: give loads, gravity or a side that moves"
            )
        wide = max(self.lattice.extent)
        softest = 5e5 if wide >= 10.0 else 1e3  # Pa: a large body; foams and gels
        asked = "are these metres and pascals? 1 mm is 0.001 m, 1 MPa is 1e6 Pa"
        for material in self.cell_materials:
            if (modulus := material.youngs_modulus) < softest:
                soft = f"materials.{material.name}: youngs_modulus = {modulus:g} Pa is soft for a"
                found.append(f"{soft} body of {wide:g} m; {asked}")
        if wide > 20.0 and all(one.youngs_modulus > 60e9 for one in self.cell_materials):
            made_of = ", ".join(one.name for one in self.cell_materials)  # metals, glass
            found.append(f"body: {wide:g} m are much for a body of {made_of}; {asked}")
        if max(map(abs, self.body.gravity or (0.0,))) > 2000.0:
            found.append(
                f"body.gravity: {self.body.gravity} m/s² is much: the Earth's is 9.81 m/s²?"
            )
        thick = self.body.thickness or 0.0  # as it was given
        if self.plane == "stress" and thick > 20.0 * wide:
            found.append(f"body.thickness: {thick:g} m are much for a plate of {wide:g} m; {asked}")
        if self.plane and not thick and any(load.pressure is None for load in self.loads):
            found.append("body.thickness is not given: 1 m is taken; is it meant so?")
        base, regions = self._resolved.base, self._resolved.regions
        for number, filled in enumerate(regions):
            (low, high), shape, where = filled.shape.extent, filled.shape, f"body.regions.{number}"
            others = (one.shape.extent for one in regions[:number] if one.kind != filled.kind)
            own = isinstance(base, int) and filled.kind == base
            if own and not any(np.less(a, high).all() and np.less(low, b).all() for a, b in others):
                found.append(f"{where}: this region is of the material below it; is it meant so?")
            if isinstance(shape, ClosedSurface) and shape.ambiguous:
                found.append(
                    f"{where}.surface: a shell within another looks outwards, too; it was taken "
                    "for a cavity. If it is a part of its own, give it a region of its own"
                )
            # of a radius of 2.4 cells becomes a square, of 5 the disk is off by 10 %
            if not self.outlined and isinstance(shape, Ball) and shape.radius < 5.0 * h:
                found.append(
                    f"{where}: its radius of {shape.radius:g} m is {shape.radius / h:.2g} cells, "
                    'so cells make a polygon of it; take smaller cells, or outline = "true"'
                )
            if filled.kind == cell_types.AIR and _meets_edge(shape, self.lattice):
                told = reach_of(shape, self.lattice, "is it meant so?")
                found.append(f"{where}: this hole meets the edge of the body: it {told}")
        return (
            *found,
            *self._overlaps,
            *self._covered,
            *self._between,
            *self._cut_off,
            *self._missed,
        )

    @property
    def _overlaps(self) -> Iterator[str]:
        """Which round holes overlap, in words."""
        pairs = zip(self.body.regions, self._resolved.regions, strict=True)
        holes = [
            (given.name or f"body.regions.{number}", filled.shape)
            for number, (given, filled) in enumerate(pairs)
            if filled.kind == cell_types.AIR and isinstance(filled.shape, Ball)
        ]
        names, shapes = [*zip(*holes, strict=True)] or [(), ()]
        centre, radius = np.array([s.centre for s in shapes]), np.array([s.radius for s in shapes])
        one, other = np.triu_indices(len(names), 1)
        apart = np.linalg.norm(centre[one] - centre[other], axis=-1)
        meet = (np.abs(radius[one] - radius[other]) < apart) & (apart < radius[one] + radius[other])
        for a, b in zip(one[meet], other[meet], strict=True):
            yield f"the holes {names[a]!r} and {names[b]!r} overlap: is it meant so?"

    @property
    def _covered(self) -> Iterator[str]:
        """Which holes a later region fills, in words."""
        found = self._resolved.regions
        every, d = [one.shape.extent for one in found], self.lattice.dimension
        ends = np.array(every).reshape(len(found), 2, d)
        for number, hole in enumerate(found):
            over = (ends[:, 0] <= ends[number, 0]) & (ends[:, 1] >= ends[number, 1])
            for later in np.flatnonzero(over.all(axis=1)) if hole.kind == cell_types.AIR else ():
                other = found[later]
                if later > number and other.kind != hole.kind and covers(other.shape, hole.shape):
                    told = "covers this hole; what lies on top comes last"
                    yield f"body.regions.{number}: body.regions.{later} {told}"

    @property
    def _between(self) -> Iterator[str]:
        """Which regions of cells have a straight side between lines of cells, in words."""
        h, size, plane = self.lattice.cell_size, np.array(self.lattice.extent), self.plane
        for number, region in enumerate(self.body.regions if self.lattice.boxes else ()):
            if region.outline == "true" or region.image is not None:
                continue
            found = {
                f"{'xyz'[axis]} = {at:.4g} m": f"{h * np.floor(at / h + 0.5):.4g} m"
                for axis, at in _straight_sides(self.region_shapes[number], plane, h)
                if abs(at / h - np.rint(at / h)) > 0.02 and 0.0 < at < size[axis]
            }
            if found:
                cure = ', or outline = "true"' * (region.material not in ("rigid", "roller"))
                told = f"{', '.join(found)}, between cells of {h:.4g} m"
                yield (
                    f"body.regions.{number} ends at {told}: the body that is solved ends at "
                    f"{', '.join(found.values())} there; take cells that fit{cure}"
                )

    @property
    def _cut_off(self) -> Iterator[str]:
        """Which shapes reach beyond the array, or are of files that name no unit, in words."""
        size, found = np.array(self.lattice.extent), self._resolved.regions
        plain = [getattr(one.shape, "in_pixels", False) for one in found]
        if any(plain):
            yield f"body.regions.{plain.index(True)}.path: {PIXELS}; or is it meant so?"
        for number, filled in enumerate(found):
            shape, where = filled.shape, f"body.regions.{number}"
            (low, high), surface = shape.extent, isinstance(shape, ClosedSurface)
            # Boxes go over the edge to say "all of this side", and disks are halved by symmetry.
            drawn = surface or isinstance(shape, PathShape | Polygon) or _lies_in(shape, size)
            margin, far = 0.01 * size.max(), much_larger(shape, self.lattice)
            cut = drawn and np.any((low < -margin) | (high > size + margin))
            told = "what lies beyond is cut off" + surface * "; offset = [x, y, z] (m) moves it"
            told = "" if far else told  # the units are asked for
            asked = far and (surface or isinstance(shape, RoundedBox))
            if not plain[number] and ((cut and filled.kind != cell_types.AIR) or asked):
                yield f"{where}: {reach_of(shape, self.lattice, told)}"

    @property
    def _missed(self) -> Iterator[str]:
        """Which sides hold nothing, for no material reaches them, in words."""
        lattice, base = self.lattice, self._resolved.base
        parts = np.array([one.shape.extent for one in self._resolved.regions if one.kind >= 0])
        if not len(parts) or not isinstance(base, int) or base >= 0 or not lattice.boxes:
            return
        near = lattice.cell_size * (1e-6 if self.outlined and self.plane else 0.5)
        for side, held in self.sides.items():
            axis, upper = divmod(lattice.sides.index(side), 2)
            end = float(parts[:, 1, axis].max() if upper else parts[:, 0, axis].min())
            edge = lattice.extent[axis] * upper
            if held.kind != "free" and (edge - end if upper else end) > near:
                reach = f"the body ends at {'xyz'[axis]} = {end:.4g} m, the array at {edge:.4g} m"
                yield f"sides.{side} holds nothing: {reach}; let the array end where the body does"

    @contextmanager
    def misplaced(self) -> Iterator[None]:
        """Let errors say, too, which shapes may lie elsewhere than meant."""
        try:
            yield
        except SceneError as error:
            told = [] if PIXELS in str(error) else [*self._cut_off, *self._missed]
            raise type(error)("; ".join([str(error), *told])) from None

    def notes_on(self, displacement: float, stress: float = 0.0, kind: int = 0) -> tuple[str, ...]:
        """Return the `notes`, and more on a large displacement (m), and stress (Pa) of a kind."""
        share, material = displacement / max(self.lattice.extent), self.cell_materials[kind]
        name, asked = repr(material.name), "are these metres, newtons and pascals?"
        moved = (
            f"the largest displacement is {share:.2g} times the body's size: are these metres and "
            "pascals? Displacements are taken to be small"
        )
        small = f"von Mises reaches only {stress:.2g} Pa in {name}: {asked} 1 MPa is 1e6 Pa"
        borne = f"von Mises reaches {1e-9 * stress:.3g} GPa, more than common {name} bears: {asked}"
        # Of metals, glass and concrete: mild steel yields at 0.1 % of its modulus, breaks at 0.3 %.
        stiff = stress > 0.003 * material.youngs_modulus > 9e7
        least = min((abs(load.pressure or 0.0) for load in self.loads), default=0.0)
        slight = 1.0 < least <= 300.0 and 0.0 < stress < 1e-8 * material.youngs_modulus
        return (*self.notes, *[moved] * (share > 0.05), *[borne] * stiff, *[small] * slight)

    @property
    def cell_materials(self) -> tuple[Material, ...]:
        """The materials of the body; kinds from 0 upwards are indices into them."""
        return self._resolved.materials

    @property
    def nothing_left(self) -> str:
        """What is to be said where regions leave nothing of the body."""
        return nothing_left(self._resolved)

    def side_condition(self, name: str) -> SideCondition:
        """Return how a side of the array is held."""
        description.check_side(name, self.lattice.sides, f"sides.{name}")
        return self.sides.get(name, description.FREE)

    def kinds(self, cells: Cells) -> Ints:
        """Return what cells (n, dimension) are: indices into `cell_materials`, or `cell_types`."""
        return self._of_cells.kinds(np.asarray(cells, dtype=np.int64))

    @property
    def uniform(self) -> bool:
        """Whether every cell of the array is of one kind."""
        return self._of_cells.uniform

    def bounds(self) -> CellBox:
        """Return a box outside of which there is no body: lower <= cell < upper."""
        return self._of_cells.bounds()

    def box_kinds(self, lower: Cells, exponent: int) -> Ints:
        """Return the kind that fills each box of 2^exponent cells a side from `lower`, or MIXED."""
        return self._of_cells.box_kinds(lower, exponent)

    def rasterise(self) -> NDArray[np.int16]:
        """Return the kinds of all cells, 2e8 at most, shape `lattice.shape`."""
        return self._of_cells.rasterise()

    def applied(self, stage: int | None = None) -> AppliedLoads:
        """Return the forces on the cells at a stage of loading, 1 to `stages`; None: the last."""
        stage = self.stages if stage is None else stage
        if not 1 <= stage <= self.stages:
            raise SceneError(f"stage: must lie between 1 and {self.stages}, got {stage}")
        return at_stage(self, self._of_cells, self.selections, stage)

    def replace(self, **changes: Any) -> Scene:
        """Return the scene with some of its parts (`loads`, `rule`, ...) replaced."""
        parts = {name: getattr(self, name) for name in type(self).model_fields}
        return Scene(**(parts | changes))

    def in_one_step(self) -> Scene:
        """Return the scene with all of its loads applied at once."""
        if self.stages == 1:
            return self
        loads = tuple(load.model_copy(update={"steps": 1}) for load in self.loads)
        return self.replace(loads=loads)

    def with_region(self, material: str = "air", **shape: Any) -> Scene:
        """Return the scene with one more region, as in `body.regions`; by default a hole."""
        regions = (*self.body.regions, Region(material=material, **shape))
        return self.replace(body=Body(**dict(self.body) | {"regions": regions}))

    def refine(self, k: int) -> Scene:
        """Return the same body, supports and loads on squares or cubes k times smaller.

        Pixels of pictures are repeated; regions are evaluated at the centres of the new cells.
        """
        picture = self._of_cells.picture
        body = _refined_body(self, picture, k)
        legend = {str(code): name for code, name in enumerate(picture.names if picture else ())}
        bare = self.replace(body=body, legend=legend, loads=())
        return bare.replace(loads=tuple(_refined_loads(self, bare.kinds, int(k))))

    def with_overrides(self, changes: Mapping[str, Any]) -> Scene:
        """Return the scene with single values replaced by key path.

        ``{"loads.0.steps": "1", "rule.threshold": 0.001}``: texts are read as TOML values.
        """
        changes = {key_path(path): value for path, value in changes.items()}
        table = table_of(self)
        if "rule" not in self.model_fields_set:  # nobody wrote it
            del table["rule"]
        one_share = any(path.startswith("rule.alpha.") for path in changes)
        if one_share and isinstance(self.rule, PrescribedRule):  # perhaps left to the dimension
            table.setdefault("rule", {})["alpha"] = list(self.rule.alpha_in(self.lattice.dimension))
        return Scene(**overridden(table, changes))

    def to_toml(self) -> str:
        """Return the scene as TOML, from which `from_toml` makes an equal scene."""
        return written(table_of(self), self._resolved.picture)[0]

    def save(self, path: str | Path) -> None:
        """Write the scene to a file; a large array goes into an ``.npy`` file beside it."""
        path, table = Path(path), table_of(self)
        beside = path.with_name(f"{path.stem}.cells.npy")
        for region in table["body"].get("regions", []):
            for key in {"image", "surface", "path"} & set(region):
                if isinstance(region[key], dict) and not region[key]["file"].startswith("data:"):
                    region[key]["file"] = os.path.relpath(region[key]["file"], path.parent)
        text, codes = written(table, self._resolved.picture, beside.name)
        if codes is not None:
            with atomic_file(beside, SceneFileError) as scratch:
                np.save(scratch, codes, allow_pickle=False)
        with atomic_file(path, SceneFileError) as scratch:
            scratch.write_text(text, encoding="utf-8")

    def to_archive(self) -> tuple[str, dict[str, NDArray[Any]]]:
        """Return the scene as TOML, its files within it, and the arrays that it refers to."""
        table = table_of(self)
        for number, filled in enumerate(self._resolved.regions):
            region, shape = table["body"]["regions"][number], filled.shape
            for key in {"image", "surface", "path"} & set(region):
                if not isinstance(region[key], str):
                    region[key] = {**region[key], "file": shape.embedded()}
                    for done in ("scale", "offset"):  # what is embedded is in its place, in metres
                        region[key].pop(done, None)
        text, codes = written(table, self._resolved.picture, "cells")
        return text, {} if codes is None else {"cells": codes}

    @classmethod
    def from_archive(cls, text: str, arrays: Mapping[str, NDArray[Any]]) -> Scene:
        """Return the scene that `to_archive` took apart."""
        table = table_from(text)
        if (name := table["body"].get("array")) is not None:
            table["body"]["array"] = arrays[name]
        return cls(**table)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        ours, theirs = (
            [
                *(one.lattice, one.plane, one.thickness, one.cell_materials, one.body.gravity),
                *(one.body.regions, one.body.allow_floating),
                *map(one.side_condition, one.lattice.sides),
                *(one.loads, one.loading, one.rule, one.history),
            ]
            for one in (self, other)
        )
        return ours == theirs and np.array_equal(self._resolved.base, other._resolved.base)

    __hash__ = None  # type: ignore[assignment]
    __iter__ = None  # type: ignore[assignment]  # not iterable: Mesa's batch_run takes a scene as one value

    def __str__(self) -> str:
        cells = " x ".join(map(str, self.lattice.shape))
        materials = ", ".join(material.name for material in self.cell_materials)
        loads = f"{len(self.loads)} load{'s' if len(self.loads) != 1 else ''}"
        stages = f"{self.stages} stage{'s' if self.stages != 1 else ''}"
        return (
            f"{cells} {self.lattice.kind}s of {self.lattice.cell_size:g} m ({materials}), "
            f"{loads} in {stages}, {self.rule.kind} rule"
        )

    @cached_property
    def _resolved(self) -> ResolvedBody:
        return resolve(self.body, self.legend, self.materials, self.sides)

    @cached_property
    def selections(self) -> tuple[Selection, ...]:
        """The faces or cells on which each load acts, and how much of each it covers."""
        body = self._of_cells
        return tuple(
            select(body, load, f"loads.{number}") for number, load in enumerate(self.loads)
        )


def body_cells(scene: Scene, points: Floats) -> tuple[Ints, Flags]:
    """Return the body cell that each point (m) lies in or on, and whether there is one."""
    lattice = scene.lattice
    cells = lattice.locate(points)
    outside = scene.kinds(cells) < 0
    # A point on the surface belongs to the body, on whichever side rounding has put it.
    corners = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
    for shift in np.concatenate([lattice.normals, corners]):
        moved = lattice.locate(points[outside] + 1e-6 * lattice.cell_size * shift)
        inside = scene.kinds(moved) >= 0
        place = np.flatnonzero(outside)[inside]
        cells[place] = moved[inside]
        outside[place] = False
    return cells, ~outside


def _straight_sides(shape: Shape, plane: str | None, h: float) -> Iterator[tuple[int, float]]:
    """Yield the axis and place (m) of each straight side of a shape that lies across an axis."""
    if plane:
        ends = np.concatenate([arcs[..., :2] / arcs[..., 2:] for arcs in shape.outline()])
        for line, axis in np.argwhere(np.ptp(ends, axis=1) <= 1e-9 * h).tolist():
            yield axis, float(ends[line, 0, axis])
    elif isinstance(shape, ClosedSurface):
        yield from shape.flat_sides()
    elif isinstance(shape, Box):
        for end in shape.extent:
            yield from enumerate(np.asarray(end).tolist())


def _lies_in(shape: Shape, size: Floats) -> bool:
    """Tell whether the middle of a shape, or its ends, lie inside an array; boxes have neither."""
    own = np.array(getattr(shape, "ends", [getattr(shape, "centre", size)]))
    return bool(np.all((own > 0.0) & (own < size)))


def _meets_edge(shape: Shape, lattice: Lattice) -> bool:
    """Tell whether a shape whose middle, or ends, lie inside the array reaches its border."""
    size = np.array(lattice.extent)
    if not _lies_in(shape, size):
        return False
    flat = [flattened(arcs, 32) for arcs in shape.outline()] if len(size) == 2 else shape.extent
    reach = np.vstack(flat) / size
    return bool(reach.min() < 1e-9 or reach.max() > 1.0 - 1e-9)


def _refined_body(scene: Scene, picture: Picture | None, k: int) -> Body:
    """Return a body with k cells along each edge of a former cell, regions asked anew."""
    body, lattice = scene.body, scene.lattice
    if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or k < 1:
        raise ParameterError(f"k: must be a whole number, 1 or more, got {k!r}")
    check_boxes(lattice, "can be split into smaller ones")
    given = dict(body)
    if body.size is None:
        given["cell_size"] = lattice.cell_size / k
    if picture is None:
        given["cells"] = tuple(k * count for count in lattice.shape)
        return Body(**given)
    check_size(tuple(k * count for count in lattice.shape), "body")
    codes = np.kron(picture.codes, np.ones((k,) * picture.codes.ndim, dtype=np.int16))
    unpictured = {"drawing": None, "image": None, "nearest_colour": False}
    return Body(**given | unpictured | {"array": codes})


def _refined_loads(
    scene: Scene, fine_kinds: Callable[[Cells], Ints], k: int
) -> Iterator[LoadTable]:
    """Yield loads of the same force on the same places of the finer lattice.

    Points, regions and sides are places in metres and stay. A load on a face of a cell is
    spread over the smaller cells along that face, a load in a cell's middle over all of
    the cell.
    """
    lattice = scene.lattice
    for load, chosen in zip(scene.loads, scene.selections, strict=True):
        if load.cell is None:
            yield load
            continue
        given = dict(load) | {"cell": None, "side": None}
        direction = int(chosen.direction[0])
        lower, upper = ([(i + end) * lattice.cell_size for i in load.cell] for end in (0, 1))
        along = [range(k * index, k * index + k) for index in load.cell]
        axis, upper_end = divmod(max(direction, 0), 2)
        along[axis] = along[axis][-1:] if upper_end else along[axis][:1]
        children = np.array(list(product(*along)), dtype=np.int64)  # the smaller cells on the face
        body = children[fine_kinds(children) >= 0]
        if direction >= 0 and len(body):
            beyond = fine_kinds(lattice.neighbours(children, direction))
            held = np.isin(beyond, (cell_types.RIGID, cell_types.DISPLACED))
            if len(body) < len(children) or np.any((beyond >= 0) | held):
                force = None if load.force is None else tuple(f / len(body) for f in load.force)
                given |= {"side": lattice.sides[direction], "force": force}
                for child in body.tolist():
                    yield LoadTable(**given | {"cell": tuple(child)})
                continue
            lower[axis] = upper[axis] = (upper if upper_end else lower)[axis]
        yield LoadTable(**given | {"region": {"box": (lower, upper)}})


def scene_needed(given: object) -> None:
    """Refuse what is no scene, such as the name of a file."""
    if not isinstance(given, Scene):
        raise ParameterError(
            f"scene: a Scene is needed, got {brief(given)}; kaju.load_scene reads one from a file"
        )


def load_scene(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene that a file describes.

    Parameters
    ----------
    path : str or path
        A TOML file. Images and arrays that it names are looked for beside it.
    overrides : mapping of str to value, optional
        Values that replace the file's, by key path: ``{"loads.0.steps": "1"}``.

    Raises
    ------
    SceneFileError
        If the file, or one that it names, cannot be read.
    SceneError
        If the scene breaks a rule; the message starts with the file's name.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml", {"loads.0.force.1": -3.0})  # of `kaju new plate.toml`
    >>> scene.loads[0].force
    (0.0, -3.0)
    """
    hint = "; a scene is a TOML file (images: Scene.from_image, arrays: Scene.from_array)"
    text = text_of_file(path, SceneFileError, LONGEST, hint=hint)
    path, changes = Path(path), {key_path(key): value for key, value in (overrides or {}).items()}
    with named(path, text, changes):
        table = with_shared(table_from(text), path.parent)
        return Scene(**located(overridden(table, changes), path.parent))


@contextmanager
def named(path: str | Path, text: str, changed: Container[str] = ()) -> Iterator[None]:
    """Let errors of a scene begin with its file, and the line of the key that they name."""
    try:
        yield
    except SceneError as error:
        raise type(error)(f"{path}: {with_lines(text, str(error), changed)}") from None


# Scenes as tables and as TOML: read, changed by key paths, and written.


def table_from(text: str, folder: str | Path | None = None) -> dict[str, Any]:
    """Return the table in a TOML text; paths in it start from `folder`."""
    if not isinstance(text, str) or text.endswith(".toml"):
        raise ParameterError(
            f"text: the TOML of a scene is needed, got {brief(text)}; kaju.load_scene reads a file"
        )
    if len(text) > LONGEST:
        raise SceneError(
            f"is not a scene: {len(text)} characters are more than {LONGEST:.0e}; "
            "describe a large body by an image or an array"
        )
    table = read_toml(text)
    return table if folder is None else located(table, Path(folder))


def located(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table with the paths in it starting from `folder`."""
    moved = {key: _moved(part, folder) for key, part in table.items() if key != "materials"}
    return with_shared({**table, **moved}, folder)


def _moved(part: Any, folder: Path) -> Any:
    if isinstance(part, list):
        return [_moved(item, folder) for item in part]
    if not isinstance(part, dict):
        return part
    moved = {}
    for key, value in part.items():
        is_path = key in ("image", "array", "file", "surface") and isinstance(value, str)
        is_path = is_path and not value.startswith("data:")  # embedded (RFC 2397)
        moved[key] = str(folder / value) if is_path else _moved(value, folder)
    return moved


def overridden(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a new scene's table with values replaced by key path, list items by their index.

    A text is read as TOML writes values, else it stays a text. A new ``rule.kind`` starts a new
    rule.
    """
    for path in changes:
        if "." not in path:
            _check_first(path)
    result: Any = plain(table)
    kind = changes.get("rule.kind")
    if kind is not None and kind != result.get("rule", {}).get("kind", "prescribed"):
        result["rule"] = {}
    for path, value in changes.items():
        keys = path.split(".")
        if not all(keys):
            raise SceneError(f"{path!r}: is not a key path such as loads.0.steps")
        place = result
        for depth in range(1, len(keys)):
            key = _key_in(place, keys[:depth])
            place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]
        place[_key_in(place, keys)] = _parsed(value)
    return dict(result)


def _check_first(key: str) -> None:
    """Say where a key belongs that stands alone but is no part of a scene."""
    homes = {
        "rule.": {key for table in description.TABLES.values() for key in table.model_fields},
        "body.": set(Body.model_fields),
        "loads.0.": set(LoadTable.model_fields),
    }
    whole = {key: home + key for home, keys in homes.items() for key in keys}
    near = get_close_matches(key, list(whole), n=1, cutoff=0.7)
    if near and key not in Description.model_fields:
        raise SceneError(f"{key}: unknown key; did you mean {whole[near[0]]}?")


def _key_in(place: Any, path: list[str]) -> str | int:
    """Return the last part of a key path as a key of the table, or index of the list, `place`."""
    key, whole, parent = path[-1], ".".join(path), ".".join(path[:-1])
    if isinstance(place, dict):
        return key
    if not isinstance(place, list):
        raise SceneError(f"{whole}: {parent} is {place!r}, which has no parts of its own")
    if not key.isdecimal() or int(key) >= len(place):
        have = f"0 to {len(place) - 1}" if place else "none"
        raise SceneError(
            f"{whole}: {parent} is a list; its items are {have}, there is no item {key!r}"
        )
    return int(key)


def _parsed(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        table = tomllib.loads(f"value = {value}")
    except ValueError:  # TOMLDecodeError, or too many digits
        return value
    return table["value"] if len(table) == 1 else value


def table_of(scene: Description) -> dict[str, Any]:
    """Return the table that describes a scene; an array stays an array in it."""
    body = scene.body.model_dump(mode="json", exclude_defaults=True, exclude={"array"})
    if scene.body.array is not None:
        body["array"] = scene.body.array
    if scene.body.regions:
        body["regions"] = [{"material": one["material"], **one} for one in body["regions"]]
    rule = {"kind": scene.rule.kind, **_entries(scene.rule)}
    if rule.get("sense") is False:
        del rule["sense"]  # the literal reading goes without saying
    table = {
        **({"loading": scene.loading} if scene.loading == "continue" else {}),
        "body": body,
        "legend": dict(scene.legend),
        "materials": {name: _entries(material) for name, material in scene.materials.items()},
        "sides": {name: side.to_value() for name, side in scene.sides.items()},
        "loads": [load.model_dump(mode="json", exclude_defaults=True) for load in scene.loads],
        "rule": rule,
        "history": _entries(scene.history) if scene.history else {},
    }
    return {key: part for key, part in table.items() if part}


def _entries(described: Any) -> dict[str, Any]:
    """Return a dataclass as a table, without its name and what is not given or endless."""
    entries = {}
    for field in fields(described):
        value = getattr(described, field.name)
        if is_dataclass(value):
            value = _entries(value)
        elif isinstance(value, Mapping):
            value = {key: _entries(part) for key, part in value.items()}
        if field.name != "name" and value is not None and value not in ("", {}, inf):
            entries[field.name] = list(value) if isinstance(value, tuple) else value
    return entries


def written(
    table: Mapping[str, Any], picture: Picture | None, array: str | None = None
) -> tuple[str, NDArray[np.int16] | None]:
    """Return a scene's table as TOML, and the cells that it names `array`: too many for a drawing.

    Without such a name an image stays the path that it is.
    """
    body, codes = table["body"], None
    if picture is not None and "drawing" not in body and (picture.drawable or array):
        if picture.drawable:
            drawing, legend = picture.drawing()
            made: dict[str, str | None] = {"drawing": drawing}
        else:
            made, codes = {"array": array}, picture.codes
            legend = {str(code): name for code, name in enumerate(picture.names)}
        given = {k: v for k, v in body.items() if k not in ("image", "array", "nearest_colour")}
        given |= made
        body = {name: given[name] for name in Body.model_fields if name in given}
        table = {**table, "body": body, "legend": legend}
    if isinstance(body.get("array"), np.ndarray):
        raise SceneError(
            "body.array: is too large, or has too many axes, to be written as a drawing; "
            "scene.save writes it beside the scene's file"
        )
    blocks = (block for name, part in table.items() for block in _blocks(_key(name), part))
    return "\n".join(blocks), codes


def _blocks(name: str, part: Any) -> Iterator[str]:
    """Yield a section and the sections inside it, or the line of a plain value."""
    if isinstance(part, str):
        yield f"{name} = {_value(part)}\n"
        return
    if isinstance(part, list):
        for item in part:
            yield "\n".join([f"[[{name}]]", *_entries_of(item), ""])
        return
    if own := {key: value for key, value in part.items() if not _is_section(name, value)}:
        yield "\n".join([f"[{name}]", *_entries_of(own), ""])
    for key, value in part.items():
        if key not in own:
            yield from _blocks(f"{name}.{_key(key)}", value)


def _is_section(name: str, value: Any) -> bool:
    if isinstance(value, Mapping):
        return name.split(".")[-1] in ("materials", "rule")  # in others a table gets a line
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _entries_of(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(_entries_of(value))}}}"
    import tomli_w

    written = tomli_w.dumps({"value": value}, multiline_strings=True)
    return written.removeprefix("value = ").removesuffix("\n")
