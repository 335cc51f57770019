"""What springs and cells survive: strengths that scatter, and how they are measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError

Measure = Literal["force", "stress", "strain", "energy"]
"""What is exceeded: a spring's tension (N) or a cell's largest principal stress (Pa), the largest
strain, or the energy (J) of either."""


def drawn_strengths(
    count: int,
    strength: ArrayLike,
    scatter: float,
    weibull: float | None,
    rng: np.random.Generator,
) -> Floats:
    """Return the strengths of springs or cells, shape (count,), with their mean or Weibull scale.

    They are spread evenly over (1 ± scatter) times the mean, unless a Weibull modulus is given.
    """
    scale = np.asarray(strength, dtype=np.float64)
    if scale.shape not in ((), (count,)):
        raise ParameterError(
            f"strength: one number, or one for each of the {count} that may break, got shape "
            f"{scale.shape}"
        )
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        raise ParameterError(f"strength: must be finite and above 0, got {strength!r:.60}")
    if not 0.0 <= scatter < 1.0:
        raise ParameterError(f"scatter: a share from 0 to below 1, got {scatter}")
    if weibull is None:
        return np.asarray(scale * (1.0 + scatter * rng.uniform(-1.0, 1.0, count)))
    if not 0.0 < weibull < np.inf:
        raise ParameterError(f"weibull: a modulus above 0, got {weibull}")
    return np.asarray(scale * rng.weibull(weibull, count))


def measured(measure: str, known: Mapping[str, Callable[[], Floats]]) -> Callable[[], Floats]:
    """Return what a measure is called by, of those that a body knows."""
    if measure not in known:
        raise ParameterError(f"measure: {', '.join(map(repr, known))}, got {measure!r}")
    return known[measure]
