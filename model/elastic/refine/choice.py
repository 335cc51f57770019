"""`kaju.solve` with a tolerance and no strategy: equal cells, or agents that spawn.

The scene's own cells are solved first, unless these are more than agents would be. Their error
tells how many of a smaller size it takes: where nothing is local these are few, and they are
solved. Elsewhere, or when they turn out to be more, agents spawn.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, log, sqrt
from time import perf_counter
from typing import Literal

import numpy as np

from kaju.errors import ConvergenceError, SceneError
from kaju.model.elastic.arguments import SMALLEST_TOLERANCE, check_numbers
from kaju.model.elastic.bounds.energy_bounds import worth_proving
from kaju.model.elastic.cell_agents import CellAgents
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.posed_body import face_keys
from kaju.model.elastic.problem import is_rubber
from kaju.model.elastic.refine.block_loop import FEWEST, MOST_AGENTS, SPREAD
from kaju.model.elastic.refine.solve_spawning import solve_spawning
from kaju.model.elastic.solve import solve
from kaju.model.scene import Scene
from kaju.model.scene.selection import AppliedLoads
from kaju.stopping import interrupt_requested

WORTH: dict[Method, int] = {"box": 10, "matrices": 5, "pressures": 2}
"""An agent, spawned generation by generation, costs as much as so many equal cells."""
SPARE = 0.9  # Cells are chosen for this share of the tolerance
STRIDE = {2: 4, 3: 2}
"""Cells this many times smaller tell how the error falls, where many more may be needed."""
QUICK = {2: 100_000, 3: 20_000}  # So few cells are solved without finding out
ORDER, SLOWEST, FASTEST = 0.8, 0.2, 1.0
"""Powers of the cells' size with which the error is taken to fall: before it is known, the
least and the greatest."""
DIVISIONS = sorted({1, *(1 << n for n in range(1, 15)), *(3 << n for n in range(14))})
"""How often a cell may be divided; even numbers suit multigrid."""
MOST_CELLS: dict[Method, int] = {"box": 40_000_000, "matrices": 8_000_000, "pressures": 1_000_000}
"""More equal cells do not fit in some 10 GB, and are not considered."""
Method = Literal["box", "matrices", "pressures"]
"""Equal cells of full boxes, of other bodies, and with pressures of their own (rubber)."""


class UniformRefinement:
    """Runs with equal cells, one finer than the other, until one is within the tolerance.

    None is smaller than the cells that describe the body (`resolution`). The first run continues
    from a previous answer. Cells are divided even where smaller ones make round shapes rounder and
    point loads sharper if `divides`. `last` is the finest answer so far; `error` its own estimate
    in the energy norm, or what the energy of the answer before tells, if that is more.
    """

    def __init__(
        self,
        scene: Scene,
        tolerance: float,
        resolution: int | None,
        stage: int | None,
        previous: ElasticResult | None = None,
        divides: bool = False,
    ) -> None:
        self.scene, self.tolerance = scene, tolerance
        self.resolution, self.stage, self.previous = resolution, stage, previous
        self._divides = divides
        self.last: ElasticResult | None = None
        self.error = inf
        self._order: float | None = None
        self._estimated = 0
        self.method: Method = "box" if scene.uniform else "matrices"
        if is_rubber(scene_moduli(scene), scene.plane):
            self.method = "pressures"
        lower, upper = scene.bounds()
        self._cells = float(np.prod((upper - lower).astype(np.float64)))
        self._allowed = DIVISIONS
        if resolution is not None:
            within = [k for k in DIVISIONS if k < resolution and resolution % k == 0]
            self._allowed = (
                [*within, resolution] if self._poses_the_same(resolution) else [resolution]
            )

    @property
    def cells(self) -> float:
        """How many cells are expected to do; infinite if none can."""
        return inf if not self._allowed else self._count(self._last_division())

    @property
    def fit(self) -> bool:
        """Whether so many can be solved."""
        return self.cells <= MOST_CELLS[self.method]

    @property
    def continues(self) -> bool:
        """Whether a previous answer waits to be continued."""
        return self.previous is not None and self.last is None and bool(self._allowed)

    def step(self) -> ElasticResult | None:
        """Run once; return the answer if it is within the tolerance, or the finest allowed."""
        division = self._last_division()
        many = self.cells > QUICK[self.scene.lattice.dimension]
        if self.last is not None and self._order is None and many:
            stride = STRIDE[self.scene.lattice.dimension]
            division = self._at_least(min(division, stride * self.last.subdivision))
        result = self._solved(division)
        if result is None:
            self._allowed = []
            return None
        self._learn(result)
        if interrupt_requested() or division == self.resolution:
            return result
        if self.error <= self.tolerance:
            # It is to be proved as well, if that can be.
            self._estimated = self._estimated or result.agents
            dimension = self.scene.lattice.dimension
            bound = result.error_bound if result.provable else None
            if bound is None or bound <= self.tolerance:
                return result
            if not worth_proving(result.agents << dimension, self._estimated, dimension):
                return result
            self.error = bound
        return None

    def _count(self, division: int) -> float:
        return self._cells * float(division) ** self.scene.lattice.dimension

    def _at_least(self, division: float) -> int:
        return next((k for k in self._allowed if k >= division), self._allowed[-1])

    def _last_division(self) -> int:
        """Return how often cells are expected to be divided in the end."""
        if self.last is None:
            return self._at_least(1 if self.previous is None else self.previous.subdivision)
        ratio = self.error / (SPARE * self.tolerance)
        needed = self.last.subdivision * max(ratio, 1.0) ** (1.0 / (self._order or ORDER))
        return self._at_least(max(needed, self.last.subdivision + 1))

    def _solved(self, division: int) -> ElasticResult | None:
        """Return the answer of cells so small, None if they cannot do."""
        if division not in (1, self.resolution) and not self._poses_the_same(division):
            return None
        try:
            before = None if self.last is not None else self.previous
            return solve(self.scene, resolution=division, stage=self.stage, previous=before)
        except (SceneError, ConvergenceError):
            if interrupt_requested():
                raise
            return None

    def _learn(self, result: ElasticResult) -> None:
        """Note how many cells there are, how far off they are, and how fast the error falls."""
        last, self.last = self.last, result
        division = result.subdivision
        self._cells = float(result.agents) / division**self.scene.lattice.dimension
        self.error = result.error_estimate
        if last is None or not self.error > 0.0:
            return
        finer = division / last.subdivision
        order = log(max(last.error_estimate, self.error) / self.error) / log(finer)
        self._order = min(max(order, SLOWEST), FASTEST)
        # Energies differ by squares of errors, that of the coarser cells less ours, which is the
        # (finer²)th part of it at least.
        gap = abs(last.strain_energy / result.strain_energy - 1.0)
        self.error = max(self.error, sqrt(gap / (finer**2 - 1.0)))

    def _poses_the_same(self, division: int) -> bool:
        """Tell whether smaller cells are of the same body under the same loads."""
        # Round shapes become rounder on smaller cells, and loads at points sharper.
        if division == 1 or self._divides:
            return True
        if self._count(division) > MOST_CELLS[self.method]:
            return False
        fine = self.scene.refine(division)
        if not self.scene.uniform:
            cells = self.scene.rasterise()
            for axis in range(cells.ndim):
                cells = cells.repeat(division, axis=axis)
            if not np.array_equal(cells, fine.rasterise()):
                return False
        return same_loads(self.scene, fine, division, self.stage)


def same_loads(scene: Scene, fine: Scene, division: int, stage: int | None) -> bool:
    """Tell whether the loads on smaller cells are those of the scene's cells, evenly spread."""
    whole, parts = _added_up(scene, stage), _added_up(fine, stage)
    inside = parts.direction < 0
    axis, upper = np.divmod(parts.direction, 2)
    cells, offset = np.divmod(parts.cells, division)
    depth = offset[np.arange(len(axis)), axis]
    on_face = inside | (depth == upper * (division - 1))
    key = face_keys(scene.lattice, cells, parts.direction)
    known = face_keys(scene.lattice, whole.cells, whole.direction)
    at = np.minimum(np.searchsorted(known, key), max(len(known) - 1, 0))
    d = scene.lattice.dimension
    count = (float(division) ** np.where(whole.direction < 0, d, d - 1)).sum()
    if len(key) != count or not np.all(on_face) or not np.array_equal(known[at], key):
        return False
    share = float(division) ** -np.where(inside, d, d - 1)
    largest = np.abs(whole.force).max(initial=0.0)
    return bool(np.all(np.abs(parts.force / share[:, None] - whole.force[at]) <= 1e-9 * largest))


