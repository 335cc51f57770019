"""The answer to a body with true outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.goals.quantities import HOOP, Stress
from kaju.model.elastic.moduli import von_mises
from kaju.model.results.archive import Archive
from kaju.model.results.formats import OUTLINE_AGENTS
from kaju.model.results.mesh import write_polygons
from kaju.model.results.result import Result, finite
from kaju.model.scene import Scene
from kaju.model.scene.shapes import Shape

from .convex_pieces import area_of
from .fitted_displacement import shapes_at, strain_rows
from .hoop_stress import HoopStress
from .outline_bracket import OutlineBracket, error_between
from .outline_problem import OutlineProblem
from .square_leaves import SquareLeaves

if TYPE_CHECKING:
    import pandas

    from kaju.model.elastic.goals.quantities import Goal

    from .true_shapes import HeldLeaves

_SCENE = "scene."
_ENERGIES = "lower_energy", "upper_energy"
_EDGE = 1e-9  # of a shape's extent: points this near to the edge of a hole belong to the body
_APART = 0.02  # share of a peak by which both fields may differ there without a note


@dataclass(frozen=True, eq=False, repr=False)
class CutAgents:
    """Agents of one generation; see the attributes of `OutlineResult`."""

    x: Ints
    y: Ints
    width: Ints
    corner_displacement: Floats
    mean_stress: Floats
    area: Floats
    energy_bounds: tuple[float, float]

    @classmethod
    def of_bracket(
        cls, scene: Scene, problem: OutlineProblem, found: OutlineBracket, edge: float
    ) -> CutAgents:
        """Return the agents of bounds, in units."""
        level = problem.strain * scene.cell_materials[0].youngs_modulus
        unit = 0.5 * level * scene.thickness * edge**2 * problem.strain
        low, high = found.bounds
        return cls(
            found.leaves.x,
            found.leaves.y,
            found.leaves.size,
            edge * problem.strain * found.fitted.displacement[found.fitted.corner],
            level * found.balanced.mean_stress,
            edge**2 * found.balanced.area,
            (float(low * unit), float(high * unit)),
        )


@dataclass(frozen=True, eq=False, repr=False)
class OutlineResult(Result, CutAgents):
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
    tractions : dict of str to array
        Of each along which two materials meet, at the same places: the tension across it (Pa),
        and the stress counter-clockwise along it that acts on the region (Pa). Shape (n, 2).
    notes : tuple of str
        What a reader should know.
    earlier : tuple of CutAgents
        The agents of the generations before; see `generations`.
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
    hoops: dict[str, Floats]
    tractions: dict[str, Floats]
    notes: tuple[str, ...]
    earlier: tuple[CutAgents, ...] = ()
    tolerance_at: tuple[Stress, ...] | None = None
    peak: tuple[float, float, float] | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        problem: OutlineProblem,
        found: OutlineBracket,
        edge: float,
        tolerance: float,
        seconds: float,
        generations: Sequence[CutAgents],
        tolerance_at: tuple[Stress, ...] | None = None,
        peak: tuple[float, float, float] | None = None,
    ) -> OutlineResult:
        """Return the answer that bounds stand for, the last of the generations, in units."""
        level = problem.strain * scene.cell_materials[0].youngs_modulus
        hoops, tractions, notes = {}, {}, list[str]()
        if loose := int(found.balanced.loose.sum()):
            notes.append(
                f"parts of the body in {loose} agents hang on nothing and bear nothing; if a "
                "support was meant, give it"
            )
        for region, true in zip(scene.body.regions, problem.body.regions, strict=True):
            if region.name is not None:
                along = HoopStress.along(true, problem, found)
                hoop = level * along.balanced
                hoops[region.name] = np.column_stack([edge * along.place, hoop])
                if tolerance_at is None or tolerance_at[0].at != region.name:
                    notes += _peak_note(region.name, hoop, level * along.mean, level * along.moved)
                if along.met.any():
                    tractions[region.name] = level * along.traction
        return cls(
            **vars(generations[-1]),
            scene=scene,
            seconds=seconds,
            tolerance=tolerance,
            first_edge=edge,
            hoops=hoops,
            tractions=tractions,
            notes=tuple(notes),
            earlier=tuple(generations[:-1]),
            tolerance_at=tolerance_at,
            peak=None if peak is None else (level * peak[0], level * peak[1], peak[2]),
        )

    @property
    def generations(self) -> tuple[OutlineResult, ...]:
        """The answers of all generations of agents, this one the last; none but it has hoops."""
        alone: dict[str, Any] = {"hoops": {}, "tractions": {}, "notes": (), "earlier": ()}
        alone |= {"peak": None}
        return (*(replace(self, **vars(one), **alone) for one in self.earlier), self)

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
        cut = self.area < self.size**2 * (1.0 - 1e-12)
        if len(self.scene.cell_materials) > 1:
            cut[[k for k, leaf in self._held()[0].cut.items() if len(leaf.held) > 1]] = True
        return np.asarray(cut)

    @property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of `mean_stress`, shape (agents,).

        In plane strain of two materials Poisson's ratio is that of the larger part of an agent.
        """
        xx, yy, _ = self.mean_stress.T
        beyond = np.zeros(len(xx))
        if self.scene.plane == "strain":
            beyond = self._ratios() * (xx + yy)
        return von_mises(self.mean_stress[:, [[0, 2], [2, 1]]], beyond)

    def pieces(self) -> tuple[Ints, list[Floats]]:
        """Return what the agents hold as convex polygons (m): of which agent each is, and corners.

        Curves are drawn by tangents or chords as far apart as the agents are large.
        """
        held, edge = self._held()
        square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        agent, polygons = [], []
        for number, (lower, size) in enumerate(zip(self.lower, self.size, strict=True)):
            of = [lower + size * square]
            if held.whole[number] < 0:
                pieces = held.cut[number].held.values()
                of = [edge * np.array(piece) for at in pieces for piece in at]
            polygons += of
            agent += [number] * len(of)
        return np.array(agent, dtype=np.int64), polygons

    def _held(self) -> tuple[HeldLeaves, float]:
        """Return what agents hold at most, and the length (m) that its coordinates count."""
        from .outlined_scene import problem_of
        from .true_shapes import CutLeaves

        problem, edge = problem_of(self.scene)
        leaves = SquareLeaves(self.x, self.y, self.width, problem.shape)
        return CutLeaves(problem.body).refined(leaves)[0], edge

    def _ratios(self) -> Floats:
        """Return Poisson's ratio of each agent in plane strain: that of its larger part."""
        held = self._held()[0]
        law = held.whole.copy()
        for k, leaf in held.cut.items():
            area = {of: sum(map(area_of, pieces)) for of, pieces in leaf.held.items()}
            law[k] = held.laws.index(max(area, key=lambda of: area[of]))
        return np.array([0.5 * (1.0 - one.shear / one.bulk) for one in held.laws])[law]

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
        """Whether `error_bound` is within the tolerance: "proved", else "missed".

        Of a peak, whose error is never proved: "estimated", else "missed".
        """
        if self.tolerance_at is not None:
            return "estimated" if self.peak and self.peak[2] <= self.tolerance else "missed"
        return "proved" if self.error_bound <= self.tolerance else "missed"

    @property
    def goals(self) -> tuple[Goal, ...]:
        """What has been found of the peak that the tolerance is about."""
        from kaju.model.elastic.goals.quantities import Goal

        if self.tolerance_at is None or self.peak is None or not np.isfinite(self.peak[0]):
            return ()
        why = "nothing is proved of a stress at a point"
        return (Goal(self.tolerance_at[0], *self.peak, no_bound=why),)

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
        agent, local, _ = self._placed(points)
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
        from .outlined_scene import laws_of

        agent, local, material = self._placed(points)
        moved = self.corner_displacement[agent].reshape(-1, 8)
        strain = np.einsum("nai,ni->na", strain_rows(local), moved) / self.size[agent, None]
        laws = np.array([law.stiffness for law in laws_of(self.scene).values()])
        modulus = self.scene.cell_materials[0].youngs_modulus
        stress = modulus * np.einsum("na,nab->nb", strain, laws[material])
        return np.asarray(stress[:, [[0, 2], [2, 1]]])

    def outline_stress(self, name: str) -> tuple[Floats, Floats]:
        """Return positions (m) along a named outline, and the hoop stress (Pa) there.

        Means over what agents hold, carried on to the outline, of which nothing is proved.
        `notes` tell by how much other estimates of the largest differ. Where two materials meet
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

    def _outline(self, name: str, asked: str) -> Floats:
        if name not in self.hoops:
            known = ", ".join(self.hoops) or "none has a name"
            raise ResultError(f"{asked}: there is no outline {name!r}; there is {known}")
        return self.hoops[name]

    def _placed(self, points: Floats) -> tuple[Ints, Floats, Ints]:
        """Return of points the agent, where in it they lie, from 0 to 1, and of which material."""
        agent, material = self._found(points)
        if (agent < 0).any():
            where = ", ".join(f"{c:g}" for c in points[np.argmax(agent < 0)])
            raise ResultError(f"points: ({where}) m lies outside the body")
        return agent, (points - self.lower[agent]) / self.size[agent, None], material

    def _found(self, points: Floats) -> tuple[Ints, Ints]:
        """Return of points the agent, -1 outside of the body, and the number of the material."""
        from .outlined_scene import laws_of

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
        leaves = SquareLeaves(self.x, self.y, self.width, (1, 1))
        # those on the upper sides of the array belong to the last agents
        at = np.minimum(points, extent * (1.0 - 1e-12)) / self.first_edge
        return np.where(inside, leaves.at(at), -1), material

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        from kaju.model.elastic.goals.quantities import told

        size = self.size
        return {
            "rule": "elastic",
            "plane": self.scene.plane,
            "agents": self.agents,
            "agents_cut": int(self.cut.sum()),
            "generations": len(self.earlier) + 1,
            "smallest_agent": float(size.min()),
            "largest_agent": float(size.max()),
            "strain_energy": self.strain_energy,
            "max_displacement": float(np.hypot(*self.corner_displacement.reshape(-1, 2).T).max()),
            "tolerance": self.tolerance,
            "tolerance_at": told(self.tolerance_at or ()),
            "tolerance_kept": self.tolerance_kept,
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
        arrays: dict[str, NDArray[Any]] = {}
        agents: dict[str, CutAgents] = {"": self}
        agents |= {f"earlier.{number}.": one for number, one in enumerate(self.earlier)}
        for prefix, one in agents.items():
            arrays |= {prefix + name: getattr(one, name) for name in OUTLINE_AGENTS}
        arrays |= {f"hoop.{name}": found for name, found in self.hoops.items()}
        arrays |= {f"traction.{name}": found for name, found in self.tractions.items()}
        arrays |= {f"{_SCENE}{name}": array for name, array in scene_arrays.items()}
        numbers = {name: getattr(self, name) for name in ("seconds", "tolerance", "first_edge")}
        numbers |= dict(zip(_ENERGIES, self.energy_bounds, strict=True))
        more: dict[str, Any] = {"scene": text, "notes": list(self.notes)}
        more["earlier_energies"] = [one.energy_bounds for one in self.earlier]
        if self.tolerance_at is not None and self.peak is not None:
            more |= {"outline": self.tolerance_at[0].at, "peak": self.peak}
        return arrays, numbers | more

    @classmethod
    def _restored(cls, archive: Archive) -> Self:
        scene = Scene.from_archive(archive.value("scene", str), archive.part(_SCENE))
        energies = archive.value("earlier_energies", list[tuple[float, float]])
        hoops = {
            name: archive.array(f"hoop.{name}", "f", (None, 3)) for name in archive.part("hoop.")
        }
        peak = "peak" in archive.about
        return cls(
            scene=scene,
            seconds=archive.value("seconds", float),
            tolerance=archive.value("tolerance", float),
            first_edge=archive.value("first_edge", float),
            **archive.columns(OUTLINE_AGENTS, {}),
            energy_bounds=(archive.value(_ENERGIES[0], float), archive.value(_ENERGIES[1], float)),
            hoops=hoops,
            tractions={
                name: archive.array(f"traction.{name}", "f", (len(hoops[name]), 2))
                for name in archive.part("traction.")
            },
            notes=tuple(archive.value("notes", list[str])),
            earlier=tuple(
                CutAgents(
                    **archive.columns(OUTLINE_AGENTS, {}, f"earlier.{k}."), energy_bounds=both
                )
                for k, both in enumerate(energies)
            ),
            tolerance_at=(Stress(archive.value("outline", str), HOOP),) if peak else None,
            peak=archive.value("peak", tuple[float, float, float]) if peak else None,
        )


def _peak_note(name: str, hoop: Floats, mean: Floats, moved: Floats) -> list[str]:
    """Return a note where three estimates of the largest hoop stress differ."""
    if not len(hoop):
        return []
    at = np.abs(hoop).argmax()
    peak, inner, other = hoop[at], mean[at], moved[at]
    if max(abs(inner - peak), abs(other - peak)) <= _APART * abs(peak):
        return []
    return [
        f"outline {name!r}: the largest hoop stress is {peak:.4g} Pa in balance ({inner:.4g} Pa as "
        f"a mean over the agent there), and {other:.4g} Pa by the displacement; nothing is proved "
        "of either"
    ]


def _within(shape: Shape, points: Floats) -> Flags:
    """Tell which points lie in a shape that is cut out: not on its edge, which is the body's."""
    lower, upper = shape.extent
    step = _EDGE * float((upper - lower).max())
    inside = np.ones(len(points), dtype=np.bool_)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        inside &= shape.contains(points + step * np.array([x, y]))
    return inside
