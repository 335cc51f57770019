"""What all answers of linear elasticity offer, whether their agents are of one size or many."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from kaju import __version__
from kaju.model.result import BodyResult

from .problem import Floats, Scales

if TYPE_CHECKING:
    import pandas

    from .export import Mesh


class SolidResult(BodyResult):
    """Linear elasticity of a scene.

    Attributes
    ----------
    scene : Scene
        What was asked.
    stage : int or None
        Stage of loading; None is the last.
    seconds : float
    """

    stage: int | None

    @property
    @abstractmethod
    def _scales(self) -> Scales:
        """Units of the scaled problem."""

    @property
    @abstractmethod
    def _energy(self) -> float:
        """Scaled energy stored in the body."""

    @property
    @abstractmethod
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body; "rigid" are rigid cells inside the array."""

    @property
    @abstractmethod
    def max_displacement(self) -> float:
        """Largest displacement of an agent's middle (m)."""

    @property
    @abstractmethod
    def error_estimate(self) -> float:
        """Estimated error in the energy norm, relative to the solution."""

    @property
    @abstractmethod
    def residuals(self) -> tuple[float, ...]:
        """Relative residual before every iteration."""

    @abstractmethod
    def _figures(self) -> dict[str, Any]:
        """Return the key figures that are its own, among them how many agents there are."""

    @abstractmethod
    def _columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the table of agents."""

    @abstractmethod
    def _mesh(self) -> Mesh:
        """Return what other programs draw."""

    @property
    def _stress_unit(self) -> float:
        return self._scales.modulus * self._scales.displacement / self._scales.length

    @property
    def strain_energy(self) -> float:
        """Energy (J) stored in the body, and in a foundation if there is one."""
        return self._energy * self._scales.force * self._scales.displacement

    @property
    def iterations(self) -> int:
        """Number of iterations, of the last generation if there were several."""
        return max(len(self.residuals) - 1, 0)

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        return {
            "rule": "elastic",
            "plane": self.scene.plane,
            "strain_energy": self.strain_energy,
            "error_estimate": self.error_estimate,
            "iterations": self.iterations,
            "residual": self.residuals[-1] if self.residuals else 0.0,
            "reaction": {name: force.tolist() for name, force in self.reactions.items()},
            "max_displacement": self.max_displacement,
            "seconds": self.seconds,
            **self._figures(),
            "kaju_version": __version__,
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per agent: place, material, displacement, strain, stress, and its own."""
        import pandas as pd

        return pd.DataFrame(self._columns())

    def to_vtk(self, path: str | Path) -> Path:
        """Write the agents as an unstructured grid that ParaView reads (.vtu or .vtk).

        Raises
        ------
        MissingExtraError
            If meshio is not installed.
        """
        from .export import write_mesh

        return write_mesh(self._mesh(), path)
