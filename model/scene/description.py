"""The parts of a scene, as files and Python give them; files of materials that scenes share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from inspect import signature
from math import isclose
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pydantic
from pydantic import Field, PlainValidator, field_validator, model_validator

from kaju.agents.elastic_rule import ElasticRule
from kaju.agents.materials import Material, material, meant_material
from kaju.agents.rules import Coefficients, PrescribedRule
from kaju.errors import ParameterError, SceneError, SceneFileError, no_such, require, suggestion
from kaju.files import text_of_file
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.load_history import History

from . import cell_types
from .cell_types import NOT_BODY
from .lattice import BUILT_IN, Lattice, check_lattice, lattice_given
from .regions import LoadRegion, Region
from .validation import (
    Coordinate,
    Count,
    Described,
    Flag,
    Index,
    Length,
    Number,
    Positive,
    Text,
    built_by,
    check_axes,
    one_given,
    optional,
    read_toml,
    with_lines,
)

LONGEST = 100_000_000
"""Bytes of a scene's text; larger bodies come from images and arrays."""


Codes = Annotated[
    str | np.ndarray,
    PlainValidator(lambda value: value if isinstance(value, str) else np.asarray(value)),
]
"""Whole numbers, one a cell, or the path of the file that holds them."""
LatticeName = Annotated[
    str | type[Lattice] | None,
    PlainValidator(lambda value: None if value is None else lattice_given(value)),
    pydantic.PlainSerializer(lambda value: getattr(value, "kind", value)),
]
"""What a file calls a lattice, or the class of your own."""


class Body(Described):
    """The cells of a body and what fills them."""

    size: tuple[Length, ...] | None = optional("the edges of the body (m), such as [0.2, 0.1]")
    cells: tuple[Count, ...] | None = optional(
        "the number of cells along each axis, such as [20, 10]"
    )
    cell_size: Length | None = optional("the edge of a cell (m), such as 0.01")  # or size
    # The scene's legend says what letters, colours and codes mean. A drawing's top row comes first;
    # arrays are indexed [x, y] or [x, y, z] from left, front and bottom.
    drawing: Text | None = optional("the body, one letter a cell")
    image: Text | None = optional("the path of an image, such as 'body.png'")
    array: Codes | None = optional("the path of an .npy file, or an array")
    thickness: Length | None = optional("the body's thickness across the plane (m)")
    plane: Literal["stress", "strain"] | None = None  # "stress" unless given
    lattice: LatticeName = None
    material: Text | None = optional("the name of what fills the body")
    gravity: tuple[Number, ...] | None = optional("an acceleration (m/s²), such as [0.0, -9.81]")
    regions: tuple[Region, ...] = ()  # later ones cover earlier ones
    allow_floating: Flag = False  # whether a body may be held by nothing
    nearest_colour: Flag = False  # whether pixels take the nearest colour of the legend

    @property
    def picture_key(self) -> str | None:
        """Which of drawing, image and array gives the body cell by cell, if any does."""
        pictures = ("drawing", "image", "array")
        return next((key for key in pictures if getattr(self, key) is not None), None)

    @property
    def outlined(self) -> bool:
        """Whether a region has a true outline."""
        return any(region.outline == "true" for region in self.regions)

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> Body:
        given = self.picture_key
        if given and any(getattr(self, key) is not None for key in {"image", "array"} - {given}):
            raise ParameterError(f"{given}: gives the body, and so does another; leave one out")
        if given and self.cells is not None:
            raise ParameterError(f"cells: the {given} has its own; leave them out")
        if given and self.material is not None:
            raise ParameterError(f"material: the legend says it of the {given}; leave it out")
        if not given and self.cells is None:
            raise ParameterError("cells: is needed, such as [20, 10], or drawing, image or array")
        if not given and self.material is None:
            raise ParameterError('material: is needed, such as "steel"')
        if self.nearest_colour and self.image is None:
            raise ParameterError("nearest_colour: belongs to an image; leave it out")
        if (self.size is None) == (self.cell_size is None):
            raise ParameterError("size: give either size or cell_size (m), and not both")
        return self

    def lattice_of(self, shape: tuple[int, ...]) -> Lattice:
        """Return the lattice of that many cells."""
        if len(shape) not in (2, 3):
            raise SceneError(f"body.cells: two or three numbers are needed, got {list(shape)}")
        lattice = self.lattice or ("cube" if len(shape) == 3 else "square")
        if isinstance(lattice, str):
            lattice = BUILT_IN[lattice]
        for key in ("thickness", "plane"):
            if len(shape) == 3 and getattr(self, key) is not None:
                raise SceneError(f"body.{key}: belongs to two dimensions; leave it out")
        edge = self.cell_size or self._edge(lattice, shape)
        if not 1e-12 <= edge <= 1e12:
            raise SceneError(f"body.size: cells would be {edge:g} m wide; lengths are in metres")
        try:
            made = lattice(shape, edge)
        except ParameterError as error:
            told = str(error).removeprefix("shape: ")
            raise SceneError(f"body.cells: {told}") from None
        if lattice.kind not in BUILT_IN:
            check_lattice(made)
        return made

    def _edge(self, lattice: type[Lattice], shape: tuple[int, ...]) -> float:
        size = self.size
        assert size is not None
        if not lattice.boxes:
            raise SceneError(
                f"body.size: rows of {lattice.kind}s overlap; give cell_size, the length of a cell "
                "along its axes, such as the distance of two faces of a hexagon"
            )
        check_axes(size, len(shape), "body.size", "edges")
        edges = [length / count for length, count in zip(size, shape, strict=True)]
        if not all(isclose(edge, edges[0], rel_tol=1e-9) for edge in edges):
            raise SceneError(
                f"body.size: cells must be as high as wide, but {list(size)} m over "
                f"{list(shape)} cells makes cells of {' x '.join(f'{e:.6g}' for e in edges)} m; "
                "change size or cells"
            )
        return edges[0]


