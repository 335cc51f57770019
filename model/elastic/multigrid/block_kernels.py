"""Loops over blocks of agents; arrays and numbers only.

Arrays over the places of blocks have the shape (blocks, dimension, places): the displacement
of, or the force on, the face below each cell along every axis. The loops run over whole blocks,
halos included; results there are masked. `stride` holds the distance
of places along every axis, `scale` the moduli's unit of every block.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.compiling import njit, part
from kaju.model.elastic.multigrid.forest import ACROSS

SIDE = ACROSS + 2
SQUARE, CUBE = SIDE**2, SIDE**3


@part
def exchange_halo(u, d, n, k, beside, first, last, table):
    """Copy the halo of block k from its neighbours in `first` … `last`."""
    ways, start, into, source, heads, ends = table
    mine = k * d * n
    for way in range(len(ways)):
        other = beside[k, ways[way]]
        if first <= other < last:
            theirs = other * d * n
            for t in range(start[way], start[way + 1]):
                u[mine + into[t]] = u[theirs + source[t]]
    for way, nothing, begin, end in heads:
        other = beside[k, way]
        if first <= other < last and beside[k, nothing] < 0:
            for t in range(begin, end):
                u[mine + ends[0, t]] = u[other * d * n + ends[1, t]]


@njit(cache=True)
def exchange_halos(u, beside, table):
    """Copy the halos of all blocks."""
    for k in range(len(u)):
        exchange_halo(u.reshape(-1), u.shape[1], u.shape[2], k, beside, np.int64(0), len(u), table)


@part
def add_halo(u, d, n, k, beside, table):
    """Add the halo of block k to its neighbours: the adjoint of `exchange_halo`."""
    ways, start, into, source, heads, ends = table
    mine = k * d * n
    for way, nothing, begin, end in heads[::-1]:
        other = beside[k, way]
        if other >= 0 and beside[k, nothing] < 0:
            for t in range(begin, end):
                u[other * d * n + ends[1, t]] += u[mine + ends[0, t]]
                u[mine + ends[0, t]] = 0.0
    for way in range(len(ways) - 1, -1, -1):
        other = beside[k, ways[way]]
        if other >= 0:
            theirs = other * d * n
            for t in range(start[way], start[way + 1]):
                u[theirs + source[t]] += u[mine + into[t]]
                u[mine + into[t]] = 0.0


# Distances and lengths are written as constants: loops over unknown ones are not vectorised.
@part
def stresses(u, scale, cross, along, shear, normal, tangent):
    """Stresses of one block's cells and edges, times their volumes; rows are flat."""
    if len(u) == 2 * SQUARE:
        for i in range(SQUARE - SIDE):
            e, f = u[i + SIDE] - u[i], u[SQUARE + i + 1] - u[SQUARE + i]
            total, own = scale * cross[i] * (e + f), scale * along[i]
            normal[i] = own * e + total
            normal[SQUARE + i] = own * f + total
        for i in range(SQUARE - SIDE):
            slip = (u[SIDE + i] - u[SIDE + i - 1]) + (u[SQUARE + SIDE + i] - u[SQUARE + i])
            tangent[SIDE + i] = scale * shear[SIDE + i] * slip
        return
    for i in range(CUBE - SQUARE):
        e, f = u[i + SQUARE] - u[i], u[CUBE + i + SIDE] - u[CUBE + i]
        w = u[2 * CUBE + i + 1] - u[2 * CUBE + i]
        total, own = scale * cross[i] * (e + f + w), scale * along[i]
        normal[i] = own * e + total
        normal[CUBE + i] = own * f + total
        normal[2 * CUBE + i] = own * w + total
    for j in range(CUBE - SQUARE):
        i = j + SQUARE
        x, y, z = u[i], u[CUBE + i], u[2 * CUBE + i]
        slip = (x - u[i - SIDE]) + (y - u[CUBE + j])
        tangent[i] = scale * shear[i] * slip
        slip = (x - u[i - 1]) + (z - u[2 * CUBE + j])
        tangent[CUBE + SQUARE + i] = scale * shear[CUBE + i] * slip
        slip = (y - u[CUBE + i - 1]) + (z - u[2 * CUBE + i - SIDE])
        tangent[2 * (CUBE + SQUARE) + i] = scale * shear[2 * CUBE + i] * slip


