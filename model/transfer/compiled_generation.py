"""One generation of many loads on arrays, cell by cell, in compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats
from kaju.compiling import njit


@njit(cache=True)
def handed_over(  # type: ignore[no-untyped-def]
    start, active, beyond, copies, column, kind, size, number, arms, next_state, passed, states
) -> tuple[Flags, Floats]:
    """Book what agents hand over; return over which arms, and what reaches boundaries.

    The rows of the agent ``active[i]`` are from ``start[i]`` to ``start[i + 1]``. Returned are
    whether it hands anything over an arm, (agents, arms), and what boundaries get of it (N),
    (agents, arms, states).
    """
    goes = np.zeros(beyond.shape, dtype=np.bool_)
    back = np.zeros((*beyond.shape, states))
    for i in range(len(active)):
        for row in range(start[i], start[i + 1]):
            for emission in range(arms.shape[1]):
                if number[kind[row], emission] < 0:
                    continue
                arm = arms[column[row], emission]
                load = size[kind[row], emission] * copies[row]
                passed[active[i], arm] += load
                goes[i, arm] = True
                if beyond[i, arm] < 0:
                    back[i, arm, next_state[column[row], emission]] += load
    return goes, back


@njit(cache=True)
def gathered(  # type: ignore[no-untyped-def]
    source, own, opposite, start, beyond, copies, column, kind, per_copy, number, over, next_state,
    back, turned, accumulate, states, values,
) -> tuple[NDArray[np.int32], NDArray[np.int32], Floats, NDArray[np.int16]]:  # fmt: skip
    """Return what comes to cells, in order: cell, state and magnitude in one, copies, and arms.

    ``source[t, arm]`` is the active agent over an arm of the cell t, ``own[t]`` the one in it; -1
    where there is none. Arms, one bit each, are those over which a row comes. ``over[column, arm]``
    lists the emissions that leave over an arm, then -1.
    """
    directions, room = len(opposite), 1024
    cell, slots, amount = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room)
    bits = np.empty(room, np.int16)
    heap = np.zeros(states * values)  # copies by state and magnitude, of one cell
    came = np.zeros(states * values, np.int64)  # and over which arms
    touched = np.empty(states * values, np.int64)
    count = 0
    for t in range(len(source)):
        met = 0
        for turn in range(2 * directions):  # what neighbours hand over, then what boundaries return
            arm, home = turn % directions, turn >= directions
            i = own[t] if home else source[t, arm]
            if i < 0 or (home and beyond[i, arm] >= 0):
                continue
            if home and accumulate:
                for state in range(states):
                    if back[i, arm, state] > 0.0:
                        slot = turned[i, arm, state]
                        if heap[slot] == 0.0:
                            touched[met] = slot
                            met += 1
                        heap[slot] += back[i, arm, state]
                continue
            way, bit = (arm, 0) if home else (opposite[arm], 1 << arm)
            for row in range(start[i], start[i + 1]):
                for each in range(over.shape[2]):
                    emission = over[column[row], way, each]
                    if emission < 0:
                        break
                    which = number[kind[row], emission]
                    if which < 0:
                        continue
                    state = next_state[column[row], emission]
                    if home:
                        state = turned[i, arm, state]
                    slot = state * values + which
                    if heap[slot] == 0.0:
                        touched[met] = slot
                        met += 1
                    heap[slot] += per_copy[kind[row], emission] * copies[row]
                    came[slot] |= bit
        touched[:met].sort()
        if count + met > room:
            room = (3 * (count + met)) // 2
            cell, slots = _longer(cell, room), _longer(slots, room)
            amount, bits = _longer(amount, room), _longer(bits, room)
        for slot in touched[:met]:
            cell[count], slots[count], amount[count] = t, slot, heap[slot]
            bits[count] = came[slot]
            heap[slot], came[slot] = 0.0, 0
            count += 1
    return cell[:count], slots[:count], amount[:count], bits[:count]


@njit(cache=True)
def _longer(column: Any, room: int) -> Any:
    """Return a longer copy of a column."""
    longer = np.empty(room, column.dtype)
    longer[: len(column)] = column
    return longer
