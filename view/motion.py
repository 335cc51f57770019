"""Runs that move: parts at points, with values and displacements a frame.

Spring networks, creep, agents, elastic answers, bodies that grow or break: pages replay them, and
`animation` writes those whose parts stay the same as files for Blender or ParaView.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.results.mesh import corner_order
from kaju.model.results.result import BodyResult, Curves, solved_scene
from kaju.model.scene import Scene
from kaju.model.transfer.transfer_result import TransferResult

from .body_plots import force_arrows
from .charts import fracture_curves, growth_curves, last_loaded, network_curves
from .deformed import Joined, join, stress_text
from .films import evenly
from .layers import arrows_of, rings_of
from .quadtree import errors_of
from .section import Arrows
from .units import quantity

if TYPE_CHECKING:
    from kaju.model.elastic.relaxation.elastic_run import ElasticRun
    from kaju.model.fracture.fracture_result import FractureResult
    from kaju.model.growth.growth_result import GrowthResult
    from kaju.model.network import NetworkResult, SpringNetwork
    from kaju.model.rheology.creep_result import CreepResult
    from kaju.model.rheology.creeping_elastic import ElasticCreepResult
    from kaju.model.rheology.creeping_elements import TransferCreepResult
    from kaju.model.rheology.creeping_network import NetworkCreepResult

MOST_FRAMES = 120
"""Longer runs are shown in pages at so many of their moments."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Parts at points, and what becomes of them."""

    points: Floats  # places at rest (m); shape (n, dimension)
    parts: NDArray[np.integer]
    """2 corners: a spring; 4: a square or a face's diamond; 8: a cube, as VTK has them; else a
    polygon. Shape (parts, corners)."""
    at: Sequence[float] | Floats  # the moment of each frame
    along: str  # what moments are: "s", "step", "generation", "stage", "break", "share" of the load
    values: Mapping[str, tuple[str, NDArray[np.floating]]]
    """What parts can be coloured by: unit, and one number each, or one each a frame."""
    moved: NDArray[np.floating] | None = None
    """Displacements (m) of points, or of whole parts. Shape (frames, n or parts, dimension)."""
    born: NDArray[np.integer] | None = None  # from when on a part is there, in units of `at`
    gone: NDArray[np.integer] | None = None  # from when on it is no more; shape (parts,)
    curves: Sequence[Curves] = ()  # drawn beside it
    held: NDArray[np.integer] | None = None  # points that something holds
    forces: Arrows | None = None
    shares: Floats | None = None  # which part of the forces acts in each frame, all of it if None
    visits: Sequence[int] = ()  # level that acted before each frame, where blocks have parents
    outcome: str = ""  # how the run ended, in words
    outlines: Sequence[int] = ()
    """How many points each closed line has within which parts are shown; these are the last."""


def applied(scene: Scene, stage: int | None = None) -> Arrows:
    """Return a scene's loads as few arrows."""
    applied = scene.applied(stage)
    return force_arrows(scene, applied, np.arange(len(applied.force)))


def _apart(corners: Floats) -> dict[str, Any]:
    """Return points and parts of cells that share no points, from their corners."""
    count, each, dimension = corners.shape
    parts = np.arange(count * each).reshape(count, each)
    return {"points": corners.reshape(-1, dimension), "parts": parts}


def _body(result: BodyResult) -> tuple[Joined, Ints]:
    """Return the cells of a result's grid, and where they are."""
    lattice = result.grid.lattice
    cells = np.argwhere(result.grid.rasterise() >= 0)
    if lattice.boxes:
        forms = lattice.cell_size * (corner_order(lattice.dimension) - 0.5)[None]
    else:
        forms = np.stack([lattice.outline(form) for form in range(lattice.forms)])
    corners = lattice.centres(cells)[:, None] + forms[lattice.form(cells)]
    return join(corners, np.diag(lattice.pitch)), cells


