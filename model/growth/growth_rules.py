"""How cells grow by what they feel: three rules by name, and the ground for one's own.

References
----------
`Compliance`: M. P. Bendsøe, O. Sigmund, *Topology Optimization*, Springer 2003, ch. 1; O. Sigmund,
Structural and Multidisciplinary Optimization 21 (2001) 120. `Remodelling`: A. Tovar et al., Journal
of Mechanical Design 128 (2006) 1205; R. Huiskes et al., Journal of Biomechanics 20 (1987) 1135 (the
lazy zone). `FullyStressed`: R. Razani, AIAA Journal 3 (1965) 2262. `Neighbours.within`: T. E.
Bruns, D. A. Tortorelli, Computer Methods in Applied Mechanics and Engineering 190 (2001) 3443.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import ClassVar, Literal

import numpy as np
from scipy.ndimage import correlate, generate_binary_structure
from scipy.optimize import brentq

from kaju.arrays import Flags, Floats, spread
from kaju.errors import require
from kaju.model.elastic.equal.krylov import dot


class Neighbours:
    """Weighted means over cells of a body, in which cells outside of it do not count."""

    def __init__(self, body: Flags, weights: Floats) -> None:
        self.body, self._weights = body, weights
        self._whole = self.sums(np.ones(np.count_nonzero(body)))

    @classmethod
    def within(cls, body: Flags, radius: float) -> Neighbours:
        """Return means whose weights fall linearly to 0 at a radius (cells)."""
        reach = max(ceil(radius) - 1, 0)
        place = np.indices((2 * reach + 1,) * body.ndim) - reach
        distance = np.sqrt((place**2).sum(axis=0))
        return cls(body, np.maximum(max(radius, 1.0) - distance, 0.0))

    @classmethod
    def across_faces(cls, body: Flags) -> Neighbours:
        """Return means over a cell and those beside it, itself as much as all others."""
        # With less weight for itself, a checkerboard would feel its opposite, and grow.
        weights = generate_binary_structure(body.ndim, 1).astype(np.float64)
        weights[(1,) * body.ndim] = 2 * body.ndim
        return cls(body, weights)

    def sums(self, values: Floats) -> Floats:
        """Return the weighted sums of the cells' values."""
        whole = spread(values, self.body)
        return np.asarray(correlate(whole, self._weights, mode="constant")[self.body])

    def means(self, values: Floats) -> Floats:
        """Return the weighted means of the cells' values."""
        return np.asarray(self.sums(values) / self._whole)

    def handed_back(self, values: Floats) -> Floats:
        """Return the derivative by the cells' values of a sum of means with these factors."""
        return self.sums(values / self._whole)


_LEAST = 1e-3  # density that a cell keeps where densities are factors
_DEAREST = 100.0
"""Logarithm of a price at which nothing grows, and of its inverse, at which all does: wishes that
differ by more than e to its power are beyond what floating-point numbers hold of energies."""


@dataclass(frozen=True, eq=False)
class Felt:
    """What the cells of a body feel at a step; arrays have one entry for each, row by row."""

    step: int  # steps taken before
    density: Floats  # share of a cell that is filled, 0 to 1: gives its stiffness and volume
    design: Floats  # what a rule changes: the density, or what it is the mean of over neighbours
    energy: Floats  # stored in each cell (J), with its share of the edges round it
    slope: Floats  # by how much the compliance F·u grows with the density (J); not above 0
    von_mises: Callable[[], Floats]  # equivalent stress (Pa) of whole material at a cell's strain
    volume: float  # share of the body that was asked for
    around: Neighbours  # means over the cells within the filter's radius
    beside: Neighbours  # means over a cell and those beside it
    cell_volume: float  # in m³


