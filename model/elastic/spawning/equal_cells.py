"""Equal cells on the way to a tolerance: from the scene's own to ever smaller ones."""

from __future__ import annotations

from math import inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ConvergenceError, SceneError
from kaju.model.elastic.bracket import worth_proving
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.solve import solve
from kaju.model.scene import Scene
from kaju.model.scene.applied import AppliedLoads
from kaju.model.scene.lattice import Cells
from kaju.stopping import stopped

from .costs import CELLS, MOST_CELLS, Cost, method_of

SPARE = 0.9
"""Cells are chosen for this share of the tolerance."""
STRIDE = {2: 4, 3: 2}
"""Cells this many times smaller tell how the error falls, where many more may be needed."""
QUICK = 0.1
"""Seconds for which it is not worth while to find out."""
ORDER, SLOWEST, FASTEST = 0.8, 0.2, 1.0
"""Powers of the cells' size with which the error is taken to fall: before it is known, the
least and the greatest."""
HARDLY_MORE = 1.1
"""Smaller cells are taken if they cost less than so many times as much."""
DIVISIONS = sorted({1, *(1 << n for n in range(1, 15)), *(3 << n for n in range(14))})
"""How often a cell may be divided; even numbers suit multigrid."""


class EqualCells:
    """Runs with equal cells, one finer than the other, until one is within the tolerance.

    Parameters
    ----------
    scene : Scene
    tolerance : float
        Relative error in the energy norm.
    resolution : int or None
        The cells that describe the body, per cell of the scene; none may be smaller.
    stage : int or None
    previous : ElasticResult, optional
        The answer to a scene of which something was changed: the first run continues from it.
    divides : bool
        Divide cells even where smaller ones make round shapes rounder and point loads sharper.

    Attributes
    ----------
    last : ElasticResult or None
        The finest answer so far.
    error : float
        Its estimated error in the energy norm: its own estimate, or what the energy of the
        answer before tells, if that is more.
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
        self._method = method_of(scene)
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
    def seconds(self) -> float:
        """What they are expected to cost; infinite if they cannot do."""
        if self.cells > MOST_CELLS[self._method]:
            return inf
        return self._cost.of(self.cells)

    @property
    def continues(self) -> bool:
        """Whether a previous answer waits to be continued."""
        return self.previous is not None and self.last is None and bool(self._allowed)

    def step(self) -> ElasticResult | None:
        """Run once; return the answer if it is within the tolerance, or the finest allowed."""
        division = self._last_division()
        if self.last is not None and self._order is None and self.seconds > QUICK:
            stride = STRIDE[self.scene.lattice.dimension]
            division = self._at_least(min(division, stride * self.last.subdivision))
        result = self._solved(division)
        if result is None:
            self._allowed = []
            return None
        self._learn(result)
        enough = stopped() or self._enough(result) or division == self.resolution
        return result if enough else None

    def _enough(self, result: ElasticResult) -> bool:
        """Tell whether the error is within the tolerance, and proved to be if that can be."""
        if self.error > self.tolerance:
            return False
        self._estimated = self._estimated or result.agents
        many = 1 << self.scene.lattice.dimension
        bound = result.error_bound if result.provable else None
        if bound is None or bound <= self.tolerance:
            return True
        if not worth_proving(many * result.agents, self._estimated):
            return True
        self.error = bound
        return False

    @property
    def _cost(self) -> Cost:
        return CELLS[self._method, self.scene.lattice.dimension]

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
        fewest = self._at_least(max(needed, self.last.subdivision + 1))
        worth = HARDLY_MORE * self._cost.of(self._count(fewest))
        return max(
            k for k in self._allowed if k <= fewest or self._cost.of(self._count(k)) <= worth
        )

    def _solved(self, division: int) -> ElasticResult | None:
        """Return the answer of cells so small, None if they cannot do."""
        if division not in (1, self.resolution) and not self._poses_the_same(division):
            return None
        try:
            before = None if self.last is not None else self.previous
            return solve(self.scene, resolution=division, stage=self.stage, previous=before)
        except (SceneError, ConvergenceError):
            if stopped():
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
        """Tell whether smaller cells are of the same body under the same loads.

        Round shapes become rounder on smaller cells, and loads at points sharper.
        """
        if division == 1 or self._divides:
            return True
        if self._count(division) > MOST_CELLS[self._method]:
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
    key = _keys(scene, cells, parts.direction)
    known = _keys(scene, whole.cells, whole.direction)
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
    keys = _keys(scene, applied.cells, applied.direction)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    force = np.zeros((len(first), scene.lattice.dimension))
    np.add.at(force, inverse, applied.force)
    return AppliedLoads(applied.cells[first], applied.direction[first], force)


def _keys(scene: Scene, cells: Cells, direction: NDArray[np.int64]) -> NDArray[np.int64]:
    lattice = scene.lattice
    return lattice.key(cells) * (2 * lattice.dimension + 1) + direction + 1