def _so_far(result: TransferResult, generation: int) -> TransferResult:
    """Return a run with what its last stage had taken up to a generation."""
    stage, history = result.last, result.last.history
    then = history.generation <= generation
    taken = np.zeros_like(stage.taken)
    np.add.at(taken, (history.agent[then], history.direction[then]), history.load[then])
    # What deforms a cell grows with the loads along each axis, pulls counted against pushes.
    axis = result.scene.lattice.axis_of[history.direction]
    load = np.where(history.pull, -history.load, history.load)
    grown, whole = np.zeros_like(stage.kept), np.zeros_like(stage.kept)
    np.add.at(whole, (history.agent, axis), load)
    np.add.at(grown, (history.agent[then], axis[then]), load[then])
    share = np.divide(grown, whole, out=np.zeros_like(grown), where=whole != 0.0)
    deforming = {n: share * getattr(stage, n) for n in ("kept", "shortened", "widened")}
    return replace(result, stages=(*result.stages[:-1], replace(stage, taken=taken, **deforming)))


def generations(result: TransferResult) -> Motion:
    """Return the last stage of a run, generation by generation."""
    count = result.last.generations + 1
    return _transfer(result, [_so_far(result, number) for number in range(count)], "generation")


def stages(result: TransferResult) -> Motion:
    """Return a run at rest, and at the end of every stage of loading."""
    ended = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    return _transfer(result, [_so_far(ended[0], 0), *ended], "stage")


def _transfer(result: TransferResult, states: Sequence[TransferResult], along: str) -> Motion:
    body, cells = _body(result)
    taken = [one.at_cells(cells, one.last.taken.sum(axis=1)) for one in states]
    return Motion(
        points=body.points,
        parts=body.parts,
        at=np.arange(float(len(states))),
        along=along,
        values={"load_taken": ("N", np.array(taken))},
        moved=np.array([body.moved(state.displacement_at) for state in states]),
        forces=applied(result.scene),
        outcome=result.outcome,
    )


def loaded(result: ElasticResult) -> Motion:
    """Return an elastic body at rest and under its load."""
    d = result.lower.shape[1]
    places = result.lower[:, None] + result.size[:, None, None] * corner_order(d)
    body = join(places, np.full(d, result.size.min()))
    values = {"von_mises": ("Pa", result.largest_von_mises), "level": ("", 1.0 * result.level)}
    moved = body.moved(result.displacement_near)
    return Motion(
        points=body.points,
        parts=body.parts,
        at=[0.0, 1.0],
        along="share",
        values={name: (unit, np.stack([0.0 * of, of])) for name, (unit, of) in values.items()},
        moved=np.stack([0.0 * moved, moved]),
        forces=loads_of(result),
        outcome=_stress_of(result),
    )


def network(result: NetworkResult | NetworkCreepResult) -> Motion:
    """Return the states of a spring network along its load path, or in time."""
    creeps, own = result.kind == "network in time", cast(Any, result)
    still: NetworkResult = own.to_network_result() if creeps else own
    return Motion(
        points=still.network.positions,
        parts=still.network.springs,
        at=own.times if creeps else still.stage,
        along="s" if creeps else "stage",
        values={"tension": ("N", np.asarray(still.tension))},
        moved=np.asarray(still.displacement),
        curves=own.curves() if creeps else network_curves(still),
        shares=own.factors if creeps else still.stage if still.network.stages == 1 else None,
        **_supports(still.network),
    )


def _supports(network: SpringNetwork) -> dict[str, Any]:
    """Return what holds and what loads a network."""
    force = network.forces[-1]
    acting = np.flatnonzero(force.any(axis=1))
    return {
        "forces": Arrows(network.positions[acting], force[acting], acting >= 0),
        "held": np.flatnonzero(network.held.any(axis=1)),
    }


