"""Sweeps over a block of one material, compiled: three dimensions.

As `kernels_2d`, with ``u = (ux, uy, uz)`` of shapes (nx+1, ny, nz), (nx, ny+1, nz) and
(nx, ny, nz+1), and sides left, right, front, back, bottom, top. Rows run along z; a pass
goes plane by plane along x, each sweep two planes behind the one before.
"""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit, part

from .kernels_3d_transfer import prolong_plane, restrict_row
from .kernels_rows import finish_row, relax_row

LAG = 2


@part
def shear_weights(mu, i, count, wall_low, wall_high):
    """Return the shear moduli of the edges below and above cell i of a line of cells."""
    return (
        mu * wall_low if i == 0 else mu,
        mu * wall_high if i == count - 1 else mu,
    )


@part
def balance_x(u, load, i, j, law, wall, spring, share, out):
    """Sum up what row (i, j) of the faces normal to x feels, but for the row itself.

    The answer is the stiffness that couples neighbours in the row, and a face's own stiffness
    at the row's lower end, inside and at its upper end: 0 where an end is held.
    """
    ux, uy, uz = u
    nx, ny, nz = uy.shape[0], ux.shape[1], ux.shape[2]
    c11, c12, mu = law
    f = load[0]
    if i == 0 or i == nx:
        inward, sign, cell = (1, 1.0, 0) if i == 0 else (nx - 1, -1.0, nx - 1)
        for k in range(nz):
            spread = uy[cell, j + 1, k] - uy[cell, j, k] + uz[cell, j, k + 1] - uz[cell, j, k]
            out[k] = share * f[i, j, k] + c11 * ux[inward, j, k] + sign * c12 * spread
        own = c11 + (spring[0] if i == 0 else spring[1])
        return 0.0, own, own, own
    front, back = shear_weights(mu, j, ny, wall[2], wall[3])
    before, after = max(j - 1, 0), min(j + 1, ny - 1)
    pull_front = front if j > 0 else 0.0
    pull_back = back if j < ny - 1 else 0.0
    cross_front, cross_back, cross = c12 + front, c12 + back, c12 + mu
    for k in range(nz):
        out[k] = (
            share * f[i, j, k]
            + c11 * (ux[i + 1, j, k] + ux[i - 1, j, k])
            + pull_back * ux[i, after, k]
            + pull_front * ux[i, before, k]
            + cross_back * (uy[i, j + 1, k] - uy[i - 1, j + 1, k])
            - cross_front * (uy[i, j, k] - uy[i - 1, j, k])
            + cross * ((uz[i, j, k + 1] - uz[i - 1, j, k + 1]) - (uz[i, j, k] - uz[i - 1, j, k]))
        )
    low, high = mu * wall[4], mu * wall[5]
    out[0] += (mu - low) * (uz[i, j, 0] - uz[i - 1, j, 0])
    out[nz - 1] -= (mu - high) * (uz[i, j, nz] - uz[i - 1, j, nz])
    own = 2.0 * c11 + front + back + mu
    return mu, own + low, own + mu, own + high


