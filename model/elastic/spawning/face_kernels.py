"""Loops that lay the faces between leaves; arrays and numbers only."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit

from .tree_kernels import leaf_at


@njit(cache=True, inline="always")
def beyond(lower, leaf, side, edge):
    """Return the unit cell past the lower corner of a leaf's side; in two dimensions z is y."""
    d = lower.shape[1]
    x, y, z = lower[leaf, 0], lower[leaf, 1], lower[leaf, d - 1]
    step = edge if side % 2 else -1
    axis = side // 2
    if axis == 0:
        x += step
    if axis == 1:
        y += step
    if axis == d - 1:
        z += step
    return x, y, z


@njit(cache=True)
def neighbours(code, lower, size):
    """Return a leaf on each side of every leaf, -1 for none: with small ones the first."""
    n, d = lower.shape
    unknown = -2
    beside = np.full((n, 2 * d), unknown, np.int64)
    for upper in (1, 0):
        for leaf in range(n):
            for side in range(upper, 2 * d, 2):
                if beside[leaf, side] != unknown:
                    continue
                x, y, z = beyond(lower, leaf, side, size[leaf])
                other = leaf_at(x, y, z, code, lower, size, leaf)
                beside[leaf, side] = other
                if other >= 0 and size[other] == size[leaf]:
                    beside[other, side ^ 1] = leaf
    return beside


@njit(cache=True)
def number_faces(beside, size):
    """Give every face a number, leaf by leaf: the smaller leaf owns one, of two alike the lower.

    Returns every leaf's own faces (-1 where smaller ones take their place), and the owner
    and its side for every face.
    """
    n, sides = beside.shape
    master = np.full((n, sides), -1, np.int64)
    owner = np.empty(n * sides, np.int64)
    owner_side = np.empty(n * sides, np.int64)
    count = 0
    for leaf in range(n):
        for side in range(sides):
            other = beside[leaf, side]
            alike = other >= 0 and size[other] == size[leaf]
            if other >= 0 and (size[other] < size[leaf] or (alike and side % 2 == 0)):
                continue
            master[leaf, side] = count
            if alike:
                master[other, side - 1] = count
            owner[count], owner_side[count] = leaf, side
            count += 1
    return master, owner[:count].copy(), owner_side[:count].copy()


@njit(cache=True)
def mean_of_faces(beside, master, code, lower, size):
    """Return the sides' displacements by those of the faces, as compressed rows.

    A side moves like its own face, or like the mean of the smaller ones in its place.
    """
    n, d = lower.shape
    many = 1 << (d - 1)
    start = np.zeros(n * 2 * d + 1, np.int32)
    for leaf in range(n):
        for side in range(2 * d):
            row = leaf * 2 * d + side
            start[row + 1] = start[row] + (1 if master[leaf, side] >= 0 else many)
    column = np.empty(start[-1], np.int32)
    weight = np.empty(start[-1])
    for leaf in range(n):
        for side in range(2 * d):
            at = start[leaf * 2 * d + side]
            if master[leaf, side] >= 0:
                column[at], weight[at] = master[leaf, side], 1.0
                continue
            for part in range(many):
                x, y, z = beyond(lower, leaf, side, size[leaf])
                half, bit = size[leaf] // 2, part
                for axis in range(d):
                    if axis == side // 2:
                        continue
                    step = half * (bit & 1)
                    bit >>= 1
                    x += step if axis == 0 else 0
                    y += step if axis == 1 else 0
                    z += step if axis == d - 1 else 0
                fine = leaf_at(x, y, z, code, lower, size, leaf)
                column[at + part], weight[at + part] = master[fine, side ^ 1], 1.0 / many
    return start, column, weight