@part
def face_forces(normal, tangent, force):
    """Write the forces of stresses on the faces: minus those that hold them."""
    if len(force) == 2 * SQUARE:
        for j in range(SQUARE - SIDE):
            i = j + SIDE
            t = tangent[i]
            force[i] = (normal[i] - normal[j]) + (tangent[i + 1] - t)
            own = normal[SQUARE + i] - normal[SQUARE + i - 1]
            force[SQUARE + i] = own + (tangent[i + SIDE] - t)
        return
    for j in range(CUBE - SQUARE):
        i = j + SQUARE
        a, b, c = tangent[i], tangent[CUBE + SQUARE + i], tangent[2 * (CUBE + SQUARE) + i]
        x = (normal[i] - normal[j]) + (tangent[i + SIDE] - a)
        y = (normal[CUBE + i] - normal[CUBE + i - SIDE]) + (tangent[i + SQUARE] - a)
        z = normal[2 * CUBE + i] - normal[2 * CUBE + i - 1]
        z += tangent[CUBE + 2 * SQUARE + i] - b
        force[i] = x + (tangent[CUBE + SQUARE + i + 1] - b)
        force[CUBE + i] = y + (tangent[2 * (CUBE + SQUARE) + i + 1] - c)
        force[2 * CUBE + i] = z + (tangent[2 * (CUBE + SQUARE) + i + SIDE] - c)


@part
def scratch(u):
    """Return arrays for the stresses and forces of one block."""
    size = u.shape[1] * u.shape[2]
    edges = SQUARE + SIDE if size == 2 * SQUARE else 3 * (CUBE + SQUARE)
    return np.zeros(size, u.dtype), np.zeros(edges, u.dtype), np.zeros(size, u.dtype)


@njit(cache=True, fastmath=True)
def apply(p, q, leaves, beside, type_of, types, scale, table):
    """Write the forces that hold leaf blocks at displacements p; return p·q."""
    cross, along, shear, _, mask, _ = types
    d, n = p.shape[1:]
    u, w = p.reshape(len(p), d * n), q.reshape(len(q), d * n)
    masks, shears = mask.reshape(len(mask), d * n), shear.reshape(len(shear), -1)
    normal, tangent, force = scratch(p)
    total = 0.0
    for k in leaves:
        exchange_halo(p.reshape(-1), d, n, k, beside, np.int64(0), len(p), table)
        g, x, y = type_of[k], u[k], w[k]
        stresses(x, scale[k], cross[g], along[g], shears[g], normal, tangent)
        face_forces(normal, tangent, force)
        m = masks[g]
        part = 0.0
        for i in range(d * n):
            f = -m[i] * force[i]
            y[i] = f
            part += f * x[i]
        total += part
    return total


@njit(cache=True, fastmath=True)
def smooth(
    u, load, first, last, forward, beside, type_of, types, own, extra, inverse, scale, table, keep,
    length,
):  # fmt: skip
    """Smooth block after block, each by Chebyshev steps with its neighbours' latest values."""
    # `forward` in the blocks' order, from zero; else in the opposite order: one is the other's
    # adjoint. The forces of irregular rows are frozen; their diagonals, `extra`, stand in for how
    # they change.
    cross, along, shear, plain, _, _ = types
    d, n = u.shape[1:]
    size = d * n
    v, loads = u.reshape(len(u), size), load.reshape(len(u), size)
    plains, shears = plain.reshape(len(plain), size), shear.reshape(len(shear), -1)
    extras, inverses = extra.reshape(len(extra), size), inverse.reshape(len(extra), size)
    normal, tangent, force = scratch(u)
    step, right = np.zeros_like(normal), np.empty_like(normal)
    for j in range(last - first):
        k = first + j if forward else last - 1 - j
        exchange_halo(u.reshape(-1), d, n, k, beside, first, k if forward else last, table)
        g, e, x, f = type_of[k], own[k], v[k], loads[k]
        if e >= 0:
            for i in range(size):
                right[i] = f[i]
        for m in range(len(length)):
            stresses(x, scale[k], cross[g], along[g], shears[g], normal, tangent)
            face_forces(normal, tangent, force)
            kept, far = keep[m], length[m]
            if e < 0:
                far /= scale[k]
                w = plains[g]
                for i in range(size):
                    z = kept * step[i] + far * w[i] * (f[i] + force[i])
                    step[i] = z
                    x[i] += z
            else:
                w, y = inverses[e], extras[e]
                for i in range(size):
                    z = kept * step[i] + far * w[i] * (right[i] + force[i])
                    step[i] = z
                    x[i] += z
                    right[i] -= y[i] * z


