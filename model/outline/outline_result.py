"""The answer to a body with true outlines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.fields import von_mises
from kaju.model.results.archive import Archive
from kaju.model.results.formats import OUTLINE_AGENTS
from kaju.model.results.mesh import write_polygons
from kaju.model.results.result import Result, finite
from kaju.model.scene import Scene
from kaju.model.scene.contents import NOT_BODY
from kaju.model.scene.shapes import Shape

from .fitted_displacement import shapes_at, strain_rows
from .outline_bracket import SLIVER, OutlineBracket, error_between
from .outline_problem import ON_BORDER, OutlineProblem, place_on
from .square_leaves import SquareLeaves

if TYPE_CHECKING:
    import pandas

_SCENE = "scene."
_EDGE = 1e-9
"""Of a shape's extent: points this near to the edge of a hole belong to the body."""
_GAP = 0.2
"""Share of an outline that lies beyond the array where no agent is along it."""
_APART = 0.02
"""Share of a peak by which both fields may differ there without a note."""
_CLOSED = 0.1
"""Share of its length by which an outline must go on within an agent to have a direction there."""


@dataclass(frozen=True, eq=False, repr=False)
class OutlineResult(Result):
    """Linear elasticity of a plane body with true outlines: agents whole or cut, and both bounds.

    Attributes
    ----------
    scene : Scene
        What was asked.
    seconds : float
    tolerance : float
        Error in the energy norm that was asked for, relative.
    first_edge : float
        Edge (m) of the first agents.
    x, y, width : int array, shape (agents,)
        Lower corner and edge of each agent, in 2^-16 of `first_edge`.
    corner_displacement : array, shape (agents, 4, 2)
        Of each agent's corners (m), counter-clockwise from the lower left one.
    mean_stress : array, shape (agents, 3)
        Mean (Pa) of the stress in balance in what each agent holds: xx, yy and xy.
    area : array, shape (agents,)
        What of each agent (m²) lies within the body at least.
    energy_bounds : tuple of float
        Energies (J) below and above that of the true body, corners, curves and all.
    hoops : dict of str to array
        Of each named outline: x and y (m), hoop stress (Pa). Shape (n, 3).
    notes : tuple of str
        What a reader should know.

    Examples
    --------
    >>> from kaju import Scene, solve
    >>> hole = {"disk": {"centre": [0.1, 0.1], "radius": 0.031}, "material": "air"}
    >>> plate = Scene(
    ...     body={
    ...         "size": [0.2, 0.2], "cells": [8, 8], "material": "steel", "thickness": 0.01,
    ...         "regions": [hole | {"outline": "true", "name": "bore"}],
    ...     },
    ...     sides={"left": "rigid"},
    ...     loads=[{"side": "right", "force": [1000.0, 0.0]}],
    ... )
    >>> answer = solve(plate, tolerance=0.1)
    >>> answer.tolerance_kept, answer.error_bound < 0.1
    ('proved', True)
    """

    kind: ClassVar[str] = "true outlines"
    scene: Scene
    seconds: float
    tolerance: float
    first_edge: float
    x: Ints
    y: Ints
    width: Ints
    corner_displacement: Floats
    mean_stress: Floats
    area: Floats
    energy_bounds: tuple[float, float]
    hoops: dict[str, Floats]
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls,
        scene: Scene,
        problem: OutlineProblem,
        found: OutlineBracket,
        edge: float,
        tolerance: float,
        seconds: float,
    ) -> OutlineResult:
        """Return the answer that bounds stand for, in units."""
        level = problem.strain * scene.cell_materials[0].youngs_modulus
        unit = 0.5 * level * scene.thickness * edge**2 * problem.strain
        low, high = found.bounds
        bounds = (float(low * unit), float(high * unit))
        leaves, balanced = found.leaves, found.balanced
        stress = level * balanced.mean_stress()
        stiffness = level * problem.stiffness
        hoops, notes = {}, []
        for region, true in zip(scene.body.regions, problem.body.regions, strict=True):
            if region.name is not None:
                border = true.shape.border(not true.solid)
                along = _hoop_stress(border, found, stress, stiffness, edge)
                hoops[region.name] = along[:, :3]
                notes += _peak_note(region.name, *along[:, 2:].T)
        return cls(
            scene,
            seconds,
            tolerance,
            edge,
            leaves.x,
            leaves.y,
            leaves.size,
            edge * problem.strain * found.fitted.displacement[found.fitted.corner],
            stress,
            edge**2 * balanced.area,
            bounds,
            hoops,
            (*_loose_note(int(balanced.loose.sum())), *notes),
        )

    @property
    def _unit(self) -> float:
        return SquareLeaves.unit * self.first_edge

    @property
    def agents(self) -> int:
        """Number of agents that hold a part of the body."""
        return len(self.x)

    @property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, 2)."""
        return np.asarray(np.stack([self.x, self.y], axis=1) * self._unit, dtype=np.float64)

    @property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return np.asarray(self.width * self._unit, dtype=np.float64)

    @property
    def cut(self) -> Flags:
        """Which agents an outline cuts, shape (agents,)."""
        return np.asarray(self.area < self.size**2 * (1.0 - 1e-12))

    @property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of `mean_stress`, shape (agents,)."""
        xx, yy, _ = self.mean_stress.T
        beyond = np.zeros(len(xx))
        if self.scene.plane == "strain":
            beyond = self.scene.cell_materials[0].poissons_ratio * (xx + yy)
        return von_mises(self.mean_stress[:, [[0, 2], [2, 1]]], beyond)

    def pieces(self) -> tuple[Ints, list[Floats]]:
        """Return what the agents hold as convex polygons (m): of which agent each is, and corners.

        Curves are drawn by tangents or chords as far apart as the agents are large.
        """
        from .outlined_scene import problem_of
        from .true_shapes import CutLeaves

        problem, edge = problem_of(self.scene)
        leaves = SquareLeaves(self.x, self.y, self.width, problem.shape)
        held = [outer for outer, _ in CutLeaves(problem.body).refined(leaves)]
        square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        agent, polygons = [], []
        for number, pieces in enumerate(held):
            whole = [self.lower[number] + self.size[number] * square] if pieces is None else []
            polygons += whole + [edge * np.array(piece) for piece in pieces or ()]
            agent += [number] * (len(whole) + len(pieces or ()))
        return np.array(agent, dtype=np.int64), polygons

    @property
    def strain_energy(self) -> float:
        """Energy (J) stored in the body: the middle of `energy_bounds`."""
        return 0.5 * sum(self.energy_bounds)

    @property
    def error_bound(self) -> float:
        """Largest error of the mean of both stresses, in the energy norm, relative to the truth."""
        return error_between(self.energy_bounds)

    @property
    def tolerance_kept(self) -> str:
        """Whether `error_bound` is within the tolerance: "proved", else "missed"."""
        return "proved" if self.error_bound <= self.tolerance else "missed"

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both of shape (n, 2).

        Raises
        ------
        ResultError
            If a point lies outside of the body.
        """
        agent, local = self._placed(points)
        moved = self.corner_displacement[agent]
        return np.asarray(np.einsum("nk,nkd->nd", shapes_at(local), moved))

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m) of the body, shape (n, 2, 2).

        Those of `displacement_at`: nothing is proved of a stress at a point.

        Raises
        ------
        ResultError
            If a point lies outside of the body.
        """
        from .outlined_scene import stiffness_of

        agent, local = self._placed(points)
        moved = self.corner_displacement[agent].reshape(-1, 8)
        strain = np.einsum("nai,ni->na", strain_rows(local), moved) / self.size[agent, None]
        modulus = self.scene.cell_materials[0].youngs_modulus
        stress = modulus * strain @ stiffness_of(self.scene)
        return np.asarray(stress[:, [[0, 2], [2, 1]]])

    def outline_stress(self, name: str) -> tuple[Floats, Floats]:
        """Return positions (m) along a named outline, and the hoop stress (Pa) there.

        Means over what each agent holds, of which nothing is proved. `notes` tell by how much
        another estimate of the largest differs.

        Raises
        ------
        ResultError
            If no region with a true outline has that name.
        """
        if name not in self.hoops:
            known = ", ".join(self.hoops) or "none has a name"
            raise ResultError(f"outline_stress: there is no outline {name!r}; there is {known}")
        found = self.hoops[name]
        return found[:, :2], found[:, 2]

    def _placed(self, points: Floats) -> tuple[Ints, Floats]:
        """Return the agent of each point, and where in it the point lies, from 0 to 1."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ResultError(f"points: finite numbers (m) of shape (n, 2), got {points!r:.80}")
        lattice = self.scene.lattice
        inside = np.full(len(points), self.scene.body.material not in NOT_BODY)
        for number, region in enumerate(self.scene.body.regions):
            shape = region.shape_in(lattice, f"body.regions.{number}")
            if region.material not in NOT_BODY:
                inside |= shape.contains(points)
            else:
                inside &= ~_within(shape, points)
        extent = np.array(lattice.extent)
        inside &= ((points >= 0.0) & (points <= extent)).all(axis=1)
        leaves = SquareLeaves(self.x, self.y, self.width, (1, 1))
        # those on the upper sides of the array belong to the last agents
        at = np.minimum(points, extent * (1.0 - 1e-12)) / self.first_edge
        agent = leaves.at(at)
        if not (inside & (agent >= 0)).all():
            where = ", ".join(f"{c:g}" for c in points[np.argmin(inside & (agent >= 0))])
            raise ResultError(f"points: ({where}) m lies outside the body")
        return agent, (points - self.lower[agent]) / self.size[agent, None]

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        size = self.size
        return {
            "rule": "elastic",
            "plane": self.scene.plane,
            "agents": self.agents,
            "agents_cut": int(self.cut.sum()),
            "smallest_agent": float(size.min()),
            "largest_agent": float(size.max()),
            "strain_energy": self.strain_energy,
            "max_displacement": float(np.hypot(*self.corner_displacement.reshape(-1, 2).T).max()),
            "tolerance": self.tolerance,
            "tolerance_kept": self.tolerance_kept,
            "error_bound": finite(self.error_bound),
            "energy_bounds": self.energy_bounds,
            "notes": list(self.notes),
            "seconds": self.seconds,
            "kaju_version": __version__,
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per agent: place, size, area within the body, and mean stress."""
        import pandas as pd

        columns = {"x (m)": self.lower[:, 0], "y (m)": self.lower[:, 1], "size (m)": self.size}
        columns |= {"area (m²)": self.area}
        for number, name in enumerate(("xx", "yy", "xy")):
            columns[f"stress_{name} (Pa)"] = self.mean_stress[:, number]
        return pd.DataFrame(columns)

    def to_vtk(self, path: str | Path) -> Path:
        """Write what the agents hold as polygons that ParaView reads (.vtu or .vtk).

        Of each the equivalent stress (Pa), the mean stress (xx, xy, yx, yy; Pa) and the number
        of its agent; displacements (m) at the corners.

        Raises
        ------
        MissingExtraError
            If meshio is not installed.
        ResultFileError
            If the file cannot be written.
        """
        agent, polygons = self.pieces()
        of = np.repeat(agent, [len(polygon) for polygon in polygons])
        local = (np.concatenate(polygons) - self.lower[of]) / self.size[of, None]
        moved = np.einsum("nk,nkd->nd", shapes_at(local), self.corner_displacement[of])
        values = {
            "von_mises": self.von_mises[agent],
            "stress": self.mean_stress[agent][:, [0, 2, 2, 1]],
            "agent": agent,
        }
        return write_polygons(path, polygons, 1e-8 * self.first_edge, values, moved)

    def _stored(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        text, scene_arrays = self.scene.to_archive()
        arrays: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in OUTLINE_AGENTS}
        arrays |= {f"hoop.{name}": found for name, found in self.hoops.items()}
        arrays |= {f"{_SCENE}{name}": array for name, array in scene_arrays.items()}
        numbers = {name: getattr(self, name) for name in ("seconds", "tolerance", "first_edge")}
        bounds = {"lower_energy": self.energy_bounds[0], "upper_energy": self.energy_bounds[1]}
        return arrays, {"scene": text, "notes": list(self.notes), **numbers, **bounds}

    @classmethod
    def _restored(cls, archive: Archive) -> Self:
        scene = Scene.from_archive(archive.value("scene", str), archive.part(_SCENE))
        hoops = {
            name: archive.array(f"hoop.{name}", "f", (None, 3)) for name in archive.part("hoop.")
        }
        return cls(
            scene=scene,
            seconds=archive.value("seconds", float),
            tolerance=archive.value("tolerance", float),
            first_edge=archive.value("first_edge", float),
            **archive.columns(OUTLINE_AGENTS, {}),
            energy_bounds=(
                archive.value("lower_energy", float),
                archive.value("upper_energy", float),
            ),
            hoops=hoops,
            notes=tuple(archive.value("notes", list[str])),
        )


