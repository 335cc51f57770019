"""What a cell costs: processor time of one core for bodies of equal cells, the least of three runs.

python benchmarks/equal_cells.py         # 512² and 64³ cells, as docs/elasticity.md states
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from shared import in_turn

from kaju import Scene, solve

MODULI = {"plain": 1e9, "stiff": 1e15, "soft": 1e3, "mild": 1e11}
MATERIALS = {n: {"youngs_modulus": e, "poissons_ratio": 0.3} for n, e in MODULI.items()}
LEGEND = {0: "plain", 1: "air", 2: "stiff", 3: "soft", 4: "mild"}


def kinds_of(name: str, cells: int, dimension: int) -> NDArray[np.int8]:
    """Return the kinds of cells of a body."""
    axes = [np.arange(cells, dtype=np.float32) + 0.5 - cells / 2] * dimension
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    kinds = np.zeros((cells,) * dimension, np.int8)
    if name in ("hole", "stiff", "soft"):
        ball = (place**2).sum(axis=-1) < (cells / (5 if dimension == 2 else 4)) ** 2
        kinds[ball] = {"hole": 1, "stiff": 2, "soft": 3}[name]
    elif name == "both":
        for x, y, kind in ((0.3, 0.3, 1), (0.7, 0.6, 1), (0.5, 0.7, 4)):
            middle = (np.array([x, y, 0.5][:dimension]) - 0.5) * cells
            kinds[((place - middle) ** 2).sum(axis=-1) < (0.15 * cells) ** 2] = kind
    elif name == "L":
        kinds[cells // 2 :, cells // 2 :] = 1
    elif name == "random":
        kinds[np.random.default_rng(1).random(kinds.shape) < 0.5] = 4
    return kinds


for cells, dimension in ((512, 2), (64, 3)):
    low, high = [[0.04], [0.075, 0.075]][dimension - 2], [[0.06], [0.125, 0.125]][dimension - 2]
    common = {"legend": LEGEND, "cell_size": 0.2 / cells, "materials": MATERIALS}
    pressed = {"box": [[*low, 0.2], [*high, 0.2]]}
    common["loads"] = [{"region": pressed, "force": [0.0] * (dimension - 1) + [-2.0]}]
    for name in ("plain", "hole", "L", "soft", "stiff", "both", "random"):
        kinds = kinds_of(name, cells, dimension)
        scene = Scene.from_array(kinds, sides={"bottom": "rigid"}, **common)
        solve(scene)  # compiles
        ((result, seconds),) = in_turn(3, lambda scene=scene: solve(scene, tolerance=None))
        count = (cells * result.subdivision) ** dimension
        print(f"{name:8} {cells}^{dimension}: {1e6 * seconds / count:6.2f} µs a cell")
