"""The answer to a body with true outlines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.goals.quantities import HOOP, Stress
from kaju.model.elastic.moduli import von_mises
from kaju.model.elastic.pair.cut_pair import CutPair
from kaju.model.results.archive import Archive
from kaju.model.results.formats import OUTLINE_AGENTS
from kaju.model.results.mesh import write_polygons
from kaju.model.results.result import Result, finite
from kaju.model.scene import Scene
from kaju.model.scene.shapes import Shape

from .hoop_stress import HoopStress
from .posed_outlines import laws_of, problem_of
from .square_leaves import SquareLeaves

if TYPE_CHECKING:
    import pandas

    from kaju.model.elastic.goals.quantities import Goal

_SCENE = "scene."
_EDGE = 1e-9  # of a shape's extent: points this near to the edge of a hole belong to the body
_APART = 0.02  # share of a peak by which it may be off both fields there without a note
_STOPPED = {
    "agents": "agents ran out before the tolerance was reached",
    "depth": "agents could not become smaller, or gained nothing any more, before the tolerance "
    "was reached",
    "interrupt": "interrupted before the tolerance was reached",
}
_ESTIMATED = (
    "the weight of what lies between a curve and its polygons is left out: the error is an "
    "estimate, without a proof"
)
_CORNERS = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


@dataclass(frozen=True, eq=False, repr=False)
class OutlineResult(Result):
    """Linear elasticity of a plane body with true outlines: agents whole or cut, and both bounds.

    Agents are stored; both fields are found again when they are asked for.

    Attributes
    ----------
    scene : Scene
        What was asked.
    seconds : float
    tolerance : float
        Error in the energy norm that was asked for, relative.
    first_edge : float
        Edge (m) of the first agents.
    leaves : tuple of SquareLeaves
        The agents of all generations.
    energies : tuple of pairs of float
        Energies (J) below and above the true one, of all generations.
    errors : tuple of float
        Largest errors in the energy norm, relative, of all generations.
    proof : bool
        Whether these are theorems: they are not where weight acts along curves.
    notes : tuple of str
        What a reader should know.
    tolerance_at : tuple of a Stress, or None
        The peak that the tolerance is about, if not the energy norm; see `goals`.
    peak : tuple of float, or None
        That stress (Pa), its estimated error (Pa), and the same relative.

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
    name: ClassVar[str] = "true outlines"  # beside another answer
    scene: Scene
    seconds: float
    tolerance: float
    first_edge: float
    leaves: tuple[SquareLeaves, ...]
    energies: tuple[tuple[float, float], ...]
    errors: tuple[float, ...]
    proof: bool
    notes: tuple[str, ...]
    tolerance_at: tuple[Stress, ...] | None = None
    peak: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        pair: CutPair,
        edge: float,
        tolerance: float,
        seconds: float,
        generations: list[tuple[SquareLeaves, tuple[float, float], float]],
        tolerance_at: tuple[Stress, ...] | None = None,
        peak: tuple[float, float, float] | None = None,
        stopped: str = "",
    ) -> OutlineResult:
        """Return the answer that both fields stand for, the last of the generations, in units."""
        problem = pair.problem
        level = problem.strain * scene.cell_materials[0].youngs_modulus
        unit = 0.5 * level * scene.thickness * edge**2 * problem.strain
        notes = [_STOPPED[stopped]] if stopped else []
        if problem.estimated:
            notes.append(_ESTIMATED)
        if pair.loose:
            notes.append(
                f"{pair.loose} part{'s' * (pair.loose > 1)} of the body hang on nothing and bear "
                "nothing; if a support was meant, give it"
            )
        for number, region in enumerate(scene.body.regions):
            asked = tolerance_at[0].at if tolerance_at is not None else None
            if region.name is not None and region.name != asked:
                notes += _peak_note(region.name, HoopStress.along(pair, number), level)
        leaves, bounds, errors = zip(*generations, strict=True)
        found = cls(
            scene,
            seconds,
            tolerance,
            edge,
            leaves,
            tuple((low * unit, high * unit) for low, high in bounds),
            errors,
            not problem.estimated,
            tuple(notes),
            tolerance_at,
            None if peak is None else (level * peak[0], level * peak[1], peak[2]),
        )
        found.__dict__["pair"] = pair  # which is there already
        return found

    @cached_property
    def pair(self) -> CutPair:
        """Both fields of the agents, in the numbers that they are found in."""
        return CutPair(problem_of(self.scene)[0], self.leaves[-1])

    @property
    def generations(self) -> tuple[OutlineResult, ...]:
        """The answers of all generations of agents, this one the last."""
        earlier = (
            replace(
                self,
                leaves=self.leaves[:number],
                energies=self.energies[:number],
                errors=self.errors[:number],
                notes=(),
                peak=None,
            )
            for number in range(1, len(self.leaves))
        )
        return (*earlier, self)

    @property
    def _level(self) -> float:
        """The stress (Pa) that is 1."""
        return float(self.pair.problem.strain * self.scene.cell_materials[0].youngs_modulus)

    @cached_property
    def kept(self) -> Ints:
        """Which of the last leaves hold a part of the body: the agents."""
        return np.flatnonzero(self.pair.area[0] > 0.0)

    @property
    def agents(self) -> int:
        """Number of agents that hold a part of the body."""
        return len(self.kept)

    @property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, 2)."""
        return self.first_edge * self.leaves[-1].lower()[self.kept]

    @property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return np.asarray(self.leaves[-1].size[self.kept] * SquareLeaves.unit * self.first_edge)

    @property
    def area(self) -> Floats:
        """What of each agent (m²) lies within the body at least, shape (agents,)."""
        return np.asarray(self.first_edge**2 * self.pair.area[1][self.kept])

    @property
    def mean_stress(self) -> Floats:
        """Mean (Pa) in each agent of the stress in balance: xx, yy and xy, shape (agents, 3)."""
        return np.asarray(self._level * self.pair.mean_stress[self.kept])

    @cached_property
    def corner_displacement(self) -> Floats:
        """Displacement (m) of the agents' corners, counter-clockwise, shape (agents, 4, 2).

        Beyond the body that of what is nearest in the agent.
        """
        leaves = self.leaves[-1]
        size = (leaves.size * leaves.unit)[self.kept, None, None]
        at = leaves.lower()[self.kept, None] + size * _CORNERS
        return self._moved(np.repeat(self.kept, 4), at.reshape(-1, 2)).reshape(-1, 4, 2)

    def _moved(self, leaf: Ints, places: Floats) -> Floats:
        scale = self.first_edge * self.pair.problem.strain
        return np.asarray(scale * self.pair.displacement_at(leaf, places))

    @property
    def cut(self) -> Flags:
        """Which agents an outline cuts, shape (agents,)."""
        mesh = self.pair.fitting.mesh
        law = np.full(len(self.leaves[-1]), -1)
        law[mesh.triangle_leaf] = mesh.triangle_law
        several = np.zeros(len(law), dtype=np.bool_)
        several[mesh.triangle_leaf[law[mesh.triangle_leaf] != mesh.triangle_law]] = True
        short = self.area < self.size**2 * (1.0 - 1e-12)
        return np.asarray(short | several[self.kept])

    @property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of `mean_stress`, shape (agents,).

        In plane strain of two materials Poisson's ratio is that of the larger part of an agent.
        """
        stress = self.mean_stress
        beyond = np.zeros(len(stress))
        if self.scene.plane == "strain":
            beyond = self._ratios() * stress[:, :2].sum(axis=1)
        return von_mises(stress[:, [[0, 2], [2, 1]]], beyond)

    def _ratios(self) -> Floats:
        """Return Poisson's ratio of each agent in plane strain: that of its larger part."""
        mesh, laws = self.pair.fitting.mesh, self.pair.laws[0]
        area = np.zeros((len(self.leaves[-1]), len(laws)))
        area[mesh.square_leaf, mesh.square_law] = 1.0
        np.add.at(area, (mesh.triangle_leaf, mesh.triangle_law), self.pair.fitting.area)
        of = np.array([0.5 * (1.0 - one.shear / one.bulk) for one in laws])
        return np.asarray(of[area.argmax(axis=1)[self.kept]])

    def pieces(self) -> tuple[Ints, list[Floats]]:
        """Return what the agents hold as squares and triangles (m): of which agent each is.

        Curves are drawn by tangents or chords as far apart as the agents are large.
        """
        mesh = self.pair.fitting.mesh
        number = np.full(len(self.leaves[-1]), -1)
        number[self.kept] = np.arange(len(self.kept))
        place = self.first_edge * mesh.place
        agent = np.concatenate([number[mesh.square_leaf], number[mesh.triangle_leaf]])
        round_one = mesh.square[:, [0, 2, 3, 1]]
        return agent, [*place[round_one], *place[mesh.triangle]]

    @property
    def energy_bounds(self) -> tuple[float, float] | None:
        """Energies (J) below and above that of the true body, corners, curves and all.

        None where weight acts along curves: nothing is proved of these.
        """
        return self.energies[-1] if self.proof else None

    @property
    def strain_energy(self) -> float:
        """Energy (J) stored in the body: the middle of `energy_bounds`."""
        return 0.5 * sum(self.energies[-1])

    @property
    def error_estimate(self) -> float:
        """Error of the mean of both stresses, in the energy norm, relative; see `error_bound`."""
        return self.errors[-1]

    @property
    def error_bound(self) -> float | None:
        """Largest error of the mean of both stresses, in the energy norm, relative to the truth.

        None where nothing is proved.
        """
        return self.errors[-1] if self.proof else None

    @property
    def tolerance_kept(self) -> str:
        """Whether the error is within the tolerance: "proved" or "estimated", else "missed".

        Of a peak, and where weight acts along curves, nothing is proved.
        """
        if self.tolerance_at is not None:
            return "estimated" if self.peak and self.peak[2] <= self.tolerance else "missed"
        if self.errors[-1] > self.tolerance:
            return "missed"
        return "proved" if self.proof else "estimated"

    @property
    def goals(self) -> tuple[Goal, ...]:
        """What has been found of the peak that the tolerance is about."""
        from kaju.model.elastic.goals.quantities import Goal

        if self.tolerance_at is None or self.peak is None or not np.isfinite(self.peak[0]):
            return ()
        why = "nothing is proved of a stress at a point"
        value, error, _ = self.peak
        return (Goal(self.tolerance_at[0], (value,), error, abs(value), why),)

    def holds(self, points: Floats) -> Flags:
        """Tell which points (m), shape (n, 2), lie in the body or on its outline."""
        return np.asarray(self._found(points)[0] >= 0)

    def material_at(self, points: Floats) -> Ints:
        """Return which of the scene's materials is at points (m) of the body, shape (n,)."""
        return self._placed(points)[2]

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both of shape (n, 2).

        Raises
        ------
        ResultError
            If a point lies outside of the body.
        """
        leaf, places, _ = self._placed(points)
        return self._moved(leaf, places)

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m) of the body, shape (n, 2, 2).

        The mean of the stress in balance and that of the displacement, of which `error_bound` is
        proved in the energy norm; nothing is proved of a stress at a point.

        Raises
        ------
        ResultError
            If a point lies outside of the body.
        """
        leaf, places, material = self._placed(points)
        pair = self.pair
        laws = list(pair.laws[0])
        own = list(laws_of(self.scene).values())
        law = np.array([laws.index(one) for one in own])[material]
        strain = pair.strain_at(leaf, places, law)
        fitted = np.einsum("na,nab->nb", strain, np.array([one.stiffness for one in own])[material])
        balanced = pair.stress_at(leaf, places, law)
        stress = np.where(np.isfinite(balanced), 0.5 * (fitted + balanced), fitted)
        return np.asarray(self._level * stress[:, [[0, 2], [2, 1]]])

    def outline_stress(self, name: str) -> tuple[Floats, Floats]:
        """Return positions (m) along a named outline, and the hoop stress (Pa) there.

        Means along each agent of the stress of the displacement, of which nothing is proved.
        `notes` tell by how much the stress in balance differs. Where two materials meet
        along the outline the stress is that of the material outside: the one inside has another.

        Raises
        ------
        ResultError
            If no region with a true outline has that name.
        """
        found = self._outline(name, "outline_stress")
        return found[:, :2], found[:, 2]

    def outline_traction(self, name: str) -> tuple[Floats, Floats]:
        """Return positions (m) along an outline between two materials, and tractions (Pa) there.

        Those of the stress in balance, from outside on the region: the tension across the
        outline, and the stress along it, counter-clockwise. Shapes (n, 2). Nothing is proved of
        them.

        Raises
        ------
        ResultError
            If no region with a true outline has that name, or no two materials meet along it.
        """
        found = self._outline(name, "outline_traction")
        if name not in self.tractions:
            raise ResultError(
                f"outline_traction: along {name!r} no two materials meet; what acts there are loads"
            )
        return found[:, :2], self.tractions[name]

    @cached_property
    def hoops(self) -> dict[str, Floats]:
        """Of each named outline: x and y (m), hoop stress (Pa). Shape (n, 3)."""
        return {
            name: np.column_stack([self.first_edge * one.place, self._level * one.moved])
            for name, one in self._along.items()
        }

    @property
    def tractions(self) -> dict[str, Floats]:
        """Of each along which two materials meet, at the same places: tension, and stress along."""
        return {
            name: self._level * one.traction for name, one in self._along.items() if one.met.any()
        }

    @cached_property
    def _along(self) -> dict[str, HoopStress]:
        return {
            region.name: HoopStress.along(self.pair, number)
            for number, region in enumerate(self.scene.body.regions)
            if region.name is not None
        }

    def _outline(self, name: str, asked: str) -> Floats:
        if name not in self.hoops:
            known = ", ".join(self.hoops) or "none has a name"
            raise ResultError(f"{asked}: there is no outline {name!r}; there is {known}")
        return self.hoops[name]

    def _placed(self, points: Floats) -> tuple[Ints, Floats, Ints]:
        """Return of points the leaf, places in edges of the first agents, and the material."""
        leaf, places, material = self._found(points)
        if (leaf < 0).any():
            where = ", ".join(f"{c:g}" for c in points[np.argmax(leaf < 0)])
            raise ResultError(f"points: ({where}) m lies outside the body")
        return leaf, places, material

    def _found(self, points: Floats) -> tuple[Ints, Floats, Ints]:
        """Return of points the leaf, -1 outside of the body, places, and the material's number."""
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ResultError(f"points: finite numbers (m) of shape (n, 2), got {points!r:.80}")
        lattice, body = self.scene.lattice, self.scene.body
        number = {name: k for k, name in enumerate(laws_of(self.scene))}
        material = np.full(len(points), number.get(str(body.material), -1))
        for k, region in enumerate(body.regions):
            shape, of = region.shape_in(lattice, f"body.regions.{k}"), number.get(region.material)
            material[_within(shape, points) if of is None else shape.contains(points)] = (
                -1 if of is None else of
            )
        extent = np.array(lattice.extent)
        inside = (material >= 0) & ((points >= 0.0) & (points <= extent)).all(axis=1)
        # those on the upper sides of the array belong to the last agents
        at = np.minimum(points, extent * (1.0 - 1e-12)) / self.first_edge
        return np.where(inside, self.leaves[-1].at(at), -1), at, material

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        from kaju.model.elastic.goals.quantities import told

        size = self.size
        return {
            "rule": "elastic",
            "plane": self.scene.plane,
            "agents": self.agents,
            "agents_cut": int(self.cut.sum()),
            "generations": len(self.leaves),
            "smallest_agent": float(size.min()),
            "largest_agent": float(size.max()),
            "strain_energy": self.strain_energy,
            "max_displacement": float(np.hypot(*self.corner_displacement.reshape(-1, 2).T).max()),
            "tolerance": self.tolerance,
            "tolerance_at": told(self.tolerance_at or ()),
            "tolerance_kept": self.tolerance_kept,
            "error_estimate": finite(self.error_estimate),
            "error_bound": finite(self.error_bound),
            "energy_bounds": self.energy_bounds,
            "goals": [goal.figures() for goal in self.goals],
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
            If meshlane is not installed.
        ResultFileError
            If the file cannot be written.
        """
        agent, polygons = self.pieces()
        of = np.repeat(agent, [len(polygon) for polygon in polygons])
        moved = self._moved(self.kept[of], np.concatenate(polygons) / self.first_edge)
        values = {
            "von_mises": self.von_mises[agent],
            "stress": self.mean_stress[agent][:, [0, 2, 2, 1]],
            "agent": agent,
        }
        return write_polygons(path, polygons, 1e-8 * self.first_edge, values, moved)

    def _stored(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        text, scene_arrays = self.scene.to_archive()
        arrays: dict[str, NDArray[Any]] = {}
        for number, one in enumerate(self.leaves):
            arrays |= {f"generation.{number}.{name}": getattr(one, name) for name in OUTLINE_AGENTS}
        arrays |= {f"{_SCENE}{name}": array for name, array in scene_arrays.items()}
        about: dict[str, Any] = {
            name: getattr(self, name) for name in ("seconds", "tolerance", "first_edge", "proof")
        }
        about |= {"scene": text, "notes": list(self.notes), "energies": list(self.energies)}
        about["errors"] = [finite(error) for error in self.errors]
        about["shape"] = list(self.leaves[-1].shape)
        if self.tolerance_at is not None and self.peak is not None:
            peak = [finite(value) for value in self.peak]
            about |= {"outline": self.tolerance_at[0].at, "peak": peak}
        return arrays, about

    @classmethod
    def _restored(cls, archive: Archive) -> Self:
        scene = Scene.from_archive(archive.value("scene", str), archive.part(_SCENE))
        energies = archive.value("energies", list[tuple[float, float]])
        errors = archive.value("errors", list[float | None])
        shape = archive.value("shape", tuple[int, int])
        leaves = tuple(
            SquareLeaves(**archive.columns(OUTLINE_AGENTS, {}, f"generation.{k}."), shape=shape)
            for k in range(len(energies))
        )
        peak = archive.value("peak", list[float | None]) if "peak" in archive.about else None
        told = None if peak is None else [inf if one is None else one for one in peak]
        return cls(
            scene,
            archive.value("seconds", float),
            archive.value("tolerance", float),
            archive.value("first_edge", float),
            leaves,
            tuple(energies),
            tuple(inf if one is None else one for one in errors),
            archive.value("proof", bool),
            tuple(archive.value("notes", list[str])),
            None if told is None else (Stress(archive.value("outline", str), HOOP),),
            None if told is None else (told[0], told[1], told[2]),
        )


def _peak_note(name: str, along: HoopStress, level: float) -> list[str]:
    """Return a note where both estimates of the largest hoop stress differ."""
    if not len(along.moved):
        return []
    at = int(np.abs(along.moved).argmax())
    peak, off = level * float(along.moved[at]), level * along.apart(at)
    if off <= _APART * abs(peak):
        return []
    return [
        f"outline {name!r}: the largest hoop stress is {peak:.4g} Pa by the displacement, about "
        f"{2.0 * off:.2g} Pa off that of the stress in balance; nothing is proved of either"
    ]


def _within(shape: Shape, points: Floats) -> Flags:
    """Tell which points lie in a shape that is cut out: not on its edge, which is the body's."""
    lower, upper = shape.extent
    step = _EDGE * float((upper - lower).max())
    inside = np.ones(len(points), dtype=np.bool_)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        inside &= shape.contains(points + step * np.array([x, y]))
    return inside
