"""Two answers side by side: how far apart, where, and along which lines.

Errors are shares of the largest value of the second answer, the reference. Answers are compared
at points of both bodies, which must be the same body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Flags, Floats, without_rows
from kaju.errors import ResultError, brief, by_name
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.moduli import constants_of
from kaju.model.results.archive import answer_of, stored_at
from kaju.model.results.result import BodyResult, line_of
from kaju.model.scene import Scene
from kaju.model.study.reference import Reference

Answer = BodyResult | Reference


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

    __repr__ = without_rows

    def component(self, name: str) -> Pair:
        """Return one component, such as "y" of a displacement or "yy" of a stress."""
        order, axes = self.values.ndim - 1, "xyz"[: self.values.shape[-1]]
        if order == 0 or len(name) != order or not set(name) <= set(axes):
            known = ", ".join(axis * order for axis in axes) if order else "none"
            raise ResultError(f"component: {self.name} has no {name!r}; components are {known}")
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
    __repr__ = without_rows


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far one answer is from another."""

    result: BodyResult  # the answer that is judged
    reference: Answer  # the answer that is believed
    points: Floats  # where they are compared (m), shape (n, dimension)
    displacement: Pair
    stress: Pair | None  # None if one of the answers knows no stress
    # √(∫Δσ:ε(Δσ) / ∫σ:ε(σ)) over the points, each of which stands for the same volume; Δσ is the
    # difference of the stresses, σ the reference's.
    energy_error: float | None

    @property
    def names(self) -> tuple[str, str]:
        """What the two answers are, in words."""
        return self.result.name, self.reference.name

    @property
    def cells(self) -> Scene:
        """The larger cells of both answers, in whose middles they are compared by default."""
        return _cells_of(self.result, self.reference)[0]

    def along(self, start: Sequence[float], end: Sequence[float], count: int = 101) -> Profile:
        """Return both answers along a line from `start` to `end` (m), at places in the body.

        A `Reference` has values only at those of its own points that lie on the line.
        """
        first, direction, length = line_of(start, end, self.points.shape[1], "along")
        if isinstance(self.reference, Reference):
            points = near_line(self.reference.points, first, direction, length)
        else:
            points = first + np.linspace(0.0, length, count)[:, None] * direction
        for answer in (self.reference, self.result):
            points = points[answer.holds(points)]
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

    def __repr__(self) -> str:
        figures = ", ".join(f"{key}={value!r}" for key, value in self.summary().items())
        return f"Comparison({figures})"


@by_name
def compare(result: Any, reference: Any, *, points: ArrayLike | None = None) -> Comparison:
    """Compare two answers for one body.

    Parameters
    ----------
    result : result of load transfer or of elasticity, or a run of agents
        The answer that is judged.
    reference : the same, or Reference
        The answer that counts as the truth, on cells of any size or within true outlines.
    points : array, shape (n, dimension), optional
        Where to compare (m). By default in the middles of the larger cells of the two answers,
        where both have body; a `Reference` that does not know these is compared at its own points.

    Returns
    -------
    Comparison
        `displacement` and `stress`, each with `misfit` and `max_error`; `energy_error`.

    Raises
    ------
    ResultError
        If the bodies or their loads differ, the points lie outside, or the reference is 0.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml")
    >>> found = kaju.compare(kaju.LoadModel(scene).run(), kaju.solve(scene))
    >>> print(f"{found.displacement.misfit:.2f}")
    0.95
    """
    judged, believed = _comparable(result), _comparable(reference)
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
            "compare: all displacements of the reference are 0, so there is no relative error; "
            "give the two the other way round"
        )
    if stress is not None and not stress.scale > 0.0:
        stress = None
    energy = None if stress is None else _energy_error(judged, where, stress)
    return Comparison(judged, believed, where, displacement, stress, energy)


def load_answer(path: str | Path) -> Answer:
    """Read a saved result or reference, whichever a file or a result's folder holds."""
    return _comparable(stored_at(path, reference=Reference))


def _comparable(given: Any) -> Answer:
    """Return the answer that is compared: a model's or a run's own, as far as it has come."""
    answer = answer_of(given)
    if isinstance(answer, Reference):
        return answer
    answer = getattr(answer, "result", answer)  # of agents the answer that they settled to
    if not isinstance(answer, BodyResult):
        raise ResultError(
            "compare: takes results of load transfer and of elasticity, and references, got "
            f"{brief(answer)}"
        )
    if answer.scene.outlined and answer.scene.lattice.dimension == 3:
        raise ResultError(
            "compare: in space a cell that an outline cuts has mean values only; compare "
            "energies, or values at points in whole cells (displacement_at, stress_at)"
        )
    return answer


def _pairs(result: BodyResult, reference: Answer, points: Floats) -> tuple[Pair, Pair | None]:
    """Return displacements and, if both know them, stresses at points (m)."""
    both = (result, reference)
    displacement = Pair("displacement", "m", *(answer.displacement_at(points) for answer in both))
    if isinstance(reference, Reference) and reference.stress is None:
        return displacement, None
    return displacement, Pair("stress", "Pa", *(answer.stress_at(points) for answer in both))


def near_line(points: Floats, first: Floats, direction: Floats, length: float) -> Floats:
    """Return the points on a line, in order."""
    along = (points - first) @ direction
    across = points - first - along[:, None] * direction
    near = np.linalg.norm(across, axis=1) < 1e-6 * length
    near &= np.abs(along - 0.5 * length) < (0.5 + 1e-6) * length
    return np.asarray(points[near][np.argsort(along[near], kind="stable")])


