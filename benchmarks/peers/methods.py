"""The methods that are compared: agents, kaju's solver, finite elements.

Each takes a problem and how often the picture's cells are split, and answers with a function that
looks up the displacements at the problem's points. What is timed starts from the description and
ends with the displacements of the whole body: cells or mesh, assembly, set-up, solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any, Literal

import kaju
from kaju.arrays import Floats

from . import bilinear, quadratic
from .problems import Problem
from .sparse import Solver

Answer = Callable[[], Floats]  # Looks up the displacements at the problem's points
Prepare = Callable[[Problem, int], Callable[[], Answer]]

WAVE_TOLERANCE = 2e-4
"""Agents rest when the loads left are this share, in energy: below the error of their grids."""
FIT_EVALUATIONS = 300
SPAWNED = 0.4  # Tolerance of agents that spawn, times the division
ESTIMATED = 1.6  # Estimated error at which quadratic elements end, times the division


@dataclass(frozen=True)
class Method:
    """A method, and what it is measured on."""

    name: str
    title: str  # For files and for people
    prepare: Prepare
    """Takes problem and division and returns the job, a function without arguments, that is timed.
    The job returns a function that looks the answer up."""
    divisions: Mapping[str, tuple[int, ...]]
    """By problem, into how many parts every edge of the picture's cells is split."""
    quick: int  # Cells of the largest body in a short look
    style: tuple[str, str, str]  # Colour, marker and line in the picture
    needs: tuple[str, ...] = ()  # Packages that must be installed

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages that are needed and not installed."""
        return tuple(package for package in self.needs if find_spec(package) is None)


@dataclass(frozen=True, eq=False)
class Sized:
    """An answer that tells how many agents or elements it took."""

    parts: int
    at: Callable[[Floats], Floats]
    points: Floats

    def __call__(self) -> Floats:
        """Return the displacements at the problem's points."""
        return self.at(self.points)


def equal_cells(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let `kaju.solve` answer on equal cells."""

    def job() -> Answer:
        result: Any = kaju.solve(problem.scene(division), resolution=1)
        return lambda: result.displacement_at(problem.points)

    return job


def spawning(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents spawn to a tolerance that falls as the equal cells' error does."""

    def job() -> Answer:
        result: Any = kaju.solve(problem.scene(1), SPAWNED / division)
        return Sized(result.agents, result.displacement_at, problem.points)

    return job


def agents(
    order: Literal["wave", "largest first"], problem: Problem, division: int
) -> Callable[[], Answer]:
    """Let the agents of the elastic rule push until they rest."""
    rule = kaju.ElasticRule(order=order, tolerance=WAVE_TOLERANCE)
    pushes = 1000 if order == "largest first" else 1

    def job() -> Answer:
        scene = problem.scene(division).replace(rule=rule)
        run = kaju.ElasticModel(scene, engine="arrays", pushes_per_step=pushes).run()
        return lambda: run.result.displacement_at(problem.points)

    return job


def prescribed(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents pass load on by the default coefficients."""
    return lambda: _transferred(problem, problem.scene(division, "prescribed"))


def fitted(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents pass load on by coefficients fitted to the truth; the search is not timed."""
    scene, end = problem.scene(1, "prescribed"), FIT_EVALUATIONS
    fit = kaju.fit_rule(scene, problem.truth(), evaluations=end)
    return lambda: _transferred(
        problem, problem.scene(division, "prescribed").replace(rule=fit.rule)
    )


def _transferred(problem: Problem, scene: kaju.Scene) -> Answer:
    result = kaju.LoadModel(scene, engine="arrays").run()
    _ = result.displacement_field
    return lambda: result.displacement_at(problem.points)


def elements(solver: Solver, problem: Problem, division: int) -> Callable[[], Answer]:
    """Let bilinear elements answer on the same cells."""
    return lambda: bilinear.solve(problem, division, solver)


def adaptive(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let quadratic triangles be refined from a coarse start; every mesh on the way counts."""
    solver: Solver = "pardiso" if find_spec("pypardiso") else "superlu"

    def job() -> Answer:
        answers = quadratic.adaptive(problem, solver)
        last = next(a for a in answers if a.error_estimate <= ESTIMATED / division)
        return Sized(last.mesh.nelements, last.at, problem.points)

    return job


def _on(plate: int, block: int, pixels: int, first: int = 1) -> dict[str, tuple[int, ...]]:
    """Return powers of two up to the largest division of each problem; none if that is 0."""
    largest = {"plate": plate, "block": block, "pixels": pixels}
    powers = [2**power for power in range(8)]
    return {name: tuple(p for p in powers if first <= p <= end) for name, end in largest.items()}


_PUSHED, _PASSED = _on(2, 1, 1), _on(4, 4, 4)
_FEM = ("skfem",)

METHODS = {
    method.name: method
    for method in (
        Method(
            "multigrid", "kaju.solve, equal cells", equal_cells, _on(128, 16, 32), 102_400,
            ("#0b5394", "o", "-"),
        ),
        Method(
            "spawning", "kaju.solve, agents that spawn", spawning, _on(64, 8, 16, first=2), 25_600,
            ("#0b5394", "o", "--"),
        ),
        Method(
            "wave", "agents, elastic rule, wave", partial(agents, "wave"), _PUSHED, 0,
            ("#5fa8d3", "^", "-"),
        ),
        Method(
            "largest_first", "agents, elastic rule, largest first",
            partial(agents, "largest first"), _PUSHED, 0, ("#5fa8d3", "v", "--"),
        ),
        Method(
            "prescribed", "agents, prescribed rule", prescribed, _PASSED, 1_600,
            ("#c8963e", "s", "-"),
        ),
        Method(
            "fitted", "agents, prescribed rule, fitted", fitted, _PASSED, 1_600,
            ("#c8963e", "D", "--"),
        ),
        Method(
            "superlu", "bilinear elements, SuperLU", partial(elements, "superlu"),
            _on(16, 2, 16, first=2), 102_400, ("#7a7a7a", "x", "-"),
        ),
        Method(
            "pardiso", "bilinear elements, PARDISO", partial(elements, "pardiso"),
            _on(32, 4, 32, first=2), 102_400, ("#7a7a7a", "*", "--"), ("pypardiso",),
        ),
        Method(
            "pyamg", "bilinear elements, pyamg", partial(elements, "pyamg"),
            _on(32, 4, 32, first=2), 102_400, ("#b2340b", "+", "-"), ("pyamg",),
        ),
        Method(
            "quadratic", "adaptive quadratic triangles", adaptive, _on(64, 0, 64, first=2), 409_600,
            ("#4d8b57", "P", "-"), _FEM,
        ),
    )
}  # fmt: skip
