"""What every engine returns: the same questions, whatever the answer was computed with."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.errors import ResultError, ResultFileError
from kaju.files import scratch_beside

if TYPE_CHECKING:
    import pandas

    from kaju.model.scene import Scene

_SCENE = "scene."


class Result(ABC):
    """What a model or a solver has found out.

    Attributes
    ----------
    kind : str
        Which model it came from, as stored results are labelled.
    seconds : float
        Time that the computation took (s).
    """

    kind: ClassVar[str]
    seconds: float

    def __repr__(self) -> str:
        # The fields are arrays of thousands of agents; nobody wants to see them printed.
        figures = ", ".join(f"{key}={value!r}" for key, value in self.summary().items())
        return f"{type(self).__name__}({figures})"

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""

    @abstractmethod
    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per agent."""

    @abstractmethod
    def save(self, path: str | Path) -> Path:
        """Write the result to one file, from which `load` reads it again."""

    @classmethod
    @abstractmethod
    def load(cls, path: str | Path) -> Self:
        """Read a result that `save` wrote."""


class BodyResult(Result):
    """What a model has found out about the body of a scene.

    Attributes
    ----------
    scene : Scene
        What was asked.
    """

    scene: Scene

    @abstractmethod
    def displacement_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""

    @abstractmethod
    def stress_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""

    def profile(
        self, start: Sequence[float], end: Sequence[float], count: int = 101
    ) -> pandas.DataFrame:
        """Return displacement and stress along a line.

        Parameters
        ----------
        start, end : sequence of float
            Points (m) at its ends.
        count : int
            Number of points, evenly spaced; those outside of the body are left out.

        Returns
        -------
        DataFrame
            One row per point, with its distance from `start` (m).

        Raises
        ------
        ResultError
            If the ends are the same or of another dimension, or the line misses the body.
        """
        from .profile import along_line

        return along_line(self, start, end, count)

    def save(self, path: str | Path) -> Path:
        """Write the result to one ``.npz`` file, whole or not at all.

        Raises
        ------
        ResultFileError
            If the file cannot be written.
        """
        text, scene_arrays = self.scene.to_archive()
        arrays, about = self._archive()
        arrays |= {f"{_SCENE}{name}": array for name, array in scene_arrays.items()}
        about |= {"scene": text, "seconds": self.seconds}
        return write_archive(path, self.kind, arrays, about)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a result that `save` wrote.

        Raises
        ------
        ResultFileError
            If the file is missing, or holds something else.
        """
        from kaju.model.scene import Scene

        arrays, about = read_archive(path, cls.kind)
        names = [name for name in arrays if name.startswith(_SCENE)]
        own = {name.removeprefix(_SCENE): arrays.pop(name) for name in names}
        return cls._from_archive(Scene.from_archive(about["scene"], own), arrays, about)

    @abstractmethod
    def _archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return what is stored besides scene and time: arrays, and plain values."""

    @classmethod
    @abstractmethod
    def _from_archive(
        cls, scene: Scene, arrays: dict[str, NDArray[Any]], about: dict[str, Any]
    ) -> Self:
        """Return the result that `_archive` took apart."""


@runtime_checkable
class OnOwnCells(Protocol):
    """A result on other cells than those of its scene."""

    @property
    def grid(self) -> Scene:
        """The scene on the cells that the fields belong to."""


def grid_of(result: BodyResult) -> Scene:
    """Return the scene on the cells that a result's fields belong to."""
    return result.grid if isinstance(result, OnOwnCells) else result.scene


def cells_of_points(
    scene: Scene, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (m) as an array, and the body cell that each lies in or on.

    Raises
    ------
    ResultError
        If the points have another dimension than the body, or lie outside of it.
    """
    points = np.asarray(points, dtype=np.float64)
    lattice = scene.lattice
    if points.ndim != 2 or points.shape[1] != lattice.dimension:
        raise ResultError(
            f"points: an array of shape (n, {lattice.dimension}) in metres is needed, "
            f"got shape {points.shape}"
        )
    if not np.isfinite(points).all():
        raise ResultError("points: must be finite numbers")
    cells, inside = body_cells(scene, points)
    if not inside.all():
        where = ", ".join(f"{value:g}" for value in points[np.argmin(inside)])
        raise ResultError(f"points: ({where}) m lies outside the body")
    return points, cells


def body_cells(
    scene: Scene, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the body cell that each point (m) lies in or on, and whether there is one."""
    lattice = scene.lattice
    cells = lattice.locate(points)
    outside = scene.kinds(cells) < 0
    # A point on the surface belongs to the body, on whichever side rounding has put it.
    corners = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
    for shift in np.concatenate([lattice.normals, corners]):
        moved = lattice.locate(points[outside] + 1e-6 * lattice.cell_size * shift)
        inside = scene.kinds(moved) >= 0
        place = np.flatnonzero(outside)[inside]
        cells[place] = moved[inside]
        outside[place] = False
    return cells, ~outside


def write_archive(
    path: str | Path, kind: str, arrays: dict[str, NDArray[Any]], text: dict[str, Any]
) -> Path:
    """Write arrays and plain values to one ``.npz`` file, whole or not at all.

    Parameters
    ----------
    path : path
        The file; the ending ``.npz`` is added if it is missing.
    kind : str
        Label of the result, which `read_archive` checks.
    arrays : dict of str to array
        Numbers; no objects, so that reading needs no pickle.
    text : dict
        Anything that JSON can hold.

    Raises
    ------
    ResultFileError
        If the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".npz":
        target = target.with_name(target.name + ".npz")
    labelled = {"kind": kind, "kaju_version": __version__, **text}
    described = np.frombuffer(json.dumps(labelled).encode(), dtype=np.uint8)
    with scratch_beside(target, ResultFileError) as scratch:
        np.savez_compressed(scratch, allow_pickle=False, json=described, **arrays)
    return target


def read_archive(
    path: str | Path, kind: str | None = None
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read what `write_archive` wrote.

    Parameters
    ----------
    path : path
        The file.
    kind : str, optional
        The label that is expected; None takes any.

    Raises
    ------
    ResultFileError
        If the file is missing, is no archive of kaju's, or holds another kind of result.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files if name != "json"}
            text = json.loads(archive["json"].tobytes().decode())
    except FileNotFoundError as error:
        raise ResultFileError(f"{path}: there is no such file") from error
    except Exception as error:
        raise ResultFileError(f"{path}: is not a result that kaju has saved ({error})") from error
    found = text.get("kind")
    if kind not in (None, found):
        raise ResultFileError(f"{path}: holds a result of kind {found!r}, not of {kind!r}")
    return arrays, text
