"""Sweeps over a plate of one material, compiled.

The plate is a full box of nx × ny cells; ``u = (ux, uy)`` with shapes (nx+1, ny) and
(nx, ny+1), and the load alike. ``law = (C₁₁, C₁₂, μ)``. Per side (left, right, bottom, top)
``wall`` is the weight of the shear there (0 free, 2 held), ``held`` tells whether the normal
faces are fixed, ``spring`` is the foundation's stiffness per face. The law itself is stated in
`staggered`; here it is only fast.

One pass runs several sweeps at once, each two rows behind the one before, so a row
stays in the cache until all sweeps have passed over it. The values are those of sweeps run
one after the other. Within a row, even faces yield before odd ones.
"""
# ruff: noqa: D103
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit

LAG = 2


@njit(cache=True, fastmath=True, inline="always")
def corner_weight(i, j, nx, ny, wall):
    weight = 1.0
    if i == 0:
        weight *= wall[0]
    if i == nx:
        weight *= wall[1]
    if j == 0:
        weight *= wall[2]
    if j == ny:
        weight *= wall[3]
    return weight


@njit(cache=True, fastmath=True)
def corner_shear(ux, uy, i, j, nx, ny, wall):
    weight = corner_weight(i, j, nx, ny, wall)
    if weight == 0.0:
        return 0.0
    gradient = 0.0
    if j < ny:
        gradient += ux[i, j]
    if j > 0:
        gradient -= ux[i, j - 1]
    if i < nx:
        gradient += uy[i, j]
    if i > 0:
        gradient -= uy[i - 1, j]
    return weight * gradient


@njit(cache=True, fastmath=True)
def inner_x(ux, uy, i, j, nx, ny, law, wall, spring):
    """Return minus the internal force on a face normal to x, and its stiffness."""
    left = law[2] * (
        corner_shear(ux, uy, i, j + 1, nx, ny, wall) - corner_shear(ux, uy, i, j, nx, ny, wall)
    )
    stiffness = law[2] * (
        corner_weight(i, j + 1, nx, ny, wall) + corner_weight(i, j, nx, ny, wall)
    )
    if i < nx:
        left += law[0] * (ux[i + 1, j] - ux[i, j]) + law[1] * (uy[i, j + 1] - uy[i, j])
        stiffness += law[0]
    else:
        left -= spring[1] * ux[i, j]
        stiffness += spring[1]
    if i > 0:
        left -= law[0] * (ux[i, j] - ux[i - 1, j]) + law[1] * (uy[i - 1, j + 1] - uy[i - 1, j])
        stiffness += law[0]
    else:
        left -= spring[0] * ux[i, j]
        stiffness += spring[0]
    return left, stiffness


@njit(cache=True, fastmath=True)
def inner_y(ux, uy, i, j, nx, ny, law, wall, spring):
    """Return minus the internal force on a face normal to y, and its stiffness."""
    left = law[2] * (
        corner_shear(ux, uy, i + 1, j, nx, ny, wall) - corner_shear(ux, uy, i, j, nx, ny, wall)
    )
    stiffness = law[2] * (
        corner_weight(i + 1, j, nx, ny, wall) + corner_weight(i, j, nx, ny, wall)
    )
    if j < ny:
        left += law[0] * (uy[i, j + 1] - uy[i, j]) + law[1] * (ux[i + 1, j] - ux[i, j])
        stiffness += law[0]
    else:
        left -= spring[3] * uy[i, j]
        stiffness += spring[3]
    if j > 0:
        left -= law[0] * (uy[i, j] - uy[i, j - 1]) + law[1] * (ux[i + 1, j - 1] - ux[i, j - 1])
        stiffness += law[0]
    else:
        left -= spring[2] * uy[i, j]
        stiffness += spring[2]
    return left, stiffness


@njit(cache=True, fastmath=True)
def relax_x(ux, uy, fx, i, law, wall, held, spring, buffer, backward):
    """Let the faces normal to x of row i yield."""
    nx, ny = uy.shape[0], ux.shape[1]
    if (i == 0 and held[0]) or (i == nx and held[1]):
        return
    edge = i == 0 or i == nx
    ease = 1.0 / (2.0 * law[0] + 2.0 * law[2])
    side = law[2] * ease
    if not edge:
        along, cross = law[0] * ease, (law[1] + law[2]) * ease
        ahead, behind, v, w, f = ux[i + 1], ux[i - 1], uy[i], uy[i - 1], fx[i]
        for j in range(1, ny - 1):
            buffer[j] = (
                f[j] * ease
                + along * (ahead[j] + behind[j])
                + cross * ((v[j + 1] - v[j]) - (w[j + 1] - w[j]))
            )
    row = ux[i]
    for phase in range(2):
        colour = 1 - phase if backward else phase
        if edge:
            for j in range(colour, ny, 2):
                left, k = inner_x(ux, uy, i, j, nx, ny, law, wall, spring)
                row[j] += (fx[i, j] + left) / k
            continue
        for j in range(2 - colour, ny - 1, 2):
            row[j] = buffer[j] + side * (row[j - 1] + row[j + 1])
        if colour == 0:
            left, k = inner_x(ux, uy, i, 0, nx, ny, law, wall, spring)
            row[0] += (fx[i, 0] + left) / k
        if (ny - 1) % 2 == colour and ny > 1:
            left, k = inner_x(ux, uy, i, ny - 1, nx, ny, law, wall, spring)
            row[ny - 1] += (fx[i, ny - 1] + left) / k


