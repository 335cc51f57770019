"""A scene's rule beside elasticity: as it is, fitted, and derived, against one answer.

They are compared along lines: in the column under the load, and along rows at some depths. The
answer that is believed is that of `kaju.solve` on smaller cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kaju import __version__
from kaju.agents.elastic_rule import ElasticRule
from kaju.arrays import Floats, first_largest
from kaju.model.elastic.relaxation.elastic_model import ElasticModel
from kaju.model.results.result import BodyResult
from kaju.model.scene import Scene
from kaju.model.study.compare import Comparison, compare
from kaju.model.study.fitting import Fit, elastic_reference, fit_rule
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.transfer_result import TransferResult
from kaju.stepping import NOTE, Interrupted

if TYPE_CHECKING:
    from kaju.model.results.cuts import Cuts


class StraightWay(NamedTuple):
    """A line through the body: its ends (m), and its depth below the load (m; None: along it)."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    depth: float | None


@dataclass(frozen=True, eq=False)
class RuleStudy:
    """How a scene's rule does beside elasticity."""

    scene: Scene  # what was asked, all of its load applied at once
    believed: BodyResult  # the answer of elasticity
    # What is judged by it: agents of the prescribed rule, of the same rule with fitted
    # coefficients, and of the elastic rule.
    comparisons: Mapping[str, Comparison]
    fit: Fit | None  # the coefficients that come closest
    axis: int  # along which the load presses most
    seconds: float  # time that all of it took (s)
    notes: tuple[str, ...] = ()  # such as that it was interrupted

    @property
    def down(self) -> StraightWay:
        """The line from the middle of the load through the body, along the load."""
        surface, _, far = self._along_load
        return self._line({self.axis: (surface, far)}, None)

    def rows(self) -> list[StraightWay]:
        """Return lines across the load, in the first row of cells, a quarter and half way down."""
        surface, into, far = self._along_load
        length, edge = abs(far - surface), self.scene.lattice.cell_size
        layers = {int(share * length / edge + 1e-9) for share in (0.0, 0.25, 0.5)}
        across, lines = 0 if self.axis else 1, []
        for layer in sorted(layers):
            depth = (layer + 0.5) * edge
            height, extent = surface + into * depth, self.scene.lattice.extent[across]
            ends = {self.axis: (height, height), across: (0.0, extent)}
            lines.append(self._line(ends, depth))
        return lines

    def _line(self, ends: Mapping[int, tuple[float, float]], depth: float | None) -> StraightWay:
        """Return the line through the middle of the load whose ends differ along some axes."""
        points = np.tile(self._middle[1], (2, 1))
        for axis, both in ends.items():
            points[:, axis] = both
        start, end = map(tuple, points.tolist())
        return StraightWay(start, end, depth)

    @cached_property
    def _middle(self) -> tuple[Floats, Floats]:
        """The middle of the load (m), and the centre of the cell that it lies in."""
        applied, lattice = self.scene.applied(), self.scene.lattice
        weight = np.abs(applied.force[:, self.axis])
        middle = (weight[:, None] * lattice.centres(applied.cells)).sum(axis=0) / weight.sum()
        # Between two rows it belongs to the upper one: a line along faces would be ambiguous.
        cell = lattice.locate(middle[None] + 1e-9 * lattice.cell_size)
        return middle, np.asarray(lattice.centres(cell)[0])

    @property
    def _along_load(self) -> tuple[float, float, float]:
        """Along its axis: the loaded surface (m), the sense into the body, and its far end (m)."""
        edge = self.scene.lattice.cell_size
        middle, place = (float(point[self.axis]) for point in self._middle)
        ends = [float(end[self.axis]) * edge for end in self.scene.bounds()]
        into = -1.0 if middle > 0.5 * sum(ends) else 1.0
        return place - 0.5 * into * edge, into, ends[0] if into < 0.0 else ends[1]

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
        reference, (believed, judged) = self.believed.summary(), self.cuts()
        return {
            "answers": {name: c.summary() for name, c in self.comparisons.items()},
            "carried_through_cuts": {
                "axis": believed.axis,
                **{name: cuts.carried.tolist() for name, cuts in judged.items()},
            },
            "squared_error_where_no_load_arrived": self.unreached(),
            "fit": self.fit and self.fit.summary(),
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

    def study(*notes: str) -> RuleStudy:
        axis, seconds = first_largest(force), perf_counter() - began
        return RuleStudy(scene, believed, found, fit, axis, seconds, notes)

    elastic = scene
    try:
        if scene.rule.kind == "prescribed":
            found["prescribed rule"] = compare(LoadModel(scene).run(), believed)
            if evaluations:
                fit = fit_rule(scene, believed, evaluations=evaluations)
                found["prescribed rule, fitted"] = fit.after
            elastic = scene.replace(rule=ElasticRule(tolerance=1e-6))
        found["elastic agents"] = compare(ElasticModel(elastic, engine="arrays").run(), believed)
    except KeyboardInterrupt:
        if not found:
            raise
        raise Interrupted(study(NOTE)) from None
    return study()
