"""The methods that are compared: kaju's solver on equal cells and by agents, finite elements.

Each takes a problem and how often the picture's cells are split, and answers with a function that
looks up the displacements at the problem's points; that is not timed. What is timed starts from the
description and ends with the displacements of the whole body: cells or mesh, assembly, solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

import kaju
from kaju.arrays import Floats

from . import bilinear, quadratic
from .bilinear import Solver
from .problems import Problem

Answer = Callable[[], Floats]  # Looks up the displacements at the problem's points

SPAWNED = 0.4  # Tolerance of agents that spawn, times the division
ESTIMATED = 1.6  # Estimated error at which quadratic elements end, times the division


@dataclass(frozen=True)
class Method:
    """A method, and what it is measured on."""

    name: str
    title: str  # For files and for people
    answer: Callable[[Problem, int], Answer]  # Takes problem and division; it is timed
    divisions: Mapping[str, tuple[int, ...]]
    """By problem, into how many parts every edge of the picture's cells is split."""
    quick: int  # Cells of the largest body in a short look
    style: tuple[str, str, str]  # Colour, marker and line in the picture
    needs: tuple[str, ...] = ()  # Packages that must be installed


@dataclass(frozen=True, eq=False)
class Sized:
    """An answer that tells how many agents or elements it took."""

    parts: int
    at: Callable[[Floats], Floats]
    points: Floats

    def __call__(self) -> Floats:
        """Return the displacements at the problem's points."""
        return self.at(self.points)


def equal_cells(problem: Problem, division: int) -> Answer:
    """Let `kaju.solve` answer on equal cells."""
    result: Any = kaju.solve(problem.scene(division), resolution=1)
    return lambda: result.displacement_at(problem.points)


def spawning(problem: Problem, division: int) -> Answer:
    """Let agents spawn to a tolerance that falls as the equal cells' error does."""
    result: Any = kaju.solve(problem.scene(1), SPAWNED / division)
    return Sized(result.agents, result.displacement_at, problem.points)


def adaptive(problem: Problem, division: int) -> Answer:
    """Let quadratic triangles be refined from a coarse start; every mesh on the way counts."""
    solver: Solver = "pardiso" if find_spec("pypardiso") else "superlu"
    answers = quadratic.adaptive(problem, solver)
    last = next(a for a in answers if a.error_estimate <= ESTIMATED / division)
    return Sized(last.mesh.nelements, last.at, problem.points)


def _on(plate: int, block: int, pixels: int, first: int = 1) -> dict[str, tuple[int, ...]]:
    """Return powers of two up to the largest division of each problem; none if that is 0."""
    largest = {"plate": plate, "block": block, "pixels": pixels}
    powers = [2**power for power in range(8)]
    return {name: tuple(p for p in powers if first <= p <= end) for name, end in largest.items()}


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
            "superlu", "bilinear elements, SuperLU", partial(bilinear.solve, solver="superlu"),
            _on(16, 2, 16, first=2), 102_400, ("#7a7a7a", "x", "-"),
        ),
        Method(
            "pardiso", "bilinear elements, PARDISO", partial(bilinear.solve, solver="pardiso"),
            _on(32, 4, 32, first=2), 102_400, ("#7a7a7a", "*", "--"), ("pypardiso",),
        ),
        Method(
            "pyamg", "bilinear elements, pyamg", partial(bilinear.solve, solver="pyamg"),
            _on(32, 4, 32, first=2), 102_400, ("#b2340b", "+", "-"), ("pyamg",),
        ),
        Method(
            "quadratic", "adaptive quadratic triangles", adaptive, _on(64, 0, 64, first=2), 409_600,
            ("#4d8b57", "P", "-"), ("skfem",),
        ),
    )
}  # fmt: skip
