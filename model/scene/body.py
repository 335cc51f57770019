"""The body as it is described: its cells, and what fills them."""

from __future__ import annotations

from inspect import isabstract
from math import isclose
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import PlainSerializer, PlainValidator, model_validator

from kaju.errors import ParameterError, SceneError
from kaju.model.scene.validation import (
    Count,
    Described,
    Flag,
    Length,
    Number,
    Text,
    check_axes,
    optional,
)

from .lattice import Lattice
from .lattices import BUILT_IN, check_lattice, lattice_named
from .regions import Region

_PICTURES = ("drawing", "image", "array")


def _codes(value: Any) -> Any:
    return value if isinstance(value, str) else np.asarray(value)


Codes = Annotated[str | np.ndarray, PlainValidator(_codes)]
"""Whole numbers, one a cell, or the path of the file that holds them."""


def _lattice(value: Any) -> Any:
    """Return the name of a lattice that kaju brings, or the class of your own."""
    if value is None or (isinstance(value, str) and value in BUILT_IN):
        return value
    if isinstance(value, str):
        return lattice_named(value)
    if not (isinstance(value, type) and issubclass(value, Lattice)):
        raise SceneError(
            f"must be {', '.join(map(repr, BUILT_IN))} or a subclass of kaju.Lattice, got {value!r}"
        )
    if BUILT_IN.get(value.kind) is value:
        return value.kind
    if isabstract(value):
        missing = ", ".join(sorted(value.__abstractmethods__))
        raise SceneError(f"{value.__name__} needs {missing}; see kaju.Lattice")
    if not value.kind or value.kind in BUILT_IN:
        raise SceneError(f"{value.__name__} needs a kind of its own, got {value.kind!r}")
    return value


LatticeName = Annotated[
    str | type[Lattice] | None,
    PlainValidator(_lattice),
    PlainSerializer(lambda value: value if value is None or isinstance(value, str) else value.kind),
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
        return next((key for key in _PICTURES if getattr(self, key) is not None), None)

    @property
    def outlined(self) -> bool:
        """Whether a region has a true outline."""
        return any(region.outline == "true" for region in self.regions)

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> Body:
        given = [key for key in _PICTURES if getattr(self, key) is not None]
        if len(given) > 1:
            raise ParameterError(f"{given[1]}: {given[0]} already gives the body; leave one out")
        if given and self.cells is not None:
            raise ParameterError(f"cells: the {given[0]} has its own; leave them out")
        if self.nearest_colour and self.image is None:
            raise ParameterError("nearest_colour: belongs to an image; leave it out")
        if given and self.material is not None:
            raise ParameterError(
                f"material: the legend already says what the {given[0]} is made of; leave "
                "material out"
            )
        if not given and self.cells is None:
            raise ParameterError("cells: is needed, such as [20, 10], or drawing, image or array")
        if not given and self.material is None:
            raise ParameterError('material: is needed, such as "steel"')
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