@njit(cache=True, fastmath=True)
def restrict(
    u, load, first, last, parent, child_index, beside, type_of, types, scale, table, transfer
):
    """Add the residuals of blocks, restricted, to the loads of their parents."""
    cross, along, shear, _, mask, _ = types
    d, n = u.shape[1:]
    size = d * n
    v, loads = u.reshape(len(u), size), load.reshape(len(u), size)
    masks, shears = mask.reshape(len(mask), size), shear.reshape(len(shear), -1)
    normal, tangent, force = scratch(u)
    start, fine, source, weight, between = transfer
    for k in range(first, last):
        exchange_halo(u.reshape(-1), d, n, k, beside, first, last, table)
        g, f, up = type_of[k], loads[k], loads[parent[k]]
        stresses(v[k], scale[k], cross[g], along[g], shears[g], normal, tangent)
        face_forces(normal, tangent, force)
        m = masks[g]
        for i in range(size):
            force[i] = m[i] * (f[i] + force[i])
        for t in range(len(between)):
            i, step = between[t]
            half = 0.5 * force[i]
            force[i - step] += half
            force[i + step] += half
        for t in range(start[child_index[k]], start[child_index[k] + 1]):
            up[source[t]] += weight[t] * force[fine[t]]


@njit(cache=True, fastmath=True)
def prolong(u, blocks, parent, child_index, transfer):
    """Add displacements interpolated from parents to blocks: the adjoint of `restrict`."""
    start, fine, source, weight, between = transfer
    size = u.shape[1] * u.shape[2]
    v, w = u.reshape(len(u), size), np.zeros(size, u.dtype)
    for k in blocks:
        x, up = v[k], v[parent[k]]
        w[:] = 0.0
        for t in range(start[child_index[k]], start[child_index[k] + 1]):
            w[fine[t]] += weight[t] * up[source[t]]
        for t in range(len(between)):
            i, step = between[t]
            w[i] = 0.5 * (w[i - step] + w[i + step])
        for i in range(size):
            x[i] += w[i]


@njit(cache=True)
def extrapolate_to_ghosts(u, blocks, beside, rules, table, ghosts, back):
    """Fill the halos of blocks, and extrapolate beyond the body as `ghost_rules` says."""
    # `back` is the adjoint: values in halos and ghosts are added to those that they follow.
    d, n = u.shape[1:]
    start, at, inward = ghosts
    if not back:
        for k in blocks:
            exchange_halo(u.reshape(-1), d, n, k, beside, np.int64(0), len(u), table)
    for k in blocks:
        x = u[k].reshape(-1)
        for turn in range(2 * d):
            side = 2 * d - 1 - turn if back else turn
            if rules[k, side] == 0:
                continue
            near, far = (2.0, -1.0) if rules[k, side] == 1 else (-1.0, 0.0)
            for t in range(start[side], start[side + 1]):
                i, one, two = at[t], at[t] + inward[side], at[t] + 2 * inward[side]
                if back:
                    x[one] += near * x[i]
                    x[two] += far * x[i]
                    x[i] = 0.0
                else:
                    x[i] = near * x[one] + far * x[two]
    if back:
        for k in blocks[::-1]:
            add_halo(u.reshape(-1), d, n, k, beside, table)


