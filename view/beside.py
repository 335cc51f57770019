"""A scene's rule beside elasticity: four figures, and what they say in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .comparison import (
    Line,
    legend_below,
    plot_profile,
    plot_profiles,
    plot_shapes,
    plot_stress_ratio,
    stress_symbol,
)
from .style import new_figure
from .units import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaju.model.beside_elasticity import BesideElasticity, Way
    from kaju.model.compare import Comparison


BELIEVED = "elasticity"


def pictures_beside(
    study: BesideElasticity, depths: Sequence[float] | None = None
) -> dict[str, Figure]:
    """Return the four figures, by what they show.

    Parameters
    ----------
    study : BesideElasticity
        A rule beside elasticity.
    depths : sequence of float, optional
        How far below the load the rows lie (m); three depths unless given.

    Returns
    -------
    dict of str to Figure
        "stress_ratio": stress down from the load as a share of the pressure, over that of
        elasticity, and stress across over stress along. "stress_rows": both normal stresses
        along rows. "deformed" (plane bodies only): the shapes. "displacement": down from the
        load, and along the rows.
    """
    names = "xyz"[: study.scene.lattice.dimension]
    along, across = names[study.axis], names[0 if study.axis else 1]
    down, rows = _line(study, study.down), [_line(study, way) for way in study.rows(depths)]
    found = study.comparisons
    stress = plot_stress_ratio(found, down, along + across, study.pressure, believed=BELIEVED)
    figures = {"stress_ratio": stress}
    figures["stress_rows"] = _stress_rows(study, rows, (along, across))
    if study.scene.lattice.dimension == 2:
        shapes = {name: comparison.result for name, comparison in found.items()}
        figures["deformed"] = plot_shapes(shapes, study.believed, name=BELIEVED)
    figures["displacement"] = plot_profiles(
        found, [down, *rows], "displacement", along, believed=BELIEVED, symbol=f"$u_{along}$"
    )
    return figures


def _line(study: BesideElasticity, way: Way) -> Line:
    across = "xyz"[0 if study.axis else 1]
    if way.depth is None:
        return Line("way down from the load", way.start, way.end)
    return Line(f"{across}, {quantity(way.depth, 'm')} below the load", way.start, way.end)


def _stress_rows(study: BesideElasticity, rows: Sequence[Line], axes: tuple[str, str]) -> Figure:
    figure = new_figure((4.1 * len(rows) + 0.5, 7.2))
    panels = figure.subplots(len(axes), len(rows), squeeze=False)
    for axis, row in zip(axes, panels, strict=True):
        for ax, line in zip(row, rows, strict=True):
            plot_profile(
                ax, study.comparisons, line, ("stress", axis * 2), None, stress_symbol(axis)
            )
    legend_below(figure, study.comparisons, BELIEVED)
    return figure


def words_beside(study: BesideElasticity) -> list[str]:
    """Say how far each of the answers is off, and where."""
    told = []
    unreached = study.unreached()
    for name, comparison in study.comparisons.items():
        told.append(f"{name}: {_grade(comparison.displacement.misfit)}")
        told.append(f"  {_off(comparison, 'displacement')}")
        if comparison.stress is not None:
            told.append(f"  {_off(comparison, 'stress')}")
        if unreached.get(name, 0.0) > 0.01:
            told.append(
                f"  {unreached[name]:.0%} of the squared error of the displacement lies where no "
                "load arrived"
            )
    if study.fit is not None:
        told.append(f"the fit: {study.fit}")
    return told


def _grade(misfit: float) -> str:
    if misfit < 0.03:
        return "the answer of elasticity, nearly"
    if misfit < 0.3:
        return "close to elasticity"
    return "the trend of elasticity" if misfit < 0.7 else "hardly closer than no answer at all"


def _off(comparison: Comparison, what: str) -> str:
    pair = comparison.displacement if what == "displacement" else comparison.stress
    assert pair is not None
    place = comparison.points[int(np.argmax(pair.error))]
    edges = ", ".join(f"{1e3 * value:.4g}" for value in place)
    return (
        f"{what} off by up to {pair.max_error:.1%} of the largest "
        f"({quantity(pair.scale, pair.unit)}), at ({edges}) mm; by {pair.l2_error:.1%} in the "
        f"mean square; misfit {pair.misfit:.3g} (1: no better than nothing)"
    )
