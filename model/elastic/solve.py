"""`kaju.solve` on equal cells: linear elasticity of a scene, to the accuracy of its grid."""

from __future__ import annotations

from time import perf_counter

from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, ParameterError
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import Grid, grid_of
from kaju.model.elastic.equal.problem import FaceFields
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.scene import Scene
from kaju.stopping import NOTE, interrupt_requested

from .arguments import SMALLEST, check_numbers, checked_stiffness
from .elastic_result import ElasticResult


def solve(
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
    solution.notes[:0] = [note for note in grid.notes if note not in solution.notes]
    found = CellAgents(grid.scene, stage, grid.problem, grid.origin, solution, field)
    result = ElasticResult(
        scene, stage, found, perf_counter() - start, tolerance=None, resolution=resolution
    )
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
            "previous: equal cells continue from equal cells, and its agents are of many sizes; "
            "leave `previous` out"
        )
    division = resolution or previous.subdivision
    grid = grid_of(scene, stage, division, found.problem, stiffness)
    if found.origin != grid.origin or found.problem.kinds.shape != grid.problem.kinds.shape:
        return grid, None
    unit = found.scales.displacement / grid.problem.scales.displacement
    return grid, tuple(unit * values for values in found.solution.displacement)
