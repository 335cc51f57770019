"""`kaju.solve`: equal cells without a tolerance, agents that spawn with one."""

from __future__ import annotations

from math import inf
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats, first_largest
from kaju.errors import ConvergenceError, ParameterError, brief
from kaju.model.elastic.arguments import SMALLEST, TOLERANCE, check_numbers
from kaju.model.elastic.corners import singular_round
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, grid_of
from kaju.model.elastic.equal.problem import FaceFields
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.equal.supports import is_torn
from kaju.model.elastic.goals.quantities import AskedFor, asked
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.elastic.pair.cut_loop import CutLoop, peak_asked
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.outline.posed_outlines import OutlinedBody
from kaju.model.scene import Scene
from kaju.stepping import NOTE, interrupt_requested


def solve_spawning(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    goal: AskedFor | None = None,
    stage: int | None = None,
) -> ElasticResult:
    """Solve a scene by agents of many sizes: `kaju.solve` with a tolerance.

    The first agents are as large as the body, its materials, supports and loads let them be. Those
    that are furthest off spawn 4 (in three dimensions 8) children of half their size, generation by
    generation, until the error is within the tolerance. The scene's cells say where the body is; it
    is never rasterised as a whole.
    """
    start = perf_counter()
    tolerance = TOLERANCE if tolerance is None else tolerance
    spawner = spawner_of(scene, tolerance, resolution, stage, goal)
    while not spawner.finished and not (spawner.generations and interrupt_requested()):
        spawner.step()
    spawning = spawner.outcome()
    spawning.notes += [NOTE] if interrupt_requested() else []
    result = answer_of(spawning, tolerance, perf_counter() - start)
    if spawning.stopped == "agents" and error_of(spawning) > tolerance:
        raise ConvergenceError(
            f"solve: {result.agents} agents leave an error of "
            f"{error_of(spawning):.2g}, and a tolerance of {tolerance:g} needs more than the "
            f"{spawner.most_agents} allowed; take a larger tolerance. The error's `best` holds "
            "the result so far",
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
                "resolution, stage: are not taken within true outlines, whose agents spawn where "
                'the tolerance asks for it; leave them out, or take regions with outline = "cells"'
            )
        return CutLoop(OutlinedBody(scene), tolerance, most_agents, peak_asked(scene, goal))
    return PairLoop(PosedBody(scene, stage, resolution), tolerance, most_agents, asked(goal))


def answer_of(spawning: PairAgents, tolerance: float, seconds: float) -> ElasticResult:
    """Return the agents of a refinement, finished or not, as a result with its notes."""
    missed = missed_note(spawning, tolerance)
    spawning.notes += [missed] if missed else []
    return ElasticResult(spawning, seconds, tolerance)


def missed_note(spawning: PairAgents, tolerance: float) -> str:
    """Return a note on an error above the tolerance, "" if there is nothing to be noted."""
    error, stopped, ground = error_of(spawning), spawning.stopped, spawning.ground
    if error <= tolerance or stopped == "agents":
        return ""
    proved = not (spawning.no_bound or any(goal.no_bound for goal in spawning.goals))
    kind = "a proved" if proved else "an estimated"
    above = f"{kind} error of {error:.2g}, above the tolerance of {tolerance:g}"
    if not stopped:
        return f"after {len(spawning.generations)} steps, which leave {above}"
    if stopped == "rounding":
        return f"rounding hides the difference between the two stresses, and leaves {above}"
    if ground.resolution is not None:
        return f"the smallest agents allowed leave {above}; a larger resolution allows smaller ones"
    agent, scene = first_largest(spawning.generations[-1].gap), ground.scene
    metre = scene.lattice.cell_size / ground.cell
    lower, size = metre * spawning.leaves.lower[agent], metre * spawning.leaves.size[agent]
    place, reason = lower + 0.5 * size, ""
    if not isinstance(ground, OutlinedBody):
        place, reason = singular_round(scene, lower, size)
    most = f"most of it lies at ({', '.join(f'{x:.4g}' for x in place)}) m"
    most += f", where {reason}" if reason else ""
    if stopped == "corners":
        return (
            f"agents would be too small to be counted before they agree where stress grows without "
            f"limit: they leave {above}; {most}"
        )
    if stopped == "stalled":
        return f"more agents do not lower the error: they leave {above}; {most}"
    return f"the smallest agents that can be counted leave {above}; {most}"


