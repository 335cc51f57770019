"""What stored results hold, kind by kind: every array with its numbers, shape and range.

Files are read by these tables and documented by them (docs/formats.md). Sizes go by name:
"agents" is the number of rows of the first array that has that name in its shape; sizes of the
scene come from `sizes_of`. Elastic answers are checked where their agents are built
(`CellAgents.of_archive`, `Spawning.of_archive`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from typing_extensions import TypedDict

from kaju.model.scene.cell_types import AIR, DISPLACED

from .archive import ArchiveColumn
from .stored import sizes_of as sizes_of

if TYPE_CHECKING:
    pass

FACE_AGENTS = {
    "level": ArchiveColumn("i", "agents", 0, 64),
    "spawn_step": ArchiveColumn("i", "agents", 0),
    "number": ArchiveColumn("i", "agents", 0),
    "axis": ArchiveColumn("i", "agents", 0, "dimension"),
    "position": ArchiveColumn("f", "agents dimension"),
    "taken": ArchiveColumn("f", "agents", 0.0),
    "left": ArchiveColumn("f", "agents"),
    "displacement": ArchiveColumn("f", "agents"),
}
BOUNDARY_AGENTS = {
    "cells": ArchiveColumn("i", "boundary dimension", -1, "cells and beyond"),
    "kind": ArchiveColumn("i", "boundary", DISPLACED, AIR),
    "spawn_step": ArchiveColumn("i", "boundary", 0),
    "reaction": ArchiveColumn("f", "boundary dimension"),
    "returned": ArchiveColumn("f", "boundary", 0.0),
}
OUTLINE_AGENTS = {
    "x": ArchiveColumn("i", "agents", 0),
    "y": ArchiveColumn("i", "agents", 0),
    "size": ArchiveColumn("i", "agents", 1),
}
MOMENTS = {
    "step": ArchiveColumn("i", "moments", 0),
    "level": ArchiveColumn("i", "moments", 0, 64),
    "energy": ArchiveColumn("f", "moments"),
    "left": ArchiveColumn("s", "moments agents"),
    "taken": ArchiveColumn("s", "moments agents", 0.0),
    "displacement": ArchiveColumn("s", "moments agents", optional=True),
}
REFERENCE = {
    "points": ArchiveColumn("f", "points dimension"),
    "displacement": ArchiveColumn("f", "points dimension"),
    "stress": ArchiveColumn("f", "points dimension dimension", optional=True),
}


_Value = float | list[float] | list[list[float]]


AnswerRecord = tuple[_Value, float, float] | tuple[_Value, float, float, float, float | None, str]
"""A goal's value, its error, and that as a share of the scale; the scale, and what is certain."""


class LedgerRecord(TypedDict):
    """The account of a run of the elastic rule; see `PushLedger`."""

    applied: list[float]
    resting: list[float]
    carried: list[float]
    turnover: float
