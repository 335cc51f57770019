"""Who loaded whom: the load path as a directed graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .transfer import BOUNDARY_NAMES

if TYPE_CHECKING:
    import networkx

    from kaju.model.scene import Scene

    from .stage import Stage


def load_path(scene: Scene, stage: Stage) -> networkx.DiGraph:
    """Return the graph of all loads handed over.

    Returns
    -------
    networkx.DiGraph
        Nodes are cells (tuples of int) with the attributes ``kind`` ("material", "free",
        "rigid" or "roller"), ``material``, ``spawn_step`` and ``pos`` (m). An edge leads from
        the cell that passed loads on to the one that took them; its ``weight`` is their sum
        (N). A boundary hands all it gets back over an edge of the same weight.
    """
    import networkx

    lattice = scene.lattice
    graph = networkx.DiGraph()
    names = [material.name for material in scene.cell_materials]
    cells = [tuple(cell) for cell in stage.cells.tolist()]
    centres = lattice.centres(stage.cells).tolist()
    for cell, number, step, centre in zip(
        cells, stage.material.tolist(), stage.spawn_step.tolist(), centres, strict=True
    ):
        graph.add_node(
            cell, kind="material", material=names[number], spawn_step=step, pos=tuple(centre)
        )
    boundaries = [tuple(cell) for cell in stage.boundary_cells.tolist()]
    centres = lattice.centres(stage.boundary_cells).tolist()
    for cell, kind, step, centre in zip(
        boundaries,
        stage.boundary_kind.tolist(),
        stage.boundary_spawn_step.tolist(),
        centres,
        strict=True,
    ):
        graph.add_node(cell, kind=BOUNDARY_NAMES[kind], spawn_step=step, pos=tuple(centre))
    outside = set(boundaries)
    for arm in range(lattice.directions):
        passing = np.flatnonzero(stage.passed[:, arm] > 0.0)
        targets = lattice.neighbours(stage.cells[passing], arm).tolist()
        for row, target in zip(passing.tolist(), map(tuple, targets), strict=True):
            if target in graph:
                graph.add_edge(cells[row], target, weight=float(stage.passed[row, arm]))
            if target in outside:
                graph.add_edge(target, cells[row], weight=float(stage.passed[row, arm]))
    return graph
