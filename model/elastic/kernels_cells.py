"""Compiled loops over equal cells, in the plane and in space alike.

A *place* is an index into arrays over all cells with two more around them (`cell_boxes.Cells`),
as vectors; `steps` is the distance between places along each axis. Place n stands for a cell, its
lower faces, edges and corner. What a cell of a material has of energy is told by matrices, which
come from the plain twins `balanced.Polynomials` and `compatible.Modes`.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit, part
from kaju.model.scene.kinds import AIR as _AIR
from kaju.model.scene.kinds import RIGID as _RIGID

AIR, RIGID = int(_AIR), int(_RIGID)
ROW = 64
"""Cells that are added up at once, at most."""


@njit(cache=True, fastmath=True)
def shear_stress(kinds, shear, reentrant, one, two, a, b, out):
    """Write the shear stress of all edges between two axes: see `staggered.edge_modulus`.

    Parameters
    ----------
    kinds : int array, shape (places,)
    shear : array, shape (materials,)
    reentrant : float
    one, two : arrays, shape (places,)
        Displacements of the faces along the two axes.
    a, b : int
        Steps along them.
    out : array, shape (places,)
    """
    for n in range(a + b, len(out)):
        k = kinds[n]
        around = (k, kinds[n - a], kinds[n - b], kinds[n - a - b])
        modulus = 0.0
        if k >= 0 and k == around[1] and k == around[2] and k == around[3]:
            modulus = shear[k]
        else:
            body, air, rigid, yields = 0, 0, 0, 0.0
            for kind in around:
                if kind >= 0:
                    body += 1
                    yields += 1.0 / shear[kind]
                air += kind == AIR
                rigid += kind == RIGID
            if body and body + rigid == 4:
                modulus = 4.0 / yields
            elif body == 3 and air == 1:
                modulus = 3.0 * reentrant / yields
        out[n] = modulus * (one[n] - one[n - b] + two[n] - two[n - a])


@part
def between(v, w):
    """Return the weighted mean half-way between four in a row; a line's end is prolonged."""
    if w[1] > 0.0 and w[2] > 0.0:
        return (w[1] * v[1] + w[2] * v[2]) / (w[1] + w[2])
    if w[2] > 0.0:
        return 1.5 * v[2] - 0.5 * v[3] if w[3] > 0.0 else v[2]
    return 1.5 * v[1] - 0.5 * v[0] if w[0] > 0.0 else v[1]


@part
def line_of_faces(kinds, stretch, u, n, normal, across, v, w):
    """Write four faces in a row round a place, and the stiffness beside them."""
    for k in range(4):
        at = n + (k - 2) * across
        v[k] = u[at]
        w[k] = stretch[kinds[at]] + stretch[kinds[at - normal]]


@njit(cache=True)
def corner_means(kinds, stretch, u, steps, out):
    """Write the displacement of all corners by the faces round them, stiff ones counting more.

    Parameters
    ----------
    kinds : int array, shape (places,)
    stretch : array
        Of the materials; nothing for kinds below zero, which count from its end.
    u : array, shape (axes, places)
        Displacements of faces.
    steps : int array, shape (axes,)
    out : array, shape (axes, places)
    """
    d, corners = len(steps), 1 << len(steps)
    back, row = np.zeros(corners, np.int64), np.zeros((4, 4))
    v, w, lines, weights = row[0], row[1], row[2], row[3]
    for c in range(corners):
        for a in range(d):
            back[c] += (c >> a & 1) * steps[a]
    for n in range(2 * back[-1], len(kinds) - 2 * back[-1]):
        k = kinds[n]
        alike, body = k >= 0, k >= 0
        for c in range(1, corners):
            kind = kinds[n - back[c]]
            alike &= kind == k
            body |= kind >= 0
        if not body:
            continue
        for a in range(d):
            if alike:
                total = 0.0
                for c in range(corners):
                    if not c >> a & 1:
                        total += u[a, n - back[c]]
                out[a, n] = 2.0 * total / corners
                continue
            b = steps[1 if a == 0 else 0]
            if d == 2:
                line_of_faces(kinds, stretch, u[a], n, steps[a], b, v, w)
                out[a, n] = between(v, w)
                continue
            c = steps[1 if a == 2 else 2]
            for k in range(4):
                line_of_faces(kinds, stretch, u[a], n + (k - 2) * c, steps[a], b, v, w)
                lines[k], weights[k] = between(v, w), w[1] + w[2]
            out[a, n] = between(lines, weights)