def _energy_error(judged: BodyResult, points: Floats, stress: Pair) -> float:
    """Return the error in the energy norm, from σ:ε = (1+ν)/E (σ:σ - c (tr σ)²).

    c is ν/(1+ν) in plane stress and in three dimensions, and ν in plane strain.
    """
    scene = judged.scene
    modulus, ratio = constants_of(scene)[np.maximum(judged.material_at(points), 0)].T
    share = ratio if scene.plane == "strain" else ratio / (1.0 + ratio)

    def energy(tensors: Floats) -> float:
        trace = np.trace(tensors, axis1=1, axis2=2)
        square = (tensors**2).sum(axis=(1, 2)) - share * trace**2
        return float(((1.0 + ratio) / modulus) @ square)

    return float(np.sqrt(energy(stress.values - stress.reference) / energy(stress.reference)))


# Where answers are compared.


def _common_points(result: BodyResult, other: Answer) -> Floats:
    """Return where to compare: the middles of the larger cells, as far as both reach."""
    coarse, fine = _cells_of(result, other)
    exact = result.scene.outlined and getattr(other, "scene", result.scene).outlined
    _refuse_other_body(coarse, fine, exact)
    points = _middles(coarse, coarse)
    points = points[coarse.kinds(coarse.lattice.locate(points)) >= 0]
    points = points[result.holds(points)]
    known: Flags = other.holds(points)
    if isinstance(other, Reference):
        return points if known.all() else other.points
    return points[known]


def _cells_of(*answers: Answer) -> list[Scene]:
    """Return the scenes of the cells of answers, those of the largest cells first."""
    bodies = [answer for answer in answers if isinstance(answer, BodyResult)]
    outlined = any(answer.scene.outlined for answer in bodies)
    scenes = [one.grid if outlined else one.scene for one in bodies]
    scenes.sort(key=lambda scene: -scene.lattice.cell_size)
    return [scenes[0], scenes[-1]]


def _middles(coarse: Scene, fine: Scene) -> Floats:
    """Return the middles (m) of the larger cells of a box round both bodies, (n, dimension)."""
    lower, upper = coarse.bounds()
    if coarse.lattice.boxes:
        ends = np.array(fine.bounds()) * (fine.lattice.cell_size / coarse.lattice.cell_size)
        lower = np.minimum(lower, np.floor(ends[0] + 1e-6).astype(np.int64))
        upper = np.maximum(upper, np.ceil(ends[1] - 1e-6).astype(np.int64))
    count = float(np.prod((upper - lower).astype(np.float64)))
    if count > 2_000_000:
        raise ResultError(
            f"points: the body has about {count:.2g} cells, more than 2e+06; "
            "name the points to compare at with points=, such as the `middle` of spawned agents"
        )
    cells = np.indices(tuple(upper - lower)).reshape(len(lower), -1).T + lower
    return coarse.lattice.centres(cells)


# What cannot be compared.


def _refuse_different(result: BodyResult, other: Answer) -> None:
    """Refuse what cannot be compared: other dimensions, thickness or loads."""
    if any(getattr(answer, "stiffness", None) is not None for answer in (result, other)):
        raise ResultError(
            "compare: an answer with an array of stiffness is of another body than its scene; "
            "compare its `energy` and `displacement` yourself"
        )
    ours = result.scene.lattice.dimension
    theirs = other.dimension if isinstance(other, Reference) else other.scene.lattice.dimension
    if ours != theirs:
        raise ResultError(f"compare: a body in {ours} dimensions and one in {theirs} differ")
    if isinstance(other, Reference):
        return
    first, second = result.scene, other.scene
    for what, unit in (("thickness", " m"), ("plane", "")):
        one, two = getattr(first, what), getattr(second, what)
        if one != two:
            raise ResultError(f"compare: the bodies differ in {what}: {one} and {two}{unit}")
    totals = [_total_load(answer) for answer in (result, other)]
    if np.abs(totals[0] - totals[1]).max(initial=0.0) > 1e-6 * np.abs(totals).max(initial=0.0):
        text = [", ".join(f"{value:g}" for value in total) for total in totals]
        raise ResultError(
            f"compare: the loads differ: ({text[0]}) N and ({text[1]}) N in all; "
            "compare results of one load, at the same stage of loading"
        )


def _total_load(answer: Any) -> Floats:
    """Return the sum of the loads (N) of an answer's stage."""
    if isinstance(answer, ElasticResult):  # within true outlines, where a scene has no cells, too
        return np.asarray(answer.found.applied(answer.stage).sum(axis=0))
    return np.asarray(answer.scene.applied(answer.stage).force.sum(axis=0))


def _refuse_other_body(coarse: Scene, fine: Scene, exact: bool) -> None:
    """Refuse bodies that differ by more than steps along a surface; `exact` ones have no steps."""
    if coarse is fine:
        return
    cell = coarse.lattice.cell_size
    points = _middles(coarse, fine)
    points = points[_differ(_moduli_at(coarse, points), _moduli_at(fine, points))]
    for scene in (coarse, fine):
        own, step = _moduli_at(scene, points), np.zeros(len(points), dtype=np.bool_)
        for normal in () if exact else coarse.lattice.normals:
            step |= _differ(own, _moduli_at(scene, points + cell * normal))
        if not step.all():
            where = ", ".join(f"{value:.4g}" for value in points[np.argmin(step)])
            raise ResultError(f"compare: the bodies differ: by what is at ({where}) m")


def _moduli_at(scene: Scene, points: Floats) -> Floats:
    """Return Young's modulus and Poisson's ratio at points, 0 where there is no body."""
    kinds = scene.kinds(scene.lattice.locate(points))
    return np.where((kinds >= 0)[:, None], constants_of(scene)[np.maximum(kinds, 0)], 0.0)


def _differ(one: Floats, other: Floats) -> Flags:
    return np.asarray(np.any(np.abs(one - other) > 1e-9 * np.abs(one), axis=1))
