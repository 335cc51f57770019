"""`kaju.solve` with a tolerance and no strategy: equal cells, or agents that spawn.

Both go on step by step, equal cells from one size to the next, agents from generation to
generation. Every step tells more of what the rest will cost, and the one that is expected to
be done first takes the next. So cells that are equal everywhere are found to do where nothing
is local, and little has been spent on the other way.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, log
from time import perf_counter

from kaju.errors import ConvergenceError
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.solve import solve
from kaju.model.scene import Scene
from kaju.model.solving import SMALLEST_TOLERANCE, check_numbers
from kaju.stopping import stopped

from .block_spawner import FEWEST, BlockSpawner, spawner_of
from .costs import cost_of_agents
from .equal_cells import EqualCells
from .generations import Spawner, Spawning
from .ground import ground_of
from .solve import MOST_AGENTS, answer_of

FAVOUR = 1.25
"""Equal cells have to be quicker by this factor: agents tell more about the body."""
TAKEN = "equal cells were taken"


class Agents:
    """Agents that spawn, generation by generation."""

    def __init__(
        self,
        scene: Scene,
        tolerance: float,
        resolution: int | None,
        stage: int | None,
        most_agents: int | None,
    ) -> None:
        self.scene, self.tolerance = scene, tolerance
        self.resolution, self.stage = resolution, stage
        self.limit = most_agents or MOST_AGENTS[scene.lattice.dimension]
        self._cost = cost_of_agents(scene)
        self._spawner: Spawner | BlockSpawner | None = None

    @property
    def agents(self) -> float:
        """How many are expected to do."""
        d = self.scene.lattice.dimension
        if self._spawner is None:
            return FEWEST[d] / self.tolerance**d
        last = self._spawner.generations[-1]
        return float(last.agents * max(last.error / self.tolerance, 1.0) ** self._power)

    @property
    def seconds(self) -> float:
        """What is expected to be left to do."""
        if self.agents > self.limit:
            return inf
        if self._spawner is None:
            return self._cost.of(self.agents)
        done = self._spawner.generations[-1].agents
        return self._cost.each * max(self.agents - 0.5 * done, 0.0)

    @property
    def _power(self) -> float:
        """With which agents are expected to grow by the error's fall.

        In the end it is the dimension. The first agents stand everywhere, and the next ones
        where they are needed: there it is less.
        """
        d = float(self.scene.lattice.dimension)
        assert self._spawner is not None
        if len(self._spawner.generations) < 2:
            return 1.0
        before, last = self._spawner.generations[-2:]
        fall = log(before.error / last.error) if 0.0 < last.error < before.error else 0.0
        growth = log(last.agents / before.agents)
        return d if d * fall <= growth else 0.5 * (d + growth / fall)

    def step(self) -> Spawning | None:
        """Let one more generation spawn; return the agents if it is the last."""
        if self._spawner is None:
            ground = ground_of(self.scene, self.stage, self.resolution)
            self._spawner = spawner_of(ground, self.tolerance, self.limit)
        self._spawner.step()
        return self._spawner.outcome() if self._spawner.finished or stopped() else None


def solve_cheaply(
    scene: Scene,
    tolerance: float,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    most_agents: int | None = None,
    previous: ElasticResult | None = None,
) -> ElasticResult:
    """Solve a scene to a tolerance by equal cells or by agents, whichever is cheaper.

    Parameters
    ----------
    scene : Scene
        Of square or cubic cells. They say where the body is, and may be divided; equal cells
        are considered only if they pose the same problem when they are.
    tolerance : float
        Relative error in the energy norm.
    resolution, stage, most_agents
        As in `solve_spawning`; no cell and no agent is smaller than the resolution allows.
    previous : ElasticResult, optional
        The answer to a scene of which something was changed: as many cells are tried first.

    Returns
    -------
    ElasticResult
        Its notes say what was chosen, and why.

    Raises
    ------
    SupportError, ConvergenceError, ParameterError, SceneError
        As `solve_spawning`.
    """
    start = perf_counter()
    check_numbers(tolerance, resolution)
    cells = EqualCells(scene, tolerance, resolution, stage, previous)
    agents = Agents(scene, tolerance, resolution, stage, most_agents)
    while True:
        if cells.continues or FAVOUR * cells.seconds < agents.seconds:
            equal = cells.step()
            if equal is not None:
                notes = [note for note in equal.notes if TAKEN not in note]
                notes += cells_notes(equal, agents, tolerance)
                return with_notes(equal, notes, tolerance, perf_counter() - start)
        else:
            spawning = agents.step()
            if spawning is not None:
                spawning.notes.append(agents_note(cells, tolerance))
                how = (tolerance, resolution, agents.limit)
                return answer_of(spawning, scene, stage, *how, perf_counter() - start)


def solve_equal(
    scene: Scene,
    tolerance: float,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    previous: ElasticResult | None = None,
) -> ElasticResult:
    """Solve a scene by equal cells that are small enough for a tolerance.

    With a resolution all cells are as small as that. Where their error is above the tolerance,
    however small, the answer's notes say so; their equations are solved to it at least.

    Raises
    ------
    ConvergenceError
        If more cells would be needed than fit.
    """
    start = perf_counter()
    if resolution is not None or tolerance < SMALLEST_TOLERANCE:
        result = solve(scene, tolerance, resolution, stage=stage, previous=previous)
        notes = [*result.notes, *above_note(result, tolerance)]
        return with_notes(result, notes, tolerance, perf_counter() - start)
    cells = EqualCells(scene, tolerance, None, stage, previous, divides=True)
    while cells.seconds < inf:
        result_or_none = cells.step()
        if result_or_none is not None:
            return with_notes(
                result_or_none, list(result_or_none.notes), tolerance, perf_counter() - start
            )
    best = cells.last
    if best is not None and best.error_estimate <= tolerance:
        return with_notes(best, list(best.notes), tolerance, perf_counter() - start)
    raise ConvergenceError(
        f"solve: a tolerance of {tolerance:g} needs about {cells.cells:.2g} equal cells, more than "
        "fit, or cells that cannot be solved; take a larger tolerance, or strategy='spawning'. The "
        "error's `best` holds the result so far",
        () if best is None else best.residuals,
        best,
    )


def above_note(result: ElasticResult, tolerance: float) -> list[str]:
    """Say that the smallest cells allowed do not do, if so."""
    if result.error_estimate <= tolerance:
        return []
    return [
        f"the smallest cells allowed leave an estimated error of {result.error_estimate:.2g}, "
        f"above the tolerance of {tolerance:g}; a larger resolution allows smaller ones"
    ]


def with_notes(
    equal: ElasticResult, notes: list[str], tolerance: float, seconds: float
) -> ElasticResult:
    """Return an answer of equal cells with what was asked of it, and what is to be said."""
    found = equal.found
    assert isinstance(found, CellAgents)
    found = replace(found, solution=replace(found.solution, notes=notes))
    return replace(equal, found=found, tolerance=tolerance, seconds=seconds)


def cells_notes(equal: ElasticResult, agents: Agents, tolerance: float) -> list[str]:
    """Say why equal cells were taken, and whether they do."""
    return [
        f"{equal.agents:,} {TAKEN} for a tolerance of {tolerance:g}; of agents that "
        f"spawn about {agents.agents:,.0f} were expected",
        *above_note(equal, tolerance),
    ]


def agents_note(cells: EqualCells, tolerance: float) -> str:
    """Say why agents were taken."""
    expected = f"about {cells.cells:,.0f} equal cells were expected"
    if cells.cells == inf:
        expected = "equal cells would not pose the same problem, or not be solved"
    return f"agents were taken for a tolerance of {tolerance:g}; {expected}"
