"""What every answer of kaju offers, whatever it was computed with."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints, points_in
from kaju.errors import ResultError, suggestion
from kaju.model.scene import Scene, body_cells
from kaju.result_kinds import KINDS, html_in_notebook

from .archive import Stored
from .cuts import Carrying, Cuts, axis_of_cuts, cuts_of

if TYPE_CHECKING:
    import pandas


class Named(dict[str, Any]):
    """What has names; to ask for one that is not there is a `ResultError` that tells the others."""

    def __init__(self, what: str, of: Mapping[str, Any], none: str = "none") -> None:
        super().__init__(of)
        self.what, self.none = what, none

    def __missing__(self, name: object) -> Any:
        near, known = suggestion(str(name), self), ", ".join(self) or self.none
        raise ResultError(f"{self.what}: there is no {name!r}{near}; there is {known}")


@dataclass(frozen=True, eq=False)
class Curves:
    """Some quantities of one unit over one other quantity."""

    title: str
    along: str  # what they are drawn over, such as "time"
    along_unit: str  # its unit, "" if it is a number
    at: Floats  # its values, shape (k,)
    lines: Mapping[str, Floats]  # the quantities by name, shape (k,) each
    unit: str  # theirs, "" if they are numbers
    logarithmic: bool = False  # whether orders of magnitude are drawn; all are above 0 then
    bars: bool = False  # whether each value is a count of its own, which no line joins to the next


# Shares by which a ledger, energies, and forces may be off without a word in the notes.
BOOKS, ROUNDING, BALANCE = 1e-12, 1e-9, 1e-6


class Check(NamedTuple):
    """One thing that must hold in an answer."""

    what: str
    off: float  # by what share it is missed
    allowed: float  # by what share it may be

    @property
    def holds(self) -> bool:
        """Whether it does; NaN holds nothing."""
        return self.off <= self.allowed


class Result(Stored):
    """The base class of all answers of kaju; printed, it shows its key figures.

    Examples
    --------
    >>> import kaju
    >>> result = kaju.LoadModel(kaju.load_scene("plate.toml")).run()
    >>> isinstance(result, kaju.Result), result.kind
    (True, 'load transfer')
    >>> result.pictures[:3]
    ('agents', 'loads', 'deformed')
    """

    seconds: float
    """Time that the computation took (s)."""

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of what `kaju.plot` draws of it, the usual one first."""
        return tuple(KINDS[self.kind].pictures)

    @property
    def films(self) -> tuple[str, ...]:
        """Names of what `kaju.animate` makes of it, the usual one first."""
        return tuple(KINDS[self.kind].films)

    @property
    def caveats_in_brief(self) -> tuple[str, ...]:
        """What is approximate of it, in a few words each, as pictures tell it."""
        return ()

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""

    @abstractmethod
    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per agent, or per time."""

    def checks(self) -> list[Check]:
        """Return the checks that must hold for every result: ledger, forces and energies balance.

        Examples
        --------
        >>> import kaju
        >>> answer = kaju.solve(kaju.load_scene("plate.toml"))
        >>> [(check.what, check.holds) for check in answer.checks()]
        [('supports bear the loads', True)]
        """
        return []

    def __repr__(self) -> str:
        figures = ", ".join(f"{key}={value!r}" for key, value in self.summary().items())
        return f"{type(self).__name__}({figures})"

    _repr_html_ = html_in_notebook


def solved_scene(result: Any) -> Scene:
    """Return what was asked; of a solid within true outlines the cells that count."""
    scene: Scene = result.grid if result.scene.outlined else result.scene
    return scene


class OnCells:
    """What stands on the cells of a scene, which say where the body is."""

    if TYPE_CHECKING:  # a field of some, which takes the place of no property

        @property
        def grid(self) -> Scene:
            """The scene on these cells."""

    def located(self, points: Floats) -> tuple[Floats, Ints]:
        """Return points (m) as an array, and the cell of the body that each lies in or on."""
        points = points_in(points, self.grid.lattice.dimension)
        cells, inside = self.cells_at(points)
        if not inside.all():
            where = ", ".join(f"{value:g}" for value in points[np.argmin(inside)])
            raise ResultError(f"points: ({where}) m lies outside the body")
        return points, cells

    def holds(self, points: Floats) -> Flags:
        """Tell which points (m), shape (n, dimension), lie in the body."""
        return self.cells_at(points)[1]

    def cells_at(self, points: Floats) -> tuple[Ints, Flags]:
        """Return the cells in or on which points (m) lie, and which points lie in the body."""
        return body_cells(self.grid, points)

    def material_at(self, points: Floats) -> Ints:
        """Return the index of the material at points (m), below 0 outside of the body."""
        found: Ints = self.grid.kinds(self.grid.lattice.locate(points))
        return found

    def applied(self, stage: int | None) -> Floats:
        """Return the forces (N) on the body, shape (n, dimension)."""
        return self.grid.applied(stage).force


class BodyResult(OnCells, Result):
    """An answer that knows displacement and stress everywhere in the body of a scene."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Its name where it is compared with another answer."""

    @property
    def grid(self) -> Scene:
        """The scene on the cells that say where the body is."""
        return self.scene

    if TYPE_CHECKING:  # a field of some answers, which takes the place of no property

        @property
        def scene(self) -> Scene:
            """The scene that was computed."""

        @property
        def stage(self) -> int | None:
            """The stage of loading at which it stands, from 1; None: the last."""

    @property
    def focus(self) -> Ints | None:
        """The cells that pictures are about; None for all of the body."""
        return None

    @abstractmethod
    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""

    def displacement_near(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m); just outside the body, of what is nearest."""
        return self.displacement_at(points)

    @abstractmethod
    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""

    def profile(
        self, start: Sequence[float], end: Sequence[float], count: int = 101
    ) -> pandas.DataFrame:
        """Return displacement and stress along a line between two points (m).

        There are `count` points, evenly spaced; each that lies in the body has a row. Within agents
        as large as the body is thick stress is rather a mean: see `ElasticResult.stress_at`.

        Raises
        ------
        ResultError
            If the ends are the same or of another dimension, or the line misses the body.
        """
        import pandas as pd

        first, direction, length = line_of(start, end, self.scene.lattice.dimension, "profile")
        points = first + np.linspace(0.0, length, count)[:, None] * direction
        points = points[self.holds(points)]
        if not len(points):
            where = f"from {list(start)} to {list(end)}"
            raise ResultError(f"profile: no point {where} lies in the body")
        columns: dict[str, Any] = {"distance (m)": (points - first) @ direction}
        columns |= in_columns("{} (m)", points)
        columns |= in_columns("displacement_{} (m)", self.displacement_at(points))
        return pd.DataFrame(columns | in_columns("stress_{} (Pa)", self.stress_at(points)))

    def cuts(self, axis: str | None = None) -> Cuts:
        """Return the force (N) through every cut across an axis, and what equilibrium asks for.

        There is a cut for each layer of cells, or of agents if these are larger; within true
        outlines, of first agents. `axis` is "x", "y" or "z"; unless given, the one along which the
        loads press most.

        Raises
        ------
        ParameterError
            If there is no such axis, or cells do not lie in layers across it (hexagons: only y).
        ResultError
            If the body has more than five million cells.

        Examples
        --------
        >>> import kaju
        >>> cuts = kaju.solve(kaju.load_scene("plate.toml")).cuts()
        >>> cuts.carried[[0, -1]].round(9)  # N: what lies on them is held up
        array([2., 2.])
        """
        scene = solved_scene(self)
        number = axis_of_cuts(scene.lattice, axis, scene.applied(self.stage).force)
        return cuts_of(scene, self.stage, number, self._carrying(number))

    def _carrying(self, axis: int) -> Carrying:
        """Return the parts of the body that carry anything, for cuts across an axis."""
        raise ResultError(
            f"cuts: {type(self).__name__} has not all stresses at once; cut a result of solve"
        )


def in_columns(title: str, values: Any) -> dict[str, Any]:
    """Return vectors, or symmetric tensors, component by component, with their axes in a title."""
    axes, order = enumerate("xyz"[: values.shape[1]]), values.ndim - 1
    return {
        title.format("".join(name for _, name in one)): values[:, *(axis for axis, _ in one)]
        for one in combinations_with_replacement(axes, order)
    }


def finite(number: float | None) -> float | None:
    """Return a number, or None if it has no bound: summaries go into JSON."""
    return number if number is not None and isfinite(number) else None


def idle_rheology(scene: Scene) -> list[str]:
    """Say that a material's rheology takes no part in an answer without time, if one has any."""
    if not any(material.rheology for material in scene.cell_materials):
        return []
    return ["a material's rheology takes no part here; time passes in `kaju creep`"]


def line_of(
    start: Sequence[float], end: Sequence[float], dimension: int, caller: str
) -> tuple[Floats, Floats, float]:
    """Return the first point (m), the unit vector and the length (m) of a line."""
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first)) if first.shape == last.shape else 0.0
    if first.shape != (dimension,) or not length > 0.0:
        raise ResultError(
            f"{caller}: two different points of {dimension} numbers are needed, "
            f"got {list(start)} and {list(end)}"
        )
    return first, (last - first) / length, length
