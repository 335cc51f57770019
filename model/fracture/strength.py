"""When a spring breaks: its strength, told as the elongation that it does not survive."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.network import SpringNetwork

Measure = Literal["force", "strain", "energy"]
"""What is exceeded where a spring breaks: its tension (N), its strain, or its energy (J)."""


def drawn_strengths(
    count: int,
    strength: ArrayLike,
    scatter: float,
    weibull: float | None,
    rng: np.random.Generator,
) -> Floats:
    """Return the strengths of springs, shape (count,).

    Parameters
    ----------
    count : int
        Number of springs.
    strength : float or (count,) floats
        Mean of them, or of a Weibull distribution the scale; above 0.
    scatter : float
        They are spread evenly over (1 ± scatter) times the mean; from 0 to below 1.
    weibull : float or None
        Modulus of a Weibull distribution, in the place of the even spread; above 0.
    rng : numpy Generator
        Draws them.

    Raises
    ------
    ParameterError
        If a number is outside its rule.
    """
    scale = np.asarray(strength, dtype=np.float64)
    if scale.shape not in ((), (count,)):
        raise ParameterError(
            f"strength: one number, or one for each of the {count} springs, got shape {scale.shape}"
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


def elongation_limits(network: SpringNetwork, strengths: Floats, measure: Measure) -> Floats:
    """Return the elongations (m) above which springs break, shape (m,).

    Raises
    ------
    ParameterError
        If there is no such measure.
    """
    if measure == "force":
        return strengths / network.stiffness
    if measure == "strain":
        return strengths * network.initial_length
    if measure == "energy":
        return np.asarray(np.sqrt(2.0 * strengths / network.stiffness))
    raise ParameterError(f"measure: 'force', 'strain' or 'energy', got {measure!r}")
