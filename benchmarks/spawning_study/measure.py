"""What an answer costs, and how far it is from the truth."""

from __future__ import annotations

import csv
import logging
from dataclasses import asdict, dataclass
from math import sqrt
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import NamedTuple

import numpy as np
from peers.adaptive_elements import adaptive, uniform

from kaju import solve

logging.getLogger("skfem").setLevel(logging.ERROR)

METHODS = {
    "spawning": "kaju, agents that spawn",
    "aimed": "kaju, agents that spawn for the displacement",
    "equal": "kaju, equal cells",
    "uniform": "scikit-fem, uniform, linear",
    "adaptive": "scikit-fem, adaptive, linear",
    "adaptive 2": "scikit-fem, adaptive, quadratic",
}


@dataclass(frozen=True)
class Row:
    """One answer.

    Attributes
    ----------
    case, method : str
    setting : float
        Tolerance of spawning, cells per cell of the scene, or step of refinement.
    cells : int
        Agents, cells or elements.
    unknowns : int
        Displacement components, about two for a plane cell.
    seconds : float
        Median of `runs` warm runs, from the description to the displacements.
    energy_error : float
        √|U/U* − 1|, the relative error in the energy norm.
    max_error, l2_error : float
        Of the displacement at the case's points, as shares of the largest.
    estimate : float
        What the method itself says about its error in the energy norm; about the largest
        displacement error, if that was its aim.
    """

    case: str
    method: str
    setting: float
    cells: int
    unknowns: int
    seconds: float
    runs: int
    energy_error: float
    max_error: float
    l2_error: float
    estimate: float

    @property
    def factor(self) -> float:
        """What was estimated over what is true."""
        return self.estimate / (self.max_error if self.method == "aimed" else self.energy_error)


class Cost(NamedTuple):
    """What a body of some size costs at a tolerance."""

    size: int
    body_cells: int
    agents: int
    seconds: float


class Order(NamedTuple):
    """Errors of an answer of so many cells, in the energy norm."""

    strategy: str
    cells: int
    estimate: float
    energy: float
    stress: float


def timed(job):
    """Run a job, warm, several times; return its answer, the median time and how often."""
    start = perf_counter()
    answer = job()
    first = perf_counter() - start
    repeats = 7 if first < 0.3 else 3 if first < 4.0 else 1
    times = []
    for _ in range(repeats):
        start = perf_counter()
        answer = job()
        times.append(perf_counter() - start)
    return answer, median(times), repeats


def row(case, method, setting, answer, truth, cost, estimate=float("nan")):
    """Return what was found; `cost` is cells, unknowns, seconds and runs."""
    energy = getattr(answer, "strain_energy", None) or answer.energy
    true = truth.displacement
    away = np.linalg.norm(answer.displacement_at(truth.points) - true, axis=1)
    away /= np.linalg.norm(true, axis=1).max()
    error = sqrt(abs(energy / truth.strain_energy - 1.0))
    l2 = float(np.sqrt(np.mean(away**2)))
    return Row(case.name, method, setting, *cost, error, float(away.max()), l2, estimate)


def by_spawning(case, truth, tolerances=None):
    """Yield a row for every tolerance in the energy norm."""
    for tolerance in tolerances or case.tolerances:
        found, seconds, runs = timed(
            lambda t=tolerance: solve(case.scene, strategy="spawning", tolerance=t)
        )
        cost = (found.agents, len(found.found.spawning.balance.free), seconds, runs)
        yield row(case, "spawning", tolerance, found, truth, cost, found.error_estimate)


def by_aim(case, truth, tolerances):
    """Yield a row for every tolerance of the largest displacement error."""
    for tolerance in tolerances:
        found, seconds, runs = timed(
            lambda t=tolerance: solve(case.scene, tolerance_at="displacement", tolerance=t)
        )
        cost = (found.agents, len(found.found.spawning.balance.free), seconds, runs)
        yield row(case, "aimed", tolerance, found, truth, cost, found.displacement_error_estimate)


def by_equal_cells(case, truth, resolutions=None):
    """Yield a row for every resolution."""
    for k in resolutions or case.resolutions:
        found, seconds, runs = timed(
            lambda k=k: solve(case.scene, resolution=k, strategy="uniform")
        )
        cells = found.summary()["agents"]
        cost = (cells, case.scene.lattice.dimension * cells, seconds, runs)
        yield row(case, "equal", k, found, truth, cost, found.error_estimate)


def by_elements(case, truth, method, limit=None):
    """Yield a row for every mesh below a number of unknowns.

    An adaptive mesh costs all the steps that led to it.
    """
    order = 2 if method.endswith("2") else 1
    steps = uniform(case.scene, order) if method == "uniform" else adaptive(case.scene, order)
    start, step = perf_counter(), 0
    while True:
        answer = next(steps)
        answer, estimate = answer if isinstance(answer, tuple) else (answer, float("nan"))
        seconds = perf_counter() - start
        cost = (answer.basis.mesh.nelements, answer.unknowns, seconds, 1)
        yield row(case, method, step, answer, truth, cost, estimate)
        growth = 2 ** answer.basis.mesh.dim() if method == "uniform" else 1.7
        if answer.unknowns * growth > (limit or case.elements):
            return
        step += 1
        start = perf_counter() - (0.0 if method == "uniform" else seconds)


def write_rows(path: Path, rows) -> None:
    """Write rows as comma-separated values."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(_table(rows[0])))
        writer.writeheader()
        writer.writerows(map(_table, rows))


def _table(found):
    return found._asdict() if hasattr(found, "_asdict") else asdict(found)


def cost_at(target, rows, cost, error):
    """Return the cost at an error, on straight lines between measurements, both axes log.

    Beyond the smallest error measured, which `measured_at` tells, cells are those of the line
    through the last two, and other costs grow like them. NaN above the largest error.
    """
    finest = sorted(rows, key=lambda r: getattr(r, error))
    x, y, size = (np.log([getattr(r, name) for r in finest]) for name in (error, cost, "cells"))
    at = np.log(target)
    if len(x) < 2 or at > x[-1]:
        return float("nan")
    if at >= x[0]:
        return float(np.exp(np.interp(at, x, y)))
    return float(np.exp(y[0] + (size[1] - size[0]) / (x[1] - x[0]) * (at - x[0])))


def measured_at(target, rows, error):
    """Tell whether an error lies within what was measured."""
    found = [getattr(r, error) for r in rows]
    return min(found) <= target <= max(found)


def slope(rows, error, size="cells"):
    """Return the least-squares slope of log error against log size."""
    x = np.log([getattr(r, size) for r in rows])
    return float(np.polyfit(x, np.log([getattr(r, error) for r in rows]), 1)[0])