def body_in_time(result: TransferCreepResult | ElasticCreepResult) -> Motion:
    """Return a body that creeps, with the largest strain and stress (principal, by size)."""
    static, times = result.static, np.asarray(result.times, dtype=np.float64)
    body, cells = _body(static)
    lattice, records = static.grid.lattice, range(len(times))
    moved = np.array(
        [body.moved(lambda at, k=k: result.displacement_at(at, k)) for k in records]  # type: ignore[misc]
    )
    stress = [np.asarray(result.stress(record)) for record in records]
    if isinstance(static, TransferResult):
        stress = [static.at_cells(cells, of) for of in stress]
    else:
        stress = [of[tuple(cells.T)] for of in stress]
    units = {"stress": "Pa", "strain": ""}
    values = {"stress": np.array(list(map(_principal, stress)))}
    if lattice.boxes:  # what the corners move apart by, over the edge
        signs = 2.0 * corner_order(lattice.dimension) - 1.0
        corners = moved[:, body.parts] * (2.0 / len(signs) / lattice.cell_size)
        gradient = np.einsum("tnca,cb->tnab", corners, signs)
        values["strain"] = _principal(0.5 * (gradient + np.swapaxes(gradient, 2, 3)))
    curves = [*result.curves()[:2]]
    for name in ("strain", "stress"):
        line = {name: values.get(name, np.zeros((len(times), 1))).max(axis=1, initial=0.0)}
        curves.append(Curves(f"Largest {name}", "time", "s", times, line, units[name]))
    return Motion(
        points=body.points,
        parts=body.parts,
        at=times,
        along="s",
        values={name: (units[name], of) for name, of in values.items()},
        moved=moved,
        curves=curves,
        forces=applied(static.scene),
        shares=np.asarray(result.factors),
    )


def _principal(tensors: Floats) -> Floats:
    """Return the size of the largest principal value of each tensor."""
    return np.asarray(np.abs(np.linalg.eigvalsh(tensors)).max(axis=-1, initial=0.0))


def element(result: CreepResult) -> Motion:
    """Return one element: a bar, four times as long as it ever lengthens, held on its left."""
    times, moved = result.times, result.displacement
    long = 4.0 * float(np.abs(moved).max(initial=0.0)) or 1.0
    shift = np.zeros((len(times), 4, 2))
    shift[:, 1:3, 0] = moved[:, None]
    return Motion(
        points=long * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.25], [0.0, 0.25]]),
        parts=np.arange(4)[None],
        at=times,
        along="s",
        values={"force": ("N", result.force[:, None])},
        moved=shift,
        curves=result.curves(),
        held=np.array([0, 3]),
    )


def elastic_answer(result: ElasticResult) -> Motion:
    """Return agents of every generation, each from when it spawned to when it retired.

    Of equal agents how they move with the load.
    """
    if not result.spawned:
        return loaded(result)
    family, count = result.family, len(result.generations)
    rows, dimension = family.rows, result.lower.shape[1]
    # Of the agents that stand at the end also how they are stressed and move.
    standing, end = family.standing(count - 1), loaded(result)
    stress = np.full((count, len(family.size)), np.nan)
    stress[-1, standing] = result.largest_von_mises
    moved = np.zeros((count, len(family.size), end.parts.shape[1], dimension))
    assert end.moved is not None
    moved[-1, standing] = end.moved[-1][end.parts]
    values = {"von_mises": ("Pa", stress), "level": ("", family.level.astype(float))}
    values |= _opinions(result)
    values["spawn_step"] = "", rows["spawn_step"].astype(float)
    over = "step", "", np.arange(float(count))
    agents = {"agents": np.array([float(g.agents) for g in result.generations])}
    errors = {"error": 100.0 * np.array(errors_of(result))}
    retired = rows["retired_step"].astype(np.int64)
    shown = Motion(
        **_apart(family.lower[:, None] + family.size[:, None, None] * corner_order(dimension)),
        at=np.arange(float(count)),
        along="generation",
        values=values,
        moved=moved.reshape(count, -1, dimension),
        born=rows["spawn_step"].astype(np.int64),
        gone=np.where(retired < 0, count, retired),
        curves=[
            Curves("Agents", *over, agents, ""),
            Curves("Error", *over, errors, "%", logarithmic=True),
            Curves("Strain energy", *over, _energies(result), "J"),
        ],
        forces=loads_of(result),
        outcome="; ".join([_error_of(result), _stress_of(result)]),
    )
    return _within_outlines(result, shown)


