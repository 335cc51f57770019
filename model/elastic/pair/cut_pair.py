"""Both opinions of agents that outlines cut, and what they prove.

One displacement fits, on a body slightly too large; one stress balances, within a body slightly too
small. Prager and Synge's circle holds with what lies between both bodies.
"""

from __future__ import annotations

from functools import cached_property
from math import inf

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SupportError
from kaju.model.elastic.free_motion import free_motion
from kaju.model.outline.leaf_polygons import leaf_polygons
from kaju.model.outline.posed_outlines import OutlineProblem, UnlikeError
from kaju.model.outline.true_shapes import UNIT, covering

from .cut_border import Border
from .cut_elements import slopes
from .cut_fields import Balancing, CutFitting
from .cut_mesh import CutMesh, mesh_of, squares_to_cut, with_squares
from .elements import airy_stress, quadratic_values, rule, strain_rows, strains, stresses
from .gap import FAR, Bounds
from .leaves import LeafCells

OTHER = 1e9  # shares by which triangles of another law are farther


def loose_parts(mesh: CutMesh, border: Border, weight: Floats) -> Flags:
    """Return which parts of the body nothing holds and nothing loads.

    Raises
    ------
    SupportError
        If one that is loaded could move without straining.
    """
    part, count = mesh.parts, int(mesh.parts.max()) + 1
    loose = np.zeros(count, dtype=np.bool_)
    own = part[border.ends[:, 0]]
    held = border.held.any(axis=1)
    for number in range(count):
        rows = np.flatnonzero((own == number) & held)
        at = mesh.place[border.ends[rows]]
        at = at - at.mean(axis=(0, 1)) if len(rows) else at
        stops = np.zeros((len(rows), 2, 2, 3))  # edge, end, component, motion
        stops[..., 0, 0] = stops[..., 1, 1] = 1.0
        stops[..., 0, 2], stops[..., 1, 2] = -at[..., 1], at[..., 0]
        held_ones = np.broadcast_to(border.held[rows, None], (len(rows), 2, 2))
        if free_motion(stops[held_ones], 2):
            loose[number] = True
            if weight.any() or border.traction[own == number].any():
                raise SupportError(
                    "sides: the body, or a part of it that is loaded, could move without "
                    'straining; hold it by [sides] such as left = "rigid"'
                )
    return loose


