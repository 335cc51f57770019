"""The scene: one description of body, supports, loads and rule that every model takes."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainValidator, field_validator, model_validator

from kaju.agents.materials import LIBRARY, Material, suggestion
from kaju.agents.rules import PrescribedRule
from kaju.errors import SceneError, SceneFileError

from . import kinds
from .body import Body
from .described import Described, Text
from .filling import Filling
from .lattice import Cells, Lattice
from .loads import Load
from .material_tables import material_from
from .pictures import Picture, from_drawing
from .rule_tables import Rule, rule_from
from .selection import AppliedLoads, Selection, select
from .sides import FREE, SideCondition


class Scene(Described):
    """A body, how it is held, how it is loaded, and the rule by which agents pass load on.

    Parameters
    ----------
    body : Body
        The cells and what fills them.
    legend : dict of str to str
        What the letters, colours or codes of a drawn body stand for: a material's name,
        "air" or "rigid".
    materials : dict of str to Material
        Materials by name; names of the library need no entry.
    sides : dict of str to SideCondition
        How the sides of the array are held; free unless given.
    loads : tuple of Load
        What presses on the body.
    rule : PrescribedRule
        How agents pass load on.

    Raises
    ------
    SceneError
        If the description breaks a rule; the message names key, rule, value and remedy.
    """

    body: Body
    legend: dict[Text, Text] = Field(default_factory=dict)
    materials: dict[Text, Annotated[Material, PlainValidator(material_from)]] = Field(
        default_factory=dict
    )
    sides: dict[Text, SideCondition] = Field(default_factory=dict)
    loads: tuple[Load, ...] = ()
    rule: Annotated[Rule, PlainValidator(rule_from)] = PrescribedRule()

    @field_validator("materials", mode="after")
    @classmethod
    def _named_by_their_keys(cls, materials: dict[str, Material]) -> dict[str, Material]:
        return {name: replace(material, name=name) for name, material in materials.items()}

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        _ = self._selections
        return self

    @classmethod
    def from_toml(cls, text: str) -> Scene:
        """Return the scene that a TOML text describes."""
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise SceneError(f"not valid TOML: {error}") from None
        return cls(**table)

    @property
    def lattice(self) -> Lattice:
        """The grid of cells."""
        return self._filling.lattice

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

    @cached_property
    def cell_materials(self) -> tuple[Material, ...]:
        """The materials of the body; kinds from 0 upwards are indices into them."""
        return tuple(self._material(name) for name in self._names if name not in _NOT_BODY)

    def side_condition(self, name: str) -> SideCondition:
        """Return how a side of the array is held."""
        if name not in self.lattice.sides:
            raise SceneError(
                f"sides.{name}: there is no such side{suggestion(name, self.lattice.sides)}; "
                f"there is {', '.join(self.lattice.sides)}"
            )
        return self.sides.get(name, FREE)

    def kinds(self, cells: Cells) -> NDArray[np.int64]:
        """Return what each cell is, also outside the array, where the sides decide.

        Parameters
        ----------
        cells : ndarray of int, shape (n, dimension)
            Cell coordinates.

        Returns
        -------
        ndarray of int, shape (n,)
            Indices into `cell_materials`, or the negative constants of
            `kaju.model.scene.kinds`.
        """
        return self._filling.kinds(np.asarray(cells, dtype=np.int64))

    def bounds(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return a box outside of which there is no body: lower <= cell < upper."""
        return self._filling.bounds()

    def rasterise(self) -> NDArray[np.int64]:
        """Return the kinds of all cells, shape `lattice.shape`.

        Raises
        ------
        SceneError
            If there are more than 2e8 cells.
        """
        return self._filling.rasterise()

    def applied(self, stage: int | None = None) -> AppliedLoads:
        """Return the forces on the cells at a stage of loading, 1 to `stages`; None: the last."""
        stage = self.stages if stage is None else stage
        if not 1 <= stage <= self.stages:
            raise SceneError(f"stage: must lie between 1 and {self.stages}, got {stage}")
        dimension = self.lattice.dimension
        cells = [np.empty((0, dimension), dtype=np.int64)]
        direction = [np.empty(0, dtype=np.int64)]
        force = [np.empty((0, dimension))]
        for chosen, load in zip(self._selections, self.loads, strict=True):
            factor = min(1.0, stage / load.steps)
            cells.append(chosen.cells)
            direction.append(chosen.direction)
            force.append(factor * chosen.forces(load, self.lattice, self.thickness))
        return AppliedLoads(np.concatenate(cells), np.concatenate(direction), np.concatenate(force))

    @cached_property
    def _picture(self) -> Picture | None:
        return from_drawing(self.body.drawing, self.legend) if self.body.drawing else None

    @property
    def _names(self) -> tuple[str, ...]:
        if self._picture is not None:
            return self._picture.names
        assert self.body.material is not None
        return (self.body.material,)

    def _material(self, name: str) -> Material:
        if name in self.materials:
            return self.materials[name]
        if name in LIBRARY:
            return LIBRARY[name]
        known = [*self.materials, *LIBRARY, *_NOT_BODY]
        raise SceneError(
            f"materials: there is no {name!r}{suggestion(name, known)}; describe it under "
            f"[materials.{name}] or use {', '.join(known)}"
        )

    @cached_property
    def _filling(self) -> Filling:
        names = [material.name for material in self.cell_materials]
        kind_of = {**{name: index for index, name in enumerate(names)}, **_NOT_BODY}
        base: int | NDArray[np.integer]
        if self._picture is None:
            assert self.body.cells is not None
            assert self.body.material is not None
            shape = self.body.cells
            base = kind_of[self.body.material]
        else:
            codes = np.array([kind_of[name] for name in self._picture.names], dtype=np.int16)
            base = codes[self._picture.codes]
            shape = base.shape
        lattice = self.body.lattice_of(shape)
        beyond = [self.sides.get(side, FREE).code for side in lattice.sides]
        return Filling(lattice, base, np.array(beyond, dtype=np.int64))

    @cached_property
    def _selections(self) -> tuple[Selection, ...]:
        return tuple(
            select(self._filling, load, f"loads.{number}") for number, load in enumerate(self.loads)
        )


_NOT_BODY = {"air": kinds.AIR, "rigid": kinds.RIGID}


def load_scene(path: str | Path) -> Scene:
    """Return the scene that a file describes."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise SceneFileError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return Scene.from_toml(text)
    except SceneError as error:
        raise type(error)(f"{path}: {error}") from None
