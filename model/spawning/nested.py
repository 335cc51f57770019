"""Multigrid on the generations of agents.

Every generation of agents holds the one before: their stiffness matrices, and the
interpolation from parents to children, are the levels of one symmetric V-cycle, which
preconditions conjugate gradients. The first generation is factorised.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from kaju.model.elasticity.krylov import Iteration, conjugate_gradients
from kaju.model.elasticity.sparse_multigrid import Level

from .balance import Balance
from .composite import Composite, Floats
from .field import prolongation

WORTHWHILE = 0.7
"""Parents that are more than this share of their children are not worth a level."""
SWEEPS = 2
DIRECT = {2: 6_000, 3: 2_500}
"""Generations of fewer faces are factorised, and serve as the coarsest level."""


class NestedMultigrid:
    """A hierarchy that grows by a generation at a time, the finest last."""

    def __init__(self, balance: Balance, direct: int) -> None:
        self._direct_limit = direct
        self._levels: list[Level] = []
        ancestors = [balance]
        while len(ancestors[-1].free) > direct:
            grid = ancestors[-1].grid
            leaves = grid.ground.parents(grid.leaves)
            if len(leaves) > WORTHWHILE * len(grid.leaves):
                break
            ancestors.append(Balance(Composite(grid.ground, leaves)))
        self._balance = ancestors[-1]
        self._factorise(ancestors[-1])
        for younger in reversed(ancestors[:-1]):
            self.grow(younger)

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self._levels)

    def grow(self, balance: Balance) -> sp.csr_array:
        """Add a generation; return the interpolation to all its faces."""
        whole = prolongation(self._balance.grid, balance.grid)
        if len(balance.free) <= self._direct_limit:
            self._factorise(balance)
        else:
            prolong = sp.csr_array(whole[balance.free][:, self._balance.free])
            level = _level(balance)
            level.prolong = prolong
            self._levels.append(level)
        self._balance = balance
        return whole

    def solve(
        self,
        right: Floats,
        start: Floats,
        done: Callable[[Iteration], bool],
        energy: Callable[[Floats], float],
    ) -> Iteration:
        """Return the displacements of the free faces of the finest generation."""
        matrix = self._levels[-1].matrix

        def apply(x: Floats) -> Floats:
            return np.asarray(matrix @ x)

        return conjugate_gradients(apply, self.precondition, right, start, done, 200, energy)

    def precondition(self, load: Floats) -> Floats:
        """Return one V-cycle's answer to a load."""
        return self._cycle(len(self._levels) - 1, load)

    def _factorise(self, balance: Balance) -> None:
        self._levels = [_level(balance)]
        self._direct = splu(
            sp.csc_array(self._levels[0].matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def _cycle(self, at: int, load: Floats) -> Floats:
        level = self._levels[at]
        if level.prolong is None:
            return np.asarray(self._direct.solve(load))
        x = np.zeros_like(load)
        for _ in range(SWEEPS):
            level.sweep(load, x, backward=False)
        left = load - level.matrix @ x
        x += level.prolong @ self._cycle(at - 1, np.asarray(level.prolong.T @ left))
        for _ in range(SWEEPS):
            level.sweep(load, x, backward=True)
        return x


def _level(balance: Balance) -> Level:
    free = balance.free
    matrix = sp.csr_array(balance.stiffness[free][:, free])
    diagonal = matrix.diagonal()
    inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    return Level(matrix, inverse)
