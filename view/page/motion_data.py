"""Runs that the page replays: parts that move and change, as a header and columns of numbers.

Spring networks, creep, elastic agents, agents of many sizes, elastic answers, bodies that grow and
load transfer on lattices of one's own are all parts (springs, cells) at points, with values and
displacements a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
from kaju.view.body_plots import SUPPORTS, force_arrows
from kaju.view.deformed import stress_text
from kaju.view.fracture_plots import bearing
from kaju.view.quadtree import errors_of
from kaju.view.units import quantity

from .scene_data import MOST_CELLS, Columns

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.growth.growth_result import GrowthResult
    from kaju.model.network import NetworkResult, SpringNetwork
    from kaju.model.rheology.creep_result import CreepResult
    from kaju.model.rheology.creeping_elastic import ElasticCreepResult
    from kaju.model.rheology.creeping_elements import TransferCreepResult
    from kaju.model.rheology.creeping_network import NetworkCreepResult
    from kaju.view.motion import Motion


MOST_FRAMES = 120
"""Longer runs are shown at so many of their moments."""


Forces = Sequence[tuple[list[float], list[float]]]
"""Places (m) and forces (N) of loads."""


@dataclass(frozen=True, eq=False)
class Pictures:
    """Parts at points, and what becomes of them."""

    points: Floats  # places at rest (m); shape (n, dimension)
    parts: NDArray[np.integer]
    """2 corners: a spring; 4: a square or a face's diamond; 8: a cube; else a polygon. Shape
    (parts, corners)."""
    at: Sequence[float] | Floats  # the moment of each frame
    along: str
    """What moments are: "s", "step", "generation", "stage"; "share" of an answer at rest, whose
    `moved` and `values` have one frame, for the whole load."""
    values: dict[str, tuple[str, NDArray[np.floating]]]
    """What parts can be coloured by: unit, and one number each, or one each a frame."""
    moved: NDArray[np.floating] | None = None
    """Displacements (m) of points, or of whole parts. Shape (frames, n or parts, dimension)."""
    born: NDArray[np.integer] | None = None  # from when on a part is there, in units of `at`
    gone: NDArray[np.integer] | None = None  # from when on it is no more; shape (parts,)
    curves: Sequence[Curves] = ()  # drawn beside it
    held: NDArray[np.integer] | None = None  # points that something holds
    forces: Forces = ()
    visits: Sequence[int] = ()  # level that acted before each frame, where blocks have parents
    outcome: str = ""  # how the run ended, in words
    ground: Sequence[dict[str, Any]] = ()
    """Where a body in the plane stands on what holds it; see `ground_of`."""
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
    pictures: Pictures = fetch(page)(result)
    scene = getattr(result, "scene", getattr(result, "subject", None))
    if isinstance(scene, Scene):
        pictures = replace(pictures, ground=ground_of(scene))
    return picture_data(pictures)


def picture_data(pictures: Pictures) -> tuple[dict[str, Any], Columns]:
    """Return the header and the columns of a page that shows parts."""
    none = np.empty(0, dtype=np.int64)
    held = none if pictures.held is None else pictures.held
    columns: Columns = {
        "points": pictures.points.astype(np.float32),
        "parts": pictures.parts.astype(np.uint32),
        "held": held.astype(np.uint32),
    }
    if pictures.moved is not None:
        columns["moved"] = pictures.moved.astype(np.float32)
    for name, column in (("born", pictures.born), ("gone", pictures.gone)):
        if column is not None:
            columns[name] = column.astype(np.uint32)
    for name, (_, values) in pictures.values.items():
        columns[f"value {name}"] = values.astype(np.float32)
    header = {
        "dimension": pictures.points.shape[1],
        "corners": pictures.parts.shape[1],
        "at": np.asarray(pictures.at, dtype=float).tolist(),
        "along": pictures.along,
        "colours": {name: unit for name, (unit, _) in pictures.values.items()},
        "curves": [curve_data(curves) for curves in pictures.curves],
        "forces": [{"place": place, "force": force} for place, force in pictures.forces],
        "visits": list(pictures.visits),
        "outcome": pictures.outcome,
        "ground": list(pictures.ground),
        "outlines": list(pictures.outlines),
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
    """Show a network stage by stage."""
    moved = np.linalg.norm(result.displacement, axis=2).max(axis=1)
    pull = {"pull": result.tension.max(axis=1), "push": result.tension.min(axis=1)}
    over = "stage", "", result.stage
    curves = [
        Curves("Displacement", *over, {"largest displacement": moved}, "m"),
        Curves("Largest forces", *over, pull, "N"),
    ]
    return _moving(motion.increments(result), "stage", curves, **_supports(result.network))


def network_in_time(result: NetworkCreepResult) -> Pictures:
    """Show a network that creeps."""
    moving = motion.network_times(result)
    return _moving(moving, "s", result.curves(), **_supports(result.network))


def body_in_time(result: TransferCreepResult | ElasticCreepResult) -> Pictures:
    """Show a body that creeps, with the largest strain and stress over time."""
    moving = _strained(result, motion.times(result))
    times = np.array([frame.time for frame in moving.frames])
    curves = [*result.curves()[:2]]
    for name in ("strain", "stress"):
        cells = [frame.values.get(name, np.zeros(1)) for frame in moving.frames]
        line = {name: np.array([values.max(initial=0.0) for values in cells])}
        curves.append(Curves(f"Largest {name}", "time", "s", times, line, _UNITS[name]))
    return _moving(moving, "s", curves, applied(result.static.scene))


def generations_of(result: TransferResult) -> Pictures:
    """Show load transfer on a lattice that the page does not know."""
    pictures = _moving(motion.generations(result), "generation", [], applied(result.scene))
    return replace(pictures, outcome=result.outcome)


def elastic_answer(result: ElasticResult) -> Pictures:
    """Show how agents spawned; of equal agents how they move with the load."""
    if result.spawned:
        return _spawned(result)
    loads = applied(solved_scene(result))
    pictures = _moving(motion.loaded(result), "share", [], loads, shares=21)
    return replace(pictures, outcome=stress_text(result))


_UNITS = {"tension": "N", "von_mises": "Pa", "load_taken": "N", "strain": "", "stress": "Pa"}


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


def element(result: CreepResult) -> Pictures:
    """Show one element: a bar, four times as long as it ever lengthens, held on its left."""
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


def _chosen(count: int) -> Ints:
    """Return the moments that are shown: all, or so many, evenly, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(np.int64))


