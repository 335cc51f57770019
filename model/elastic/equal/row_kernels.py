"""Compiled loops over rows of faces, in the plane and in space: smooth, restrict, prolong, P'AP.

A *place* is the index of a face or cell in an array with ghosts around it; a vector holds all
places for one component after the other. A *level* is a tuple of arrays:

``data``: on the finest level the law (2 + pairs, places): C₁₁, C₁₂ and the moduli of the edges;
on coarse levels the stencil (rows, entries, row length); as one vector;
``inverse`` (components × places): inverse of a face's own stiffness, 0 where it cannot move;
``couplings`` (couplings, 3): of a coarse level, in which row the coefficient is, its distance
from that row's first entry, and in a vector from the place of component 0 to the other face;
``box``: integers, at the indices named below;
``rows``: per row of places its row of ``data`` and ``inverse``. Equal rows, nearly all of a full
box, share one, which stays in the cache.

Several Gauss-Seidel sweeps run in one pass, each as many planes behind the one before as a row
reaches, so that a plane stays in the cache (temporal blocking). Within a row, even faces are
smoothed before odd ones; going back the order is reversed. `staggered` states the law.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import along, inlined, njit, part

PLANES, ROWS, LENGTH = 0, 1, 2  # Of the arrays with their ghosts
FIRST, END = 3, 4
"""Of the planes in use; two and four further those of rows, and of places in a row."""
FIRST_ROW, END_ROW, LOW, HIGH = 5, 6, 7, 8
REACH, ENTRIES, COUNT, SIZE = 9, 10, 11, 12
"""Rows that a stencil reaches, its entries (0 on the finest level), components, places."""
STEP, START, NEXT = 13, 16, 20
"""Distance in places along the axis that a component is normal to; its first coupling (and the
end of all); entry of a face with its next in the row."""

GHOST = 3  # Place of a coarse level's first ghost along every axis
TO_COARSE, FROM_COARSE, RESIDUAL = 0, 1, 2  # What `pass_level` is for
SMOOTH, RESTRICT, RESTRICT_LOAD, WRITE_RESIDUAL, PROLONG = 0, 1, 2, 3, 4  # Tasks of a plane
OVER = 1.3
"""Faces are relaxed by so many times what balances them (Young 1954): 1.2 to 1.5 take a tenth to a
fifth of the iterations away, on plates, boxes, holes, grains, rubber and missing pixels alike."""


@part
def shared(rows, place, length):
    """Return the place of the shared row that describes one of the first component."""
    return rows[place // length] * length + place % length


@inlined
def residual_row(u, f, level, a, row, r):
    """Write f − Au on a row of component a."""
    data, inverse, couplings, box, rows = level
    length, lo, entries = box[LENGTH], box[LOW], box[ENTRIES]
    w, s = box[HIGH] - lo, row * length + lo
    load = along(f, a * box[SIZE] + s)
    if entries == 0:
        n, m, ea = box[SIZE], len(inverse) // box[COUNT], box[STEP + a]
        at, here, last = a * n + s, shared(rows, s, length), shared(rows, s - ea, length)
        x, ahead, behind = along(u, at), along(u, at + ea), along(u, at - ea)
        c, before = along(data, here), along(data, last)
        d, back = along(data, m + here), along(data, m + last)
        for b in range(box[COUNT]):
            if b == a:
                continue
            eb, to, edge = box[STEP + b], b * n + s, (1 + a + b) * m
            y, up = along(u, to), along(u, to + eb)
            low, corner = along(u, to - ea), along(u, to + eb - ea)
            k, other = along(data, edge + here), along(data, edge + shared(rows, s + eb, length))
            above, below = along(u, at + eb), along(u, at - eb)
            if b == (a == 0):
                # With the first of the other components come the normal stresses of the row itself.
                for j in range(w):
                    r[j] = (
                        load[j]
                        + c[j] * (ahead[j] - x[j])
                        - before[j] * (x[j] - behind[j])
                        + d[j] * (up[j] - y[j])
                        - back[j] * (corner[j] - low[j])
                        + other[j] * (above[j] - x[j] + up[j] - corner[j])
                        - k[j] * (x[j] - below[j] + y[j] - low[j])
                    )
            else:
                for j in range(w):
                    r[j] += (
                        d[j] * (up[j] - y[j])
                        - back[j] * (corner[j] - low[j])
                        + other[j] * (above[j] - x[j] + up[j] - corner[j])
                        - k[j] * (x[j] - below[j] + y[j] - low[j])
                    )
        return
    for j in range(w):
        r[j] = load[j]
    first, last, size = box[START + a], box[START + a + 1], entries * length
    fours = first + 4 * ((last - first) // 4)
    for k in range(first, fours, 4):
        at = rows[row + couplings[k, 0]] * size + lo + couplings[k, 1]
        a0, x0 = along(data, at), along(u, s + couplings[k, 2])
        at = rows[row + couplings[k + 1, 0]] * size + lo + couplings[k + 1, 1]
        a1, x1 = along(data, at), along(u, s + couplings[k + 1, 2])
        at = rows[row + couplings[k + 2, 0]] * size + lo + couplings[k + 2, 1]
        a2, x2 = along(data, at), along(u, s + couplings[k + 2, 2])
        at = rows[row + couplings[k + 3, 0]] * size + lo + couplings[k + 3, 1]
        a3, x3 = along(data, at), along(u, s + couplings[k + 3, 2])
        for j in range(w):
            r[j] -= a0[j] * x0[j] + a1[j] * x1[j] + a2[j] * x2[j] + a3[j] * x3[j]
    for k in range(fours, last):
        at = rows[row + couplings[k, 0]] * size + lo + couplings[k, 1]
        a0, x0 = along(data, at), along(u, s + couplings[k, 2])
        for j in range(w):
            r[j] -= a0[j] * x0[j]


@part
def coarse_place(i, normal, other):
    """Return one of the two coarse places that place i follows along an axis, and its weight."""
    if normal:
        return i // 2 + 2 + other * (i % 2), 0.5 if i % 2 else 1.0 - other
    return i // 2 + 2 + other * (2 * (i % 2) - 1), 0.75 - 0.5 * other


@part
def coarse_row(a, p, i, k, count, coarse):
    """Return the start of one of the four coarse rows that a row follows, and its weight."""
    plane, weight = coarse_place(p, a == 0, k // 2)
    row, height = coarse_place(i, a == 1, k % 2)
    if count == 2:
        row, height = 0, 1.0 - k % 2
    plane += a * coarse[PLANES]
    return (plane * coarse[ROWS] + row) * coarse[LENGTH], weight * height


@inlined
def prolong_plane(u, g, level, coarse, p, t):
    """Interpolate the coarse displacement g and add it to the faces of a plane that can move."""
    _data, inverse, _couplings, box, rows = level
    count, low, half = box[COUNT], GHOST, coarse[HIGH] - GHOST
    m = len(inverse) // count
    before, own, after = along(t, low - 1), along(t, low), along(t, low + 1)
    for a in range(count):
        for i in range(box[FIRST_ROW], box[END_ROW]):
            for j in range(len(t)):
                t[j] = 0.0
            for k in range(4):
                start, weight = coarse_row(a, p, i, k, count, coarse)
                if weight != 0.0:
                    one = along(g, start)
                    for j in range(len(t)):
                        t[j] += weight * one[j]
            row, lo = p * box[ROWS] + i, 2 * low - 4
            x = along(u, a * box[SIZE] + row * box[LENGTH] + lo)
            v = along(inverse, a * m + rows[row] * box[LENGTH] + lo)
            for j in range(half):
                near = 0.75 * own[j]
                even, odd = near + 0.25 * before[j], near + 0.25 * after[j]
                if a == count - 1:
                    even, odd = own[j], 0.5 * (own[j] + after[j])
                x[2 * j] += even if v[2 * j] > 0.0 else 0.0
                x[2 * j + 1] += odd if v[2 * j + 1] > 0.0 else 0.0


@njit(cache=True, fastmath=True)
def take_planes(u, f, g, level, coarse, parity, r, t, steps, back, share):
    """Take a level's planes in turn; see `pass_level`."""
    # The residual (or the load itself) is restricted to g, or share·f − Au written there. Residuals
    # are worked out at one place in this loop, as that is what takes long to be compiled.
    data, inverse, _couplings, box, rows = level
    n, count, entries, length, lo = box[SIZE], box[COUNT], box[ENTRIES], box[LENGTH], box[LOW]
    first, end, w, m = box[FIRST_ROW], box[END_ROW], box[HIGH] - lo, len(inverse) // count
    # Odd faces yield second going forward, even ones going back.
    later = along(parity, (lo + 1 - back) % 2)
    left, here, right = along(r, lo - 1), along(r, lo), along(r, lo + 1)
    low, half = GHOST, coarse[HIGH] - GHOST
    restricted = along(r, 2 * low - 5)
    for step in range(len(steps)):
        p, task = steps[step, 0], steps[step, 1]
        if task == PROLONG:
            prolong_plane(u, g, level, coarse, p, t)
            continue
        for k in range(count):
            a = count - 1 - k if back else k
            for turn in range(first, end):
                i = first + end - 1 - turn if back else turn
                row = p * box[ROWS] + i
                place, s = a * n + row * length + lo, shared(rows, row * length + lo, length)
                v, load = along(inverse, a * m + s), along(f, place)
                if task == RESTRICT_LOAD:
                    for j in range(w):
                        here[j] = load[j]
                else:
                    residual_row(u, f, level, a, row, here)
                if task == SMOOTH:
                    x = along(u, place)
                    v_left, v_right = along(inverse, a * m + s - 1), along(inverse, a * m + s + 1)
                    # Neighbours in a row share a cell (along the row) or an edge (across it).
                    sign, at = OVER, s - 1 if a == count - 1 else (count + a) * m + s
                    if entries:
                        sign, at = -OVER, (rows[row] * entries + box[NEXT + a]) * length + lo - 1
                    before, behind = along(data, at), along(data, at + 1)
                    for j in range(w):
                        pull = before[j] * v_left[j] * left[j] + behind[j] * v_right[j] * right[j]
                        x[j] += OVER * v[j] * (here[j] + sign * later[j] * pull)
                    continue
                if task == WRITE_RESIDUAL:
                    out = along(g, place)
                    for j in range(w):
                        out[j] = here[j] - (1.0 - share) * load[j] if v[j] > 0.0 else 0.0
                    continue
                for j in range(w):
                    here[j] = here[j] if v[j] > 0.0 else 0.0
                if a == count - 1:
                    for j in range(half):
                        t[j] = restricted[2 * j + 1] + 0.5 * (
                            restricted[2 * j] + restricted[2 * j + 2]
                        )
                else:
                    for j in range(half):
                        near = 0.75 * (restricted[2 * j + 1] + restricted[2 * j + 2])
                        t[j] = near + 0.25 * (restricted[2 * j] + restricted[2 * j + 3])
                for which in range(4):
                    start, weight = coarse_row(a, p, i, which, count, coarse)
                    if weight != 0.0:
                        out = along(g, start + low)
                        for j in range(half):
                            out[j] += weight * t[j]