def _within_outlines(result: ElasticResult, shown: Motion) -> Motion:
    """Return agents as their body's true outlines cut them, if it has any."""
    found = result.cut_agents
    if found is None or shown.moved is None:
        return shown
    rings = rings_of(found)
    places, moved = (np.concatenate(part) for part in zip(*rings, strict=True))
    still = np.zeros((len(shown.moved) - 1, *moved.shape))
    drawn = []
    for name, along in found.along.items():  # stress over the way along the outline
        (x, y), stress = result.outline_stress(name)[0].T, result.outline_stress(name)[1]
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))[: len(stress)]
        if held := name in found.ground.rigid.values():  # a glued edge bears more than hoop stress
            stress = found.scales.stress * along.von_mises
        turn = "\u21ba" if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0 else "\u21bb"
        start = f"0 = ({x[0]:.3g}, {y[0]:.3g}) m {turn}"
        what = "Equivalent stress" if held else "Hoop stress"
        drawn.append(Curves(f"{what}: {name}", start, "m", way, {what.lower(): stress}, "Pa"))
    return replace(
        shown,
        points=np.concatenate([shown.points, places]),
        moved=np.concatenate([shown.moved, np.concatenate([still, moved[None]])], axis=1),
        curves=[*shown.curves, *drawn],
        outlines=[len(ring) for ring, _ in rings],
    )


def loads_of(result: ElasticResult) -> Arrows:
    """Return what acts on an elastic body as few arrows."""
    cut = result.cut_agents
    return applied(solved_scene(result)) if cut is None else arrows_of(cut)


def _energies(result: ElasticResult) -> dict[str, Floats]:
    """Return the energy of every generation, or what is proved of it."""
    proved = np.array([(g.upper, g.lower) for g in result.generations], dtype=np.float64)
    if not np.isfinite(proved).all():
        return {"energy": np.array([g.energy for g in result.generations])}
    return {"at most": proved[:, 0], "at least": proved[:, 1]}


def _opinions(result: ElasticResult) -> dict[str, tuple[str, Floats]]:
    """Return the gap and the stress of each opinion, of every agent in every generation."""
    found, family = {}, result.family
    for name, unit in {"gap": "J", "fitted": "Pa", "balanced": "Pa"}.items():
        values = np.full((len(result.generations), len(family.size)), np.nan)
        for number, generation in enumerate(result.generations):
            values[number, family.standing(number)] = getattr(generation, name)
        if not np.isnan(values).all():
            found[name] = (unit, values)
    return found


def _stress_of(result: ElasticResult) -> str:
    """Return the largest stress, and some corners at which it has no limit: steps all have none."""
    plane = result.lower.shape[1] == 2 and not result.stepped
    corners = result.sharp_corners.tolist() if plane else []
    at = [f"({', '.join(quantity(x, 'm') for x in corner)})" for corner in corners[:3]]
    no_limit = f"; stress at corners, without limit: {', '.join(at)}{', …' * (len(corners) > 3)}"
    return stress_text(result) + (no_limit if corners else "")


def _error_of(result: ElasticResult) -> str:
    """Return how many agents there are, their error, and between which bounds the energy lies."""
    words = (
        f"{result.agents} agents, error in the energy norm {100.0 * result.error_estimate:.2g} %"
    )
    if result.energy_bounds is None:
        return words
    lower, upper = (quantity(bound, "J") for bound in result.energy_bounds)
    return f"{words}, energy " + (lower if lower == upper else f"between {lower} and {upper}")


def growth_steps(result: GrowthResult) -> Motion:
    """Return densities step by step, also with the sign of pull or push."""
    lattice = result.scene.lattice
    corners = lattice.cell_size * (corner_order(lattice.dimension) - 0.5)
    steps = evenly(result.steps + 1, MOST_FRAMES)
    density = _steps_of(result.designs[steps], 256)
    pull = np.where(result.pulled[steps], density, -density)
    return Motion(
        **_apart(lattice.centres(np.argwhere(result.body))[:, None] + corners),
        at=steps.astype(float),
        along="step",
        values={"density": ("", density), "pull": ("", pull)},
        curves=growth_curves(result),
        forces=applied(result.scene, result.stage),
        outcome=result.outcome,
    )


