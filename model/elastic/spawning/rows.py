"""Sums of rows of sparse matrices, and the stiffness that follows from strains."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats, Ints


def sum_rows(matrix: sp.csr_array, index: Ints, weight: Floats) -> sp.csr_array:
    """Return a matrix of weighted sums of rows of another: `index`, shape (n, terms)."""
    # An index may be any number where its weight is zero.
    some = weight != 0.0
    start = np.append(0, np.cumsum(some.sum(axis=1))).astype(np.int32)
    shape = (len(index), matrix.shape[0])
    rows = sp.csr_array((weight[some], index[some].astype(np.int32), start), shape=shape)
    return sp.csr_array(rows @ matrix)


def stiffness_of(
    strains: sp.csr_array, face: Ints, along: Floats, cross: Floats, shear: Floats, dimension: int
) -> sp.csr_array:
    """Return SᵀDS among some of the faces."""
    # S are the stretches of the leaves axis by axis, then the shear strains of the edges. D is
    # stress times volume: by the stretch along its axis, by those across, and by the shear strain.
    n = len(along)
    own = strains if len(face) == strains.shape[1] else strains[:, face]
    stretches = [own[axis * n : (axis + 1) * n] for axis in range(dimension)]
    # Beside its own part, each stretch has one in the change of volume.
    rows = sp.csr_array(sp.vstack([own, sum(stretches[1:], start=stretches[0])], format="csr"))
    modulus = np.concatenate([*[along - cross] * dimension, shear, cross])
    stress = sp.csr_array(
        (rows.data * np.repeat(modulus, np.diff(rows.indptr)), rows.indices, rows.indptr),
        shape=rows.shape,
    )
    return sp.csr_array(rows.T.tocsr() @ stress)
