"""The compiled loops of the hierarchy: rows of faces, in the plane and in space alike.

A *place* is the index of a face or cell in an array with ghosts around it; a vector holds all
places for one component after the other. A *level* is a tuple of arrays:

``law`` (2 + pairs, places): C₁₁, C₁₂ and the moduli of the edges; empty on parents' levels;
``stencil`` (rows, entries, row length): coefficients, empty on the finest level;
``inverse`` (components × places): inverse of a face's own stiffness, 0 where it cannot move;
``couplings``, ``starts``, ``own``, ``next``: see `stencils.Stencil`;
``box``: planes, rows to the plane, row length, then first and end of the places in use, axis
by axis, and how far a row reaches;
``steps``: distance in places along the axis that each component is normal to.

The law itself is stated in `staggered`; here it is only fast. One pass runs several sweeps at
once, each as far behind the one before as a row reaches, so that a plane stays in the cache.
Within a row, even faces yield before odd ones; going back everything is reversed.
"""
# ruff: noqa: D103
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit


@njit(cache=True, fastmath=True)
def unbalanced_by_law(u, f, law, a, s, w, steps, n, r):
    """Write f − Au on the row of component a that starts at place s."""
    ea, at = steps[a], a * n + s
    x, ahead, behind = u[at : at + w], u[at + ea : at + ea + w], u[at - ea : at - ea + w]
    c, before = law[0, s : s + w], law[0, s - ea : s - ea + w]
    load = f[at : at + w]
    for j in range(w):
        r[j] = load[j] + c[j] * (ahead[j] - x[j]) - before[j] * (x[j] - behind[j])
    d, back = law[1, s : s + w], law[1, s - ea : s - ea + w]
    for b in range(len(steps)):
        if b == a:
            continue
        eb, to = steps[b], b * n + s
        y, up = u[to : to + w], u[to + eb : to + eb + w]
        low, corner = u[to - ea : to - ea + w], u[to + eb - ea : to + eb - ea + w]
        k, other = law[1 + a + b, s : s + w], law[1 + a + b, s + eb : s + eb + w]
        above, below = u[at + eb : at + eb + w], u[at - eb : at - eb + w]
        for j in range(w):
            r[j] += (
                d[j] * (up[j] - y[j])
                - back[j] * (corner[j] - low[j])
                + other[j] * (above[j] - x[j] + up[j] - corner[j])
                - k[j] * (x[j] - below[j] + y[j] - low[j])
            )