def _supports(network: SpringNetwork) -> dict[str, Any]:
    """Return what holds and what loads a network."""
    force = network.forces[-1]
    acting = np.flatnonzero(force.any(axis=1))
    places = network.positions[acting].tolist()
    return {
        "forces": list(zip(places, force[acting].tolist(), strict=True)),
        "held": np.flatnonzero(network.held.any(axis=1)),
    }


def _moving(
    moving: Motion,
    along: str,
    curves: Sequence[Curves],
    forces: Forces,
    *,
    shares: int = 0,
    held: NDArray[np.integer] | None = None,
) -> Pictures:
    """Show points that move; `shares`: of an answer at rest, how many are shown."""
    frames = [moving.frames[k] for k in ([-1] if shares else _chosen(len(moving.frames)))]
    return Pictures(
        points=moving.points,
        parts=moving.parts,
        at=np.linspace(0.0, 1.0, shares) if shares else [frame.time for frame in frames],
        along=along,
        values={
            name: (_UNITS.get(name, ""), np.array([frame.values[name] for frame in frames]))
            for name in frames[-1].values
        },
        moved=np.array([frame.moved for frame in frames]),
        curves=curves,
        forces=forces,
        held=held,
    )


def _apart(corners: Floats) -> dict[str, Any]:
    """Return points and parts of cells that share no points, from their corners."""
    count, each, dimension = corners.shape
    parts = np.arange(count * each).reshape(count, each)
    return {"points": corners.reshape(-1, dimension), "parts": parts}


def applied(scene: Scene, stage: int | None = None) -> Forces:
    """Return the places and forces of a scene's loads, as few arrows."""
    applied = scene.applied(stage)
    arrows = force_arrows(scene, applied, np.arange(len(applied.force)))
    return list(zip(arrows.place.tolist(), arrows.force.tolist(), strict=True))


def ground_of(scene: Scene) -> list[dict[str, Any]]:
    """Return the lines (m) along which a body of squares is held, with the way out of it."""
    lattice = scene.lattice
    if scene.outlined or lattice.kind != "square" or lattice.size > MOST_CELLS:
        return []
    cells, lines = np.argwhere(scene.rasterise() >= 0), []
    for arm, normal in enumerate(lattice.normals):
        axis = int(np.abs(normal).argmax())
        kinds, step = scene.kinds(lattice.neighbours(cells, arm)), np.eye(2, dtype=int)[1 - axis]
        for kind, (name, _) in SUPPORTS.items():
            held = cells[kinds == kind]
            held = held[np.lexsort((held[:, 1 - axis], held[:, axis]))]
            begins = np.ones(len(held), dtype=np.bool_)
            begins[1:] = np.any(np.diff(held, axis=0) != step, axis=1)
            first = np.flatnonzero(begins)
            last = np.append(first[1:], len(held))[: len(first)] - 1
            side = 0.5 * (1.0 - step) + 0.5 * normal  # of a cell: where its face lies
            for one, other in zip(held[first], held[last], strict=True):
                ends = lattice.cell_size * np.array([one + side, other + side + step])
                line = {"from": ends[0].tolist(), "to": ends[1].tolist()}
                lines.append(line | {"out": normal.tolist(), "kind": name})
    return lines


