"""Two answers side by side: how far apart, where, and along which lines.

Errors are shares of the largest value of the second answer, the reference. Answers are compared
at points of both bodies, which must be the same body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError, ResultFileError
from kaju.model.outline.outline_result import OutlineResult
from kaju.model.results.archive import open_archive
from kaju.model.results.result import BodyResult, line_of, load_result
from kaju.model.scene import Body, Scene, body_cells
from kaju.model.study.reference import Reference

MOST_POINTS = 2_000_000  # larger bodies are compared at points that the caller names
FINE = 64  # cells along the longer side, at whose middles answers with true outlines are compared
_SAME = 1e-9

AnyAnswer = BodyResult | OutlineResult


@runtime_checkable
class Settling(Protocol):
    """A run of agents with the answer that they have settled to."""

    @property
    def result(self) -> BodyResult:
        """That answer."""


@runtime_checkable
class Stressed(Protocol):
    """An answer that knows stresses."""

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""


@dataclass(frozen=True, eq=False)
class Pair:
    """One quantity of two answers at the same points."""

    name: str
    unit: str
    values: Floats  # shape (n,), (n, dimension) or (n, dimension, dimension)
    reference: Floats  # likewise

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
        """Return one component, such as "y" of a displacement or "yy" of a stress."""
        order, axes = self.values.ndim - 1, "xyz"[: self.values.shape[-1]]
        if order == 0 or len(name) != order or not set(name) <= set(axes):
            known = "none" if order == 0 else " and ".join(axes if order == 1 else (axes[0] * 2,))
            raise ResultError(
                f"component: {self.name} has no {name!r}; "
                f"components are {known}{' and so on' if order == 2 else ''}"
            )
        place: Any = (slice(None), *map(axes.index, name))
        return Pair(f"{self.name} {name}", self.unit, self.values[place], self.reference[place])

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
    return np.asarray(np.linalg.norm(values.reshape(len(values), -1), axis=1))


@dataclass(frozen=True, eq=False)
class Profile:
    """Two answers along a line."""

    points: Floats  # (m), shape (n, dimension)
    distance: Floats  # from the start of the line (m), shape (n,)
    displacement: Pair
    stress: Pair | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far one answer is from another."""

    result: AnyAnswer  # the answer that is judged
    reference: AnyAnswer | Reference  # the answer that is believed
    points: Floats  # where they are compared (m), shape (n, dimension)
    displacement: Pair
    stress: Pair | None  # None if one of the answers knows no stress
    # √(∫Δσ:ε(Δσ) / ∫σ:ε(σ)) over the points, each of which stands for the same volume; Δσ is the
    # difference of the stresses, σ the reference's.
    energy_error: float | None

    @property
    def names(self) -> tuple[str, str]:
        """What the two answers are, in words."""
        believed = self.reference
        if isinstance(believed, Reference):
            return self.result.name, believed.source.partition(":")[0] or "reference"
        return self.result.name, believed.name

    @property
    def cells(self) -> Scene:
        """The larger cells of both answers, in whose middles they are compared by default."""
        return _coarse_and_fine(self.result, self.reference)[0]

    def along(self, start: Sequence[float], end: Sequence[float], count: int = 101) -> Profile:
        """Return both answers along a line from `start` to `end` (m).

        At `count` places, those outside of the body left out. A `Reference` has values only at
        those of its own points that lie on the line; where there is none, a `ResultError` is
        raised.
        """
        first, direction, length = line_of(start, end, self.points.shape[1], "along")
        if isinstance(self.reference, Reference):
            points = near_line(self.reference.points, first, direction, length)
        else:
            points = first + np.linspace(0.0, length, count)[:, None] * direction
            points = points[_inside(self.reference, points)]
        points = points[_inside(self.result, points)]
        if not len(points):
            raise ResultError(
                "along: no point of the line lies in both bodies, or is known to the reference"
            )
        pairs = _pairs(self.result, self.reference, points)
        return Profile(points, (points - first) @ direction, *pairs)

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        result, reference = self.names
        return {
            "result": result,
            "reference": reference,
            "points": len(self.points),
            "displacement": self.displacement.summary(),
            "stress": self.stress.summary() if self.stress else None,
            "energy_error": self.energy_error,
        }