@njit(cache=True, fastmath=True)
def unbalanced_by_stencil(u, f, stencil, couplings, row, at, s, w, r):
    """Write f − Au on a row of parents: `at` is its place in u, s its start in the row."""
    load = f[at : at + w]
    for j in range(w):
        r[j] = load[j]
    here = at - couplings[0, 3]
    fours = len(couplings) - 3
    for k in range(0, fours, 4):
        far, e, i, o = couplings[k]
        a, x = stencil[row + far, e, s + i : s + i + w], u[here + o : here + o + w]
        far, e, i, o = couplings[k + 1]
        b, y = stencil[row + far, e, s + i : s + i + w], u[here + o : here + o + w]
        far, e, i, o = couplings[k + 2]
        c, z = stencil[row + far, e, s + i : s + i + w], u[here + o : here + o + w]
        far, e, i, o = couplings[k + 3]
        d, v = stencil[row + far, e, s + i : s + i + w], u[here + o : here + o + w]
        for j in range(w):
            r[j] -= a[j] * x[j] + b[j] * y[j] + c[j] * z[j] + d[j] * v[j]
    for k in range(4 * (len(couplings) // 4), len(couplings)):
        far, e, i, o = couplings[k]
        a, x = stencil[row + far, e, s + i : s + i + w], u[here + o : here + o + w]
        for j in range(w):
            r[j] -= a[j] * x[j]


@njit(cache=True, fastmath=True)
def unbalanced(u, f, level, a, row, r):
    """Write f − Au on a row of component a."""
    law, stencil, _inverse, couplings, starts, _own, _after, box, steps = level
    n = box[0] * box[1] * box[2]
    w = box[8] - box[7]
    s = row * box[2] + box[7]
    if len(law):
        unbalanced_by_law(u, f, law, a, s, w, steps, n, r)
    else:
        some = couplings[starts[a] : starts[a + 1]]
        unbalanced_by_stencil(u, f, stencil, some, row, a * n + s, box[7], w, r)


@njit(cache=True, fastmath=True)
def relax(u, f, level, a, row, later, r):
    """Let a row of component a yield: `later` says (1 or 0) which of its faces come second."""
    law, stencil, inverse, _, _, _, after, box, steps = level
    lo, w = box[7], box[8] - box[7]
    unbalanced(u, f, level, a, row, r[lo : lo + w])
    s = row * box[2] + lo
    at = a * box[0] * box[1] * box[2] + s
    x, v = u[at : at + w], inverse[at : at + w]
    v_left, v_right = inverse[at - 1 : at - 1 + w], inverse[at + 1 : at + 1 + w]
    left, here, right = r[lo - 1 : lo - 1 + w], r[lo : lo + w], r[lo + 1 : lo + 1 + w]
    if len(law):
        # Neighbours in a row share a cell (along the row) or an edge (across it).
        k, low, high = (0, s - 1, s) if a == len(steps) - 1 else (len(steps) + a, s, s + 1)
        before, behind = law[k, low : low + w], law[k, high : high + w]
        for j in range(w):
            pull = before[j] * v_left[j] * left[j] + behind[j] * v_right[j] * right[j]
            x[j] += v[j] * (here[j] + later[j] * pull)
    else:
        before = stencil[row, after[a], lo - 1 : lo - 1 + w]
        behind = stencil[row, after[a], lo : lo + w]
        for j in range(w):
            pull = before[j] * v_left[j] * left[j] + behind[j] * v_right[j] * right[j]
            x[j] += v[j] * (here[j] - later[j] * pull)


@njit(cache=True, fastmath=True)
def relax_plane(u, f, level, p, parity, backward, r):
    """Let the faces of a plane yield, component after component."""
    box, count = level[7], len(level[8])
    # Odd faces yield second going forward, even ones going back.
    start = (box[7] + 1 - backward) % 2
    later = parity[start : start + box[8] - box[7]]
    for k in range(count):
        a = count - 1 - k if backward else k
        for i in range(box[5], box[6]):
            row = p * box[1] + (box[5] + box[6] - 1 - i if backward else i)
            relax(u, f, level, a, row, later, r)


@njit(cache=True, fastmath=True)
def parents(i, normal):
    """Return the two parents of place i along one axis, and their weights."""
    one = i // 2 + 2
    if normal:
        return (one, 1.0, one, 0.0) if i % 2 == 0 else (one, 0.5, one + 1, 0.5)
    return one, 0.75, one - 1 + 2 * (i % 2), 0.25


@njit(cache=True, fastmath=True)
def add_row(out, row, weight):
    for j in range(len(out)):
        out[j] += weight * row[j]


@njit(cache=True, fastmath=True)
def gather(s, t, normal):
    """Hand a row to the parents along it: t[j] is from s[2j] to s[2j + 3]."""
    if normal:
        for j in range(len(t)):
            t[j] = s[2 * j + 1] + 0.5 * (s[2 * j] + s[2 * j + 2])
    else:
        for j in range(len(t)):
            t[j] = 0.75 * (s[2 * j + 1] + s[2 * j + 2]) + 0.25 * (s[2 * j] + s[2 * j + 3])


@njit(cache=True, fastmath=True)
def restrict_row(r, a, p, i, count, box, coarse, g, t):
    """Hand a whole row of loads (r) to the parents' loads g."""
    last, lo, w = count - 1, coarse[7], coarse[8] - coarse[7]
    gather(r[2 * lo - 5 :], t[:w], a == last)
    n = coarse[0] * coarse[1] * coarse[2]
    one, weight, two, other = parents(p, a == 0)
    if count == 2:
        three, height, four, rest = 0, 1.0, 0, 0.0
    else:
        three, height, four, rest = parents(i, a == 1)
    for plane, share in ((one, weight), (two, other)):
        for row, part in ((three, height), (four, rest)):
            if share * part != 0.0:
                at = a * n + (plane * coarse[1] + row) * coarse[2] + lo
                add_row(g[at : at + w], t[:w], share * part)


@njit(cache=True, fastmath=True)
def prolong_plane(u, g, level, coarse, p, t):
    """Add the parents' displacement g to the faces of a plane; those that are held keep theirs."""
    inverse, box, count = level[2], level[7], len(level[8])
    n, m = box[0] * box[1] * box[2], coarse[0] * coarse[1] * coarse[2]
    length = coarse[2]
    for a in range(count):
        one, weight, two, other = parents(p, a == 0)
        for i in range(box[5], box[6]):
            if count == 2:
                three, height, four, rest = 0, 1.0, 0, 0.0
            else:
                three, height, four, rest = parents(i, a == 1)
            t[:] = 0.0
            for plane, share in ((one, weight), (two, other)):
                for row, part in ((three, height), (four, rest)):
                    if share * part != 0.0:
                        at = a * m + (plane * coarse[1] + row) * length
                        add_row(t, g[at : at + length], share * part)
            at = a * n + (p * box[1] + i) * box[2] + 2 * coarse[7] - 4
            end = 2 * (coarse[8] - coarse[7])
            spread(t[coarse[7] - 1 :], u[at : at + end], inverse[at : at + end], a == count - 1)


@njit(cache=True, fastmath=True)
def spread(t, x, v, normal):
    """Add what a row's parents do: x[2j] and x[2j + 1] belong to t[j + 1]."""
    for j in range(len(x) // 2):
        if normal:
            even, odd = t[j + 1], 0.5 * (t[j + 1] + t[j + 2])
        else:
            even, odd = 0.75 * t[j + 1] + 0.25 * t[j], 0.75 * t[j + 1] + 0.25 * t[j + 2]
        x[2 * j] += even if v[2 * j] > 0.0 else 0.0
        x[2 * j + 1] += odd if v[2 * j + 1] > 0.0 else 0.0


@njit(cache=True, fastmath=True)
def descend(u, f, g, level, coarse, parity, sweeps):
    """Sweep from zero and hand what is left unbalanced to the parents, in one pass."""
    inverse, box, count = level[2], level[7], len(level[8])
    n, lo, w, reach = box[0] * box[1] * box[2], box[7], box[8] - box[7], box[9]
    r, t = np.zeros(box[2]), np.zeros(coarse[2])
    u[:] = 0.0
    g[:] = 0.0
    for front in range(box[3], box[4] + reach * sweeps):
        for sweep in range(sweeps):
            p = front - reach * sweep
            if box[3] <= p < box[4]:
                relax_plane(u, f, level, p, parity, 0, r)
        p = front - reach * sweeps
        if p < box[3]:
            continue
        for a in range(count):
            for i in range(box[5], box[6]):
                row = p * box[1] + i
                unbalanced(u, f, level, a, row, r[lo : lo + w])
                at = a * n + row * box[2] + lo
                v = inverse[at : at + w]
                for j in range(w):
                    r[lo + j] = r[lo + j] if v[j] > 0.0 else 0.0
                restrict_row(r, a, p, i, count, box, coarse, g, t)


@njit(cache=True, fastmath=True)
def ascend(u, f, g, level, coarse, parity, sweeps):
    """Add the parents' displacement and sweep in the opposite order, in one pass."""
    box = level[7]
    reach = box[9]
    r, t = np.zeros(box[2]), np.zeros(coarse[2])
    for front in range(box[4] - 1 + reach, box[3] - 1 - reach * sweeps, -1):
        if box[3] <= front - reach < box[4]:
            prolong_plane(u, g, level, coarse, front - reach, t)
        for sweep in range(sweeps):
            p = front + reach * sweep
            if box[3] <= p < box[4]:
                relax_plane(u, f, level, p, parity, 1, r)


@njit(cache=True, fastmath=True)
def residual(u, f, share, level, out):
    """Write share·f − Au; 0 where a face cannot move."""
    inverse, box, count = level[2], level[7], len(level[8])
    n, lo, w = box[0] * box[1] * box[2], box[7], box[8] - box[7]
    r = np.zeros(w)
    out[:] = 0.0
    for p in range(box[3], box[4]):
        for a in range(count):
            for i in range(box[5], box[6]):
                row = p * box[1] + i
                at = a * n + row * box[2] + lo
                unbalanced(u, f, level, a, row, r)
                o, load, v = out[at : at + w], f[at : at + w], inverse[at : at + w]
                for j in range(w):
                    o[j] = r[j] - (1.0 - share) * load[j] if v[j] > 0.0 else 0.0


@njit(cache=True, fastmath=True)
def restrict(f, g, level, coarse):
    """Hand a load to the parents."""
    box, count = level[7], len(level[8])
    n, t = box[0] * box[1] * box[2], np.zeros(coarse[2])
    g[:] = 0.0
    for p in range(box[3], box[4]):
        for a in range(count):
            for i in range(box[5], box[6]):
                at = a * n + (p * box[1] + i) * box[2]
                restrict_row(f[at : at + box[2]], a, p, i, count, box, coarse, g, t)


@njit(cache=True, fastmath=True)
def prolong(u, g, level, coarse):
    """Add the parents' displacement to the children's."""
    t = np.zeros(coarse[2])
    for p in range(level[7][3], level[7][4]):
        prolong_plane(u, g, level, coarse, p, t)


@njit(cache=True, fastmath=True)
def combine(out, source, where, place, weight, lo, hi):
    """Add up weighted rows of a source: see `stencils.Terms`."""
    last, n = -1, hi - lo
    for k in range(0, len(weight), 4):
        to, i, e, shift = place[k]
        a = source[where[i], e, lo + shift : hi + shift]
        _, i, e, shift = place[k + 1]
        b = source[where[i], e, lo + shift : hi + shift]
        _, i, e, shift = place[k + 2]
        c = source[where[i], e, lo + shift : hi + shift]
        _, i, e, shift = place[k + 3]
        d = source[where[i], e, lo + shift : hi + shift]
        o = out[to, lo:hi]
        w0, w1, w2, w3 = weight[k], weight[k + 1], weight[k + 2], weight[k + 3]
        if to != last:
            o[:] = 0.0
        for j in range(n):
            o[j] += w0 * a[j] + w1 * b[j] + w2 * c[j] + w3 * d[j]
        last = to


@njit(cache=True, fastmath=True)
def law_row(law, inverse, entries, made, steps, row, length, n, out):
    """Write the finest level's coefficients of one row: see `stencils.finest_entries`."""
    s, w = row * length + 2, length - 4
    for e in range(len(made)):
        sign, k, axis, shift, k2, axis2, shift2 = made[e]
        a, b = entries[e, 0], entries[e, 1]
        way = entries[e, 2] * (steps[0]) + entries[e, 3] * length + entries[e, 4]
        o = out[e, 2 : 2 + w]
        one, two = (
            inverse[a * n + s : a * n + s + w],
            inverse[b * n + s + way : b * n + s + way + w],
        )
        p = s + _distance(axis, shift, steps[0], length)
        q = s + _distance(axis2, shift2, steps[0], length)
        x, y = law[k, p : p + w], law[k2, q : q + w]
        if sign == 2:
            for j in range(w):
                o[j] = 1.0 / one[j] if one[j] > 0.0 else 0.0
        else:
            factor = -0.5 if sign == 0 else float(sign)
            for j in range(w):
                o[j] = factor * (x[j] + y[j]) if (one[j] > 0.0) & (two[j] > 0.0) else 0.0


@njit(cache=True)
def _distance(axis, shift, plane, length):
    return shift * (plane if axis == 0 else length if axis == 1 else 1)


@njit(cache=True, fastmath=True)
def galerkin(level, entries, made, terms, coarse, out):
    """Write the parents' coefficients P'AP: `terms` are place, weight and rows, axis by axis."""
    law, stencil, inverse, _couplings, _starts, _own, _after, box, steps = level
    place0, weight0, rows0, place1, weight1, rows1, place2, weight2, _rows2 = terms
    length, half = box[2], box[2] // 2
    n = box[0] * box[1] * box[2]
    fine = np.zeros((4, len(made), length))
    one = np.zeros((4, place0[-1, 0] + 1, length))
    two = np.zeros((place1[-1, 0] + 1, length))
    split = np.zeros((2, max(len(two), one.shape[1]), half))
    where = np.zeros(len(rows0), np.int64)
    turn, both = np.zeros(4, np.int64), np.arange(2)
    for p in range(coarse[3], coarse[4]):
        for q in range(coarse[5], coarse[6]):
            last = 2 * q - 2 if box[1] > 1 else 0
            first = 0 if box[1] == 1 else last - 3 if q == coarse[5] else last - 1
            for i in range(first, last + 1):
                for k in range(len(rows0)):
                    plane = min(max(2 * p - 4 + rows0[k, 0], 0), box[0] - 1)
                    row = min(max(i + rows0[k, 1], 0), box[1] - 1)
                    where[k] = plane * box[1] + row
                    if len(law):
                        row = where[k]
                        law_row(law, inverse, entries, made, steps, row, length, n, fine[k])
                        where[k] = k
                source = fine if len(law) else stencil
                combine(one[i % 4], source, where, place0, weight0, 2, length - 2)
            if box[1] > 1:
                for k in range(4):
                    turn[k] = (2 * q - 4 + rows1[k, 0 + 1]) % 4
                combine(two, one, turn, place1, weight1, 2, length - 2)
                before = two
            else:
                before = one[0]
            for e in range(len(before)):
                for j in range(half):
                    split[0, e, j] = before[e, 2 * j]
                    split[1, e, j] = before[e, 2 * j + 1]
            row = p * coarse[1] + q
            combine(out[row], split, both, place2, weight2, coarse[7], coarse[8])


@njit(cache=True)
def invert_own(stencil, own, inverse):
    """Write the inverse of every face's own stiffness."""
    rows, length = stencil.shape[0], stencil.shape[2]
    for a in range(len(own)):
        for row in range(rows):
            for j in range(length):
                value = stencil[row, own[a], j]
                at = (a * rows + row) * length + j
                inverse[at] = 1.0 / value if value > 0.0 else 0.0


@njit(cache=True)
def lay_moduli(kinds, table, share, law, steps):
    """Write C₁₁, C₁₂ and the moduli of the edges: see `staggered.edge_modulus`.

    `table` has columns C₁₁, C₁₂, 1/μ (infinite but for materials and rigid cells), whether a
    cell is air, whether it is rigid; its row is the kind, counted from the last for what is no
    material. `share` is what a re-entrant corner keeps.
    """
    count = len(steps)
    start = steps.sum()
    for q in range(start, len(kinds)):
        k = kinds[q]
        law[0, q], law[1, q] = table[k, 0], table[k, 1]
        for a in range(count):
            for b in range(a + 1, count):
                one, two = kinds[q - steps[a]], kinds[q - steps[b]]
                three = kinds[q - steps[a] - steps[b]]
                if k >= 0 and one == k and two == k and three == k:
                    law[1 + a + b, q] = 1.0 / table[k, 2]
                    continue
                total = air = rigid = other = 0.0
                for kind in (k, one, two, three):
                    if table[kind, 3] > 0.0:
                        air += 1.0
                    elif np.isinf(table[kind, 2]):
                        other += 1.0
                    else:
                        total += table[kind, 2]
                        rigid += table[kind, 4]
                value = 0.0
                if air + other == 0.0 and total > 0.0:
                    value = 4.0 / total
                elif air == 1.0 and other == 0.0 and rigid == 0.0:
                    value = share * 3.0 / total
                law[1 + a + b, q] = value


@njit(cache=True)
def lay_faces(code, law, steps, inverse):
    """Write the inverse of every face's own stiffness; 0 where it cannot move.

    `code` of a place is 1 if there is body, 2 if what is there holds.
    """
    count, n = len(steps), len(code)
    start = steps.sum()
    for a in range(count):
        ea, w = steps[a], n - 2 * start
        high, low = code[start : start + w], code[start - ea : start - ea + w]
        c, before = law[0, start : start + w], law[0, start - ea : start - ea + w]
        out = inverse[a * n + start : a * n + start + w]
        for j in range(w):
            out[j] = c[j] + before[j]
        for b in range(count):
            if b != a:
                eb = steps[b]
                k, other = (
                    law[1 + a + b, start : start + w],
                    law[1 + a + b, start + eb : start + eb + w],
                )
                for j in range(w):
                    out[j] += k[j] + other[j]
        for j in range(w):
            moves = ((high[j] | low[j]) == 1) & (out[j] > 0.0)
            out[j] = 1.0 / out[j] if moves else 0.0