def pass_level(
    u: Floats,
    f: Floats,
    g: Floats,
    level: tuple[Any, ...],
    coarse: Ints,
    parity: Floats,
    sweeps: int,
    way: int,
    share: float,
) -> None:
    """Smooth a level, and restrict, prolong or write the residual, in one pass."""
    # TO_COARSE: smooth from u = 0 and restrict the residual to g; without sweeps the load f.
    # FROM_COARSE: prolong g, add it and smooth in the opposite order. RESIDUAL: write share·f − Au
    # to g; 0 where a face cannot move.
    if way != FROM_COARSE:
        g.fill(0.0)
        if sweeps:
            u.fill(0.0)
    box, back = level[3], int(way == FROM_COARSE)
    steps = _steps(int(box[FIRST]), int(box[END]), int(box[REACH]), sweeps, way)
    room = np.zeros(box[LENGTH]), np.zeros(coarse[LENGTH])
    take_planes(u, f, g, level, coarse, parity, *room, steps, back, share)


@lru_cache(maxsize=200)
def _steps(first: int, end: int, reach: int, sweeps: int, way: int) -> Ints:
    """Return the planes from first to end in the order they are taken, each with its task."""
    planes, back = end - first, int(way == FROM_COARSE)
    steps: list[tuple[int, int]] = []
    last = WRITE_RESIDUAL if way == RESIDUAL else RESTRICT if sweeps else RESTRICT_LOAD
    for front in range(planes + reach * sweeps):
        if back and front < planes:
            steps.append((end - 1 - front, PROLONG))
        for stage in range(sweeps + 1 - back):
            at = front - reach * (stage + back)
            if 0 <= at < planes:
                p = end - 1 - at if back else first + at
                steps.append((p, SMOOTH if stage < sweeps else last))
    return np.array(steps, dtype=np.int64)


