"""Compiled loops over boxes in which a displacement is linear along every axis.

`compatible.Modes` says the same in plain NumPy: mode by mode, which makes the stiffness short.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju.compiling import njit


def pull(element: Any, stretch: Any, lateral: Any, shear: Any, v: Any, out: Any) -> None:
    """Add the forces that hold the corners of boxes at a displacement.

    Parameters
    ----------
    element : int array, shape (2^d, n)
        Nodes at the corners, the last axis running fastest.
    stretch, lateral, shear : arrays, shape (n,)
        Moduli, times the edge in three dimensions.
    v, out : arrays, shape (nodes, d)
    """
    loop = _pull_plane if element.shape[0] == 4 else _pull_solid  # compiled if it is needed
    loop(element, stretch, lateral, shear, v, out)


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


@njit(cache=True)
def spread(element, value, out):  # type: ignore[no-untyped-def]
    """Add a value of every box to all nodes at its corners."""
    for n in range(element.shape[1]):
        for w in range(element.shape[0]):
            out[element[w, n]] += value[n]


@njit(cache=True, fastmath=True)
def work_on_sides(corner, pressure, area, v):  # type: ignore[no-untyped-def]
    """Return the work of pressures, shape (2·d, boxes), along the normals of boxes' sides."""
    d, count = v.shape[1], corner.shape[0]
    total = 0.0
    for side in range(2 * d):
        axis, upper = side // 2, side % 2
        for n in range(corner.shape[1]):
            if pressure[side, n] != 0.0:
                moved = 0.0
                for w in range(count):
                    if (w >> (d - 1 - axis)) & 1 == upper:
                        moved += v[corner[w, n], axis]
                total += (2.0 * upper - 1.0) * pressure[side, n] * area[n] * moved
    return total / (count // 2)


@njit(cache=True, fastmath=True)
def sink(v, left, way, pull, weight, step):  # type: ignore[no-untyped-def]
    """Go along a way, and return the weighted square of the forces that are left."""
    total = 0.0
    for i in range(len(v)):
        for a in range(v.shape[1]):
            v[i, a] += step * way[i, a]
            left[i, a] -= step * pull[i, a]
            total += weight[i, a] * left[i, a] * left[i, a]
    return total


@njit(cache=True, fastmath=True)
def turn(way, left, weight, share):  # type: ignore[no-untyped-def]
    """Make the weighted forces that are left, and a share of the last way, the new one."""
    for i in range(len(way)):
        for a in range(way.shape[1]):
            way[i, a] = weight[i, a] * left[i, a] + share * way[i, a]
