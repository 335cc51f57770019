"""Where the tolerance matters: what `tolerance_at` asks for."""

from __future__ import annotations

from kaju.errors import ParameterError

from .aims import Aim
from .displacement_error import DisplacementAim

DISPLACEMENT = "displacement"
"""The displacement, wherever it is furthest off."""


def aim_of(tolerance_at: str | None) -> Aim | None:
    """Return what the tolerance is about, None for the energy norm.

    Raises
    ------
    ParameterError
        If `tolerance_at` is nothing that a tolerance can be about.
    """
    if tolerance_at is None:
        return None
    if tolerance_at == DISPLACEMENT:
        return DisplacementAim()
    raise ParameterError(f"tolerance_at: must be {DISPLACEMENT!r}, got {tolerance_at!r}")
