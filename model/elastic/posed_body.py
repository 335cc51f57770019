"""The posed body in scaled units: cell types, supports and loads of a scene, box by box."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, log2
from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.corners import ROUND, sharp_corners
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.pair.leaves import BITS, LeafCells, corner_ends
from kaju.model.elastic.scales import Scales
from kaju.model.elastic.uneven_loads import Portions
from kaju.model.scene import Scene
from kaju.model.scene.lattice import check_boxes
from kaju.model.scene.resolved_body import MIXED
from kaju.model.scene.selection import Uneven

ACROSS_LONGEST, ACROSS_SHORTEST = {2: 8, 3: 4}, 2
"""The first agents are at least this many along the body's longest and shortest side. Of 4, 8
and 16 in the plane 8 are a sixth sooner than the others on a plate, an L and a pierced plate, at
0.02 and 0.003, with 2 % more agents than 4."""
ENDED = {2: 3e-4, 3: 1e-2}
"""Loads that end within sides may leave about such a share of the energy norm: less than tolerances
that are asked for."""
DEEPEST = {2: 22, 3: 16}
"""An agent's edge is at least the scene's cell divided by 2 to this power."""


class LeafForces(NamedTuple):
    """Forces on leaves; scaled."""

    leaf: Ints
    direction: Ints  # Side of the leaf, -1 for its middle
    force: Floats
    uneven: Portions | None = None  # Those that lie unevenly on their sides again, with moments


@dataclass(eq=False)
class PosedBody:
    """A scene whose cell types, supports and loads are looked up for boxes of any size.

    A resolution refines the cells of the scene that is asked about, and allows none smaller.
    `cell` is the edge of the cells of `scene`, `smallest` that of the smallest agents allowed, and
    `extent` those of the array (units); scales and moduli are those of equal cells; `loaded` are
    the loaded cells, shape (n, dimension).
    """

    asked: Scene
    stage: int | None = None
    resolution: int | None = None

    def __post_init__(self) -> None:
        self.stage, self.resolution = (n and int(n) for n in (self.stage, self.resolution))
        times = self.resolution or 1
        self.scene = self.asked if times == 1 else self.asked.refine(times)
        lattice = self.scene.lattice
        check_boxes(lattice)
        self.dimension = lattice.dimension
        digits = max(1, ceil(log2(max(lattice.shape))))
        spare = BITS[self.dimension] - digits
        if spare < 1:
            raise SceneError(
                f"body.cells: {max(lattice.shape)} cells along an axis are more than the "
                f"2^{BITS[self.dimension] - 1} that agents can count; use larger cells"
            )
        self.cell = 1 << min(spare, DEEPEST[self.dimension])
        self.smallest = 1 if self.resolution is None else self.cell
        self.extent = np.asarray(lattice.shape) * self.cell
        self._collect_loads(self.stage)
        self._scale()

    def kinds_at(self, points: Ints) -> Ints:
        """Return the kinds of unit cells, also outside the array."""
        return self.scene.box_kinds(points // self.cell, 0)

    @cached_property
    def sharp(self) -> Ints:
        """The unit cells round points at which stress is singular, shape (n, dimension)."""
        corner = np.rint(sharp_corners(self.scene) / self.scene.lattice.cell_size)
        if not len(corner):
            return np.empty((0, self.dimension), dtype=np.int64)
        return np.asarray(corner[:, None] * self.cell + ROUND, dtype=np.int64).reshape(-1, 2)

    def given(self, side: int) -> Floats:
        """Return the scaled prescribed displacement beyond a side."""
        condition = self.scene.side_condition(self.scene.lattice.sides[side])
        if condition.displacement is None:
            return np.zeros(self.dimension)
        return np.asarray(condition.displacement) / self.scales.displacement

    def foundation(self, side: int) -> float:
        """Return the scaled stiffness per area of the foundation beyond a side."""
        stiffness = self.scene.side_condition(self.scene.lattice.sides[side]).stiffness
        return (stiffness or 0.0) * self.scales.length / self.scales.modulus

    def start(self) -> LeafCells:
        """Return the first leaves: as large as body, supports and loads allow."""
        lower, upper = self.scene.bounds()
        spans = upper - lower
        across = ACROSS_LONGEST[self.dimension]
        widest = max(1.0, min(spans.max() / across, spans.min() / ACROSS_SHORTEST))
        exponent = int(log2(widest))
        leaves = self._pure(covering(lower, upper, exponent), exponent)
        leaves = self._until(leaves, self._beside_mixed)
        leaves = self._until(leaves, self.unevenly_loaded)
        return leaves.balanced()

    def _pure(self, boxes: Ints, exponent: int) -> LeafCells:
        """Split boxes of cells until each is of one kind; keep those of material."""
        lower, size, kind = [], [], []
        corners = corner_ends(self.dimension)
        while len(boxes):
            found = self.scene.box_kinds(boxes, exponent)
            body = found >= 0
            lower.append(boxes[body] * self.cell)
            size.append(np.full(np.count_nonzero(body), self.cell << exponent, dtype=np.int64))
            kind.append(found[body])
            exponent -= 1
            mixed = boxes[found == MIXED]
            boxes = (mixed[:, None] + corners * (1 << max(exponent, 0))).reshape(-1, self.dimension)
        sizes = np.concatenate(size)
        if not len(sizes):
            raise SceneError("body: no cell is of a material, so there is nothing to solve")
        return LeafCells.of(np.concatenate(lower), sizes, np.concatenate(kind))

    def _until(self, leaves: LeafCells, unfit: Callable[[LeafCells], Flags]) -> LeafCells:
        """Split leaves until none is unfit."""
        while True:
            chosen = unfit(leaves)
            if not chosen.any():
                return leaves
            leaves = leaves.split(chosen)

    def _beside_mixed(self, leaves: LeafCells) -> Flags:
        """Tell which leaves have a box of their own size beside them that is not of one kind."""
        unfit = np.zeros(len(leaves), dtype=np.bool_)
        for size in np.unique(leaves.size[leaves.size > self.cell]):
            here = np.flatnonzero(leaves.size == size)
            exponent = int(size // self.cell).bit_length() - 1
            for offset in product((-1, 0, 1), repeat=self.dimension):
                if any(offset):
                    box = (leaves.lower[here] + np.array(offset) * size) // self.cell
                    unfit[here] |= self.scene.box_kinds(box, exponent) == MIXED
        return unfit

    def unevenly_loaded(self, leaves: LeafCells) -> Flags:
        """Return leaves to be split because loads are not uniform over a side."""
        unfit, d = np.zeros(len(leaves), dtype=np.bool_), self.dimension
        if not len(self.loaded):
            return unfit
        owner = leaves.find(self.loaded * self.cell)
        large = (owner >= 0) & (leaves.size[owner] > self.cell)
        owner, direction, force = owner[large], self._direction[large], self._force[large]
        # A loaded face of a cell inside the leaf is not on the leaf's side.
        offset = self.loaded[large] * self.cell - leaves.lower[owner]
        depth = offset[np.arange(len(owner)), np.maximum(direction, 0) // 2]
        edge = np.where(np.maximum(direction, 0) % 2, leaves.size[owner] - self.cell, 0)
        wrong = (direction >= 0) & (depth != edge)
        # Every side, or middle, of a leaf needs a load on all of its cells, equal on each.
        side = owner * (2 * d + 1) + direction + 1
        _, group, count = np.unique(side, return_inverse=True, return_counts=True)
        wrong |= count[group] != (leaves.size[owner] // self.cell) ** np.where(
            direction < 0, d, d - 1
        )
        mean = np.stack([np.bincount(group, one, len(count)) for one in force.T], axis=1)
        unlike = np.abs(force - (mean / count[:, None])[group])
        wrong |= (unlike > 1e-9 * np.abs(force).max(initial=0.0)).any(axis=1)
        unfit[owner[wrong | (self._uneven_of[large] >= 0)]] = True
        if self.ends_within:
            # Loads that end within a side are approximated better by smaller leaves.
            rest = self.forces(leaves).uneven or Portions.none(d)
            size = leaves.size[rest.box] / self.cell
            large = np.sqrt(size) * rest.rest > ENDED[d] * self._strength
            unfit[rest.box[large & (leaves.size[rest.box] > self.smallest)]] = True
        return unfit

    @property
    def ends_within(self) -> bool:
        """Whether loads lie unevenly on faces of the scene's cells."""
        return bool((self._uneven_of >= 0).any())

    def forces(self, leaves: LeafCells) -> LeafForces:
        """Return the loads on leaves; a cell's load is shared by the smaller ones in it."""
        d = self.dimension
        if not len(self.loaded):
            nothing = np.empty(0, dtype=np.int64)
            return LeafForces(nothing, nothing, np.empty((0, d)))
        owner = leaves.find(self.loaded * self.cell)
        large = np.flatnonzero((owner >= 0) & (leaves.size[owner] >= self.cell))
        # Smaller leaves share the loads of their cell, found by bisection in the sorted keys.
        small = np.flatnonzero(leaves.size < self.cell)
        key = self.scene.lattice.key(leaves.lower[small] // self.cell)
        loaded_key = self._key // (2 * d + 1)
        first, last = (np.searchsorted(loaded_key, key, side=end) for end in ("left", "right"))
        leaf = np.repeat(small, last - first)
        # One row for every leaf and load of its cell; these loads follow one another.
        row = np.arange(len(leaf)) + np.repeat(last - np.cumsum(last - first), last - first)
        direction = self._direction[row]
        offset = leaves.lower[leaf] - self.loaded[row] * self.cell
        depth = offset[np.arange(len(leaf)), np.maximum(direction, 0) // 2]
        end = np.where(direction % 2, self.cell - leaves.size[leaf], 0)
        touches = (direction < 0) | (depth == end)
        leaf, row, offset = leaf[touches], row[touches], offset[touches]
        share = (leaves.size[leaf] / self.cell) ** (d - (self._direction[row] >= 0))
        leaf, row = np.concatenate([owner[large], leaf]), np.concatenate([large, row])
        share = np.concatenate([np.ones(len(large)), share])
        offset = np.concatenate([np.zeros((len(large), d), dtype=np.int64), offset])
        force, direction = share[:, None] * self._force[row], self._direction[row]
        at = np.flatnonzero((self._uneven_of[row] >= 0) & (leaves.size[leaf] <= self.cell))
        which = self._uneven_of[row[at]]
        loads = Uneven(row[at], self._uneven.part[which], self._uneven.growth[which])
        size = leaves.size[leaf[at]] / self.cell
        uneven = Portions.of(
            leaf[at], direction[at], self._force[row[at]], loads, offset[at] / self.cell, size
        )
        force[at] = uneven.force
        acts = np.ones(len(leaf), dtype=np.bool_)
        acts[at] = uneven.force.any(axis=1) | uneven.moment.any(axis=(1, 2))
        uneven = Portions._make(column[acts[at]] for column in uneven)
        return LeafForces(leaf[acts], direction[acts], force[acts], uneven)

    def _collect_loads(self, stage: int | None) -> None:
        """Sum the forces on the same face of a cell, in the order of their keys."""
        # Uneven ones stay apart: `_uneven_of` is the index of each in `_uneven`, -1 for others.
        applied = self.scene.applied(stage)
        d = self.dimension
        # A number for every side, or middle (-1), of cells.
        keys = self.scene.lattice.key(applied.cells) * (2 * d + 1) + applied.direction + 1
        nothing = Uneven(np.zeros(0, dtype=np.int64), np.zeros((0, 2, d)), np.zeros((0, d, d)))
        self._uneven = applied.uneven or nothing
        rows = self._uneven.row
        alone = np.zeros(len(keys), dtype=np.int64)
        alone[rows] = np.arange(1, len(rows) + 1)
        apart = np.stack([keys, alone]) if len(rows) else keys
        _, first, inverse = np.unique(apart, axis=-1, return_index=True, return_inverse=True)
        self._key, self._uneven_of = keys[first], alone[first] - 1
        self.loaded, self._direction = applied.cells[first], applied.direction[first]
        self._force = np.zeros((len(first), self.dimension))
        np.add.at(self._force, inverse.ravel(), applied.force)

    def _scale(self) -> None:
        """Choose units and divide by them; see `kaju.model.elastic.equal.problem`."""
        scene = self.scene
        modulus = max(material.youngs_modulus for material in scene.cell_materials)
        sides = map(scene.side_condition, scene.lattice.sides)
        self.scales = Scales.of_cells(scene, modulus, self._force, sides)
        self._force /= self.scales.force
        self._uneven = self._uneven._replace(growth=self._uneven.growth / self.scales.force)
        # Square root of about the energy of the loads, each spread over the width it covers.
        share, uneven = np.ones(len(self._force)), self._uneven_of >= 0
        part = self._uneven.part
        share[uneven] = (part[:, 1] - part[:, 0]).prod(axis=1)[self._uneven_of[uneven]]
        wide = float(share.sum()) ** (1.0 / (self.dimension - 1))
        square = wide * ((self._force**2).sum(axis=1) / share).sum()
        self._strength = float(np.sqrt(square / max(len(part), 1)))
        self.moduli = scene_moduli(scene, modulus)


def covering(lower: Ints, upper: Ints, exponent: int) -> Ints:
    """Return the boxes of 2^exponent cells, by their lower corners, that cover a box of cells."""
    first, last = lower >> exponent, -((-upper) >> exponent)
    ranges = [np.arange(a, b) for a, b in zip(first, last, strict=True)]
    return np.stack([g.ravel() for g in np.meshgrid(*ranges, indexing="ij")], axis=1) << exponent