def _spawned(result: ElasticResult) -> Pictures:
    """Show agents of every generation, each from when it spawned to when it retired."""
    family, generations = result.family, result.generations
    rows = family.rows
    # Of the agents that stand at the end also how they are stressed and move.
    standing, loaded = family.standing(len(generations) - 1), motion.loaded(result)
    order = [
        np.lexsort((size, *lower.T))
        for lower, size in (
            (family.lower[standing], family.size[standing]),
            (result.lower, result.size),
        )
    ]
    standing, own = standing[order[0]], order[1]
    stress = np.full((len(generations), len(family.size)), np.nan)
    stress[-1, standing] = result.von_mises[own]
    each, dimension = loaded.parts.shape[1], result.lower.shape[1]
    moved = np.zeros((len(generations), len(family.size), each, dimension))
    moved[-1, standing] = loaded.frames[-1].moved[loaded.parts[own]]
    corners = corner_order(result.lower.shape[1])
    at = np.arange(float(len(generations)))

    def curve(title: str, values: list[float], unit: str, logarithmic: bool = False) -> Curves:
        line = {title.rsplit(" ", 1)[-1].lower(): np.array(values)}
        return Curves(title, "generation", "", at, line, unit, logarithmic)

    retired = rows["retired_step"].astype(np.int64)
    return Pictures(
        **_apart(family.lower[:, None] + family.size[:, None, None] * corners),
        at=at,
        along="generation",
        values={
            "von_mises": ("Pa", stress),
            "level": ("", family.level.astype(float)),
            "gap": ("J", np.nan_to_num(rows["gap"])),
            **_opinions(result),
            "spawn_step": ("", rows["spawn_step"].astype(float)),
        },
        moved=moved.reshape(len(generations), -1, dimension),
        born=rows["spawn_step"].astype(np.int64),
        gone=np.where(retired < 0, len(generations), retired),
        curves=[
            curve("Agents", [float(g.agents) for g in generations], ""),
            curve("Error", [100.0 * error for error in errors_of(result)], "%", True),
            Curves("Strain energy", "generation", "", at, _energies(result), "J"),
        ],
        forces=applied(result.scene),
        outcome="; ".join([_error_of(result), stress_text(result)]),
    )


def _energies(result: ElasticResult) -> dict[str, Floats]:
    """Return the energy of every generation, or what is proved of it."""
    proved = np.array([(g.upper, g.lower) for g in result.generations], dtype=np.float64)
    if not np.isfinite(proved).all():
        return {"energy": np.array([g.energy for g in result.generations])}
    return {"at most": proved[:, 0], "at least": proved[:, 1]}


def _opinions(result: ElasticResult) -> dict[str, tuple[str, Floats]]:
    """Return the equivalent stress of each opinion, of every agent in every generation."""
    found, family = {}, result.family
    for name in ("fitted", "balanced"):
        values = np.full((len(result.generations), len(family.size)), np.nan)
        for number, generation in enumerate(result.generations):
            values[number, family.standing(number)] = getattr(generation, name)
        if not np.isnan(values).all():
            found[name] = ("Pa", values)
    return found


def _error_of(result: ElasticResult) -> str:
    """Return how many agents there are, their error, and between which bounds the energy lies."""
    words = f"{result.agents} agents, error {100.0 * result.error_estimate:.2g} %"
    if result.energy_bounds is None:
        return words
    lower, upper = (quantity(bound, "J") for bound in result.energy_bounds)
    return f"{words}, energy between {lower} and {upper}"


def growth_steps(result: GrowthResult) -> Pictures:
    """Show densities step by step; of the last step alone if no other were kept."""
    lattice = result.scene.lattice
    corners = lattice.cell_size * (corner_order(lattice.dimension) - 0.5)
    steps = _chosen(result.steps + 1) if len(result.designs) else np.array([result.steps])
    designs = result.designs[steps] if len(result.designs) else result.cells[None]
    over = ("step", "", np.arange(result.steps + 1.0))
    return Pictures(
        **_apart(lattice.centres(np.argwhere(result.body))[:, None] + corners),
        at=steps.astype(float),
        along="step",
        values={"density": ("", np.rint(256.0 * designs) / 256.0)},  # more would not deflate
        curves=[
            Curves("Compliance", *over, {"compliance": result.compliances}, "J"),
            Curves("Volume", *over, {"volume": 100.0 * result.volumes}, "%"),
        ],
        forces=applied(result.scene, result.stage),
        outcome=result.outcome,
    )