def error_of(spawning: PairAgents) -> float:
    """Return the error that the tolerance limits."""
    return max((one.relative_error for one in spawning.goals), default=spawning.error)


def solve_cells(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    previous: ElasticResult | None = None,
    stiffness: ArrayLike | None = None,
) -> ElasticResult:
    """Solve a scene as linear elasticity, on equal cells: `kaju.solve` without a tolerance.

    The equations are solved to `tolerance` in the energy norm: see `solve_problem`. There are
    `resolution` cells per cell of the scene along every axis, by default as many as in the previous
    result, or 1, and 2 where a member is only one cell wide, which could not carry shear. An
    iteration starts from the previous answer; with a field of stiffness few cells iterate as well.
    """
    start = perf_counter()
    check_numbers(tolerance, resolution, least=SMALLEST)
    field = None if stiffness is None else checked_stiffness(scene, stiffness)
    grid, before = _grid(scene, stage, resolution, previous, field)
    iterate = field is not None and before is not None
    solution = solve_problem(grid.problem, tolerance, before, iterate=iterate)
    if is_torn(grid.problem):
        solution.discretisation = inf
    solution.notes[:0] = [note for note in grid.notes if note not in solution.notes]
    found = CellAgents(scene, stage, grid.division, solution, field, grid)
    result = ElasticResult(found, perf_counter() - start)
    if not solution.converged:
        solution.notes += [NOTE] if interrupt_requested() else []
        asked = "the grid's own error" if tolerance is None else f"a tolerance of {tolerance:g}"
        raise ConvergenceError(
            f"solve: after {solution.iterations} iterations of {solution.method} the relative "
            f"residual is {solution.residuals[-1]:.2g}, short of {asked}; take a larger tolerance, "
            "or a smaller contrast of materials and supports. The error's `best` holds the result "
            "so far, its `residuals` the history",
            result.residuals,
            result,
        )
    return result


def _grid(
    scene: Scene,
    stage: int | None,
    resolution: int | None,
    previous: ElasticResult | None,
    stiffness: Floats | None,
) -> tuple[Grid, FaceFields | None]:
    """Return the grid, and the previous displacement of its faces if its cells are the same."""
    if previous is None:
        return grid_of(scene, stage, resolution or 1, stiffness=stiffness), None
    found = previous.found
    if not isinstance(found, CellAgents):
        raise ParameterError(
            "previous: equal cells can only start from equal cells, and this answer has agents "
            "of many sizes; leave `previous` out"
        )
    division = resolution or previous.subdivision
    grid = grid_of(scene, stage, division, found.problem, stiffness)
    if found.origin != grid.origin or found.problem.kinds.shape != grid.problem.kinds.shape:
        return grid, None
    unit = found.scales.displacement / grid.problem.scales.displacement
    return grid, tuple(unit * values for values in found.solution.displacement)


def checked_stiffness(scene: Scene, stiffness: ArrayLike) -> Floats:
    """Return a field of relative stiffness, one number above 0 for every cell of the scene."""
    try:
        field = np.asarray(stiffness, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"stiffness: must be numbers, got {brief(stiffness)}") from error
    shape = scene.lattice.shape
    if field.shape != shape:
        raise ParameterError(
            f"stiffness: one number a cell is needed, an array of shape {shape} indexed from "
            f"left and bottom, got shape {field.shape}"
        )
    stiffest = max(material.youngs_modulus for material in scene.cell_materials)
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
