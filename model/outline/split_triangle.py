"""Stresses in balance on triangles split in three from their middle, linear in each part.

The composite triangle of Johnson and Mercier (1978): whatever linear tractions on its sides
balance, there is one such stress. A linear map x = F x̂ takes the stress σ̂ of one triangle to
F σ̂ Fᵀ / det F of another, so that one table serves all of them; its divergence becomes
F div σ̂ / det F, so that two patterns more bear any weight.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from kaju.arrays import Floats

_SIDES = ((0, 1), (1, 2), (2, 0))


class BalancedPatterns(NamedTuple):
    """Of the triangle (0, 0), (1, 0), (0, 1)."""

    stress: Floats
    """Stress (xx, yy, xy) at the corners of the parts, a column for each pattern. (3, 3, 3, m).

    The last two bear a weight, 1 along each axis.
    """
    traction: Floats
    """Moments ∫ t N of the tractions at both ends of each side, shape (3, 2, 2, m)."""
    mass: Floats
    """∫ σ_a σ_b of all pairs of components and patterns, shape (3, 3, m, m)."""
    mean: Floats
    """Mean of the stress, shape (3, m)."""


@cache
def table() -> BalancedPatterns:
    """Return all stresses in balance, what they do on the sides, and what they cost."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    parts = np.array([[corners[a], corners[b], corners.mean(axis=0)] for a, b in _SIDES])
    unknown = np.eye(27).reshape(3, 3, 3, 27)  # part, corner, component
    rules = []
    for part, at in enumerate(parts):
        gradient = np.linalg.inv(np.column_stack([np.ones(3), at]))[1:]
        d = np.einsum("gk,kcu->gcu", gradient, unknown[part])
        rules += [d[0, 0] + d[1, 2], d[0, 2] + d[1, 1]]
    for part in range(3):  # corner 1 of a part is corner 0 of the next
        following = (part + 1) % 3
        run = parts[part][2] - parts[part][1]
        for one, other in ((1, 0), (2, 2)):
            jump = unknown[part, one] - unknown[following, other]
            rules += list(_traction(jump, np.array([run[1], -run[0]])))
    _, singular, patterns = np.linalg.svd(np.array(rules))
    rank = int((singular > 1e-12).sum())
    stress = patterns[rank:].T.reshape(3, 3, 3, -1)
    stress = np.concatenate([stress, _bearing(parts, np.eye(2))], axis=3)
    moments = []
    for part, (a, b) in enumerate(_SIDES):
        run = corners[b] - corners[a]
        ends = np.stack([_traction(stress[part, k], np.array([run[1], -run[0]])) for k in (0, 1)])
        moments.append(np.einsum("ij,jcm->icm", np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0, ends))
    square = (np.ones((3, 3)) + np.eye(3)) / 12.0 / 6.0  # of a part, whose area is 1/6
    mass = np.einsum("kl,pkam,plbn->abmn", square, stress, stress)
    return BalancedPatterns(stress, np.array(moments), mass, stress.mean(axis=(0, 1)))


def _bearing(parts: Floats, weights: Floats) -> Floats:
    """Return linear stresses that bear weights (columns), their mean none. Shape (3, 3, 3, m)."""
    away = parts - parts[:, 2:].mean(axis=(0, 1))
    normal = -away[..., None] * weights
    return np.concatenate([normal, np.zeros_like(normal[:, :, :1])], axis=2)


def _traction(stress: Floats, normal: Floats) -> Floats:
    """Return σ n of stresses (xx, yy, xy) in the first axis."""
    (x, y), (xx, yy, xy) = normal, stress
    return np.stack([xx * x + xy * y, xy * x + yy * y])


THIN = 0.03
"""Triangles flatter than this take patterns of their own."""


def shape_of(f: Floats) -> Floats:
    """Return 4 √3 area / Σ sides² of triangles with two sides as columns, 1 if all are alike."""
    squares = (f**2).sum(axis=(1, 2)) + ((f[:, :, 1] - f[:, :, 0]) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(12.0) * np.linalg.det(f) / squares)


