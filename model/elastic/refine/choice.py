"""Equal cells small enough for a tolerance, and `kaju.solve` with a tolerance alone."""

from __future__ import annotations

from dataclasses import replace
from math import inf, log, sqrt
from time import perf_counter
from typing import Literal

import numpy as np

from kaju.errors import ConvergenceError, SceneError
from kaju.model.elastic.arguments import SMALLEST_TOLERANCE
from kaju.model.elastic.bounds.admissible_displacement import fits_quadratics
from kaju.model.elastic.bounds.energy_bounds import worth_proving
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import is_rubber, scene_moduli
from kaju.model.elastic.posed_body import face_keys
from kaju.model.elastic.refine.solve_spawning import solve_spawning
from kaju.model.elastic.solve import solve
from kaju.model.scene import Scene
from kaju.model.scene.selection import AppliedLoads
from kaju.stopping import interrupt_requested

Method = Literal["box", "matrices", "pressures"]
"""Multigrid of equal cells on full boxes, on other bodies, and in mixed form (rubber)."""
MOST_CELLS: dict[Method, int] = {"box": 40_000_000, "matrices": 8_000_000, "pressures": 1_000_000}
"""More equal cells do not fit in some 10 GB, and are not considered."""
SPARE = 0.9  # Cells are chosen for this share of the tolerance
STRIDE = {2: 4, 3: 2}
"""Refinement of the second run, which measures the order of convergence for the next ones."""
QUICK = {2: 100_000, 3: 20_000}  # Up to so many cells are solved without measuring the order first
ORDER, SLOWEST, FASTEST, PROVED = 0.8, 0.2, 1.0, 2.0
"""Order of convergence: assumed before it is measured, and the least and greatest accepted; the
greatest of bounds in the plane."""
DIVISIONS = sorted({1, *(1 << n for n in range(1, 15)), *(3 << n for n in range(14))})
"""How often a cell may be divided; even numbers suit multigrid."""


class UniformRefinement:
    """Solutions with equal cells, each finer than the last, until one is within the tolerance.

    No cell is smaller than `resolution` allows. The first solution starts from a previous answer.
    If `divides`, cells are divided even where the refined scene differs from the given one (round
    shapes become rounder, point loads sharper). `last` is the finest answer so far; `error` in the
    plane the bound of its error; else the estimate in the energy norm, or that from the change of
    energy since the answer before, if larger.
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
        self.error = self._estimate = inf
        self._order: float | None = None  # of convergence, once measured
        self._agents_estimated = 0  # of the first answer whose estimate kept the tolerance
        self.method: Method = "box" if scene.uniform else "matrices"
        if is_rubber(scene_moduli(scene), scene.plane):
            self.method = "pressures"
        lower, upper = scene.bounds()
        self._cells = float(np.prod((upper - lower).astype(np.float64)))
        self._allowed = DIVISIONS
        if resolution is not None:
            coarser = [k for k in DIVISIONS if k < resolution and resolution % k == 0]
            same = self._poses_the_same(resolution)
            self._allowed = [*coarser, resolution] if same else [resolution]

    @property
    def cells(self) -> float:
        """Expected number of cells that keep the tolerance; infinite if none can."""
        return self._count(self._needed_division()) if self._allowed else inf

    def run(self, most: float) -> ElasticResult | None:
        """Return the first answer that suffices; None if more than `most` cells are expected."""
        while self.cells <= MOST_CELLS[self.method]:
            restarts = self.previous is not None and self.last is None
            if self.cells > most and not restarts:
                return None
            answer = self._step()
            if answer is not None:
                return answer
        return None

    def _step(self) -> ElasticResult | None:
        """Solve once; return the answer if it is within the tolerance, or the finest allowed."""
        dimension = self.scene.lattice.dimension
        division = self._needed_division()
        if self.last is not None and self._order is None and self.cells > QUICK[dimension]:
            measuring = STRIDE[dimension] * self.last.subdivision
            division = self._at_least(min(division, measuring))
        result = self._solved(division)
        if result is None:
            self._allowed = []
            return None
        self._measure(result)
        if interrupt_requested() or division == self.resolution:
            return result
        if min(self.error, self._estimate) > self.tolerance:
            return None
        # The estimate keeps the tolerance; one more refinement may prove it, if that is cheap.
        self._agents_estimated = self._agents_estimated or result.agents
        bound = result.error_bound
        if bound is None or bound <= self.tolerance:
            return result
        if not worth_proving(result.agents << dimension, self._agents_estimated, dimension):
            return result
        self.error = bound
        return None

    def _count(self, division: int) -> float:
        return self._cells * float(division) ** self.scene.lattice.dimension

    def _at_least(self, division: float) -> int:
        return next((k for k in self._allowed if k >= division), self._allowed[-1])

    def _needed_division(self) -> int:
        """Return the division at which the error is expected to keep the tolerance."""
        if self.last is None:
            return self._at_least(1 if self.previous is None else self.previous.subdivision)
        ratio = self.error / (SPARE * self.tolerance)
        needed = self.last.subdivision * max(ratio, 1.0) ** (1.0 / (self._order or ORDER))
        return self._at_least(max(needed, self.last.subdivision + 1))

    def _solved(self, division: int) -> ElasticResult | None:
        """Return the answer on cells of a division, None if they pose another problem or fail."""
        if division not in (1, self.resolution) and not self._poses_the_same(division):
            return None
        try:
            before = None if self.last is not None else self.previous
            return solve(self.scene, resolution=division, stage=self.stage, previous=before)
        except (SceneError, ConvergenceError):
            if interrupt_requested():
                raise
            return None

    def _measure(self, result: ElasticResult) -> None:
        """Take an answer as the last, and measure its error and the order of convergence."""
        last, self.last = self.last, result
        error_before, division = self.error, result.subdivision
        self._cells = float(result.agents) / division**self.scene.lattice.dimension
        self.error = self._estimate = result.error_estimate
        second = fits_quadratics(self.scene.lattice.dimension, result.agents)
        bound = result.error_bound if second else None
        finer = division / last.subdivision if last is not None else 1.0
        if bound is not None:
            self.error = bound
        elif last is not None:
            # Energies differ by the squares of the errors, e_c² - e_f² with e_c ≤ finer · e_f
            # (order ≤ 1), so e_f² is at least their difference by finer² - 1.
            gap = abs(last.strain_energy / result.strain_energy - 1.0)
            self.error = self._estimate = max(self.error, sqrt(gap / (finer**2 - 1.0)))
        if last is not None and self.error > 0.0:
            order = log(max(error_before, self.error) / self.error) / log(finer)
            self._order = min(max(order, SLOWEST), FASTEST if bound is None else PROVED)

    def _poses_the_same(self, division: int) -> bool:
        """Tell whether the refined scene is the same body under the same loads."""
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
    """Tell whether the loads on refined cells are those of the scene's cells, evenly spread."""
    coarse_loads, fine_loads = _summed_loads(scene, stage), _summed_loads(fine, stage)
    d = scene.lattice.dimension
    # Every fine load has to lie on the loaded face of the coarse cell that it is in.
    inside = fine_loads.direction < 0
    axis, upper = np.divmod(fine_loads.direction, 2)
    cells, offset = np.divmod(fine_loads.cells, division)
    depth = offset[np.arange(len(axis)), axis]
    on_face = inside | (depth == upper * (division - 1))
    # The coarse load of every fine one, by bisection in the sorted keys.
    key = face_keys(scene.lattice, cells, fine_loads.direction)
    coarse_key = face_keys(scene.lattice, coarse_loads.cells, coarse_loads.direction)
    at = np.minimum(np.searchsorted(coarse_key, key), max(len(coarse_key) - 1, 0))
    # Together they have to cover every coarse face or cell completely.
    count = (float(division) ** np.where(coarse_loads.direction < 0, d, d - 1)).sum()
    if len(key) != count or not np.all(on_face) or not np.array_equal(coarse_key[at], key):
        return False
    share = float(division) ** -np.where(inside, d, d - 1)
    largest = np.abs(coarse_loads.force).max(initial=0.0)
    difference = np.abs(fine_loads.force / share[:, None] - coarse_loads.force[at])
    return bool(np.all(difference <= 1e-9 * largest))


