"""A stress in balance within an outline, free of traction on it: the best of its kind."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SupportError
from kaju.factors import rigid_motions
from kaju.model.scene.curves import Point

from .convex_pieces import LEAST_AREA, NEAR, Corners, area_of, triangles_of
from .fitted_displacement import FittedDisplacement
from .joined_blocks import MergedSquares, joined
from .laws import Law
from .split_triangle import SplitTriangles
from .true_shapes import HeldLeaves

# Pieces with a flatter triangle are left out, and those of little area (in leaves) with one of a
# millionth: a body within the body is at least as soft.
LEAST_SHAPE = 1e-10
SMALL_RESIDUAL = 1e-7  # largest force out of balance, as a share of the largest load: rounding


# corners on lines along leaves' sides, in order, by the axis and place of the line
Lines = dict[tuple[int, float], list[float]]


class LooseError(SupportError):
    """A part of the pieces could move without straining."""


class WholeLeaf(NamedTuple):
    """Whole leaves of one law with smaller neighbours on the same sides, made of triangles."""

    triangles: SplitTriangles
    points: Ints  # which of the square's corners and middles of sides, in turns, they have
    sides: Floats  # their ends in a unit square, counter-clockwise. Shape (n, 2, 2)
    matrix: Floats  # forces on the sides by displacements of the sides
    answer: Floats  # patterns of each triangle by displacements of the sides
    sagging: Floats  # patterns under the weight where no side moves
    law: Law


@lru_cache(maxsize=256)
def whole_leaf(halved: tuple[bool, ...], law: Law, weight: Point) -> WholeLeaf:
    """Return the table of a unit square with a middle on some of its sides."""
    ring = _ring([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], halved)
    n = len(ring)
    corners = np.array([[ring[k], ring[(k + 1) % n], (0.5, 0.5)] for k in range(n)])
    triangles = SplitTriangles(corners, law.compliance, np.array(weight))
    four = np.arange(4)
    own = np.empty((n, 12), dtype=np.int64)
    for k in range(n):
        following = n + (k + 1) % n
        own[k] = np.concatenate(
            [4 * k + four, 4 * following + four, 4 * (n + k) + four[[2, 3, 0, 1]]]
        )
    matrix = np.zeros((8 * n, 8 * n))
    for rows, part in zip(own, triangles.matrix, strict=True):
        matrix[np.ix_(rows, rows)] += part
    sides, spokes = slice(0, 4 * n), slice(4 * n, 8 * n)
    borne = np.bincount(own.ravel(), triangles.tractions(triangles.sagging).ravel(), 8 * n)
    asked = np.column_stack([matrix[spokes, sides], borne[spokes]])
    inner = -np.linalg.solve(matrix[spokes, spokes], asked)
    moved = np.concatenate([np.eye(4 * n, 4 * n + 1), inner])  # the last column by the weight
    answer = triangles.answer @ moved[own]
    sagging = answer[..., -1] + triangles.sagging
    outer = matrix[sides, sides] + matrix[sides, spokes] @ inner[:, :-1]
    points = np.flatnonzero(np.stack([np.ones(4), halved], axis=1))
    return WholeLeaf(triangles, points, corners[:, :2], outer, answer[..., :-1], sagging, law)


def _ring(square: Corners, halved: Iterable[bool]) -> Corners:
    """Return the corners of a square, and middles of some sides, counter-clockwise."""
    ring: list[Point] = []
    for (x, y), (u, v), half in zip(square, square[1:] + square[:1], halved, strict=True):
        ring += [(x, y), (0.5 * (x + u), 0.5 * (y + v))] if half else [(x, y)]
    return ring


class BalancedPieces:
    """Triangles of all leaves within the inner outline, joined by linear tractions on their sides.

    `fitted` numbers the corners of the same leaves, `weight` is a force on a unit of area.
    """

    def __init__(self, fitted: FittedDisplacement, held: HeldLeaves, weight: Floats):
        self.leaves, self.weight = fitted.leaves, weight
        self.low = self.leaves.lower()
        self.high = self.low + (self.leaves.size * self.leaves.unit)[:, None]
        self._triangulate(held, fitted.middle >= 0)
        self._join(fitted)

    def _triangulate(self, held: HeldLeaves, halved: Flags) -> None:
        leaves, alike = self.leaves, held.whole >= 0
        self.laws = list(held.laws)
        rings = {
            leaf: [(law, ring) for law, at in zip(cut.held, cut.rings, strict=True) for ring in at]
            for leaf, cut in held.cut.items()
        }
        lines, touching = self._points_on_sides(rings, halved)
        # whole leaves are alike but where a cut ends within one of their sides
        touched = np.unique(touching[alike[touching]])
        for leaf, square in zip(touched.tolist(), leaves.squares(touched), strict=True):
            rings[leaf] = [(self.laws[held.whole[leaf]], _ring(square, halved[leaf]))]
        corners: list[tuple[Point, Point, Point]] = []
        of: list[tuple[int, int]] = []
        left_out: list[tuple[Point, ...]] = []
        for leaf, at in rings.items():
            low, high = self.low[leaf].tolist(), self.high[leaf].tolist()
            # what is left out beside another material leaves a crack: no more than must be
            alone = alike[leaf] or len(held.cut[leaf].held) == 1
            edge = high[0] - low[0] if alone else 0.0
            for law, ring in at:
                split = _with_points_beside(ring, low, high, lines)
                if alike[leaf] and len(split) == len(ring):
                    continue
                alike[leaf] = False
                made = _triangles_in(split, edge)
                corners += made
                of += [(leaf, self.laws.index(law))] * len(made)
                left_out += [] if made else [split]
        self.corners = np.array(corners, dtype=float).reshape(-1, 3, 2)
        self.owner, self.law = np.array(of, dtype=np.int64).reshape(-1, 2).T
        sides = [side for ring in left_out for side in zip(ring, ring[1:] + ring[:1], strict=True)]
        self.flat_ends = np.array(sides, dtype=float).reshape(-1, 2, 2)
        self.flat = np.repeat(np.arange(len(left_out)), [len(ring) for ring in left_out])
        compliance = np.array([law.compliance for law in self.laws])
        self.cut = SplitTriangles(self.corners, compliance[self.law], self.weight)
        x, y = self.weight.tolist()
        kind = np.where(alike, 16 * held.whole + halved @ [1, 2, 4, 8], -1)
        self.whole = [
            (
                whole_leaf(tuple(k >> s & 1 > 0 for s in range(4)), self.laws[k // 16], (x, y)),
                np.flatnonzero(kind == k),
            )
            for k in np.union1d(kind[alike], 0).tolist()  # 0 in any case, and first
        ]
        self.area = np.zeros(len(leaves))
        np.add.at(self.area, self.owner, self.cut.area)
        self.area[alike] = (leaves.size[alike] * leaves.unit) ** 2

    def _points_on_sides(
        self, rings: dict[int, list[tuple[Law, Corners]]], halved: Flags
    ) -> tuple[Lines, Ints]:
        """Return where on sides of cut leaves corners lie, and leaves that touch cuts' ends."""
        lines: dict[tuple[int, float], set[float]] = {}
        ends: Corners = []
        squares = self.leaves.squares(np.array([*rings], dtype=np.int64))
        for (leaf, held), square in zip(rings.items(), squares, strict=True):
            for x, y in _ring(square, halved[leaf]):
                lines.setdefault((0, x), set()).add(y)
                lines.setdefault((1, y), set()).add(x)
            (x0, y0), _, (x1, y1), _ = square
            for x, y in chain.from_iterable(ring for _, ring in held):
                upright, level = x in (x0, x1), y in (y0, y1)
                if upright:
                    lines[0, x].add(y)
                if level:
                    lines[1, y].add(x)
                if upright is not level:
                    ends.append((x, y))
        nudges = 0.25 * self.leaves.unit * np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])
        touching = self.leaves.at((np.reshape(ends, (-1, 1, 2)) + nudges).reshape(-1, 2))
        return {key: sorted(values) for key, values in lines.items()}, touching[touching >= 0]

    def _join(self, fitted: FittedDisplacement) -> None:
        """Count the sides: first those of triangles in cut leaves, then those round whole ones."""
        ends = [self.corners[:, [0, 1]], self.corners[:, [1, 2]], self.corners[:, [2, 0]]]
        starts = [np.stack(ends, axis=1).reshape(-1, 2, 2)]
        leaf_of, law_of = [np.repeat(self.owner, 3)], [np.repeat(self.law, 3)]
        cut = np.concatenate([starts[0], self.flat_ends])
        points = np.concatenate([fitted.place, cut.reshape(-1, 2)])
        near = cKDTree(points, compact_nodes=False, balanced_tree=False).query_pairs(
            NEAR, output_type="ndarray"
        )
        graph = sp.csr_array(
            (np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(points), len(points))
        )
        one = connected_components(graph, directed=False)[1]
        *numbers, flat = np.split(one[fitted.nodes :].reshape(-1, 2), [len(starts[0])])
        around = np.stack([fitted.corner, fitted.middle], axis=2).reshape(-1, 8)
        for table, rows in self.whole:
            size = self.leaves.size[rows] * self.leaves.unit
            placed = self.low[rows][:, None, None] + size[:, None, None, None] * table.sides
            starts.append(placed.reshape(-1, 2, 2))
            leaf_of.append(np.repeat(rows, len(table.sides)))
            law_of.append(np.full(len(leaf_of[-1]), self.laws.index(table.law)))
            ring = one[around[rows][:, table.points]]
            numbers.append(np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2))
        self.ends = np.concatenate(starts)
        self.leaf_of, self.law_of = np.concatenate(leaf_of), np.concatenate(law_of)
        number = np.concatenate([*numbers, flat])
        first, last = number.min(axis=1), number.max(axis=1)
        key = first.astype(np.int64) * len(points) + last
        sides, side = np.unique(key, return_inverse=True)
        n = len(self.ends)
        self.side, self.flat_side = side[:n], side[n:]
        self.shared = np.bincount(self.side, minlength=len(sides))
        turned = (number[:, 0] != first)[:n]
        order = np.where(turned[:, None], [[2, 3, 0, 1]], [[0, 1, 2, 3]])
        self.dofs = 4 * self.side[:, None] + order
        counts = [len(at) for at in numbers]
        parts = np.split(self.dofs, np.cumsum(counts)[:-1])
        widths = [12, *(4 * len(table.sides) for table, _ in self.whole)]
        # of each triangle in a cut leaf, then of each whole leaf, kind by kind
        self.untables = [at.reshape(-1, k) for at, k in zip(parts, widths, strict=True)]
        self.alone = self.shared[self.side] == 1
        total = np.bincount(self.side, self.law_of, len(sides))
        # sides with another law beyond them
        self.between = total[self.side] != self.shared[self.side] * self.law_of
        low, high = self.low[self.leaf_of], self.high[self.leaf_of]
        on = (self.ends == low[:, None]).all(axis=1) | (self.ends == high[:, None]).all(axis=1)
        self.on_square = on.any(axis=1)

    def settle(self, force: Floats, held: Flags) -> float:
        """Find the stress under moments ∫ t N of forces on sides; return the upper bound of work.

        `held` tells which components supports hold on each side, shape (sides, 2).
        """
        matrices = [self.cut.matrix, *(table.matrix for table, _ in self.whole)]
        blocks = [
            (np.broadcast_to(part, (len(at), *part.shape[-2:])), at)
            for part, at in zip(matrices, self.untables, strict=True)
        ]
        count = 4 * len(self.shared)
        load = np.bincount(self.dofs.ravel(), force.ravel(), count)
        fixed = np.zeros(count, dtype=np.bool_)
        fixed[self.dofs[held[:, [0, 1, 0, 1]]]] = True
        self._check_held(held, force)
        fixed |= self._idle | np.repeat(self.shared == 0, 4)
        cut, (_, dofs), *others = blocks
        plain, rows = self.whole[0]
        places = np.repeat(plain.sides.mean(axis=1), 4, axis=0)
        merged = MergedSquares(self.leaves.only(rows), plain.matrix, dofs, places)
        solved = joined([cut, *others], fixed, merged)
        self.patterns = self.cut.sagging.copy()
        area = (self.leaves.size * self.leaves.unit) ** 2
        self.whole_patterns = [area[at][:, None, None] * one.sagging for one, at in self.whole]
        moved = np.zeros(count)
        first = 0.0
        for _ in range(5):  # iterative refinement: the stress of the residual is added
            self.moments = self._add_stress_of(moved)
            borne = np.bincount(self.dofs.ravel(), self.moments.ravel(), count)
            left = np.where(fixed, 0.0, load - borne)
            first = first or float(np.abs(left).max())
            self.residual = float(np.abs(left).max()) / (first or 1.0)
            if self.residual < 1e-11:
                break
            moved = solved(left)
        return float(self.energies().sum())

    def _check_held(self, held: Flags, force: Floats) -> None:
        """Leave out parts that nothing holds and nothing loads; refuse those that could move."""
        n = len(self.shared)
        sides = [dofs[:, ::4] // 4 for dofs in self.untables]
        firsts = np.concatenate([np.repeat(at[:, 0], at.shape[1]) for at in sides])
        others = np.concatenate([at.ravel() for at in sides])
        graph = sp.csr_array((np.ones(len(firsts)), (firsts, others)), shape=(n, n))
        parts, label = connected_components(graph, directed=False)
        of = label[self.side]
        self._idle = np.zeros(4 * n, dtype=np.bool_)
        self.loose = np.zeros(len(self.leaves), dtype=np.bool_)
        for part in range(parts):
            if not (of == part).any():  # a side of what was left out
                continue
            at = np.flatnonzero((of == part) & held.any(axis=1))
            end, axis = np.nonzero(np.repeat(held[at], 2, axis=0))
            places = self.ends[at].reshape(-1, 2)[end]
            size = np.ptp(self.ends[of == part], axis=(0, 1)).max()
            motions = (
                rigid_motions((places - places.mean(axis=0)) / size, axis) if len(at) else None
            )
            if motions is not None and np.linalg.matrix_rank(motions, 1e-9) == 3:
                continue
            borne = force[of == part].any() or self.weight.any()
            if motions is None and not borne:
                self._idle[np.flatnonzero(np.repeat(label == part, 4))] = True
                self.loose[self.leaf_of[of == part]] = True
                continue
            raise LooseError

    def _add_stress_of(self, moved: Floats) -> Floats:
        """Add the stress by displacements of the sides; return the moments of all tractions."""
        local, *others = (moved[at] for at in self.untables)
        self.patterns += (self.cut.answer @ local[:, :, None])[:, :, 0]
        moments = [self.cut.tractions(self.patterns).reshape(-1, 4)]
        kinds = zip(self.whole, self.whole_patterns, others, strict=True)
        for (table, _), patterns, outer in kinds:
            patterns += np.tensordot(outer, table.answer, (1, 2))
            traction = np.einsum("tim,ntm->nti", table.triangles.moments[:, :4], patterns)
            moments.append(traction.reshape(-1, 4))
        return np.concatenate(moments)

    def energies(self) -> Floats:
        """Return ∫ σ S σ of each leaf."""
        out = np.zeros(len(self.leaves))
        np.add.at(out, self.owner, self.cut.energies(self.patterns))
        for (table, rows), patterns in zip(self.whole, self.whole_patterns, strict=True):
            strains = np.einsum("tkl,ntl->ntk", table.triangles.cost, patterns)
            out[rows] = np.einsum("ntk,ntk->n", patterns, strains)
        return out

    @cached_property
    def by_law(self) -> tuple[Floats, Floats, Floats]:
        """Of each law in each leaf the area, its middle, and the mean stress (xx, yy, xy).

        Of shape (laws, leaves), and with (2,) and (3,) after it; zeros where there is no area.
        """
        area = np.zeros((len(self.laws), len(self.leaves)))
        middle, stress = np.zeros((*area.shape, 2)), np.zeros((*area.shape, 3))
        at, part = (self.law, self.owner), self.cut.area[:, None]
        np.add.at(area, at, self.cut.area)
        np.add.at(middle, at, part * self.corners.mean(axis=1))
        np.add.at(stress, at, part * self.cut.means(self.patterns))
        shared = np.where(area > 0.0, area, 1.0)[:, :, None]
        middle, stress = middle / shared, stress / shared
        for (table, rows), patterns in zip(self.whole, self.whole_patterns, strict=True):
            law, each = self.laws.index(table.law), table.triangles
            size = self.leaves.size[rows] * self.leaves.unit
            area[law, rows] = size**2
            middle[law, rows] = self.low[rows] + 0.5 * size[:, None]
            shares = each.area[:, None, None] * each.mean
            stress[law, rows] = np.tensordot(patterns, shares, ((1, 2), (0, 2))) / size[:, None]
        return area, middle, stress

    @cached_property
    def mean_stress(self) -> Floats:
        """The mean stress (xx, yy, xy) of what each leaf holds, shape (n, 3)."""
        area, _, stress = self.by_law
        total = (area[:, :, None] * stress).sum(axis=0)
        area = area.sum(axis=0)
        return np.asarray(total / np.where(area > 0.0, area, 1.0)[:, None])


def _with_points_beside(
    ring: Corners, low: Sequence[float], high: Sequence[float], lines: Lines
) -> tuple[Point, ...]:
    """Return a closed line with the corners of others on the sides of its leaf."""
    out: list[Point] = []
    for first, last in zip(ring, [*ring[1:], ring[0]], strict=True):
        out.append(first)
        for axis in (0, 1):
            at = first[axis]
            if at != last[axis] or at not in (low[axis], high[axis]):
                continue
            start, end = sorted((first[1 - axis], last[1 - axis]))
            line = lines.get((axis, at), [])
            between: list[float] = []
            for value in line[bisect_right(line, start + NEAR) : bisect_left(line, end - NEAR)]:
                if not between or value - between[-1] > NEAR:
                    between.append(value)
            if first[1 - axis] > last[1 - axis]:
                between.reverse()
            out += [(at, value) if axis == 0 else (value, at) for value in between]
    return tuple(out)


@lru_cache(maxsize=10_000)
def _triangles_in(ring: tuple[Point, ...], edge: float) -> list[tuple[Point, Point, Point]]:
    """Return the triangles of a polygon in a leaf, none if it is too flat."""
    triangles, shape = triangles_of(ring)
    small = area_of(ring) < LEAST_AREA * edge**2
    return triangles if shape > (LEAST_AREA**1.5 if small else LEAST_SHAPE) else []
