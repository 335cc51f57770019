"""Triangles that fill what leaves hold of a body, side to side, and where they end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.outline.leaf_triangles import Filled, named
from kaju.model.outline.posed_outlines import SIDES, OutlinedBody, UnlikeError
from kaju.model.outline.true_shapes import pieces_of

from .leaves import joined
from .sheets import Rim

FLAT = 0.03
"""Height of a triangle over its shortest side below which it is flat. Of random bodies 33, 39 and
166 had some of 1e-3 to 1e-7, with which their stress lost all digits."""
BESIDE = 0.1
"""The same of triangles beside straight edges of the border along an axis: of 40 plates pulled at a
side that rounds off 6 missed 0.05, as one flat triangle held both the side and the free edge."""
THIRDS = np.array([(0, 1), (1, 2), (2, 0)])  # corners at the ends of a triangle's sides


@dataclass(frozen=True, eq=False)
class CutMesh:
    """Triangles in leaves; the unknowns of both fields sit at their vertices and edges.

    A point in which parts of the body only touch is several vertices.
    """

    place: Floats  # of vertices, shape (n, 2)
    triangle: Ints  # vertices, counter-clockwise, shape (triangles, 3)
    leaf: Ints  # of each triangle
    law: Ints

    @property
    def around(self) -> Ints:
        """Vertices at both ends of the sides of triangles, counter-clockwise, (n, 3, 2)."""
        return self.triangle[:, THIRDS]

    @cached_property
    def _sides(self) -> tuple[Ints, Ints]:
        """Keys of edges, and the three edges of each triangle, (n, 3)."""
        both = np.sort(self.around, axis=2)
        keys = both[..., 0] * len(self.place) + both[..., 1]
        key, edge = np.unique(keys, return_inverse=True)
        return key, np.asarray(edge.reshape(-1, 3))

    @cached_property
    def ends(self) -> Ints:
        """Vertices of each edge, the smaller coordinate first, shape (edges, 2)."""
        return np.stack(np.divmod(self._sides[0], len(self.place)), axis=1)

    @property
    def edge(self) -> Ints:
        """Edges of triangles, the first between the first two vertices, shape (triangles, 3)."""
        return self._sides[1]

    @cached_property
    def beside(self) -> Ints:
        """Triangles on both sides of edges, -1 beyond the border, shape (edges, 2)."""
        found = np.full((len(self.ends), 2), -1)
        order = np.argsort(self.edge.ravel(), kind="stable")
        edge = self.edge.ravel()[order]
        found[edge, 1 * (np.diff(edge, prepend=-1) == 0)] = order // 3
        return found

    @cached_property
    def run(self) -> Floats:
        """From end to end of each edge."""
        return self.place[self.ends[:, 1]] - self.place[self.ends[:, 0]]

    @cached_property
    def normal(self) -> Floats:
        """Unit normals of edges, to the left of them."""
        across = np.stack([-self.run[:, 1], self.run[:, 0]], axis=1)
        return np.asarray(across / np.hypot(*self.run.T)[:, None])

    @cached_property
    def parts(self) -> Ints:
        """The part of the body that each vertex belongs to: triangles joined by vertices."""
        return joined(self.ends, len(self.place))

    def flipped(self) -> CutMesh:
        """Return the mesh, flat triangles parted across their longest side with those beyond it.

        On the border and between laws at the foot of their height. Stresses in flat triangles are
        so stiff that what is soft would drown in rounding.
        """
        flat, longest = self._flatness, self._legs.argmax(axis=1)
        beyond = self.beside[self.edge[np.arange(len(flat)), longest]].sum(axis=1)
        beyond -= np.arange(len(flat))  # -1 beyond the border
        ends, straight = self.beside[self.edge] < 0, (self.run[self.edge] == 0.0).any(axis=2)
        thin = np.where((ends.any(axis=2) & straight).any(axis=1), BESIDE, FLAT)
        rows = np.flatnonzero((flat < thin) & (beyond >= 0) & (self.law[beyond] == self.law))
        others = beyond[rows]
        a, b, tip = self.triangle[rows[:, None], (longest[rows, None] + np.arange(3)) % 3].T
        c = self.triangle[others].sum(axis=1) - a - b
        new = np.stack([a, c, tip, c, b, tip], axis=1).reshape(-1, 2, 3)
        least = replace(self, triangle=new.reshape(-1, 3))._flatness.reshape(-1, 2).min(axis=1)
        better = least > np.minimum(flat[rows], flat[others])
        known: set[int] = set()
        triangle, leaf = self.triangle.copy(), self.leaf.copy()
        for row, other, both in zip(rows[better], others[better], new[better], strict=True):
            if not {row, other} & known:
                triangle[[row, other]], leaf[row] = both, leaf[other]
                known |= {row, other}
        if known:
            return replace(self, triangle=triangle, leaf=leaf).flipped()
        rows = np.flatnonzero((flat < FLAT) & ((beyond < 0) | (self.law[beyond] != self.law)))
        return self._parted(rows, longest[rows]) if len(rows) else self

    def _parted(self, rows: Ints, longest: Ints) -> CutMesh:
        """Return the mesh, the longest sides of some triangles parted at the foot of the height."""
        edge, tip = self.edge[rows, longest], self.triangle[rows, longest - 1]
        sides, each = self.beside[edge], np.arange(len(edge))[:, None]
        last = np.full(len(self.triangle) + 1, -1)
        last[sides] = each  # a triangle is parted once
        chosen = ((sides < 0) | (last[sides] == each)).all(axis=1)
        edge, tip, sides = edge[chosen], tip[chosen], sides[chosen]
        start, run = self.place[self.ends[edge, 0]], self.run[edge]
        along = ((self.place[tip] - start) * run).sum(axis=1) / (run**2).sum(axis=1)
        part, side = np.nonzero(sides >= 0)
        of, foot = sides[part, side], len(self.place) + part
        at = (self.edge[of] == edge[part, None]).argmax(axis=1)
        a, b, c = self.triangle[of[:, None], (at[:, None] + np.arange(3)) % 3].T
        triangle, feet = self.triangle.copy(), start + along[:, None] * run
        triangle[of] = np.stack([a, foot, c], axis=1)
        triangle = np.concatenate([triangle, np.stack([foot, b, c], axis=1)])
        leaf, law = (np.append(one, one[of]) for one in (self.leaf, self.law))
        return CutMesh(np.concatenate([self.place, feet]), triangle, leaf, law)

    @cached_property
    def _legs(self) -> Floats:
        at = self.place[self.triangle]
        return np.asarray(np.hypot(*np.moveaxis(np.roll(at, -1, axis=1) - at, 2, 0)))

    @property
    def _flatness(self) -> Floats:
        """Height of triangles over their shortest side."""
        area = slopes(self.place[self.triangle])[1]
        square = self._legs.max(axis=1) * self._legs.min(axis=1)
        return np.asarray(2.0 * area / np.maximum(square, np.finfo(np.float64).tiny))

    def torn(self) -> CutMesh:
        """Return the mesh, vertices parted where only points of the body touch."""
        # triangles round a vertex hang together by the ends of edges that they share there
        slots = 3 * np.arange(len(self.triangle))[:, None, None] + THIRDS
        end = 2 * self.edge[..., None] + (self.around != self.ends[self.edge][..., :1])
        count = self.triangle.size
        pairs = np.stack([slots, count + end], axis=-1).reshape(-1, 2)
        label = joined(pairs, count + 2 * len(self.ends))
        corner = self.triangle.ravel()
        key = corner * len(label) + label[:count]
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        return replace(self, place=self.place[corner[first]], triangle=number.reshape(-1, 3))

    def holding(self, leaf: Ints, points: Floats, law: Ints | None = None) -> tuple[Ints, Floats]:
        """Return the triangle of a leaf that holds each point, or is nearest, and its shares.

        Of one law, if the leaf has any of this.
        """
        order = np.argsort(self.leaf, kind="stable")
        first, last = (np.searchsorted(self.leaf[order], leaf, side) for side in ("left", "right"))
        # All triangles of the leaf of each point, one point after the other.
        many = last - first
        end, point = np.cumsum(many), np.repeat(np.arange(len(leaf)), many)
        triangle = order[np.arange(len(point)) + np.repeat(last - end, many)]
        away = points[point] - self.place[self.triangle[triangle, 0]]
        slope = slopes(self.place[self.triangle])[0]
        share = np.einsum("ncd,nd->nc", slope[triangle], away)
        share[:, 0] += 1.0
        beyond = -share.min(axis=1)
        if law is not None:
            # Triangles of another law are farther than any of its own.
            beyond += 1e9 * (self.law[triangle] != law[point])
        least = np.flatnonzero(beyond == np.minimum.reduceat(beyond, end - many)[point])
        nearest = least[np.searchsorted(least, end - many)]
        share = np.maximum(share[nearest], 0.0)
        return triangle[nearest], share / share.sum(axis=1, keepdims=True)


def slopes(at: Floats) -> tuple[Floats, Floats]:
    """Return the slopes of the three linear functions on triangles, (n, 3, 2), and areas."""
    a, b, c = at[:, 0], at[:, 1], at[:, 2]
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    across = np.stack([c - b, a - c, b - a], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.stack([-across[..., 1], across[..., 0]], axis=2) / twice[:, None, None]
    return np.asarray(slope), np.asarray(0.5 * twice)


def mesh_of(filled: Filled) -> CutMesh:
    """Return the mesh of triangles that lie side to side."""
    names = named(filled.corners.reshape(-1, 2))
    _, first, number = np.unique(names, return_index=True, return_inverse=True)
    place = filled.corners.reshape(-1, 2)[first]
    return CutMesh(place, number.reshape(-1, 3), filled.leaf, filled.law).torn().flipped()


@dataclass(frozen=True, eq=False)
class Border:
    """Edges beyond which there is no body, and what is known there."""

    owner: Ints  # triangle that each is a side of
    side_of: Ints  # which of its sides it is
    edge: Ints
    ends: Ints  # vertices, the body to the left, shape (n, 2)
    at: Floats  # where these are, shape (n, 2, 2)
    given: Floats  # forces of the tractions, shape (n, 2)
    tilted: Floats  # by how much more tractions are at the end than in the middle, as forces
    held: Flags  # components of the displacement, shape (n, 2)
    side: Ints  # number of the array's side, -1 on an outline
    outline: Ints  # region whose outline it lies on, -1 for none
    pivot: Floats  # what a pinned outline turns about, NaN for others, shape (n, 2)
    shares: list[float]  # of edges in each load that is spread over some, in all

    @property
    def run(self) -> Floats:
        """From end to end of each edge."""
        return self.at[:, 1] - self.at[:, 0]

    @property
    def spots(self) -> Floats:
        """Where each edge bears forces: at its ends, and along a pin as if at its pivot."""
        pivot = self.pivot[:, None]
        return np.where(np.isfinite(pivot), pivot, self.at)

    @property
    def outward(self) -> Floats:
        """Outward normals, times the lengths of edges."""
        return np.stack([self.run[:, 1], -self.run[:, 0]], axis=1)

    @classmethod
    def of(cls, mesh: CutMesh, body: OutlinedBody, along: list[Floats]) -> Border:
        """Return the border of a mesh under the loads and supports of a body."""
        owner, side_of = np.nonzero(mesh.beside[mesh.edge, 1] < 0)
        edge, ends = mesh.edge[owner, side_of], mesh.around[owner, side_of]
        at = mesh.place[ends]
        run = at[:, 1] - at[:, 0]
        length = np.hypot(*run.T)
        given, tilted = np.zeros((2, len(edge), 2))
        held = np.zeros((len(edge), 2), dtype=np.bool_)
        side, outline = np.full((2, len(edge)), -1)
        there = ~body.left_at(at.mean(axis=1))
        for number, (name, (axis, upper)) in enumerate(SIDES.items()):
            on = there & (at[:, :, axis] == (body.shape[axis] if upper else 0.0)).all(axis=1)
            side[on] = number
            held[np.ix_(on, body.held.get(name, ()))] = True
            for region, line in enumerate(along):  # outlines may run along sides, too
                its = line[(line[..., axis] == body.shape[axis] * upper).all(axis=1), :, 1 - axis]
                (low, high), middle = np.sort(its, axis=1).T, at[on, :, 1 - axis].mean(axis=1)
                within = (low < middle[:, None]) & (middle[:, None] < high)
                outline[on] = np.where(within.any(axis=1), region, outline[on])
        rest = np.flatnonzero(side < 0)
        outline[rest] = _outline_of(at[rest], along)
        held[np.isin(outline, [*body.rigid])] = True
        outward, shares = np.stack([run[:, 1], -run[:, 0]], axis=1), []
        for one in body.loads:
            share = np.where(held.any(axis=1), 0.0, one.shares(at, outline, side))
            if not share.any():
                reach = ", ".join(f"{x:.3g}" for x in body.edge * at.max(axis=(0, 1)))
                raise UnlikeError(f"{one.told}; the body ends at ({reach}) m")
            on, (pressure, slope, couple) = share > 0.0, one.bent
            shares.append(float(share.sum()))
            given += share[:, None] / shares[-1] * one.force
            given[on] -= pressure * outward[on]
            if slope or couple:
                axis, upper = divmod(one.sides[0], 2)
                pull = _bent(at[on, :, 1 - axis], length[on], couple) * (1 if axis else -1)
                pull += (1 - 2 * upper) * slope * at[on, :, 1 - axis]
                given[on, axis] += length[on] * pull.mean(axis=1)
                tilted[on, axis] += length[on] * 0.5 * (pull[:, 1] - pull[:, 0])
        known = given, tilted, held, side, outline, body.pivots[outline], shares
        return cls(owner, side_of, edge, ends, at, *known)

    def rim(self, mesh: CutMesh, weight: Floats) -> Rim:
        """Return how φ and its slopes grow along the border."""
        # tractions that φ makes good: those asked for less those of what bears the weight
        load = self.given[:, None] + self.at * weight * self.outward[:, None]
        load += (np.array([-1.0, 1.0])[:, None, None] * self.tilted).swapaxes(0, 1)
        turn = np.stack([-load[..., 1], load[..., 0]], axis=2)
        slope, bulge = turn.mean(axis=1), (turn[:, 0] - turn[:, 1]) / 8.0
        rise = ((0.5 * slope + bulge * (2.0 / 3.0)) * self.run).sum(axis=1)
        across = (bulge * mesh.normal[self.edge]).sum(axis=1)
        growth = np.column_stack([rise, slope])
        sides = THIRDS[self.side_of]
        return Rim(self.owner, sides, self.edge, ~self.held, growth, across, self.pivot)

    def forces(self, mesh: CutMesh) -> Floats:
        """Return the work of the tractions on the unknowns of a displacement."""
        out = np.zeros((len(mesh.place) + len(mesh.ends), 2))
        for k in (0, 1):
            np.add.at(out, self.ends[:, k], 0.5 * self.given + (2 * k - 1) / 6.0 * self.tilted)
        out[len(mesh.place) + self.edge] += self.given * (2.0 / 3.0)
        return out


def _bent(at: Floats, length: Floats, couple: float) -> Floats:
    """Return the stresses of a couple at ends of edges, (n, 2), linear along a side."""
    middle = at.mean(axis=1)
    off = middle - (length * middle).sum() / length.sum()
    inertia = (length * (off**2 + length**2 / 12.0)).sum()
    return np.asarray(couple / inertia * (at - middle[:, None] + off[:, None]))


def _outline_of(at: Floats, along: list[Floats]) -> Ints:
    """Return the region on whose outline edges lie, by the straight pieces of each; -1 for none."""
    outline = np.full(len(at), -1)
    for region, line in enumerate(along):
        outline[pieces_of(line, at)[0] >= 0] = region
    # Others are halves of these, or stand for slivers left out: the nearest line is theirs.
    rest = np.flatnonzero(outline < 0)
    middle, least = at[rest].mean(axis=1), np.full(len(rest), np.inf)
    for region, line in enumerate(along):
        run, away = line[:, 1] - line[:, 0], middle[:, None] - line[:, 0]
        share = np.clip((away * run).sum(axis=2) / (run**2).sum(axis=1), 0.0, 1.0)
        off = np.hypot(*np.moveaxis(away - share[..., None] * run, 2, 0)).min(1, initial=np.inf)
        outline[rest[off <= least]] = region
        least = np.minimum(least, off)
    return outline