_WORDS = ("free", "rigid", "roller")
HELD_AS = dict.fromkeys(("fixed", "clamped", "pinned", "encastre", "ground", "built-in"), "rigid")
HELD_AS |= dict.fromkeys(("pin", "hinge", "bolt"), "pinned")
HELD_AS |= dict.fromkeys(("symmetry", "symmetric", "slider", "sliding"), "roller")
"""What others call them."""
_FORMS = 'a side is "free", "rigid", "roller", {stiffness = N/m³} or {displacement = [m, m]}'


class SideCondition(Described):
    """How one side of the array is held.

    In a scene it is written as a word, "free", "rigid" or "roller", or as a table,
    ``{stiffness = 1e9}`` or ``{displacement = [0.0, -1e-4]}``.
    """

    word: Literal["free", "rigid", "roller"] = "free"
    stiffness: Positive | None = optional("the pressure per displacement of an elastic bed (N/m³)")
    displacement: tuple[Number, ...] | None = optional(
        "what the side is moved by (m), one number per axis"
    )
    free_axes: tuple[Index, ...] = ()
    """Axes along which a moved side lets the body slide, as a roller does: all of the side's own. A
    scene writes "free" in place of their numbers, ``{displacement = ["free", -1e-4]}``."""

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, value: Any) -> Any:
        if isinstance(value, str):
            if value not in _WORDS:
                meant = suggestion(HELD_AS.get(value, value), _WORDS)
                raise ValueError(f"there is no {value!r}{meant}; {_FORMS}")
            return {"word": value}
        if isinstance(value, SideCondition):
            return value
        if not isinstance(value, Mapping):
            raise ValueError(f"must be a word or a table, got {value!r}; {_FORMS}")
        moved = value.get("displacement")
        if isinstance(moved, (list, tuple)) and "free" in moved:
            free = [axis for axis, number in enumerate(moved) if number == "free"]
            numbers = [0.0 if number == "free" else number for number in moved]
            return {**value, "displacement": numbers, "free_axes": free}
        return value

    @model_validator(mode="after")
    def _one_form(self) -> SideCondition:
        if len({"word", "stiffness", "displacement"} & self.model_fields_set) > 1:
            raise ValueError(f"takes one form; {_FORMS}")
        return self

    @property
    def kind(self) -> str:
        """What lies beyond: "free", "rigid", "roller", "foundation" or "displaced"."""
        if self.stiffness is not None:
            return "foundation"
        return self.word if self.displacement is None else "displaced"

    @property
    def code(self) -> int:
        """The kind of the cells beyond this side, from `kaju.model.scene.cell_types`."""
        if self.free_axes:
            return cell_types.ROLLER
        return cell_types.AIR if self.kind == "free" else getattr(cell_types, self.kind.upper())

    def to_value(self) -> Any:
        """Return the short form that scenes are written in."""
        if self.stiffness is not None:
            return {"stiffness": self.stiffness}
        if self.displacement is not None:
            moved: list[float | str] = list(self.displacement)
            for axis in self.free_axes:
                moved[axis] = "free"
            return {"displacement": moved}
        return self.kind