def compare(
    result: AnyAnswer | Settling,
    reference: AnyAnswer | Reference | Settling,
    *,
    points: ArrayLike | None = None,
) -> Comparison:
    """Compare two answers for one body.

    Parameters
    ----------
    result : BodyResult, OutlineResult or ElasticRun
        The answer that is judged: of load transfer, or elastic.
    reference : BodyResult, OutlineResult, ElasticRun or Reference
        The answer that is believed; on cells of any size, or within true outlines.
    points : array, shape (n, dimension), optional
        Where to compare (m). By default in the middles of the larger cells of the two scenes,
        within true outlines of 64 along the longer side or more, as far as both bodies reach;
        a `Reference` that does not know these is compared at its own points.

    Returns
    -------
    Comparison

    Raises
    ------
    ResultError
        If the bodies or their loads differ, the points lie outside, or the reference is 0.

    Examples
    --------
    >>> from kaju import LoadModel, Scene, compare, solve
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> rough = LoadModel(scene).run()
    >>> print(f"{compare(rough, solve(scene)).displacement.misfit:.2f}")
    0.57
    """
    judged, believed = _answer(result), _answer(reference)
    if isinstance(judged, Reference):
        raise ResultError(
            "compare: the first answer is judged by the second, so it cannot be a reference; "
            "give the two the other way round"
        )
    _refuse_different(judged, believed)
    where = _common_points(judged, believed) if points is None else np.asarray(points, np.float64)
    displacement, stress = _pairs(judged, believed, where)
    if not displacement.scale > 0.0:
        raise ResultError(
            "compare: the reference moves nowhere, so no error can be a share of it; "
            "give the two the other way round"
        )
    if stress is not None and not stress.scale > 0.0:
        stress = None
    energy = None if stress is None else _energy_error(judged, where, stress)
    return Comparison(judged, believed, where, displacement, stress, energy)


def load_answer(path: str | Path) -> AnyAnswer | Reference:
    """Read a saved result or reference, whichever a file or a result's folder holds."""
    source = Path(path) / "result.npz" if Path(path).is_dir() else Path(path)
    if open_archive(source).about["kind"] == "reference":
        return Reference.load(source)
    result = load_result(source)
    _refuse_solid(result)
    if not isinstance(result, AnyAnswer):
        raise ResultFileError(
            f"{source}: holds a {type(result).__name__}; results of load transfer, of elasticity "
            "and references can be compared"
        )
    return result


def _answer(given: AnyAnswer | Reference | Settling) -> AnyAnswer | Reference:
    _refuse_solid(given)
    if isinstance(given, (BodyResult, OutlineResult, Reference)):
        return given
    if isinstance(given, Settling):
        return given.result
    raise ResultError(f"compare: results and references can be compared, got {given!r:.80}")


def _refuse_solid(given: object) -> None:
    """Refuse solids with true outlines: their cut cells know only means over all of each."""
    scene = getattr(given, "scene", None)
    if isinstance(scene, Scene) and scene.outlined and scene.lattice.dimension == 3:
        raise ResultError(
            "compare: what cells that an outline cuts in space tell are means over all of each, "
            "which no other answer knows; compare its energy_bounds, or ask both answers at "
            "points that lie in whole cells (displacement_at, stress_at)"
        )


def _pairs(
    result: AnyAnswer, reference: AnyAnswer | Reference, points: Floats
) -> tuple[Pair, Pair | None]:
    """Return displacements and, if both know them, stresses at points (m)."""
    both = (result, reference)
    displacement = Pair("displacement", "m", *(answer.displacement_at(points) for answer in both))
    if isinstance(reference, Reference) and reference.stress is None:
        return displacement, None
    if not isinstance(result, Stressed) or not isinstance(reference, Stressed):
        return displacement, None
    stresses = result.stress_at(points), reference.stress_at(points)
    return displacement, Pair("stress", "Pa", *stresses)


def near_line(points: Floats, first: Floats, direction: Floats, length: float) -> Floats:
    """Return the points on a line, in order."""
    along = (points - first) @ direction
    across = points - first - along[:, None] * direction
    near = np.linalg.norm(across, axis=1) < 1e-6 * length
    near &= (along > -1e-6 * length) & (along < (1.0 + 1e-6) * length)
    return np.asarray(points[near][np.argsort(along[near], kind="stable")])


