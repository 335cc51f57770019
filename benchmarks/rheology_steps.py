"""What time costs: elements, networks and bodies per implicit step.

Run it with

    python benchmarks/rheology_steps.py

Medians of several steps. A step of backward Euler is one implicit step, one of sdirk2 three.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import kaju
from kaju.agents.materials import Material
from kaju.model.elastic.grid import problem_of_scene
from kaju.model.elastic.solver import solve_problem
from kaju.model.network.lattices import triangular
from kaju.model.rheology import schemes as steps
from kaju.model.rheology.elastic import CreepingBody
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.march import take_step
from kaju.model.rheology.network import CreepingNetwork

REPEATS = 5
HELD = np.ones((2, 2))
SOFT = ThreeElement(K_f=1e5, D_f=3e5, D_d=2e6)


def median(job: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the median time of a job (s), after one to warm up."""
    job()
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        job()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def elements(count: int = 10**6) -> None:
    """Advance a million different elements, each under its own force."""
    rng = np.random.default_rng(1)
    laws = steps.Laws(*rng.uniform(1.0, 2.0, (3, count)))
    state, force = steps.Stretch(*np.zeros((2, count))), rng.standard_normal(count)

    def implicit_step() -> None:
        steps.moved(state, steps.rates(laws, 0.1, state, force), 0.1)

    print(f"{count:,} elements: {1e3 * median(implicit_step):.1f} ms per implicit step")
    as_springs = median(lambda: steps.as_spring(laws, 0.1, state))
    print(f"{count:,} elements as springs: {1e3 * as_springs:.1f} ms")


def network(width: int) -> None:
    """Advance a triangular lattice of three-element springs."""
    lattice = triangular(width, force=0.01)
    body = CreepingNetwork(lattice, ThreeElement(1.0, 1.5, 10.0))
    for method in steps.SCHEMES.values():
        fields = body.start()
        fields, _ = take_step(body, method, fields, 0.1, HELD)
        taken = median(lambda m=method, f=fields: take_step(body, m, f, 0.1, HELD), 3)
        print(f"{len(lattice.positions):,} nodes, {method.name}: {taken:.2f} s per step")


def plate(size: int) -> None:
    """Advance a plate with an inclusion, and compare with one elastic solution of it."""
    kinds = np.zeros((size, size), dtype=np.int64)
    kinds[size // 4 : size // 2, size // 4 : size // 2] = 1
    materials = [Material("soft", 1e5, 0.3, rheology=SOFT), Material("stiff", 1e6, 0.3)]
    side = 0.01 * size
    scene = kaju.Scene.from_array(
        kinds,
        legend=dict(enumerate(material.name for material in materials)),
        cell_size=0.01,
        materials={
            m.name: {"youngs_modulus": m.youngs_modulus, "poissons_ratio": m.poissons_ratio}
            for m in materials
        },
        sides={"bottom": "rigid"},
        loads=[
            {"region": {"box": [[0.45 * side, side], [0.55 * side, side]]}, "force": [0.0, -1.0]}
        ],
    )
    problem, _ = problem_of_scene(scene)
    elastic = median(lambda: solve_problem(problem, 1e-8), 3)
    print(f"{size}² plate, elastic to 1e-8: {elastic:.2f} s")
    body = CreepingBody(problem, materials)
    for method in steps.SCHEMES.values():
        fields, _ = take_step(body, method, body.start(), 0.2, HELD)
        taken = median(lambda m=method, f=fields: take_step(body, m, f, 0.2, HELD), 3)
        share = taken / elastic
        print(f"{size}² plate, {method.name}: {taken:.2f} s per step, {share:.2f} of it")


if __name__ == "__main__":
    elements()
    network(101)
    network(317)
    plate(256)
    plate(512)
