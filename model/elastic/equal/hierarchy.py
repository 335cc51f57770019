"""Multigrid for equal cells: any form of the body and any mix of materials.

The finest level stores no matrix, only the moduli of cells and edges; a coarse level stores P'AP
(`multigrid_levels`), which is robust where the moduli jump by 10⁶ and next to holes, and needs no
boundary conditions of its own. Coarse levels of full boxes obey the law themselves, which is twice
as fast. One symmetric V-cycle with Gauss-Seidel sweeps is the preconditioner.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats
from kaju.factors import factors_of
from kaju.model.elastic.moduli import Moduli

from .direct import GUARD
from .krylov import dot
from .multigrid_levels import FIRST, MultigridLevel, coarse_level, level_by_law, spread
from .problem import ElasticProblem, FaceFields, coarse_box, ghost_weights_of, is_box
from .row_kernels import (
    PROLONG,
    RESTRICT,
    RESTRICT_LOAD,
    SMOOTH,
    Level,
    LevelBox,
    take,
    write_residual,
)
from .staggered import Numbering, stiffness_matrix

SWEEPS = {2: (3, 1, 2, 4), 3: (3, 1)}
"""Gauss-Seidel sweeps before and after the coarse correction: by the law, by the first stencil and
by the coarser ones, where they cost little (Bramble & Pasciak 1987).

