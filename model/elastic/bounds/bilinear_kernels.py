"""Boxes in which a displacement is linear along every axis; compiled loops where they are many.

The loops go mode by mode, products of X_i − ½: all are at right angles to each other, and so are
their strains, which makes the stiffness short.
"""

from __future__ import annotations

from functools import lru_cache, reduce
from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.compiling import njit

FEW = 50_000  # The forces on so few boxes take no compiled loop


def pull(element: Any, stretch: Any, lateral: Any, shear: Any, v: Any, out: Any) -> None:
    """Add the forces that hold the corners of boxes at a displacement, both of shape (nodes, d)."""
    # `element` are the nodes at the corners, shape (2^d, n), the last axis running fastest; the
    # moduli are times the edge in three dimensions.
    if element.shape[1] > FEW:
        loop = _pull_plane if element.shape[0] == 4 else _pull_solid
        loop(element, stretch, lateral, shear, v, out)
        return
    d, force = v.shape[1], forces(stretch, lateral, shear, moved_corners(element, v))
    for a in range(d):
        out[:, a] += np.bincount(element.T.ravel(), force[:, a::d].ravel(), len(out))


def moved_corners(element: Any, v: Any) -> Any:
    """Return the displacements of the corners of boxes, shape (n, 2^d · d)."""
    return v[element].transpose(1, 0, 2).reshape(element.shape[1], -1)


def forces(stretch: Any, lateral: Any, shear: Any, moved: Any) -> Any:
    """Return the forces that hold the corners of boxes, by their displacements."""
    forms = element_stiffness({8: 2, 24: 3}[moved.shape[1]])
    parts = zip((stretch, lateral, shear), forms, strict=True)
    return sum(modulus[:, None] * (moved @ form) for modulus, form in parts)


@lru_cache(maxsize=2)
def element_stiffness(dimension: int) -> tuple[Floats, Floats, Floats]:
    """Return the forces at corners by their displacements, of moduli C₁₁, C₁₂ and μ of one."""
    mass, stiff = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0, np.array([[1.0, -1.0], [-1.0, 1.0]])
    slope = np.array([[-0.5, -0.5], [0.5, 0.5]])
    axes = range(dimension)

    def product(a: int, b: int) -> Floats:
        """Return the integral of ∂N/∂x_a times ∂N/∂x_b."""
        line = [
            (stiff if a == b else slope if c == a else slope.T) if c in (a, b) else mass
            for c in axes
        ]
        return reduce(np.kron, line)

    count = 1 << dimension
    forms = np.zeros((3, count, dimension, count, dimension))
    for a in axes:
        forms[0, :, a, :, a] = product(a, a)
        for b in axes:
            if a != b:
                forms[1, :, a, :, b] = product(a, b)
                forms[2, :, a, :, a] += product(b, b)
                forms[2, :, a, :, b] += product(b, a)
    one, two, three = forms.reshape(3, count * dimension, count * dimension)
    return one, two, three


@njit(cache=True, fastmath=True)
def _pull_plane(element, stretch, lateral, shear, v, out):  # type: ignore[no-untyped-def]
    for n in range(element.shape[1]):
        a, b, c, e = element[0, n], element[1, n], element[2, n], element[3, n]
        p, q = v[e, 0] - v[a, 0], v[c, 0] - v[b, 0]
        ux, uy, uxy = 0.5 * (p + q), 0.5 * (p - q), v[e, 0] + v[a, 0] - v[b, 0] - v[c, 0]
        p, q = v[e, 1] - v[a, 1], v[c, 1] - v[b, 1]
        wx, wy, wxy = 0.5 * (p + q), 0.5 * (p - q), v[e, 1] + v[a, 1] - v[b, 1] - v[c, 1]
        mu = shear[n]
        x = 0.5 * (stretch[n] * ux + lateral[n] * wy)
        y = 0.5 * (stretch[n] * wy + lateral[n] * ux)
        t = 0.5 * mu * (uy + wx)
        twist = (stretch[n] + mu) / 12.0
        ru, rw = twist * uxy, twist * wxy
        out[a, 0] += ru - x - t
        out[a, 1] += rw - y - t
        out[b, 0] += t - x - ru
        out[b, 1] += y - t - rw
        out[c, 0] += x - t - ru
        out[c, 1] += t - y - rw
        out[e, 0] += x + t + ru
        out[e, 1] += y + t + rw


@njit(cache=True, fastmath=True)
def _pull_solid(element, stretch, lateral, shear, v, out):  # type: ignore[no-untyped-def]
    mode, force = np.empty((8, 3)), np.empty((8, 3))
    for n in range(element.shape[1]):
        for w in range(8):
            for a in range(3):
                mode[w, a], force[w, a] = v[element[w, n], a], 0.0
        for bit in (4, 2, 1):
            for w in range(8):
                if not w & bit:
                    for a in range(3):
                        low, high = mode[w, a], mode[w | bit, a]
                        mode[w, a], mode[w | bit, a] = 0.5 * (low + high), high - low
        for w in range(7):
            square = 1.0
            for bit in (4, 2, 1):
                square /= 12.0 if w & bit else 1.0
            volume = 0.0
            for a in range(3):
                if not w & (4 >> a):
                    volume += mode[w | (4 >> a), a]
            for a in range(3):
                if not w & (4 >> a):
                    own = (stretch[n] - lateral[n]) * mode[w | (4 >> a), a]
                    force[w | (4 >> a), a] += square * (lateral[n] * volume + own)
                for b in range(a + 1, 3):
                    slope = 0.0
                    if not w & (4 >> b):
                        slope += mode[w | (4 >> b), a]
                    if not w & (4 >> a):
                        slope += mode[w | (4 >> a), b]
                    tau = square * shear[n] * slope
                    if not w & (4 >> b):
                        force[w | (4 >> b), a] += tau
                    if not w & (4 >> a):
                        force[w | (4 >> a), b] += tau
        for bit in (4, 2, 1):
            for w in range(8):
                if not w & bit:
                    for a in range(3):
                        half, slope = 0.5 * force[w, a], force[w | bit, a]
                        force[w, a], force[w | bit, a] = half - slope, half + slope
        for w in range(8):
            for a in range(3):
                out[element[w, n], a] += force[w, a]
