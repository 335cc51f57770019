"""Compiled loops over equal cells, in the plane and in space alike.

A *place* is an index into arrays over all cells with two more around them (`cell_boxes.Cells`),
as vectors; `steps` is the distance between places along each axis. Place n stands for a cell, its
lower faces, edges and corner. What a cell of a material has of energy is told by matrices, which
come from the plain twins `balanced.Polynomials` and `compatible.Modes`.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from typing import Any

import numpy as np

from kaju.compiling import along, njit, part
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
def line_of_faces(kinds, stretch, u, first, n, normal, across, v, w):
    """Write four faces in a row round a place, and the stiffness beside them."""
    faces = along(u, first + n - 2 * across)
    for k in range(4):
        at = n + (k - 2) * across
        v[k] = faces[k * across]
        w[k] = stretch[kinds[at]] + stretch[kinds[at - normal]]


@njit(cache=True, fastmath=True)
def corner_means(touched, alike, kinds, stretch, u, steps, out):
    """Write the displacement of all corners by the faces round them, stiff ones counting more.

    Parameters
    ----------
    touched, alike : bool arrays, shape (places,)
        Corners round which any cell is body, and all are of one material.
    kinds : int array, shape (places,)
    stretch : array
        Of the materials; nothing for kinds below zero, which count from its end.
    u : array, shape (axes, places)
        Displacements of faces.
    steps : int array, shape (axes,)
    out : array, shape (axes, places)
    """
    d, count, row = len(steps), len(kinds), np.zeros((4, 4))
    v, w, lines, weights = row[0], row[1], row[2], row[3]
    n = 0
    while n < count:
        if not touched[n]:
            n += 1
            continue
        m = 0
        while alike[n + m]:
            m += 1
        for a in range(d):
            b, c = steps[1 if a == 0 else 0], steps[1 if a == 2 else 2] if d == 3 else 0
            at = a * count + n
            if m:
                one, two, mean = along(u, at), along(u, at - b), along(out, at)
                if d == 2:
                    for t in range(m):
                        mean[t] = 0.5 * (one[t] + two[t])
                else:
                    three, four = along(u, at - c), along(u, at - b - c)
                    for t in range(m):
                        mean[t] = 0.25 * (one[t] + two[t] + three[t] + four[t])
            elif d == 2:
                line_of_faces(kinds, stretch, u, a * count, n, steps[a], b, v, w)
                out[a, n] = between(v, w)
            else:
                for k in range(4):
                    line_of_faces(kinds, stretch, u, a * count, n + (k - 2) * c, steps[a], b, v, w)
                    lines[k], weights[k] = between(v, w), w[1] + w[2]
                out[a, n] = between(lines, weights)
        n += max(m, 1)


def corner_means_of_few(
    corner: Any, kinds: Any, stretch: Any, u: Any, steps: Any, out: Any
) -> None:
    """Write the displacement of some corners as `corner_means` does, without compiled loops."""

    def half_way(v: Any, w: Any) -> Any:
        low, high = w[1] > 0.0, w[2] > 0.0
        weight = np.where(low & high, w[1] + w[2], 1.0)
        after = np.where(w[3] > 0.0, 1.5 * v[2] - 0.5 * v[3], v[2])
        before = np.where(w[0] > 0.0, 1.5 * v[1] - 0.5 * v[0], v[1])
        ends = np.where(high, after, before)
        return np.where(low & high, (w[1] * v[1] + w[2] * v[2]) / weight, ends)

    for a, normal in enumerate(steps):

        def line(place: Any, across: Any, faces: Any = u[a], normal: Any = normal) -> Any:
            at = place + across * np.arange(-2, 2)[:, None]
            return faces[at], stretch[kinds[at]] + stretch[kinds[at - normal]]

        b, *others = (step for step in steps if step != normal)
        if not others:
            out[a, corner] = half_way(*line(corner, b))
            continue
        lines = [line(corner + k * others[0], b) for k in range(-2, 2)]
        weights = [w[1] + w[2] for _, w in lines]
        out[a, corner] = half_way([half_way(v, w) for v, w in lines], weights)


@njit(cache=True, fastmath=True)
def normal_stress(kinds, stretch, lateral, u, steps, out):
    """Write the normal stresses of cells, shape (axes, places); 0 where there is no body."""
    count, d = len(kinds), len(steps)
    one, two, last = along(u, 0), along(u, count), along(u, (d - 1) * count)
    one_up, two_up, last_up = (
        along(u, steps[0]), along(u, count + steps[1]), along(u, (d - 1) * count + steps[d - 1]),
    )  # fmt: skip
    x, y, z = along(out, 0), along(out, count), along(out, (d - 1) * count)
    for n in range(count - steps[0]):
        k = kinds[n]
        if k >= 0:
            p, q = one_up[n] - one[n], two_up[n] - two[n]
            r = last_up[n] - last[n] if d == 3 else 0.0
            lame, twice = lateral[k] * (p + q + r), stretch[k] - lateral[k]
            x[n], y[n] = lame + twice * p, lame + twice * q
            if d == 3:
                z[n] = lame + twice * r


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
    d, corners, count = len(steps), 1 << len(steps), len(kinds)
    size, moved, wanted = statics.shape[1], corners * d, len(column) > 0
    value, at = np.empty((max(size, moved), ROW)), np.empty(corners, np.int64)
    total, mean = np.empty(ROW), np.empty(ROW)
    for c in range(corners):
        at[c] = 0
        for a in range(d):
            at[c] += (c >> (d - 1 - a) & 1) * steps[a]
    complementary = whole = rest = 0.0
    n = 0
    while n < count:
        if not chosen[n]:
            n += 1
            continue
        k, m = kinds[n], 1
        while m < ROW and chosen[n + m] and kinds[n + m] == k:
            m += 1
        i, pair = d, 0
        for a in range(d):
            take(sigma, a * count + n, value, a, m)
            for b in range(a + 1, d):
                for first in (0, steps[a]):
                    for second in (0, steps[b]):
                        take(shear, pair * count + n + first + second, value, i, m)
                        i += 1
                pair += 1
        for i in range(size):
            half, own = 0.5 * statics[k, i, i], along(value, i * ROW)
            for t in range(m):
                total[t] = half * own[t]
            for j in range(i + 1, size):
                if statics[k, i, j] != 0.0:
                    add(total, statics[k, i, j], value, j, m)
            complementary += product(total, own, m)
        for c in range(corners):
            for a in range(d):
                take(v, a * count + n + at[c], value, c * d + a, m)
        for c in range(corners):
            for a in range(d):
                i = c * d + a
                for t in range(m):
                    total[t] = 0.0
                for j in range(0, moved, 4):
                    one, two = along(value, j * ROW), along(value, (j + 1) * ROW)
                    three, four = along(value, (j + 2) * ROW), along(value, (j + 3) * ROW)
                    p, q = stiffness[k, i, j], stiffness[k, i, j + 1]
                    r, s = stiffness[k, i, j + 2], stiffness[k, i, j + 3]
                    for t in range(m):
                        total[t] += p * one[t] + q * two[t] + r * three[t] + s * four[t]
                whole += 0.5 * product(total, along(value, i * ROW), m)
                if wanted:
                    less = along(left, a * count + n + at[c])
                    for t in range(m):
                        less[t] -= total[t]
            if wanted:
                own, more = along(column, n + at[c]), stiffness[k, 0, 0]
                for t in range(m):
                    own[t] += more
        for a in range(d):
            for upper in range(2):
                bare = upper == 1
                for t in range(m):
                    mean[t] = 0.0
                    bare |= kinds[n + t - steps[a]] < 0
                if not bare:
                    continue
                for c in range(corners):
                    if (c >> (d - 1 - a)) & 1 == upper:
                        add(mean, 2.0 / corners, value, c * d + a, m)
                face = a * count + n + upper * steps[a]
                low, high = along(sigma, face - steps[a]), along(sigma, face)
                for t in range(m):
                    total[t] = low[t] - high[t]
                for b in range(d):
                    if b != a:
                        face = (a + b - 1) * count + n + upper * steps[a]
                        low, high = along(shear, face), along(shear, face + steps[b])
                        for t in range(m):
                            total[t] += low[t] - high[t]
                if not upper:
                    for t in range(m):
                        if kinds[n + t - steps[a]] >= 0:
                            total[t] = 0.0
                rest -= product(total, mean, m)
        n += m
    return complementary, whole, rest


@part
def take(values, start, rows, i, count):
    """Write a part of a vector into a row."""
    own, row = along(values, start), along(rows, i * ROW)
    for t in range(count):
        row[t] = own[t]


@part
def add(total, share, rows, i, count):
    """Add a share of a row."""
    row = along(rows, i * ROW)
    for t in range(count):
        total[t] += share * row[t]


@part
def product(one, two, count):
    """Return the product of two rows."""
    total = 0.0
    for t in range(count):
        total += one[t] * two[t]
    return total