FREE = SideCondition()


def check_side(name: str, sides: tuple[str, ...], where: str) -> None:
    """Refuse a side that the array does not have."""
    if name not in sides:
        raise SceneError(f"{where}: {no_such(f'side {name!r}', name, sides)}")


class Table(Described):
    """A table of what a dataclass is made of."""

    made: ClassVar[type]

    def build(self) -> Any:
        """Return the object, which refuses what is out of its range."""
        given = {name: getattr(self, name) for name in type(self).model_fields if name != "kind"}
        return self.made(**given)


def _table(made: type, **told: tuple[Any, Any]) -> type[Table]:
    """Return the table of a dataclass: strict types of its fields, and meanings; its defaults."""
    entries: dict[str, Any] = {}
    for name, (kind, meaning) in told.items():
        given = Field(default=getattr(made, name, ...), description=meaning)
        entries[name] = kind, given if isinstance(meaning, str) else meaning
    found = pydantic.create_model(f"{made.__name__}Table", __base__=Table, **entries)
    found.made = made
    return found


_RHEOLOGY = built_by(
    _table(
        ThreeElement,
        K_f=(Number, "stiffness of the spring (Pa)"),
        D_f=(Number, "damper beside the spring (Pa s)"),
        D_d=(Number, "damper in series (Pa s); left out: none"),
    ),
    ThreeElement,
    "a table of K_f, D_f and D_d",
)


class MaterialTable(Described):
    """``[materials.NAME]``: numbers as in `Material`, or a material of the library with some."""

    base: Text | None = optional("the name of a material of the library")
    youngs_modulus: Number | None = optional("E (Pa)")
    poissons_ratio: Number | None = optional("ν")
    density: Number | None = optional("mass per volume (kg/m³)")
    source: Text | None = optional("where the numbers come from")
    rheology: Annotated[ThreeElement, _RHEOLOGY] | None = optional("how it gives in time")

    def build(self) -> Material:
        """Return the material; whoever keeps it by name gives it that name."""
        given = {name: part for name, part in self if name != "base" and part is not None}
        if self.base is not None:
            return replace(material(self.base, "base"), **given)
        for key in ("youngs_modulus", "poissons_ratio"):
            require(key in given, f"{key}: is needed, or a base from the library")
        return Material(name="", **given)


_MATERIAL_FORMS = "a table of youngs_modulus, poissons_ratio, ... or a Material"
MaterialEntry = Annotated[Material, built_by(MaterialTable, Material, _MATERIAL_FORMS)]


def with_shared(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scene's table in which tables stand for the file of materials that it names."""
    named = table.get("materials")
    if not isinstance(named, str):
        return table
    return table | {"materials": _read(folder / named)[0]}


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Material]]:
    """Return a file's tables, and the materials that they make."""
    text = text_of_file(path, SceneFileError, LONGEST, key="materials")
    try:
        table = read_toml(text)
    except SceneError as error:
        raise SceneError(f"materials: {path}: {error}") from None
    inside = "materials." if "materials" in table else ""
    tables = table.get("materials", table)
    if not (isinstance(tables, Mapping) and all(isinstance(t, Mapping) for t in tables.values())):
        raise SceneError(
            f"materials: {path} must hold a table for each material, such as [agar] with "
            "youngs_modulus = 30e3 and poissons_ratio = 0.49"
        )
    found = {}
    for name, entries in tables.items():
        try:
            found[name] = replace(MaterialTable(**entries).build(), name=name)
        except (SceneError, ParameterError) as error:
            message = with_lines(text, f"{inside}{name}.{error}")
            raise SceneError(f"materials: {path}: {message}") from None
    return dict(tables), found