def _loose_note(loose: int) -> list[str]:
    if not loose:
        return []
    told = f"parts of the body in {loose} agents hang on nothing and bear nothing"
    return [f"{told}; if a support was meant, give it"]


def _peak_note(name: str, balanced: Floats, moved: Floats) -> list[str]:
    """Return what is uncertain of the largest hoop stress, by how far two fields differ there."""
    if not len(balanced):
        return []
    at = np.abs(balanced).argmax()
    peak, other = balanced[at], moved[at]
    if abs(other - peak) <= _APART * abs(peak):
        return []
    return [
        f"outline {name!r}: the largest hoop stress is {peak:.4g} Pa in balance, as a mean over an "
        f"agent, and {other:.4g} Pa by the displacement on the outline; nothing is proved of either"
    ]


def _within(shape: Shape, points: Floats) -> Flags:
    """Tell which points lie in a shape that is cut out: not on its edge, which is the body's."""
    lower, upper = shape.extent
    step = _EDGE * float((upper - lower).max())
    inside = np.ones(len(points), dtype=np.bool_)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        inside &= shape.contains(points + step * np.array([x, y]))
    return inside


def _hoop_stress(
    border: Floats, found: OutlineBracket, stress: Floats, stiffness: Floats, edge: float
) -> Floats:
    """Return x, y (m) and the hoop stress of the agents along an outline, in order along it.

    The last column is the hoop stress of the displacement, on the outline itself.
    """
    balanced = found.balanced
    rows = np.flatnonzero(balanced.alone)
    near, along = place_on(balanced.ends[rows].mean(axis=1), border)
    rows, along = rows[near < ON_BORDER], along[near < ON_BORDER]
    run = balanced.ends[rows, 1] - balanced.ends[rows, 0]
    length = np.hypot(run[:, 0], run[:, 1])
    leaf, of = np.unique(balanced.leaf_of[rows], return_inverse=True)
    full = (found.leaves.size[leaf] * found.leaves.unit) ** 2
    total = np.bincount(of, length, len(leaf))
    sums = [np.bincount(of, length * c, len(leaf)) for c in balanced.ends[rows].mean(axis=1).T]
    middle = np.stack(sums, axis=1) / total[:, None]
    tx, ty = np.stack([np.bincount(of, c, len(leaf)) for c in run.T])
    onward = np.hypot(tx, ty)
    along_outline = np.stack([tx**2, ty**2, 2.0 * tx * ty], axis=1)
    along_outline /= np.where(onward > 0.0, onward**2, 1.0)[:, None]
    hoop = (stress[leaf] * along_outline).sum(axis=1)
    moved = found.fitted.strain_at(leaf, middle) @ stiffness
    other = (moved * along_outline).sum(axis=1)
    first = np.unique(of, return_index=True)[1]  # a mean would tear agents from the line's start
    order = np.argsort(along[first])
    if len(order):  # a part beyond the array lies after the end, wherever the line starts
        place = along[first][order]
        whole = np.hypot(*(border[:, 1] - border[:, 0]).T).sum()
        gaps = np.diff(place, append=place[0] + whole)
        order = np.roll(order, -1 - gaps.argmax() if gaps.max() > _GAP * whole else 0)
    says = (balanced.area[leaf] > SLIVER * full) & (onward > _CLOSED * total)
    order = order[says[order]]
    return np.asarray(np.column_stack([edge * middle, hoop, other])[order])
