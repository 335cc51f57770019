"""A tyre in a curve: loads along a ring, and ground that gives back what reaches it."""

import argparse
from math import cos, radians, sin

from kaju import LoadModel, PrescribedRule, Scene, plot

OUTER, INNER = 0.10, 0.07
"""Radii of the tyre's section (m), seen from behind."""
WEIGHT = 300.0  # What the rim presses down (N), on the lower half of its ring


def scene(sideways=0.0, cells=41):
    """A ring of rubber on the ground; in a curve the rim pushes outwards too."""
    edge = 2.0 * OUTER / cells
    middle = [OUTER, OUTER]
    ring = [
        {"disk": {"centre": middle, "radius": OUTER}, "material": "rubber"},
        {"disk": {"centre": middle, "radius": INNER}, "material": "air"},
    ]
    angles = [radians(angle) for angle in range(-165, 0, 15)]  # along the inner ring
    loads = []
    for angle in angles:
        radius = INNER + 0.8 * edge
        cell = [int((OUTER + radius * turn(angle)) / edge) for turn in (cos, sin)]
        down = WEIGHT * sin(angle) / -sum(map(sin, angles))
        outwards = sum(max(0.0, cos(each)) for each in angles)
        aside = sideways * WEIGHT * max(0.0, cos(angle)) / outwards
        loads.append({"cell": cell, "force": [aside, down]})
    return Scene(
        body={"cells": [cells, cells], "cell_size": edge, "thickness": 0.2, "material": "air"}
        | {"regions": ring},
        sides={"bottom": "rigid"},
        loads=loads,
        rule=PrescribedRule(alpha=(0.5, 0.8, 0.1), threshold=0.05, sense=True),
    )


def run(sideways):
    """Return the result with so much of the weight pushing sideways."""
    return LoadModel(scene(sideways)).run()


def outer_half(result):
    """Return what part of all loads the outer half takes, and what the ground gives back (N)."""
    stage, lattice = result.last, result.scene.lattice
    taken, across = stage.taken.sum(axis=1), lattice.centres(stage.cells)[:, 0] - OUTER
    inner, outer = taken[across < -1e-9].sum(), taken[across > 1e-9].sum()
    ground = stage.boundary_cells[:, 1] < 0
    return float(outer / (inner + outer)), float(stage.returned[ground].sum())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", nargs="?", help="a file to draw it into")
    path = parser.parse_args().picture
    for sideways in (0.0, 0.3, 0.6):
        part, given = outer_half(run(sideways))
        print(
            f"{sideways:.1f} of the weight outwards: the outer half takes {part:.1%} of all loads, "
            f"the ground gives back {given:.0f} N"
        )
    if path:
        plot(run(0.6), "taken", crop=False).savefig(path, dpi=90)