class LoadTable(Described):
    """A force or a pressure, and where it acts.

    Exactly one place: `cell`, `point`, `region` or `outline`, or `side` alone. Exactly one of
    `force`, `pressure` and `couple`.
    """

    cell: tuple[Index, ...] | None = optional(
        "a cell, such as [10, 19], counted from 0 at left and bottom (and front)"
    )
    point: tuple[Coordinate, ...] | None = optional("a point (m), such as [0.1, 0.2]")
    # Cells that a point lies between share its force.
    region: LoadRegion | None = None
    outline: Text | None = optional("the name of a region with a true outline, such as 'bore'")
    # A pressure acts all along it, a force where the outline faces it, even across its direction.
    side: Text | None = optional("a side's name, such as 'top'")
    # With `cell` or `point`: the side of the cell by which the force enters; unless given it is the
    # one that faces the force most. Alone: every face of the body on that side of the array.
    force: tuple[Number, ...] | None = optional("the total force (N), such as [0.0, -2.0]")
    pressure: Number | None = optional("a pressure against the surface (Pa), such as 1e5")
    pressure_slope: tuple[Number, ...] | None = optional(
        "the growth of the pressure along each axis (Pa/m)"
    )
    # From `pressure` at the origin on; below 0 it pulls. Elasticity takes it as it is; agents that
    # pass loads on take that in the middle of each face.
    couple: Number | tuple[Number, ...] | None = optional(
        "a moment (N m): a number, in three dimensions three"
    )
    # Counter-clockwise in the plane, without any force: shares that turn round the middle of a side
    # or a region, the larger the farther from it.
    steps: Count = Field(default=1, le=100_000, description="the number of equal steps")
    sense: Literal["push", "pull"] | None = optional(
        "whether the force travels along ('push') or against itself"
    )
    # For a prescribed rule with `sense`; unless given a force pulls where it points out of the body
    # over its own side.

    @model_validator(mode="after")
    def _one_place_one_load(self) -> LoadTable:
        places = [k for k in ("cell", "point", "region", "outline") if getattr(self, k) is not None]
        told = "cell: a load acts in one place: give cell, point, region, outline, or side alone"
        require(len(places) == 1 or (not places and self.side is not None), told)
        told = "side: a region selects its own faces, and an outline all; leave side out"
        require(self.side is None or not {"region", "outline"} & {*places}, told)
        given = one_given(self, ("force", "pressure", "couple"), "force: a load has exactly one of")
        told = "pressure_slope: needs pressure, its value at the origin (Pa)"
        require(self.pressure_slope is None or given == "pressure", told)
        told = "couple: a single cell has no lever; let it act on a side or a region"
        require(given != "couple" or not {"cell", "point"} & {*places}, told)
        acts = np.any(getattr(self, given)) or any(self.pressure_slope or ())
        require(bool(acts), f"{given}: is zero; leave the load out")
        return self

    def check_in(self, lattice: Lattice, where: str) -> None:
        """Refuse numbers that are not those of a lattice's axes, and sides that it has not."""
        for key in ("force", "pressure_slope"):
            if getattr(self, key) is not None:
                check_axes(getattr(self, key), lattice.dimension, f"{where}.{key}")
        if self.couple is not None and np.size(self.couple) != 2 * lattice.dimension - 3:
            needed = "three numbers" if lattice.dimension == 3 else "one number"
            raise SceneError(f"{where}.couple: {needed} (N m) are needed, got {self.couple}")
        if self.side is not None:
            check_side(self.side, lattice.sides, f"{where}.side")


_STEPS = ("ramp", "hold", "release", "cycles")
"""The words for a step of a history: methods of `History`, whose first argument is its number."""


class HistoryTable(Described):
    """``[history]``: ``times`` and ``factors`` of its corners, or ``steps``."""

    times: tuple[Number, ...] | None = optional("the times of the corners (s), the first 0")
    factors: tuple[Number, ...] | None = optional("the factor at each corner")
    steps: tuple[dict[Text, Number], ...] | None = optional(
        "a list such as [{ramp = 1.0, duration = 0.2}, {hold = 5.0}]"
    )

    def build(self) -> History:
        """Return the history, which refuses what is out of its range."""
        corners = self.times is not None
        if corners != (self.factors is not None) or corners == (self.steps is not None):
            raise ParameterError("times: give either times and factors, or steps")
        if self.times is not None and self.factors is not None:
            return History(self.times, self.factors)
        history = History()
        for number, step in enumerate(self.steps or ()):
            history = _after(history, step, f"steps.{number}")
        return history


_BUILT_HISTORY = built_by(HistoryTable, History, "a table of times and factors, or of steps")


def _after(history: History, step: dict[str, Any], where: str) -> History:
    """Return a history that goes on with a step, such as ``{ramp = 1.0, duration = 0.2}``."""
    words = [word for word in _STEPS if word in step]
    if len(words) != 1:
        names, got = ", ".join(_STEPS), ", ".join(step)
        raise ParameterError(f"{where}.ramp: a step has one of {names}; got {got or 'none'}")
    word = words[0]
    keys = [*signature(getattr(history, word)).parameters][1:]
    wrong = [key for key in step if key not in (word, *keys)]
    wrong += [key for key in keys[:1] if key not in step]
    if wrong:
        takes = f"{word} takes {', '.join(keys) or 'no key'} beside its number"
        raise ParameterError(f"{where}.{wrong[0]}: {takes}")
    others = {key: number for key, number in step.items() if key != word}
    after: History = getattr(history, word)(step[word], **others)
    return after


