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
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit, part

from .kernels_rows import (
    add_row,
    finish_row,
    gather_across,
    gather_normal,
    parents_across,
    parents_normal,
    relax_row,
    spread_across,
    spread_normal,
)

LAG = 2


@part
def balance_x(ux, uy, fx, i, law, wall, spring, share, out):
    """Sum up what row i of the faces normal to x feels, but for the row itself.

    `out` gets `share` of the load plus the pull of all faces in other rows or of the other
    kind. Returned are the stiffness that couples neighbours in the row, and a face's own
    stiffness at the row's lower end, inside and at its upper end: 0 where an end is held.
    """
    nx, ny = uy.shape[0], ux.shape[1]
    c11, c12, mu = law
    if i == 0 or i == nx:
        inward, sign, cell = (1, 1.0, 0) if i == 0 else (nx - 1, -1.0, nx - 1)
        for j in range(ny):
            out[j] = (
                share * fx[i, j]
                + c11 * ux[inward, j]
                + sign * c12 * (uy[cell, j + 1] - uy[cell, j])
            )
        own = c11 + (spring[0] if i == 0 else spring[1])
        return 0.0, own, own, own
    cross = c12 + mu
    for j in range(ny):
        out[j] = (
            share * fx[i, j]
            + c11 * (ux[i + 1, j] + ux[i - 1, j])
            + cross * ((uy[i, j + 1] - uy[i - 1, j + 1]) - (uy[i, j] - uy[i - 1, j]))
        )
    # The outermost faces have a wall, or nothing, instead of a neighbour.
    low, high = mu * wall[2], mu * wall[3]
    out[0] += (mu - low) * (uy[i, 0] - uy[i - 1, 0])
    out[ny - 1] -= (mu - high) * (uy[i, ny] - uy[i - 1, ny])
    own = 2.0 * c11 + mu
    return mu, own + low, own + mu, own + high


@part
def balance_y(ux, uy, fy, i, law, wall, held, spring, share, out):
    """Sum up what row i of the faces normal to y feels, but for the row itself.

    The answer is that of `balance_x`.
    """
    nx, ny = uy.shape[0], ux.shape[1]
    c11, c12, mu = law
    left = mu * wall[0] if i == 0 else mu
    right = mu * wall[1] if i == nx - 1 else mu
    if i == 0 or i == nx - 1:
        before, after = max(i - 1, 0), min(i + 1, nx - 1)
        pull_before = left if i > 0 else 0.0
        pull_after = right if i < nx - 1 else 0.0
        for j in range(1, ny):
            out[j] = (
                share * fy[i, j]
                + (c12 + right) * (ux[i + 1, j] - ux[i + 1, j - 1])
                - (c12 + left) * (ux[i, j] - ux[i, j - 1])
                + pull_before * uy[before, j]
                + pull_after * uy[after, j]
            )
    else:
        cross = c12 + mu
        for j in range(1, ny):
            out[j] = (
                share * fy[i, j]
                + mu * (uy[i + 1, j] + uy[i - 1, j])
                + cross * ((ux[i + 1, j] - ux[i + 1, j - 1]) - (ux[i, j] - ux[i, j - 1]))
            )
    out[0] = share * fy[i, 0] + c12 * (ux[i + 1, 0] - ux[i, 0])
    out[ny] = share * fy[i, ny] - c12 * (ux[i + 1, ny - 1] - ux[i, ny - 1])
    low = 0.0 if held[2] else c11 + spring[2]
    high = 0.0 if held[3] else c11 + spring[3]
    return c11, low, 2.0 * c11 + left + right, high


@part
def relax(u, load, i, law, wall, held, spring, pull, back):
    """Let the faces of row i yield: those normal to x, then those normal to y, or `back`."""
    nx = u[1].shape[0]
    for turn in range(2):
        if (turn == 0) != back:
            fixed = (i == 0 and held[0]) or (i == nx and held[1])
            if 0 <= i <= nx and not fixed:
                couple, low, own, high = balance_x(
                    u[0], u[1], load[0], i, law, wall, spring, 1.0, pull
                )
                relax_row(u[0][i], pull, couple, low, own, high, back)
        elif 0 <= i < nx:
            couple, low, own, high = balance_y(
                u[0], u[1], load[1], i, law, wall, held, spring, 1.0, pull
            )
            relax_row(u[1][i], pull, couple, low, own, high, back)