def _summed_loads(scene: Scene, stage: int | None) -> AppliedLoads:
    """Return the loads, those on the same face of a cell summed, in the order of their keys."""
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
    """Solve a scene to a tolerance by agents that spawn, or by equal cells if these are given."""
    if previous is not None:
        return solve_equal(scene, tolerance, resolution, stage=stage, previous=previous)
    return solve_spawning(scene, tolerance, resolution, stage=stage, most_agents=most_agents)


def solve_equal(
    scene: Scene,
    tolerance: float,
    resolution: int | None = None,
    *,
    stage: int | None = None,
    previous: ElasticResult | None = None,
) -> ElasticResult:
    """Solve a scene by equal cells that are small enough for a tolerance.

    With a resolution all cells have that size; if their error is above the tolerance, the answer's
    notes say so. Their equations are always solved to the tolerance.
    """
    start = perf_counter()
    if resolution is not None or tolerance < SMALLEST_TOLERANCE:
        result = solve(scene, tolerance, resolution, stage=stage, previous=previous)
        return _finished(result, _missed_note(result, tolerance), tolerance, start)
    cells = UniformRefinement(scene, tolerance, None, stage, previous, divides=True)
    best = cells.run(most=inf)
    if best is None and cells.last is not None and cells.last.error_estimate <= tolerance:
        best = cells.last
    if best is not None:
        return _finished(best, [], tolerance, start)
    raise ConvergenceError(
        f"solve: a tolerance of {tolerance:g} needs about {cells.cells:.2g} equal cells, more than "
        "fit, or cells that cannot be solved; take a larger tolerance, or strategy='spawning'. The "
        "error's `best` holds the result so far",
        () if cells.last is None else cells.last.residuals,
        cells.last,
    )


def _missed_note(result: ElasticResult, tolerance: float) -> list[str]:
    """Return a note if the smallest cells allowed miss the tolerance."""
    if result.error_estimate <= tolerance:
        return []
    return [
        f"the smallest cells allowed leave an estimated error of {result.error_estimate:.2g}, "
        f"above the tolerance of {tolerance:g}; a larger resolution allows smaller ones"
    ]


def _finished(
    result: ElasticResult, notes: list[str], tolerance: float, start: float
) -> ElasticResult:
    """Return an answer with its tolerance, more notes, and the seconds since `start`."""
    result.found.solution.notes.extend(notes)
    return replace(result, tolerance=tolerance, seconds=perf_counter() - start)
