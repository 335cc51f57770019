"""The equations of one field, generation by generation: the generations are multigrid levels.

Agents only halve, so the functions of a generation are among those of the next one. A generation
is solved by factors while it is small; then by conjugate gradients, whose preconditioner is a
V-cycle over the generations before it. Two to five steps end one. Nothing here knows the
dimension or the element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats, Ints
from kaju.factors import factors_of

from .leaves import LeafCells

ENOUGH = 0.03
"""Of the gap: an iteration ends when its last step closed less. What is left is in the bound. To
1e-3 on the plate, the hole and contrast 1000 0.01 takes as long, and 0.1 a tenth more agents."""
DIRECT = {2: 800, 3: 2_500}
"""Up to so many unknowns factors are as quick as levels, and in space as exact as tests of even
stress ask for. To 0.02 and 0.01 2,000 take 1.2 times as long on a plate and an L, 400 as long as
800; the same bodies with goals, and all from 3e-3 on, take as long with any. In space 1,000 take
two thirds of the time on coarse cubes, 4,000 a fifth longer."""
SWEEPS, LOWEST = 3, 6.0
"""Order of the smoother's polynomial, and the part of the largest eigenvalue down to which it
smooths: on the same bodies 2 and 4, or 4 and 10, take as long within a tenth."""


def blocks_of(blocks: Floats) -> sp.csr_array:
    """Return the matrix with these blocks, shape (n, k, m), on its diagonal."""
    n, rows, many = blocks.shape
    place, shape = np.arange(n + 1), (n * rows, n * many)
    return sp.csr_array(sp.bsr_array((blocks, place[:-1], place), shape=shape))


def summed(blocks: Floats, dof: Ints, way: sp.csr_array) -> sp.csc_array:
    """Return the sum of small matrices, (n, m, m), of unknowns, (n, m), that `way` makes."""
    own = way[dof.ravel()]
    return sp.csc_array((blocks_of(blocks) @ own).T @ own)


def by_laws(laws: list[tuple[Ints | slice, Floats]], own: Floats) -> Floats:
    """Return what agents' own values, along the last axis, become by the matrix of their law."""
    out = np.empty((*own.shape[:-1], len(laws[0][1])))
    for agents, matrix in laws:
        out[agents] = own[agents] @ matrix.T
    return out


@dataclass(frozen=True, eq=False)
class Blocks:
    """A matrix as the sum of those of the agents, which are multiples of few: one for each law."""

    dof: Ints  # Unknowns of every agent; shape (n, m)
    laws: list[tuple[Ints | slice, Floats]]  # Agents of each law, and its matrix (m, m)
    weight: Floats  # Multiples; shape (n,)
    scale: Floats | None  # What an agent's own unknowns are by the shared ones; shape (n, m)
    size: int  # Number of shared unknowns
    extra: sp.csc_array | None = None  # Added to the sum: elastic beds
    lighten: Callable[[Floats], Floats] | None = None
    """Takes from agents' own unknowns what their matrices make nothing of: else it is rounding."""

    def own(self, shared: Floats) -> Floats:
        """Return the agents' own unknowns, shape (n, m)."""
        own = shared[self.dof] if self.scale is None else shared[self.dof] * self.scale
        return own if self.lighten is None else self.lighten(own)

    def times(self, own: Floats) -> Floats:
        """Return the agents' matrices times their own unknowns."""
        return by_laws(self.laws, own) * self.weight[:, None]

    def gather(self, forces: Floats) -> Floats:
        """Return the sums of what agents put on the shared unknowns."""
        if self.scale is not None:
            forces = forces * self.scale
        sums = np.bincount(self.dof.ravel(), forces.ravel(), self.size)
        return np.asarray(sums, dtype=np.float64)

    def apply(self, shared: Floats) -> Floats:
        """Return the matrix times a vector of the shared unknowns."""
        out = self.gather(self.times(self.own(shared)))
        return out if self.extra is None else out + self.extra @ shared

    def diagonal(self) -> Floats:
        """Return the diagonal."""
        own = np.empty(self.dof.shape)
        for agents, matrix in self.laws:
            own[agents] = np.diag(matrix)
        own *= self.weight[:, None]
        out = self.gather(own if self.scale is None else own * self.scale)
        return out if self.extra is None else out + self.extra.diagonal()

    def shared(self, own: Floats) -> Floats:
        """Return the shared unknowns of agents that agree on them; 0 for those no agent has."""
        out = np.zeros(self.size)
        out[self.dof] = own if self.scale is None else own / self.scale
        return out

    def top(self) -> float:
        """Return a bound of the eigenvalues of the matrix over its diagonal."""
        largest = 1.0
        for _, matrix in self.laws:
            half = np.diag(matrix) ** -0.5
            largest = max(largest, float(np.linalg.eigvalsh(half[:, None] * matrix * half)[-1]))
        return largest if self.extra is None else largest + 1.0

    def assembled(self, way: sp.csr_array) -> sp.csc_array:
        """Return the matrix for the free unknowns, of which `way` makes the shared ones."""
        m = self.dof.shape[1]
        block = np.empty((len(self.dof), m, m))
        for agents, matrix in self.laws:
            block[agents] = matrix
        block *= self.weight[:, None, None]
        if self.scale is not None:
            block *= self.scale[:, :, None] * self.scale[:, None]
        whole = summed(block, self.dof, way)
        return whole if self.extra is None else sp.csc_array(whole + way.T @ self.extra @ way)


