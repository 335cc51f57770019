"""Loops over the leaves of a linear quadtree or octree; arrays and numbers only."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.compiling import njit, part

BITS = {2: 30, 3: 20}
"""Binary digits of a coordinate in units; the code needs as many for every axis."""


@njit(cache=True, inline="always")
def _spread2(x):
    x = np.uint64(x)
    x = (x | (x << np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
    x = (x | (x << np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
    x = (x | (x << np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    x = (x | (x << np.uint64(2))) & np.uint64(0x3333333333333333)
    return (x | (x << np.uint64(1))) & np.uint64(0x5555555555555555)


@njit(cache=True, inline="always")
def _spread3(x):
    x = np.uint64(x)
    x = (x | (x << np.uint64(32))) & np.uint64(0x001F00000000FFFF)
    x = (x | (x << np.uint64(16))) & np.uint64(0x001F0000FF0000FF)
    x = (x | (x << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    x = (x | (x << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (x | (x << np.uint64(2))) & np.uint64(0x1249249249249249)


@njit(cache=True, inline="always")
def code_of(x, y, z, d):
    """Return the Morton code of a point (units, not negative); numbers, for speed."""
    if d == 2:
        return np.int64(_spread2(x) | (_spread2(y) << np.uint64(1)))
    code = _spread3(x) | (_spread3(y) << np.uint64(1)) | (_spread3(z) << np.uint64(2))
    return np.int64(code)


@njit(cache=True)
def codes(points):
    """Return the Morton codes of points."""
    d = points.shape[1]
    found = np.empty(len(points), np.int64)
    for i in range(len(points)):
        found[i] = code_of(points[i, 0], points[i, 1], points[i, d - 1], d)
    return found


@part
def leaf_at(x, y, z, code, lower, size, near):
    """Return the leaf that holds a unit cell, -1 if none does; quick if it is `near` a leaf."""
    d = lower.shape[1]
    limit = 1 << (30 if d == 2 else 20)
    if min(x, y, z) < 0 or max(x, y, z) >= limit:
        return -1
    asked = code_of(x, y, z, d)
    # Neighbours mostly stand close to each other in the order: look there first.
    step = 1
    if code[near] <= asked:
        first = near
        while first + step < len(code) and code[first + step] <= asked:
            first += step
            step *= 2
        last = min(first + step, len(code))
    else:
        last = near
        while last - step >= 0 and code[last - step] > asked:
            last -= step
            step *= 2
        first = max(last - step, 0)
        if code[first] > asked:
            return -1
    while last - first > 1:
        middle = (first + last) >> 1
        if code[middle] <= asked:
            first = middle
        else:
            last = middle
    edge = size[first]
    inside = x - lower[first, 0] < edge and y - lower[first, 1] < edge
    return first if inside and z - lower[first, d - 1] < edge else -1


@njit(cache=True)
def find(points, code, lower, size):
    """Return the leaf that holds each unit cell, -1 where there is none."""
    d = points.shape[1]
    found = np.empty(len(points), np.int64)
    near = np.int64(0)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, d - 1]
        found[i] = leaf_at(x, y, z, code, lower, size, near)
        if found[i] >= 0:
            near = found[i]
    return found


@njit(cache=True)
def too_large(young, ways, code, lower, size, kind):
    """Mark the leaves that are too large for their neighbours among the `young`.

    `ways` are the steps to the neighbours, as x, y and z; in two dimensions z repeats y.
    Returns the marks, and which of the young have such a neighbour.
    """
    d = lower.shape[1]
    marked = np.zeros(len(code), np.bool_)
    crowded = np.zeros(len(young), np.bool_)
    for i in range(len(young)):
        leaf = young[i]
        x, y, z = lower[leaf, 0], lower[leaf, 1], lower[leaf, d - 1]
        edge = size[leaf]
        for way in range(len(ways)):
            east, north, up = ways[way, 0], ways[way, 1], ways[way, 2]
            other = leaf_at(
                x + east * edge, y + north * edge, z + up * edge, code, lower, size, leaf
            )
            if other < 0 or size[other] <= edge:
                continue
            ahead = abs(east) + abs(north) + (abs(up) if d == 3 else 0) == 1
            if size[other] > 2 * edge or (ahead and kind[other] != kind[leaf]):
                marked[other] = crowded[i] = True
    return marked, crowded


@njit(cache=True)
def number(keys):
    """Give equal keys one number, in the order in which they first appear.

    Returns the places of the first appearances, and the number of every key.
    """
    bits = 4
    while (1 << bits) < 2 * len(keys):
        bits += 1
    slots, rest = 1 << bits, np.uint64(64 - bits)
    table = np.full(slots, -1, np.int64)
    numbers = np.empty(len(keys), np.int64)
    first = np.empty(len(keys), np.int64)
    count = 0
    for i in range(len(keys)):
        # The upper digits of a product with 2⁶⁴ over the golden ratio are well mixed.
        slot = np.int64((np.uint64(keys[i]) * np.uint64(0x9E3779B97F4A7C15)) >> rest)
        while table[slot] >= 0 and keys[first[table[slot]]] != keys[i]:
            slot = (slot + 1) & (slots - 1)
        if table[slot] < 0:
            table[slot] = count
            first[count] = i
            count += 1
        numbers[i] = table[slot]
    return first[:count].copy(), numbers
