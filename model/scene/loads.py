"""Loads as they are described: where they press, how much, in how many steps."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from kaju.errors import ParameterError
from kaju.model.scene.validation import (
    Coordinate,
    Count,
    Described,
    Index,
    Number,
    Text,
    optional,
)

from .regions import LoadRegion


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
        keys = ("cell", "point", "region", "outline")
        places = [name for name in keys if getattr(self, name) is not None]
        if len(places) > 1 or not (places or self.side):
            raise ParameterError(
                "cell: a load acts in one place: give either cell, point, region, "
                "outline, or side alone"
            )
        if self.region is not None and self.side is not None:
            raise ParameterError("side: a region selects its own faces; leave side out")
        if self.outline is not None and self.side is not None:
            raise ParameterError("side: an outline is loaded all along; leave side out")
        loads = ("force", "pressure", "couple")
        given = [name for name in loads if getattr(self, name) is not None]
        if self.pressure_slope is not None and given != ["pressure"]:
            raise ParameterError("pressure_slope: needs pressure, its value at the origin (Pa)")
        if len(given) != 1:
            raise ParameterError(
                "force: give either force (N) or pressure (Pa) or couple (N m), and not both"
            )
        if self.couple is not None and (self.cell is not None or self.point is not None):
            raise ParameterError(
                "couple: a single cell has no lever; let it act on a side or a region"
            )
        if self.force is not None and not any(self.force):
            raise ParameterError("force: is zero along every axis; leave the load out")
        if self.couple is not None and not np.any(self.couple):
            raise ParameterError("couple: is zero; leave the load out")
        if self.pressure == 0.0 and not any(self.pressure_slope or ()):
            raise ParameterError("pressure: is zero; leave the load out")
        return self
