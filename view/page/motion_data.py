"""What the page is told of runs that it replays as pictures: parts that move and change.

Spring networks, creep, elastic agents, agents of many sizes, elastic answers, bodies that grow and
load transfer on lattices of one's own are all parts (springs, cells) at points, with values and
displacements a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.results.mesh import corner_order
from kaju.model.results.result import Curves, Result, solved_scene
from kaju.model.scene import Scene
from kaju.model.transfer.transfer_result import TransferResult
from kaju.result_kinds import KINDS, fetch
from kaju.view import motion

from .scene_data import Columns

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.growth.growth_result import GrowthResult
    from kaju.model.network import NetworkResult, SpringNetwork
    from kaju.model.rheology.creep_result import CreepResult
    from kaju.model.rheology.creeping_body import TransferCreepResult
    from kaju.model.rheology.elastic import ElasticCreepResult
    from kaju.model.rheology.network import NetworkCreepResult
    from kaju.view.motion import Motion


MOST_FRAMES = 120
"""Longer runs are shown at so many of their moments."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Parts at points, and what becomes of them."""

    points: Floats
    """Places at rest (m). Shape (n, dimension)."""
    parts: NDArray[np.integer]
    """2 corners: a spring; 4: a square or a face's diamond; 8: a cube; else a polygon. Shape
    (parts, corners)."""
    at: Sequence[float] | Floats
    along: str
    """What each frame stands at, and what that is: "s", "step", "generation", "stage"; "share" of
    an answer at rest, whose `moved` and `values` are told once, for the whole load."""
    values: dict[str, tuple[str, NDArray[np.floating]]]
    """What parts can be coloured by: one number each, or one each a frame."""
    moved: NDArray[np.floating] | None = None
    """Displacements (m) of points, or of whole parts. Shape (frames, n or parts, dimension)."""
    born: NDArray[np.integer] | None = None
    gone: NDArray[np.integer] | None = None
    """From when on a part is there, and from when on it is no more; in the units of `at`. Shape
    (parts,)."""
    curves: Sequence[Curves] = ()
    """What is drawn beside it."""
    held: NDArray[np.integer] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Points that something holds."""
    forces: Sequence[tuple[list[float], list[float]]] = ()
    """Loads (m, N)."""
    visits: Sequence[int] = ()
    """Which level acted before each frame, where parents stand for blocks of cells."""
    words: str = ""
    """How the run ended."""
    alone: bool = False
    """Whether every frame is magnified by itself: what hardly holds any more moves far."""
    outlines: Sequence[dict[str, Any]] = ()
    """What cuts the parts, first the box, then regions by their curves: "solid", and "lines", the
    number of points of each. These are the last points: one, and three a cubic curve."""


def motion_data(result: Result) -> tuple[dict[str, Any], Columns]:
    """Return the header and the columns of a page that replays a result."""
    page = KINDS[result.kind].page
    if page is None:
        raise ParameterError(
            f"of: {type(result).__name__} has nothing that a page can show; it shows scenes, "
            "models and their results"
        )
    return picture_data(fetch(page)(result))


def picture_data(told: Pictures) -> tuple[dict[str, Any], Columns]:
    """Return the header and the columns of a page that shows parts."""
    single = np.float32
    columns: Columns = {
        "points": told.points.astype(single),
        "parts": told.parts.astype(np.uint32),
        "held": told.held.astype(np.uint32),
    }
    if told.moved is not None:
        columns["moved"] = told.moved.astype(single)
    if told.born is not None:
        columns["born"] = told.born.astype(np.uint32)
    if told.gone is not None:
        columns["gone"] = told.gone.astype(np.uint32)
    for name, (_, values) in told.values.items():
        columns[f"value {name}"] = values.astype(single)
    header = {
        "dimension": told.points.shape[1],
        "corners": told.parts.shape[1],
        "at": np.asarray(told.at, dtype=float).tolist(),
        "along": told.along,
        "colours": {name: unit for name, (unit, _) in told.values.items()},
        "curves": [curve_data(curves) for curves in told.curves],
        "forces": [{"place": place, "force": force} for place, force in told.forces],
        "visits": list(told.visits),
        "outcome": told.words,
        "alone": told.alone,
        "outlines": list(told.outlines),
    }
    return header, columns


def curve_data(curves: Curves) -> dict[str, Any]:
    """Return curves as plain data."""
    return {
        "title": curves.title,
        "unit": curves.unit,
        "at": curves.at.tolist(),
        "lines": {name: line.tolist() for name, line in curves.lines.items()},
        "logarithmic": curves.logarithmic,
        "course": curves.along == "displacement",  # a point a moment, there and back
        "place": curves.along == "place",  # no moments at all
    }


def network(result: NetworkResult) -> Pictures:
    """Tell of a network stage by stage."""
    over, moved = ("stage", "", result.stage), _largest(result.displacement)
    stages = Curves("Displacement", *over, moved, "m")
    pull = {"pull": result.tension.max(axis=1), "push": result.tension.min(axis=1)}
    springs = Curves("Largest forces", *over, pull, "N")
    return _network(motion.increments(result), result.network, "stage", [stages, springs])


def network_in_time(result: NetworkCreepResult) -> Pictures:
    """Tell of a network that creeps."""
    return _network(motion.network_times(result), result.network, "s", result.curves())


def body_in_time(result: TransferCreepResult | ElasticCreepResult) -> Pictures:
    """Tell of a body that creeps."""
    moving = _strained(result, motion.times(result))
    curves = [*result.curves()[:2], *map(_largest_of(moving), ("strain", "stress"))]
    return _moving(moving, "s", curves, applied(result.static.scene))


def generations_of(result: TransferResult) -> Pictures:
    """Tell of load transfer on a lattice that the page does not know."""
    told = _moving(motion.generations(result), "generation", [], applied(result.scene))
    return replace(told, words=result.outcome)


def elastic_answer(result: ElasticResult) -> Pictures:
    """Tell how agents spawned; of equal agents how they move with the load."""
    if result.spawned:
        return _spawned(result)
    return _moving(motion.loaded(result), "share", [], applied(solved_scene(result)), 21)


_UNITS = {"strain": "", "stress": "Pa"}


def _strained(result: TransferCreepResult | ElasticCreepResult, moving: Motion) -> Motion:
    """Give every cell of a creeping body its largest strain and stress (principal, by size)."""
    static = result.static
    lattice, cells = static.grid.lattice, np.argwhere(static.grid.rasterise() >= 0)
    frames = []
    for record, frame in enumerate(moving.frames):
        stress = result.stress(record)
        if isinstance(static, TransferResult):
            field = np.zeros((*lattice.shape, lattice.dimension, lattice.dimension))
            field[tuple(static.last.cells.T)] = stress
            stress = field
        values = {"stress": _principal(stress[tuple(cells.T)])}
        if lattice.boxes:  # what the corners move apart by, over the edge
            corners = frame.moved[moving.parts] / lattice.cell_size
            signs = 2.0 * corner_order(lattice.dimension) - 1.0
            gradient = np.einsum("nca,cb->nab", corners, signs) * 2.0 / len(signs)
            values |= {"strain": _principal(0.5 * (gradient + gradient.transpose(0, 2, 1)))}
        frames.append(frame._replace(values=values))
    return replace(moving, frames=frames)


def _principal(tensors: Floats) -> Floats:
    """Return the size of the largest principal value of each tensor."""
    return np.asarray(np.abs(np.linalg.eigvalsh(tensors)).max(axis=1, initial=0.0))


def _largest_of(moving: Motion) -> Callable[[str], Curves]:
    times = np.array([frame.time for frame in moving.frames])

    def curve(name: str) -> Curves:
        none = np.zeros(1)
        line = [float(f.values.get(name, none).max(initial=0.0)) for f in moving.frames]
        title = f"Largest {name}"
        return Curves(title, "time", "s", times, {name: np.array(line)}, _UNITS[name])

    return curve


def element(result: CreepResult) -> Pictures:
    """Tell of one element: a bar, four times as long as it ever lengthens, held on its left."""
    times, moved = result.times, result.displacement
    long = 4.0 * float(np.abs(moved).max(initial=0.0)) or 1.0
    points = long * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.25], [0.0, 0.25]])
    shift = np.zeros((len(times), 4, 2))
    shift[:, 1:3, 0] = moved[:, None]
    chosen = _chosen(len(times))
    return Pictures(
        points=points,
        parts=np.arange(4)[None],
        at=times[chosen],
        along="s",
        values={"force": ("N", result.force[chosen, None])},
        moved=shift[chosen],
        curves=result.curves(),
        held=np.array([0, 3]),
    )


def _largest(displacement: Floats) -> dict[str, Floats]:
    return {"largest displacement": np.linalg.norm(displacement, axis=2).max(axis=1)}


def _chosen(count: int) -> Ints:
    """Return the moments that are shown: all, or so many, evenly, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(np.int64))


