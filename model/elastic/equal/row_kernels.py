"""Compiled loops of multigrid over rows of faces: smoother, residual, transfers and coarse sums.

A *place* is the index of a face or cell in an array with ghosts around it; a vector holds all
places for one component after the other. Places have three axes, planes × rows × length; a body in
the plane has one row in each plane.

Several Gauss-Seidel sweeps run in one pass, each as many planes behind the one before as a row
reaches, so that a plane stays in the cache (temporal blocking). Within a row, even faces are
smoothed before odd ones; going back the order is reversed. `staggered` states the law.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.compiling import along, inlined, njit, part

Numbers = tuple[int, ...]  # Of planes, rows and places in a row, or by component

GHOST = 3  # Place of a coarse level's first ghost along every axis
SMOOTH, RESTRICT, RESTRICT_LOAD, WRITE_RESIDUAL, PROLONG = range(5)  # Tasks of a plane
OVER = 1.3
"""Faces are relaxed by so many times what balances them (Young 1954): 1.2 to 1.5 take a tenth to a
fifth of the iterations away, on plates, boxes, holes, grains, rubber and missing pixels alike."""


class LevelBox(NamedTuple):
    """The numbers of a level's arrays."""

    shape: Numbers  # Of the arrays with their ghosts: planes, rows, length
    first: Numbers  # The first of those in use, and
    end: Numbers  # the end
    components: int
    places: int
    step: Numbers  # Distance in places along the axis that a component is normal to
    reach: int  # Rows that a stencil reaches
    entries: int  # Of a stencil; 0 on the finest level
    starts: Numbers  # First coupling of every component, and the end
    after: Numbers  # Entry of a face with its next in the row, by component


class Level(NamedTuple):
    """The equations of one level: on the finest the law, on coarse ones a stencil."""

    data: Floats
    """As one vector, of the finest level C11, C12 and the moduli of the edges at all places; of
    coarse levels the coefficients of the stencil (rows, entries, length)."""
    inverse: Floats  # Of a face's own stiffness, 0 where it cannot move; components × places
    couplings: Ints
    """Of coarse levels: in which row a coefficient is, its distance from that row's first entry,
    and in a vector from the place of component 0 to the other face. Shape (couplings, 3)."""
    rows: Ints
    """Per row of places its row of `data` and `inverse`: equal rows, nearly all of a full box,
    share one, which stays in the cache."""
    box: LevelBox


