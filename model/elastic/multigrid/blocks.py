"""The balance of forces on blocks of agents: the same operator as `Equilibrium`, hardly stored.

Within blocks and between blocks of one size the energy follows from `pages`, in compiled loops.
Where agents of two sizes meet, the strains are rows of the composite grid of the agents that
touch there (`Window`), and are added to it: together they are Sᵀ D S.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.moduli import moduli_at
from kaju.model.elastic.multigrid import block_kernels as kernels
from kaju.model.elastic.multigrid.block_types import PLACES, surroundings
from kaju.model.elastic.multigrid.forest import ACROSS, COARSE, REFINED, Forest, corners, ways
from kaju.model.elastic.problem import ACTIVE
from kaju.model.elastic.refine.estimator import SINGULAR, Indicator
from kaju.model.elastic.staggered import axis_pairs


class Layout(NamedTuple):
    """Where things lie in a block's places."""

    stride: Ints  # shape (dimension,)
    # Ways, and for each the faces that a neighbour owns, and where they are there; then the same
    # for the last faces of neighbours at corners (`_ends`)
    layer: tuple[Ints, ...]
    # For every side where the faces beyond it begin, these, and the step to the next within
    ghosts: tuple[Ints, Ints, Ints]
    # For every child: fine faces, faces of the parent, and weights; then the faces that lie between
    # two such, and how far apart these are
    ties: tuple[Ints, Ints, Ints, Floats, Ints]
    # For every child and axis: fine faces, and the parent's faces of which they are parts
    halves: tuple[Ints, Ints, Ints]


@cache
def layout(dimension: int) -> Layout:
    """Return the layout of blocks of squares or cubes."""
    d = dimension
    stride = np.array([PLACES ** (d - 1 - a) for a in range(d)])
    place = np.array(list(product(range(PLACES), repeat=d)))
    start, way, into, source = [0], [], [], []
    steps = ways(d)
    # Neighbours at corners come last: what they tell of faces that two of them share is right.
    for m in np.argsort(np.abs(steps).sum(axis=1), kind="stable")[1:]:
        way.append(int(m))
        for a in range(d):
            low = np.where(steps[m] > 0, PLACES - 1, np.where(steps[m] < 0, 0, 1))
            high = np.where(steps[m] == 0, ACROSS + (np.arange(d) == a), low)
            here = np.flatnonzero(((place >= low) & (place <= high)).all(axis=1))
            into.append(here + a * PLACES**d)
            source.append((place[here] - ACROSS * steps[m]) @ stride + a * PLACES**d)
        start.append(sum(map(len, into)))
    layer = (np.array(way), np.array(start), np.concatenate(into), np.concatenate(source))
    ends = _ends(d, stride, place)
    ties, halves = _ties(d, stride), _halves(d, stride)
    beyond = [
        np.flatnonzero(place[:, b] == upper * (PLACES - 1)) + a * PLACES**d
        for b, upper, a in product(range(d), (0, 1), range(d))
        if a != b
    ]
    each = (d - 1) * PLACES ** (d - 1)
    inward = np.repeat(stride, 2) * np.tile([1, -1], d)
    ghosts = (each * np.arange(2 * d + 1), np.concatenate(beyond), inward)
    return Layout(stride, layer + ends, ghosts, ties, halves)


def _ends(d: int, stride: Ints, place: Ints) -> tuple[Ints, Ints]:
    """Return the last faces of neighbours at corners, which stand at the first of nothing."""
    # A row holds the way, the way to nothing, and where its places begin and end; a second array
    # the places, and where they are in the neighbour.
    steps, heads, into, source = ways(d), [], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
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


Line = list[tuple[int, int, float]]
"""Places along a line of a child, those of its parent that belong to them, and weights."""


def _ties(d: int, stride: Ints) -> tuple[Ints, Ints, Ints, Floats, Ints]:
    start, fine, source, weight, axis = _of_children(d, stride, _line)
    between = []
    for a in range(d):
        lines = [range(2, ACROSS + 1, 2) if b == a else range(1, ACROSS + 1) for b in range(d)]
        at = np.array(list(product(*lines))) @ stride + a * PLACES**d
        between.append(np.stack([at, np.full_like(at, stride[a])], axis=1))
    own = axis * PLACES**d
    return start[::d], fine + own, source + own, weight, np.concatenate(between)


