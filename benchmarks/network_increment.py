"""Time and memory of one increment of a large spring network.

Loads a triangular lattice (bottom row held, top row pressed) by a few increments of forward
Euler, and prints what each took: assembly, factorisation or multigrid, solution, checks.

    python benchmarks/network_increment.py [nodes in a row] [auto|direct|multigrid] [3]
"""

import resource
import sys
import time
from dataclasses import replace

import numpy as np

from kaju.model.network import IncrementalLoading, SpringNetwork, face_centred, triangular


def pressed(width: int) -> SpringNetwork:
    lattice = triangular(width)
    height = lattice.positions[:, 1]
    forces = np.zeros_like(lattice.forces)
    forces[0, height == height.max(), 1] = -0.001
    bottom = np.repeat((height == 0.0)[:, None], 2, axis=1)
    return replace(lattice, held=bottom, forces=forces)


def main(width: int, method: str, dimension: int) -> None:
    network = pressed(width) if dimension == 2 else face_centred(width, width, width)
    start = time.perf_counter()
    loading = IncrementalLoading(network, 10, scheme="euler", method=method)
    prepared = time.perf_counter() - start
    print(f"{len(network.positions)} nodes, {len(network.springs)} springs: {loading.solver.name}")
    print(f"  ordering and pattern, once: {prepared:6.2f} s")
    for _ in range(4):
        start, worked = time.perf_counter(), time.process_time()
        loading.step()
        passed, worked = time.perf_counter() - start, time.process_time() - worked
        print(f"  increment: {passed:6.2f} s ({worked:.2f} s of processor time)")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"  largest memory: {memory:.2f} GB")


if __name__ == "__main__":
    arguments = sys.argv[1:] + ["316", "auto", "2"][len(sys.argv) - 1 :]
    main(int(arguments[0]), arguments[1], int(arguments[2]))
