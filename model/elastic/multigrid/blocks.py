"""The balance of forces on blocks of agents: the operator SᵀDS of `Equilibrium`, hardly stored.

Within blocks and between blocks of one size the moduli are those of block types, in compiled loops.
Where agents of two sizes meet, the strains are rows of the composite grid of the agents that touch
there (`Window`).
"""

from __future__ import annotations

from functools import cache, cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.moduli import moduli_at
from kaju.model.elastic.multigrid import block_kernels as kernels
from kaju.model.elastic.multigrid.block_types import PLACES, block_types
from kaju.model.elastic.multigrid.forest import ACROSS, COARSE, REFINED, Forest, corners, offsets
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.refine.estimator import SINGULAR, Indicator
from kaju.model.elastic.staggered import axis_pairs


class Layout(NamedTuple):
    """Where things lie in a block's places."""

    stride: Ints  # shape (dimension,)
    # Ways, and for each the faces that a neighbour owns, and where they are there; then the same
    # for the last faces of neighbours at corners (`_ends`)
    halo: tuple[Ints, ...]
    # For every side where the faces beyond it begin, these, and the step to the next within
    ghosts: tuple[Ints, Ints, Ints]
    # For every child: fine faces, faces of the parent, and weights; then the faces that lie between
    # two such, and how far apart these are
    transfer: tuple[Ints, Ints, Ints, Floats, Ints]


@cache
def layout(dimension: int) -> Layout:
    """Return the layout of blocks of squares or cubes."""
    d = dimension
    stride = np.array([PLACES ** (d - 1 - a) for a in range(d)])
    place = np.array(list(product(range(PLACES), repeat=d)))
    start, way, into, source = [0], [], [], []
    steps = offsets(d)
    # Neighbours at corners come last: of faces that two neighbours share their values are right.
    for m in np.argsort(np.abs(steps).sum(axis=1), kind="stable")[1:]:
        way.append(int(m))
        for a in range(d):
            low = np.where(steps[m] > 0, PLACES - 1, np.where(steps[m] < 0, 0, 1))
            high = np.where(steps[m] == 0, ACROSS + (np.arange(d) == a), low)
            here = np.flatnonzero(((place >= low) & (place <= high)).all(axis=1))
            into.append(here + a * PLACES**d)
            source.append((place[here] - ACROSS * steps[m]) @ stride + a * PLACES**d)
        start.append(sum(map(len, into)))
    halo = (np.array(way), np.array(start), np.concatenate(into), np.concatenate(source))
    ends = _ends(d, stride, place)
    beyond = [
        np.flatnonzero(place[:, b] == upper * (PLACES - 1)) + a * PLACES**d
        for b, upper, a in product(range(d), (0, 1), range(d))
        if a != b
    ]
    each = (d - 1) * PLACES ** (d - 1)
    inward = np.repeat(stride, 2) * np.tile([1, -1], d)
    ghosts = (each * np.arange(2 * d + 1), np.concatenate(beyond), inward)
    return Layout(stride, halo + ends, ghosts, _transfer(d, stride))


