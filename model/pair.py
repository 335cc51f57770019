"""One quantity of two answers at the same points, and how far apart they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ResultError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pair:
    """One quantity of two answers at the same points.

    Attributes
    ----------
    name, unit : str
        What it is.
    values, reference : arrays, shape (n,), (n, dimension) or (n, dimension, dimension)
        The answer that is judged, and the one that is believed.
    """

    name: str
    unit: str
    values: Floats
    reference: Floats

    @property
    def scale(self) -> float:
        """Largest size of the reference, of which errors are shares."""
        return float(_size(self.reference).max(initial=0.0))

    @property
    def error(self) -> Floats:
        """Size of the difference at every point, as a share of the reference's largest."""
        return _size(self.values - self.reference) / self.scale

    @property
    def max_error(self) -> float:
        """Largest error."""
        return float(self.error.max())

    @property
    def l2_error(self) -> float:
        """Root mean square of the error."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def misfit(self) -> float:
        """Norm of the difference over that of the reference: 1 is no better than nothing."""
        difference = float(np.linalg.norm(self.values - self.reference))
        return difference / float(np.linalg.norm(self.reference))

    @property
    def ratio(self) -> Floats:
        """The values over the reference's, NaN where that is below a thousandth of its largest."""
        small = np.abs(self.reference) < 1e-3 * np.abs(self.reference).max()
        return np.asarray(self.values / np.where(small, np.nan, self.reference))

    def component(self, name: str) -> Pair:
        """Return one component, such as "y" of a displacement or "yy" of a stress.

        Raises
        ------
        ResultError
            If there is no such component.
        """
        order, axes = self.values.ndim - 1, "xyz"[: self.values.shape[-1]]
        if order == 0 or len(name) != order or not set(name) <= set(axes):
            known = "none" if order == 0 else " and ".join(axes if order == 1 else (axes[0] * 2,))
            raise ResultError(
                f"component: {self.name} has no {name!r}; "
                f"components are {known}{' and so on' if order == 2 else ''}"
            )
        own, other = self.values, self.reference
        for axis in name:
            own, other = own[:, axes.index(axis)], other[:, axes.index(axis)]
        return Pair(f"{self.name} {name}", self.unit, own, other)

    def summary(self) -> dict[str, float]:
        """Return the error's norms and the largest value of the reference."""
        return {
            "max_error": self.max_error,
            "l2_error": self.l2_error,
            "misfit": self.misfit,
            "largest": self.scale,
        }


def _size(values: Floats) -> Floats:
    """Return the length of vectors, the Frobenius norm of tensors."""
    flat = values.reshape(len(values), -1)
    sizes: Floats = np.sqrt((flat**2).sum(axis=1))
    return sizes


@dataclass(frozen=True, eq=False)
class Profile:
    """Two answers along a line.

    Attributes
    ----------
    points : array, shape (n, dimension)
        Where (m).
    distance : array, shape (n,)
        Way along the line (m).
    displacement : Pair
    stress : Pair or None
    """

    points: Floats
    distance: Floats
    displacement: Pair
    stress: Pair | None
