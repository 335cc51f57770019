"""Multigrid on the generations of agents, where these are many and of high contrast.

The stiffness matrices of all generations and the interpolation between them make one symmetric
V-cycle, which preconditions conjugate gradients; the first generation is factorised. Where
materials differ coarse matrices are the fine one's, projected: P'AP (Galerkin's condition).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import inf, sqrt

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from kaju.arrays import Floats
from kaju.factors import factors_of
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.cells.interpolation import prolongation
from kaju.model.elastic.equal.krylov import Iteration, conjugate_gradients, dot
from kaju.model.elastic.equal.problem import ACTIVE
from kaju.model.elastic.moduli import is_rubber

WORTHWHILE = 0.7  # Coarser cells that are more than this share of the finer ones make no level
DEGREE, LOW = 4, 0.15
"""Of the smoothing polynomial, and the share of the spectrum, from above, that it leaves alone."""
FACTORISED, PATIENCE, MOST = {2: 400_000, 3: 30_000}, 40, {2: 100, 3: 400}
"""A generation of up to so many faces that does not settle in PATIENCE iterations is factorised;
larger ones get MOST iterations: in the plane a hundred take a minute."""
DIRECT, SEVERAL = {2: 150_000, 3: 5_000}, {2: 150_000, 3: 5_000}
"""Generations of fewer faces are factorised, and serve as the coarsest level: of one material, and
of several, where P'AP makes the coarsest matrix denser."""
RUBBER = {2: 400_000, 3: 15_000}
"""Up to so many faces every generation is factorised if a material is nearly incompressible."""
LAST = 1e-10  # Share of an answer to which its last generation settles
WORST = 0.05  # A displacement whose error is above this share does not show which cells to refine


class NestedMultigrid:
    """A hierarchy that grows by a generation at a time, the finest last."""

    def __init__(self, balance: Equilibrium) -> None:
        ground = balance.grid.ground
        self._several = len(np.unique(ground.moduli.stretch)) > 1
        limits = SEVERAL if self._several else DIRECT
        limits = RUBBER if is_rubber(ground.moduli, ground.scene.plane) else limits
        direct = self._direct_limit = limits[ground.dimension]  # Faces of a factorised generation
        self._levels: list[_NestedLevel] = []
        ancestors = [balance]
        while len(ancestors[-1].free) > direct:
            grid = ancestors[-1].grid
            leaves = grid.ground.parents(grid.leaves)
            if len(leaves) > WORTHWHILE * len(grid.leaves):
                break
            ancestors.append(Equilibrium(CompositeGrid(grid.ground, leaves)))
        self._balance = ancestors[-1]
        self._factorise(ancestors[-1])
        for younger in reversed(ancestors[:-1]):
            self.grow(younger, self._balance.grid.value)

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self._levels)

    @property
    def matrix(self) -> sp.csr_array:
        """Stiffness among the free faces of the finest generation."""
        return self._levels[-1].matrix

    def grow(self, balance: Equilibrium, before: Floats) -> Floats:
        """Add a generation; return a displacement to begin with, after one of the last."""
        grid, start = balance.grid, balance.grid.value.copy()
        if len(balance.free) <= self._direct_limit:
            self._factorise(balance)  # a direct solution needs no start
        else:
            whole = prolongation(self._balance.grid, grid)
            start = np.where(grid.state == ACTIVE, whole @ before, start)
            prolong = sp.csr_array(whole[balance.free][:, self._balance.free])
            self._levels.append(_NestedLevel(balance.stiffness(balance.free), prolong))
            self._projected = not self._several
        self._balance = balance
        return start

    def solve(
        self,
        right: Floats,
        start: Floats,
        done: Callable[[Iteration], bool],
        energy: Callable[[Floats], float] | None = None,
    ) -> Iteration:
        """Return the displacements of the free faces of the finest generation."""
        if not self._projected:
            self._project()
        dimension, matrix = self._balance.grid.dimension, self.matrix

        def run_from(x: Floats, most: int) -> Iteration:
            return conjugate_gradients(
                lambda p: np.asarray(matrix @ p), self.precondition, right, x, done, most, energy
            )

        if len(right) > FACTORISED[dimension]:
            return run_from(start, MOST[dimension])
        run = run_from(start, PATIENCE)
        if not run.converged:
            self._factorise(self._balance)
            run = run_from(run.solution, PATIENCE)
        return run

    def prolonged(self, displacement: Floats) -> Floats:
        """Return the displacement of the free faces, interpolated from the generation before."""
        level = self._levels[-1]
        if level.prolong is None or level.prolong.shape[1] != len(displacement):
            return np.zeros(level.matrix.shape[0])
        return np.asarray(level.prolong @ displacement)

    def precondition(self, load: Floats) -> Floats:
        """Return one V-cycle's answer to a load."""
        return self._cycle(len(self._levels) - 1, load)

    def _project(self) -> None:
        """Give coarser levels the stiffness P'AP, from the finest on."""
        for level, coarse in pairwise(self._levels[::-1]):
            assert level.prolong is not None
            coarse.take(sp.csr_array(level.prolong.T @ (level.matrix @ level.prolong)))
        self._direct = _factors(self._levels[0].matrix)
        self._projected = True

    def _factorise(self, balance: Equilibrium) -> None:
        self._projected = True
        self._levels = [_NestedLevel(balance.stiffness(balance.free))]
        self._direct = _factors(self._levels[0].matrix)

    def _cycle(self, at: int, load: Floats) -> Floats:
        level = self._levels[at]
        if level.prolong is None:
            return np.asarray(self._direct.solve(load))
        x = np.zeros_like(load)
        level.smooth(load, x)
        residual = load - level.matrix @ x
        x += level.prolong @ self._cycle(at - 1, np.asarray(level.prolong.T @ residual))
        level.smooth(load - level.matrix @ x, x)
        return x