def _ends(d: int, stride: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Return the last faces of neighbours at corners, which stand at the first of nothing."""
    # A row holds the way, the way to nothing, and where its places begin and end; a second array
    # the places, and where they are in the neighbour.
    steps, heads, into, source = offsets(d), [], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    count = 0
    for m, a in product(np.argsort(np.abs(steps).sum(axis=1), kind="stable"), range(d)):
        if steps[m, a] != -1 or np.abs(steps[m]).sum() < 2:
            continue
        low = np.where(steps[m] > 0, PLACES - 1, np.where(steps[m] < 0, 0, 1))
        high = np.where(steps[m] == 0, ACROSS, low)
        low[a] = high[a] = 1
        here = np.flatnonzero(((place >= low) & (place <= high)).all(axis=1))
        heads.append((int(m), int(m) + 3**a, count, count + len(here)))
        count += len(here)
        into.append(here + a * PLACES**d)
        source.append((place[here] - ACROSS * steps[m]) @ stride + a * PLACES**d)
    return np.array(heads), np.stack([np.concatenate(into), np.concatenate(source)])


def _transfer(d: int, stride: Ints) -> tuple[Ints, Ints, Ints, Floats, Ints]:
    """Return which faces of children follow which of the parent's: see `Layout.transfer`."""
    parts, between = [], []
    for child, a in product(range(1 << d), range(d)):
        lines = []
        for b in range(d):
            # Along the normal every other face is one of the parent's; across it they lie a quarter
            # of a parent's cell off.
            line, first = [], (child >> b & 1) * ACROSS - 1
            for p in range(1, ACROSS + 1 + (b == a), 1 + (b == a)):
                near, nearer = (first + p) // 2 + 1, 1 if (first + p) % 2 else -1
                line += [(p, near, 1.0)] if b == a else [(p, near, 0.75), (p, near + nearer, 0.25)]
            lines.append(line)
        parts.append(np.array(list(product(*lines))))
    count, table = [len(part) for part in parts], np.concatenate(parts)
    own = np.repeat(np.tile(np.arange(d), 1 << d), count) * PLACES**d
    fine, source = table[:, :, :2].astype(np.int64).transpose(2, 0, 1) @ stride
    start, weight = np.append(0, np.cumsum(count))[::d], table[:, :, 2].prod(axis=1)
    for a in range(d):
        odd = [range(2, ACROSS + 1, 2) if b == a else range(1, ACROSS + 1) for b in range(d)]
        at = np.array(list(product(*odd))) @ stride + a * PLACES**d
        between.append(np.stack([at, np.full_like(at, stride[a])], axis=1))
    return start, fine + own, source + own, weight, np.concatenate(between)


class BlockRows(NamedTuple):
    """Strains where agents of two sizes meet, level by level of the smaller ones."""

    level: Ints  # shape (levels + 1,): First row of every level
    start: Ints  # Compressed rows over all places of all blocks
    column: Ints
    value: Floats
    modulus: Floats  # shape (rows,): Times volumes


class Window:
    """Some agents of a forest as a composite grid: where all they touch is among them, as in it.

    Of the blocks, in the order of their codes, all agents, or those `chosen`, shape (blocks,
    agents). `block` is the block of every one, and `corner` which of `Forest.corners` it is.
    """

    def __init__(self, forest: Forest, block: Ints, chosen: Flags | None = None) -> None:
        many = len(forest.corners)
        at = np.arange(many * len(block)) if chosen is None else np.flatnonzero(chosen)
        self.block, self.corner = block[at // many], at % many
        cells = forest.cells(block)
        self.leaves = cells if chosen is None else cells.only(at)
        self._forest = forest

    @cached_property
    def grid(self) -> CompositeGrid:
        """The composite grid of these agents."""
        return CompositeGrid(self._forest.ground, self.leaves)

    @cached_property
    def balance(self) -> Equilibrium:
        """Its balance of forces."""
        return Equilibrium(self.grid)

    def displacement(self, u: Floats) -> Floats:
        """Return the displacement of the grid's faces by that of all places."""
        return np.where(self.grid.state == ACTIVE, u.ravel()[self.place], self.grid.value)

    @cached_property
    def place(self) -> Ints:
        """Where the faces of the grid are among the places of all blocks; -1 for those held."""
        forest, grid, d = self._forest, self.grid, self._forest.dimension
        stride, step = layout(d).stride, 3 ** np.arange(d)
        block = self.block[grid.owner]
        p = forest.corners[self.corner[grid.owner]] + 1
        upper, rows = grid.upper, np.arange(grid.size)
        p[rows, grid.axis] += upper
        past = p[rows, grid.axis] > ACROSS
        ahead = forest.beside[block, 3**d // 2 + step[grid.axis]]
        over = past & (ahead >= 0)
        block = np.where(over, ahead, block)
        p[over, grid.axis[over]] = 1
        found = (block * d + grid.axis) * PLACES**d + p @ stride
        return np.where(grid.state == ACTIVE, found, -1)


class BlockOperator:
    """Energy and forces of a forest, level by level and of all its leaves together; scaled.

    `type_of` are the types of the blocks on their own levels, and as parts of the whole, shape (2,
    blocks); `scale` the unit of the blocks' energy, h^(d-2).
    """

    def __init__(self, forest: Forest) -> None:
        self.forest = forest
        d = forest.dimension
        self.layout = layout(d)
        self.shape = (len(forest), d, PLACES**d)
        self.scale = (forest.size / forest.ground.cell) ** (d - 2.0)
        self.states = forest.states(composite=True)
        alone = forest.states(composite=False)
        kinds = np.concatenate([forest.kinds, forest.kinds])
        states = np.concatenate([alone, self.states])
        type_of, self.types = block_types(kinds, states, forest.ground.moduli)
        self.type_of: Ints = type_of.reshape(2, -1)
        self.rows = self._rows()

    def zeros(self) -> Floats:
        """Return a displacement or force of nothing."""
        return np.zeros(self.shape)

    @cached_property
    def unknowns(self) -> Ints:
        """Places that are unknown."""
        mask = self.types.mask[self.type_of[1]] > 0
        mask[~self.forest.leaf] = False
        return np.flatnonzero(mask)

    def apply(self, u: Floats, force: Floats) -> float:
        """Write the force that holds a displacement; return twice its energy."""
        forest, rows = self.forest, self.rows
        tree = (forest.leaves, forest.beside, self.type_of[1])
        total = kernels.apply(u, force, *tree, self.types, self.scale, self.layout.halo)
        stress, every = np.empty(len(rows.modulus)), (0, len(rows.modulus))
        strains = (*every, rows.start, rows.column, rows.value)
        total += kernels.strain_rows(u.ravel(), *strains, rows.modulus, stress)
        kernels.add_row_forces(force.ravel(), *strains, stress, 1.0)
        return float(total)

    @property
    def load(self) -> Floats:
        """External force on every place."""
        return self._entered[0]

    @property
    def loaded(self) -> Ints:
        """Blocks with external forces."""
        return self._entered[1]

    @cached_property
    def _entered(self) -> tuple[Floats, Ints]:
        forest, total, many = self.forest, self.zeros(), len(self.forest.corners)
        block = forest.leaves[forest.loaded]
        forces = forest.ground.forces(forest.cells(block))
        bears = np.zeros((len(block), many), dtype=np.bool_)
        bears.ravel()[forces.leaf] = True
        block, bears = block[bears.any(axis=1)], bears[bears.any(axis=1)]
        if not len(block):
            return total, block
        rows = np.arange(len(forces.leaf))
        forces_along = forces.force.copy()
        forces_along[rows, np.maximum(forces.direction, 0) // 2] = 0.0
        uneven = forces.uneven is not None and len(forces.uneven.box)
        if (forces.direction < 0).any() or forces_along.any() or uneven:
            # Forces along sides and in middles act on faces of neighbours, too.
            window = Window(forest, forest.with_neighbours(block))
        else:
            window = Window(forest, block, bears)
        free = window.place >= 0
        place, force = window.place[free], window.balance.load[free]
        total.ravel()[place] = force
        return total, np.unique(place[force != 0.0] // total[0].size)

    def fill_coarse(self, u: Floats) -> None:
        """Fill in displacements that are no unknowns: of blocks with children, and of halos."""
        # A side that smaller agents share moves by the mean of their faces.
        forest, d = self.forest, self.forest.dimension
        places = np.arange(PLACES**d).reshape((PLACES,) * d)
        for level in range(forest.depth - 1, -1, -1):
            block = np.arange(forest.start[level], forest.start[level + 1])
            leaf = forest.leaf[block]
            self._average_children(u, block[~leaf])
            for a in range(d):
                way = 3**d // 2 - 3**a
                large = block[leaf & (self.states[block, way] == REFINED)]
                first, last = (np.take(places, p, axis=a).ravel() for p in (1, PLACES - 1))
                u[large[:, None], a, first] = u[forest.beside[large, way][:, None], a, last]
        kernels.exchange_halos(u, forest.beside, self.layout.halo)

    def _average_children(self, u: Floats, parents: Ints) -> None:
        """Write the means of the children's faces to the faces of their parents."""
        d, half = self.forest.dimension, ACROSS // 2
        places = u.reshape(*self.shape[:2], *(PLACES,) * d)
        for child, a in product(range(1 << d), range(d)):
            faces, into = places[self.forest.child[parents, child], a], list[slice]()
            for b in range(d):
                # Along the normal every other face is one of the parent's, the last one that of the
                # upper child; across it two lie in one.
                upper = child >> b & 1
                count = half + (upper if b == a else 0)
                into.append(slice(upper * half + 1, upper * half + 1 + count))
                first, second = (
                    faces.take(range(k, k + 2 * count, 2), b + 1, mode="clip") for k in (1, 2)
                )
                faces = first if b == a else 0.5 * (first + second)
            index: tuple[Any, ...] = (parents, a, *into)
            places[index] = faces

    def errors(self, u: Floats, squares: Floats | None = None) -> tuple[Floats, Floats]:
        """Return the squares of the leaf blocks' errors, and each agent's residual load."""
        # `squares` may take those of the agents; see `block_kernels.second_differences`.
        forest, moduli = self.forest, self.forest.ground.moduli
        lateral = np.maximum(moduli.lateral[forest.kind], 0.0)
        law = (lateral, moduli.shear[forest.kind], self.scale)
        middle = 3**forest.dimension // 2
        ahead = [middle + end * 3**a for a in range(forest.dimension) for end in (-1, 1)]
        block = forest.leaves[:, None]
        alike = forest.kinds[block, ahead] == forest.kinds[block, middle]
        next_to = np.where(alike, forest.beside[block, ahead], -1)
        around = (*law, self.layout.stride)
        loads = np.empty((len(block), len(forest.corners)))
        squares = np.empty((0, 0)) if squares is None else squares
        found = np.asarray(
            kernels.second_differences(u, forest.leaves, next_to, *around, squares, loads)
        )
        row, cell = forest.holding(forest.ground.sharp)
        own = np.empty((len(row), len(forest.corners)))
        kernels.second_differences(u, forest.leaves[row], next_to[row], *around, own, loads[:0])
        np.add.at(found, row, (SINGULAR - 1.0) * own[np.arange(len(row)), cell])
        if len(squares):
            squares[row, cell] *= SINGULAR
        return found, loads[:, forest.rows].ravel()

    def indicator(self, u: Floats) -> Indicator:
        """Return the estimated error of every agent of the leaf blocks."""
        u = u.copy()
        self.fill_coarse(u)
        squares = np.empty((len(self.forest.leaves), len(self.forest.corners)))
        load = self.errors(u, squares)[1]
        return Indicator(squares[:, self.forest.rows].ravel(), load)

    def prolonged(self, old: Floats, ghost_rules: Ints) -> Floats:
        """Return the displacement interpolated from the forest that this one has grown from."""
        # `old` has been filled by `fill_coarse`; the rules are those of this forest.
        forest, u = self.forest, self.zeros()
        known = forest.origin >= 0
        u[known] = old[forest.origin[known]]
        for level in range(1, forest.depth):
            block = np.arange(forest.start[level], forest.start[level + 1])
            fresh = block[~known[block]]
            parents = np.unique(forest.parent[fresh])
            around = (self.layout.halo, self.layout.ghosts)
            kernels.extrapolate_to_ghosts(u, parents, forest.beside, ghost_rules, *around, False)
            kernels.prolong(u, fresh, forest.parent, forest.child_index, self.layout.transfer)
        kernels.clean(u, forest.leaf, self.type_of[1], self.types.mask)
        return u

    def _rows(self) -> BlockRows:
        """Return the strains of all edges, and of all large agents, where two sizes meet."""
        forest, d = self.forest, self.forest.dimension
        irregular = (self.states == COARSE) | (self.states == REFINED)
        irregular &= forest.leaf[:, None]
        block = forest.leaves[irregular[forest.leaves].any(axis=1)]
        if not len(block):
            nothing = np.empty(0, dtype=np.int64)
            level = np.zeros(forest.depth + 1, dtype=np.int64)
            return BlockRows(level, np.zeros(1, np.int64), nothing, np.empty(0), np.empty(0))
        reach = _reach(d)
        meets = irregular.astype(np.float32)
        window = Window(forest, block, meets[block] @ reach.max(axis=(2, 3, 4)) > 0)
        grid, chosen = window.grid, []
        touched = meets[window.block]
        for number, laid in enumerate(grid.edges.values()):
            table = reach[:, :, number][:, window.corner]
            on = np.einsum("nw,wnij->nij", touched, table) > 0
            marked = np.zeros(len(laid.modulus), dtype=np.bool_)
            marked[laid.of_leaf[on]] = True
            chosen.append(np.flatnonzero(marked & (laid.modulus > 0)))
        return _collected(forest, window, chosen)


@cache
def _reach(dimension: int) -> NDArray[np.float32]:
    """Tell which edges of a block's agents touch which neighbour."""
    # Shape (ways, agents, pairs, 2, 2): 1 for those at the lower or upper end along either axis.
    step, place = offsets(dimension), corners(dimension)
    on = np.zeros((dimension, 2, len(step), len(place)))
    for a, end in product(range(dimension), (0, 1)):
        last = place[None, :, a] == end * (ACROSS - 1)
        on[a, end] = (step[:, a] == 0)[:, None] | ((step[:, a] == 2 * end - 1)[:, None] & last)
    found = np.zeros((len(step), len(place), len(axis_pairs(dimension)), 2, 2))
    for number, pair in enumerate(axis_pairs(dimension)):
        others = [a for a in range(dimension) if a not in pair]
        within = (step[:, others] == 0).all(axis=1)[:, None]
        for i, j in product((0, 1), repeat=2):
            found[:, :, number, i, j] = on[pair[0], i] * on[pair[1], j] * within
    return found.astype(np.float32)


def _collected(forest: Forest, window: Window, edges: list[Ints]) -> BlockRows:
    """Return the strains of large agents and of some edges as rows over places."""
    grid, balance, d = window.grid, window.balance, forest.dimension
    n = len(grid.leaves)
    large = np.flatnonzero((grid.master < 0).any(axis=1))
    volume, law = grid.length[large] ** d, moduli_at(grid.law, large)
    lateral = volume * law.lateral
    # The energy of stretches is one of each by itself, and one of the change in volume.
    stretches = [balance.strains[a * n + large] for a in range(d)]
    parts = [*stretches, sum(stretches[1:], stretches[0])]
    modulus = [volume * law.stretch - lateral] * d + [lateral]
    at = n * d
    for number, laid in zip(edges, grid.edges.values(), strict=True):
        parts.append(balance.strains[at + number])
        modulus.append((laid.modulus * laid.weight)[number])
        at += len(laid.modulus)
    matrix = sp.csr_array(sp.vstack(parts, format="csr"))
    row = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    level = np.zeros(matrix.shape[0], dtype=np.int64)
    np.maximum.at(level, row, forest.level[window.block[grid.owner[matrix.indices]]])
    place = window.place[matrix.indices]
    order = np.argsort(level[row], kind="stable")
    order = order[(place[order] >= 0) & (matrix.data[order] != 0.0)]
    number = np.argsort(level, kind="stable")
    new = np.empty_like(number)
    new[number] = np.arange(len(number))
    order = order[np.argsort(new[row[order]], kind="stable")]
    counts = np.bincount(new[row[order]], minlength=len(number))
    return BlockRows(
        np.searchsorted(level[number], np.arange(forest.depth + 1)),
        np.concatenate([[0], np.cumsum(counts)]),
        place[order],
        matrix.data[order],
        np.concatenate(modulus)[number],
    )
