"""Blocks of B × B (× B) agents of one size and material, on a balanced tree.

A block that spawns gets 2^d children of half its size, and stays as their coarse level in
multigrid. No two leaf blocks that touch, be it at a corner, differ by more than a factor of two, so
that every neighbour of a block with children is there at its own level.

Every block holds B + 2 places along an axis, one halo of them belonging to its neighbours.
The cell at place p has its lower face along every axis at the same place; a block owns the
faces at 1 … B, and those at B + 1 on a side where no block of its own size follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.quadtree import LeafCells, morton
from kaju.model.elastic.posed_body import PosedBody, covering
from kaju.model.scene.box_kinds import MIXED

ACROSS = 8  # Agents along the edge of a block, B
MOST_ROOT = 1_000_000  # So many agents may stand in the blocks of the coarsest level

REGULAR, COARSE, REFINED, NOTHING = 0, 1, 2, 3
"""What a block has beside it: one of its size, a larger one, smaller ones, or no body."""


def offsets(dimension: int) -> Ints:
    """Return the offsets of a block's neighbours, x fastest; its own in the middle."""
    steps = product((-1, 0, 1), repeat=dimension)
    return np.array([step[::-1] for step in steps], dtype=np.int64)


@cache
def corners(dimension: int) -> Ints:
    """Return places (0 … B - 1) of a block's agents in the order of their Morton codes."""
    grid = np.array(list(product(range(ACROSS), repeat=dimension)), dtype=np.int64)
    return grid[np.argsort(morton(grid), kind="stable")]


@cache
def _parent_table(dimension: int) -> tuple[Ints, Ints]:
    """Return for every child and offset the parent's offset and the child there: (2^d, 3^d)."""
    child_index = np.arange(1 << dimension)[:, None, None] >> np.arange(dimension) & 1
    reach = child_index + offsets(dimension)
    way = ((reach >> 1) + 1) @ 3 ** np.arange(dimension)
    return way, (reach & 1) @ 2 ** np.arange(dimension)