@njit(cache=True, fastmath=True)
def normal_stress(kinds, stretch, lateral, u, steps, out):
    """Write the normal stresses of cells, shape (axes, places); 0 where there is no body."""
    d = len(steps)
    for n in range(len(kinds) - steps[0]):
        k = kinds[n]
        if k < 0:
            continue
        volume = 0.0
        for a in range(d):
            volume += u[a, n + steps[a]] - u[a, n]
        for a in range(d):
            own = u[a, n + steps[a]] - u[a, n]
            out[a, n] = lateral[k] * volume + (stretch[k] - lateral[k]) * own


@njit(cache=True, fastmath=True)
def sums(chosen, kinds, sigma, shear, v, steps, statics, stiffness, left, column):
    """Add up the energies of cells: rows of one material at a time.

    Parameters
    ----------
    chosen : bool array, shape (places,)
        Cells without loads or walls at their faces.
    kinds : int array, shape (places,)
    sigma, shear : arrays, shape (axes or pairs, places)
        Normal stresses of cells and shear stresses of edges.
    v : array, shape (axes, places)
        Displacements of corners.
    steps : int array, shape (axes,)
    statics : array, shape (materials, data, data)
        Complementary energy of a cell by its normal stresses, then the shear stresses of its
        edges, pair by pair: the half of data·statics·data.
    stiffness : array, shape (materials, corners · axes, corners · axes)
    left, column : arrays, shape (axes, places) and (places,)
        Less the forces at the corners; their own stiffness; empty if not wanted.

    Returns
    -------
    complementary, whole, rest : float
        Energies of the stresses and of the displacement of the corners, and the work on these of
        what the faces are left with; a face belongs to the cell below, if there is one.
    """
    d, corners = len(steps), 1 << len(steps)
    size, moved, wanted = statics.shape[1], corners * d, len(column) > 0
    value, at = np.empty((max(size, moved), ROW)), np.empty(moved, np.int64)
    total, mean = np.empty(ROW), np.empty(ROW)
    for c in range(corners):
        at[c] = 0
        for a in range(d):
            at[c] += (c >> (d - 1 - a) & 1) * steps[a]
    complementary = whole = rest = 0.0
    n, end = 0, len(kinds)
    while n < end:
        if not chosen[n]:
            n += 1
            continue
        k, m = kinds[n], 1
        while m < ROW and chosen[n + m] and kinds[n + m] == k:
            m += 1
        i, pair = d, 0
        for a in range(d):
            for t in range(m):
                value[a, t] = sigma[a, n + t]
            for b in range(a + 1, d):
                for first in (0, steps[a]):
                    for second in (0, steps[b]):
                        for t in range(m):
                            value[i, t] = shear[pair, n + t + first + second]
                        i += 1
                pair += 1
        for i in range(size):
            half = 0.5 * statics[k, i, i]
            for t in range(m):
                total[t] = half * value[i, t]
            for j in range(i + 1, size):
                share = statics[k, i, j]
                if share != 0.0:
                    for t in range(m):
                        total[t] += share * value[j, t]
            for t in range(m):
                complementary += total[t] * value[i, t]
        for c in range(corners):
            for a in range(d):
                for t in range(m):
                    value[c * d + a, t] = v[a, n + t + at[c]]
        for c in range(corners):
            for a in range(d):
                for t in range(m):
                    total[t] = 0.0
                for j in range(moved):
                    share = stiffness[k, c * d + a, j]
                    if share != 0.0:
                        for t in range(m):
                            total[t] += share * value[j, t]
                for t in range(m):
                    whole += 0.5 * total[t] * value[c * d + a, t]
                if wanted:
                    for t in range(m):
                        left[a, n + t + at[c]] -= total[t]
            if wanted:
                for t in range(m):
                    column[n + t + at[c]] += stiffness[k, 0, 0]
        for a in range(d):
            for upper in range(2):
                for t in range(m):
                    mean[t] = 0.0
                for c in range(corners):
                    if (c >> (d - 1 - a)) & 1 == upper:
                        for t in range(m):
                            mean[t] += value[c * d + a, t]
                face = n + upper * steps[a]
                for t in range(m):
                    total[t] = sigma[a, face + t - steps[a]] - sigma[a, face + t]
                for b in range(d):
                    if b != a:
                        for t in range(m):
                            one, two = face + t, face + t + steps[b]
                            total[t] += shear[a + b - 1, one] - shear[a + b - 1, two]
                for t in range(m):
                    if upper or kinds[n + t - steps[a]] < 0:
                        rest -= 2.0 * total[t] * mean[t] / corners
        n += m
    return complementary, whole, rest
