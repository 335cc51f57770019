"""What results are measured against: displacement and stress at some points.

A reference may come from another program, an experiment or a formula. It knows nothing
between its points and never guesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Flags, Floats, Ints, without_rows
from kaju.errors import ParameterError, ResultError, brief, require
from kaju.model.results.archive import Stored
from kaju.model.results.stored import Column

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


@dataclass(frozen=True, eq=False)
class Reference(Stored):
    """Displacement and stress at points.

    Parameters
    ----------
    points : array, shape (n, dimension)
        Where something is known (m).
    displacement : array, shape (n, dimension)
        Displacement there (m).
    stress : array, shape (n, dimension, dimension), optional
        Stress there (Pa).
    strain_energy : float, optional
        Energy stored in the whole body (J).
    source : str
        Where the numbers come from; what stands before a colon is its name.

    Raises
    ------
    ParameterError
        If the arrays do not fit together or hold anything but finite numbers.

    Examples
    --------
    >>> import numpy as np
    >>> import kaju
    >>> answer = kaju.solve(kaju.load_scene("plate.toml"))
    >>> points = np.array([[0.055, 0.145], [0.105, 0.195]])
    >>> larger = 1.1 * answer.displacement_at(points)
    >>> measured = kaju.Reference(points, larger, source="test: made up")
    >>> print(f"{kaju.compare(answer, measured).displacement.misfit:.3f}")
    0.091
    """

    kind: ClassVar[str] = "reference"
    points: Annotated[Floats, Column("points dimension")]
    displacement: Annotated[Floats, Column("points dimension")]
    stress: Annotated[Floats, Column("points dimension dimension")] | None = None
    strain_energy: float | None = None
    source: str = ""
    __repr__ = without_rows

    def __post_init__(self) -> None:
        for name in ("points", "displacement", "stress"):
            if (given := getattr(self, name)) is None and name == "stress":
                continue
            try:
                values = np.array(given, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise ParameterError(f"{name}: must be numbers, got {brief(given)}") from error
            n, d = self.points.shape if name != "points" else (*values.shape, 0, 0)[:2]
            shape = (n, d, d) if name == "stress" else (n, d)
            if values.shape != shape or d not in (2, 3) or not n:
                needed = shape if name != "points" else "(n, 2) or (n, 3)"
                raise ParameterError(f"{name}: must have shape {needed}, got {values.shape}")
            require(bool(np.isfinite(values).all()), f"{name}: must be finite numbers")
            object.__setattr__(self, name, values)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.points.shape[1])

    @property
    def name(self) -> str:
        """Its name where it is compared with another answer."""
        return self.source.partition(":")[0] or "reference"

    def holds(self, points: ArrayLike) -> Flags:
        """Tell which points (m) it knows."""
        return self._rows(points) >= 0

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.points)  # built once: a fit asks for the same points hundreds of times

    def _rows(self, points: ArrayLike) -> Ints:
        """Return the row of every point, -1 where nothing is known."""
        found = np.asarray(points, dtype=np.float64)
        if found.ndim != 2 or found.shape[1] != self.dimension:
            raise ResultError(f"points: must have shape (n, {self.dimension}), got {found.shape}")
        reach = 1e-7 * float(np.ptp(self.points, axis=0).max(initial=0.0))
        distance, row = self._tree.query(found)
        return np.where(distance <= reach, row, -1).astype(np.int64)

    def displacement_at(self, points: ArrayLike) -> Floats:
        """Return the displacement (m) at known points (m), both (n, dimension)."""
        return self.displacement[self._known(points)]

    def stress_at(self, points: ArrayLike) -> Floats:
        """Return stress tensors (Pa) at known points (m), (n, dimension, dimension)."""
        if self.stress is None:
            raise ResultError("stress: the reference has none; give it as stress=")
        return self.stress[self._known(points)]

    def _known(self, points: ArrayLike) -> Ints:
        rows = self._rows(points)
        if (rows < 0).any():
            where = ", ".join(f"{value:g}" for value in np.asarray(points)[np.argmax(rows < 0)])
            raise ResultError(
                f"points: the reference knows nothing at ({where}) m; take points from its "
                f"own {len(self.points)}"
            )
        return rows