Rule = PrescribedRule | ElasticRule


_SHARES: dict[str, tuple[Any, str]] = {
    "alpha": (tuple[Number, ...] | None, "the shares kept, passed ahead and passed beside"),
    "beta": (Number, "the free part of the Poisson expansion"),
}
_OWN = built_by(_table(Coefficients, **_SHARES), Coefficients, "a table of alpha and beta")
TABLES = {
    "prescribed": _table(
        PrescribedRule,
        **_SHARES,
        kind=(Literal["prescribed"], ""),
        threshold=(Number, "γ, below which loads end (N)"),
        accumulate=(Flag, ""),
        materials=(dict[Text, Annotated[Coefficients, _OWN]], Field(default={})),
        sense=(Flag, "whether loads push or pull"),
    ),
    "elastic": _table(
        ElasticRule,
        kind=(Literal["elastic"], ""),
        threshold=(Number | None, "γ, up to which loads rest (N); left out: from the tolerance"),
        order=(Text, "who acts when"),
        share=(Number | None, "the share by which all yield in a wave; left out: a stable one"),
        tolerance=(Number, "the error in energy aimed at, as a share"),
    ),
}
"""How each kind of rule is written. A new kind of rule is entered here."""


def _rule_from(value: Any) -> Any:
    """Return the rule that a table describes; a rule is returned as it is."""
    if isinstance(value, Rule):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"must be a table or a rule, got {value!r}")
    kind = value.get("kind", "prescribed")
    known = isinstance(kind, str) and kind in TABLES
    require(known, f"kind: {no_such(f'rule {kind!r}', kind, TABLES)}")
    return TABLES[kind].model_validate(value).build()


def check_rule(rule: Rule, materials: list[str]) -> None:
    """Refuse coefficients of materials that the scene does not have: they would do nothing."""
    for name in rule.materials if isinstance(rule, PrescribedRule) else ():
        if name not in materials:
            raise SceneError(
                f"rule.materials.{name}: the scene has no such material"
                f"{meant_material(name, materials)}; it has {', '.join(dict.fromkeys(materials))}"
            )


class Description(Described):
    """Body, legend, materials, sides, loads, rule and history: the keys of a scene's file."""

    body: Body
    legend: dict[Text, Text] = Field(default_factory=dict)
    materials: dict[Text, MaterialEntry] = Field(default_factory=dict)
    sides: dict[Text, SideCondition] = Field(default_factory=dict)
    loads: tuple[LoadTable, ...] = ()
    # With "continue" agents live on from one step of the loads to the next, which brings what is
    # added; otherwise every step begins with a body in which nobody is awake.
    loading: Literal["afresh", "continue"] = "afresh"
    rule: Annotated[Rule, PlainValidator(_rule_from)] = PrescribedRule()
    history: Annotated[History, _BUILT_HISTORY] | None = None

    @model_validator(mode="before")
    @classmethod
    def _regions_into_body(cls, values: Any) -> Any:
        if isinstance(values, Mapping) and "regions" in values:
            body = values.get("body")
            if not isinstance(body, Mapping) or "regions" in body:
                raise ParameterError("regions: are given twice; leave them out here, or in body")
            inner = {**body, "regions": values["regions"]}
            return {**{k: v for k, v in values.items() if k != "regions"}, "body": inner}
        return values

    @field_validator("materials", mode="before")
    @classmethod
    def _in_a_file(cls, materials: Any) -> Any:
        named = isinstance(materials, (str, Path))
        return _read(Path(materials))[1] if named else materials

    @field_validator("legend", mode="before")
    @classmethod
    def _codes_as_keys(cls, legend: Any) -> Any:
        if isinstance(legend, Mapping):
            return {str(k) if isinstance(k, int) else k: name for k, name in legend.items()}
        return legend

    @field_validator("materials", mode="after")
    @classmethod
    def _named_by_their_keys(cls, materials: dict[str, Material]) -> dict[str, Material]:
        told = "cannot name a material, because scenes use the word for cells that are not body"
        for name in NOT_BODY:
            require(name not in materials, f"{name}: {told}")
        return {name: replace(material, name=name) for name, material in materials.items()}
