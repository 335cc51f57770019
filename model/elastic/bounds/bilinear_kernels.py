"""Forces of boxes in which a displacement is linear along every axis.

The compiled loop goes mode by mode, products of X_i − ½: all are orthogonal to each other, and so
are their strains, which makes the stiffness short.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import Moduli, by_law

FEW = 50_000  # The forces on so few boxes take no compiled loop


class LawForms:
    """One matrix for the boxes of each law, made of one for each modulus, times a factor."""

    def __init__(self, moduli: Floats, forms: Floats, factor: Floats) -> None:
        # Shapes (moduli, n), (moduli, data, data) and (n,).
        self._groups = [(some, np.tensordot(law, forms, 1)) for some, law in by_law(moduli)]
        self._data, self._factor = forms.shape[1], factor[:, None]

    def apply(self, values: Floats) -> Floats:
        """Return the product of the matrices and values, shape (n, data)."""
        found = np.empty_like(values)
        for some, form in self._groups:
            found[some] = values[some] @ form
        found *= self._factor
        return found

    def diagonal(self) -> Floats:
        """Return the diagonals of the matrices, shape (n, data)."""
        found = np.empty((len(self._factor), self._data))
        for some, form in self._groups:
            found[some] = form.diagonal()
        return np.asarray(found * self._factor)


def node_displacements(element: Ints, v: Floats) -> Floats:
    """Return the displacements of the nodes of boxes, shape (n, functions · d)."""
    return v[element.T].reshape(element.shape[1], -1)


def add_forces(element: Ints, law: Moduli, v: Floats, out: Floats) -> None:
    """Add the forces that hold the corners of boxes at a displacement, both of shape (nodes, d)."""
    # `element` are the nodes at the corners, shape (2^d, n), the last axis running fastest; the
    # moduli are times the edge in three dimensions.
    _compiled()(element, *law, v, out, (0.0,) * v.shape[1])


@cache
def _compiled() -> Any:
    from kaju.compiling import njit

    return njit(cache=True, fastmath=True)(_add_by_modes)


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