def breaks(result: FractureResult) -> Pictures:
    """Show springs or cells, each until it breaks, under the load of the last break; first bare."""
    counts = _chosen(result.breaks + 1)
    drawn = [bearing(result, count) for count in counts.tolist()]
    moved, borne = [], []
    for count, at, body in zip(counts, drawn, result.replayed(drawn), strict=True):
        factor = result.factor_after(at) if count else 0.0
        moved.append(_steps_of(factor * body.displacement(), 128))
        bears = (
            factor * body.borne()
            if count <= result.breaks_resisted
            else np.zeros(len(body.borne()))
        )
        borne.append(_steps_of(bears, 128))
    points, parts = body.points
    gone = np.full(len(parts), result.breaks + 1)
    gone[result.broken] = np.arange(1, result.breaks + 1)
    force, way = (np.append(0.0, column) for column in (result.force, result.displacement))
    # What bears hardly anything any more moves so far that the rest would not be seen.
    loaded = 1 + np.flatnonzero(force >= 0.02 * force.max())[-1]
    load = {"load": force[:loaded]}
    sizes = [0, *(k + 1 for size in result.avalanche_sizes for k in range(size))]
    energy = {
        name: np.append(0.0, getattr(result, name)) for name in ("work", "stored", "released")
    }
    over = ("break", "", np.arange(result.breaks + 1.0))
    supports: dict[str, Any]
    if isinstance(result.subject, Scene):
        name, supports = "stress", {"forces": applied(result.subject)}
    else:
        name, supports = "tension", _supports(result.subject)
    return Pictures(
        points=points,
        parts=parts,
        at=counts.astype(float),
        along="break",
        values={name: (_UNITS[name], np.array(borne))},
        moved=np.array(moved),
        gone=gone,
        curves=[
            Curves("Load", *over, {"load": force}, "N"),
            Curves("Load over displacement (m)", "displacement", "m", way[:loaded], load, "N"),
            Curves("Breaks of the avalanche", *over, {"size": np.array(sizes, dtype=float)}, ""),
            Curves("Energy", *over, energy, "J"),
        ],
        **supports,
        outcome=result.outcome,
    )


def _steps_of(values: Floats, count: int) -> Floats:
    """Round to so many steps or more up to the largest: other digits would not deflate."""
    most = float(np.abs(values).max(initial=0.0)) or 1.0
    step = 2.0 ** np.floor(np.log2(most / count))
    return np.asarray(step * np.rint(values / step))


def diamonds(middle: Floats, h: float) -> dict[str, Any]:
    """Return points and parts that stand for faces of cells of an edge h (m)."""
    corners = 0.5 * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if middle.shape[1] == 3:
        corners = 0.5 * (corner_order(3) - 0.5)
    return _apart(middle[:, None] + h * corners)


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


def elastic_agents(run: ElasticRun) -> Pictures:
    """Show agents on the faces of the cells."""
    agents, moments = run.agents, run.moments
    own = agents.level == 0
    # Most happens in the first steps, so the moments shown lie ever farther apart.
    last = len(moments.step)
    chosen = np.unique(np.geomspace(1, last, min(last, MOST_FRAMES)).round().astype(np.int64)) - 1
    shape = None
    if moments.displacement is not None:
        axis, places = agents.axis[own], agents.position[own] / run.grid.lattice.cell_size
        across = axis[:, None] != np.arange(places.shape[1])
        index = np.rint(places - 0.5 * across).astype(np.int64) + 1
        fields = [np.pad(field, 1, constant_values=np.nan) for field in run.displacement]
        moving = MovingFaces(axis, index, fields)
        moved = [moving.at(now[own].astype(float)) for now in moments.displacement[chosen]]
        bits = np.stack(moved).astype(np.float32).view(np.uint32)
        shape = ((bits + 0x80) & np.uint32(0xFFFFFF00)).view(np.float32)  # more would not deflate
    return Pictures(
        **diamonds(agents.position[own], run.grid.lattice.cell_size),
        at=moments.step[chosen].astype(float),
        along="step",
        values={
            "load_left": ("N", np.abs(moments.left[chosen][:, own]).astype(float)),
            "load_taken": ("N", moments.taken[chosen][:, own].astype(float)),
        },
        moved=shape,
        born=agents.spawn_step[own],
        curves=run.curves(),
        forces=applied(run.scene),
        visits=moments.level[chosen].tolist(),
        outcome=run.outcome,
    )