@part
def shared(rows, place, length):
    """Return the place of the shared row that describes one of the first component."""
    return rows[place // length] * length + place % length


@inlined
def residual_row(u, f, data, inverse, couplings, rows, box, a, row, r):
    """Write the residual f − Au of a row of component a."""
    # The arrays come one by one: to take them from a level costs as much as a short row.
    length, lo, entries = box.shape[2], box.first[2], box.entries
    w, s = box.end[2] - lo, row * length + lo
    load = along(f, a * box.places + s)
    if entries == 0:
        n, m, ea = box.places, len(inverse) // box.components, box.step[a]
        at, here, last = a * n + s, shared(rows, s, length), shared(rows, s - ea, length)
        x, ahead, behind = along(u, at), along(u, at + ea), along(u, at - ea)
        c, before = along(data, here), along(data, last)
        d, back = along(data, m + here), along(data, m + last)
        for b in range(box.components):
            if b == a:
                continue
            eb, to, edge = box.step[b], b * n + s, (1 + a + b) * m
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
    first, last, size = box.starts[a], box.starts[a + 1], entries * length
    # Four couplings at once: the residual is read and written a quarter as often.
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
def coarse_row(a, p, i, k, count, shape):
    """Return the start of one of the four coarse rows that a row follows, and its weight."""
    plane, weight = coarse_place(p, a == 0, k // 2)
    row, height = coarse_place(i, a == 1, k % 2)
    if count == 2:
        row, height = 0, 1.0 - k % 2
    plane += a * shape[0]
    return (plane * shape[1] + row) * shape[2], weight * height


@inlined
def prolong_plane(u, g, inverse, rows, box, coarse, p, t):
    """Interpolate the coarse displacement g and add it to the faces of a plane that can move."""
    count, low, half = box.components, GHOST, coarse.end[2] - GHOST
    n, length, m = box.places, box.shape[2], len(inverse) // count
    before, own, after = along(t, low - 1), along(t, low), along(t, low + 1)
    for a in range(count):
        for i in range(box.first[1], box.end[1]):
            for j in range(len(t)):
                t[j] = 0.0
            for k in range(4):
                start, weight = coarse_row(a, p, i, k, count, coarse.shape)
                if weight != 0.0:
                    one = along(g, start)
                    for j in range(len(t)):
                        t[j] += weight * one[j]
            row, lo = p * box.shape[1] + i, 2 * low - 4
            x = along(u, a * n + row * length + lo)
            v = along(inverse, a * m + rows[row] * length + lo)
            for j in range(half):
                near = 0.75 * own[j]
                even, odd = near + 0.25 * before[j], near + 0.25 * after[j]
                if a == count - 1:
                    even, odd = own[j], 0.5 * (own[j] + after[j])
                x[2 * j] += even if v[2 * j] > 0.0 else 0.0
                x[2 * j + 1] += odd if v[2 * j + 1] > 0.0 else 0.0


@njit(cache=True, fastmath=True)
def take_planes(u, f, g, level, coarse, parity, r, t, steps, back, share):
    """Take a level's planes in turn, each for one task."""
    # The residual (or the load itself) is restricted to g, or share·f − Au written there. Residuals
    # are worked out at one place in this loop, as that is what takes long to be compiled.
    data, inverse, couplings, rows, box = level
    n, count, entries = box.places, box.components, box.entries
    many, length = box.shape[1], box.shape[2]
    first, end, lo, m = box.first[1], box.end[1], box.first[2], len(inverse) // count
    w = box.end[2] - lo
    # Odd faces yield second going forward, even ones going back.
    later = along(parity, (lo + 1 - back) % 2)
    left, here, right = along(r, lo - 1), along(r, lo), along(r, lo + 1)
    low, half = GHOST, coarse.end[2] - GHOST
    restricted = along(r, 2 * low - 5)
    for step in range(len(steps)):
        p, task = steps[step, 0], steps[step, 1]
        if task == PROLONG:
            prolong_plane(u, g, inverse, rows, box, coarse, p, t)
            continue
        for k in range(count):
            a = count - 1 - k if back else k
            for turn in range(first, end):
                i = first + end - 1 - turn if back else turn
                row = p * many + i
                place, s = a * n + row * length + lo, shared(rows, row * length + lo, length)
                v, load = along(inverse, a * m + s), along(f, place)
                if task == RESTRICT_LOAD:
                    for j in range(w):
                        here[j] = load[j]
                else:
                    residual_row(u, f, data, inverse, couplings, rows, box, a, row, here)
                if task == SMOOTH:
                    x = along(u, place)
                    v_left, v_right = along(inverse, a * m + s - 1), along(inverse, a * m + s + 1)
                    # Neighbours in a row share a cell (along the row) or an edge (across it).
                    sign, at = OVER, s - 1 if a == count - 1 else (count + a) * m + s
                    if entries:
                        sign, at = -OVER, (rows[row] * entries + box.after[a]) * length + lo - 1
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
                # The transpose of `prolong_plane`, along the row and then across.
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
                    start, weight = coarse_row(a, p, i, which, count, coarse.shape)
                    if weight != 0.0:
                        out = along(g, start + low)
                        for j in range(half):
                            out[j] += weight * t[j]


@njit(cache=True, fastmath=True)
def add_rows(out, source, inverse, where, terms, weights, to, n):
    """Add weighted rows of a source to rows, n places from one on: see `multigrid_levels`."""
    # A term is the entry it is added to; in which of the rows near, which entry there, and from
    # which place on. Moduli of the law are added where both faces, told alike, can move.
    (_, entries, long), (_, many, length) = out.shape, source.shape
    for row in range(len(where)):
        near = where[row]
        for k in range(len(terms)):
            o, w = along(out, (row * entries + terms[k, 0]) * long + to), weights[k]
            at, entry, place = near[terms[k, 1]], terms[k, 2], terms[k, 3]
            if terms.shape[1] == 4:
                x = along(source, (at * many + entry) * length + place)
                for j in range(n):
                    o[j] += w * x[j]
                continue
            x = along(source, (entry * many + at) * length + place)
            v = along(inverse, (terms[k, 5] * many + near[terms[k, 4]]) * length + terms[k, 6])
            u = along(inverse, (terms[k, 8] * many + near[terms[k, 7]]) * length + terms[k, 9])
            for j in range(n):
                o[j] += w * x[j] if (u[j] > 0.0) & (v[j] > 0.0) else 0.0


def write_residual(
    u: Floats, load: Floats, out: Floats, level: Level, coarse: LevelBox, share: float = 1.0
) -> None:
    """Write share·load − Au; 0 where a face cannot move."""
    out.fill(0.0)
    take(u, load, out, level, coarse, (WRITE_RESIDUAL,), share=share)


def take(
    u: Floats,
    f: Floats,
    g: Floats,
    level: Level,
    coarse: LevelBox,
    tasks: Numbers,
    back: int = 0,
    share: float = 1.0,
) -> None:
    """Take all tasks in one pass over the planes: see `take_planes`."""
    box = level.box
    # Every other face of a row is picked by 1, 0, 1, ...
    parity = np.resize([1.0, 0.0], box.shape[2] + 2)
    room = parity, np.zeros(box.shape[2]), np.zeros(coarse.shape[2])
    steps = _steps(box.first[0], box.end[0], box.reach, tasks, back)
    take_planes(u, f, g, level, coarse, *room, steps, back, share)


@lru_cache(maxsize=200)
def _steps(first: int, end: int, reach: int, tasks: tuple[int, ...], back: int) -> Ints:
    """Return the planes from first to end in the order they are taken, each with its task."""
    steps: list[tuple[int, int]] = []
    for front in range(end - first + reach * (len(tasks) - 1)):
        for stage, task in enumerate(tasks):
            at = front - reach * stage  # Each task as far behind the one before as a row reaches.
            if 0 <= at < end - first:
                steps.append((end - 1 - at if back else first + at, task))
    return np.array(steps, dtype=np.int64)
