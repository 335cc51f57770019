"""What sparse solvers share: LU factors of symmetric matrices."""

from __future__ import annotations

from typing import Any

import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from kaju.errors import OutOfMemoryError


def factors_of(matrix: sp.sparray, order: str = "MMD_AT_PLUS_A") -> SuperLU:
    """Return factors of a symmetric matrix on the diagonal's own pivots, in `splu`'s order."""
    # Columns of unlike structure are not taken together: a third quicker in the plane.
    how: dict[str, Any] = {"permc_spec": order, "diag_pivot_thresh": 0.0, "relax": 1}
    columns = sp.csc_array(matrix)
    # One column at a time is a tenth quicker, but in space, where columns of many are long.
    how["panel_size"] = 1 if columns.shape[0] <= 3_000 else None
    try:
        return splu(columns, options={"SymmetricMode": True}, **how)
    except (MemoryError, SystemError, RuntimeError) as error:
        if "singular" in str(error):
            raise
        # SuperLU ends in any of these where memory does.
        raise OutOfMemoryError(
            f"the factors of a matrix of {columns.shape[0]:,} rows do not fit in memory; take "
            "fewer cells (a smaller resolution) or a larger tolerance, or free memory"
        ) from error
