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
    out : array, shape (places, axes)
    """
    d, corners = len(steps), 1 << len(steps)
    back, row = np.zeros(corners, np.int64), np.zeros((4, 4))
    v, w, lines, weights = row[0], row[1], row[2], row[3]
    for c in range(corners):
        for a in range(d):
            back[c] += (c >> a & 1) * steps[a]
    for n in range(2 * back[-1], len(out) - 2 * back[-1]):
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
                out[n, a] = 2.0 * total / corners
                continue
            b = steps[1 if a == 0 else 0]
            if d == 2:
                line_of_faces(kinds, stretch, u[a], n, steps[a], b, v, w)
                out[n, a] = between(v, w)
                continue
            c = steps[1 if a == 2 else 2]
            for k in range(4):
                line_of_faces(kinds, stretch, u[a], n + (k - 2) * c, steps[a], b, v, w)
                lines[k], weights[k] = between(v, w), w[1] + w[2]
            out[n, a] = between(lines, weights)


@njit(cache=True, fastmath=True)
def sums(cells, kinds, law, u, shear, v, steps, statics, stiffness, own, left, column):
    """Add up the energies of cells.

    Parameters
    ----------
    cells : int array
        Places of cells without loads or walls at their faces.
    kinds : int array, shape (places,)
    law : array, shape (3, materials and zeros for the kinds below zero)
        C₁₁ and C₁₂ come first.
    u, shear : arrays, shape (axes or pairs, places)
        Displacements of faces, and shear stresses of edges.
    v : array, shape (places, axes)
        Displacements of corners.
    steps : int array
    statics : array, shape (materials, data, data)
        Complementary energy of a cell by its normal stresses, then the shear stresses of its
        edges, pair by pair: the half of data·statics·data.
    stiffness : array, shape (materials, corners · axes, corners · axes)
    own : array, shape (materials,)
        A corner's own stiffness.
    left, column : arrays, shape (places, axes) and (places,)
        Less the forces at the corners; their own stiffness; empty if not wanted.

    Returns
    -------
    complementary, whole, rest : float
        Energies of the stresses and of the displacement of the corners, and the work on these of
        what the faces are left with; a face belongs to the cell below, if there is one.
    """
    d, corners = len(steps), 1 << len(steps)
    size, wanted = statics.shape[1], len(left) > 0
    data, moved = np.empty(size), np.empty(corners * d)
    ahead = np.zeros(corners, np.int64)
    for c in range(corners):
        for a in range(d):
            ahead[c] += (c >> (d - 1 - a) & 1) * steps[a]
    complementary = whole = rest = 0.0
    for n in cells:
        k = kinds[n]
        for a in range(d):
            data[a] = normal_stress(u, law, kinds, steps, n, a)
        at, pair = d, 0
        for a in range(d):
            for b in range(a + 1, d):
                data[at] = shear[pair, n]
                data[at + 1] = shear[pair, n + steps[b]]
                data[at + 2] = shear[pair, n + steps[a]]
                data[at + 3] = shear[pair, n + steps[a] + steps[b]]
                at, pair = at + 4, pair + 1
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += statics[k, i, j] * data[j]
            complementary += 0.5 * total * data[i]
        for c in range(corners):
            for a in range(d):
                moved[c * d + a] = v[n + ahead[c], a]
        for c in range(corners):
            for a in range(d):
                total = 0.0
                for j in range(corners * d):
                    total += stiffness[k, c * d + a, j] * moved[j]
                whole += 0.5 * total * moved[c * d + a]
                if wanted:
                    left[n + ahead[c], a] -= total
            if wanted:
                column[n + ahead[c]] += own[k]
        for a in range(d):
            for upper in range(2):
                face = n + upper * steps[a]
                if not upper and kinds[n - steps[a]] >= 0:
                    continue
                force = (2.0 * upper - 1.0) * data[a]
                if upper:
                    force -= normal_stress(u, law, kinds, steps, face, a)
                for b in range(d):
                    if b != a:
                        pair = a + b - 1
                        force += shear[pair, face] - shear[pair, face + steps[b]]
                mean = 0.0
                for c in range(corners):
                    if (c >> (d - 1 - a)) & 1 == upper:
                        mean += moved[c * d + a]
                rest -= 2.0 * force * mean / corners
    return complementary, whole, rest


@part
def normal_stress(u, law, kinds, steps, n, a):
    """Return a cell's normal stress along an axis; 0 where there is no body."""
    k, volume = kinds[n], 0.0
    for b in range(len(steps)):
        volume += u[b, n + steps[b]] - u[b, n]
    return law[1, k] * volume + (law[0, k] - law[1, k]) * (u[a, n + steps[a]] - u[a, n])