def _added_up(scene: Scene, stage: int | None) -> AppliedLoads:
    """Return the loads with those on one face of a cell added up, in the order of their keys."""
    applied = scene.applied(stage)
    keys = face_keys(scene.lattice, applied.cells, applied.direction)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    force = np.zeros((len(first), scene.lattice.dimension))
    np.add.at(force, inverse, applied.force)
    return AppliedLoads(applied.cells[first], applied.direction[first], force)


def solve_cheaply(
    scene: Scene,
    tolerance: float,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    most_agents: int | None = None,
    previous: ElasticResult | None = None,
) -> ElasticResult:
    """Solve a scene to a tolerance by equal cells or by agents, whichever is cheaper."""
    # Arguments and errors are those of `kaju.solve`. The scene's cells may be divided; equal cells
    # are considered only if they pose the same problem when they are. As many as in the previous
    # answer are tried first. The answer's notes say what was chosen, and why.
    start = perf_counter()
    check_numbers(tolerance, resolution)
    cells = UniformRefinement(scene, tolerance, resolution, stage, previous)
    d = scene.lattice.dimension
    expected = SPREAD * FEWEST[d] / tolerance**d
    allowed = expected <= SPREAD * (most_agents or MOST_AGENTS[d])
    most = WORTH[cells.method] * expected if allowed else inf
    while cells.fit and (cells.continues or cells.cells <= most):
        equal = cells.step()
        if equal is not None:
            taken = (
                f"{equal.agents:,} equal cells were taken for a tolerance of {tolerance:g}; of "
                f"agents that spawn about {expected:,.0f} were expected"
            )
            said = [taken, *above_note(equal, tolerance)]
            return with_notes(equal, said, tolerance, perf_counter() - start)
    told = f"about {cells.cells:,.0f} equal cells were expected"
    if cells.cells == inf:
        told = "equal cells would not pose the same problem, or not be solved"
    note = f"agents were taken for a tolerance of {tolerance:g}; {told}"
    return solve_spawning(
        scene, tolerance, resolution, stage=stage, most_agents=most_agents, note=note
    )


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
    """
    start = perf_counter()
    if resolution is not None or tolerance < SMALLEST_TOLERANCE:
        result = solve(scene, tolerance, resolution, stage=stage, previous=previous)
        said = above_note(result, tolerance)
        return with_notes(result, said, tolerance, perf_counter() - start)
    cells = UniformRefinement(scene, tolerance, None, stage, previous, divides=True)
    while cells.fit:
        enough = cells.step()
        if enough is not None:
            return with_notes(enough, [], tolerance, perf_counter() - start)
    best = cells.last
    if best is not None and best.error_estimate <= tolerance:
        return with_notes(best, [], tolerance, perf_counter() - start)
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
    equal: ElasticResult, said: list[str], tolerance: float, seconds: float
) -> ElasticResult:
    """Return an answer of equal cells with what was asked of it, and what else is to be said."""
    found = equal.found
    assert isinstance(found, CellAgents)
    found = replace(found, solution=replace(found.solution, notes=[*found.solution.notes, *said]))
    return replace(equal, found=found, tolerance=tolerance, seconds=seconds)