@dataclass(frozen=True, eq=False)
class Forest:
    """Blocks of all levels, level after level, the largest first."""

    ground: PosedBody
    start: Ints  # shape (levels + 1,): First block of every level
    lower: Ints  # shape (blocks, dimension): Lower corners (units)
    parent: Ints  # shape (blocks,)
    child: Ints  # shape (blocks, 2^d): -1 for leaves
    beside: Ints  # shape (blocks, 3^d): Blocks of the same level, by `ways`; -1 for none
    kinds: Ints  # shape (blocks, 3^d): Material or kind of what is there, whatever its size
    origin: Ints  # shape (blocks,): The same block in the forest before, -1 for new ones
    step: Ints  # shape (blocks,): Spawning step in which its agents came to be
    cause: Floats = field(repr=False)  # shape (blocks,): 1 for children of chosen blocks, else NaN
    edge: int = 0

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.ground.dimension

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def depth(self) -> int:
        """Number of levels."""
        return len(self.start) - 1

    @cached_property
    def level(self) -> Ints:
        """Level of every block."""
        return np.repeat(np.arange(self.depth), np.diff(self.start))

    @cached_property
    def size(self) -> Ints:
        """Edges (units) of the blocks' agents."""
        return (self.edge // ACROSS) >> self.level

    @cached_property
    def leaf(self) -> Flags:
        """Which blocks have no children."""
        return np.asarray(self.child[:, 0] < 0)

    @cached_property
    def leaves(self) -> Ints:
        """Numbers of the leaf blocks, in the order of their Morton codes."""
        at = np.flatnonzero(self.leaf)
        return at[np.argsort(morton(self.lower[at]), kind="stable")]

    @property
    def kind(self) -> Ints:
        """Material of every block."""
        return self.kinds[:, 3**self.dimension // 2]

    @property
    def count(self) -> int:
        """Number of agents."""
        return int(len(self.leaves) * ACROSS**self.dimension)

    @property
    def agents(self) -> LeafCells:
        """All agents, in the order of their Morton codes."""
        return self.cells(self.leaves)

    @property
    def rows(self) -> Ints:
        """Where a block's agents stand in an array over its places, in the order of their codes."""
        return self.corners @ ACROSS ** np.arange(self.dimension)[::-1]

    def loaded_by(self, ground: PosedBody) -> Forest:
        """Return the same blocks, as the first ones, on other ground of the same body."""
        zeros, every = np.zeros_like(self.step), np.arange(len(self))
        return replace(self, ground=ground, origin=every, step=zeros, cause=np.zeros(len(self)))

    def states(self, composite: bool) -> Ints:
        """Tell what every block has beside it, shape (blocks, 3^d)."""
        # On its own level a block ignores its neighbours' children; in the `composite` it does not.
        there = self.beside >= 0
        state = np.where(there, REGULAR, np.where(self.kinds >= 0, COARSE, NOTHING))
        if composite:
            state[there & ~self.leaf[self.beside]] = REFINED
        return state

    def refined(self, marked: Flags, step: int) -> Forest:
        """Return the forest in which marked leaf blocks, and all that balance requires, spawn."""
        chosen = marked & self.leaf
        marked = chosen.copy()
        way, _ = _parent_table(self.dimension)
        child_index = self.child_index
        for level in range(self.depth - 1, 0, -1):
            block = np.arange(self.start[level], self.start[level + 1])
            block = block[marked[block]]
            alone = (self.beside[block] < 0) & (self.kinds[block] >= 0)
            row, m = np.nonzero(alone)
            marked[self.beside[self.parent[block[row]], way[child_index[block[row]], m]]] = True
        forest = self._grown(marked | ~self.leaf, chosen, step)
        unlike = forest._beside_other_material()
        if not unlike.any():
            return forest
        return forest.refined(unlike, step).after(forest)

    def after(self, before: Forest) -> Forest:
        """Return this forest as one that has grown from what `before` has grown from."""
        origin = np.where(self.origin >= 0, before.origin[self.origin], -1)
        return replace(self, origin=origin)

    @cached_property
    def child_index(self) -> Ints:
        """Which child of its parent every block is; bit a for axis a."""
        half = self.edge >> self.level
        bits = (self.lower // half[:, None]) & 1
        return np.asarray(bits @ 2 ** np.arange(self.dimension))

    def _beside_other_material(self) -> Flags:
        """Mark leaf blocks that are larger than a neighbour ahead of another material."""
        marked = np.zeros(len(self), dtype=np.bool_)
        if len(np.unique(self.kind)) == 1:
            return marked
        ahead = np.flatnonzero(np.abs(offsets(self.dimension)).sum(axis=1) == 1)
        way, _ = _parent_table(self.dimension)
        kinds = self.kinds[:, ahead]
        unlike = (self.states(False)[:, ahead] == COARSE) & (kinds != self.kind[:, None])
        block, m = np.nonzero(unlike)
        marked[self.beside[self.parent[block], way[self.child_index[block], ahead[m]]]] = True
        return marked

    def _grown(self, split: Flags, chosen: Flags, step: int) -> Forest:
        """Return the forest in which blocks are followed by children where they are to be split."""
        many = 1 << self.dimension
        way, turned = _parent_table(self.dimension)
        bits = np.arange(many)[:, None] >> np.arange(self.dimension) & 1
        level = _Level(
            self.lower[: self.start[1]], self.parent[: self.start[1]],
            self.beside[: self.start[1]], self.kinds[: self.start[1]],
            np.arange(self.start[1]), self.step[: self.start[1]], self.cause[: self.start[1]],
        )  # fmt: skip
        levels, children, begin, end = [level], [], 0, int(self.start[1])
        while True:
            old = level.origin >= 0
            here = np.zeros(len(old), dtype=np.bool_)
            here[old] = split[level.origin[old]]
            parent = np.flatnonzero(here)
            child = np.full((len(old), many), -1, dtype=np.int64)
            child[parent] = end + np.arange(many * len(parent)).reshape(-1, many)
            children.append(child)
            if not len(parent):
                break
            half = (self.edge >> len(levels)) * bits
            lower = (level.lower[parent][:, None] + half).reshape(-1, self.dimension)
            above = level.beside[parent][:, way]
            found = np.where(above >= 0, child[np.maximum(above - begin, 0), turned], -1)
            kinds = level.kinds[parent][:, way]
            origin = self.child[level.origin[parent]].ravel()
            fresh = origin < 0
            by_choice = chosen[level.origin[parent]]
            cause = np.repeat(np.where(by_choice, 1.0, np.nan), many)
            level = _Level(
                lower,
                np.repeat(parent, many) + begin,
                found.reshape(len(lower), -1),
                kinds.reshape(len(lower), -1),
                origin,
                np.where(fresh, step, self.step[origin]),
                np.where(fresh, cause, self.cause[origin]),
            )
            levels.append(level)
            begin, end = end, end + len(lower)
        count = [len(one.parent) for one in levels]
        start = np.concatenate([[0], np.cumsum(count)])
        lower, parents, beside, kinds, origin, steps, cause = (
            np.concatenate(column) for column in zip(*levels, strict=True)
        )
        return Forest(
            self.ground, start, lower, parents, np.concatenate(children), beside, kinds,
            origin, steps, cause, self.edge,
        )  # fmt: skip

    def cells(self, block: Ints) -> LeafCells:
        """Return the agents of blocks, in the order of their Morton codes if the blocks are."""
        size = np.repeat(self.size[block], len(self.corners))
        lower = (
            self.lower[block][:, None] + self.corners * self.size[block][:, None, None]
        ).reshape(-1, self.dimension)
        code = morton(lower)
        many = len(self.corners)
        kind, step = np.repeat(self.kind[block], many), np.repeat(self.step[block], many)
        return LeafCells(lower, size, kind, step, np.repeat(self.cause[block], many), code)

    @property
    def loaded(self) -> Flags:
        """Which of the `leaves` may take loads."""
        block, cell = self.leaves, self.ground.cell
        size, lower = self.size[block] * ACROSS, self.lower[block]
        found = np.zeros(len(block), dtype=np.bool_)
        loaded = self.ground.loaded
        code = morton(lower)
        at = np.searchsorted(code, morton(loaded * cell), side="right") - 1
        inside = np.all(loaded * cell - lower[at] < size[at, None], axis=1) & (at >= 0)
        found[at[inside]] = True
        small = np.flatnonzero(size < cell)
        keys = self.ground.scene.lattice.key
        found[small] = np.isin(keys(lower[small] // cell), keys(loaded))
        return found

    def holding(self, points: Ints) -> tuple[Ints, Ints]:
        """Return the agents that hold any of some unit cells: which of the `leaves`, and place."""
        lower, size = self.lower[self.leaves], self.size[self.leaves]
        at = np.searchsorted(morton(lower), morton(np.maximum(points, 0)), side="right") - 1
        place = (points - lower[at]) // size[at, None]
        held = ((place >= 0) & (place < ACROSS)).all(axis=1)
        found = np.unique(np.column_stack([at, place])[held], axis=0)
        return found[:, 0], found[:, 1:] @ ACROSS ** np.arange(self.dimension)[::-1]

    def with_neighbours(self, block: Ints) -> Ints:
        """Return leaf blocks and all those that touch them, in order."""
        marked = np.zeros(len(self), dtype=np.bool_)
        marked[block] = True
        way, _ = _parent_table(self.dimension)
        parent = self.parent[block, None]
        above = self.beside[parent, way[self.child_index[block]]]
        beside = self.beside[block]
        large = (beside < 0) & (self.kinds[block] >= 0) & (parent >= 0)
        beside = np.where(large, above, beside)
        near = np.unique(beside[beside >= 0])
        children = self.child[near[~self.leaf[near]]]
        marked[near] = True
        marked[children.ravel()] = True
        order = self.leaves
        return order[marked[order]]

    @cached_property
    def corners(self) -> Ints:
        """Places (0 … B - 1) of a block's agents in the order of their Morton codes."""
        return corners(self.dimension)


class _Level(NamedTuple):
    lower: Ints
    parent: Ints
    beside: Ints
    kinds: Ints
    origin: Ints
    step: Ints
    cause: Floats


def first_forest(ground: PosedBody) -> Forest | None:
    """Return the first blocks: of one size, as large as body and surroundings let them be."""
    # None where they would have to be too small or too many for what the body is.
    lower, upper = ground.scene.bounds()
    spans, d = upper - lower, ground.dimension
    exponent = int(np.log2(max(1, min(spans.max() // 2, spans.min()))))
    while True:
        boxes = covering(lower, upper, exponent)
        kind = ground.kinds_of(boxes, exponent)
        beside = boxes[:, None] + (offsets(d) << exponent)
        body = np.flatnonzero(kind != -1)
        kinds = ground.kinds_of(beside[body].reshape(-1, d), exponent).reshape(len(body), -1)
        mine = kind[body] >= 0
        if not (kinds[mine] == MIXED).any() and not (kind == MIXED).any():
            break
        if exponent == 0:
            return None
        exponent -= 1
    body, kinds = body[mine], kinds[mine]
    edge = ground.cell << exponent
    if edge // ACROSS < ground.smallest or len(body) * ACROSS**d > MOST_ROOT:
        return None
    place = boxes[body] * ground.cell
    order = np.argsort(morton(place), kind="stable")
    place, kinds = place[order], kinds[order]
    beside = _found(place, place[:, None] + offsets(d) * edge)
    n = len(place)
    zeros = np.zeros(n, dtype=np.int64)
    child = np.full((n, 1 << d), -1, dtype=np.int64)
    forest = Forest(
        ground, np.array([0, n]), place, zeros - 1, child, beside, kinds,
        np.arange(n), zeros, np.zeros(n), edge,
    )  # fmt: skip
    return evenly_loaded(forest)


def evenly_loaded(forest: Forest) -> Forest:
    """Return the forest in which agents take loads all over, or none, or are small."""
    ground = forest.ground
    while True:
        unfit, leaves = np.zeros(len(forest), dtype=np.bool_), forest.leaves
        large = leaves[(forest.size[leaves] > ground.cell) | (forest.loaded & ground.ends_within)]
        if len(large):
            agents = ground.unevenly_loaded(forest.cells(large))
            unfit[large] = agents.reshape(len(large), -1).any(axis=1)
        if not unfit.any():
            return forest
        forest = forest.refined(unfit, 0).after(forest)


def _found(place: Ints, asked: Ints) -> Ints:
    """Return the number of each wanted place among those in the order of their codes; else -1."""
    code = morton(place)
    flat = asked.reshape(-1, place.shape[1])
    there = np.all(flat >= 0, axis=1)
    wanted = morton(np.where(there[:, None], flat, 0))
    at = np.minimum(np.searchsorted(code, wanted), len(code) - 1)
    return np.where(there & (code[at] == wanted), at, -1).reshape(asked.shape[:-1])
