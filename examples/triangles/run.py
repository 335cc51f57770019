"""Press on a plate of triangles, and see how they pass the load on.

python examples/triangles/run.py --out triangles
"""

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
sys.path.insert(0, str(Path(__file__).parent))

import matplotlib.pyplot as plt
from triangles import Triangles

from kaju import LoadModel, PrescribedRule, Scene, animate, export_page, plot, stability


def scene():
    """A steel plate with a hole, 2 N on the triangle in the middle of its top."""
    return Scene(
        body={
            "lattice": Triangles,
            "cells": [25, 14],
            "cell_size": 0.01,
            "thickness": 0.002,
            "material": "steel",
            "regions": [{"disk": {"centre": [0.0751, 0.085], "radius": 0.016}, "material": "air"}],
        },
        sides={"bottom": "rigid"},
        loads=[{"cell": [12, 13], "side": "top", "force": [0.0, -2.0]}],
        rule=PrescribedRule(threshold=2e-4),
    )


def draw(result, folder):
    """Write a picture of the agents beside the deformed plate, a film and a page."""
    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 2, figsize=(11, 5.6))
    for ax, picture in zip(axes, ("agents", "deformed"), strict=True):
        plot(result, picture, ax=ax)
    figure.tight_layout()
    figure.savefig(folder / "triangles.png", dpi=80, bbox_inches="tight")
    plt.close(figure)
    animate(result, folder / "triangles.gif")
    export_page(result, folder / "triangles.html", title="Triangles")


def main(arguments=None):
    """Run, tell, and draw where asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for a picture, a film and a page")
    folder = parser.parse_args(arguments).out
    print(stability(scene()).verdict)
    result = LoadModel(scene()).run()
    stage = result.last
    print(f"{len(stage.cells)} triangles and {len(stage.boundary_cells)} boundary agents took part")
    off = max(stage.ledger.imbalance, 1e-15)
    print(f"{stage.ledger.taken:.4f} N taken, books off by less than {off:.0e}")
    if folder is not None:
        draw(result, folder)


if __name__ == "__main__":
    main()