class CutPair:
    """Both fields on leaves, and what each leaf adds to their gap."""

    def __init__(self, problem: OutlineProblem, leaves: LeafCells):
        every = covering(leaves, problem.shape)
        problem.body.refine(every)
        at = every.find(leaves.lower)
        held = np.isin(np.arange(len(every)), at)
        polygons = [leaf_polygons(problem.body, every, held, most) for most in (True, False)]
        # agents that hold nothing of the body are none
        filled = polygons[0][1] >= 0
        filled[polygons[0][2].place] = True
        leaves = leaves.only(filled[at])
        at = at[filled[at]]
        row = np.full(len(every), -1)
        row[at] = np.arange(len(at))
        parts = [
            (whole[at], kept.with_law(row[kept.place], kept.law))
            for _, whole, rings, _ in polygons
            for kept in (rings.only(row[rings.place] >= 0),)
        ]
        laws, others, within = polygons[0][0], polygons[1][0], polygons[1][3]
        self.problem, self.leaves = problem, leaves
        chosen = np.empty(0, dtype=np.int64)
        for whole, rings in parts:
            chosen = np.union1d(chosen, squares_to_cut(whole, rings, leaves))
        while True:
            meshes = []
            for whole, rings in parts:
                mine = chosen[whole[chosen] >= 0]
                rings = with_squares(rings, mine, whole, leaves)
                rest = whole.copy()
                rest[mine] = -1
                meshes.append(mesh_of(rest, rings, leaves))
            more = np.concatenate([mesh.pinned for mesh in meshes])
            if not len(more):
                break
            chosen = np.union1d(chosen, more)
        n, size = len(leaves), np.asarray(leaves.size * UNIT, dtype=np.float64)
        if not len(meshes[1].place):
            raise UnlikeError("they leave nothing of the body")
        edges = [
            Border.of(meshes[0], problem, polygons[0][3]),
            Border.of(meshes[1], problem, within),
        ]
        loose = loose_parts(meshes[0], edges[0], problem.weight)
        self.loose = int(loose.sum())
        """Parts of the body that hang on nothing, and bear nothing."""
        self.fitting = CutFitting(meshes[0], edges[0], laws, problem.weight, size, loose)
        self.balancing = Balancing(meshes[1], edges[1], others, problem.weight, size)
        self.borders = edges[0], edges[1]
        self.laws, self.along = (laws, others), within
        self.area = np.stack([_areas(mesh, leaves) for mesh in meshes])
        fitted, balanced = self.fitting.energies(n), self.balancing.energies(n)
        between = np.maximum(self.area[0] - self.area[1], 0.0)
        band = problem.band * between
        if problem.estimated:  # the weight there counts as its share of all
            band = band + between / self.area[1].sum() * balanced.sum()
        self.shares = np.maximum(fitted + balanced - 2.0 * self._crossed() + 2.0 * band, 0.0)
        self.energies = 0.25 * (fitted + balanced)
        """Of each leaf, half-way between those of both fields."""
        self.lower = 2.0 * self.fitting.work - float(fitted.sum()) - float(band.sum())
        self.upper = float(balanced.sum()) + float(band.sum())

    @cached_property
    def bounds(self) -> Bounds:
        """What both energies prove, as far apart as rounding may take them."""
        rounding = self.problem.rounding
        lower, upper = self.lower * (1.0 - rounding), self.upper * (1.0 + rounding)
        # the gap counts as both energies have it, or as its shares add up, should that be more
        gap = max(upper - lower, float(self.shares.sum()))
        error = 0.5 * (gap / lower) ** 0.5 if lower > 0.0 else inf
        # of energies far apart that which fits is the better one
        energy = 0.5 * lower if upper > FAR * lower > 0.0 else 0.25 * (lower + upper)
        return Bounds(0.5 * lower, 0.5 * upper, error, False, energy)

    def _crossed(self) -> Floats:
        """Return ∫ σ : ε of each leaf, nearly so where the triangles of both fields differ."""
        own, n = self.balancing, len(self.leaves)
        moved = self.fitting.square[self._squares[0][own.mesh.square_leaf]]
        crossed = np.einsum("q,qai,qaj->ij", rule()[1], stresses(), strains())
        work = np.einsum("ni,ij,nj->n", own.square, crossed, moved) / own.size
        out = np.zeros(n)
        out += np.bincount(own.mesh.square_leaf, work, n)
        if own.weight.any() and len(own.mesh.square):
            low = own.mesh.place[own.mesh.square[:, 0]]
            points = low[:, None] + own.size[:, None, None] * rule()[0]
            strain = np.einsum("qai,ni->nqa", strains(), moved)
            work = np.einsum("q,nqa,nqa->n", rule()[1], own.bearing(points), strain)
            out += np.bincount(own.mesh.square_leaf, work * own.size, n)
        if len(own.mesh.triangle):
            # three points within each third, off the edges of triangles
            points = 0.5 * (own.corners + own.corners.mean(axis=2, keepdims=True))
            stress = np.einsum("nkcai,ni->nkca", own.rows, own.triangle)
            stress = 0.5 * (stress + stress.mean(axis=2, keepdims=True)) + own.bearing(points)
            leaf, law = (
                np.repeat(one, 9) for one in (own.mesh.triangle_leaf, own.mesh.triangle_law)
            )
            strain = self.strain_at(leaf, points.reshape(-1, 2), law)
            work = (stress.reshape(-1, 3) * strain).sum(axis=1) * np.repeat(own.third / 3.0, 9)
            out += np.bincount(leaf, work, n)
        return out

    def displacement_at(self, leaf: Ints, points: Floats) -> Floats:
        """Return the displacement at points of leaves, (n, 2); beyond the body that beside it."""
        fit, out = self.fitting, np.zeros((len(points), 2))
        whole, local, number = self._within(0, leaf, points)
        moved = fit.square[number].reshape(-1, 8, 2)
        out[whole] = np.einsum("nk,nkd->nd", quadratic_values(local), moved)
        cut = np.flatnonzero(~whole)
        triangle, share = self.holding(0, leaf[cut], points[cut])
        bulges = 4.0 * share * np.roll(share, -1, axis=1)
        values = np.concatenate([share, bulges], axis=1)
        moved = fit.triangle[triangle].reshape(-1, 6, 2)
        out[cut] = np.einsum("nk,nkd->nd", values, moved)
        return out

    def strain_at(self, leaf: Ints, points: Floats, law: Ints | None = None) -> Floats:
        """Return the strain (xx, yy, 2 xy) of the displacement at points of leaves, (n, 3).

        On or beside an outline that in what is of one law.
        """
        fit, out = self.fitting, np.zeros((len(points), 3))
        whole, local, number = self._within(0, leaf, points)
        size = (self.leaves.size * UNIT)[leaf[whole]]
        out[whole] = np.einsum("nai,ni->na", strain_rows(local), fit.square[number]) / size[:, None]
        cut = np.flatnonzero(~whole)
        triangle, share = self.holding(0, leaf[cut], points[cut], None if law is None else law[cut])
        rows = np.einsum("ncai,ni->nca", fit.strain[triangle], fit.triangle[triangle])
        out[cut] = np.einsum("nc,nca->na", share, rows)
        return out

    def stress_at(self, leaf: Ints, points: Floats, law: Ints) -> Floats:
        """Return the stress (xx, yy, xy) that balances at points of leaves, (n, 3); else NaN."""
        own, out = self.balancing, np.full((len(points), 3), np.nan)
        whole, local, number = self._within(1, leaf, points)
        size = own.size[number]
        out[whole] = np.einsum("nai,ni->na", airy_stress(local), own.square[number])
        out[whole] /= size[:, None] ** 2
        cut = np.flatnonzero(~whole & np.isin(leaf, own.mesh.triangle_leaf))
        triangle, share = self.holding(1, leaf[cut], points[cut], law[cut])
        # the third that lies along the edge away from the least share
        least = share.argmin(axis=1)
        third = (least + 1) % 3
        rows = np.arange(len(cut))
        of = np.stack(
            [share[rows, third], share[rows, (third + 1) % 3], 3.0 * share[rows, least]], 1
        )
        of[:, :2] -= share[rows, least, None]
        stress = np.einsum("ncai,ni->nca", own.rows[triangle, third], own.triangle[triangle])
        out[cut] = np.einsum("nc,nca->na", of, stress)
        return np.asarray(out + own.bearing(points))

    @cached_property
    def means(self) -> tuple[Floats, Floats]:
        """Means (xx, yy, xy) over what leaves hold: of the stress that balances, and that fits."""
        own, fit, n = self.balancing, self.fitting, len(self.leaves)
        balanced, fitted = np.zeros((n, 3)), np.zeros((n, 3))
        rows = np.einsum("q,qai->ai", rule()[1], stresses())
        size = own.size[:, None]
        low = own.mesh.place[own.mesh.square[:, 0]]
        balanced[own.mesh.square_leaf] = own.square @ rows.T
        balanced[own.mesh.square_leaf] += size**2 * own.bearing(low + 0.5 * size)
        stress = np.einsum("nkcai,ni->nka", own.rows, own.triangle) / 3.0
        stress += own.bearing(own.corners.mean(axis=2))
        np.add.at(balanced, own.mesh.triangle_leaf, own.third[:, None] * stress.sum(axis=1))
        stiffness = np.array([law.stiffness for law in self.laws[0]])
        strain = fit.square @ np.einsum("q,qai->ai", rule()[1], strains()).T
        edge = np.asarray(self.leaves.size * UNIT)[fit.mesh.square_leaf, None]
        fitted[fit.mesh.square_leaf] = edge * np.einsum(
            "nab,nb->na", stiffness[fit.mesh.square_law], strain
        )
        strain = np.einsum("ncai,ni->na", fit.strain, fit.triangle) * fit.area[:, None] / 3.0
        strain = np.einsum("nab,nb->na", stiffness[fit.mesh.triangle_law], strain)
        np.add.at(fitted, fit.mesh.triangle_leaf, strain)
        fitted /= self.area[0][:, None]
        some = self.area[1][:, None] > 0.0  # else nothing balances there
        return np.where(some, balanced / np.where(some, self.area[1][:, None], 1.0), fitted), fitted

    @cached_property
    def _squares(self) -> tuple[Ints, Ints]:
        """Of each leaf its square in either mesh, -1 for none."""
        found = []
        for mesh in (self.fitting.mesh, self.balancing.mesh):
            number = np.full(len(self.leaves), -1)
            number[mesh.square_leaf] = np.arange(len(mesh.square_leaf))
            found.append(number)
        return found[0], found[1]

    def _within(self, field: int, leaf: Ints, points: Floats) -> tuple[Flags, Floats, Ints]:
        """Return which points lie in squares, where in them, from 0 to 1, and in which."""
        number = self._squares[field][leaf]
        whole = number >= 0
        size = (self.leaves.size * UNIT)[leaf[whole]]
        local = (points[whole] - self.leaves.lower[leaf[whole]] * UNIT) / size[:, None]
        return whole, np.clip(local, 0.0, 1.0), number[whole]

    @cached_property
    def _triangles(self) -> list[tuple[Floats, Ints]]:
        """The slopes of the shares in triangles of either mesh, and their order by leaves."""
        return [
            (slopes(mesh.place[mesh.triangle])[0], np.argsort(mesh.triangle_leaf, kind="stable"))
            for mesh in (self.fitting.mesh, self.balancing.mesh)
        ]

    def holding(
        self, field: int, leaf: Ints, points: Floats, law: Ints | None = None
    ) -> tuple[Ints, Floats]:
        """Return the triangle of a cut leaf that holds each point, or is nearest, and its shares.

        Of one law, if the leaf has any of this.
        """
        mesh, (slope, order) = (
            (self.fitting.mesh, self.balancing.mesh)[field],
            self._triangles[field],
        )
        # laws of either field are the same up to those of materials mixed
        first = np.searchsorted(mesh.triangle_leaf[order], leaf)
        count = np.searchsorted(mesh.triangle_leaf[order], leaf, "right") - first
        best, found = np.full(len(leaf), -inf), np.zeros(len(leaf), dtype=np.int64)
        share = np.zeros((len(leaf), 3))
        for k in range(int(count.max(initial=0))):
            at = np.flatnonzero(count > k)
            triangle = order[first[at] + k]
            away = points[at] - mesh.place[mesh.triangle[triangle, 0]]
            own = np.einsum("ncd,nd->nc", slope[triangle], away)
            own[:, 0] += 1.0
            held = own.min(axis=1)
            if law is not None:
                held = held - OTHER * (mesh.triangle_law[triangle] != law[at])
            better = held > best[at]
            at, triangle, own = at[better], triangle[better], own[better]
            best[at], found[at], share[at] = held[better], triangle, own
        share = np.maximum(share, 0.0)
        return found, share / np.maximum(share.sum(axis=1, keepdims=True), 1e-300)


def _areas(mesh: CutMesh, leaves: LeafCells) -> Floats:
    """Return the area of what each leaf holds."""
    out = np.zeros(len(leaves))
    out[mesh.square_leaf] = (leaves.size[mesh.square_leaf] * UNIT) ** 2
    return out + np.bincount(mesh.triangle_leaf, slopes(mesh.place[mesh.triangle])[1], len(leaves))