class GrowthRule:
    """How cells grow: override `grow`, and what else differs.

    Examples
    --------
    Cells that carry less than the mean fade by a tenth, the others grow by a tenth:

    >>> import numpy as np
    >>> import kaju
    >>> from kaju.model.growth.growth_rules import GrowthRule
    >>> class Tenths(GrowthRule):
    ...     def grow(self, felt):
    ...         carries = felt.energy > felt.energy.mean()
    ...         return np.clip(felt.design * np.where(carries, 1.1, 0.9), 0.01, 1.0)
    ...
    >>> grown = kaju.GrowthModel(kaju.load_scene("plate.toml"), rule=Tenths()).run(5)
    >>> len(grown.history)
    6
    """

    name: ClassVar[str] = "own"
    smooth: bool = False  # whether the density is the mean of the design within the filter's radius
    holds_volume: bool = False  # whether the volume stays what was asked for
    least_stiffness: float = 1e-9  # share of its stiffness that a cell without density keeps
    patience: int = 0  # steps before which a body is not at rest

    def penalty(self, step: int) -> float:
        """Return the power p of the density that the stiffness follows at a step."""
        return 3.0

    def prepare(self, felt: Felt) -> None:
        """Look at the body before its first step."""

    def grow(self, felt: Felt) -> Floats:
        """Return the next design, shape (n,), from 0 to 1."""
        raise NotImplementedError


class Compliance(GrowthRule):
    """Least compliance of a given volume: optimality criteria.

    A cell grows by the root of what the compliance loses by it, beside a price that all pay
    alike, and which keeps the volume.

    `filter`: what is averaged over the cells within the filter's radius; `penalty`: power of the
    density that the stiffness follows, 1 or more; `move`: how far a density may change in a step,
    above 0, at most 1.
    """

    name = "compliance"
    holds_volume = True

    def __init__(
        self,
        filter: Literal["density", "sensitivity"] = "density",
        penalty: float = 3.0,
        move: float = 0.2,
    ) -> None:
        names = ("density", "sensitivity")
        require(filter in names, f"filter: 'density' or 'sensitivity', got {filter!r}")
        require(1.0 <= penalty < 100.0, f"penalty: a power of 1 or more, got {penalty}")
        require(0.0 < move <= 1.0, f"move: above 0, at most 1, got {move}")
        self.smooth, self._penalty, self._move = filter == "density", penalty, move

    def penalty(self, step: int) -> float:
        """Return the same power at every step."""
        return self._penalty

    def grow(self, felt: Felt) -> Floats:
        """Return what grows most where it helps most."""
        x, around = felt.design, felt.around
        if self.smooth:
            slope = around.handed_back(felt.slope)
            weight = around.handed_back(np.ones_like(x))  # of the sum of all means
        else:
            slope = around.means(x * felt.slope) / np.maximum(x, 1e-3)
            weight = np.ones_like(x)
        wish = x * np.sqrt(np.maximum(-slope, 0.0) / weight)
        wish /= wish.max() or 1.0
        low, high = np.maximum(x - self._move, 0.0), np.minimum(x + self._move, 1.0)

        def missing(price: float) -> float:
            grown = np.clip(wish * np.exp(-price), low, high)
            return dot(weight, grown) / len(x) - felt.volume

        price = _DEAREST  # its logarithm
        if missing(-_DEAREST) <= 0.0:
            price = -_DEAREST
        elif missing(_DEAREST) < 0.0:
            price = float(brentq(missing, -_DEAREST, _DEAREST, xtol=1e-15, rtol=1e-15))
        return np.asarray(np.clip(wish * np.exp(-price), low, high))


