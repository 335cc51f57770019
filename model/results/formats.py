"""Arrays of stored answers whose fields do not say yet what they hold: face agents, outlines.

Sizes go by name: "agents" is the number of rows of the first array that has that name in its
shape; sizes of the scene come from `sizes_of`. Other elastic answers are checked where their agents
are built.
"""

from __future__ import annotations

from typing_extensions import TypedDict

from kaju.model.scene.cell_types import AIR, DISPLACED

from .archive import ArchiveColumn
from .stored import sizes_of as sizes_of

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


class LedgerRecord(TypedDict):
    """The account of a run of the elastic rule; see `PushLedger`."""

    applied: list[float]
    resting: list[float]
    carried: list[float]
    turnover: float
