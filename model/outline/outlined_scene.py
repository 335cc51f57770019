"""Scenes with true outlines, solved: agents whole, cut by an outline, or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import gcd
from time import perf_counter
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from kaju.errors import ConvergenceError, SceneError, SupportError
from kaju.model.elastic.goals.quantities import ToleranceAt
from kaju.model.elastic.problem import Scales
from kaju.model.elastic.refine.solve_spawning import check_previous
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import NOT_BODY
from kaju.model.scene.regions import Region
from kaju.model.scene.shapes import OutlinedShape

from .arc_triangles import ArcFrames, TouchError, keep_apart
from .balanced_pieces import LooseError
from .laws import AIR, Law
from .mixed_body import MixedBody, MixedRegion
from .outline_bracket import OutlineBracket, error_between, rounding_of, spawn
from .outline_peak import OutlinePeak, peak_asked
from .outline_problem import SIDES, LoadedOutline, OutlineProblem, UnlikeError
from .outline_result import CutAgents, OutlineResult
from .square_leaves import SquareLeaves
from .true_shapes import TrueBody, TrueRegion, TrueShape, nested

TOLERANCE = 0.01
MOST_AGENTS = 100_000
FIRST = 8
"""First agents along the longer side, where the cells' number has such a divisor."""


def solve_outlined(
    scene: Scene,
    tolerance: float | None,
    most_agents: int | None,
    previous: OutlineResult | None = None,
    tolerance_at: ToleranceAt | None = None,
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
        _check_alone(problem.body.regions, which, f"tolerance_at: {name!r}", "peak")
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

    def tell(found: OutlineBracket) -> None:
        generations.append(CutAgents.standing(scene, problem, found, edge))

    def result(found: OutlineBracket) -> OutlineResult:
        how = problem, found, edge, tolerance, perf_counter() - start
        of_peak = None if peak is None else (peak.value, peak.off, peak.error)
        return OutlineResult.of(scene, *how, generations, goal, of_peak)

    try:
        aim = peak.aim if peak is not None else None
        return result(spawn(problem, tolerance, most_agents or MOST_AGENTS, before, tell, aim))
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
    regions = body.regions
    thickness, modulus = scene.thickness, scene.cell_materials[0].youngs_modulus
    held: dict[str, tuple[int, ...]] = {}
    pulled: dict[str, tuple[float, float]] = {}
    pressed_sides: dict[str, float] = {}
    for name in SIDES:
        kind = scene.side_condition(name).kind
        if kind != "free":
            held[name] = (0, 1) if kind == "rigid" else (SIDES[name][0],)
    outlines: list[LoadedOutline] = []
    unit = modulus * thickness * edge
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            which = [region.name for region in scene.body.regions].index(load.outline)
            if any(one.name == load.outline for one in outlines):
                raise SceneError(
                    f"loads.{number}.outline: {load.outline!r} is loaded already; give one load"
                )
            one = regions[which]
            _check_alone(regions, which, f"loads.{number}.outline: {load.outline!r}", "load")
            _check_body_ends(scene, which, f"loads.{number}.outline")
            # stresses as strains of the modulus, forces as such over edges
            what = (load.outline, one.shape, one.solid)
            if load.pressure is not None:
                outlines.append(LoadedOutline.pressed(*what, load.pressure / modulus))
            else:
                total = np.array(load.force) / unit
                outlines.append(LoadedOutline.pushed(*what, total, shape))
                if total.any() and not outlines[-1].stress.any():
                    raise SceneError(f"loads.{number}.force: nothing of {load.outline!r} faces it")
            if not len(outlines[-1].taking(shape)):
                raise SceneError(
                    f"loads.{number}.outline: nothing of {load.outline!r} lies within the array"
                )
        elif load.pressure is not None:
            assert load.side is not None
            sofar = pressed_sides.get(load.side, 0.0)
            pressed_sides[load.side] = sofar + load.pressure / modulus
        else:
            assert load.force is not None
            assert load.side is not None
            x, y = pulled.get(load.side, (0.0, 0.0))
            pulled[load.side] = (x + load.force[0] / unit, y + load.force[1] / unit)
    weight = np.zeros(2)
    if scene.body.gravity is not None and any(scene.body.gravity):
        density = scene.cell_materials[0].density
        assert density is not None
        weight = density * edge / modulus * np.array(scene.body.gravity, dtype=np.float64)
        for number, one in enumerate(regions):
            if ArcFrames(one.shape.arcs).turn.any():
                _check_alone(regions, number, f"body.gravity: regions.{number} bends and", "weight")
    acting: list[ArrayLike] = [
        *pulled.values(),
        *pressed_sides.values(),
        *(one.stress for one in outlines),
        weight,
    ]
    strain = max(float(np.abs(np.asarray(one)).max()) for one in acting)
    if strain == 0.0:
        raise SceneError(
            "loads: without a load or gravity, or with loads of sides that cancel, there is no "
            "energy to bound; give one of them"
        )
    Scales.of(modulus, strain * unit, edge, modulus * thickness)  # refuses what no number holds
    problem = OutlineProblem(
        body,
        shape,
        held,
        {side: (x / strain, y / strain) for side, (x, y) in pulled.items()},
        {side: pressure / strain for side, pressure in pressed_sides.items()},
        tuple(replace(one, stress=one.stress / strain) for one in outlines),
        weight / strain,
        strain,
    )
    return problem, edge


def _check_alone(
    regions: Sequence[TrueRegion | MixedRegion], which: int, what: str, borne: str
) -> None:
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


def _body(scene: Scene, edge: float, shape: tuple[int, int]) -> TrueBody | MixedBody:
    laws = laws_of(scene)
    shapes = [
        (_shape(scene, region, f"body.regions.{number}", edge, shape), region.material)
        for number, region in enumerate(scene.body.regions)
    ]
    assert scene.body.material is not None
    if len(set(laws.values())) > 1:
        mixed = [
            MixedRegion(shape, material in laws, laws.get(material, AIR))
            for shape, material in shapes
        ]
        return MixedBody(laws.get(scene.body.material, AIR), tuple(mixed))
    true = [TrueRegion(shape, material in laws) for shape, material in shapes]
    return TrueBody(scene.body.material in laws, tuple(true), next(iter(laws.values())))


def _shape(
    scene: Scene, region: Region, where: str, edge: float, shape: tuple[int, int]
) -> TrueShape:
    known = region.shape_in(scene.lattice, where)
    try:
        lines = cast(OutlinedShape, known).outline()
        return nested([np.asarray(arcs / [edge, edge, 1.0]) for arcs in lines], shape)
    except TouchError:
        raise SceneError(
            f"{where}: its outline crosses or touches itself; split it in two"
        ) from None