@njit(cache=True, fastmath=True)
def relax_y(ux, uy, fy, i, law, wall, held, spring, buffer, backward):
    """Let the faces normal to y of row i yield."""
    nx, ny = uy.shape[0], ux.shape[1]
    edge = i == 0 or i == nx - 1
    ease = 1.0 / (2.0 * law[0] + 2.0 * law[2])
    along = law[0] * ease
    if not edge:
        side, cross = law[2] * ease, (law[1] + law[2]) * ease
        ahead, behind, v, w, f = uy[i + 1], uy[i - 1], ux[i + 1], ux[i], fy[i]
        for j in range(1, ny):
            buffer[j] = (
                f[j] * ease
                + side * (ahead[j] + behind[j])
                + cross * ((v[j] - v[j - 1]) - (w[j] - w[j - 1]))
            )
    row = uy[i]
    for phase in range(2):
        colour = 1 - phase if backward else phase
        if edge:
            for j in range(2 - colour, ny, 2):
                left, k = inner_y(ux, uy, i, j, nx, ny, law, wall, spring)
                row[j] += (fy[i, j] + left) / k
        else:
            for j in range(2 - colour, ny, 2):
                row[j] = buffer[j] + along * (row[j - 1] + row[j + 1])
        if colour == 0 and not held[2]:
            left, k = inner_y(ux, uy, i, 0, nx, ny, law, wall, spring)
            row[0] += (fy[i, 0] + left) / k
        if ny % 2 == colour and not held[3]:
            left, k = inner_y(ux, uy, i, ny, nx, ny, law, wall, spring)
            row[ny] += (fy[i, ny] + left) / k


@njit(cache=True, fastmath=True)
def force_x(ux, uy, i, law, wall, held, spring, out):
    """Write minus the internal force on row i of the faces normal to x; fixed ones get 0."""
    nx, ny = uy.shape[0], ux.shape[1]
    if (i == 0 and held[0]) or (i == nx and held[1]):
        out[:ny] = 0.0
        return
    if i == 0 or i == nx:
        for j in range(ny):
            out[j] = inner_x(ux, uy, i, j, nx, ny, law, wall, spring)[0]
        return
    c11, mu, cross = law[0], law[2], law[1] + law[2]
    own = 2.0 * (c11 + mu)
    row, ahead, behind, v, w = ux[i], ux[i + 1], ux[i - 1], uy[i], uy[i - 1]
    for j in range(1, ny - 1):
        out[j] = (
            c11 * (ahead[j] + behind[j])
            + mu * (row[j - 1] + row[j + 1])
            + cross * ((v[j + 1] - v[j]) - (w[j + 1] - w[j]))
            - own * row[j]
        )
    out[0] = inner_x(ux, uy, i, 0, nx, ny, law, wall, spring)[0]
    out[ny - 1] = inner_x(ux, uy, i, ny - 1, nx, ny, law, wall, spring)[0]


@njit(cache=True, fastmath=True)
def force_y(ux, uy, i, law, wall, held, spring, out):
    """Write minus the internal force on row i of the faces normal to y; fixed ones get 0."""
    nx, ny = uy.shape[0], ux.shape[1]
    if i == 0 or i == nx - 1:
        for j in range(ny + 1):
            out[j] = inner_y(ux, uy, i, j, nx, ny, law, wall, spring)[0]
    else:
        c11, mu, cross = law[0], law[2], law[1] + law[2]
        own = 2.0 * (c11 + mu)
        row, ahead, behind, v, w = uy[i], uy[i + 1], uy[i - 1], ux[i + 1], ux[i]
        for j in range(1, ny):
            out[j] = (
                c11 * (row[j - 1] + row[j + 1])
                + mu * (ahead[j] + behind[j])
                + cross * ((v[j] - v[j - 1]) - (w[j] - w[j - 1]))
                - own * row[j]
            )
        out[0] = inner_y(ux, uy, i, 0, nx, ny, law, wall, spring)[0]
        out[ny] = inner_y(ux, uy, i, ny, nx, ny, law, wall, spring)[0]
    if held[2]:
        out[0] = 0.0
    if held[3]:
        out[ny] = 0.0


