"""Mesa's names, imported without the side effect of importing Mesa.

Mesa's batch runner sets multiprocessing's start method to "spawn" for the whole process when
it is imported. Whoever imports kaju has not asked for that, so it is put back as it was.
"""

from __future__ import annotations

import multiprocessing

_before = multiprocessing.get_start_method(allow_none=True)

from mesa import Agent, DataCollector, Model  # noqa: E402
from mesa.agent import AgentSet  # noqa: E402
from mesa.discrete_space import (  # noqa: E402
    Cell,
    FixedAgent,
    HexGrid,
    Network,
    OrthogonalVonNeumannGrid,
)

multiprocessing.set_start_method(_before, force=True)

__all__ = [
    "Agent",
    "AgentSet",
    "Cell",
    "DataCollector",
    "FixedAgent",
    "HexGrid",
    "Model",
    "Network",
    "OrthogonalVonNeumannGrid",
]
