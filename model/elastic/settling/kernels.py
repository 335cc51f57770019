"""Agents as rows of arrays: pushes one after another, compiled.

The plain twin of these functions is the agent itself: `FaceAgent.act`.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np

from kaju.model.compiling import njit


@njit(cache=True)
def push(i, indptr, target, share, stiffness, left, displacement, taken):
    """Let agent i take all of its load, yield, and pass it on; return the energy released."""
    load = left[i]
    displacement[i] += load / stiffness[i]
    left[i] -= load
    taken[i] += abs(load)
    for at in range(indptr[i], indptr[i + 1]):
        left[target[at]] += share[at] * load
    return 0.5 * (load / stiffness[i]) * load


@njit(cache=True)
def push_in_turn(
    backward, threshold, generation, weight, spawn_step, indptr, target, share, stiffness, left,
    displacement, taken,
):  # fmt: skip
    """Let every agent whose load exceeds γ act when its turn comes.

    Returns the number of pushes and the energy released.
    """
    pushes, released = 0, 0.0
    n = len(stiffness)
    for k in range(n):
        i = n - 1 - k if backward else k
        if abs(left[i]) * weight[i] > threshold:
            if spawn_step[i] == 0:
                spawn_step[i] = generation + 1
            released += push(i, indptr, target, share, stiffness, left, displacement, taken)
            pushes += 1
    return pushes, released


@njit(cache=True)
def seat(measured):
    """Set up a tournament: node k holds the better of the players at nodes 2k and 2k + 1.

    Players are faces, the larger load wins, of equal ones the lower number. Unlike in a
    heap a player keeps its seat, so that its new load is one climb of log₂ n matches.
    """
    seats = 1
    while seats < len(measured):
        seats *= 2
    tree = np.full(2 * seats, -1, dtype=np.int64)
    for i in range(len(measured)):
        tree[seats + i] = i
    for node in range(seats - 1, 0, -1):
        tree[node] = _winner(tree[2 * node], tree[2 * node + 1], measured)
    return tree


@njit(cache=True)
def _winner(first, second, measured):
    if second < 0 or (first >= 0 and measured[first] >= measured[second]):
        return first
    return second


@njit(cache=True)
def replay(tree, measured, i):
    """Play the matches of face i again after its load has changed."""
    node = (len(tree) // 2 + i) // 2
    while node > 0:
        tree[node] = _winner(tree[2 * node], tree[2 * node + 1], measured)
        node //= 2


@njit(cache=True)
def push_largest(
    count, tree, measured, threshold, generation, weight, spawn_step, indptr, target, share,
    stiffness, left, displacement, taken,
):  # fmt: skip
    """Let the agent with the largest load act, `count` times or until none exceeds γ.

    Returns the number of pushes and the energy released.
    """
    released = 0.0
    for pushes in range(count):
        i = tree[1]
        if not measured[i] > threshold:
            return pushes, released
        if spawn_step[i] == 0:
            spawn_step[i] = generation + 1
        released += push(i, indptr, target, share, stiffness, left, displacement, taken)
        measured[i] = abs(left[i]) * weight[i]
        replay(tree, measured, i)
        for at in range(indptr[i], indptr[i + 1]):
            j = target[at]
            if j < len(measured):
                measured[j] = abs(left[j]) * weight[j]
                replay(tree, measured, j)
    return count, released