def _network(
    moving: Motion, network: SpringNetwork, along: str, curves: Sequence[Curves]
) -> Pictures:
    return _moving(
        moving,
        along,
        curves,
        _acting(network),
        held=np.flatnonzero(network.held.any(axis=1)),
    )


def _acting(network: SpringNetwork) -> list[tuple[list[float], list[float]]]:
    """Return the places and forces of a network's loads."""
    force = network.forces[-1]
    acting = np.flatnonzero(force.any(axis=1))
    return [(network.positions[node].tolist(), force[node].tolist()) for node in acting]


def _moving(
    moving: Motion,
    along: str,
    curves: Sequence[Curves],
    forces: Sequence[tuple[list[float], list[float]]],
    shares: int = 0,
    held: NDArray[np.integer] | None = None,
) -> Pictures:
    """Tell of points that move; `shares`: of an answer at rest, how many are shown."""
    units = {"tension": "N", "von_mises": "Pa", "load_taken": "N", "level": "", **_UNITS}
    frames = [moving.frames[k] for k in ([-1] if shares else _chosen(len(moving.frames)))]
    values = {
        name: (units.get(name, ""), np.array([frame.values[name] for frame in frames]))
        for name in frames[-1].values
    }
    at = np.linspace(0.0, 1.0, shares) if shares else np.array([frame.time for frame in frames])
    none = np.empty(0, dtype=np.int64)
    return Pictures(
        points=moving.points,
        parts=moving.parts,
        at=at,
        along=along,
        values=values,
        moved=np.array([frame.moved for frame in frames]),
        curves=curves,
        forces=forces,
        held=none if held is None else held,
    )


