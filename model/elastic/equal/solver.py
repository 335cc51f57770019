"""From a problem to its displacements: by sparse factors of few cells, by multigrid of many."""

from __future__ import annotations

import numpy as np

from .direct import by_factors
from .problem import ElasticProblem, FaceFields
from .system import Solution

FEW = {2: 10_000, 3: 3_000}
"""So many cells are solved by factors, in less time than it takes to load the compiled loops."""


def solve_problem(
    problem: ElasticProblem,
    tolerance: float | None = None,
    start: FaceFields | None = None,
    *,
    iterate: bool = False,
) -> Solution:
    """Find the displacements at which every face of a supported body is in balance."""
    # To a relative algebraic error in the energy norm, by default well below the estimated error of
    # the grid, and for small bodies 1e-10; iterations may start from displacements of as many
    # faces. Few cells are solved by factors, unless it is asked to `iterate`.
    if not iterate and np.count_nonzero(problem.kinds >= 0) <= FEW[problem.dimension]:
        solution = by_factors(problem)
        if solution is not None:
            return solution
    # Imported where it is needed, as it holds compiled loops.
    from .iterative import by_iterations

    return by_iterations(problem, tolerance, start)


def followed(problem: ElasticProblem, start: FaceFields | None, tolerance: float) -> Solution:
    """Solve a body that is one of many alike, from the displacement of the one before."""
    # To a relative algebraic error in the energy norm; that of the grid is not looked at.
    from .iterative import continued

    return continued(problem, start, tolerance) or solve_problem(problem, tolerance, start)
