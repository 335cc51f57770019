"""The compiled loops of the hierarchy: rows of faces, in the plane and in space alike.

A *place* is the index of a face or cell in an array with ghosts around it; a vector holds all
places for one component after the other. A *level* is a tuple of arrays:

``data``: on the finest level the law (2 + pairs, places): C₁₁, C₁₂ and the moduli of the edges;
on parents' levels the stencil (rows, entries, row length); as one vector;
``inverse`` (components × places): inverse of a face's own stiffness, 0 where it cannot move;
``couplings`` (couplings, 3): of a parents' level, in which row the coefficient is, its distance
from that row's first entry, and in a vector from the place of component 0 to the other face;
``box``: integers, at the places named below;
``rows``: per row of places the row of ``data`` and ``inverse`` that says what it is like. Rows that
are like each other, nearly all of a full box, are described once, which stays in the cache.

The law itself is stated in `staggered`; here it is only fast. One pass runs several sweeps at
once, each as far behind the one before as a row reaches, so that a plane stays in the cache.
Within a row, even faces yield before odd ones; going back everything is reversed.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.compiling import along, njit, part

PLANES, ROWS, LENGTH = 0, 1, 2
"""Of the arrays with their ghosts."""
FIRST, END = 3, 4
"""Of the planes in use; two and four further those of rows, and of places in a row."""
FIRST_ROW, END_ROW, LOW, HIGH = 5, 6, 7, 8
REACH, ENTRIES, COUNT, SIZE = 9, 10, 11, 12
"""How far a row feels, entries of the stencil (0 on the finest level), components, places."""
STEP, START, NEXT = 13, 16, 20
"""Distance in places along the axis that a component is normal to; its first coupling (and the
end of all); entry of a face with its next in the row."""

GHOST = 3
"""Place of a parents' first ghost along every axis."""
WAY_UP, WAY_DOWN, ACROSS = 0, 1, 2
"""What `cross` is for."""
YIELD, HAND_OVER, HAND_OVER_ALL, WRITE = 0, 1, 2, 3
"""What is done on a plane."""