@part
def balance_y(u, load, i, j, law, wall, spring, share, out):
    """Sum up what row (i, j) of the faces normal to y feels, but for the row itself."""
    ux, uy, uz = u
    nx, ny, nz = uy.shape[0], ux.shape[1], ux.shape[2]
    c11, c12, mu = law
    f = load[1]
    if j == 0 or j == ny:
        inward, sign, cell = (1, 1.0, 0) if j == 0 else (ny - 1, -1.0, ny - 1)
        for k in range(nz):
            spread = ux[i + 1, cell, k] - ux[i, cell, k] + uz[i, cell, k + 1] - uz[i, cell, k]
            out[k] = share * f[i, j, k] + c11 * uy[i, inward, k] + sign * c12 * spread
        own = c11 + (spring[2] if j == 0 else spring[3])
        return 0.0, own, own, own
    left, right = shear_weights(mu, i, nx, wall[0], wall[1])
    before, after = max(i - 1, 0), min(i + 1, nx - 1)
    pull_left = left if i > 0 else 0.0
    pull_right = right if i < nx - 1 else 0.0
    cross_left, cross_right, cross = c12 + left, c12 + right, c12 + mu
    for k in range(nz):
        out[k] = (
            share * f[i, j, k]
            + c11 * (uy[i, j + 1, k] + uy[i, j - 1, k])
            + pull_right * uy[after, j, k]
            + pull_left * uy[before, j, k]
            + cross_right * (ux[i + 1, j, k] - ux[i + 1, j - 1, k])
            - cross_left * (ux[i, j, k] - ux[i, j - 1, k])
            + cross * ((uz[i, j, k + 1] - uz[i, j - 1, k + 1]) - (uz[i, j, k] - uz[i, j - 1, k]))
        )
    low, high = mu * wall[4], mu * wall[5]
    out[0] += (mu - low) * (uz[i, j, 0] - uz[i, j - 1, 0])
    out[nz - 1] -= (mu - high) * (uz[i, j, nz] - uz[i, j - 1, nz])
    own = 2.0 * c11 + left + right + mu
    return mu, own + low, own + mu, own + high


@part
def balance_z(u, load, i, j, law, wall, held, spring, share, out):
    """Sum up what row (i, j) of the faces normal to z feels, but for the row itself."""
    ux, uy, uz = u
    nx, ny, nz = uy.shape[0], ux.shape[1], ux.shape[2]
    c11, c12, mu = law
    f = load[2]
    left, right = shear_weights(mu, i, nx, wall[0], wall[1])
    front, back = shear_weights(mu, j, ny, wall[2], wall[3])
    west, east = max(i - 1, 0), min(i + 1, nx - 1)
    south, north = max(j - 1, 0), min(j + 1, ny - 1)
    pull_left = left if i > 0 else 0.0
    pull_right = right if i < nx - 1 else 0.0
    pull_front = front if j > 0 else 0.0
    pull_back = back if j < ny - 1 else 0.0
    cross_left, cross_right = c12 + left, c12 + right
    cross_front, cross_back = c12 + front, c12 + back
    for k in range(1, nz):
        out[k] = (
            share * f[i, j, k]
            + pull_right * uz[east, j, k]
            + pull_left * uz[west, j, k]
            + pull_back * uz[i, north, k]
            + pull_front * uz[i, south, k]
            + cross_right * (ux[i + 1, j, k] - ux[i + 1, j, k - 1])
            - cross_left * (ux[i, j, k] - ux[i, j, k - 1])
            + cross_back * (uy[i, j + 1, k] - uy[i, j + 1, k - 1])
            - cross_front * (uy[i, j, k] - uy[i, j, k - 1])
        )
    top = nz - 1
    spread = ux[i + 1, j, 0] - ux[i, j, 0] + uy[i, j + 1, 0] - uy[i, j, 0]
    out[0] = share * f[i, j, 0] + c12 * spread
    spread = ux[i + 1, j, top] - ux[i, j, top] + uy[i, j + 1, top] - uy[i, j, top]
    out[nz] = share * f[i, j, nz] - c12 * spread
    own = 2.0 * c11 + left + right + front + back
    low = 0.0 if held[4] else c11 + spring[4]
    high = 0.0 if held[5] else c11 + spring[5]
    return c11, low, own, high


@part
def fixed_row(axis, i, j, u, held):
    """Tell whether row (i, j) of the faces normal to an axis (x or y) is fixed as a whole."""
    if axis == 0:
        return (i == 0 and held[0]) or (i == u[0].shape[0] - 1 and held[1])
    return (j == 0 and held[2]) or (j == u[1].shape[1] - 1 and held[3])


