"""What agents of the elastic rule have settled to, as a result with stresses anywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .elastic_result import ElasticResult
from .engine import Solution
from .from_scene import problem_of_scene
from .staggered import strain_energy

if TYPE_CHECKING:
    from .elastic_model_run import ElasticRun


def settled(run: ElasticRun) -> ElasticResult:
    """Return the displacements at the end of a run as an `ElasticResult`.

    Parameters
    ----------
    run : ElasticRun
        What `ElasticModel.run` returned.

    Returns
    -------
    ElasticResult
        On the run's cells. Its error estimate is that of the loads still left; what the grid
        itself misses is not known to agents.
    """
    problem, origin = problem_of_scene(run.scene)
    faces = tuple(given.copy() for given in problem.fixed)
    for axis, (face, moved) in enumerate(zip(faces, run.displacement, strict=True)):
        box = tuple(
            slice(first, first + count + (a == axis))
            for a, (first, count) in enumerate(zip(origin, problem.shape, strict=True))
        )
        face[problem.inner] = np.nan_to_num(moved[box]) / problem.scales.displacement
    summary = run.summary()
    solution = Solution(
        displacement=faces,
        energy=strain_energy(problem, faces),
        method=summary["order"],
        discretisation=0.0,
        algebraic=summary["error_estimate"],
        levels=summary["levels"],
        residuals=[],
        converged=run.outcome.startswith("at rest"),
        notes=[run.outcome],
    )
    return ElasticResult(run.scene, run.scene, None, 1, problem, origin, solution, run.seconds)
