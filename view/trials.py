"""Pictures of trials: what came of every family of scenes, and where coefficients are stable."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from .picture_files import save
from .style import FAINT, INK, new_figure

if TYPE_CHECKING:
    from kaju.model.study.trials.stability_map import StabilityMap
    from kaju.model.study.trials.trial import Outcome

COLOURS = {
    "answered": "#3b6a8f",
    "refused": "#d9d4c5",
    "failed": "#b2340b",
    "not finished": "#e8b04a",
}
WORDS = {name: name for name in COLOURS} | {"refused": "refused by a named error"}

SMALLEST = 1e-3
"""True errors are drawn from here on: the elements that measure them are off by less."""


def plot_trials(outcomes: Sequence[Outcome], path: str | Path) -> Path:
    """Draw what came of trials, and estimated against true errors; return the file."""
    figure = new_figure((7.0, 8.5))
    upper, lower = figure.subplots(2, 1)
    _bars(upper, outcomes)
    _errors(lower, outcomes)
    return save(figure, path)


def _bars(ax: Axes, outcomes: Sequence[Outcome]) -> None:
    """Draw a bar for every kind of trial, in shares of its trials."""
    names = sorted({o.engine for o in outcomes}, reverse=True)
    counts = np.zeros((len(names), len(COLOURS)))
    for o in outcomes:
        counts[names.index(o.engine), list(COLOURS).index(o.verdict)] += 1
    whole = counts.sum(axis=1)
    start = np.zeros(len(names))
    for column, (verdict, colour) in enumerate(COLOURS.items()):
        share = counts[:, column] / whole
        ax.barh(range(len(names)), share, left=start, color=colour, label=WORDS[verdict])
        start += share
    ax.set_yticks(range(len(names)), names)
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel(f"share of the trials ({len(outcomes):,} in all)")
    ax.set_ylim(-0.6, len(names) - 0.4)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)


def _errors(ax: Axes, outcomes: Sequence[Outcome]) -> None:
    known = [o for o in outcomes if np.isfinite(o.true_error) and o.estimate > 0.0]
    stated = np.array([o.estimate for o in known])
    true = np.maximum([o.true_error for o in known], SMALLEST)
    ax.plot([SMALLEST, 10.0], [SMALLEST, 10.0], color=INK, linewidth=0.8)
    ax.plot(true, stated, "o", color=COLOURS["answered"], markersize=4, alpha=0.6)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("true error (energy norm; graded elements of order 4)")
    ax.set_ylabel("error that the answer states")
    ax.set_title(f"{len(known)} plane bodies; above the line: on the safe side", fontsize=11)


def plot_stability(maps: Sequence[StabilityMap], path: str | Path) -> Path:
    """Draw which coefficients are stable, the certificate's line, and what happened."""
    rows = -(-len(maps) // 2)
    figure = new_figure((7.0, 3.6 * rows))
    for place, one in enumerate(maps, start=1):
        ax = figure.add_subplot(rows, 2, place)
        x, y = np.meshgrid(one.forward, one.friction, indexing="ij")
        grew = one.growth > 1.0
        ax.plot(x[~grew], y[~grew], "o", color=COLOURS["answered"], markersize=4, clip_on=False)
        ax.plot(x[grew], y[grew], "x", color=COLOURS["failed"], markersize=4, clip_on=False)
        ax.contour(x, y, one.radius, levels=[1.0], colors=INK, linewidths=1.5)
        ax.contour(x, y, one.radius, levels=[0.5, 1.5, 2.0], colors=FAINT, linewidths=0.5)
        ax.set_title(f"β = {one.beta:g}, ν = {one.poissons_ratio:g}", fontsize=11)
        ax.set_xlabel("forward α₂")
        ax.set_ylabel("friction α₃")
    figure.suptitle("● ended or faded, × grew; line: the certificate's limit", fontsize=11)
    return save(figure, path)
