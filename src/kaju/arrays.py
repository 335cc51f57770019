"""Arrays by what they hold, for annotations."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


def first_largest(values: Floats) -> int:
    """Return the first index whose value equals the largest one, but for rounding."""
    # Another processor rounds them in another order.
    near = values >= values.max() - 1e-9 * np.abs(values).max()
    return int(near.argmax() if near.any() else values.argmax())  # inf or NaN


def moved(points: Ints, axis: int, by: int | Ints | Flags) -> Ints:
    """Return points by their indices, shape (n, dimension), moved along an axis."""
    points = points.copy()
    points[:, axis] += by
    return points
