"""Bite a firm and a soft noodle: dent over time, the shape that stays, and an animation.

python examples/noodle_bite/run.py --out noodle_bite --rows 9
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from matplotlib.figure import Figure
from noodle import FIRM, HEIGHT, SOFT, Bite, eat

import kaju

COLOURS = {FIRM.name: "#b45f06", SOFT.name: "#3d85c6"}


def force_over_time(bites: dict[str, Bite], path: Path) -> None:
    """Draw the force of the teeth, and the dent, over time."""
    figure = Figure((7.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for name, bite in bites.items():
        upper.plot(bite.course.times, bite.force, color="0.4")
        lower.plot(bite.course.times, 1e3 * bite.dent, color=COLOURS[name], label=name)
    upper.set(ylabel="force of the teeth (N)")
    lower.set(ylabel="loss of height (mm)", xlabel="time (s)")
    lower.set_ylim(top=1.35 * lower.get_ylim()[1])  # room for the legend over the curves
    lower.legend(frameon=False, loc="upper right", ncols=2)
    figure.savefig(path, dpi=120)


def shapes(bites: dict[str, Bite], path: Path) -> None:
    """Draw both noodles while bitten, just after the release, rested, and after chewing."""
    figure = Figure((12.0, 14.0), layout="constrained")
    axes = figure.subplots(4, len(bites))
    for column, (name, bite) in enumerate(bites.items()):
        records = (bite.released, bite.released + 1, bite.rested, len(bite.course.times) - 1)
        words = ("bitten", "let go", "rested", "chewed")
        for ax, word, record in zip(axes[:, column], words, records, strict=True):
            kaju.plot(bite.course, "deformed", ax=ax, record=record)
            ax.set_title(f"{name}, {word}: {bite.course.times[record]:.1f} s", fontsize=9)
    figure.savefig(path, dpi=100)


def figures_of(bite: Bite) -> dict[str, Any]:
    """Return the key figures of a bite."""
    course = bite.course
    return {
        "nodes": len(course.network.positions),
        "springs": len(course.network.springs),
        "deepest": bite.deepest,
        "deepest_share_of_height": bite.deepest[0] / HEIGHT,
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
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    bites = {noodle.name: eat(noodle, asked.rows) for noodle in (FIRM, SOFT)}
    force_over_time(bites, asked.out / "force_time.png")
    shapes(bites, asked.out / "shapes.png")
    kaju.animate(bites[SOFT.name].course, asked.out / "bite.gif", "times")
    summary = {name: figures_of(bite) for name, bite in bites.items()}
    (asked.out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


if __name__ == "__main__":
    print(json.dumps(main(), indent=1))
