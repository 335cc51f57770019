"""True outlines in pages: curves that cut the agents' squares, and the loads on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from kaju.arrays import Floats
from kaju.errors import SceneError
from kaju.model.outline.arc_triangles import ArcFrames, halved
from kaju.model.outline.laws import AIR
from kaju.model.outline.outline_problem import SIDES
from kaju.model.outline.posed_outlines import problem_of
from kaju.model.outline.square_leaves import SquareLeaves
from kaju.model.results.mesh import corner_order
from kaju.model.results.result import Curves
from kaju.model.scene.curves import flattened
from kaju.view.motion import Motion

if TYPE_CHECKING:
    from kaju.model.outline.outline_result import OutlineResult
    from kaju.model.scene import Scene
    from kaju.model.scene.loads import LoadTable

_ON_CURVE = np.linalg.inv(
    [[(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3] for t in (0, 1 / 3, 2 / 3, 1)]
)
"""Control points of the cubic curve through four points."""
_ARROWS = 12
"""Arrows that stand for a pressure along an outline."""
CELLS = {
    "en": "The outlines of this body are true ones. The prescribed rule runs on cells: here they "
    "are steps of these.",
    "de": "Die Umrisse dieses Körpers sind echte Kurven. Die vorgeschriebene Regel läuft auf "
    "Zellen: Hier sind sie Treppen aus diesen.",
    "ja": "この物体の輪郭は本来なめらかな曲線です。決められた規則はセルの上で動くので、"
    "ここではセルの階段になります。",
}
"""What a page says that runs the prescribed rule on a body with true outlines."""


class DrawnOutlines(NamedTuple):
    """Outlines as cubic curves: every line begins with a point, and three follow for each curve."""

    points: Floats
    """Where their control points are (m), shape (n, 2)."""
    moved: Floats
    """By how much they move (m), shape (generations, n, 2)."""
    regions: list[dict[str, Any]]
    """Whether it is solid, and the number of points of each of its lines: first the box, which has
    none, then region by region."""


def cut_agents(result: OutlineResult) -> Motion:
    """Agents as whole squares that the outlines cut, generation by generation."""
    generations = result.generations
    squares = []
    for one in generations:
        stood = one.leaves[-1].only(one.kept)
        squares.append(np.stack([stood.x, stood.y, stood.size], axis=1))
    family, own = np.unique(np.concatenate(squares), axis=0, return_inverse=True)
    rows = np.split(own.ravel(), np.cumsum([len(square) for square in squares])[:-1])
    corners = family[:, None, :2] + family[:, None, 2:] * corner_order(2).astype(np.int64)
    places, node = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    parts = node.reshape(-1, 4)
    count = len(generations)
    born, gone = np.full(len(family), count), np.zeros(len(family), dtype=np.int64)
    moved, stress = np.zeros((count, len(places), 2)), np.zeros((count, len(family)))
    for number, (one, row) in enumerate(zip(generations, rows, strict=True)):
        born[row], gone[row] = np.minimum(born[row], number), number + 1
        moved[number, parts[row]] = one.corner_displacement
        stress[number, row] = one.von_mises
    drawn = drawn_outlines(result)
    most = "at most" if result.proof else "about"
    over = ("generation", "", np.arange(float(count)))
    agents = {"agents": np.array([float(one.agents) for one in generations])}
    errors = {"error": 100.0 * np.array(result.errors)}
    curves = [Curves("Agents", *over, agents, ""), Curves("Error", *over, errors, "%", True)]
    for name, (x, y, hoop) in ((name, rows.T) for name, rows in result.hoops.items()):
        along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))[: len(hoop)]
        title = f"Hoop stress over the way along {name} (m)"
        curves.append(Curves(title, "place", "m", along, {"hoop stress": hoop}, "Pa"))
    return Motion(
        points=np.concatenate([result.first_edge * SquareLeaves.unit * places, drawn.points]),
        parts=parts,
        at=np.arange(float(count)),
        along="generation",
        values={"von_mises": ("Pa", stress)},
        moved=np.concatenate([moved, drawn.moved], axis=1),
        born=born,
        gone=gone,
        curves=curves,
        forces=[arrow for load in result.scene.loads for arrow in _arrows_of(result, load)],
        outcome=f"{result.agents} agents, error {most} {100.0 * result.error_estimate:.2g} %",
        outlines=drawn.regions,
    )


def drawn_outlines(result: OutlineResult) -> DrawnOutlines:
    """Return the outlines of a body, as its agents move them."""
    problem, edge = problem_of(result.scene)
    leaves = result.leaves[-1]
    points: list[Floats] = []
    regions: list[dict[str, Any]] = [{"solid": problem.body.law != AIR, "lines": []}]
    for region in problem.body.regions:
        lines = [flattened(_as_fine(line.arcs, leaves), 3) for line in region.lines]
        regions.append({"solid": region.solid, "lines": [len(at) + 1 for at in lines]})
        points += lines
    moved = []
    for one in result.generations:
        moved.append(np.concatenate([_as_curves(_moved(one, at)) for at in points]))
    places = np.concatenate([edge * _as_curves(at) for at in points])
    return DrawnOutlines(places, np.stack(moved), regions)


def _as_curves(points: Floats) -> Floats:
    """Return the control points of cubic curves through every third of these points, closed."""
    of = np.stack([points[0::3], points[1::3], points[2::3], np.roll(points[0::3], -1, 0)], 1)
    controls = np.einsum("ij,njd->nid", _ON_CURVE, of)
    return np.concatenate([controls[:1, 0], controls[:, 1:].reshape(-1, 2)])


def _as_fine(arcs: Floats, leaves: SquareLeaves) -> Floats:
    """Halve arcs that are longer than the leaves at them: the leaves bend them."""
    while True:
        frames = ArcFrames(arcs)
        size = np.full(len(arcs), np.inf)
        for points in (frames.start, frames.tip, frames.end):
            leaf = leaves.at(points)
            size = np.minimum(size, np.where(leaf < 0, np.inf, leaves.size[leaf] * leaves.unit))
        long = frames.length > size
        if not long.any():
            return arcs
        arcs = halved(arcs, long)


def _moved(result: OutlineResult, at: Floats) -> Floats:
    """Return how points (in edges of the first agents) move; beyond the body with what is near."""
    own = result.leaves[-1].only(result.kept)
    leaf = own.at(at)
    beyond = leaf < 0
    middle = own.lower() + 0.5 * (own.size * own.unit)[:, None]
    leaf[beyond] = cKDTree(middle).query(at[beyond])[1]
    scale = result.first_edge * result.pair.problem.strain
    return np.asarray(scale * result.pair.displacement_at(result.kept[leaf], at))


def _arrows_of(result: OutlineResult, load: LoadTable) -> list[tuple[list[float], list[float]]]:
    scene = result.scene
    if load.side is not None:
        axis, upper = SIDES[load.side]
        at = (
            result.lower
            + np.where(np.arange(2) == axis, 1.0 if upper else 0.0, 0.5) * (result.size[:, None])
        )
        end = scene.lattice.extent[axis] if upper else 0.0
        there = np.isclose(at[:, axis], end, rtol=0.0, atol=1e-9 * result.first_edge)
        place, long = at[there].mean(axis=0), float(result.size[there].sum())
        if load.force is not None:
            return [(place.tolist(), list(load.force))]
        assert load.pressure is not None
        inward = np.where(np.arange(2) == axis, -1.0 if upper else 1.0, 0.0)
        return [(place.tolist(), (load.pressure * long * scene.thickness * inward).tolist())]
    problem, edge = problem_of(scene)
    which = [region.name for region in scene.body.regions].index(load.outline)
    region = problem.body.regions[which]
    ring = np.concatenate([edge * flattened(arcs, 8) for arcs in [region.lines[0].arcs]])
    if load.force is not None:
        return [(ring.mean(axis=0).tolist(), list(load.force))]
    assert load.pressure is not None
    run = np.roll(ring, -1, axis=0) - ring
    way = np.append(0.0, np.cumsum(np.hypot(*run.T)))
    rows = np.searchsorted(way, way[-1] * np.arange(_ARROWS) / _ARROWS, side="right") - 1
    inward = np.stack([-run[rows, 1], run[rows, 0]], axis=1) * (1.0 if region.solid else -1.0)
    inward /= np.hypot(*inward.T)[:, None]
    force = load.pressure * scene.thickness * way[-1] / _ARROWS * inward
    inside = ((ring[rows] >= 0.0) & (ring[rows] <= scene.lattice.extent)).all(axis=1)
    return list(zip(ring[rows][inside].tolist(), force[inside].tolist(), strict=True))


def on_cells(scene: Scene) -> Scene:
    """Return a scene whose true outlines are steps of its cells; a loaded outline is refused."""
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            raise SceneError(
                f"loads.{number}.outline: the prescribed rule runs on cells, which have no outline "
                f"{load.outline!r} to load; show the answer, export_page(solve(scene), ...), or "
                "load a side or a region"
            )
    count = len(scene.body.regions)
    return scene.with_overrides({f"body.regions.{n}.outline": "cells" for n in range(count)})
