"""Bite a firm and a soft noodle: dent over time, the shape that stays, and an animation.

python examples/noodle_bite/run.py --out noodle_bite --rows 9
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
sys.path.insert(0, str(Path(__file__).parent))

import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.collections import LineCollection
from noodle import FIRM, HEIGHT, SOFT, TOOTH, Bite, Meal, bitten, eat

from kaju.model.network.assembler import spring_geometry

COLOURS = {FIRM.name: "#b45f06", SOFT.name: "#3d85c6"}
STRAIN_SHOWN = 0.25


def force_over_time(bites: dict[str, Bite], path: Path) -> None:
    """Draw the force of the teeth, and the dent, over time."""
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(7.0, 5.0), sharex=True)
    for name, bite in bites.items():
        upper.plot(bite.course.times, bite.force, color="0.4")
        lower.plot(bite.course.times, 1e3 * bite.dent, color=COLOURS[name], label=name)
    upper.set(ylabel="force of the teeth (N)")
    lower.set(ylabel="loss of height (mm)", xlabel="time (s)")
    lower.set_ylim(top=1.35 * lower.get_ylim()[1])  # room for the legend over the curves
    lower.legend(frameon=False, loc="upper right", ncols=2)
    _save(figure, path)


def shapes(bites: dict[str, Bite], path: Path) -> None:
    """Draw both noodles while bitten, just after the release, rested, and after chewing."""
    figure, axes = plt.subplots(4, len(bites), figsize=(9.0, 7.0), sharex=True, sharey=True)
    for column, (name, bite) in enumerate(bites.items()):
        moments = {
            "bitten": bite.released,
            "let go": bite.released + 1,
            "rested": bite.rested,
            "chewed": len(bite.course.times) - 1,
        }
        for row, (word, record) in enumerate(moments.items()):
            _lattice(axes[row, column], bite, record)
            axes[row, column].set_title(
                f"{name}, {word}: {bite.course.times[record]:.1f} s", fontsize=9
            )
    _save(figure, path)


def nodes_and_material(by_rows: dict[int, dict[str, Bite]], path: Path) -> None:
    """Draw what the number of nodes changes, and what the material changes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.2))
    rows = list(by_rows)
    for name, colour in COLOURS.items():
        bites = [by_rows[count][name] for count in rows]
        deepest = [100.0 * bite.deepest[0] / HEIGHT for bite in bites]
        left.plot(rows, deepest, "o-", color=colour, label=name)
        stays = [100.0 * bite.dent[-1] / HEIGHT for bite in bites]
        right.plot(rows, stays, "o-", color=colour)
    for axes, label in ((left, "dent of the first bite"), (right, "dent that stays")):
        axes.set(
            xlabel="rows of nodes", ylabel=f"{label} (% of height)", ylim=(0.0, None), xticks=rows
        )
    left.legend(frameon=False, fontsize=8)
    _save(figure, path)


def animation(bites: dict[str, Bite], path: Path, frames: int = 60) -> None:
    """Write an animation of both noodles, in even steps of time."""
    figure, axes = plt.subplots(len(bites), 1, figsize=(8.0, 2.7 * len(bites)), squeeze=False)
    end = min(bite.course.times[-1] for bite in bites.values())

    def draw(frame: int) -> list[Any]:
        now = end * frame / (frames - 1)
        for axis, (name, bite) in zip(axes[:, 0], bites.items(), strict=True):
            axis.clear()
            times = bite.course.times
            record = min(int(np.searchsorted(times, now)), len(times) - 1)
            _lattice(axis, bite, record)
            axis.set_title(f"{name}: {now:4.1f} s, {bite.force[record]:.2f} N", fontsize=9)
        return []

    FuncAnimation(figure, draw, frames=frames).save(path, writer=PillowWriter(fps=8), dpi=100)
    plt.close(figure)


def _lattice(axes: Any, bite: Bite, record: int) -> None:
    """Draw springs, blue where pressed and red where pulled, and the teeth while they bite."""
    network, moved = bite.course.network, bite.course.displacement[record]
    at = 1e3 * (network.positions + moved)
    strain = spring_geometry(network, moved).elongation / network.initial_length
    look = {"cmap": "coolwarm", "clim": (-STRAIN_SHOWN, STRAIN_SHOWN), "linewidths": 1.2}
    axes.add_collection(LineCollection(list(at[network.springs]), array=strain, **look))
    middle, half = float(1e3 * network.positions[:, 0].mean()), 0.5e3 * TOOTH
    if bite.force[record] > 0.0:
        for nodes, outward in zip(bitten(network), (1.0, -1.0), strict=True):
            edge = float(at[nodes, 1].mean())
            teeth_x = [middle - half, middle + half, middle + 0.6 * half, middle - 0.6 * half]
            teeth_y = [edge, edge, edge + 0.9 * outward, edge + 0.9 * outward]
            axes.fill(teeth_x, teeth_y, color="0.75")
    across = at[:, 0].min() - 0.3, at[:, 0].max() + 0.3
    axes.set(xlim=across, ylim=(-1.2, 1e3 * HEIGHT + 1.2), aspect="equal")
    axes.set_axis_off()


def _save(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def figures_of(bite: Bite) -> dict[str, Any]:
    """Return the key figures of a bite."""
    course = bite.course
    return {
        "nodes": len(course.network.positions),
        "springs": len(course.network.springs),
        "deepest": bite.deepest,
        "dent_just_released": float(bite.dent[bite.released + 1]),
        "dent_at_the_end": float(bite.dent[-1]),
        "work": float(course.work[-1]),
        "stored": float(course.stored[-1]),
        "turned_to_heat": float(course.dissipated[-1]),
        "made_by_the_time_stepping": float(course.numerical[-1]),
    }


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Bite, draw, and return the key figures that ``summary.json`` holds."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--out", type=Path, default=Path("noodle_bite"), help="folder for results")
    parser.add_argument("--rows", type=int, default=9, help="rows of nodes, an odd number")
    parser.add_argument("--width", type=int, help="nodes along the strip; left out: 10 mm")
    parser.add_argument(
        "--compare", type=int, nargs="*", default=[5, 9, 13], help="rows to compare"
    )
    parser.add_argument("--chews", type=int, default=3, help="bites after the first")
    parser.add_argument("--frames", type=int, default=60, help="frames of the animation, 0: none")
    parser.add_argument("--no-pictures", action="store_true", help="write numbers only")
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    meal = Meal(chews=asked.chews)
    by_rows = {
        rows: {noodle.name: eat(noodle, rows, meal, asked.width) for noodle in (FIRM, SOFT)}
        for rows in sorted({asked.rows, *asked.compare})
    }
    bites = by_rows[asked.rows]
    if not asked.no_pictures:
        force_over_time(bites, asked.out / "force_time.png")
        shapes(bites, asked.out / "shapes.png")
        if len(by_rows) > 1:
            nodes_and_material(by_rows, asked.out / "nodes_and_material.png")
        if asked.frames > 1:
            animation(bites, asked.out / "bite.gif", asked.frames)
    summary = {
        f"{rows} rows": {name: figures_of(bite) for name, bite in pair.items()}
        for rows, pair in by_rows.items()
    }
    (asked.out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


if __name__ == "__main__":
    print(json.dumps(main(), indent=1))
