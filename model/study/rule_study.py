"""A scene's rule beside elasticity: run, fitted, and derived, against one answer.

The description of the prescribed rule compares it with finite elements along lines: in the
column under the load, and along rows at some depths. Here the same is done for any scene; the
answer that is believed is that of `kaju.solve` on smaller cells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kaju import __version__
from kaju.agents.elastic_rule import ElasticRule
from kaju.arrays import Floats, first_largest
from kaju.errors import ParameterError
from kaju.model.elastic.relaxation.elastic_model import ElasticModel
from kaju.model.results.result import BodyResult
from kaju.model.scene import Scene
from kaju.model.study.compare import Comparison, compare
from kaju.model.study.fitting import Fit, elastic_reference, fit_rule
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.transfer_result import TransferResult
from kaju.stopping import NOTE, Interrupted

if TYPE_CHECKING:
    from kaju.model.results.cuts import Cuts


CHOSEN = "prescribed rule"
FITTED = "prescribed rule, fitted"
DERIVED = "elastic agents"

ELASTIC_TOLERANCE = 1e-6
"""So far the elastic agents are run beside a prescribed rule."""


class StraightWay(NamedTuple):
    """A straight way: its ends (m), and its depth below the load (m), None of the way down."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    depth: float | None


@dataclass(frozen=True, eq=False)
class RuleStudy:
    """How a scene's rule does beside elasticity."""

    scene: Scene
    """What was asked, all of its load applied at once."""
    believed: BodyResult
    """The answer of elasticity."""
    comparisons: Mapping[str, Comparison]
    """What is judged by it: agents of the prescribed rule, of the same rule with fitted
    coefficients, and of the elastic rule."""
    fit: Fit | None
    """The coefficients that come closest."""
    axis: int
    """Along which the load presses most."""
    seconds: float
    """Time that all of it took (s)."""
    notes: tuple[str, ...] = ()
    """What is to be known of it, such as that it was interrupted."""

    @property
    def down(self) -> StraightWay:
        """The way from the middle of the load through the body, along the load."""
        place, _, far = self._load
        start, end = place.copy(), place.copy()
        start[self.axis], end[self.axis] = self._surface, far
        return StraightWay(tuple(start.tolist()), tuple(end.tolist()), None)

    def rows(self, depths: Sequence[float] | None = None) -> list[StraightWay]:
        """Return ways across the load at some depths (m) below it.

        Unless given at the middle of the first row of cells, and those nearest to a quarter and to
        half of the way down.
        """
        place, into, far = self._load
        length, edge = abs(far - self._surface), self.scene.lattice.cell_size
        if depths is None:
            layers = {int(share * length / edge + 1e-9) for share in (0.0, 0.25, 0.5)}
            depths = [(layer + 0.5) * edge for layer in sorted(layers)]
        across = 0 if self.axis else 1
        ways = []
        for depth in depths:
            if not 0.0 < depth < length:
                raise ParameterError(
                    f"depth: must lie between 0 and {length:g} m, the way through the body; "
                    f"got {depth}"
                )
            start, end = place.copy(), place.copy()
            start[self.axis] = end[self.axis] = self._surface + into * depth
            start[across], end[across] = 0.0, self.scene.lattice.extent[across]
            ways.append(StraightWay(tuple(start.tolist()), tuple(end.tolist()), float(depth)))
        return ways

    @property
    def pressure(self) -> float:
        """Size of the applied force over the area of the cells it presses on (Pa)."""
        applied, lattice = self.scene.applied(), self.scene.lattice
        force = float(np.abs(applied.force[:, self.axis]).sum())
        cells = np.unique(applied.cells, axis=0)
        flat = np.delete(cells, self.axis, axis=1)
        area = len(np.unique(flat, axis=0)) * lattice.face_area(self.scene.thickness)
        return force / area

    @property
    def _load(self) -> tuple[Floats, float, float]:
        """Middle of the load (m), its sense along the axis, and where the body ends there."""
        applied, lattice = self.scene.applied(), self.scene.lattice
        force = applied.force[:, self.axis]
        weight = np.abs(force)
        middle = (weight[:, None] * lattice.centres(applied.cells)).sum(axis=0) / weight.sum()
        # In the middle of a row of cells, or a way would run along their faces.
        place = lattice.centres(lattice.locate(middle[None] + 1e-9 * lattice.cell_size))[0]
        lower, upper = (np.asarray(end) * lattice.cell_size for end in self.scene.bounds())
        half = 0.5 * (lower[self.axis] + upper[self.axis])
        into = -1.0 if middle[self.axis] > half else 1.0
        return place, into, float(lower[self.axis] if into < 0.0 else upper[self.axis])

    @property
    def _surface(self) -> float:
        place, into, _ = self._load
        return float(place[self.axis] - 0.5 * into * self.scene.lattice.cell_size)

    def cuts(self) -> tuple[Cuts, dict[str, Cuts]]:
        """Return the force through every cut across the load: as believed, and of each answer."""
        axis = "xyz"[self.axis]
        answers = {name: found.result for name, found in self.comparisons.items()}
        judged = {n: one.cuts(axis) for n, one in answers.items() if isinstance(one, BodyResult)}
        return self.believed.cuts(axis), judged

    def unreached(self) -> dict[str, float]:
        """Return which part of the squared error of displacement lies where no load arrived."""
        shares = {}
        for name, comparison in self.comparisons.items():
            judged = comparison.result
            if isinstance(judged, TransferResult):
                key = judged.scene.lattice.key
                there = key(judged.scene.lattice.locate(comparison.points))
                square = comparison.displacement.error**2
                outside = ~np.isin(there, key(judged.last.cells))
                shares[name] = float(square[outside].sum() / square.sum())
        return shares

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        fitted = None
        if self.fit is not None:
            before, after = self.fit.misfit
            rule = self.fit.rule
            fitted = {
                "alpha": list(rule.alpha or ()),
                "beta": rule.beta,
                "misfit_before": before,
                "misfit_after": after,
                "runs": self.fit.evaluations,
            }
        reference = self.believed.summary()
        believed, judged = self.cuts()
        return {
            "answers": {name: c.summary() for name, c in self.comparisons.items()},
            "carried_through_cuts": {
                "axis": believed.axis,
                **{name: cuts.carried.tolist() for name, cuts in judged.items()},
            },
            "squared_error_where_no_load_arrived": self.unreached(),
            "fit": fitted,
            "believed": {key: reference[key] for key in ("agents", "error_estimate")},
            "notes": list(self.notes),
            "seconds": self.seconds,
            "kaju_version": __version__,
        }