def _energy_error(judged: AnyAnswer, points: Floats, stress: Pair) -> float:
    """Return the error in the energy norm, from σ:ε = (1+ν)/E (σ:σ - c (tr σ)²).

    c is ν/(1+ν) in plane stress and in three dimensions, and ν in plane strain.
    """
    scene = judged.scene
    if isinstance(judged, OutlineResult):
        kinds = judged.material_at(points)
    else:
        kinds = np.maximum(scene.kinds(scene.lattice.locate(points)), 0)
    modulus, ratio = _moduli(scene)[kinds].T
    share = ratio if scene.plane == "strain" else ratio / (1.0 + ratio)

    def energy(tensors: Floats) -> float:
        trace = np.trace(tensors, axis1=1, axis2=2)
        square = (tensors**2).sum(axis=(1, 2)) - share * trace**2
        return float(((1.0 + ratio) / modulus) @ square)

    return float(np.sqrt(energy(stress.values - stress.reference) / energy(stress.reference)))


def _moduli(scene: Scene) -> Floats:
    """Return Young's modulus (Pa) and Poisson's ratio of every material, shape (n, 2)."""
    return np.array([(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials])


# Where answers are compared.


def _common_points(result: AnyAnswer, other: AnyAnswer | Reference) -> Floats:
    """Return where to compare: the middles of the larger cells, as far as both reach."""
    coarse, fine = _coarse_and_fine(result, other)
    if not isinstance(other, Reference):
        exact = isinstance(result, OutlineResult) and isinstance(other, OutlineResult)
        _refuse_other_body(coarse, fine, exact)
    cells = _cells_in(coarse)
    points = coarse.lattice.centres(cells[coarse.kinds(cells) >= 0])
    points = points[_inside(result, points)]
    if isinstance(other, Reference):
        return points if (other.rows(points) >= 0).all() else other.points
    return points[_inside(other, points)]


def _inside(answer: AnyAnswer, points: Floats) -> Flags:
    """Tell which points (m) lie in the body of an answer."""
    if isinstance(answer, OutlineResult):
        return answer.holds(points)
    return body_cells(answer.grid, points)[1]


def _coarse_and_fine(result: AnyAnswer, other: AnyAnswer | Reference) -> tuple[Scene, Scene]:
    """Return the scenes of the larger and of the smaller cells of two answers."""
    both = [result, *(() if isinstance(other, Reference) else (other,))]
    outlined = any(isinstance(answer, OutlineResult) for answer in both)
    scenes = [
        _rastered(one.scene)
        if isinstance(one, OutlineResult)
        else (one.grid if outlined else one.scene)
        for one in both
    ]
    scenes.sort(key=lambda scene: -scene.lattice.cell_size)
    return scenes[0], scenes[-1]


def _rastered(scene: Scene) -> Scene:
    """Return cells of what lies in their middles in a body with true outlines."""
    many = -(-FINE // max(scene.lattice.shape))
    lattice = type(scene.lattice)(
        tuple(many * count for count in scene.lattice.shape), scene.lattice.cell_size / many
    )
    centres = lattice.centres(np.indices(lattice.shape).reshape(2, -1).T)
    codes, legend = np.zeros(len(centres), dtype=np.int16), {0: str(scene.body.material)}
    for number, region in enumerate(scene.body.regions, 1):
        shape = region.shape_in(scene.lattice, f"body.regions.{number - 1}")
        codes[shape.contains(centres)] = number
        legend[number] = region.material
    body = Body(
        array=codes.reshape(lattice.shape),
        cell_size=lattice.cell_size,
        thickness=scene.body.thickness,
        plane=scene.body.plane,
        allow_floating=True,
    )
    names = {str(code): legend[int(code)] for code in np.unique(codes)}
    return Scene(body=body, legend=names, materials=scene.materials)


def _cells_in(scene: Scene) -> Ints:
    """Return all cells of the box round a body, shape (n, dimension)."""
    lower, upper = scene.bounds()
    count = float(np.prod((upper - lower).astype(np.float64)))
    if count > MOST_POINTS:
        raise ResultError(
            f"points: the body has about {count:.2g} cells, more than {MOST_POINTS:.0e}; "
            "name the points to compare at with points=, such as the `middle` of spawned agents"
        )
    return np.indices(tuple(upper - lower)).reshape(len(lower), -1).T + lower


# What cannot be compared.


def _refuse_different(result: AnyAnswer, other: AnyAnswer | Reference) -> None:
    """Refuse what cannot be compared: other dimensions, materials, thickness or loads."""
    for answer in (result, other):
        if getattr(answer, "stiffness", None) is not None:
            raise ResultError(
                "compare: an answer with a field of stiffness is of another body than its scene's; "
                "compare its `energy` and `displacement` with those of another by yourself"
            )
    ours = result.scene.lattice.dimension
    theirs = other.dimension if isinstance(other, Reference) else other.scene.lattice.dimension
    if ours != theirs:
        raise ResultError(f"compare: a body in {ours} dimensions and one in {theirs} differ")
    if isinstance(other, Reference):
        return
    first, second = result.scene, other.scene
    if first.thickness != second.thickness:
        raise ResultError(
            f"compare: the bodies differ in thickness: {first.thickness:g} and "
            f"{second.thickness:g} m"
        )
    if first.plane != second.plane:
        raise ResultError(
            f"compare: one body is in plane {first.plane}, the other in plane {second.plane}"
        )
    cells = [answer for answer in (result, other) if isinstance(answer, BodyResult)]
    if len(cells) < 2:
        whole = all(answer.stage in (None, answer.scene.stages) for answer in cells)
        if not whole or len({repr(_described_loads(s, bool(cells))) for s in (first, second)}) > 1:
            raise ResultError(
                "compare: beside true outlines both answers must be to the whole of the same "
                "loads, described alike: the same sides, and in place of an outline a region "
                "round it; or compare the answers' energies"
            )
        return
    totals = [answer.scene.applied(answer.stage).force.sum(axis=0) for answer in cells]
    if np.abs(totals[0] - totals[1]).max(initial=0.0) > 1e-6 * np.abs(totals).max(initial=0.0):
        text = [", ".join(f"{value:g}" for value in total) for total in totals]
        raise ResultError(
            f"compare: the loads differ: ({text[0]}) N and ({text[1]}) N in all; "
            "compare results of one load, at the same stage of loading"
        )


def _described_loads(scene: Scene, beside_cells: bool) -> list[str]:
    """Return loads in words, in one order; outlines by their shape, or beside cells as a region.

    A region by which cells along an outline are chosen is wider than the outline.
    """
    shapes = {region.name: repr(region) for region in scene.body.regions}
    found = [f"gravity {scene.body.gravity if any(scene.body.gravity or ()) else None}"]
    for load in scene.loads:
        words = load.model_dump(exclude_none=True, exclude={"steps", "outline", "region"})
        if load.outline is not None or load.region is not None:
            words["region"] = beside_cells or shapes[load.outline]
        found.append(repr(sorted(words.items())))
    return sorted(found)


def _refuse_other_body(coarse: Scene, fine: Scene, exact: bool) -> None:
    """Refuse bodies that differ by more than the steps that cells cut into a slanted surface.

    Such steps lie at a surface, or where materials meet, in both bodies; `exact` ones have none.
    """
    if coarse is fine:
        return
    cell = coarse.lattice.cell_size
    for ours, theirs in zip(_corners(coarse), _corners(fine), strict=True):
        if np.abs(ours - theirs).max() > (1.0 + _SAME) * cell:
            text = [", ".join(f"{value:.4g}" for value in corner) for corner in (ours, theirs)]
            raise ResultError(
                f"compare: the bodies differ: one reaches to ({text[0]}) m, the other to "
                f"({text[1]}) m"
            )
    points = coarse.lattice.centres(_cells_in(coarse))
    points = points[_differ(_moduli_at(coarse, points), _moduli_at(fine, points))]
    for scene in (coarse, fine):
        own, step = _moduli_at(scene, points), np.zeros(len(points), dtype=np.bool_)
        for normal in () if exact else coarse.lattice.normals:
            step |= _differ(own, _moduli_at(scene, points + cell * normal))
        if not step.all():
            where = ", ".join(f"{value:.4g}" for value in points[np.argmin(step)])
            raise ResultError(f"compare: the bodies differ: by what is at ({where}) m")


def _corners(scene: Scene) -> tuple[Floats, Floats]:
    """Return the lowest and the highest corner (m) of a body."""
    lower, upper = scene.bounds()
    lowest, highest = scene.lattice.centres(np.stack([lower, upper - 1]))
    half = 0.5 * scene.lattice.cell_size
    return lowest - half, highest + half


def _moduli_at(scene: Scene, points: Floats) -> Floats:
    """Return Young's modulus and Poisson's ratio at points, 0 where there is no body."""
    kinds = scene.kinds(scene.lattice.locate(points))
    return np.where((kinds >= 0)[:, None], _moduli(scene)[np.maximum(kinds, 0)], 0.0)


def _differ(one: Floats, other: Floats) -> Flags:
    return np.asarray(np.any(np.abs(one - other) > _SAME * np.abs(one), axis=1))
