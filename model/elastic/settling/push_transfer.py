"""Interpolation between a grid and its parents on bodies of any form.

Along its normal a face's displacement is interpolated linearly between the parents' faces
(1; ½, ½), across it between the parents' middles (¾, ¼). At a free surface, where the
parent beyond is missing, the line is prolonged (5/4, -1/4); at a rigid one it runs to zero
(½). So a rigid rotation of the parents is a rigid rotation of the children, without which
a stiff body on a soft one would not turn. Restriction is the transpose.

One axis is coarsened after the other, and every axis looks only at the faces that are
there, so holes, odd numbers of cells and ragged outlines need no special case.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.elastic.problem import ABSENT, ACTIVE, FIXED
from kaju.model.elastic.staggered import Numbering, compact

States = NDArray[np.int8]


def coarsen(fine: Numbering) -> tuple[Numbering, sp.csr_array]:
    """Return the parents' numbering and the interpolation from parents to children."""
    states, blocks = [], []
    for axis, state in enumerate(fine.states):
        matrix = sp.eye_array(int(np.count_nonzero(state == ACTIVE)), format="csr")
        for along in range(state.ndim):
            parents = _parents(state, along, normal=along == axis)
            step = _interpolation(state, parents, along, normal=along == axis)
            matrix = sp.csr_array(matrix @ step)
            state = parents
        states.append(state)
        blocks.append(matrix)
    return Numbering(tuple(states)), sp.csr_array(sp.block_diag(blocks, format="csr"))


def _parents(state: States, axis: int, *, normal: bool) -> States:
    """Coarsen the states of one component along one axis."""
    lines = np.moveaxis(state, axis, 0)
    parents = _parents_normal(lines) if normal else _parents_across(lines)
    return np.ascontiguousarray(np.moveaxis(parents, 0, axis))


def _parents_normal(lines: States) -> States:
    """Every second face stays; one that is missing exists if a child beside it moves."""
    cells = (len(lines) - 3 + 1) // 2
    rim = np.full((1, *lines.shape[1:]), ABSENT, dtype=np.int8)
    padded = np.concatenate([lines, rim])
    kept = padded[1 : 2 * cells + 2 : 2]
    before, after = padded[0 : 2 * cells + 1 : 2], padded[2 : 2 * cells + 3 : 2]
    revived = (kept == ABSENT) & ((before == ACTIVE) | (after == ACTIVE))
    inner: States = np.where(revived, ACTIVE, kept).astype(np.int8)
    return np.concatenate([rim, inner, rim])


def _parents_across(lines: States) -> States:
    """Two children have one parent, which moves if either of them does."""
    odd = len(lines) % 2
    padded = np.concatenate([lines[:1], lines, *[lines[-1:]] * (1 + odd)])
    return np.asarray(np.maximum(padded[0::2], padded[1::2]), dtype=np.int8)


def _interpolation(fine: States, coarse: States, axis: int, *, normal: bool) -> sp.csr_array:
    """Return the weights of one axis, active children by active parents."""
    number = np.full(coarse.shape, -1, dtype=np.int64)
    number[coarse == ACTIVE] = np.arange(np.count_nonzero(coarse == ACTIVE))
    place = np.nonzero(fine == ACTIVE)
    child = place[axis].astype(np.int64) - 1
    parent = child // 2

    def look(offset: Ints) -> tuple[Ints, NDArray[np.int8]]:
        at = [*place]
        at[axis] = np.clip(parent + offset + 1, 0, coarse.shape[axis] - 1)
        return number[tuple(at)], coarse[tuple(at)]

    odd = child % 2
    zero = np.zeros_like(child)
    if normal:
        terms = [(look(zero)[0], np.where(odd, 0.5, 1.0)), (look(odd)[0], 0.5 * odd)]
    else:
        terms = _across(look, 2 * odd - 1, zero)
    row = np.concatenate([np.flatnonzero((c >= 0) & (w != 0)) for c, w in terms])
    column = np.concatenate([c[(c >= 0) & (w != 0)] for c, w in terms])
    weight = np.concatenate([w[(c >= 0) & (w != 0)] for c, w in terms])
    size = (len(child), int(np.count_nonzero(coarse == ACTIVE)))
    return compact(row, column, weight, size)


def _across(
    look: Callable[[Ints], tuple[Ints, States]], toward: Ints, zero: Ints
) -> list[tuple[Ints, Floats]]:
    """Return the three parents of a child across the normal and their weights."""
    own, _ = look(zero)
    near, near_state = look(toward)
    far, far_state = look(-toward)
    free = (near_state == ABSENT) & (far_state == ACTIVE)
    beside = near_state == ACTIVE
    weight = np.ones(len(zero))
    weight[beside] = 0.75
    weight[near_state == FIXED] = 0.5
    weight[free] = 1.25
    return [(own, weight), (near, 0.25 * beside), (far, -0.25 * free)]
