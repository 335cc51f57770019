"""Stresses in balance on triangles split in three from their middle, linear in each part.

The composite triangle of Johnson and Mercier (1978): whatever linear tractions on its sides
balance, there is one such stress. A linear map x = F x̂ takes the stress σ̂ of one triangle to
F σ̂ Fᵀ / det F of another, so that one table serves all of them; its divergence becomes
F div σ̂ / det F, so that two patterns more bear any weight.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from kaju.arrays import Floats

# ∫ a b of linear a and b over a triangle of area 1, by their values at its corners
_SQUARE = (np.ones((3, 3)) + np.eye(3)) / 12.0


class BalancedPatterns(NamedTuple):
    """Of the triangle (0, 0), (1, 0), (0, 1)."""

    # (xx, yy, xy) at the corners of the parts, a column for each pattern, shape (3, 3, 3, m); the
    # last two bear a weight of 1 along each axis
    stress: Floats
    traction: Floats  # moments ∫ t N of the tractions at both ends of each side, shape (3, 2, 2, m)
    mass: Floats  # ∫ σ_a σ_b of all pairs of components and patterns, shape (3, 3, m, m)
    mean: Floats  # mean of the stress, shape (3, m)


@cache
def table() -> BalancedPatterns:
    """Return a basis of the stresses in balance on the reference triangle."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    parts = _parts(corners)
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
            rules += list(_traction(jump, run))
    _, singular, patterns = np.linalg.svd(np.array(rules))
    rank = int((singular > 1e-12).sum())
    stress = patterns[rank:].T.reshape(3, 3, 3, -1)
    stress = np.concatenate([stress, _bearing(parts, np.eye(2))], axis=3)
    mass = np.einsum("kl,pkam,plbn->abmn", _SQUARE / 6.0, stress, stress)  # a part's area is 1/6
    return BalancedPatterns(stress, _moments(stress, corners), mass, stress.mean(axis=(0, 1)))


def _parts(corners: Floats) -> Floats:
    """Return the corners of the three parts of triangles, shape (..., 3, 3, 2)."""
    middle = np.broadcast_to(corners.mean(axis=-2, keepdims=True), corners.shape)
    return np.stack([corners, np.roll(corners, -1, axis=-2), middle], axis=-2)


def _bearing(parts: Floats, weights: Floats) -> Floats:
    """Return linear stresses that bear weights (columns), their mean none. (..., 3, 3, 3, m)."""
    away = parts - parts[..., 2:, :]
    normal = -away[..., None] * weights
    return np.concatenate([normal, np.zeros_like(normal[..., :1, :])], axis=-2)


def _traction(stress: Floats, run: Floats) -> Floats:
    """Return the tractions of stresses (xx, yy, xy; last axis but one) on the right of lines."""
    x, y = run[..., 1, None], -run[..., 0, None]
    xx, yy, xy = np.moveaxis(stress, -2, 0)
    return np.stack([xx * x + xy * y, xy * x + yy * y], axis=-2)


def _moments(stress: Floats, corners: Floats) -> Floats:
    """Return the moments ∫ t N of the tractions at both ends of each side, (..., 3, 2, 2, m)."""
    run = np.roll(corners, -1, axis=-2) - corners
    ends = _traction(stress[..., :2, :, :], run[..., None, :])
    shares = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
    return np.asarray(np.einsum("ij,...jcm->...icm", shares, ends))


THIN = 0.03  # triangles flatter than this take patterns of their own


def shape_of(f: Floats) -> Floats:
    """Return 4 √3 area / Σ sides² of triangles with two sides as columns, 1 if all are alike."""
    squares = (f**2).sum(axis=(1, 2)) + ((f[:, :, 1] - f[:, :, 0]) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(12.0) * np.linalg.det(f) / squares)