class FieldLevel:
    """The equations of one generation for its free unknowns, scaled by the diagonal.

    `way` makes the shared unknowns of the free ones; `rise` makes the free ones of the shared ones
    of the level before, without which it is solved by factors.
    """

    def __init__(
        self,
        blocks: Blocks,
        way: sp.csr_array,
        before: FieldLevel | None = None,
        rise: sp.csr_array | None = None,
    ) -> None:
        self.blocks, self.way, self.back = blocks, way, way.T
        self.before, self.factors = None, None
        if before is None or rise is None:
            matrix = blocks.assembled(way)
            self.scale = scale = matrix.diagonal() ** -0.5
            matrix.data *= scale[matrix.indices] * np.repeat(scale, np.diff(matrix.indptr))
            self.factors = factors_of(matrix)
            return
        # For a row of k entries (sum p x)^2 <= k sum p^2 x^2, so this diagonal bounds the matrix.
        entries = np.diff(way.indptr)
        squares = sp.csr_array(
            (way.data**2 * np.repeat(entries, entries), way.indices, way.indptr), way.shape
        )
        self.scale = (squares.T @ blocks.diagonal()) ** -0.5
        self.top = blocks.top()
        self.before, self.rise, self.fall = before, rise, sp.csr_array(rise.T)

    def apply(self, free: Floats) -> Floats:
        """Return the scaled matrix times a vector."""
        image = self.back @ self.blocks.apply(self.way @ (self.scale * free))
        return np.asarray(self.scale * image)

    def smooth(self, rest: Floats) -> Floats:
        """Return a correction that takes the upper part of the spectrum: Chebyshev's polynomial."""
        middle, half = 0.5 * self.top * (1.0 + 1.0 / LOWEST), 0.5 * self.top * (1.0 - 1.0 / LOWEST)
        ratio = half / middle
        found = step = rest / middle
        for _ in range(SWEEPS - 1):
            rest = rest - self.apply(step)
            new = 1.0 / (2.0 * middle / half - ratio)
            step = new * ratio * step + 2.0 * new / half * rest
            found, ratio = found + step, new
        return np.asarray(found)

    def cycle(self, rest: Floats) -> Floats:
        """Return an approximate solution by all generations."""
        if self.factors is not None or self.before is None:
            assert self.factors is not None
            return np.asarray(self.factors.solve(rest))
        found = self.smooth(rest)
        before = self.before
        coarse = before.back @ (self.fall @ ((rest - self.apply(found)) / self.scale))
        correction = before.way @ (before.scale * before.cycle(before.scale * coarse))
        found = found + (self.rise @ correction) / self.scale
        return np.asarray(found + self.smooth(rest - self.apply(found)))

    def solve(self, forces: Floats, gap: float) -> Floats:
        """Return the correction of the shared unknowns by the forces on them; `gap` ends it."""
        rest = self.scale * (self.back @ forces)
        if self.factors is not None:
            return np.asarray(self.way @ (self.scale * self.factors.solve(rest)))
        found, gained = np.zeros_like(rest), 0.0
        direction = turned = self.cycle(rest)
        power = float(rest @ turned)
        # What is left past so many steps is in the bound, too.
        for _ in range(60):
            if power <= 0.0:
                break
            image = self.apply(direction)
            # The step of least energy along the direction, whatever rounding made of this.
            share = float(rest @ direction) / float(direction @ image)
            gain = 0.5 * share * float(rest @ direction)
            found, before = found + share * direction, rest
            rest = rest - share * image
            gained += gain
            rounding = np.finfo(np.float64).eps * gained
            if gain <= max(ENOUGH * max(gap - gained, 0.1 * gap), rounding):
                break
            turned = self.cycle(rest)
            new = float(rest @ turned)
            direction = turned + float((rest - before) @ turned) / power * direction
            power = new
        return np.asarray(self.way @ (self.scale * found))