class _NestedLevel:
    """One generation: its stiffness, the interpolation to it, and the smoother of new faces.

    Faces that are as in the generation before are smoothed there (Brandt 1977), so that a cycle
    over all generations costs little more than one sweep over the last.
    """

    def __init__(self, matrix: sp.csr_array, prolong: sp.csr_array | None = None) -> None:
        self.prolong = prolong
        if prolong is not None:
            kept = np.diff(prolong.indptr) == 1
            kept[kept] = prolong.data[prolong.indptr[:-1][kept]] == 1.0
            # Rows with an entry in a column of those that are not as before.
            row = np.repeat(np.arange(len(kept)), np.diff(matrix.indptr))
            self.rows = np.flatnonzero(np.bincount(row, ~kept[matrix.indices], len(kept)) > 0.0)
        self.take(matrix)

    def take(self, matrix: sp.csr_array) -> None:
        """Take a stiffness among the free faces."""
        self.matrix = matrix
        if self.prolong is None:
            return
        self._among = sp.csr_array(matrix[self.rows][:, self.rows])
        own = self._among.diagonal()
        self._inverse = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0)
        # No eigenvalue of D⁻¹A is larger than a row's sum of sizes (Gershgorin).
        sums = np.asarray(abs(self._among).sum(axis=1)).ravel() * self._inverse
        self._largest = float(sums.max(initial=1.0))

    def smooth(self, residual: Floats, x: Floats) -> None:
        """Smooth the displacement of new faces, in place, by Chebyshev's polynomial."""
        # It is least for the upper part of the spectrum, which coarser cells do not see (Adams et
        # al. 2003), by the recurrence of Chebyshev's polynomials (Saad 2003, algorithm 12.1).
        centre, half = 0.5 * self._largest * (1.0 + LOW), 0.5 * self._largest * (1.0 - LOW)
        residual, inverse = residual[self.rows], self._inverse
        step, rho = inverse * residual / centre, half / centre
        total = step.copy()
        for _ in range(DEGREE - 1):
            residual -= self._among @ step
            last, rho = rho, 1.0 / (2.0 * centre / half - rho)
            step = rho * (last * step + 2.0 / half * (inverse * residual))
            total += step
        x[self.rows] += total


def _factors(matrix: sp.csr_array) -> SuperLU:
    """Return the factors of a matrix, guarded against coarse faces that no finer one follows."""
    diagonal = matrix.diagonal()
    guard = np.where(diagonal > 0, 1e-15 * diagonal, 1.0)
    return factors_of(matrix + sp.diags_array(guard))


def settle(balance: Equilibrium, hierarchy: NestedMultigrid, u: Floats, share: float) -> Iteration:
    """Solve for the free faces of `u`, in place, to a relative algebraic error."""
    free = balance.free
    right = (balance.load - balance.pull)[free]
    load, prescribed = balance.load[free], balance.strain(balance.grid.value)
    given = float(dot(prescribed, balance.stress(prescribed)))  # while the free faces rest

    def twice_energy(x: Floats) -> float:
        return 2 * float(dot(x, load)) - float(dot(x, right)) + given

    def done(run: Iteration) -> bool:
        return run.errors[-1] <= min(share, WORST) or run.at_rounding()

    run = hierarchy.solve(right, u[free], done, twice_energy)
    u[free] = run.solution
    return run


def energy_of(balance: Equilibrium, u: Floats) -> float:
    """Return the energy, of second order in what the iteration left."""
    free = balance.free
    residual = balance.force(u)[free] - balance.load[free]
    return balance.energy(u) - float(dot(residual, u[free]))


def relative_error(square: Floats, energy: float) -> float:
    """Return the estimated error in the energy norm, relative to a solution of some energy."""
    total = float(square.sum())
    if energy <= 0.0:
        return 0.0 if total == 0.0 else inf
    return sqrt(total / (2 * energy))