@njit(cache=True, fastmath=True)
def apply(u, out, law, wall, held, spring):
    """Write the stiffness times u; return u·out."""
    ux, uy = u
    nx, ny = uy.shape[0], ux.shape[1]
    product = 0.0
    for i in range(nx + 1):
        force_x(ux, uy, i, law, wall, held, spring, out[0][i])
        row, value = ux[i], out[0][i]
        for j in range(ny):
            value[j] = -value[j]
            product += row[j] * value[j]
        if i < nx:
            force_y(ux, uy, i, law, wall, held, spring, out[1][i])
            row, value = uy[i], out[1][i]
            for j in range(ny + 1):
                value[j] = -value[j]
                product += row[j] * value[j]
    return product


@njit(cache=True, fastmath=True)
def gather_across(row, out, own, far, count):
    """Restrict one row across the normal: the transpose of (3/4, 1/4)."""
    for j in range(count):
        out[j] = 0.75 * (row[2 * j] + row[2 * j + 1])
    for j in range(count - 1):
        out[j] += 0.25 * row[2 * j + 2]
        out[j + 1] += 0.25 * row[2 * j + 1]
    last = 2 * count - 1
    out[0] += (own[0] - 0.75) * row[0]
    out[1] += far[0] * row[0]
    out[count - 1] += (own[1] - 0.75) * row[last]
    out[count - 2] += far[1] * row[last]


@njit(cache=True, fastmath=True)
def gather_normal(row, out, count):
    """Restrict one row along the normal: the transpose of (1; 1/2, 1/2)."""
    for j in range(count + 1):
        out[j] = row[2 * j]
    for j in range(count):
        half = 0.5 * row[2 * j + 1]
        out[j] += half
        out[j + 1] += half


@njit(cache=True, fastmath=True)
def add_row(out, row, weight, count):
    for j in range(count):
        out[j] += weight * row[j]


@njit(cache=True, fastmath=True)
def restrict_x(row, i, coarse, own, far, buffer):
    """Hand row i of loads on faces normal to x to the parents."""
    count = coarse.shape[1]
    gather_across(row, buffer, own[2:], far[2:], count)
    parent = i // 2
    if i % 2 == 0:
        add_row(coarse[parent], buffer, 1.0, count)
    else:
        add_row(coarse[parent], buffer, 0.5, count)
        add_row(coarse[parent + 1], buffer, 0.5, count)


@njit(cache=True, fastmath=True)
def restrict_y(row, i, coarse, own, far, buffer):
    """Hand row i of loads on faces normal to y to the parents."""
    rows, count = coarse.shape
    gather_normal(row, buffer, count - 1)
    parent = i // 2
    near = parent - 1 if i % 2 == 0 else parent + 1
    if near < 0 or near == rows:
        side = 0 if near < 0 else 1
        away = 1 if near < 0 else rows - 2
        add_row(coarse[parent], buffer, own[side], count)
        add_row(coarse[away], buffer, far[side], count)
    else:
        add_row(coarse[parent], buffer, 0.75, count)
        add_row(coarse[near], buffer, 0.25, count)


@njit(cache=True, fastmath=True)
def restrict(load, coarse, own, far):
    """Hand a load to the parents."""
    nx, ny = load[1].shape[0], load[0].shape[1]
    buffer = np.empty(ny + 2)
    coarse[0][:] = 0.0
    coarse[1][:] = 0.0
    for i in range(nx + 1):
        restrict_x(load[0][i], i, coarse[0], own, far, buffer)
        if i < nx:
            restrict_y(load[1][i], i, coarse[1], own, far, buffer)


@njit(cache=True, fastmath=True)
def descend(u, load, coarse, law, wall, held, spring, own, far, sweeps):
    """Sweep from zero and hand what is left unbalanced to the parents, in one pass."""
    ux, uy = u
    nx, ny = uy.shape[0], ux.shape[1]
    buffer, left = np.empty(ny + 2), np.empty(ny + 2)
    coarse[0][:] = 0.0
    coarse[1][:] = 0.0
    ux[0] = 0.0
    uy[0] = 0.0
    for front in range(nx + 1 + LAG * sweeps):
        if front < nx:
            ux[front + 1] = 0.0
        if front < nx - 1:
            uy[front + 1] = 0.0
        for sweep in range(sweeps):
            i = front - LAG * sweep
            if 0 <= i <= nx:
                relax_x(ux, uy, load[0], i, law, wall, held, spring, buffer, False)
            if 0 <= i < nx:
                relax_y(ux, uy, load[1], i, law, wall, held, spring, buffer, False)
        i = front - LAG * sweeps
        if 0 <= i <= nx and not ((i == 0 and held[0]) or (i == nx and held[1])):
            force_x(ux, uy, i, law, wall, held, spring, left)
            add_row(left, load[0][i], 1.0, ny)
            restrict_x(left, i, coarse[0], own, far, buffer)
        if 0 <= i < nx:
            force_y(ux, uy, i, law, wall, held, spring, left)
            add_row(left, load[1][i], 1.0, ny + 1)
            if held[2]:
                left[0] = 0.0
            if held[3]:
                left[ny] = 0.0
            restrict_y(left, i, coarse[1], own, far, buffer)