def applied(scene: Scene, stage: int | None = None) -> list[tuple[list[float], list[float]]]:
    """Return the places and forces of a scene's loads."""
    applied = scene.applied(stage)
    places = scene.lattice.centres(applied.cells)
    return [(p.tolist(), f.tolist()) for p, f in zip(places, applied.force, strict=True)]


def _spawned(result: ElasticResult) -> Pictures:
    """Agents of every generation, each from when it spawned to when it retired."""
    family, generations = result.family, result.generations
    rows, dimension = family.rows, result.lower.shape[1]
    corners = corner_order(dimension)
    places = family.lower[:, None] + family.size[:, None, None] * corners
    count = np.arange(float(len(generations)))
    over = ("generation", "", count)
    curves = [
        Curves("Agents", *over, {"agents": np.array([float(g.agents) for g in generations])}, ""),
        Curves(
            "Error", *over, {"error": np.array([100.0 * g.error for g in generations])}, "%", True
        ),
        Curves("Strain energy", *over, {"energy": np.array([g.energy for g in generations])}, "J"),
    ]
    retired = rows["retired_step"].astype(np.int64)
    return Pictures(
        points=places.reshape(-1, dimension),
        parts=np.arange(len(rows) * len(corners)).reshape(len(rows), -1),
        at=np.arange(float(len(generations))),
        along="generation",
        values={
            "level": ("", family.level.astype(float)),
            "unbalanced_load": ("N", np.nan_to_num(rows["unbalanced_load"])),
            "spawn_step": ("", rows["spawn_step"].astype(float)),
        },
        born=rows["spawn_step"].astype(np.int64),
        gone=np.where(retired < 0, len(generations), retired),
        curves=curves,
        forces=applied(result.scene),
        words=f"{result.agents} agents, error {100.0 * result.error_estimate:.2g} %",
    )