@part
def combine(out, to, pitch, source, stride, where, terms, weight, first, end, n):
    """Add up n places of weighted rows of a source: see `stencils.Terms`."""
    # Sums are written from `to` on, `pitch` apart; `where` tells where the source's rows start, of
    # which the entries are `stride` apart.
    last = -1
    for k in range(first, end, 4):
        a = along(source, where[terms[k, 1]] + terms[k, 2] * stride + terms[k, 3])
        m = k + 1
        b = along(source, where[terms[m, 1]] + terms[m, 2] * stride + terms[m, 3])
        m = k + 2
        c = along(source, where[terms[m, 1]] + terms[m, 2] * stride + terms[m, 3])
        m = k + 3
        d = along(source, where[terms[m, 1]] + terms[m, 2] * stride + terms[m, 3])
        o = along(out, to + terms[k, 0] * pitch)
        w0, w1, w2, w3 = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
        if terms[k, 0] != last:
            for j in range(n):
                o[j] = 0.0
        for j in range(n):
            o[j] += w0 * a[j] + w1 * b[j] + w2 * c[j] + w3 * d[j]
        last = terms[k, 0]


@part
def within(i, n):
    """Return the place i of n, or the end that it lies beyond."""
    return 0 if i < 0 else i if i < n else n - 1


