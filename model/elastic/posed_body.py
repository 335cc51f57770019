"""The posed body in scaled units: cell types, supports and loads of a scene, box by box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, log2

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.corners import ROUND, sharp_places
from kaju.model.elastic.moduli import constants_of, scene_moduli
from kaju.model.elastic.pair.leaves import BITS, LeafCells, morton
from kaju.model.elastic.scales import Scales
from kaju.model.elastic.uneven_loads import portions
from kaju.model.scene import Scene
from kaju.model.scene.lattice import check_boxes
from kaju.model.scene.resolved_body import MIXED

ACROSS_LONGEST, ACROSS_SHORTEST = {2: 8, 3: 4}, 2
"""The first agents are at least this many along the body's longest and shortest side. Of 4, 8
and 16 in the plane 8 are a sixth sooner than the others on a plate, an L and a pierced plate, at
0.02 and 0.003, with 2 % more agents than 4."""


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
        # An agent's edge is at least the cell divided by 2 to this power.
        self.cell = 1 << min(spare, 22 if self.dimension == 2 else 16)
        self.smallest = 1 if self.resolution is None else self.cell
        self.extent = np.asarray(lattice.shape) * self.cell
        self._collect_loads()

    @property
    def no_bound(self) -> str:
        """Why agents in it prove nothing; empty if they do."""
        return "" if self.dimension == 2 else "in space there are no bounds"

    @cached_property
    def sharp(self) -> Ints:
        """The unit cells round points at which stress is singular; none in space."""
        if self.dimension == 3:
            return np.empty((0, 3), dtype=np.int64)
        corner = np.rint(sharp_places(self.scene)[0] / self.scene.lattice.cell_size)
        return np.asarray(corner[:, None] * self.cell + ROUND, dtype=np.int64).reshape(-1, 2)

    def start(self) -> LeafCells:
        """Return the first leaves: as large as body, supports and loads allow."""
        lower, upper = self.scene.bounds()
        spans = upper - lower
        across = ACROSS_LONGEST[self.dimension]
        widest = max(1.0, min(spans.max() / across, spans.min() / ACROSS_SHORTEST))
        exponent = int(log2(widest))
        first, last = lower >> exponent, -((-upper) >> exponent)
        boxes = (np.indices(tuple(last - first)).reshape(self.dimension, -1).T + first) << exponent
        leaves = LeafCells.of(
            boxes * self.cell,
            np.full(len(boxes), self.cell << exponent),
            self.scene.box_kinds(boxes, exponent),
        )
        while (mixed := leaves.kind == MIXED).any():
            leaves, exponent = leaves.split(mixed), exponent - 1
            new = np.flatnonzero(leaves.kind == MIXED)
            leaves.kind[new] = self.scene.box_kinds(leaves.lower[new] // self.cell, exponent)
        leaves = leaves.only(leaves.kind >= 0)
        if not len(leaves):
            raise SceneError("body: no cell is of a material, so there is nothing to solve")
        for unfit in (self._beside_mixed, self.unevenly_loaded):
            while (chosen := unfit(leaves)).any():
                leaves = leaves.split(chosen)
        return leaves.balanced()

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
        leaf, row, _, touches = self._laid(leaves)
        large = leaves.size[leaf] > self.cell
        leaf, row, touches = leaf[large], row[large], touches[large]
        direction, force = self._direction[row], self._force[row]
        # Every side, or middle, of a leaf needs a load on all of its cells, equal on each.
        side = leaf * (2 * d + 1) + direction + 1
        _, group, count = np.unique(side, return_inverse=True, return_counts=True)
        full = (leaves.size[leaf] // self.cell) ** np.where(direction < 0, d, d - 1)
        mean = np.stack([np.bincount(group, one, len(count)) for one in force.T], axis=1)
        unlike = np.abs(force - (mean / count[:, None])[group])
        wrong = (unlike > 1e-9 * np.abs(force).max(initial=0.0)).any(axis=1)
        wrong |= ~touches | (count[group] != full) | ~self._even[row]
        unfit[leaf[wrong]] = True
        if self._even.all():
            return unfit
        # Loads that end within a side are approximated better by smaller leaves.
        *_, leaf, rest = self.forces(leaves)
        size = leaves.size[leaf]
        # Loads that end within sides may leave such a share of the energy norm.
        least = (3e-4 if d == 2 else 1e-2) * self._strength
        large = np.sqrt(size / self.cell) * rest > least
        unfit[leaf[large & (size > self.smallest)]] = True
        return unfit

    def _laid(self, leaves: LeafCells) -> tuple[Ints, Ints, Ints, Flags]:
        """Return leaves and loads of cells that they share, how far the leaves are from the cells.

        And which of the leaves have the loaded side, or middle.
        """
        # Those in a leaf, or of the cell that holds it, follow one another in the order of codes.
        whole = self.cell**self.dimension
        start = leaves.code // whole * whole
        end = start + np.maximum(leaves.size**self.dimension, whole)
        first, last = (np.searchsorted(self._code, code) for code in (start, end))
        many = last - first
        leaf = np.repeat(np.arange(len(leaves)), many)
        row = np.arange(len(leaf)) + np.repeat(first - np.cumsum(many) + many, many)
        offset, direction = leaves.lower[leaf] - self.loaded[row] * self.cell, self._direction[row]
        depth = offset[np.arange(len(leaf)), np.maximum(direction, 0) // 2]
        end = np.where(direction % 2, self.cell - leaves.size[leaf], 0)
        return leaf, row, offset, (direction < 0) | (depth == end)

    def forces(self, leaves: LeafCells) -> tuple[Floats, Floats, Ints, Floats]:
        """Return the loads on sides of leaves and within them, as in `Sides`, and what is left.

        Of loads that end within sides that is the norm of the traction which is not linear, after
        the leaf of each.
        """
        leaf, row, offset, touches = self._laid(leaves)
        leaf, row, offset = leaf[touches], row[touches], offset[touches]
        direction, size, d = self._direction[row], leaves.size[leaf] / self.cell, self.dimension
        # A cell's load is shared by the smaller leaves in it.
        share = np.minimum(size, 1.0) ** (d - (direction >= 0))
        force = share[:, None] * self._force[row]
        at = np.flatnonzero(~self._even[row] & (size <= 1.0))
        side, load_of = direction[at], row[at]
        described = self._force[load_of], self._part[load_of], self._growth[load_of]
        force[at], moment, rest = portions(side, *described, offset[at] / self.cell, size[at])
        load, inside = np.zeros((len(leaves), 2 * d, d, d)), np.zeros((len(leaves), d))
        on = direction >= 0
        np.add.at(inside, leaf[~on], force[~on])
        np.add.at(load[:, :, 0], (leaf[on], direction[on]), force[on])
        along = np.array([np.delete(np.arange(d), axis) for axis in range(d)])[side // 2]
        moment = np.take_along_axis(moment, along[:, None], axis=2).swapaxes(1, 2)
        np.add.at(load[:, :, 1:], (leaf[at], side), moment / size[at, None, None])
        return load, inside, leaf[at], rest

    def _collect_loads(self) -> None:
        """Sum the forces on the same face of a cell, in the order of their codes, and scale all."""
        scene, d = self.scene, self.dimension
        applied = scene.applied(self.stage)
        n, code = len(applied.cells), morton(applied.cells)
        # A number for every side, or middle (-1), of cells; each uneven force has its own.
        keys = code * (2 * d + 1) + applied.direction + 1
        part = np.tile(np.array([[0.0], [1.0]]), (n, 1, d))
        even, growth = np.ones(n, dtype=np.bool_), np.zeros((n, d, d))
        if applied.uneven is not None:
            row, part[row], growth[row] = applied.uneven
            even[row], keys[row] = False, -1 - np.arange(len(row))
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        force = np.zeros((len(first), d))
        np.add.at(force, inverse, applied.force)
        order = np.argsort(code[first], kind="stable")
        first, force = first[order], force[order]
        self._code = code[first] * self.cell**d
        self.loaded, self._direction = applied.cells[first], applied.direction[first]
        # For the units see `kaju.model.elastic.equal.problem`.
        modulus = float(constants_of(scene)[:, 0].max())
        sides = map(scene.side_condition, scene.lattice.sides)
        self.scales = Scales.of_cells(scene, modulus, force, sides)
        self._force, self._growth = force / self.scales.force, growth[first] / self.scales.force
        self._part, self._even = part[first], even[first]
        # Square root of about the energy of the loads, each spread over the width it covers.
        share = (self._part[:, 1] - self._part[:, 0]).prod(axis=1)
        wide = float(share.sum()) ** (1.0 / (self.dimension - 1))
        square = wide * ((self._force**2).sum(axis=1) / share).sum()
        self._strength = float(np.sqrt(square / max((~even).sum(), 1)))
        self.moduli = scene_moduli(scene, modulus)