class SplitTriangles:
    """Many triangles: what displacements of their sides make of tractions and stresses.

    Parameters
    ----------
    corners : array, shape (n, 3, 2)
        Counter-clockwise.
    compliance : array, shape (3, 3)
        Strain (xx, yy, 2 xy) of a stress, the same along all directions.
    weight : array, shape (2,)
        Force on a unit of area.
    """

    def __init__(self, corners: Floats, compliance: Floats, weight: Floats):
        known = table()
        f = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
        self.area = 0.5 * np.linalg.det(f)
        turned = _turned(f) / (2.0 * self.area[:, None, None])
        law = np.einsum("nai,ab,nbj->nij", turned, compliance, turned)
        self.cost = np.einsum("n,nij,ijkl->nkl", 2.0 * self.area, law, known.mass)
        self.moments = np.einsum("nij,sejm->nseim", f, known.traction).reshape(
            len(f), 12, known.traction.shape[-1]
        )
        self.mean = np.einsum("nij,jm->nim", turned, known.mean)
        for k in np.flatnonzero(shape_of(f) < THIN):
            at = tuple(corners[k].ravel().tolist()), tuple(compliance.ravel().tolist())
            self.cost[k], self.moments[k], self.mean[k] = _thin(*at)
        borne = 2.0 * self.area[:, None, None] * np.linalg.solve(f, weight[:, None])
        free = self.cost[:, :-2, :-2]
        answer = np.linalg.solve(free, self.moments[:, :, :-2].transpose(0, 2, 1))
        self.answer = np.pad(answer, ((0, 0), (0, 2), (0, 0)))
        self.matrix = self.moments @ self.answer
        sagging = -np.linalg.solve(free, self.cost[:, :-2, -2:] @ borne)
        self.sagging = np.concatenate([sagging, borne], axis=1)[:, :, 0]
        """Patterns under the weight where no side moves."""

    def tractions(self, patterns: Floats) -> Floats:
        """Return the moments of the tractions at the ends of the sides, shape (n, 12)."""
        return np.asarray(np.einsum("nim,nm->ni", self.moments, patterns))

    def energies(self, patterns: Floats) -> Floats:
        """Return ∫ σ S σ of each triangle."""
        return np.asarray(np.einsum("nk,nkl,nl->n", patterns, self.cost, patterns))

    def means(self, patterns: Floats) -> Floats:
        """Return the mean stress (xx, yy, xy) of each triangle, shape (n, 3)."""
        return np.asarray(np.einsum("nim,nm->ni", self.mean, patterns))


def _turned(f: Floats) -> Floats:
    """Return what takes (xx, yy, xy) of σ to that of F σ Fᵀ, shape (n, 3, 3)."""
    (a, b), (c, d) = f[:, 0].T, f[:, 1].T
    rows = [
        [a * a, b * b, 2 * a * b],
        [c * c, d * d, 2 * c * d],
        [a * c, b * d, a * d + b * c],
    ]
    return np.array(rows).transpose(2, 0, 1)


@lru_cache(maxsize=10_000)  # most triangles stay what they were when others are split
def _thin(places: tuple[float, ...], law: tuple[float, ...]) -> tuple[Floats, Floats, Floats]:
    """Return cost, moments and means of patterns that are orthonormal in this triangle.

    Those of the table become all but alike here. In the principal axes of the map their
    components are large, middling and small throughout, and elimination in that order, the
    largest patterns first, loses none of them (Cox and Higham 1998).
    """
    corners, compliance = np.array(places).reshape(3, 2), np.array(law).reshape(3, 3)
    f = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
    u, (long, short), v = np.linalg.svd(f)
    if np.linalg.det(u) < 0.0:
        u, v = u * [1.0, -1.0], v * [[1.0], [-1.0]]
    grades = np.array([1.0, (short / long) ** 2, short / long])
    aligned = np.einsum("ij,pkjm->pkim", _turned(v[None])[0], table().stress[..., :-2])
    half = np.linalg.cholesky((np.ones((3, 3)) + np.eye(3)) / 12.0)
    weights = np.array([1.0, 1.0, np.sqrt(2.0)])
    rows = np.einsum("lk,pkim,i->iplm", half.T, aligned, grades * weights)
    rows = rows[[0, 2, 1]].reshape(27, -1)
    basis = qr(rows, mode="economic", pivoting=True)[0].reshape(3, 3, 3, -1)[[0, 2, 1]]
    basis = basis / weights[:, None, None, None]
    nodal = np.einsum("kl,iplm->pkim", np.linalg.inv(half.T), basis)
    nodal = np.einsum("ij,pkjm->pkim", _turned(u[None])[0], nodal)
    area = 0.5 * np.linalg.det(f)
    middle = corners.mean(axis=0)
    parts = np.array([[corners[a], corners[b], middle] for a, b in _SIDES])
    nodal = np.concatenate([nodal, _bearing(parts, f / (2.0 * area))], axis=3)
    square = (np.ones((3, 3)) + np.eye(3)) / 12.0
    cost = area / 3.0 * np.einsum("pkim,kl,ij,pljn->mn", nodal, square, compliance, nodal)
    moments = []
    for part, (a, b) in enumerate(_SIDES):
        run = corners[b] - corners[a]
        ends = np.stack([_traction(nodal[part, k], np.array([run[1], -run[0]])) for k in (0, 1)])
        moments.append(np.einsum("ij,jcm->icm", np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0, ends))
    return cost, np.array(moments).reshape(12, -1), nodal.mean(axis=(0, 1))
