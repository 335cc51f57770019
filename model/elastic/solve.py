"""`kaju.solve`: equal cells without a tolerance, agents that spawn with one."""

from __future__ import annotations

from math import inf
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, ParameterError, require
from kaju.model.elastic.arguments import SMALLEST, TOLERANCE, check_numbers
from kaju.model.elastic.caveats import refuse_singular
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.equal.supports import is_torn
from kaju.model.elastic.goals.quantities import AskedFor, Deflection, asked
from kaju.model.elastic.moduli import constants_of
from kaju.model.elastic.pair.cut_loop import CutLoop, goals_asked
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.outline.posed_outlines import OutlinedBody
from kaju.model.scene import Scene
from kaju.model.solid.solid_agents import SolidAgents, grid_of_solid
from kaju.stepping import NOTE, interrupt_requested, progress_line


def solve_spawning(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    goal: AskedFor | None = None,
    stage: int | None = None,
) -> ElasticResult:
    """Solve a scene by agents of many sizes: `kaju.solve` with a tolerance."""
    start = perf_counter()
    tolerance = TOLERANCE if tolerance is None else tolerance
    spawner = spawner_of(scene, tolerance, resolution, stage, goal)
    with progress_line() as report:
        while not spawner.finished and not (spawner.generations and interrupt_requested()):
            spawner.step()
            report(spawner.progress)
    found = spawner.outcome()
    found.notes += [NOTE] if interrupt_requested() else []
    result = ElasticResult(found, perf_counter() - start, tolerance)
    if found.stopped == "agents" and result.tolerance_kept == "missed":
        raise ConvergenceError(
            f"solve: {result.agents} agents leave an error of "
            f"{result.goal_error:.2g}, and a tolerance of {tolerance:g} needs more than the "
            f"{spawner.most_agents} allowed; take a larger tolerance. `best` of this exception "
            "is the result so far",
            result.residuals,
            result,
        )
    return result


def spawner_of(
    scene: Scene,
    tolerance: float,
    resolution: int | None,
    stage: int | None,
    goal: AskedFor | None,
    most_agents: int | None = None,
) -> PairLoop:
    """Return the loop that agents spawn in: within cells, or within true outlines."""
    check_numbers(tolerance, resolution, stage, most_agents)
    if scene.outlined and scene.lattice.dimension == 2:
        if resolution is not None or stage not in (None, 1):
            raise ParameterError(
                "resolution, stage: true outlines have neither, since their agents spawn as the "
                'tolerance asks; leave them out, or take regions with outline = "cells"'
            )
        return CutLoop(OutlinedBody(scene), tolerance, most_agents, goals_asked(scene, goal))
    body, quantities = PosedBody(scene, stage, resolution), asked(goal)
    refuse_singular(scene, quantities)
    for one in quantities:
        side = scene.sides.get(str(getattr(one, "at", "")))
        if isinstance(one, Deflection) and side and side.kind == "rigid":
            raise ParameterError(f"goal: {one.at} is held, and has no deflection to ask for")
    return PairLoop(body, tolerance, most_agents, quantities)


def solve_cells(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    previous: ElasticResult | None = None,
    stiffness: ArrayLike | None = None,
) -> ElasticResult:
    """Solve a scene on equal cells, `kaju.solve` without a tolerance: this is of the equations."""
    start = perf_counter()
    check_numbers(tolerance, resolution, least=SMALLEST)
    field = None if stiffness is None else checked_stiffness(scene, stiffness)
    known, before = None if previous is None else previous.found, None
    if not isinstance(known, CellAgents | None):
        raise ParameterError(
            "previous: equal cells can only start from equal cells, and this answer has agents "
            "of many sizes; leave `previous` out"
        )
    # By default there are as many cells as before.
    division = resolution or (previous.subdivision if previous is not None else 1)
    like = None if known is None else known.problem
    grid = grid_of(scene, stage, division, like, field, slides=True)
    place = grid.origin, grid.problem.kinds.shape
    if known is not None and place == (known.origin, known.problem.kinds.shape):
        unit = known.scales.displacement / grid.problem.scales.displacement
        before = tuple(unit * values for values in known.solution.displacement)
    iterate = field is not None and before is not None
    solution = solve_problem(grid.problem, tolerance, before, iterate=iterate)
    if is_torn(grid.problem):
        solution.discretisation = inf
    solution.notes[:0] = [note for note in grid.notes if note not in solution.notes]
    found = CellAgents(scene, stage, grid.division, solution, field, grid)
    return _converged(found, start, tolerance)


def solve_solid(scene: Scene, resolution: int | None) -> ElasticResult:
    """Solve a solid within true outlines on equal cells, whole, cut or empty."""
    start = perf_counter()
    check_numbers(None, resolution)
    posed, share = grid_of_solid(scene, int(resolution or 1))
    solution = solve_problem(posed.problem)
    solution.notes[:0] = posed.notes
    return _converged(SolidAgents(scene, None, posed.division, solution, share, posed), start)


def _converged(found: CellAgents, start: float, tolerance: float | None = None) -> ElasticResult:
    """Return the answer, or raise it if its equations are not solved."""
    result, solution = ElasticResult(found, perf_counter() - start), found.solution
    if not solution.converged:
        solution.notes += [NOTE] if interrupt_requested() else []
        asked = "the grid's own error" if tolerance is None else f"a tolerance of {tolerance:g}"
        raise ConvergenceError(
            f"solve: after {solution.iterations} iterations of {solution.method} the relative "
            f"residual is {solution.residuals[-1]:.2g}, short of {asked}; take a larger tolerance, "
            "another resolution, or a smaller contrast of materials and supports. `best` of this "
            "exception is the result so far, `residuals` the history",
            result.residuals,
            result,
        )
    return result


def checked_stiffness(scene: Scene, stiffness: ArrayLike) -> Floats:
    """Return a field of relative stiffness, one number above 0 for every cell of the scene."""
    shape = scene.lattice.shape
    try:
        field = np.asarray(stiffness, dtype=np.float64)
        require(field.shape == shape, f"got shape {field.shape}")
    except (TypeError, ValueError) as error:
        raise ParameterError(
            f"stiffness: one number a cell is needed, an array of shape {shape} indexed from "
            f"left and bottom: {error}"
        ) from error
    stiffest = constants_of(scene)[:, 0].max()
    with np.errstate(over="ignore"):
        wrong = (scene.rasterise() >= 0) & ~(np.isfinite(field * stiffest) & (field > 0.0))
    if wrong.any():
        cell = tuple(np.argwhere(wrong)[0].tolist())
        raise ParameterError(
            f"stiffness: must be above 0 where there is material, and finite, also times Young's "
            f"modulus, got {field[cell]} at cell {cell}; take a small share of the material's own, "
            "such as 1e-6, for what is nearly air"
        )
    return field