@part
def relax_plane(u, load, i, law, wall, held, spring, pull, back):
    """Let the faces of plane i yield, the three kinds in turn, or `back`."""
    nx, ny = u[1].shape[0], u[0].shape[1]
    for turn in range(3):
        axis = 2 - turn if back else turn
        if i < 0 or i >= nx + (axis == 0):
            continue
        rows = ny + (axis == 1)
        for step in range(rows):
            j = rows - 1 - step if back else step
            if axis < 2 and fixed_row(axis, i, j, u, held):
                continue
            if axis == 0:
                couple, low, own, high = balance_x(u, load, i, j, law, wall, spring, 1.0, pull)
                row = u[0][i, j]
            elif axis == 1:
                couple, low, own, high = balance_y(u, load, i, j, law, wall, spring, 1.0, pull)
                row = u[1][i, j]
            else:
                couple, low, own, high = balance_z(
                    u, load, i, j, law, wall, held, spring, 1.0, pull
                )
                row = u[2][i, j]
            relax_row(row, pull, couple, low, own, high, back)


@part
def left_row(axis, u, load, i, j, law, wall, held, spring, share, out):
    """Write `share` of the load less the internal force on a row of faces; 0 where fixed."""
    if axis < 2 and fixed_row(axis, i, j, u, held):
        for k in range(len(out)):
            out[k] = 0.0
        return
    if axis == 0:
        couple, low, own, high = balance_x(u, load, i, j, law, wall, spring, share, out)
        row = u[0][i, j]
    elif axis == 1:
        couple, low, own, high = balance_y(u, load, i, j, law, wall, spring, share, out)
        row = u[1][i, j]
    else:
        couple, low, own, high = balance_z(u, load, i, j, law, wall, held, spring, share, out)
        row = u[2][i, j]
    finish_row(row, out, couple, low, own, high)


@njit(cache=True, fastmath=True)
def apply(u, out, law, wall, held, spring):
    """Write the stiffness times u; return u·out."""
    nx = u[1].shape[0]
    product = 0.0
    for i in range(nx + 1):
        for axis in range(3):
            if i == nx and axis > 0:
                continue
            for j in range(u[0].shape[1] + (axis == 1)):
                product += apply_row(axis, u, out, i, j, law, wall, held, spring)
    return product


@part
def apply_row(axis, u, out, i, j, law, wall, held, spring):
    """Write the stiffness times u on a row of faces; return their part of u·out."""
    row = out[0][i, j] if axis == 0 else out[1][i, j] if axis == 1 else out[2][i, j]
    value = u[0][i, j] if axis == 0 else u[1][i, j] if axis == 1 else u[2][i, j]
    left_row(axis, u, u, i, j, law, wall, held, spring, 0.0, row)
    product = 0.0
    for k in range(len(row)):
        row[k] = -row[k]
        product += value[k] * row[k]
    return product


@njit(cache=True, fastmath=True)
def cross(u, load, coarse, law, wall, held, spring, own, far, sweeps, back):
    """Cross a level in one pass, on the way to the parents or (`back`) from them.

    To them: sweep from zero and hand what is left unbalanced to their loads, `coarse`. From them:
    add their displacement, `coarse`, and sweep in the opposite order.
    """
    nx, ny, nz = u[1].shape[0], u[0].shape[1], u[0].shape[2]
    buffer, left = np.empty(nz + 2), np.empty(nz + 2)
    if not back:
        for field in coarse:
            field[:] = 0.0
        for field in u:
            field[0] = 0.0
    for step in range(nx + 1 + LAG * sweeps):
        front = nx + 1 - step if back else step
        if back and front > 0:
            prolong_plane(u, coarse, front - 1, own, far)
        if not back and front < nx:
            u[0][front + 1] = 0.0
        if not back and front < nx - 1:
            u[1][front + 1] = 0.0
            u[2][front + 1] = 0.0
        for sweep in range(sweeps):
            i = front + LAG * sweep if back else front - LAG * sweep
            relax_plane(u, load, i, law, wall, held, spring, buffer, back)
        i = front - LAG * sweeps
        if back or i < 0:
            continue
        for axis in range(3):
            if i < nx + (axis == 0):
                row = left[: nz + (axis == 2)]
                for j in range(ny + (axis == 1)):
                    left_row(axis, u, load, i, j, law, wall, held, spring, 1.0, row)
                    restrict_row(axis, row, i, j, coarse, own, far, buffer)