def _line(upper: int, along: bool) -> Line:
    # Along their normal every other face is one of the parent's; across it faces lie a quarter off.
    found = []
    for p in range(1, ACROSS + 1 + along, 1 + along):
        at = upper * ACROSS + p - 1
        if along:
            found.append((p, at // 2 + 1, 1.0))
        else:
            found += [(p, at // 2 + 1, 0.75), (p, at // 2 + 1 + (1 if at % 2 else -1), 0.25)]
    return found


def _halves(d: int, stride: Ints) -> tuple[Ints, Ints, Ints]:
    half = ACROSS // 2

    def line(upper: int, along: bool) -> Line:
        if along:  # The plane between two children is told by the upper one.
            return [(2 * i + 1, upper * half + i + 1, 1.0) for i in range(half + upper)]
        return [(p, upper * half + (p + 1) // 2, 1.0) for p in range(1, ACROSS + 1)]

    start, fine, source, _, _ = _of_children(d, stride, line)
    return start[d * np.arange(1 << d)[:, None] + np.arange(d + 1)], fine, source


def _of_children(
    d: int, stride: Ints, line: Callable[[int, bool], Line]
) -> tuple[Ints, Ints, Ints, Floats, Ints]:
    """Return products of lines: starts child by child and axis by axis, places, weights, axes."""
    parts = []
    for octant, a in product(range(1 << d), range(d)):
        parts.append(list(product(*(line(octant >> b & 1, b == a) for b in range(d)))))
    count = [len(part) for part in parts]
    table = np.concatenate([np.array(part) for part in parts])
    fine, source = table[:, :, :2].astype(np.int64).transpose(2, 0, 1) @ stride
    axis = np.repeat(np.tile(np.arange(d), 1 << d), count)
    return np.append(0, np.cumsum(count)), fine, source, table[:, :, 2].prod(axis=1), axis


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

    `page` are the pages of the blocks on their own levels, and as parts of the whole, shape (2,
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
        page, self.pages = surroundings(kinds, states, forest.ground.moduli)
        self.page: Ints = page.reshape(2, -1)
        self.rows = self._rows()

    def zeros(self) -> Floats:
        """Return a displacement or force of nothing."""
        return np.zeros(self.shape)

    @cached_property
    def unknowns(self) -> Ints:
        """Places that are unknown."""
        mask = self.pages.mask[self.page[1]] > 0
        mask[~self.forest.leaf] = False
        return np.flatnonzero(mask)

    def apply(self, u: Floats, force: Floats) -> float:
        """Write the force that holds a displacement; return twice its energy."""
        forest, rows = self.forest, self.rows
        tree = (forest.leaves, forest.beside, self.page[1])
        total = kernels.apply(u, force, *tree, self.pages, self.scale, self.layout.layer)
        stress, every = np.empty(len(rows.modulus)), (0, len(rows.modulus))
        strains = (*every, rows.start, rows.column, rows.value)
        total += kernels.strain_rows(u.ravel(), *strains, rows.modulus, stress)
        kernels.pull_rows(force.ravel(), *strains, stress, 1.0)
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
        forest, total = self.forest, self.zeros()
        block = forest.leaves[forest.loaded]
        if not len(block):
            return total, block
        cells = forest.cells(block)
        forces = forest.ground.forces(cells)
        rows = np.arange(len(forces.leaf))
        forces_along = forces.force.copy()
        forces_along[rows, np.maximum(forces.direction, 0) // 2] = 0.0
        if (forces.direction < 0).any() or forces_along.any() or forces.uneven:
            # Of what is dragged along, or pulled by its middle, the neighbours tell more.
            window = Window(forest, forest.with_neighbours(block))
        else:
            chosen = np.zeros((len(block), len(forest.corners)), dtype=np.bool_)
            chosen.ravel()[forces.leaf] = True
            window = Window(forest, block, chosen)
        free = window.place >= 0
        place, force = window.place[free], window.balance.load[free]
        total.ravel()[place] = force
        return total, np.unique(place[force != 0.0] // total[0].size)

    def everywhere(self, u: Floats) -> None:
        """Fill in what is not unknown, but has a displacement: of parents, and neighbours."""
        # A side that smaller agents share moves by the mean of their faces.
        forest, d = self.forest, self.forest.dimension
        places = np.arange(PLACES**d).reshape((PLACES,) * d)
        for level in range(forest.depth - 1, -1, -1):
            block = np.arange(forest.start[level], forest.start[level + 1])
            leaf = forest.leaf[block]
            kernels.upward(u, block[~leaf], forest.child, self.layout.halves)
            for a in range(d):
                way = 3**d // 2 - 3**a
                large = block[leaf & (self.states[block, way] == REFINED)]
                first, last = (np.take(places, p, axis=a).ravel() for p in (1, PLACES - 1))
                u[large[:, None], a, first] = u[forest.beside[large, way][:, None], a, last]
        kernels.borrow_all(u, forest.beside, self.layout.layer)

    def errors(self, u: Floats, squares: Floats | None = None) -> tuple[Floats, Floats]:
        """Return the squares of the leaf blocks' errors, and what each agent leaves unbalanced."""
        # `squares` may take those of the agents; see `block_kernels.curvature`.
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
        found = np.asarray(kernels.curvature(u, forest.leaves, next_to, *around, squares, loads))
        row, cell = forest.holding(forest.ground.sharp)
        own = np.empty((len(row), len(forest.corners)))
        kernels.curvature(u, forest.leaves[row], next_to[row], *around, own, loads[:0])
        np.add.at(found, row, (SINGULAR - 1.0) * own[np.arange(len(row)), cell])
        if len(squares):
            squares[row, cell] *= SINGULAR
        return found, loads[:, forest.rows].ravel()

    def indicator(self, u: Floats) -> Indicator:
        """Return what every agent of the leaf blocks leaves unbalanced."""
        u = u.copy()
        self.everywhere(u)
        squares = np.empty((len(self.forest.leaves), len(self.forest.corners)))
        load = self.errors(u, squares)[1]
        return Indicator(squares[:, self.forest.rows].ravel(), load)

    def follow(self, old: Floats, rim: Ints) -> Floats:
        """Return the displacement interpolated to this forest from what it has grown from."""
        # `old` is known everywhere; `rim` belongs to this forest.
        forest, u = self.forest, self.zeros()
        known = forest.origin >= 0
        u[known] = old[forest.origin[known]]
        for level in range(1, forest.depth):
            block = np.arange(forest.start[level], forest.start[level + 1])
            fresh = block[~known[block]]
            parents = np.unique(forest.parent[fresh])
            around = (self.layout.layer, self.layout.ghosts)
            kernels.go_on(u, parents, forest.beside, rim, *around, False)
            kernels.hand_down(u, fresh, forest.parent, forest.octant, self.layout.ties)
        kernels.clean(u, forest.leaf, self.page[1], self.pages.mask)
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
    step, place = ways(dimension), corners(dimension)
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
