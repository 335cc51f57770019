"""Multigrid on blocks of agents: conjugate gradients, preconditioned by one symmetric V-cycle.

Every level of blocks is smoothed while larger agents stay fixed (Brandt 1977): block after block
takes its neighbours' latest displacements and some Chebyshev steps, in the fastest memory. The
first level is one of equal cells, with their hierarchy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.elastic.cells.leaf_supports import check_held
from kaju.model.elastic.multigrid import block_kernels as kernels
from kaju.model.elastic.multigrid.block_types import PLACES, BlockTypes, ghost_rules
from kaju.model.elastic.multigrid.blocks import BlockOperator, BlockRows, Window
from kaju.model.elastic.multigrid.forest import ACROSS, offsets
from kaju.model.elastic.multigrid.hierarchy import Hierarchy
from kaju.model.elastic.multigrid.krylov import Iteration, conjugate_gradients, dot
from kaju.model.elastic.problem import ElasticProblem, face_zeros
from kaju.model.elastic.supports import check_supports
from kaju.model.scene.cell_types import AIR

STEPS = 4  # Chebyshev steps within a block
STIFF = 0.6
"""Forces of irregular rows are frozen while a block is smoothed: their diagonal, with the sizes of
all entries of a row summed up, stands in for them, times this. From 0.5 on no cycle enlarges an
error, whatever the rows: a sum of squares |v·u|² is at most that diagonal's (Gershgorin)."""
SAFETY = 1.03  # Of the bound on the largest eigenvalue


