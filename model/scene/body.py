"""The body as it is described: its cells, and what fills them."""

from __future__ import annotations

from math import isclose
from typing import Literal

from pydantic import Field, model_validator

from kaju.errors import ParameterError, SceneError

from .described import Count, Described, Flag, Number, Positive, Text
from .lattice import Lattice


class Body(Described):
    """The cells of a body and what fills them.

    Parameters
    ----------
    size : tuple of float, optional
        Edges of the array of cells (m); with `cells` or a picture.
    cells : tuple of int, optional
        Number of cells along x, y (and z). Three numbers make cubes.
    cell_size : float, optional
        Distance of two opposite faces of a cell (m); instead of `size`.
    drawing : str, optional
        The body as text, one letter a cell, the top row first; the scene's legend says
        what the letters mean.
    thickness : float, optional
        Of a two-dimensional body, across the plane (m); 1 m unless given.
    plane : {"stress", "strain"}, optional
        Two-dimensional state; "stress" unless given.
    lattice : {"square", "hexagon", "cube"}, optional
        Form of the cells.
    material : str, optional
        What fills the array, under the regions: a material's name, "air" or "rigid".
    gravity : tuple of float, optional
        Acceleration (m/s²) that pulls every cell.
    allow_floating : bool
        Take a body that nothing holds.
    """

    size: tuple[Positive, ...] | None = Field(
        default=None, description="the edges of the body (m), such as [0.2, 0.1]"
    )
    cells: tuple[Count, ...] | None = Field(
        default=None, description="the number of cells along each axis, such as [20, 10]"
    )
    cell_size: Positive | None = Field(
        default=None, description="the edge of a cell (m), such as 0.01"
    )
    drawing: Text | None = Field(default=None, description="the body, one letter a cell")
    thickness: Positive | None = Field(
        default=None, description="the body's thickness across the plane (m)"
    )
    plane: Literal["stress", "strain"] | None = None
    lattice: Literal["square", "hexagon", "cube"] | None = None
    material: Text | None = Field(default=None, description="the name of what fills the body")
    gravity: tuple[Number, ...] | None = Field(
        default=None, description="an acceleration (m/s²), such as [0.0, -9.81]"
    )
    allow_floating: Flag = False

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> Body:
        pictures = [name for name in ("drawing",) if getattr(self, name) is not None]
        if pictures and self.cells is not None:
            raise ParameterError("cells: the drawing has its own number of cells; leave it out")
        if pictures and self.material is not None:
            raise ParameterError(
                "material: in a drawn body the legend says what is where; leave it out"
            )
        if not pictures and self.cells is None:
            raise ParameterError("cells: is needed, such as [20, 10], or a drawing")
        if not pictures and self.material is None:
            raise ParameterError('material: is needed, such as "steel"')
        if (self.size is None) == (self.cell_size is None):
            raise ParameterError("size: give either size or cell_size (m), and not both")
        return self

    def lattice_of(self, shape: tuple[int, ...]) -> Lattice:
        """Return the lattice of that many cells.

        Raises
        ------
        SceneError
            If the cells would not be of one size, or the keys contradict each other.
        """
        if len(shape) not in (2, 3):
            raise SceneError(f"body.cells: two or three numbers are needed, got {list(shape)}")
        kind = self.lattice or ("cube" if len(shape) == 3 else "square")
        if (kind == "cube") != (len(shape) == 3):
            raise SceneError(
                f"body.lattice: {kind!r} has {3 if kind == 'cube' else 2} axes, but "
                f"body.cells names {len(shape)}"
            )
        if len(shape) == 3 and (self.thickness is not None or self.plane is not None):
            raise SceneError("body.thickness, body.plane: belong to two dimensions; leave them out")
        return Lattice(kind, shape, self.cell_size or self._edge(kind, shape))

    def _edge(self, kind: str, shape: tuple[int, ...]) -> float:
        size = self.size
        assert size is not None
        if kind == "hexagon":
            raise SceneError(
                "body.size: rows of hexagons overlap; give cell_size, the distance of two faces"
            )
        if len(size) != len(shape):
            raise SceneError(
                f"body.size: {len(size)} edges are given for {len(shape)} axes of cells"
            )
        edges = [length / count for length, count in zip(size, shape, strict=True)]
        if not all(isclose(edge, edges[0], rel_tol=1e-9) for edge in edges):
            raise SceneError(
                f"body.size: cells must be as high as wide, but {list(size)} m over "
                f"{list(shape)} cells makes cells of {' x '.join(f'{e:.6g}' for e in edges)} m; "
                "change size or cells"
            )
        return edges[0]