A stencil couples a face with 30 others in the plane, 235 in space: three and eleven times as many
as the law.
"""


class Hierarchy:
    """Multigrid on the equal cells of a body.

    Its vectors hold all components' places with ghosts around them; see `gather` and `scatter`.
    `moduli` may replace the problem's own: the mixed form leaves the pressure's part out.
    """

    def __init__(self, problem: ElasticProblem, moduli: Moduli | None = None) -> None:
        self.dimension = problem.dimension
        by_law, *by_stencil = SWEEPS[self.dimension]
        self.plain = is_box(problem)
        if self.plain or moduli is not None:
            by_law = self.dimension  # Coarse levels obey the law too, or are those of a mixed form.
        own = replace(problem, moduli=moduli or problem.moduli)
        self.levels = [level_by_law(own)]
        self._ghost_weights = ghost_weights_of(problem)
        while is_box(own):
            own = coarse_box(own)
            self.levels.append(level_by_law(own))
        self._laws = laws = len(self.levels)
        # The last of full boxes is solved by factors if it is small: without stencils, which take
        # long to be compiled; other last levels by an inverse of some 350 faces.
        few = self.plain and self.dimension * prod(self.levels[-1].cells) <= 2_000
        smallest = 8 if self.dimension == 2 else 2
        while not few and (len(self.levels) == laws or max(self.levels[-1].cells) > smallest):
            self.levels.append(coarse_level(self.levels[-1], len(self.levels) + 1 - laws))
        self._sweeps = [by_law] * laws + by_stencil + by_stencil[-1:] * len(self.levels)
        self._solve_smallest = _smallest(self.levels[-1], own if few else None)

    @cached_property
    def moving(self) -> Flags:
        """Which entries of a vector are faces that can move."""
        finest = self.levels[0].level
        return spread(finest.inverse > 0.0, finest)

    def resisted(self, x: Floats) -> Floats:
        """Return the force with which faces resist x by their own stiffness, in the same array."""
        finest = self.levels[0].level
        inverse = spread(finest.inverse, finest)
        resisted: Floats = np.divide(x, inverse, out=x, where=self.moving)
        return resisted

    def gather(self, fields: FaceFields) -> Floats:
        """Return the values of the faces that can move; all else is 0."""
        vector = np.zeros(self.levels[0].u.size)
        free = self.views(self.moving)
        for view, values, moves in zip(self.views(vector), fields, free, strict=True):
            np.copyto(view, values, where=moves)
        return vector

    def scatter(self, vector: Floats, fields: FaceFields) -> None:
        """Add the values of the faces that can move to arrays of all faces."""
        for view, values in zip(self.views(vector), fields, strict=True):
            values += view

    def views(self, vector: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        """Return a vector as one array per axis, ghost cells included."""
        finest = self.levels[0]
        part = vector.reshape(self.dimension, *(n for n in finest.level.box.shape if n > 1))
        views = []
        for axis in range(self.dimension):
            ends = [FIRST + n + 1 + (a == axis) for a, n in enumerate(finest.cells)]
            views.append(part[axis][tuple(slice(FIRST - 1, end) for end in ends)])
        return tuple(views)

    def apply(self, x: Floats, out: Floats | None = None) -> Floats:
        """Return the stiffness times x."""
        out = np.empty_like(x) if out is None else out
        write_residual(x, x, out, *self._pair(0), share=0.0)
        return np.negative(out, out=out)

    def precondition(self, load: Floats, out: Floats | None = None) -> Floats:
        """Return one V-cycle's answer to a load."""
        out = np.empty_like(load) if out is None else out
        self._cycle(0, load, out)
        return out

    def full_multigrid(self, load: Floats, guess: Floats | None = None) -> tuple[Floats, float]:
        """Start from the coarsest answer and improve it level by level."""
        # On the finest level from the guess, whatever the size of its loads, if that is far better.
        # Also returns the potential energy there of the coarse answer.
        loads = [load]
        for at in range(len(self.levels) - 1):
            loads.append(self.restrict(at, loads[at]))
        x, energy = self._solve_smallest(loads[-1]), 0.0
        for at in range(len(self.levels) - 2, -1, -1):
            x, residual, more = self.prolong(at, x), self.levels[at].load, self.levels[at].u
            write_residual(x, loads[at], residual, *self._pair(at))
            if at == 0:
                energy = -0.5 * (dot(load, x) + dot(residual, x))
                if guess is not None:
                    force = self.apply(guess)
                    size = dot(guess, load) / (dot(guess, force) or 1.0)
                    other = load - size * force
                    if dot(other, other) < 0.01 * dot(residual, residual):
                        x, residual = size * guess, other
            self._cycle(at, residual, more)
            x += more
        return x, energy

    def prolong(self, at: int, coarse: Floats) -> Floats:
        """Return a displacement interpolated from the next coarser level."""
        x: Floats = np.zeros(self.levels[at].u.size)
        self._correct(at, x, x, coarse, 0)
        return x

    def restrict(self, at: int, load: Floats) -> Floats:
        """Return a load restricted to the next coarser level."""
        coarse: Floats = np.empty_like(self.levels[at + 1].load)
        self._restrict(at, load, load, coarse, 0)
        return coarse

    def rough(self, x: Floats) -> Floats:
        """Return about what the next coarser level cannot represent: x less its means there."""
        weight, mean = self.restrict(0, self.moving.astype(np.float64)), self.restrict(0, x)
        np.divide(mean, weight, out=mean, where=weight > 0.1)
        mean[weight <= 0.1] = 0.0
        return np.asarray(x - self.prolong(0, mean))

    def _cycle(self, at: int, load: Floats, u: Floats) -> None:
        """Take one V-cycle from a level on, from u = 0."""
        if at == len(self.levels) - 1:
            u[:] = self._solve_smallest(load)
            return
        below, sweeps = self.levels[at + 1], self._sweeps[at]
        self._restrict(at, u, load, below.load, sweeps)
        self._cycle(at + 1, below.load, below.u)
        self._correct(at, u, load, below.u, sweeps)

    def _pair(self, at: int) -> tuple[Level, LevelBox]:
        return self.levels[at].level, self.levels[at + 1].level.box

    def _restrict(self, at: int, u: Floats, load: Floats, coarse: Floats, sweeps: int) -> None:
        """Smooth and restrict the residual; ghosts of full boxes hand theirs to faces inside."""
        coarse.fill(0.0)
        if sweeps:
            u.fill(0.0)
        tasks = *[SMOOTH] * sweeps, RESTRICT if sweeps else RESTRICT_LOAD
        take(u, load, coarse, *self._pair(at), tasks)
        if at + 1 < self._laws:
            self._extrapolate_to_ghosts(coarse, self._pair(at)[1], back=True)

    def _correct(self, at: int, u: Floats, load: Floats, coarse: Floats, sweeps: int) -> None:
        """Prolong and smooth; in full boxes ghosts follow from the faces inside."""
        if at + 1 < self._laws:
            self._extrapolate_to_ghosts(coarse, self._pair(at)[1], back=False)
        take(u, load, coarse, *self._pair(at), (PROLONG, *[SMOOTH] * sweeps), back=1)

    def _extrapolate_to_ghosts(self, g: Floats, coarse: LevelBox, *, back: bool) -> None:
        """Extrapolate to ghosts beyond a full box; back, add their loads inside: the transpose."""
        count, weights = coarse.components, self._ghost_weights
        fields = g.reshape(count, *coarse.shape)
        for a in range(count):
            # Corners follow from the sides, so loads go back in the opposite order.
            for b in reversed(range(count)) if back else range(count):
                axis = 2 if b == count - 1 else b
                lines = fields[a] if axis == 0 else np.moveaxis(fields[a], axis, 0)
                for side in range(2 if a != b else 0):
                    layer = (coarse.first[axis], coarse.end[axis] - 2)[side]
                    inward, (near, far) = 1 - 2 * side, weights[2 * b + side]
                    one, two, ghost = (lines[layer + k * inward] for k in (0, 1, -1))
                    if back:
                        one += near * ghost
                        two += far * ghost
                        ghost[...] = 0.0
                    else:
                        ghost[...] = near * one + far * two


def _smallest(grid: MultigridLevel, problem: ElasticProblem | None) -> Callable[[Floats], Floats]:
    """Return what solves the smallest level: its inverse, or the factors of a full box."""
    there = np.flatnonzero(spread(grid.level.inverse, grid.level))
    if problem is not None:
        solve = factors_of(stiffness_matrix(problem, Numbering(problem.face_states))).solve
    else:
        matrix = np.empty((len(there),) * 2)
        x, force = np.zeros_like(grid.u), np.empty_like(grid.u)
        for column, place in zip(matrix, there, strict=True):
            x[place] = 1.0
            write_residual(x, x, force, grid.level, grid.level.box, share=0.0)
            x[place], column[:] = 0.0, -force[there]
        size = np.sqrt(matrix.diagonal())
        matrix /= np.outer(size, size)
        matrix[np.diag_indices_from(matrix)] += GUARD  # Ghosts may be linearly dependent.
        solve = (np.linalg.inv(matrix) / np.outer(size, size)).dot

    def solved(load: Floats) -> Floats:
        u: Floats = np.zeros_like(load)
        u[there] = solve(load[there])
        return u

    return solved
