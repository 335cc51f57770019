"""Press lattices of springs between two points: more nodes, other shapes.

python examples/lattice/run.py --out lattice
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import networkx as nx
import numpy as np

mpl.use("Agg")
sys.path.insert(0, str(Path(__file__).parent))

import matplotlib.pyplot as plt
from lattice import NODES, SHAPES, free_motions, pressed, same_body, without_supports

from kaju import NetworkResult, plot
from kaju.model.network import triangular


def shapes(path: Path) -> dict[str, Any]:
    """Press lattices of three shapes, and draw them."""
    found = {f"{width} × {rows}": pressed(width, rows) for width, rows in SHAPES}
    for (width, rows), result in zip(SHAPES, found.values(), strict=True):
        plot(result).savefig(path / f"pressed_{width}x{rows}.png", dpi=110)
    return {name: figures_of(result) for name, result in found.items()}


def figures_of(result: NetworkResult) -> dict[str, Any]:
    """Return how many nodes there are, how far the tip gives, and where strain is largest."""
    node, tip = result.largest_displacement()
    names = result.network.names
    strain = np.abs(result.strain())
    # Several springs, since a lattice is symmetric: all that are equal but for rounding.
    worst = result.network.springs[strain > (1.0 - 1e-9) * strain.max()]
    return {
        "nodes": len(result.network.positions),
        "springs": len(result.network.springs),
        "tip": round(tip, 6),
        "tip_node": str(node),
        "share_of_height": round(result.share_of_height(), 6),
        "largest_strain": round(float(strain.max()), 6),
        "largest_strain_between": [[str(names[end]) for end in ends] for ends in worst],
    }


def more_nodes(path: Path) -> dict[str, Any]:
    """Make the same body of ever more nodes, and draw what changes and what does not."""
    found = {rows: figures_of(same_body(rows)) for rows in NODES}
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.4))
    nodes = [told["nodes"] for told in found.values()]
    left.semilogx(nodes, [1e3 * told["tip"] for told in found.values()], "o-", color="#0b5394")
    right.loglog(nodes, [t["largest_strain"] for t in found.values()], "s-", color="#b2340b")
    left.set(ylabel="tip gives by (mm)", ylim=(0.0, None))
    right.set(ylabel="largest strain of a spring")
    for axes in (left, right):
        axes.set_xlabel("nodes of the same body")
        axes.grid(color="#dddddd", lw=0.5)
    _save(figure, path / "more_nodes.png")
    return {str(rows): told for rows, told in found.items()}


def matrix(path: Path) -> dict[str, Any]:
    """Count what the matrix of connections says, and draw it."""
    network = triangular(5)
    joined = nx.to_numpy_array(network.to_graph(), weight=None, dtype=np.int64)
    figure, axes = plt.subplots(figsize=(4.6, 4.8))
    axes.imshow(joined, cmap="Greys", interpolation="nearest")
    axes.set_title("Which nodes are joined: 1 is black", fontsize=10, loc="left")
    axes.set(xlabel="node", ylabel="node")
    _save(figure, path / "matrix.png")
    return {
        "nodes": len(joined),
        "springs": int(joined.sum()) // 2,
        "most_neighbours": int(joined.sum(axis=1).max()),
        "free_motions_without_supports": free_motions(network),
    }


def _save(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Run the experiment, draw, and return the key figures that ``summary.json`` holds."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--out", type=Path, default=Path("lattice"), help="folder for results")
    asked = parser.parse_args(arguments)
    asked.out.mkdir(parents=True, exist_ok=True)
    summary = {
        "shapes": shapes(asked.out),
        "more nodes on the same body": more_nodes(asked.out),
        "matrix of connections": matrix(asked.out),
        "without supports": without_supports(),
    }
    (asked.out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    return summary


if __name__ == "__main__":
    print(json.dumps(main(), indent=1))
