"""Loads as they are described: where they press, how much, in how many steps."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from kaju.errors import ParameterError, SceneError

from .described import Coordinate, Count, Described, Index, Number, Text

MOST_STEPS = 100_000


class LoadRegion(Described):
    """A box that selects what a load acts on.

    Parameters
    ----------
    box : tuple of two points
        Lower and upper corner (m). Without thickness along one axis it selects the surface
        of the body on that plane, otherwise the cells inside.
    """

    box: tuple[tuple[Coordinate, ...], tuple[Coordinate, ...]] = Field(
        description="the lower and the upper corner (m), such as [[0.0, 0.2], [0.1, 0.2]]"
    )

    def flat_axis(self, cell_size: float, where: str) -> int | None:
        """Return the axis along which the box has no thickness, None if it has volume.

        Raises
        ------
        SceneError
            If a corner is on the wrong side, or the box is thin along several axes.
        """
        spans = [high - low for low, high in zip(*self.box, strict=True)]
        if min(spans) < 0.0:
            raise SceneError(
                f"{where}: goes from {list(self.box[0])} to {list(self.box[1])}; the first "
                "corner must be the lower one along every axis"
            )
        flat = [axis for axis, span in enumerate(spans) if span <= 1e-6 * cell_size]
        if len(flat) > 1:
            raise SceneError(
                f"{where}: has no thickness along {' and '.join('xyz'[axis] for axis in flat)}; "
                "a surface has none along one axis only; for a point use point = [...]"
            )
        return flat[0] if flat else None


class Load(Described):
    """A force or a pressure, and where it acts.

    Exactly one place: `cell`, `point` or `region`, or `side` alone. Exactly one of `force`
    and `pressure`.

    Parameters
    ----------
    cell : tuple of int, optional
        The cell pressed on, counted from 0 at left and bottom (and front).
    point : tuple of float, optional
        A point in or on the body (m). Between cells, these share the force.
    region : LoadRegion, optional
        A box of surface or of cells.
    side : str, optional
        With `cell` or `point`: the side of the cell by which the force enters; unless given
        it is the one that faces the force most. Alone: every face of the body on that side
        of the array.
    force : tuple of float, optional
        Total force (N), spread evenly.
    pressure : float, optional
        Pressure (Pa) against the outward normal of each face.
    steps : int
        The load is applied in this many equal steps.
    sense : {"push", "pull"}, optional
        For a prescribed rule with `sense`; unless given a force pulls where it points out of
        the body over its own side.
    """

    cell: tuple[Index, ...] | None = Field(
        default=None, description="a cell, such as [10, 19], counted from 0 at left and bottom"
    )
    point: tuple[Coordinate, ...] | None = Field(
        default=None, description="a point (m), such as [0.1, 0.2]"
    )
    region: LoadRegion | None = None
    side: Text | None = Field(default=None, description="a side's name, such as 'top'")
    force: tuple[Number, ...] | None = Field(
        default=None, description="the total force (N), such as [0.0, -2.0]"
    )
    pressure: Number | None = Field(
        default=None, description="a pressure against the surface (Pa), such as 1e5"
    )
    steps: Count = Field(
        default=1, le=MOST_STEPS, description="the number of equal steps of loading"
    )
    sense: Literal["push", "pull"] | None = Field(
        default=None, description="whether the force travels along ('push') or against itself"
    )

    @model_validator(mode="after")
    def _one_place_one_load(self) -> Load:
        places = [name for name in ("cell", "point", "region") if getattr(self, name) is not None]
        if len(places) > 1 or not (places or self.side):
            raise ParameterError(
                "cell: a load acts in one place: give either cell, point, region, or side alone"
            )
        if self.region is not None and self.side is not None:
            raise ParameterError("side: a region selects its own faces; leave side out")
        if (self.force is None) == (self.pressure is None):
            raise ParameterError("force: give either force (N) or pressure (Pa), and not both")
        if self.force is not None and not any(self.force):
            raise ParameterError("force: is zero along every axis; leave the load out")
        if self.pressure == 0.0:
            raise ParameterError("pressure: is zero; leave the load out")
        return self
