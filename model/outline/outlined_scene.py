"""Scenes with true outlines, solved: agents whole, cut by an outline, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import gcd
from time import perf_counter
from typing import cast

import numpy as np

from kaju.errors import ConvergenceError, SceneError, SupportError
from kaju.model.elastic.goals.quantities import AskedFor
from kaju.model.elastic.refine.solve_spawning import check_previous
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import NOT_BODY
from kaju.model.scene.regions import Region
from kaju.model.scene.shapes import OutlinedShape

from .arc_triangles import ArcFrames, TouchError, keep_apart
from .balanced_pieces import LooseError
from .laws import AIR, Law
from .outline_bracket import OutlineBracket, error_between, rounding_of, spawn
from .outline_peak import OutlinePeak, peak_asked
from .outline_problem import SIDES, LoadedOutline, OutlineProblem, UnlikeError
from .outline_result import CutAgents, OutlineResult
from .square_leaves import SquareLeaves
from .true_shapes import TrueBody, TrueRegion, TrueShape, nested

TOLERANCE = 0.01
MOST_AGENTS = 100_000
FIRST = 8  # first agents along the longer side, where the cells' number has such a divisor


def solve_outlined(
    scene: Scene,
    tolerance: float | None,
    most_agents: int | None,
    previous: OutlineResult | None = None,
    tolerance_at: AskedFor | None = None,
) -> OutlineResult:
    """Return the answer to a scene with true outlines, proved to a tolerance; see `kaju.solve`."""
    start = perf_counter()
    goal = peak_asked(scene, tolerance_at)
    if previous is not None:
        tolerance = previous.tolerance if tolerance is None else tolerance
        goal = previous.tolerance_at if tolerance_at is None else goal
    tolerance = TOLERANCE if tolerance is None else tolerance
    problem, edge = problem_of(scene)
    peak = None
    if goal is not None:
        name = str(goal[0].at)
        which = [region.name for region in scene.body.regions].index(name)
        _check_alone(problem.body.regions, which, f"goal: {name!r}", "peak")
        peak = OutlinePeak(which, name, problem, edge, tolerance)
    before = None
    if previous is not None:
        check_previous(previous.scene.lattice, scene.lattice)
        if _serves(previous, scene) and tolerance <= previous.tolerance:
            # of a peak the change is asked for that the last generation made
            again = peak is not None and goal == previous.tolerance_at and previous.earlier
            last = previous.earlier[-1] if again else previous
            before = SquareLeaves(last.x, last.y, last.width, problem.shape)
    rounding = rounding_of(problem)
    left = error_between((1.0 - rounding, 1.0 + rounding))
    if peak is None and len(problem.body.laws) > 1 and left > tolerance:
        raise SceneError(
            f"body.regions: materials this unlike leave an error of {left:.2g} to rounding alone, "
            f"above the tolerance of {tolerance:g}; take a larger one, rigid sides for what is all "
            "but rigid, or air for what is all but air"
        )

    generations: list[CutAgents] = []

    def keep(found: OutlineBracket) -> None:
        generations.append(CutAgents.of_bracket(scene, problem, found, edge))

    def result(found: OutlineBracket) -> OutlineResult:
        how = problem, found, edge, tolerance, perf_counter() - start
        of_peak = None if peak is None else (peak.value, peak.off, peak.error)
        return OutlineResult.of(scene, *how, generations, goal, of_peak)

    try:
        aim = peak.aim if peak is not None else None
        return result(spawn(problem, tolerance, most_agents or MOST_AGENTS, before, keep, aim))
    except ConvergenceError as error:
        best = result(cast(OutlineBracket, error.best))
        raise ConvergenceError(str(error), error.residuals, best) from None
    except LooseError:
        raise SupportError(
            "sides: the body, or a part of it that is loaded, could move without straining; hold "
            'it by [sides] such as left = "rigid"'
        ) from None
    except UnlikeError as error:
        raise SceneError(
            f"body.regions: the outlines could not be resolved ({error}); outlines that all but "
            "touch the lines between agents, or are covered by another region, do so: move one "
            "by a little; so does plane strain where Poisson's ratio is all but 1/2"
        ) from None


def _serves(previous: OutlineResult, scene: Scene) -> bool:
    """Tell whether agents may begin as those of a previous answer ended."""
    places = [
        ({(load.side, load.outline) for load in one.loads}, any(one.body.gravity or ()))
        for one in (previous.scene, scene)
    ]
    return scene.same_body(previous.scene) and places[0] == places[1]


def problem_of(scene: Scene) -> tuple[OutlineProblem, float]:
    """Return what is solved, and the edge (m) of the first agents."""
    lattice = scene.lattice
    nx, ny = lattice.shape
    common = gcd(nx, ny)
    wide = [d for d in range(1, common + 1) if common % d == 0 and max(nx, ny) // d >= FIRST]
    cells = max(wide, default=1)
    edge = lattice.cell_size * cells
    shape = (nx // cells, ny // cells)
    body = _body(scene, edge, shape)
    modulus = scene.cell_materials[0].youngs_modulus
    held: dict[str, tuple[int, ...]] = {}
    for name in SIDES:
        kind = scene.side_condition(name).kind
        if kind != "free":
            held[name] = (0, 1) if kind == "rigid" else (SIDES[name][0],)
    # stresses as strains of the modulus, forces as such over edges
    unit = modulus * scene.thickness * edge
    forces = {str(load.side): np.zeros(2) for load in scene.loads if load.side is not None}
    tractions = {side: np.zeros(2) for side in forces}
    outlines: list[LoadedOutline] = []
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            outlines.append(_outline_load(scene, number, body, shape, unit))
            if any(one.name == load.outline for one in outlines[:-1]):
                raise SceneError(
                    f"loads.{number}.outline: {load.outline!r} is loaded already; give one load"
                )
        elif load.pressure is not None:
            axis, upper = SIDES[str(load.side)]
            tractions[str(load.side)][axis] -= load.pressure / modulus * (1 if upper else -1)
        else:
            forces[str(load.side)] += np.array(load.force) / unit
    weight = np.zeros(2)
    if scene.body.gravity is not None and any(scene.body.gravity):
        density = scene.cell_materials[0].density
        assert density is not None
        weight = density * edge / modulus * np.array(scene.body.gravity, dtype=np.float64)
        for number, one in enumerate(body.regions):
            if ArcFrames(one.shape.arcs).turn.any():
                what = f"body.gravity: regions.{number} bends and"
                _check_alone(body.regions, number, what, "weight")
    stresses = [one.stress for one in outlines]
    acting = [*forces.values(), *tractions.values(), *stresses, weight]
    strain = max(float(np.abs(one).max()) for one in acting)
    if strain == 0.0:
        raise SceneError(
            "loads: without a load or gravity, or with loads of sides that cancel, there is no "
            "energy to bound; give one of them"
        )
    # refuses what no number holds
    Scales.of(modulus, strain * unit, edge, modulus * scene.thickness)
    problem = OutlineProblem(
        body,
        shape,
        held,
        {side: force / strain for side, force in forces.items()},
        {side: traction / strain for side, traction in tractions.items()},
        tuple(replace(one, stress=one.stress / strain) for one in outlines),
        weight / strain,
        strain,
    )
    return problem, edge


def _outline_load(
    scene: Scene, number: int, body: TrueBody, shape: tuple[int, int], unit: float
) -> LoadedOutline:
    """Return what a load does along an outline; refuse an outline that cannot be loaded."""
    load, where = scene.loads[number], f"loads.{number}.outline"
    name = str(load.outline)
    which = [region.name for region in scene.body.regions].index(name)
    _check_alone(body.regions, which, f"{where}: {name!r}", "load")
    _check_body_ends(scene, which, where)
    region = body.regions[which]
    if load.pressure is not None:
        stress = -load.pressure / scene.cell_materials[0].youngs_modulus * np.eye(2)
        found = LoadedOutline(name, region.shape, region.solid, stress)
    else:
        total = np.array(load.force) / unit
        found = LoadedOutline.pushed(name, region.shape, region.solid, total, shape)
        if total.any() and not found.stress.any():
            raise SceneError(f"loads.{number}.force: nothing of {name!r} faces it")
    if not len(found.taking(shape)):
        raise SceneError(f"{where}: nothing of {name!r} lies within the array")
    return found


def _check_alone(regions: Sequence[TrueRegion], which: int, what: str, borne: str) -> None:
    """Refuse what an outline bears where it meets another one."""
    for other, beside in enumerate(regions):
        if other != which and not keep_apart(regions[which].shape.arcs, beside.shape.arcs):
            raise SceneError(
                f"{what} meets the outline of regions.{other}; a {borne} is known along outlines "
                "that are alone: draw both as one path"
            )


def _check_body_ends(scene: Scene, which: int, where: str) -> None:
    """Refuse a load on an outline, which meets no other, that is not where the body ends."""
    body = scene.body
    shapes = [
        region.shape_in(scene.lattice, f"body.regions.{number}")
        for number, region in enumerate(body.regions)
    ]
    at = cast(OutlinedShape, shapes[which]).outline()[0][:1, 0]
    place, below, region = at[:, :2] / at[:, 2:], body.material, body.regions[which]
    for number, other in enumerate(body.regions):
        if number == which or not shapes[number].contains(place)[0]:
            continue
        if number > which:
            raise SceneError(f"{where}: {region.name!r} is covered by regions.{number}")
        below = other.material
    if (region.material in NOT_BODY) == (below in NOT_BODY):
        raise SceneError(
            f"{where}: {region.name!r} is {region.material} in {below}; loads act where the body "
            "ends, not between two materials, or in the air"
        )


def laws_of(scene: Scene) -> dict[str, Law]:
    """Return the law of each material by name; the first one's Young's modulus is 1."""
    names = [scene.body.material, *(region.material for region in scene.body.regions)]
    found = dict.fromkeys(name for name in names if name is not None and name not in NOT_BODY)
    unit = scene.cell_materials[0].youngs_modulus
    return {
        name: Law.of(
            material.youngs_modulus / unit, material.poissons_ratio, scene.plane or "stress"
        )
        for name, material in zip(found, scene.cell_materials, strict=True)
    }


def _body(scene: Scene, edge: float, shape: tuple[int, int]) -> TrueBody:
    laws = laws_of(scene)
    regions = [
        TrueRegion(
            _shape(scene, region, f"body.regions.{number}", edge, shape),
            laws.get(region.material, AIR),
        )
        for number, region in enumerate(scene.body.regions)
    ]
    return TrueBody(laws.get(str(scene.body.material), AIR), tuple(regions))


def _shape(
    scene: Scene, region: Region, where: str, edge: float, shape: tuple[int, int]
) -> TrueShape:
    try:
        lines = cast(OutlinedShape, region.shape_in(scene.lattice, where)).outline()
        return nested([np.asarray(arcs / [edge, edge, 1.0]) for arcs in lines], shape)
    except TouchError:
        raise SceneError(
            f"{where}: its outline crosses or touches itself; split it in two"
        ) from None
