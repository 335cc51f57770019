"""The ways to an answer that are compared: agents, kaju's solver, finite elements.

Each takes a problem and how often the picture's cells are split, and returns the
displacements at the problem's points. What is timed starts from the description and ends
with the displacements of the whole body: cells or mesh, assembly, set-up, solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

from kaju.arrays import Floats

from .problems import Problem

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.scene import Scene

Answer = Callable[[], Floats]
"""Looks the displacements at the problem's points up."""
Prepare = Callable[[Problem, int], Callable[[], Answer]]

WAVE_TOLERANCE = 2e-4
"""Agents rest when the loads left are this share, in energy: below the error of their grids."""
FIT_EVALUATIONS = 300
SPAWNED = 0.4
"""Tolerance of agents that spawn, times the division."""


@dataclass(frozen=True)
class Method:
    """A way to an answer.

    Attributes
    ----------
    name, title : str
        For files and for people.
    prepare : function
        Takes problem and division and returns the job, a function without arguments, that is
        timed. The job returns a function that looks the answer up.
    divisions : mapping
        By problem, into how many parts every edge of the picture's cells is split.
    quick : mapping
        The same for a short look.
    needs : tuple of str
        Packages that must be installed.
    """

    name: str
    title: str
    prepare: Prepare
    divisions: Mapping[str, tuple[int, ...]]
    quick: Mapping[str, tuple[int, ...]]
    needs: tuple[str, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages that are needed and not installed."""
        return tuple(package for package in self.needs if find_spec(package) is None)


def multigrid(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let `kaju.solve` answer on equal cells."""
    from kaju.model.elastic.solve import solve

    def job() -> Answer:
        result = solve(problem.scene(division))
        return lambda: result.displacement_at(problem.points)

    return job


def spawning(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents spawn to a tolerance that falls as the equal cells' error does."""
    from kaju.model.study.solving import solve

    def job() -> Answer:
        return Spawned(solve(problem.scene(1), SPAWNED / division, strategy="spawning"), problem)

    return job


@dataclass(frozen=True, eq=False)
class Spawned:
    """An answer that tells how many agents it took."""

    result: ElasticResult
    problem: Problem

    @property
    def agents(self) -> int:
        """Number of agents."""
        return self.result.agents

    def __call__(self) -> Floats:
        """Return the displacements at the problem's points."""
        return self.result.displacement_at(self.problem.points)


def _agents(
    order: Literal["wave", "largest first"],
) -> Callable[[Problem, int], Callable[[], Answer]]:
    def prepare(problem: Problem, division: int) -> Callable[[], Answer]:
        from kaju.agents.rules import ElasticRule
        from kaju.model.elastic.settling.elastic_model import ElasticModel

        rule = ElasticRule(order=order, tolerance=WAVE_TOLERANCE)
        pushes = 1000 if order == "largest first" else 1

        def job() -> Answer:
            scene = problem.scene(division).replace(rule=rule)
            run = ElasticModel(scene, engine="arrays", pushes_per_step=pushes).run()
            return lambda: run.result.displacement_at(problem.points)

        return job

    return prepare


def prescribed(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents pass load on by the default coefficients."""
    return lambda: _transfer(problem, problem.scene(division, "prescribed"))


def fitted(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let agents pass load on by coefficients fitted to the truth on the picture's own cells.

    The search for them is not timed.
    """
    from kaju.model.study.fitting import fit_rule

    fit = fit_rule(
        problem.scene(1, "prescribed"),
        problem.truth(),
        points=problem.points,
        evaluations=FIT_EVALUATIONS,
    )
    return lambda: _transfer(problem, problem.scene(division, "prescribed").replace(rule=fit.rule))


def _transfer(problem: Problem, scene: Scene) -> Answer:
    from kaju.model.transfer.load_model import LoadModel

    result = LoadModel(scene, engine="arrays").run()
    _ = result.displacement_field
    return lambda: result.displacement_at(problem.points)


def finite_elements_direct(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let scikit-fem's bilinear elements answer, by SciPy's sparse factorisation."""
    from . import finite_elements

    return lambda: finite_elements.solve(problem, division, "direct")


def finite_elements_multigrid(problem: Problem, division: int) -> Callable[[], Answer]:
    """Let scikit-fem's bilinear elements answer, by pyamg's smoothed aggregation."""
    from . import finite_elements

    return lambda: finite_elements.solve(problem, division, "multigrid")


def _elsewhere(problem: Problem, division: int) -> Callable[[], Answer]:
    raise NotImplementedError("dolfinx is run by `measure.by_dolfinx`, in its own Python")


_NONE: tuple[int, ...] = ()
_AGENTS = {"plate": (1, 2), "block": (1,), "pixels": (1,)}
_AGENTS_QUICK = {"plate": (1,), "block": _NONE, "pixels": _NONE}
_TRANSFER = {"plate": (1, 2, 4), "block": (1, 2, 4), "pixels": (1, 2, 4)}
_TRANSFER_QUICK = {"plate": (1,), "block": (1,), "pixels": (1,)}
_ITERATED = {"plate": (2, 4, 8, 16, 32), "block": (2, 4), "pixels": (2, 4, 8, 16, 32)}
_ITERATED_QUICK = {"plate": (4,), "block": (2,), "pixels": (4,)}

METHODS = {
    method.name: method
    for method in (
        Method(
            "multigrid",
            "kaju.solve, equal cells",
            multigrid,
            {
                "plate": (1, 2, 4, 8, 16, 32, 64, 128),
                "block": (1, 2, 4, 8, 16),
                "pixels": (1, 2, 4, 8, 16, 32),
            },
            {"plate": (1, 4, 16), "block": (2, 4), "pixels": (1, 4)},
        ),
        Method(
            "spawning",
            "kaju.solve, agents that spawn",
            spawning,
            {"plate": (2, 4, 8, 16, 32, 64), "block": (2, 4, 8), "pixels": (2, 4, 8, 16)},
            {"plate": (4, 16), "block": (2,), "pixels": (4,)},
        ),
        Method("wave", "agents, elastic rule, wave", _agents("wave"), _AGENTS, _AGENTS_QUICK),
        Method(
            "largest_first",
            "agents, elastic rule, largest first",
            _agents("largest first"),
            _AGENTS,
            _AGENTS_QUICK,
        ),
        Method("prescribed", "agents, prescribed rule", prescribed, _TRANSFER, _TRANSFER_QUICK),
        Method("fitted", "agents, prescribed rule, fitted", fitted, _TRANSFER, _TRANSFER_QUICK),
        Method(
            "direct",
            "scikit-fem, spsolve",
            finite_elements_direct,
            {"plate": (2, 4, 8, 12, 16), "block": (2,), "pixels": (2, 4, 8, 16)},
            {"plate": (2, 4), "block": _NONE, "pixels": (4,)},
            ("skfem",),
        ),
        Method(
            "algebraic",
            "scikit-fem, pyamg",
            finite_elements_multigrid,
            _ITERATED,
            _ITERATED_QUICK,
            ("skfem", "pyamg"),
        ),
        Method("dolfinx", "dolfinx, hypre", _elsewhere, _ITERATED, _ITERATED_QUICK),
    )
}