def growth_steps(result: GrowthResult) -> Pictures:
    """Densities step by step; of the last step alone if no other were kept."""
    lattice = result.scene.lattice
    corners = lattice.cell_size * (corner_order(lattice.dimension) - 0.5)
    places = lattice.centres(np.argwhere(result.body))[:, None] + corners
    steps = _chosen(result.steps + 1) if len(result.designs) else np.array([result.steps])
    designs = result.designs[steps] if len(result.designs) else result.cells[None]
    over = ("step", "", np.arange(result.steps + 1.0))
    return Pictures(
        points=places.reshape(-1, lattice.dimension),
        parts=np.arange(places.size // lattice.dimension).reshape(len(places), -1),
        at=steps.astype(float),
        along="step",
        values={"density": ("", np.rint(256.0 * designs) / 256.0)},  # more would not deflate
        curves=[
            Curves("Compliance", *over, {"compliance": result.compliances}, "J"),
            Curves("Volume", *over, {"volume": 100.0 * result.volumes}, "%"),
        ],
        forces=applied(result.scene, result.stage),
        words=result.outcome,
    )


def breaks(result: FractureResult) -> Pictures:
    """Springs or cells, each until it breaks, under the load of the last break."""
    counts = _chosen(result.standing + 1)
    moved, borne = [], []
    for count, body in zip(counts.tolist(), result.replayed(counts.tolist()), strict=True):
        factor = result.factor_after(count)
        moved.append(_steps_of(factor * body.displacement(), 128))
        borne.append(_steps_of(factor * body.borne(), 128))
    points, parts = body.points
    gone = np.full(len(parts), result.breaks + 1)
    gone[result.broken] = np.arange(1, result.breaks + 1)
    over = ("break", "", np.arange(result.breaks + 1.0))
    force, way = (np.append(0.0, column) for column in (result.force, result.displacement))
    # What bears hardly anything any more moves so far that the rest would not be seen.
    bearing = 1 + np.flatnonzero(force >= 0.02 * force.max())[-1]
    course = Curves(
        "Load over displacement (m)",
        *("displacement", "m", way[:bearing]),
        {"load": force[:bearing]},
        "N",
    )
    sizes = [0, *(k + 1 for size in result.avalanche_sizes for k in range(size))]
    books = {name: np.append(0.0, getattr(result, name)) for name in ("work", "stored", "released")}
    if isinstance(result.subject, Scene):
        name, unit, held, forces = "stress", "Pa", None, applied(result.subject)
    else:
        name, unit, held = "tension", "N", np.flatnonzero(result.subject.held.any(axis=1))
        forces = _acting(result.subject)
    return Pictures(
        points=points,
        parts=parts,
        at=counts.astype(float),
        along="break",
        values={name: (unit, np.array(borne))},
        moved=np.array(moved),
        gone=gone,
        curves=[
            Curves("Load", *over, {"load": force}, "N"),
            course,
            Curves("Breaks of the avalanche", *over, {"size": np.array(sizes, dtype=float)}, ""),
            Curves("Energy", *over, books, "J"),
        ],
        held=np.empty(0, dtype=np.int64) if held is None else held,
        forces=forces,
        words=result.outcome,
        alone=True,
    )


def _steps_of(values: Floats, count: int) -> Floats:
    """Round to so many steps or more up to the largest: other digits would not deflate."""
    most = float(np.abs(values).max(initial=0.0)) or 1.0
    step = 2.0 ** np.floor(np.log2(most / count))
    return np.asarray(step * np.rint(values / step))


def diamonds(middle: Floats, h: float) -> tuple[Floats, NDArray[np.integer]]:
    """Return points and parts that stand for faces of cells: each half in either cell."""
    dimension = middle.shape[1]
    if dimension == 3:
        corners = 0.5 * (corner_order(3) - 0.5)
    else:
        corners = 0.5 * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    points = (middle[:, None] + h * corners).reshape(-1, dimension)
    return points, np.arange(len(points)).reshape(len(middle), -1)


class MovingFaces:
    """Displacements of the faces' middles in all directions.

    A face moves along its normal; across it goes with the mean of the faces round it. `fields`:
    displacement (m) of all faces, one array for each axis, with a rim; NaN where there is none.
    """

    def __init__(self, axis: Ints, index: Ints, fields: Sequence[Floats]) -> None:
        self.axis = axis
        self.fields = fields
        self.places = [tuple(index[axis == a].T) for a in range(len(fields))]
        unit = np.eye(len(fields), dtype=np.int64)
        self.round: dict[tuple[int, int], tuple[Any, Floats]] = {}
        for a, b in permutations(range(len(fields)), 2):
            at = index[axis == a]
            places = [at, at + unit[b], at - unit[a], at - unit[a] + unit[b]]
            flat = np.stack([np.ravel_multi_index(tuple(p.T), fields[b].shape) for p in places])
            there = ~np.isnan(fields[b].ravel()[flat])
            self.round[a, b] = flat, there / np.maximum(there.sum(axis=0), 1)

    def at(self, displacement: Floats) -> Floats:
        """Return displacements (m), shape (faces, dimension), from those along the normals."""
        fields = [np.nan_to_num(field) for field in self.fields]
        moved = np.zeros((len(displacement), len(fields)))
        for a, places in enumerate(self.places):
            fields[a][places] = moved[self.axis == a, a] = displacement[self.axis == a]
        for (a, b), (flat, weight) in self.round.items():
            moved[self.axis == a, b] = (weight * fields[b].ravel()[flat]).sum(axis=0)
        return moved


def _shape_of(run: ElasticRun, chosen: Ints) -> NDArray[np.floating] | None:
    """Return how the agents on the cells' own faces have moved at some moments, if that is told."""
    moved, own = run.moments.displacement, run.agents.level == 0
    if moved is None:
        return None
    axis, places = run.agents.axis[own], run.agents.position[own] / run.grid.lattice.cell_size
    across = axis[:, None] != np.arange(places.shape[1])
    index = np.rint(places - 0.5 * across).astype(np.int64) + 1
    fields = [np.pad(field, 1, constant_values=np.nan) for field in run.displacement]
    moving = MovingFaces(axis, index, fields)
    told = np.stack([moving.at(moment) for moment in moved[chosen][:, own].astype(float)])
    bits = told.astype(np.float32).view(np.uint32)  # five digits: the rest would not deflate
    return ((bits + 0x80) & np.uint32(0xFFFFFF00)).view(np.float32)


def elastic_agents(run: ElasticRun) -> Pictures:
    """Agents on the faces of the cells."""
    agents, moments = run.agents, run.moments
    own = agents.level == 0
    points, parts = diamonds(agents.position[own], run.grid.lattice.cell_size)
    # Most happens in the first steps, so the moments shown lie ever farther apart.
    last = len(moments.step)
    chosen = np.unique(np.geomspace(1, last, min(last, MOST_FRAMES)).round().astype(np.int64)) - 1
    return Pictures(
        points=points,
        parts=parts,
        at=moments.step[chosen].astype(float),
        along="step",
        values={
            "load_left": ("N", np.abs(moments.left[chosen][:, own]).astype(float)),
            "load_taken": ("N", moments.taken[chosen][:, own].astype(float)),
        },
        moved=_shape_of(run, chosen),
        born=agents.spawn_step[own],
        curves=run.curves(),
        forces=applied(run.scene),
        visits=moments.level[chosen].tolist(),
        words=run.outcome,
    )