def level_of(
    blocks: Blocks,
    free: tuple[sp.csr_array, Ints],
    before: FieldLevel | None,
    family: tuple[Ints, Ints] | None,
    maps: Floats,
    direct: int,
) -> FieldLevel:
    """Return the equations of a generation; up to `direct` free unknowns it has factors."""
    # family: the parent of each agent, and which of its parts it is.
    # maps: What an agent's own unknowns, taken component by component, are by its parent's.
    way, unknown = free
    if before is None or family is None or way.shape[1] <= direct:
        return FieldLevel(blocks, way)
    parent, part = family
    m, each = maps.shape[1], blocks.dof.shape[1] // maps.shape[1]
    # What shared unknowns are by those of the generation before is read off in one agent.
    first = np.full(blocks.size, -1)
    first[blocks.dof.ravel()[::-1]] = np.arange(blocks.dof.size)[::-1]
    agent, local = np.divmod(np.maximum(first[unknown], 0), m * each)
    rows, old = maps[part[agent], local // each], before.blocks
    columns = old.dof[parent[agent]].reshape(-1, m, each)[np.arange(len(agent)), :, local % each]
    if old.scale is not None and blocks.scale is not None:
        rows = rows * old.scale[parent[agent]] / blocks.scale[agent, local][:, None]
    alone = first[unknown] < 0
    if alone.any():
        # Unknowns that no agent has (of cuts) stand last in every generation.
        rows[alone], columns[alone] = 0.0, old.size - 1
        rows[alone, 0], columns[alone, 0] = 1.0, old.size - (blocks.size - unknown[alone])
    place = np.arange(len(unknown) + 1) * m
    rise = sp.csr_array((rows.ravel(), columns.ravel(), place), (len(unknown), old.size))
    return FieldLevel(blocks, way, before, rise)


def handed_down(own: Floats, family: tuple[Ints, Ints], maps: Floats) -> Floats:
    """Return the parts of what agents hold that their children begin with."""
    parent, part = family
    out, some = own[parent], np.flatnonzero(part)
    whole = out[some].reshape(len(some), maps.shape[1], -1)
    out[some] = (maps[part[some]] @ whole).reshape(len(some), -1)
    return out


def descent(old: LeafCells, new: LeafCells) -> tuple[Ints, Ints]:
    """Return the parent of each agent, and which part of it it is, as `child_maps` counts."""
    d, parent = old.dimension, new.parents_in(old)
    ratio = old.size[parent] // new.size
    offset = (new.lower - old.lower[parent]) // new.size[:, None]
    number = (offset * ratio[:, None] ** np.arange(d)).sum(axis=1)
    # Parts of fewer halvings stand before: 1 + 2^d + 4^d + ...
    return parent, np.asarray((ratio**d - 1) // (2**d - 1) + number)