@inlined
def finest_row(level, made, row, w, where, out, to):
    """Write the finest level's coefficients of w places of a row: see `hierarchy._finest_terms`."""
    law, inverse, _couplings, box, rows = level
    length, n = box[LENGTH], len(inverse) // box[COUNT]
    for e in range(len(made)):
        sign = made[e, 0]
        for k in range(4):
            near = rows[within(row + made[e, 3 * k + 2], len(rows))] * length
            where[k] = made[e, 3 * k + 1] * n + near + made[e, 3 * k + 3] + 2
        one, two = along(inverse, where[0]), along(inverse, where[1])
        x, y, o = along(law, where[2]), along(law, where[3]), along(out, to)
        to += length
        factor = -0.5 if sign == 0 else float(sign)
        if sign == 2:
            for j in range(w):
                o[j] = 1.0 / one[j] if one[j] > 0.0 else 0.0
        else:
            for j in range(w):
                free = (one[j] > 0.0) & (two[j] > 0.0)
                o[j] = factor * (x[j] + y[j]) if free else 0.0


@njit(cache=True, fastmath=True)
def galerkin(level, made, sums, coarse, slots, own, room, out, inverse):
    """Write coarse coefficients P'AP, one axis after the other, and inverses of their diagonal."""
    # `slots` are the coarse rows: see `rows`. The first, of those not in use, is left empty.
    # In the room to work in there are rows of the finest level's coefficients; four rows of sums
    # along the first axis, then sums along the second, of all but two ghosts; these split into
    # even and odd places; and where rows start. `sums` are all axes' `stencils.Terms`, one after
    # the other, and where those of each begin.
    data, _inverse, _couplings, box, rows = level
    terms, weight, way, ends, starts = sums
    fine, one, split, where = room
    four, w = along(where, starts[3]), box[LENGTH] - 4
    planes, many, length, half = box[PLANES], box[ROWS], box[LENGTH], box[LENGTH] // 2
    first, second = ends[1], ends[2]
    size, entries = (terms[first - 1, 0] + 1) * length, box[ENTRIES] or len(made)
    count, done = terms[(second if many > 1 else first) - 1, 0] + 1, 4 * size if many > 1 else 0
    pitch, lo, slot = coarse[LENGTH], coarse[LOW], 0
    n = coarse[HIGH] - lo
    for p in range(coarse[FIRST], coarse[END]):
        ready = -1
        for q in range(coarse[FIRST_ROW], coarse[END_ROW]):
            if slots[p * coarse[ROWS] + q] == slot:
                continue  # Shared with the one before.
            slot += 1
            last = 2 * q - 2 if many > 1 else 0
            start = 0 if many == 1 else ready + 1 if ready > last - 4 else last - 3
            ready = last
            for i in range(start, last + 1):
                for k in range(starts[1]):
                    plane = within(2 * p - 4 + way[k, 0], planes)
                    row = plane * many + within(i + way[k, 1], many)
                    where[k] = rows[row] * entries * length + 2
                    if box[ENTRIES] == 0:
                        where[k] = k * entries * length + 2
                        finest_row(level, made, row, w, four, fine, where[k])
                source = data if box[ENTRIES] else fine
                to = i % 4 * size + 2
                combine(one, to, length, source, length, where, terms, weight, ends[0], first, w)
            if many > 1:
                for k in range(starts[2] - starts[1]):
                    where[k] = (2 * q - 4 + way[starts[1] + k, 1]) % 4 * size + 2
                to = done + 2
                combine(one, to, length, one, length, where, terms, weight, first, second, w)
            for e in range(count):
                for j in range(half):
                    split[e * half + j] = one[done + e * length + 2 * j]
                    split[(count + e) * half + j] = one[done + e * length + 2 * j + 1]
            to, where[0], where[1] = slot * coarse[ENTRIES] * pitch, lo, lo + count * half
            combine(out, to + lo, pitch, split, half, where, terms, weight, second, ends[3], n)
            for a in range(len(own)):
                value = along(out, to + own[a] * pitch)
                v = along(inverse, a * (len(inverse) // len(own)) + slot * pitch)
                for j in range(pitch):
                    v[j] = 1.0 / value[j] if value[j] > 0.0 else 0.0