class Root:
    """The first level: its agents as equal cells without loads, `problem`, and their hierarchy."""

    def __init__(self, balance: BlockOperator) -> None:
        forest, ground = balance.forest, balance.forest.ground
        d, last = forest.dimension, int(forest.start[1])
        block: Ints = (forest.lower[:last] - forest.lower[:last].min(axis=0)) // forest.edge
        kinds: Ints = np.full(block.max(axis=0) + 3, AIR)
        for way, step in enumerate(offsets(d)):
            kinds[tuple((block + 1 + step).T)] = forest.kinds[:last, way]
        for axis in range(d):
            kinds = kinds.repeat(ACROSS, axis=axis)
        rim = kinds[(slice(ACROSS - 1, 1 - ACROSS),) * d]
        cells = np.ascontiguousarray(rim, dtype=np.int32)
        nothing, fields = face_zeros(cells), face_zeros(cells)
        self.problem = ElasticProblem(
            cells, ground.moduli, nothing, nothing, nothing, {},
            ground.scales, ground.scene.plane,
        )  # fmt: skip
        self._hierarchy = Hierarchy(self.problem)
        self._scale = float(balance.scale[0])
        # Where every unknown place is in the hierarchy's vectors.
        at = np.argwhere(balance.types.mask[balance.type_of[0, :last]] > 0)
        number: Ints = np.asarray(np.ravel_multi_index(tuple(at.T), balance.shape))
        place: Ints = np.stack(np.unravel_index(at[:, 2], (PLACES,) * d), axis=1)
        cell: Ints = block[at[:, 0]] * ACROSS + place
        for axis in range(d):
            own = at[:, 1] == axis
            fields[axis][tuple(cell[own].T)] = number[own] + 1.0
        vector = self._hierarchy.gather(fields)
        self._index = np.flatnonzero(vector)
        self._place = vector[self._index].astype(np.int64) - 1
        self._load = np.zeros_like(vector)

    def solve(self, load: Floats, u: Floats) -> None:
        """Write one V-cycle's answer to a load, both over places."""
        self._load[self._index] = load[self._place]
        u[self._place] = self._hierarchy.precondition(self._load)[self._index] / self._scale

    def check_held(self, balance: BlockOperator) -> None:
        """Refuse a body of which a part could move without straining."""
        forest, cell = balance.forest, balance.forest.ground.cell
        size = int(forest.size[0])
        if size <= cell:
            origin = forest.lower[: forest.start[1]].min(axis=0) // cell
            check_supports(self.problem, tuple(int(i) for i in origin), cell // size)
        else:
            check_held(Window(forest, np.arange(forest.start[1])).balance)


class BlockCycle:
    """The V-cycle on a forest, and conjugate gradients with it.

    `real` is the type of the V-cycle's numbers: in short ones it takes two thirds of the time and
    the iteration as many cycles, unless the body is so slender that rounding hides how it strains.
    """

    def __init__(
        self, balance: BlockOperator, root: Root | None = None, real: type = np.float32
    ) -> None:
        self.balance, self.real, forest = balance, real, balance.forest
        self.root = root or Root(balance)
        self.ghost_rules = ghost_rules(forest.kinds, forest.states(composite=False))
        self._parents = [
            np.flatnonzero(~forest.leaf[a:b]) + a
            for a, b in zip(forest.start[:-1], forest.start[1:], strict=True)
        ]
        self._diagonals()
        moduli, d = forest.ground.moduli, forest.dimension
        ratio = (moduli.lateral + moduli.shear) / (moduli.stretch + (d - 1) * moduli.shear)
        radius = SAFETY * (2.0 + 2.0 * (d - 1) * float(ratio.max()))
        k = np.arange(1, STEPS + 1)
        self._keep, self._length, self._scale = self._rounded(
            np.where(k > 1, (2 * k - 3) / (2 * k + 1), 0.0),
            (8 * k - 4) / (2 * k + 1) / radius,
            balance.scale,
        )
        self._rows = BlockRows(*self._rounded(*balance.rows))
        self._types = BlockTypes(*self._rounded(*balance.types))
        self._transfer = self._rounded(*balance.layout.transfer)
        self._u: NDArray[Any] = np.zeros(balance.shape, real)
        self._load: NDArray[Any] = np.zeros_like(self._u)
        self._stress: NDArray[Any] = np.zeros(len(balance.rows.modulus), real)

    def _rounded(self, *arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Return arrays of numbers as short as those of the cycle."""
        return tuple(a.astype(self.real) if a.dtype == np.float64 else a for a in arrays)

    def _diagonals(self) -> None:
        """Work out the diagonals of blocks with irregular rows, which share no block type."""
        balance, rows = self.balance, self.balance.rows
        places = balance.shape[1] * balance.shape[2]
        row = np.repeat(np.arange(len(rows.modulus)), np.diff(rows.start))
        of_row = np.repeat(np.arange(balance.forest.depth), np.diff(rows.level))
        block = rows.column // places
        fine = balance.forest.level[block] == of_row[row]
        concerned = np.unique(block[fine])
        self._own = np.full(len(balance.forest), -1, dtype=np.int64)
        self._own[concerned] = np.arange(len(concerned))
        # What larger agents have in a row stays fixed.
        size = np.where(fine, np.abs(rows.value), 0.0)
        share = rows.modulus[row] * size * np.bincount(row, size)[row]
        at = self._own[block[fine]] * places + rows.column[fine] % places
        extra = STIFF * np.bincount(at, share[fine], len(concerned) * places)
        extra = extra.reshape(-1, *balance.shape[1:])
        type_of = balance.type_of[0, concerned]
        diagonal = balance.types.diagonal[type_of] * balance.scale[concerned, None, None] + extra
        mask = (balance.types.mask[type_of] > 0) & (diagonal > 0)
        inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=mask)
        self._inverse, self._extra = self._rounded(inverse, extra)

    def precondition(self, residual: Floats) -> NDArray[Any]:
        """Return one V-cycle's answer to a residual; it is overwritten by the next one."""
        balance, forest, rows = self.balance, self.balance.forest, self._rows
        layout, type_of, u, load = balance.layout, balance.type_of[0], self._u, self._load
        start, child_index = forest.start, forest.child_index
        around = (layout.halo, layout.ghosts)
        strains = (rows.start, rows.column, rows.value)
        stress, force = self._stress, load.ravel()
        u.fill(0.0)
        load[...] = residual
        load[~forest.leaf] = 0.0
        for level in range(forest.depth - 1, 0, -1):
            blocks, some = (
                (start[level], start[level + 1]),
                (rows.level[level], rows.level[level + 1]),
            )
            self._smooth(level, True)
            kernels.strain_rows(u.ravel(), *some, *strains, rows.modulus, stress)
            kernels.add_row_forces(force, *some, *strains, stress, self.real(-1.0))
            kernels.restrict(
                u, load, *blocks, forest.parent, child_index, forest.beside, type_of, self._types,
                self._scale, layout.halo, self._transfer,
            )  # fmt: skip
            parents = self._parents[level - 1]
            kernels.extrapolate_to_ghosts(
                load, parents, forest.beside, self.ghost_rules, *around, True
            )
        self.root.solve(force, u.ravel())
        for level in range(1, forest.depth):
            some = (rows.level[level], rows.level[level + 1])
            parents = self._parents[level - 1]
            kernels.extrapolate_to_ghosts(
                u, parents, forest.beside, self.ghost_rules, *around, False
            )
            blocks_of = np.arange(start[level], start[level + 1])
            kernels.prolong(u, blocks_of, forest.parent, child_index, self._transfer)
            before = stress[some[0] : some[1]].copy()
            kernels.strain_rows(u.ravel(), *some, *strains, rows.modulus, stress)
            stress[some[0] : some[1]] -= before
            kernels.add_row_forces(force, *some, *strains, stress, self.real(-1.0))
            self._smooth(level, False)
        return u

    def _smooth(self, level: int, forward: bool) -> None:
        balance, forest = self.balance, self.balance.forest
        kernels.smooth(
            self._u, self._load, forest.start[level], forest.start[level + 1], forward,
            forest.beside, balance.type_of[0], self._types, self._own, self._extra, self._inverse,
            self._scale, balance.layout.halo, self._keep, self._length,
        )  # fmt: skip

    def solve(
        self, load: Floats, u: Floats, done: Callable[[Iteration], bool], most: int = 100
    ) -> Iteration:
        """Solve for the displacement in place, by conjugate gradients."""
        shape, loaded = self.balance.shape, self.balance.loaded
        given, force = load[loaded].ravel(), np.empty(shape)

        def apply(x: Floats) -> Floats:
            force[:] = 0.0  # also on parents, whose displacements mean nothing
            self.balance.apply(x.reshape(shape), force)
            return force.ravel()

        def precondition(residual: Floats) -> Floats:
            return self.precondition(residual.reshape(shape)).ravel()

        def energy(x: Floats) -> float:
            return dot(given, x.reshape(shape)[loaded].ravel())

        return conjugate_gradients(apply, precondition, load.ravel(), u.ravel(), done, most, energy)
