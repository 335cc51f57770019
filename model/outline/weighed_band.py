"""The weight between curves and polygons: tractions on the polygons' sides, and bounds of the rest.

Over one side the band's points are J + s c + t d, where c runs along the side, d out of it, and
0 <= t <= δ(s), which is the curve. For a weight w = a c + b d the stress

    σ = a (δ - t) (c dᵀ + d cᵀ) + (b + a δ') (δ - t) d dᵀ

is in balance and leaves the curve free. Linear tractions replace those on the side, of the
same force and moment; the rest, which has neither, is borne near by.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.scene.curves import cross, parted

from .arc_triangles import ArcFrames, overlapping
from .balanced_pieces import BalancedPieces
from .fitted_displacement import FittedDisplacement
from .outline_problem import ON_BORDER, OutlineProblem, UnlikeError, place_on, within_array
from .true_shapes import ArcShape, TrueShape

SURE = 1e-10  # share of an integral along an arc by which rules of ten and eight points may differ
DEPTHS = 0.5 ** np.arange(1.0, 8.0)  # how deep what bears the rest may be, in sides
TOUCHING = -1e-9  # what overlaps by no more (in edges of the first agents) only touches


@dataclass(frozen=True, eq=False)
class BandParts:
    """Parts of the band between a polygon and its curve, each over one straight side."""

    start: Floats  # J, shape (n, 2)
    along: Floats  # c: from J to the end of the side, or of its part
    out: Floats  # d: such that δ is 1 at most
    integrals: Floats  # ∫ δ, ∫ s δ and ∫ δ² for s from 0 to 1, shape (n, 3)
    last: Floats  # δ at s = 1: 1 where another part begins that has the same d, else 0
    slope: Floats  # largest size of δ'

    @classmethod
    def of(cls, arcs: Floats, tangents: bool) -> BandParts:
        """Return the parts between arcs and their end tangents, or their chords."""
        frames = ArcFrames(arcs)
        if tangents:
            curve = parted(arcs, 0.5)
            curve[1::2] = curve[1::2, ::-1]
            start, middle = (curve[:, k, :2] / curve[:, k, 2:] for k in (0, 3))
            tip = np.repeat(frames.tip, 2, axis=0)
            along, out = tip - start, middle - tip
        else:
            curve, start = arcs, frames.start
            along = frames.end - frames.start
            out = frames.tip - 0.5 * (frames.start + frames.end)
        turned = np.linalg.inv(np.stack([along, out], axis=2))
        away = curve[..., :2] - start[:, None] * curve[..., 2:]
        local = np.concatenate([np.einsum("nij,nkj->nki", turned, away), curve[..., 2:]], axis=2)
        integrals, other = (_integrals(local, count) for count in (10, 8))
        if (np.abs(integrals - other) > SURE).any():
            raise UnlikeError("a curve too uneven has weight")
        slope = np.full(len(curve), 2.0)  # of a chord's curve, for its end tangents meet at d
        if tangents:
            s, t = (local[:, 3, :2] / local[:, 3, 2:] - local[:, 2, :2] / local[:, 2, 2:]).T
            slope = np.abs(t / s)
        return cls(start, along, out, integrals, np.full(len(curve), float(tangents)), slope)

    @classmethod
    def joined(cls, parts: list[BandParts]) -> BandParts:
        """Return the parts of several bands as one."""
        columns = zip(*(vars(one).values() for one in parts), strict=True)
        return cls(*map(np.concatenate, columns))

    @property
    def size(self) -> Floats:
        """Area of what c and d span."""
        return np.asarray(np.abs(cross(self.along, self.out)))

    def components(self, weight: Floats) -> Floats:
        """Return a and b of a weight, shape (2, n)."""
        axes = np.stack([self.along, self.out], axis=2)
        return np.asarray(np.linalg.solve(axes, weight[:, None])[..., 0].T)

    def lines(self, sides: Floats) -> tuple[Floats, Floats]:
        """Return at the ends of sides the linear functions that stand for δ and for δ δ'.

        They have the same integral and first moment along the whole side.
        """
        at, run = _along(self.start - sides[:, 0], sides), _along(self.along, sides)
        if (np.stack([at, at + run]).clip(-1e-6, 1.0 + 1e-6) != np.stack([at, at + run])).any():
            raise UnlikeError("a polygon with weight misses a curve")
        whole, first, second = self.integrals.T
        out = []
        for force, moment in ((whole, first), (self.last / 2.0, (self.last - second) / 2.0)):
            moment = at * force + run * moment
            out.append(np.stack([4.0 * force - 6.0 * moment, 6.0 * moment - 2.0 * force], axis=1))
        return out[0], out[1]

    def masses(self) -> tuple[Floats, Floats]:
        """Return areas, and their middles of shape (n, 2)."""
        area, first, second = self.integrals.T
        middle = self.start + (first / area)[:, None] * self.along
        return self.size * area, middle + (0.5 * second / area)[:, None] * self.out


class WeighedBand:
    """Forces on both polygons by the weight along the curves of a body, which meet no other.

    Raises UnlikeError if the polygons are not like the body yet, or have no room to bear the rest.
    """

    def __init__(self, problem: OutlineProblem, pieces: BalancedPieces):
        self.weight, self.pieces = problem.weight, pieces
        self.compliance = problem.softest.compliance
        self.extent = np.array(problem.shape, dtype=float)
        # moments of the tractions that are put on each of the sides of pieces
        self.force = np.zeros((len(pieces.ends), 2, 2))
        # bound of the energy (twice) of a stress that bears the rest, by leaf
        self.unborne = np.zeros(len(pieces.leaves))
        outer, inner, sides = [], [], []
        shapes = [line for one in problem.body.regions for line in _lines(one.shape, one.solid)]
        frames = [ArcFrames(shape.arcs) for shape, _ in shapes]
        for one, other in combinations(frames, 2):
            bends = one.turn.any() or other.turn.any()
            if bends and len(overlapping(one.triangles, other.triangles, 0.0)[0]):
                raise UnlikeError("a curve with weight is near to another outline")
        self._corners = np.concatenate([one.triangles for one in frames])
        for (shape, solid), known in zip(shapes, frames, strict=True):
            inside = ~self._beyond(known.triangles)
            if (inside[:, [0, 2]].all(axis=1) & ~inside[:, 1]).any():
                raise UnlikeError("a curve with weight is near to a side of the array")
            bent = inside.all(axis=1) & (known.turn != 0.0)
            border = within_array(shape.border(not solid), problem.shape)
            if not bent.any() or not len(rows := self._sides_on(border)):
                continue
            tangents = (known.turn > 0.0) != solid  # what the inner polygon takes
            for on_tangents in (True, False):
                arcs = shape.arcs[bent & (tangents == on_tangents)]
                if len(arcs):
                    inner.append(BandParts.of(arcs, on_tangents))
                    outer.append(BandParts.of(arcs, not on_tangents))
                    sides.append(self._hand(inner[-1], border, rows))
        self._outer = BandParts.joined(outer) if outer else None
        if outer:
            self._bound(BandParts.joined(inner), np.concatenate(sides))

    def _beyond(self, points: Floats) -> Flags:
        """Tell which points lie outside of the array."""
        return np.asarray(((points < TOUCHING) | (points > self.extent - TOUCHING)).any(axis=-1))

    def _sides_on(self, border: Floats) -> Ints:
        """Return the sides of pieces on a polygon: none where other regions cover it."""
        rows = np.flatnonzero(self.pieces.alone)
        rows = rows[place_on(self.pieces.ends[rows].mean(axis=1), border)[0] < ON_BORDER]
        found, whole = (_lengths(at).sum() for at in (self.pieces.ends[rows], border))
        if found and abs(found - whole) > 1e-7 * whole:
            raise UnlikeError("a polygon with weight is not all there")
        return rows

    def _hand(self, parts: BandParts, border: Floats, rows: Ints) -> Floats:
        """Put the weight of parts on the sides under them, and return these."""
        ends = np.cumsum(_lengths(border))
        away, at = place_on(parts.start + 0.5 * parts.along, border)
        if (away > ON_BORDER).any():
            raise UnlikeError("a polygon with weight misses a curve")
        number = np.searchsorted(ends, at)
        a, b = parts.size * parts.components(self.weight)
        plain, steep = parts.lines(border[number])
        total = np.zeros((len(border), 2, 2))
        along = (a * parts.integrals[:, 0])[:, None] * parts.along
        np.add.at(total, number, along[:, None])
        out = b[:, None] * plain + a[:, None] * steep
        np.add.at(total, number, out[:, :, None] * parts.out[:, None])
        side = np.searchsorted(ends, place_on(self.pieces.ends[rows].mean(axis=1), border)[1])
        x = _along(self.pieces.ends[rows] - border[side, :1], border[side])
        traction = total[side, :1] + x[:, :, None] * (total[side, 1:] - total[side, :1])
        share = np.abs(x[:, 1] - x[:, 0])[:, None, None] / 6.0
        self.force[rows] += share * (traction + traction.sum(axis=1)[:, None])
        return np.asarray(border[number])

    def _bound(self, parts: BandParts, sides: Floats) -> None:
        """Bound the energy of a stress that bears the band and what its sides do not take.

        What is left on a side are tractions ρ, without force and moment, along x from 0 to 1. An
        Airy function α(x) f(y/q) + β(x) q g(y/q) bears them, where q = 4 x (1 - x), α'' and β'
        are their parts along d and c, f = (1 - ζ)² (1 + 2 ζ), and g = ζ (1 - ζ)².
        """
        run, length, height = sides[:, 1] - sides[:, 0], _lengths(sides), np.hypot(*parts.out.T)
        inward = -parts.out / height[:, None]
        deep, bodies = self._room(sides, inward)
        spanned = deep * np.abs(cross(run, inward))
        a, b = np.abs(parts.components(self.weight))
        area, wide = parts.masses()[0], _lengths(np.stack([0.0 * run, parts.along], axis=1))
        stress = 2.0 * a * wide * height + (b + a * parts.slope) * height**2
        cost = stress**2 * area
        share, plain, steep = wide / length, *parts.lines(sides)
        over = np.abs(plain).max(axis=1), 1.0 / share - plain.min(axis=1)
        normal = b * np.maximum(*over) + a * (parts.slope / share + np.abs(steep).max(axis=1))
        normal *= parts.size * height / (deep * spanned)
        whole = parts.integrals[:, 0]
        shear = a * np.maximum(whole, 1.0 / share - whole) * parts.size * share / spanned
        rise = a * parts.slope / share * parts.size / spanned
        # |α''| <= N, |α'| <= N q / 2, |α| <= N q² / 8; |β'| <= S, |β| <= S q / 2
        stress = length**2 * (0.75 * normal + 2.0 * shear)
        stress += 2.0 * length * deep * (3.75 * normal + 5.0 * shear)
        stress += deep**2 * (16.6 * normal + 23.5 * shear + 0.15 * rise)
        first, _ = overlapping(bodies, bodies, TOUCHING)
        cost += np.bincount(first, minlength=len(sides)) * stress**2 * 2.0 / 3.0 * spanned
        scale = 1.0 / np.sqrt([1.0, 1.0, 2.0])
        law = self.compliance * np.outer(scale, scale)
        leaf = self.pieces.leaves.at(sides.mean(axis=1) + ON_BORDER * inward)
        cost *= float(np.linalg.eigvalsh(law).max())
        self.unborne += np.bincount(leaf, cost, len(self.unborne))

    def _room(self, sides: Floats, inward: Floats) -> tuple[Floats, Floats]:
        """Return depths of bodies on sides within the inner body, and triangles round these."""
        depth, length = np.zeros(len(sides), dtype=np.int64), _lengths(sides)
        while True:
            deep = DEPTHS[depth] * length
            tip = sides.mean(axis=1) + 2.0 * deep[:, None] * inward
            bodies = np.concatenate([sides, tip[:, None]], axis=1)
            tight = np.asarray(self._beyond(bodies).any(axis=1))
            tight[overlapping(bodies, self._corners, TOUCHING)[0]] = True
            if not tight.any():
                return deep, bodies
            depth += tight
            if depth.max() == len(DEPTHS):
                raise UnlikeError("there is no room to bear the weight beside a curve")

    def excess(self, field: FittedDisplacement) -> Floats:
        """Return the forces on corners of leaves by weight outside of the body, (nodes, 2)."""
        if self._outer is None:
            return np.zeros((field.nodes, 2))
        area, middle = self._outer.masses()
        leaf = field.leaves.at(middle)
        if (leaf < 0).any():
            raise UnlikeError("a curve with weight has no agents")
        return field.spread(leaf, middle, area[:, None] * self.weight)

    def unsure(self, field: FittedDisplacement) -> float:
        """Return by how much the work of the `excess` may be wrong.

        The displacement there is not linear, by what its gradients differ in agents near by.
        """
        if self._outer is None:
            return 0.0
        area, middle = self._outer.masses()
        moved = field.displacement[field.corner]
        edge = (field.leaves.size * field.leaves.unit)[:, None, None]
        slopes = np.stack([moved[:, [1, 2]] - moved[:, [0, 3]], moved[:, [3, 2]] - moved[:, :2]], 1)
        slopes /= edge[..., None]
        part = self._outer
        points = np.stack([part.start, part.start + part.along, middle], axis=1)
        points = np.concatenate([points, points[:, :2] + part.out[:, None]], axis=1)
        low, high = points.min(axis=1), points.max(axis=1)
        here = slopes[field.leaves.at(middle)].mean(axis=2, keepdims=True)
        apart = np.zeros((len(middle), 2))
        for share in np.stack(np.meshgrid(*2 * [np.linspace(0.0, 1.0, 6)]), -1).reshape(-1, 2):
            leaf = field.leaves.at(low + share * (high - low))
            off = np.sqrt(((slopes[leaf] - here) ** 2).sum(axis=3)).max(axis=2)
            apart = np.maximum(apart, np.where(leaf[:, None] < 0, 0.0, off))
        reach = np.hypot(*(high - low).T)
        return float(np.hypot(*self.weight) * (area * reach * np.hypot(*apart.T)).sum())


def _lines(shape: TrueShape, solid: bool) -> list[tuple[ArcShape, bool]]:
    """Return the closed lines of a shape, and whether each is filled."""
    if isinstance(shape, ArcShape):
        return [(shape, solid)]
    return [at for one in shape.regions for at in _lines(one.shape, one.solid == solid)]


def _lengths(sides: Floats) -> Floats:
    return np.asarray(np.hypot(*(sides[:, 1] - sides[:, 0]).T))


def _along(away: Floats, sides: Floats) -> Floats:
    """Return how far along sides vectors from their starts reach, 1 to their ends."""
    run = sides[:, 1] - sides[:, 0]
    return np.asarray(np.einsum("n...d,nd->n...", away, run).T / (run**2).sum(axis=1)).T


def _integrals(local: Floats, count: int) -> Floats:
    """Return ∫ t, ∫ s t and ∫ t² over s along curves of points (s, t), by Gauss's rule."""
    places, weights = np.polynomial.legendre.leggauss(count)
    u = 0.5 + 0.5 * places
    basis = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    rise = 3.0 * np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2], axis=1)
    s, t, w = np.moveaxis(basis @ local, -1, 0)
    ds, _, dw = np.moveaxis(rise @ np.diff(local, axis=1), -1, 0)
    s, t, run = s / w, t / w, 0.5 * weights * (ds - s / w * dw) / w
    return np.stack([(run * at).sum(axis=1) for at in (t, s * t, t**2)], axis=1)