@njit(cache=True, fastmath=True)
def strain_rows(u, first, last, start, column, value, modulus, stress):
    """Write the stresses of rows; return twice their energy."""
    total = 0.0
    for row in range(first, last):
        strain = 0.0
        for t in range(start[row], start[row + 1]):
            strain += value[t] * u[column[t]]
        stress[row] = modulus[row] * strain
        total += stress[row] * strain
    return total


@njit(cache=True, fastmath=True)
def add_row_forces(f, first, last, start, column, value, stress, sign):
    """Add the forces of the stresses of rows to faces."""
    for row in range(first, last):
        s = sign * stress[row]
        for t in range(start[row], start[row + 1]):
            f[column[t]] += value[t] * s


@njit(cache=True, fastmath=True)
def second_differences(u, blocks, next_to, lateral, shear, scale, stride, squares, loads):
    """Return squares of blocks' errors; write those of their agents, and their residual loads."""
    # See `estimator`: second differences are taken within a block, and with its neighbours of the
    # same size and material, `next_to` its lower and upper end along every axis. Into empty arrays
    # nothing is written.
    d, n = u.shape[1:]
    b = SIDE - 2
    at_place = np.empty((n, d), np.int64)
    for i in range(n):
        for a in range(d):
            at_place[i, a] = (i // stride[a]) % SIDE
    square = np.zeros(len(blocks))
    for j in range(len(blocks)):
        k = blocks[j]
        whole = 0.0
        cell = 0
        for i in range(n):
            inside = True
            for a in range(d):
                inside &= 1 <= at_place[i, a] <= b
            if not inside:
                continue
            largest, part = 0.0, 0.0
            for a in range(d):
                step, place = stride[a], at_place[i, a]
                before, low = k, i - step
                if place == 1:
                    before, low = next_to[j, 2 * a], i + (b - 1) * step
                after, high = k, i + step
                if place == b:
                    after, high = next_to[j, 2 * a + 1], i - (b - 1) * step
                over = 1.0 if before < 0 or after < 0 else 0.5
                if before < 0:
                    before, low = k, i
                if after < 0:
                    after, high = k, i
                bend, volume = 0.0, 0.0
                for c in range(d):
                    across = stride[c]
                    change = u[after, c, high + across] - u[after, c, high]
                    change -= u[before, c, low + across] - u[before, c, low]
                    volume += over * change
                    if c == a:
                        bend = over * change
                part += 2.0 * shear[k] * bend * bend + lateral[k] * volume * volume
                own = 4.0 * bend * bend
                for c in range(d):
                    if c == a:
                        continue
                    across, place = stride[c], at_place[i, c]
                    at = i
                    if place == 1 and next_to[j, 2 * c] < 0:
                        at += across
                    elif place == b and next_to[j, 2 * c + 1] < 0:
                        at -= across
                    bow = u[k, a, at + across] - 2.0 * u[k, a, at] + u[k, a, at - across]
                    at += step
                    bow += u[k, a, at + across] - 2.0 * u[k, a, at] + u[k, a, at - across]
                    part += 0.25 * shear[k] * bow * bow
                    own += 0.25 * bow * bow
                largest = max(largest, own)
            if len(loads) > 0:
                loads[j, cell] = scale[k] * shear[k] * np.sqrt(largest)
            if len(squares) > 0:
                squares[j, cell] = scale[k] * part / 12.0
            whole += part
            cell += 1
        square[j] = scale[k] * whole / 12.0
    return square


@njit(cache=True)
def clean(u, leaf, type_of, mask):
    """Set all but unknowns to zero."""
    for k in range(len(u)):
        if leaf[k]:
            x, m = u[k].ravel(), mask[type_of[k]].ravel()
            for i in range(len(x)):
                x[i] *= m[i]
        else:
            u[k] = 0.0
