"""Loops that lay the faces between leaves; arrays and numbers only."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.compiling import njit

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


@njit(cache=True)
def look(p, a, b, quadrant, code, lower, size, near):
    """Return the leaf in a quadrant about a point: (a-, b-), (a-, b+), (a+, b-), (a+, b+)."""
    first, second = (quadrant >> 1) - 1, (quadrant & 1) - 1
    x = p[0] + (first if a == 0 else 0)
    y = p[1] + (first if a == 1 else second if b == 1 else 0)
    z = p[2] + (second if b == 2 else 0)
    return leaf_at(x, y, y if lower.shape[1] == 2 else z, code, lower, size, near)


@njit(cache=True)
def alike_around(leaf, first, second, beside, size):
    """Return the leaves across both sides of an edge, and across it, if all are of one size."""
    east, north = beside[leaf, first], beside[leaf, second]
    if east < 0 or north < 0 or size[east] != size[leaf] or size[north] != size[leaf]:
        return -1, -1, -1
    beyond = beside[east, second]
    alike = beyond >= 0 and size[beyond] == size[leaf]
    return (east, north, beyond) if alike else (-1, -1, -1)


@njit(cache=True)
def edges(code, lower, size, beside, a, b):
    """Lay the edges between axes a < b, each as long as the largest leaf around.

    Returns the point where every edge begins, its length, the leaves around there and around its
    second half (`look`; -1 for none), and the edges at the ends of every leaf along a and b.
    """
    n, d = lower.shape
    along = 3 - a - b
    of_leaf = np.full((n, 2, 2), -1, np.int64)
    point, reach = np.empty((4 * n, d), np.int64), np.empty(4 * n, np.int64)
    around = np.empty((4, 4 * n), np.int64)
    far = around if d == 2 else np.empty_like(around)
    p, count = np.zeros(3, np.int64), 0
    for leaf in range(n):
        for end in range(4):
            if of_leaf[leaf, end >> 1, end & 1] >= 0:
                continue
            for axis in range(d):
                p[axis] = lower[leaf, axis]
            p[a] += (end >> 1) * size[leaf]
            p[b] += (end & 1) * size[leaf]
            upper, right = end >> 1, end & 1
            across = alike_around(leaf, 2 * a + upper, 2 * b + right, beside, size)
            largest = size[leaf]
            if across[0] >= 0:
                own = 3 - end
                around[own, count] = leaf
                around[own ^ 2, count], around[own ^ 1, count], around[end, count] = across
                for quadrant in range(4):
                    far[quadrant, count] = around[quadrant, count]
            else:
                for quadrant in range(4):
                    other = look(p, a, b, quadrant, code, lower, size, leaf)
                    around[quadrant, count] = other
                    if other >= 0:
                        largest = max(largest, size[other])
            if across[0] < 0 and d == 3:
                before = p[along] % largest
                p[along] -= before
                for quadrant in range(4):
                    if before > 0:
                        around[quadrant, count] = look(p, a, b, quadrant, code, lower, size, leaf)
                    p[along] += largest // 2
                    far[quadrant, count] = look(p, a, b, quadrant, code, lower, size, leaf)
                    p[along] -= largest // 2
            reach[count] = largest
            for axis in range(d):
                point[count, axis] = p[axis]
            for quadrant in range(4):
                # The leaf before an edge has it at its upper end.
                first, second = 1 - (quadrant >> 1), 1 - (quadrant & 1)
                for other in (around[quadrant, count], far[quadrant, count]):
                    if other < 0:
                        continue
                    ahead = lower[other, a] + first * size[other] == p[a]
                    if ahead and lower[other, b] + second * size[other] == p[b]:
                        of_leaf[other, first, second] = count
            count += 1
    return (
        point[:count].copy(), reach[:count].copy(), around[:, :count].copy(), far[:, :count].copy(),
        of_leaf,
    )  # fmt: skip


@njit(cache=True)
def sides_of_edges(quads, far, size, length, a, sides):
    """Return what u_a is before and behind edges, along b.

    These are the sides of leaves whose displacements count and their weights, the distance between
    both, and whether there is any: that of the smaller leaf, or of the middle of one that reaches
    round the edge, which moves by the mean of its two sides.
    """
    many = quads.shape[1]
    index, weight = np.zeros((many, 4), np.int64), np.zeros((many, 4))
    offset, present = np.zeros(many), np.zeros((2, many), np.bool_)
    for edge in range(many):
        for end in range(2):
            low, high = quads[end, edge], quads[2 + end, edge]
            if low < 0 and high < 0:
                continue
            take_low = low >= 0 and (high < 0 or size[low] <= size[high])
            chosen, next_to = (low, far[end, edge]) if take_low else (high, far[2 + end, edge])
            first = second = chosen * sides + 2 * a + (1 if take_low else 0)
            if low == high:
                first, second = low * sides + 2 * a, low * sides + 2 * a + 1
            elif next_to >= 0:
                second = next_to * sides + 2 * a + (1 if take_low else 0)
            half = 0.5 if end else -0.5
            index[edge, 2 * end], index[edge, 2 * end + 1] = first, second
            weight[edge, 2 * end], weight[edge, 2 * end + 1] = half, half
            if first == second:
                weight[edge, 2 * end], weight[edge, 2 * end + 1] = 2.0 * half, 0.0
            offset[edge] += 0.5 * length[chosen]
            present[end, edge] = True
    return index, weight, offset, present