def breaks(result: FractureResult) -> Motion:
    """Return springs or cells, each until it breaks; a frame is the moment of its last break."""
    counts, last = evenly(result.breaks + 1, MOST_FRAMES), last_loaded(result)
    factors = np.append(0.0, result.load_factor)[counts]  # the first frame is that of no load
    bodies = zip(factors, result.replayed(np.maximum(counts - 1, 0).tolist()), strict=True)
    frames = [(_steps_of(f * b.displacement(), 128), f * b.borne()) for f, b in bodies]
    moved, borne = map(np.array, zip(*frames, strict=True))
    moved[counts > last] = moved[counts <= last][-1]
    points, parts = next(result.replayed([0])).points
    gone = np.full(len(parts), result.breaks + 2)
    gone[result.broken] = np.arange(2, result.breaks + 2)
    supports: dict[str, Any]
    if isinstance(result.subject, Scene):
        name, unit, supports = "stress", "Pa", {"forces": applied(result.subject)}
    else:
        name, unit, supports = "tension", "N", _supports(result.subject)
    values = {name: (unit, _steps_of(borne, 1024))}
    if result.measure in ("force", "stress"):
        values["strength"] = unit, _steps_of(result.strengths, 1024)
        values["used"] = "%", _steps_of(100.0 * np.maximum(borne, 0.0) / result.strengths, 128)
    return Motion(
        points=points,
        parts=parts,
        at=counts.astype(float),
        along="break",
        values=values,
        moved=moved,
        gone=gone,
        curves=fracture_curves(result),
        shares=factors,
        **supports,
        outcome=result.outcome,
    )


def _steps_of(values: NDArray[np.floating], count: int) -> Floats:
    """Round to so many steps or more up to the largest: other digits would not deflate."""
    most = float(np.abs(values).max(initial=0.0)) or 1.0
    step = 2.0 ** np.floor(np.log2(most / count))
    return np.asarray(step * np.rint(values / step))


def elastic_agents(run: ElasticRun) -> Motion:
    """Return agents on the faces of the cells, each a diamond, or a small cube in space."""
    agents, moments, h = run.agents, run.moments, run.grid.lattice.cell_size
    own = agents.level == 0
    # Most happens in the first steps, so the moments shown lie ever farther apart.
    last = len(moments.step)
    chosen = np.unique(np.geomspace(1, last, min(last, MOST_FRAMES)).round().astype(np.int64)) - 1
    corners = 0.5 * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    if agents.position.shape[1] == 3:
        corners = 0.5 * (corner_order(3) - 0.5)
    along = moments.displacement[chosen][:, own].astype(float)
    bits = _faces_moved(run, along).astype(np.float32).view(np.uint32)
    moved = ((bits + 0x80) & np.uint32(0xFFFFFF00)).view(np.float32)  # more would not deflate
    return Motion(
        **_apart(agents.position[own][:, None] + h * corners),
        at=moments.step[chosen].astype(float),
        along="step",
        values={
            "load_left": ("N", np.abs(moments.left[chosen][:, own]).astype(float)),
            "load_taken": ("N", moments.taken[chosen][:, own].astype(float)),
        },
        moved=moved,
        born=agents.spawn_step[own],
        curves=run.curves(),
        forces=applied(run.scene),
        visits=[run.history[step - 1].level if step else 0 for step in moments.step[chosen]],
        outcome=run.outcome,
    )


def _faces_moved(run: ElasticRun, along: Floats) -> Floats:
    """Return displacements (m), shape (frames, faces, dimension), from those along the normals.

    A face moves along its normal; across it goes with the mean of the faces round it.
    """
    from scipy.spatial import cKDTree

    own = run.agents.level == 0
    axis, places = run.agents.axis[own], run.agents.position[own] / run.grid.lattice.cell_size
    d = places.shape[1]
    moved = np.where(axis[:, None] == np.arange(d), along[..., None], 0.0)
    for a, b in permutations(range(d), 2):
        one, other = axis == a, axis == b
        far, near = cKDTree(places[other]).query(places[one], 4, distance_upper_bound=0.8)
        known = np.pad(along[:, other], [(0, 0), (0, 1)])  # the last for faces that are not there
        moved[:, one, b] = known[:, near].sum(axis=2) / np.isfinite(far).sum(axis=1).clip(1)
    return moved
