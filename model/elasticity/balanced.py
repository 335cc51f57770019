"""The stress that balances exactly: what the staggered equations say between the faces.

The equations of the staggered grid *are* the balance of a simple stress field. In every cell
let τ_ab be bilinear in a and b between its edges, and σ_aa vary along a only, so that it
balances them:

    σ_aa(X) = n − Σ_b (D_b X + D'_b X²/2) − f_a X

with n the traction on the lower face, D_b the difference of τ_ab along b there, D_b + D'_b that
on the upper face, and f the force in the cell. The tractions are

    n_lower, n_upper = σ_aa(centre) ± (½Σ_b D_b at that face + f_a/2)

and a face's equation says that its two cells agree on them. So no load is left over anywhere: the
field is statically admissible, and its complementary energy is never below the true energy.

At a re-entrant corner the operator's shear τ (half of what a whole corner would have) pulls the
faces beside it, while on the two free sides none may act. It goes through the two sides between
the three cells, 2τ on the halves next to the corner, and a linear normal traction on these sides
passes on the couple that this leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import AIR, RIGID

from .problem import ElasticProblem, FaceFields, Floats
from .staggered import Pair, cut, edge_modulus, strains, stresses

Index = NDArray[np.int64]

LEFT, RIGHT, BOTTOM, TOP = range(4)


class Law(NamedTuple):
    """C₁₁, C₁₂ and μ of cells, each an array of as many entries."""

    stretch: Floats
    lateral: Floats
    shear: Floats


@dataclass
class Polynomials:
    """Balanced stresses in boxes of unit size; the last axis of all arrays counts the boxes.

    Attributes
    ----------
    low : array, shape (d, n)
        Normal traction on the lower face along every axis.
    rise : dict from (a, b) to arrays, shape (2, n)
        Difference of τ_ab along b, at the lower and the upper end of a.
    shear : dict from pair to array, shape (2, 2, n)
        τ_ab at the ends of a and b.
    body : array, shape (d, n)
        Force within.
    """

    low: Floats
    rise: dict[Pair, Floats]
    shear: dict[Pair, Floats]
    body: Floats

    def slopes(self, axis: int) -> tuple[Floats, Floats]:
        """Return B and C of σ_aa = n + B X + C X²."""
        rises = [rise for (a, _), rise in self.rise.items() if a == axis]
        start = -sum(rise[0] for rise in rises) - self.body[axis]
        return start, -0.5 * sum(rise[1] - rise[0] for rise in rises)

    def mean_normal(self) -> Floats:
        """Return the mean normal stresses, shape (d, n)."""
        parts = []
        for axis, low in enumerate(self.low):
            b, c = self.slopes(axis)
            parts.append(low + b / 2 + c / 3)
        return np.stack(parts)

    def high(self, axis: int) -> Floats:
        """Return the normal traction on the upper faces along an axis."""
        b, c = self.slopes(axis)
        return np.asarray(self.low[axis] + b + c)

    def energy(self, law: Law) -> Floats:
        """Return the complementary energy of every box."""
        d = len(self.low)
        mean = self.mean_normal()
        squares = np.zeros_like(mean[0])
        for axis, a in enumerate(self.low):
            b, c = self.slopes(axis)
            squares += a * a + a * b + (b * b + 2 * a * c) / 3 + b * c / 2 + c * c / 5
        products = sum(mean[a] * mean[b] for a, b in combinations(range(d), 2))
        # s:C⁻¹:s for C₁₁ on the diagonal and C₁₂ off it.
        share = law.lateral / (law.stretch + (d - 1) * law.lateral)
        normal = (squares - share * (squares + 2 * products)) / (law.stretch - law.lateral)
        shear = sum(_square_mean(t) for t in self.shear.values()) / law.shear
        return np.asarray(0.5 * (normal + shear))


def _square_mean(t: Floats) -> Floats:
    """Return the mean square of functions that are bilinear between four corners."""
    (a, b), (c, e) = t
    own = a * a + b * b + c * c + e * e
    return np.asarray((own + a * b + c * e + a * c + b * e + 0.5 * (a * e + b * c)) / 9)


class BalancedStress:
    """The statically admissible stress field of an answer on equal cells.

    Parameters
    ----------
    problem : ElasticProblem
    u : tuple of arrays
        Face displacements that solve its equations, scaled.
    body : array, shape (dimension, cells)
        Force within every cell of material, scaled.

    Attributes
    ----------
    cells : int array, shape (cells, dimension)
        Cells of material, rim counted.
    law : Law
    plain : Polynomials
        The field in every cell (not to be taken for `ragged` ones).
    ragged : int array
        Which of the cells lie round a re-entrant corner: they are cut into four.
    parts : Polynomials
        The field in these quarters, four times as many as `ragged`, quarter by quarter.
    """

    def __init__(self, problem: ElasticProblem, u: FaceFields, body: Floats) -> None:
        d = problem.dimension
        self.problem, self.body = problem, body
        self.cells = np.argwhere(problem.kinds >= 0)
        kind = problem.kinds[tuple(self.cells.T)]
        moduli = problem.moduli
        self.law = Law(moduli.stretch[kind], moduli.lateral[kind], moduli.shear[kind])
        stress = stresses(problem, strains(u))
        corners = reentrant_corners(problem) if d == 2 else np.zeros((0, 2), dtype=np.int64)
        self._sigma = np.stack([s[tuple(self.cells.T)] for s in stress.cells])
        edges = {pair: tau.copy() for pair, tau in stress.edges.items()}
        bubble = edges[0, 1][tuple(corners.T)] if len(corners) else np.zeros(0)
        if len(corners):
            edges[0, 1][tuple(corners.T)] = 0.0
        shear = {pair: self._ends(tau, pair) for pair, tau in edges.items()}
        self.plain = self._between(shear)
        self.ragged, self.parts = self._quarters(corners, bubble)

    def _ends(self, tau: Floats, pair: Pair) -> Floats:
        """Return the shear at the four edges of every cell, shape (2, 2, cells)."""
        a, b = pair
        found = []
        for i in (0, 1):
            for j in (0, 1):
                at = self.cells.copy()
                at[:, a] += i
                at[:, b] += j
                found.append(tau[tuple(at.T)])
        return np.stack(found).reshape(2, 2, -1)

    def _between(self, shear: dict[Pair, Floats]) -> Polynomials:
        rise = {}
        for (a, b), t in shear.items():
            rise[a, b] = t[:, 1] - t[:, 0]
            rise[b, a] = t[1] - t[0]
        low = self._sigma + 0.5 * self.body
        for (axis, _), difference in rise.items():
            low[axis] += 0.5 * difference[0]
        return Polynomials(low, rise, shear, self.body)

    def _quarters(self, corners: Index, tau: Floats) -> tuple[Index, Polynomials]:
        """Return the cells round re-entrant corners, and the field in their quarters."""
        number = np.full(self.problem.kinds.shape, -1)
        number[tuple(self.cells.T)] = np.arange(len(self.cells))
        sides = np.zeros((len(self.cells), 4, 2))  # what goes through half a side, by the corners
        slope = np.zeros((len(self.cells), 4))  # upper half less lower half of a normal traction
        for (x, y), t in zip(corners, tau, strict=True):
            around = number[x - 1 : x + 1, y - 1 : y + 1]
            i, j = 1 - np.argwhere(around < 0)[0]  # of the cell opposite to the air
            own, along_y, along_x = around[i, j], around[i, 1 - j], around[1 - i, j]
            low_x, low_y = i == 0, j == 0
            for cell, side in (
                (own, TOP if low_y else BOTTOM),
                (along_y, BOTTOM if low_y else TOP),
            ):
                sides[cell, side, int(low_x)] += 2 * t
                slope[cell, side] -= 4 * t * (1 if low_y else -1)
            for cell, side in (
                (own, RIGHT if low_x else LEFT),
                (along_x, LEFT if low_x else RIGHT),
            ):
                sides[cell, side, int(low_y)] += 2 * t
                slope[cell, side] -= 4 * t * (1 if low_x else -1)
        ragged = np.flatnonzero(np.abs(slope).max(axis=1, initial=0.0) + np.abs(sides).sum((1, 2)))
        return ragged, self._cut(ragged, sides[ragged], slope[ragged])

    def _cut(self, cells: Index, through: Floats, slope: Floats) -> Polynomials:
        """Return the field in the quarters of cells.

        Tractions are even on half a side; the shear in the middles of sides and of the cell
        makes the quarters' moments balance.
        """
        n, body = len(cells), self.body[:, cells]
        if not n:
            return _no_polynomials()
        t = np.zeros((3, 3, n))
        t[::2, ::2] = self.plain.shear[0, 1][:, :, cells]
        left, right, bottom, top = t[0, ::2], t[2, ::2], t[::2, 0], t[::2, 2]
        halves = np.stack([left, right, bottom, top]) + through.transpose(1, 2, 0)
        middle = halves.mean(axis=1) + 0.5 * through.sum(axis=2).T
        t[0, 1], t[2, 1], t[1, 0], t[1, 2] = middle
        s = slope.T
        corners = t[::2, ::2].sum(axis=(0, 1))
        t[1, 1] = 0.25 * (
            2 * (s[RIGHT] - s[LEFT])
            + corners
            + 2 * (middle[TOP] + middle[BOTTOM] - middle[LEFT] - middle[RIGHT])
        )
        sigma = self._sigma[:, cells]
        low_x = sigma[0] + 0.5 * (halves[TOP, 0] - halves[BOTTOM, 0] + body[0])
        low_y = sigma[1] + 0.5 * (halves[RIGHT, 0] - halves[LEFT, 0] + body[1])
        return _quartered(t, low_x, low_y, s, 0.5 * body)

    def tractions(self) -> Floats:
        """Return the mean normal traction on the sides of all cells, shape (2 d, cells)."""
        found = []
        for axis in range(self.problem.dimension):
            low, high = self.plain.low[axis].copy(), self.plain.high(axis)
            if len(self.ragged):
                parts_low = self.parts.low[axis].reshape(2, 2, -1)
                parts_high = self.parts.high(axis).reshape(2, 2, -1)
                first = (0, slice(None)) if axis == 0 else (slice(None), 0)
                last = (1, slice(None)) if axis == 0 else (slice(None), 1)
                low[self.ragged] = parts_low[first].mean(axis=0)
                high[self.ragged] = parts_high[last].mean(axis=0)
            found += [low, high]
        return np.stack(found)

    def energies(self) -> Floats:
        """Return the complementary energy of every cell, scaled."""
        energy = self.plain.energy(self.law)
        if len(self.ragged):
            quarters = Law(*(np.tile(modulus[self.ragged], 4) for modulus in self.law))
            energy[self.ragged] = self.parts.energy(quarters).reshape(4, -1).sum(axis=0) / 4
        return energy

    def means(self) -> tuple[Floats, dict[Pair, Floats]]:
        """Return mean normal stresses, shape (d, cells), and mean shear stresses of the cells."""
        normal = self.plain.mean_normal()
        shear = {pair: t.mean(axis=(0, 1)) for pair, t in self.plain.shear.items()}
        if len(self.ragged):
            normal[:, self.ragged] = self.parts.mean_normal().reshape(2, 4, -1).mean(axis=1)
            quarter = self.parts.shear[0, 1].mean(axis=(0, 1))
            shear[0, 1][self.ragged] = quarter.reshape(4, -1).mean(axis=0)
        return normal, shear


def _quartered(t: Floats, low_x: Floats, low_y: Floats, slope: Floats, body: Floats) -> Polynomials:
    """Return the polynomials of four quarters from shears at 3 × 3 nodes and outer tractions."""
    shear = np.stack([t[i : i + 2, j : j + 2] for i in (0, 1) for j in (0, 1)], axis=2)
    rise = {(0, 1): shear[:, 1] - shear[:, 0], (1, 0): shear[1] - shear[0]}
    n = shear.shape[-1]
    x, y = np.zeros((2, 2, n)), np.zeros((2, 2, n))
    for half, sign in ((0, -0.5), (1, 0.5)):
        x[0, half] = low_x + sign * slope[LEFT]
        y[half, 0] = low_y + sign * slope[BOTTOM]
        x[1, half] = x[0, half] - rise[0, 1][:, half].mean(axis=0) - body[0]
        y[half, 1] = y[half, 0] - rise[1, 0][:, 2 * half].mean(axis=0) - body[1]
    low = np.stack([x.reshape(4, n), y.reshape(4, n)]).reshape(2, -1)
    flat = {key: value.reshape(2, -1) for key, value in rise.items()}
    return Polynomials(low, flat, {(0, 1): shear.reshape(2, 2, -1)}, np.tile(body, 4))


def _no_polynomials() -> Polynomials:
    empty = {(0, 1): np.zeros((2, 0)), (1, 0): np.zeros((2, 0))}
    return Polynomials(np.zeros((2, 0)), empty, {(0, 1): np.zeros((2, 2, 0))}, np.zeros((2, 0)))


def reentrant_edges(problem: ElasticProblem, pair: Pair) -> NDArray[np.bool_]:
    """Tell at which edges one of the four cells is air, the others are body, and shear acts."""
    kinds = problem.kinds
    width = [(1, 1) if axis in pair else (0, 0) for axis in range(kinds.ndim)]
    air = np.pad(kinds == AIR, width, constant_values=True)
    rigid = np.pad(kinds == RIGID, width)
    count = np.zeros(edge_modulus(problem, pair).shape, dtype=np.int8)
    walls = np.zeros_like(count)
    for first in (slice(None, -1), slice(1, None)):
        for second in (slice(None, -1), slice(1, None)):
            count += air[cut(kinds.ndim, pair[0], first)][cut(kinds.ndim, pair[1], second)]
            walls += rigid[cut(kinds.ndim, pair[0], first)][cut(kinds.ndim, pair[1], second)]
    return np.asarray((count == 1) & (walls == 0) & (edge_modulus(problem, pair) > 0))


def reentrant_corners(problem: ElasticProblem) -> Index:
    """Return the re-entrant corners of a plane body, shape (n, 2)."""
    return np.argwhere(reentrant_edges(problem, (0, 1)))
