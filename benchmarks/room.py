"""What a body of equal cells costs beside a plain plate or cube: `python benchmarks/room.py`.

Processor time of `kaju.solve` a cell that is solved (where a member is one cell wide, the scene's
cells are halved), the least of several runs that take turns, so that a busy machine slows all
alike; with `--bounds` also what `error_bound` takes, as a share of that. The last line tells the
clock of the last body and the most memory held. `--bodies both --cells 256 --dimension 3 --runs 1
--alone` is a large solid with holes and two materials. Give another checkout's
`src` folder by PYTHONPATH to see its figures; the ratios to the plain body of the same run are
what can be compared.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import resource
import time

import numpy as np

import kaju

MATERIALS = {
    "plain": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "stiff": {"youngs_modulus": 1e15, "poissons_ratio": 0.3},
    "soft": {"youngs_modulus": 1e3, "poissons_ratio": 0.3},
    "mild": {"youngs_modulus": 1e11, "poissons_ratio": 0.3},
}
LEGEND = {0: "plain", 1: "air", 2: "stiff", 3: "soft", 4: "mild"}
BODIES = ("plain", "hole", "L", "stiff", "soft", "both", "pores", "random")


def kinds_of(name: str, cells: int, dimension: int) -> np.ndarray:
    """Return the kinds of cells of a body."""
    axes = [np.arange(cells, dtype=np.float32) + 0.5 - cells / 2] * dimension
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    ball = (place**2).sum(axis=-1) < (cells / (5 if dimension == 2 else 4)) ** 2
    kinds = np.zeros((cells,) * dimension, np.int8)
    if name in ("hole", "stiff", "soft"):
        kinds[ball] = {"hole": 1, "stiff": 2, "soft": 3}[name]
    elif name == "both":
        for x, y, radius, kind in ((0.3, 0.3, 0.15, 1), (0.7, 0.6, 0.15, 1), (0.5, 0.7, 0.15, 4)):
            middle = (np.array([x, y, 0.5][:dimension]) - 0.5) * cells
            kinds[((place - middle) ** 2).sum(axis=-1) < (radius * cells) ** 2] = kind
    elif name == "L":
        kinds[cells // 2 :, cells // 2 :] = 1
    elif name == "random":
        kinds[np.random.default_rng(1).random(kinds.shape) < 0.5] = 4
    elif name == "pores":
        from scipy import ndimage

        empty = np.random.default_rng(1).random(kinds.shape) < 0.3
        empty[..., :2] = empty[..., -2:] = False
        empty = ndimage.binary_opening(empty, np.ones((2,) * dimension))
        parts, _ = ndimage.label(~empty)
        kinds[parts != parts[(0,) * dimension]] = 1
    return kinds


def scene(name: str, cells: int, dimension: int) -> kaju.Scene:
    """Return a body, clamped below and pressed on in the middle of its top."""
    patch = [[0.04, 0.2], [0.06, 0.2]]
    if dimension == 3:
        patch = [[0.075, 0.075, 0.2], [0.125, 0.125, 0.2]]
    return kaju.Scene.from_array(
        kinds_of(name, cells, dimension),
        legend=LEGEND,
        cell_size=0.2 / cells,
        materials=MATERIALS,
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": patch}, "force": [0.0] * (dimension - 1) + [-2.0]}],
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=512, help="cells along every axis")
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--bodies", nargs="+", default=list(BODIES), choices=BODIES)
    parser.add_argument("--alone", action="store_true", help="no plain body beside them")
    parser.add_argument("--bounds", action="store_true", help="work out bounds as well")
    asked = parser.parse_args()
    names = list(dict.fromkeys([*(["plain"] if not asked.alone else []), *asked.bodies]))
    scenes = {name: scene(name, asked.cells, asked.dimension) for name in names}
    small = kaju.solve(scene("hole", 16, asked.dimension), strategy="uniform")  # Compiles.
    assert small.error_bound or not asked.bounds
    least, bound = dict.fromkeys(names, np.inf), dict.fromkeys(names, np.inf)
    method, finer = {}, {}
    for _ in range(asked.runs):
        for name, body in scenes.items():
            begun, start = time.perf_counter(), time.process_time()
            result = kaju.solve(body, strategy="uniform")
            solved, clock = time.process_time(), time.perf_counter() - begun
            if asked.bounds:
                result.energy_bounds  # noqa: B018
            bound[name] = min(bound[name], time.process_time() - solved)
            least[name] = min(least[name], solved - start)
            method[name], finer[name] = result.summary()["method"], result.subdivision
    print(f"{'body':8} {'µs a cell':>9} {'ratio':>6} {'halved':>6} {'bound':>6}  method")
    prices = {n: 1e6 * least[n] / (asked.cells * finer[n]) ** asked.dimension for n in names}
    for name, price in prices.items():
        ratio, halved = price / prices[names[0]], "yes" if finer[name] > 1 else "no"
        share = bound[name] / least[name]
        print(f"{name:8} {price:9.3f} {ratio:6.2f} {halved:>6} {share:6.2f}  {method[name]}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{names[-1]}: {clock:.2f} s by the clock; at most {peak:.2f} GB held")


if __name__ == "__main__":
    main()
