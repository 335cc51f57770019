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
    "width": ArchiveColumn("i", "agents", 1),
    "corner_displacement": ArchiveColumn("f", "agents 4 2"),
    "mean_stress": ArchiveColumn("f", "agents 3"),
    "area": ArchiveColumn("f", "agents", 0.0),
}
MOMENTS = {
    "step": ArchiveColumn("i", "moments", 0),
    "level": ArchiveColumn("i", "moments", 0, 64),
    "energy": ArchiveColumn("f", "moments"),
    "left": ArchiveColumn("s", "moments agents"),
    "taken": ArchiveColumn("s", "moments agents", 0.0),
    "displacement": ArchiveColumn("s", "moments agents", optional=True),
}
NETWORK = {
    "positions": ArchiveColumn("f", "nodes dimension"),
    "springs": ArchiveColumn("i", "springs 2", 0, "nodes"),
    "stiffness": ArchiveColumn("f", "springs", 0.0),
    "rest_length": ArchiveColumn("f", "springs", 0.0),
    "held": ArchiveColumn("b", "nodes dimension"),
    "forces": ArchiveColumn("f", "stages nodes dimension"),
    "displacements": ArchiveColumn("f", "stages nodes dimension"),
}
RECORDS = {
    "stage": ArchiveColumn("f", "records", 0.0, "stages", order="rising"),
    "displacement": ArchiveColumn("f", "records nodes dimension"),
    "tension": ArchiveColumn("f", "records springs"),
    "residual": ArchiveColumn("f", "records"),
    "corrections": ArchiveColumn("i", "records", 0),
}
BREAKS = {
    "strengths": ArchiveColumn("f", "parts", 0.0),
    "broken": ArchiveColumn("i", "breaks", 0, "parts"),
    "load_factor": ArchiveColumn("f", "breaks", 0.0),
    "displacement": ArchiveColumn("f", "breaks"),
    "force": ArchiveColumn("f", "breaks"),
    "stored": ArchiveColumn("f", "breaks", 0.0),
    "released": ArchiveColumn("f", "breaks", 0.0),
    "work": ArchiveColumn("f", "breaks"),
}
GROWTH = {
    "cells": ArchiveColumn("f", "agents", 0.0, 1.0),
    "stiffness_of_cells": ArchiveColumn("f", "agents", 0.0, 1.0),
    "designs": ArchiveColumn("s", "kept agents", 0.0, 1.0),
    "compliances": ArchiveColumn("f", "steps", 0.0),
    "volumes": ArchiveColumn("f", "steps", 0.0, 1.0),
    "changes": ArchiveColumn("f", "steps", 0.0, 1.0),
    "iterations": ArchiveColumn("i", "steps", 0),
}
COURSE = {"times": ArchiveColumn("f", "times", 0.0, order="never falling")} | {
    name: ArchiveColumn("f", "times")
    for name in ("factors", "work", "stored", "dissipated", "numerical")
}
COURSE["at_jumps"] = ArchiveColumn("f", "times", optional=True)
ELEMENT_IN_TIME = {
    "displacement": ArchiveColumn("f", "times"),
    "force": ArchiveColumn("f", "times"),
}
NETWORK_IN_TIME = {
    "displacement": ArchiveColumn("f", "times nodes dimension"),
    "force": ArchiveColumn("f", "times springs"),
}
TRANSFER_IN_TIME = {"growth": ArchiveColumn("f", "times materials")}
ELASTIC_IN_TIME = {
    "growth": ArchiveColumn("f", "times", optional=True),
    "faces": ArchiveColumn("f", "times faces", optional=True),
    "cells": ArchiveColumn("f", "times dimension solid", optional=True),
    "edges": ArchiveColumn("f", "times edges", optional=True),
}
CREEP_STATE = {
    "time": ArchiveColumn("f", "", 0.0),
    "next_step": ArchiveColumn("f", "", 0.0),
    "scale": ArchiveColumn("f", "", 0.0),
    "error_estimate": ArchiveColumn("f", "", 0.0),
    "work": ArchiveColumn("f", ""),
    "dissipated": ArchiveColumn("f", ""),
    "numerical": ArchiveColumn("f", ""),
    "steps": ArchiveColumn("i", "", 0),
    "rejected": ArchiveColumn("i", "", 0),
    "at_jumps": ArchiveColumn("f", "", optional=True),
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
