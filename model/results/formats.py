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

from .archive import Column
from .stored import sizes_of as sizes_of

if TYPE_CHECKING:
    pass

FACE_AGENTS = {
    "level": Column("i", "agents", 0, 64),
    "spawn_step": Column("i", "agents", 0),
    "number": Column("i", "agents", 0),
    "axis": Column("i", "agents", 0, "dimension"),
    "position": Column("f", "agents dimension"),
    "taken": Column("f", "agents", 0.0),
    "left": Column("f", "agents"),
    "displacement": Column("f", "agents"),
}
BOUNDARY_AGENTS = {
    "cells": Column("i", "boundary dimension", -1, "cells and beyond"),
    "kind": Column("i", "boundary", DISPLACED, AIR),
    "spawn_step": Column("i", "boundary", 0),
    "reaction": Column("f", "boundary dimension"),
    "returned": Column("f", "boundary", 0.0),
}
OUTLINE_AGENTS = {
    "x": Column("i", "agents", 0),
    "y": Column("i", "agents", 0),
    "width": Column("i", "agents", 1),
    "corner_displacement": Column("f", "agents 4 2"),
    "mean_stress": Column("f", "agents 3"),
    "area": Column("f", "agents", 0.0),
}
MOMENTS = {
    "step": Column("i", "moments", 0),
    "level": Column("i", "moments", 0, 64),
    "energy": Column("f", "moments"),
    "left": Column("s", "moments agents"),
    "taken": Column("s", "moments agents", 0.0),
    "displacement": Column("s", "moments agents", optional=True),
}
NETWORK = {
    "positions": Column("f", "nodes dimension"),
    "springs": Column("i", "springs 2", 0, "nodes"),
    "stiffness": Column("f", "springs", 0.0),
    "rest_length": Column("f", "springs", 0.0),
    "held": Column("b", "nodes dimension"),
    "forces": Column("f", "stages nodes dimension"),
    "displacements": Column("f", "stages nodes dimension"),
}
RECORDS = {
    "stage": Column("f", "records", 0.0, "stages", order="rising"),
    "displacement": Column("f", "records nodes dimension"),
    "tension": Column("f", "records springs"),
    "residual": Column("f", "records"),
    "corrections": Column("i", "records", 0),
}
BREAKS = {
    "strengths": Column("f", "parts", 0.0),
    "broken": Column("i", "breaks", 0, "parts"),
    "load_factor": Column("f", "breaks", 0.0),
    "displacement": Column("f", "breaks"),
    "force": Column("f", "breaks"),
    "stored": Column("f", "breaks", 0.0),
    "released": Column("f", "breaks", 0.0),
    "work": Column("f", "breaks"),
}
GROWTH = {
    "cells": Column("f", "agents", 0.0, 1.0),
    "stiffness_of_cells": Column("f", "agents", 0.0, 1.0),
    "designs": Column("s", "kept agents", 0.0, 1.0),
    "compliances": Column("f", "steps", 0.0),
    "volumes": Column("f", "steps", 0.0, 1.0),
    "changes": Column("f", "steps", 0.0, 1.0),
    "iterations": Column("i", "steps", 0),
}
COURSE = {"times": Column("f", "times", 0.0, order="never falling")} | {
    name: Column("f", "times") for name in ("factors", "work", "stored", "dissipated", "numerical")
}
COURSE["at_jumps"] = Column("f", "times", optional=True)
ELEMENT_IN_TIME = {"displacement": Column("f", "times"), "force": Column("f", "times")}
NETWORK_IN_TIME = {
    "displacement": Column("f", "times nodes dimension"),
    "force": Column("f", "times springs"),
}
TRANSFER_IN_TIME = {"growth": Column("f", "times materials")}
ELASTIC_IN_TIME = {
    "growth": Column("f", "times", optional=True),
    "faces": Column("f", "times faces", optional=True),
    "cells": Column("f", "times dimension solid", optional=True),
    "edges": Column("f", "times edges", optional=True),
}
CREEP_STATE = {
    "time": Column("f", "", 0.0),
    "next_step": Column("f", "", 0.0),
    "scale": Column("f", "", 0.0),
    "error_estimate": Column("f", "", 0.0),
    "work": Column("f", ""),
    "dissipated": Column("f", ""),
    "numerical": Column("f", ""),
    "steps": Column("i", "", 0),
    "rejected": Column("i", "", 0),
    "at_jumps": Column("f", "", optional=True),
}
REFERENCE = {
    "points": Column("f", "points dimension"),
    "displacement": Column("f", "points dimension"),
    "stress": Column("f", "points dimension dimension", optional=True),
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
