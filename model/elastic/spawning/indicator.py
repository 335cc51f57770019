"""Where load is left unbalanced, and the error that this stands for.

Children that take their parents' displacements by interpolation feel none of its
curvature: the stress that changes from one agent to the next, ahead and beside, is the load
that they leave unbalanced. Interpolated linearly over an edge h, a displacement with the
second derivative u″ is off by a strain whose mean square is (h u″)²/12. So

    η² = V h²/12 · (2μ Σ u_a,aa² + λ Σ (div u),a² + μ Σ u_a,bb²)

is the square of the error of one agent in the energy norm, and √(Σ η² / 2U) the relative
error of all (U: strain energy).
"""

from __future__ import annotations

from typing import NamedTuple

from .balance import Balance
from .composite import Floats
from .curvature import Curvature


class Indicator(NamedTuple):
    """Per leaf the square of its error (energy norm) and its unbalanced load; both scaled."""

    square: Floats
    load: Floats


def indicate(balance: Balance, u: Floats) -> Indicator:
    """Return what every agent would leave unbalanced if its children only followed it."""
    curvature, grid = Curvature(balance), balance.grid
    bends = curvature.of(u)
    load = grid.length**grid.dimension * curvature.push(bends)
    return Indicator(curvature.energy(bends, bends), load)
