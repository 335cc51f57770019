"""True outlines in pages: cubic curves that cut the agents' squares, and stresses along them."""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.pair.cut_agents import CutAgents
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.outline.arc_triangles import ArcFrames, halved
from kaju.model.outline.true_shapes import AIR, UNIT, leaf_at
from kaju.model.results.result import Curves
from kaju.model.scene.curves import flattened

_ON_CURVE = np.linalg.inv(
    [[(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3] for t in (0, 1 / 3, 2 / 3, 1)]
)
"""Control points of the cubic curve through four points."""


def curves_of(
    result: ElasticResult, found: CutAgents
) -> tuple[Floats, Floats, list[dict[str, Any]]]:
    """Return control points of the outlines (m), how they move (m), and their lines.

    Every line begins with a point, and three follow for each cubic curve. First stands the box,
    which has none, then region by region whether it is solid, and the number of points of each of
    its lines.
    """
    body, places, moved = found.ground.problem.body, [np.empty((0, 2))], [np.empty((0, 2))]
    regions: list[dict[str, Any]] = [{"solid": body.law != AIR, "lines": []}]
    for region in body.regions:
        lines = [flattened(_as_fine(line.arcs, found.leaves), 3) for line in region.lines]
        regions.append({"solid": region.solid, "lines": [len(at) + 1 for at in lines]})
        for line in lines:
            at = found.ground.edge * line
            places.append(_as_curves(at))
            moved.append(_as_curves(result.displacement_near(at)))
    return np.concatenate(places), np.concatenate(moved), regions


def along_outlines(result: ElasticResult, found: CutAgents) -> list[Curves]:
    """Return the hoop stress over the way along every named outline."""
    drawn = []
    for name in found.along:
        (x, y), hoop = result.outline_stress(name)[0].T, result.outline_stress(name)[1]
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))[: len(hoop)]
        title = f"Hoop stress: {name}"
        drawn.append(Curves(title, "place", "m", way, {"hoop stress": hoop}, "Pa"))
    return drawn


def _as_curves(points: Floats) -> Floats:
    """Return the control points of cubic curves through every third of these points, closed."""
    of = np.stack([points[0::3], points[1::3], points[2::3], np.roll(points[0::3], -1, 0)], 1)
    controls = np.einsum("ij,njd->nid", _ON_CURVE, of)
    return np.concatenate([controls[:1, 0], controls[:, 1:].reshape(-1, 2)])


def _as_fine(arcs: Floats, leaves: LeafCells) -> Floats:
    """Halve arcs that are longer than the leaves at them: the leaves bend them."""
    while True:
        frames = ArcFrames(arcs)
        size = np.full(len(arcs), np.inf)
        for points in (frames.start, frames.tip, frames.end):
            leaf = leaf_at(leaves, points)
            size = np.minimum(size, np.where(leaf < 0, np.inf, leaves.size[leaf] * UNIT))
        long = frames.length > size
        if not long.any():
            return arcs
        arcs = halved(arcs, long)