class SplitTriangles:
    """Triangles, counter-clockwise: tractions and stresses by displacements of their sides.

    The compliance, one or one each, gives strain (xx, yy, 2 xy) by an isotropic law; the weight is
    a force on a unit of area.
    """

    def __init__(self, corners: Floats, compliance: Floats, weight: Floats):
        reference = table()
        f = _map(corners)
        self.area = 0.5 * np.linalg.det(f)
        turned = _turned(f) / (2.0 * self.area[:, None, None])
        compliance = np.broadcast_to(compliance, (len(f), 3, 3))
        law = 2.0 * self.area[:, None, None] * (turned.transpose(0, 2, 1) @ compliance @ turned)
        self.cost = np.tensordot(law, reference.mass, 2)
        self.moments = np.einsum("nij,sejm->nseim", f, reference.traction).reshape(
            len(f), 12, reference.traction.shape[-1]
        )
        self.mean = np.einsum("nij,jm->nim", turned, reference.mean)
        thin = shape_of(f) < THIN
        if thin.any():
            flat = _thin(corners[thin], compliance[thin])
            self.cost[thin], self.moments[thin], self.mean[thin] = flat
        borne = 2.0 * self.area[:, None, None] * np.linalg.solve(f, weight[:, None])
        free = self.cost[:, :-2, :-2]
        answer = np.linalg.solve(free, self.moments[:, :, :-2].transpose(0, 2, 1))
        self.answer = np.pad(answer, ((0, 0), (0, 2), (0, 0)))
        self.matrix = self.moments @ self.answer
        sagging = -np.linalg.solve(free, self.cost[:, :-2, -2:] @ borne)
        # patterns under the weight where no side moves
        self.sagging = np.concatenate([sagging, borne], axis=1)[:, :, 0]

    def tractions(self, patterns: Floats) -> Floats:
        """Return the moments of the tractions at the ends of the sides, shape (n, 12)."""
        return np.asarray((self.moments @ patterns[:, :, None])[:, :, 0])

    def energies(self, patterns: Floats) -> Floats:
        """Return ∫ σ S σ of each triangle."""
        return np.asarray(
            np.einsum("nk,nk->n", patterns, (self.cost @ patterns[:, :, None])[:, :, 0])
        )

    def means(self, patterns: Floats) -> Floats:
        """Return the mean stress (xx, yy, xy) of each triangle, shape (n, 3)."""
        return np.asarray(np.einsum("nim,nm->ni", self.mean, patterns))


def _map(corners: Floats) -> Floats:
    """Return what takes (0, 0), (1, 0), (0, 1) to triangles, but for a shift: shape (n, 2, 2)."""
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)


def _turned(f: Floats) -> Floats:
    """Return what takes (xx, yy, xy) of σ to that of F σ Fᵀ, shape (n, 3, 3)."""
    (a, b), (c, d) = f[:, 0].T, f[:, 1].T
    rows = [
        [a * a, b * b, 2 * a * b],
        [c * c, d * d, 2 * c * d],
        [a * c, b * d, a * d + b * c],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _thin(corners: Floats, compliance: Floats) -> tuple[Floats, Floats, Floats]:
    """Return cost, moments and means of patterns that are orthonormal in each triangle.

    Those of the table become all but alike here. In the principal axes of the map their
    components are large, middling and small throughout, and elimination in that order, the
    largest patterns first, loses none of them (Cox and Higham 1998).
    """
    f = _map(corners)
    u, size, v = np.linalg.svd(f)
    flip = np.sign(np.linalg.det(u))[:, None]
    u[:, :, 1] *= flip
    v[:, 1] *= flip
    flat = size[:, 1] / size[:, 0]
    weights = np.array([1.0, 1.0, np.sqrt(2.0)])
    grades = np.stack([np.ones_like(flat), flat**2, flat], axis=1) * weights
    aligned = np.einsum("nij,pkjm->npkim", _turned(v), table().stress[..., :-2])
    half = np.linalg.cholesky(_SQUARE)
    rows = np.einsum("lk,npkim,ni->niplm", half.T, aligned, grades)[:, [0, 2, 1]]
    bases = [qr(one.reshape(27, -1), mode="economic", pivoting=True)[0] for one in rows]
    basis = np.reshape(bases, rows.shape)[:, [0, 2, 1]] / weights[:, None, None, None]
    nodal = np.einsum("kl,niplm->npkim", np.linalg.inv(half.T), basis)
    nodal = np.einsum("nij,npkjm->npkim", _turned(u), nodal)
    area = 0.5 * np.linalg.det(f)
    bearing = _bearing(_parts(corners), f[:, None, None] / (2.0 * area[:, None, None, None, None]))
    nodal = np.concatenate([nodal, bearing], axis=4)
    strain = np.einsum("kl,nij,npljm->npkim", _SQUARE, compliance, nodal)
    cost = np.einsum("n,npkil,npkim->nlm", area / 3.0, nodal, strain)
    return cost, _moments(nodal, corners).reshape(len(f), 12, -1), nodal.mean(axis=(1, 2))