@part
def left_x(u, load, i, law, wall, held, spring, share, out):
    """Write `share` of the load less the internal force on row i of the faces normal to x."""
    nx, ny = u[1].shape[0], u[0].shape[1]
    if (i == 0 and held[0]) or (i == nx and held[1]):
        for j in range(ny):
            out[j] = 0.0
        return
    couple, low, own, high = balance_x(u[0], u[1], load[0], i, law, wall, spring, share, out)
    finish_row(u[0][i], out, couple, low, own, high)


@part
def left_y(u, load, i, law, wall, held, spring, share, out):
    """Write `share` of the load less the internal force on row i of the faces normal to y."""
    couple, low, own, high = balance_y(u[0], u[1], load[1], i, law, wall, held, spring, share, out)
    finish_row(u[1][i], out, couple, low, own, high)


@njit(cache=True, fastmath=True)
def apply(u, out, law, wall, held, spring):
    """Write the stiffness times u; return u·out."""
    nx, ny = u[1].shape[0], u[0].shape[1]
    product = 0.0
    row = np.empty(ny + 2)
    for i in range(nx + 1):
        left_x(u, u, i, law, wall, held, spring, 0.0, row)
        for j in range(ny):
            out[0][i, j] = -row[j]
            product -= u[0][i, j] * row[j]
        if i < nx:
            left_y(u, u, i, law, wall, held, spring, 0.0, row)
            for j in range(ny + 1):
                out[1][i, j] = -row[j]
                product -= u[1][i, j] * row[j]
    return product


@part
def restrict_x(row, i, coarse, own, far, buffer):
    """Hand row i of loads on faces normal to x to the parents."""
    gather_across(row, buffer, own[2], far[2], own[3], far[3])
    first, weight, second, other = parents_normal(i)
    add_row(coarse[first], buffer, weight)
    if other != 0.0:
        add_row(coarse[second], buffer, other)


@part
def restrict_y(row, i, coarse, own, far, buffer):
    """Hand row i of loads on faces normal to y to the parents."""
    gather_normal(row, buffer)
    first, weight, second, other = parents_across(
        i, coarse.shape[0], own[0], far[0], own[1], far[1]
    )
    add_row(coarse[first], buffer, weight)
    if other != 0.0:
        add_row(coarse[second], buffer, other)


@part
def prolong_row(u, coarse, i, own, far):
    """Add the parents' displacement to row i of both kinds of faces."""
    first, weight, second, other = parents_normal(i)
    spread_across(coarse[0][first], u[0][i], own[2], far[2], own[3], far[3], weight)
    if other != 0.0:
        spread_across(coarse[0][second], u[0][i], own[2], far[2], own[3], far[3], other)
    count = coarse[1].shape[0]
    if i == 2 * count:
        return
    first, weight, second, other = parents_across(i, count, own[0], far[0], own[1], far[1])
    spread_normal(coarse[1][first], u[1][i], weight)
    if other != 0.0:
        spread_normal(coarse[1][second], u[1][i], other)


@njit(cache=True, fastmath=True)
def cross(u, load, coarse, law, wall, held, spring, own, far, sweeps, back):
    """Cross a level in one pass, on the way to the parents or (`back`) from them.

    To them: sweep from zero and hand what is left unbalanced to their loads, `coarse`. From them:
    add their displacement, `coarse`, and sweep in the opposite order.
    """
    nx, ny = u[1].shape[0], u[0].shape[1]
    buffer, left = np.empty(ny + 2), np.empty(ny + 2)
    if not back:
        coarse[0][:] = 0.0
        coarse[1][:] = 0.0
        u[0][0] = 0.0
        u[1][0] = 0.0
    for step in range(nx + 1 + LAG * sweeps):
        front = nx + 1 - step if back else step
        if back and front > 0:
            prolong_row(u, coarse, front - 1, own, far)
        if not back and front < nx:
            u[0][front + 1] = 0.0
        if not back and front < nx - 1:
            u[1][front + 1] = 0.0
        for sweep in range(sweeps):
            i = front + LAG * sweep if back else front - LAG * sweep
            relax(u, load, i, law, wall, held, spring, buffer, back)
        i = front - LAG * sweeps
        if back or i < 0:
            continue
        left_x(u, load, i, law, wall, held, spring, 1.0, left)
        restrict_x(left[:ny], i, coarse[0], own, far, buffer)
        if i < nx:
            left_y(u, load, i, law, wall, held, spring, 1.0, left)
            restrict_y(left[: ny + 1], i, coarse[1], own, far, buffer)