@part
def alike(rows, box, row, ahead, step):
    """Return the first place in use of what a row, or its neighbour a step ahead, is like."""
    length = box[LENGTH]
    return rows[row + ahead * (step // length)] * length + ahead * (step % length) + box[LOW]


@part
def unbalanced_by_law(u, f, level, a, row, r):
    """Write f − Au on a row of component a."""
    law, inverse, _couplings, box, rows = level
    n, m, ea, w = box[SIZE], len(inverse) // box[COUNT], box[STEP + a], box[HIGH] - box[LOW]
    s = row * box[LENGTH] + box[LOW]
    at, here, last = a * n + s, alike(rows, box, row, 0, 0), alike(rows, box, row, -1, ea)
    x, ahead, behind = along(u, at), along(u, at + ea), along(u, at - ea)
    c, before, load = along(law, here), along(law, last), along(f, at)
    d, back = along(law, m + here), along(law, m + last)
    for b in range(box[COUNT]):
        if b == a:
            continue
        eb, to, edge = box[STEP + b], b * n + s, (1 + a + b) * m
        y, up = along(u, to), along(u, to + eb)
        low, corner = along(u, to - ea), along(u, to + eb - ea)
        k, other = along(law, edge + here), along(law, edge + alike(rows, box, row, 1, eb))
        above, below = along(u, at + eb), along(u, at - eb)
        if b == (a == 0):
            # The first of the other components: what the row's own cells feel comes with it.
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


@part
def unbalanced(u, f, level, a, row, r):
    """Write f − Au on a row of component a."""
    data, _inverse, couplings, box, rows = level
    length, lo, entries = box[LENGTH], box[LOW], box[ENTRIES]
    w, s = box[HIGH] - lo, row * length + lo
    if entries == 0:
        unbalanced_by_law(u, f, level, a, row, r)
        return
    load = along(f, a * box[SIZE] + s)
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
def parents(i, normal):
    """Return the two parents of place i along one axis, and their weights."""
    one = i // 2 + 2
    if normal:
        return (one, 1.0, one, 0.0) if i % 2 == 0 else (one, 0.5, one + 1, 0.5)
    return one, 0.75, one - 1 + 2 * (i % 2), 0.25


@part
def ancestors(a, p, i, count, coarse):
    """Return the start of the four rows that the parents of a row lie in, and their weights."""
    one, weight, two, other = parents(p, a == 0)
    three, height, four, rest = parents(i, a == 1)
    if count == 2:
        three, height, four, rest = 0, 1.0, 0, 0.0
    rows, length = coarse[ROWS], coarse[LENGTH]
    one, two = (a * coarse[PLANES] + one) * rows, (a * coarse[PLANES] + two) * rows
    return (
        ((one + three) * length, weight * height),
        ((one + four) * length, weight * rest),
        ((two + three) * length, other * height),
        ((two + four) * length, other * rest),
    )


@part
def pass_plane(u, f, g, level, coarse, p, parity, task, back, share, r, t):
    """Let a plane's faces yield, hand what they leave unbalanced over to g, or write it to g."""
    # `task` is YIELD, HAND_OVER (to the parents' loads), HAND_OVER_ALL (of f), WRITE (share·f −
    # Au). Forces are summed up at one place, for that is what takes long to be compiled.
    data, inverse, _couplings, box, rows = level
    n, count, entries, length, lo = box[SIZE], box[COUNT], box[ENTRIES], box[LENGTH], box[LOW]
    first, end, w, m = box[FIRST_ROW], box[END_ROW], box[HIGH] - lo, len(inverse) // count
    # Odd faces yield second going forward, even ones going back.
    later = along(parity, (lo + 1 - back) % 2)
    left, here, right = along(r, lo - 1), along(r, lo), along(r, lo + 1)
    low, half = GHOST, coarse[HIGH] - GHOST
    handed = along(r, 2 * low - 5)
    for turn in range(count):
        a = count - 1 - turn if back else turn
        for k in range(first, end):
            i = first + end - 1 - k if back else k
            row = p * box[ROWS] + i
            place, s = a * n + row * length + lo, alike(rows, box, row, 0, 0)
            v, load = along(inverse, a * m + s), along(f, place)
            if task == HAND_OVER_ALL:
                for j in range(w):
                    here[j] = load[j]
            else:
                unbalanced(u, f, level, a, row, here)
            if task == YIELD:
                x = along(u, place)
                v_left, v_right = along(inverse, a * m + s - 1), along(inverse, a * m + s + 1)
                # Neighbours in a row share a cell (along the row) or an edge (across it).
                sign, at = 1.0, s - 1 if a == count - 1 else (count + a) * m + s
                if entries:
                    sign, at = -1.0, (rows[row] * entries + box[NEXT + a]) * length + lo - 1
                before, behind = along(data, at), along(data, at + 1)
                for j in range(w):
                    pull = before[j] * v_left[j] * left[j] + behind[j] * v_right[j] * right[j]
                    x[j] += v[j] * (here[j] + sign * later[j] * pull)
                continue
            if task == WRITE:
                out = along(g, place)
                for j in range(w):
                    out[j] = here[j] - (1.0 - share) * load[j] if v[j] > 0.0 else 0.0
                continue
            for j in range(w):
                here[j] = here[j] if v[j] > 0.0 else 0.0
            if a == count - 1:
                for j in range(half):
                    t[j] = handed[2 * j + 1] + 0.5 * (handed[2 * j] + handed[2 * j + 2])
            else:
                for j in range(half):
                    near = 0.75 * (handed[2 * j + 1] + handed[2 * j + 2])
                    t[j] = near + 0.25 * (handed[2 * j] + handed[2 * j + 3])
            for start, weight in ancestors(a, p, i, count, coarse):
                if weight != 0.0:
                    out = along(g, start + low)
                    for j in range(half):
                        out[j] += weight * t[j]


@part
def follow(u, g, level, coarse, p, t):
    """Add the parents' displacement g to the faces of a plane; those that are held keep theirs."""
    _data, inverse, _couplings, box, rows = level
    count, low, half = box[COUNT], GHOST, coarse[HIGH] - GHOST
    m = len(inverse) // count
    before, own, after = along(t, low - 1), along(t, low), along(t, low + 1)
    for a in range(count):
        for i in range(box[FIRST_ROW], box[END_ROW]):
            t[:] = 0.0
            for start, weight in ancestors(a, p, i, count, coarse):
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
def cross(u, f, g, level, coarse, parity, sweeps, way, share):
    """Cross a level in one pass."""
    # On the WAY_UP, to the parents, sweep from u = 0 and hand what is left unbalanced to their
    # loads g; without sweeps all of f. On the WAY_DOWN add their displacement g and sweep in the
    # opposite order. ACROSS write share·f − Au to g; 0 where a face cannot move.
    box, back = level[3], 1 if way == WAY_DOWN else 0
    first, reach, planes = box[FIRST], box[REACH], box[END] - box[FIRST]
    r, t = np.zeros(box[LENGTH]), np.zeros(coarse[LENGTH])
    last = HAND_OVER if sweeps else HAND_OVER_ALL
    if not back:
        g[:] = 0.0
        if sweeps:
            u[:] = 0.0
    for front in range(planes + reach * sweeps):
        if back and front < planes:
            follow(u, g, level, coarse, first + planes - 1 - front, t)
        for stage in range(sweeps + 1 - back):
            at = front - reach * (stage + back)
            if 0 <= at < planes:
                p = first + (planes - 1 - at if back else at)
                task = YIELD if stage < sweeps else WRITE if way == ACROSS else last
                pass_plane(u, f, g, level, coarse, p, parity, task, back, share, r, t)


@part
def combine(out, to, pitch, source, stride, where, terms, weight, n):
    """Add up n places of weighted rows of a source: see `stencils.Terms`."""
    # Sums are written from `to` on, `pitch` apart; `where` tells where the source's rows start, of
    # which the entries are `stride` apart.
    last = -1
    for k in range(0, len(weight), 4):
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
def law_row(level, made, row, w, out, to):
    """Write the finest level's coefficients of w places of a row: see `hierarchy._made`."""
    law, inverse, _couplings, box, rows = level
    length, n, where = box[LENGTH], len(inverse) // box[COUNT], np.zeros(4, np.int64)
    for e in range(len(made)):
        sign = made[e, 0]
        for k in range(4):
            near = min(max(row + made[e, 3 * k + 2], 0), len(rows) - 1)
            where[k] = made[e, 3 * k + 1] * n + rows[near] * length + made[e, 3 * k + 3] + 2
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
def galerkin(level, made, terms, coarse, slots, own, out, inverse):
    """Write the parents' coefficients P'AP, one axis after the other, and their own inverses."""
    # `slots` are the parents' rows: see `rows`. The first, of those not in use, is left empty.
    data, _inverse, _couplings, box, rows = level
    place0, weight0, rows0, place1, weight1, rows1, place2, weight2, _rows2 = terms
    planes, many, length, half = box[PLANES], box[ROWS], box[LENGTH], box[LENGTH] // 2
    size, entries = (place0[-1, 0] + 1) * length, box[ENTRIES] if box[ENTRIES] else len(made)
    # Four rows of sums along the first axis, then sums along the second; all but two ghosts.
    fine, one = np.zeros(4 * entries * length), np.zeros(4 * size + (place1[-1, 0] + 1) * length)
    sums, done = (place0[-1, 0] + 1, 0) if many == 1 else (place1[-1, 0] + 1, 4 * size)
    split = np.zeros(2 * sums * half)
    where, turn = np.zeros(len(rows0), np.int64), np.zeros(len(rows1), np.int64)
    both = np.array([coarse[LOW], coarse[LOW] + sums * half])
    pitch, n, slot = coarse[LENGTH], coarse[HIGH] - coarse[LOW], 0
    for p in range(coarse[FIRST], coarse[END]):
        last = -1
        for q in range(coarse[FIRST_ROW], coarse[END_ROW]):
            if slots[p * coarse[ROWS] + q] == slot:
                continue  # Like the one before.
            slot += 1
            ready, last = last, 2 * q - 2 if many > 1 else 0
            for i in range(max(ready + 1, last - 3) if many > 1 else 0, last + 1):
                for k in range(len(rows0)):
                    plane = min(max(2 * p - 4 + rows0[k, 0], 0), planes - 1)
                    row = plane * many + min(max(i + rows0[k, 1], 0), many - 1)
                    where[k] = rows[row] * entries * length + 2
                    if box[ENTRIES] == 0:
                        where[k] = k * entries * length + 2
                        law_row(level, made, row, length - 4, fine, where[k])
                source = data if box[ENTRIES] else fine
                to = i % 4 * size + 2
                combine(one, to, length, source, length, where, place0, weight0, length - 4)
            if many > 1:
                for k in range(len(rows1)):
                    turn[k] = (2 * q - 4 + rows1[k, 1]) % 4 * size + 2
                combine(one, done + 2, length, one, length, turn, place1, weight1, length - 4)
            for e in range(sums):
                for j in range(half):
                    split[e * half + j] = one[done + e * length + 2 * j]
                    split[(sums + e) * half + j] = one[done + e * length + 2 * j + 1]
            to = slot * coarse[ENTRIES] * pitch
            combine(out, to + coarse[LOW], pitch, split, half, both, place2, weight2, n)
            for a in range(len(own)):
                value = along(out, to + own[a] * pitch)
                v = along(inverse, a * (len(inverse) // len(own)) + slot * pitch)
                for j in range(pitch):
                    v[j] = 1.0 / value[j] if value[j] > 0.0 else 0.0