@dataclass(eq=False)
class Remodelling(GrowthRule):
    """Bone's rule: each cell grows until its stimulus, a mean over neighbours, meets its aim.

    The stimulus is p U / x, the energy that a unit of filled volume saves. A density rests where
    the stimulus misses its aim by less than `lazy`.

    Raises
    ------
    ParameterError
        If a number breaks its rule, or the gain is not stable.
    """

    name = "remodelling"
    least_stiffness = 1e-6
    stimulus: float | None = None
    """Aim (J/m³); unless given the mean of the body that growth starts from, at a power of 1."""
    gain: float = 0.25
    """Share of the missing logarithm by which a density's logarithm changes in a step. Under given
    forces the stimulus falls with the power p + 1 of the density, so a gain of 2/(p + 1) or more
    overshoots for ever (`stability_limit`)."""
    lazy: float = 0.05
    """Logarithm of the stimulus by which nothing changes."""
    powers: tuple[float, float] = (1.0, 3.0)
    """The power p at first and in the end: what is built from 1 on depends less on the start."""
    while_rising: tuple[int, int] = (40, 100)
    """Steps from which on and to which it rises."""

    def __post_init__(self) -> None:
        aims = self.stimulus is None or 0.0 < self.stimulus < np.inf
        require(aims, f"stimulus: finite and above 0 (J/m³), got {self.stimulus}")
        require(self.lazy >= 0.0, f"lazy: 0 or more, got {self.lazy}")
        steep = all(1.0 <= power < 100.0 for power in self.powers)
        require(steep, f"powers: 1 or more each, got {self.powers}")
        first, last = self.while_rising
        require(0 <= first < last, f"while_rising: two steps in order, got {self.while_rising}")
        self.patience = last if self.powers[0] != self.powers[1] else 0
        limit = self.stability_limit
        rule = f"above 0 and below 2/(p + 1) = {limit:.3g}, or densities overshoot for ever"
        require(0.0 < self.gain < limit, f"gain: {rule}, got {self.gain}; take a smaller one")

    @property
    def stability_limit(self) -> float:
        """The gain that is too large."""
        return 2.0 / (max(self.powers) + 1.0)

    def penalty(self, step: int) -> float:
        """Return a power that rises from the first to the last."""
        return float(np.interp(step, self.while_rising, self.powers))

    def prepare(self, felt: Felt) -> None:
        """Aim at what the body feels at first, if no aim was given."""
        if self.stimulus is None:
            filled = felt.density.sum() * felt.cell_volume
            self.stimulus = float(felt.energy.sum() / filled)

    def grow(self, felt: Felt) -> Floats:
        """Return what comes nearer to the stimulus."""
        filled = np.maximum(felt.beside.means(felt.density), _LEAST) * felt.cell_volume
        felt_now = self.penalty(felt.step) * felt.beside.means(felt.energy) / filled
        assert self.stimulus is not None
        missing = np.log(np.maximum(felt_now / self.stimulus, 1e-9))
        missing = np.sign(missing) * np.maximum(np.abs(missing) - self.lazy, 0.0)
        step = np.clip(self.gain * missing, -0.3, 0.3)
        return np.clip(felt.design * np.exp(step), _LEAST, 1.0)


@dataclass(eq=False)
class FullyStressed(GrowthRule):
    """Every cell becomes as thick as makes its stress the one that is allowed.

    Densities are shares of the thickness here: stiffness grows with them, not with a power.
    """

    name = "stress"
    least_stiffness = 1e-6
    stress: float | None = None
    """Equivalent stress (Pa) that is allowed; unless given the mean of the body that growth starts
    from."""
    gain: float = 1.0
    """Power of the ratio of stresses by which a cell grows; 1 is exact where forces do not depend
    on the thickness. Above 0, below 2."""

    def __post_init__(self) -> None:
        allowed = self.stress is None or 0.0 < self.stress < np.inf
        require(allowed, f"stress: finite and above 0 (Pa), got {self.stress}")
        require(0.0 < self.gain < 2.0, f"gain: above 0 and below 2, got {self.gain}")

    def penalty(self, step: int) -> float:
        """Return 1: a plate half as thick is half as stiff."""
        return 1.0

    def prepare(self, felt: Felt) -> None:
        """Allow the mean of what the body bears at first, if nothing else is allowed."""
        if self.stress is None:
            self.stress = float(felt.von_mises().mean())

    def grow(self, felt: Felt) -> Floats:
        """Return what bears the stress that is allowed, if the forces stay as they are."""
        assert self.stress is not None
        ratio = felt.beside.means(felt.von_mises()) / self.stress
        return np.clip(felt.design * ratio**self.gain, _LEAST, 1.0)


RULES: dict[str, type[GrowthRule]] = {
    rule.name: rule for rule in (Compliance, Remodelling, FullyStressed)
}
"""Rules by name."""
