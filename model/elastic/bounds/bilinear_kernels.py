"""Forces of boxes in which a displacement is linear along every axis.

The compiled loop goes mode by mode, products of X_i − ½: all are orthogonal to each other, and so
are their strains, which makes the stiffness short.
"""

from __future__ import annotations

from functools import lru_cache, reduce

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import njit
from kaju.model.elastic.moduli import Moduli

FEW = 50_000  # The forces on so few boxes take no compiled loop


def add_forces(element: Ints, law: Moduli, v: Floats, out: Floats) -> None:
    """Add the forces that hold the corners of boxes at a displacement, both of shape (nodes, d)."""
    # `element` are the nodes at the corners, shape (2^d, n), the last axis running fastest; the
    # moduli are times the edge in three dimensions.
    if element.shape[1] > FEW:
        _add_by_modes(element, *law, v, out, (0.0,) * v.shape[1])
        return
    d, force = v.shape[1], forces(law, corner_displacements(element, v))
    for a in range(d):
        out[:, a] += np.bincount(element.T.ravel(), force[:, a::d].ravel(), len(out))


def corner_displacements(element: Ints, v: Floats) -> Floats:
    """Return the displacements of the corners of boxes, shape (n, 2^d · d)."""
    return v[element].transpose(1, 0, 2).reshape(element.shape[1], -1)


def forces(law: Moduli, moved: Floats) -> Floats:
    """Return the forces that hold the corners of boxes, by their displacements."""
    forms = element_stiffness({8: 2, 24: 3}[moved.shape[1]])
    parts = (modulus[:, None] * (moved @ form) for modulus, form in zip(law, forms, strict=True))
    return reduce(np.add, parts)


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
def _add_by_modes(element, stretch, lateral, shear, v, out, axes):  # type: ignore[no-untyped-def]
    # The length of `axes` is the dimension, known when this is compiled: its loops unroll.
    d = len(axes)
    count, top = 1 << d, 1 << (d - 1)
    mode, force = np.empty((count, d)), np.empty((count, d))
    for n in range(element.shape[1]):
        for w in range(count):
            for a in range(d):
                mode[w, a], force[w, a] = v[element[w, n], a], 0.0
        for b in range(d):
            for w in range(count):
                if not w & (1 << b):
                    for a in range(d):
                        low, high = mode[w, a], mode[w | (1 << b), a]
                        mode[w, a], mode[w | (1 << b), a] = 0.5 * (low + high), high - low
        for w in range(count - 1):
            square = 1.0
            for b in range(d):
                square /= 12.0 if w & (1 << b) else 1.0
            volume = 0.0
            for a in range(d):
                if not w & (top >> a):
                    volume += mode[w | (top >> a), a]
            for a in range(d):
                if not w & (top >> a):
                    own = (stretch[n] - lateral[n]) * mode[w | (top >> a), a]
                    force[w | (top >> a), a] += square * (lateral[n] * volume + own)
                for b in range(a + 1, d):
                    slope = 0.0
                    if not w & (top >> b):
                        slope += mode[w | (top >> b), a]
                    if not w & (top >> a):
                        slope += mode[w | (top >> a), b]
                    tau = square * shear[n] * slope
                    if not w & (top >> b):
                        force[w | (top >> b), a] += tau
                    if not w & (top >> a):
                        force[w | (top >> a), b] += tau
        for b in range(d):
            for w in range(count):
                if not w & (1 << b):
                    for a in range(d):
                        half, slope = 0.5 * force[w, a], force[w | (1 << b), a]
                        force[w, a], force[w | (1 << b), a] = half - slope, half + slope
        for w in range(count):
            for a in range(d):
                out[element[w, n], a] += force[w, a]
