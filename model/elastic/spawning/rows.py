"""Sums of rows of sparse matrices, without the detour over a general product."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from kaju.compiling import njit

if TYPE_CHECKING:
    from .composite import Floats
    from .leaves import Index


@njit(cache=True)
def _gather(index, weight, start, column, value, width):  # type: ignore[no-untyped-def]
    many, terms = index.shape
    most = 0
    for i in range(many):
        for k in range(terms):
            if weight[i, k] != 0.0:
                most += start[index[i, k] + 1] - start[index[i, k]]
    new_start = np.zeros(many + 1, np.int32)
    new_column = np.empty(most, np.int32)
    new_value = np.empty(most)
    place = np.full(width, -1, np.int32)
    end = 0
    for i in range(many):
        first = end
        for k in range(terms):
            share = weight[i, k]
            if share == 0.0:
                continue
            for at in range(start[index[i, k]], start[index[i, k] + 1]):
                j = column[at]
                if place[j] < first:
                    place[j] = end
                    new_column[end] = j
                    new_value[end] = share * value[at]
                    end += 1
                else:
                    new_value[place[j]] += share * value[at]
        new_start[i + 1] = end
    return new_start, new_column[:end], new_value[:end]


def sum_rows(matrix: sp.csr_array, index: Index, weight: Floats) -> sp.csr_array:
    """Return a matrix whose rows are weighted sums of rows of another.

    Parameters
    ----------
    matrix : sparse array, shape (rows, columns)
    index : int array, shape (n, terms)
        Rows to add up; any number where the weight is zero.
    weight : array, shape (n, terms)
    """
    width = matrix.shape[1]
    parts = _gather(index, weight, matrix.indptr, matrix.indices, matrix.data, width)
    return sp.csr_array((parts[2], parts[1], parts[0]), shape=(len(index), width))


@njit(cache=True, inline="always")
def _add(share, row, free, start, column, value, place, first, end, new_column, new_value):  # type: ignore[no-untyped-def]
    """Add a share of a row of S to a new row; return its end."""
    for k in range(start[row], start[row + 1]):
        j = free[column[k]]
        if j < 0:
            continue
        if place[j] < first:
            place[j] = end
            new_column[end] = j
            new_value[end] = share * value[k]
            end += 1
        else:
            new_value[place[j]] += share * value[k]
    return end


@njit(cache=True)
def _stiffness(face, free, rows, touch, touched, pull, along, cross, weight, d):  # type: ignore[no-untyped-def]
    """Compressed rows of SᵀDS for some faces; `touch` and `touched` are the columns of S."""
    start, column, value = rows
    many, n = len(face), len(along)
    size = 16 * many
    new_start = np.zeros(many + 1, np.int32)
    new_column, new_value = np.empty(size, np.int32), np.empty(size)
    place = np.full(many, -1, np.int32)
    end = 0
    for i in range(many):
        first = end
        # A leaf's stretches have at most eight entries each.
        most = 0
        for at in range(touch[face[i]], touch[face[i] + 1]):
            most += d * (start[touched[at] + 1] - start[touched[at]] + 8)
        while size - end < most:
            new_column = np.concatenate((new_column, np.empty(size, np.int32)))
            new_value = np.concatenate((new_value, np.empty(size)))
            size *= 2
        for at in range(touch[face[i]], touch[face[i] + 1]):
            row = touched[at]
            if row >= n * d:
                share = pull[at] * weight[row - n * d]
                if share != 0.0:
                    end = _add(
                        share,
                        row,
                        free,
                        start,
                        column,
                        value,
                        place,
                        first,
                        end,
                        new_column,
                        new_value,
                    )
                continue
            leaf = row
            while leaf >= n:
                leaf -= n
            # A stretch calls forth stresses along all axes.
            for other in range(leaf, n * d, n):
                share = pull[at] * (along[leaf] if other == row else cross[leaf])
                end = _add(
                    share,
                    other,
                    free,
                    start,
                    column,
                    value,
                    place,
                    first,
                    end,
                    new_column,
                    new_value,
                )
        new_start[i + 1] = end
    return new_start, new_column[:end].copy(), new_value[:end].copy()


def stiffness_of(
    strains: sp.csr_array,
    face: Index,
    along: Floats,
    cross: Floats,
    shear: Floats,
    dimension: int,
) -> sp.csr_array:
    """Return SᵀDS among some of the faces.

    Parameters
    ----------
    strains : sparse array
        S: the stretches of the leaves axis by axis, then the shear strains of the edges.
    face : int array
        Columns of S to keep, as rows and columns of the stiffness.
    along, cross : arrays, shape (leaves,)
        D: stress times volume along an axis by the stretch along it, and along the others.
    shear : array, shape (edges,)
        D: shear stress times volume by the shear strain.
    """
    free = np.full(strains.shape[1], -1, np.int32)
    free[face] = np.arange(len(face))
    by_face = strains.tocsc()
    parts = _stiffness(
        face, free, (strains.indptr, strains.indices, strains.data), by_face.indptr,
        by_face.indices, by_face.data, along, cross, shear, dimension,
    )  # fmt: skip
    return sp.csr_array((parts[2], parts[1], parts[0]), shape=(len(face),) * 2)