def beside_elasticity(
    scene: Scene, *, resolution: int | None = None, evaluations: int = 200
) -> RuleStudy:
    """Set a scene's rule beside elasticity.

    A prescribed rule of squares or cubes is run as it is, with coefficients fitted by so many runs,
    about, and beside agents of the elastic rule; an elastic rule as it is. The believed answer has
    `resolution` cells for each of the scene's along every axis; by default as many as give 160 (in
    space 48) across the body, up to 8.
    """
    began = perf_counter()
    scene = scene.in_one_step()
    believed = elastic_reference(scene, resolution)
    force = np.abs(scene.applied().force).sum(axis=0)
    found: dict[str, Comparison] = {}
    fit: Fit | None = None

    def told(*notes: str) -> RuleStudy:
        axis, seconds = first_largest(force), perf_counter() - began
        return RuleStudy(scene, believed, found, fit, axis, seconds, notes)

    elastic = scene
    try:
        if scene.rule.kind == "prescribed":
            found[CHOSEN] = compare(LoadModel(scene).run(), believed)
            if evaluations:
                fit = fit_rule(scene, believed, evaluations=evaluations)
                found[FITTED] = fit.after
            elastic = scene.replace(rule=ElasticRule(tolerance=ELASTIC_TOLERANCE))
        found[DERIVED] = compare(ElasticModel(elastic, engine="arrays").run(), believed)
    except KeyboardInterrupt:
        if not found:
            raise
        raise Interrupted(told(NOTE)) from None
    return told()