@njit(cache=True, fastmath=True)
def spread_across(row, out, own, far, count, weight):
    """Add weight times a row of parents, interpolated across the normal."""
    a, b = 0.75 * weight, 0.25 * weight
    for j in range(1, count - 1):
        out[2 * j] += a * row[j] + b * row[j - 1]
        out[2 * j + 1] += a * row[j] + b * row[j + 1]
    last = count - 1
    out[0] += weight * (own[0] * row[0] + far[0] * row[1])
    out[1] += a * row[0] + b * row[1]
    out[2 * last] += a * row[last] + b * row[last - 1]
    out[2 * last + 1] += weight * (own[1] * row[last] + far[1] * row[last - 1])


@njit(cache=True, fastmath=True)
def spread_normal(row, out, count, weight):
    """Add weight times a row of parents, interpolated along the normal."""
    for j in range(count):
        out[2 * j] += weight * row[j]
        out[2 * j + 1] += 0.5 * weight * (row[j] + row[j + 1])
    out[2 * count] += weight * row[count]


@njit(cache=True, fastmath=True)
def prolong_row(u, coarse, i, own, far):
    """Add the parents' displacement to row i of both kinds of faces."""
    parent = i // 2
    count = coarse[0].shape[1]
    if i % 2 == 0:
        spread_across(coarse[0][parent], u[0][i], own[2:], far[2:], count, 1.0)
    else:
        spread_across(coarse[0][parent], u[0][i], own[2:], far[2:], count, 0.5)
        spread_across(coarse[0][parent + 1], u[0][i], own[2:], far[2:], count, 0.5)
    rows = coarse[1].shape[0]
    if i == 2 * rows:
        return
    near = parent - 1 if i % 2 == 0 else parent + 1
    if near < 0 or near == rows:
        side = 0 if near < 0 else 1
        away = 1 if near < 0 else rows - 2
        spread_normal(coarse[1][parent], u[1][i], count, own[side])
        spread_normal(coarse[1][away], u[1][i], count, far[side])
    else:
        spread_normal(coarse[1][parent], u[1][i], count, 0.75)
        spread_normal(coarse[1][near], u[1][i], count, 0.25)


@njit(cache=True, fastmath=True)
def prolong(u, coarse, own, far):
    """Add the parents' displacement to the children."""
    for i in range(u[0].shape[0]):
        prolong_row(u, coarse, i, own, far)


@njit(cache=True, fastmath=True)
def ascend(u, load, coarse, law, wall, held, spring, own, far, sweeps):
    """Add the parents' displacement and sweep in the opposite order, in one pass."""
    ux, uy = u
    nx, ny = uy.shape[0], ux.shape[1]
    buffer = np.empty(ny + 2)
    for front in range(nx + 1, -LAG * sweeps, -1):
        if front > 0:
            prolong_row(u, coarse, front - 1, own, far)
        for sweep in range(sweeps):
            i = front + LAG * sweep
            if 0 <= i < nx:
                relax_y(ux, uy, load[1], i, law, wall, held, spring, buffer, True)
            if 0 <= i <= nx:
                relax_x(ux, uy, load[0], i, law, wall, held, spring, buffer, True)


@njit(cache=True, fastmath=True)
def smooth(u, load, law, wall, held, spring, sweeps, backward):
    """Sweep one after the other: the plain order that the fused passes must reproduce."""
    ux, uy = u
    nx, ny = uy.shape[0], ux.shape[1]
    buffer = np.empty(ny + 2)
    for _ in range(sweeps):
        for k in range(nx + 1):
            i = nx - k if backward else k
            if not backward:
                relax_x(ux, uy, load[0], i, law, wall, held, spring, buffer, False)
            if i < nx:
                relax_y(ux, uy, load[1], i, law, wall, held, spring, buffer, backward)
            if backward:
                relax_x(ux, uy, load[0], i, law, wall, held, spring, buffer, True)
