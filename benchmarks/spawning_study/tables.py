"""The tables: work and precision, tolerance and truth, order, growth, idle material."""

from __future__ import annotations

from math import sqrt

import numpy as np

from kaju import Scene, solve

from .measure import (
    METHODS,
    Cost,
    Order,
    by_elements,
    by_equal_cells,
    by_spawning,
    cost_at,
    measured_at,
    slope,
    timed,
)
from .scenes import PLATE, cases, plate, pressed
from .stress import StressTruth
from .truth import truth

FEW = 400
"""Slopes are those of answers of more cells."""
WORK_LINE = (
    f"{'':12}{'setting':>9}{'cells':>11}{'unknowns':>11}{'time (s)':>10}"
    f"{'energy':>9}{'max u':>9}{'r.m.s. u':>9}{'estimate':>10}{'factor':>8}"
)


def show(r):
    """Print one row of work and precision."""
    print(
        f"{r.method:12}{r.setting:9.4g}{r.cells:11,}{r.unknowns:11,}{r.seconds:10.3f}"
        f"{r.energy_error:9.1e}{r.max_error:9.1e}{r.l2_error:9.1e}{r.estimate:10.4f}"
        f"{r.factor:8.2f}",
        flush=True,
    )


def work(case, folder, quick=False):
    """Print errors and costs of all methods on a body; return the rows."""
    true = truth(case, folder)
    print(f"\n{case.title}\n{true.source}\n{WORK_LINE}")
    cut = slice(0, 3 if quick else None)
    limit = case.elements // (10 if quick else 1)
    runs = [by_spawning(case, true, case.tolerances[cut])]
    runs += [by_equal_cells(case, true, case.resolutions[cut])]
    runs += [by_elements(case, true, m, limit) for m in ("uniform", "adaptive", "adaptive 2")]
    rows = []
    for run in runs:
        for r in run:
            show(r)
            rows.append(r)
    for error, name in (("energy_error", "energy norm"), ("max_error", "largest displacement")):
        ratios(rows, error, name)
    return rows


def ratios(rows, error, name):
    """Print how many times the cells and the time of spawning others take for its errors."""
    ours = [r for r in rows if r.method == "spawning"]
    for reached in (ours[len(ours) // 2], ours[-1]):
        target, told = getattr(reached, error), []
        for method in METHODS:
            theirs = [r for r in rows if r.method == method]
            if method == "spawning" or len(theirs) < 2:
                continue
            many = cost_at(target, theirs, "unknowns", error) / reached.unknowns
            long = cost_at(target, theirs, "seconds", error) / reached.seconds
            if np.isfinite(many):
                mark = "" if measured_at(target, theirs, error) else "*"
                told.append(f"{method} {many:.3g} / {long:.3g}{mark}")
        print(f"  {name} {target:.1e}: unknowns / time of {'; '.join(told)}")


def effectivity(folder, quick=False):
    """Print tolerance, estimate and true error of all bodies."""
    print("\ntolerance, what was estimated, what is true (energy norm), and the factor")
    rows = []
    for case in cases().values():
        true = truth(case, folder)
        for r in by_spawning(case, true, case.tolerances[: 3 if quick else None]):
            print(
                f"{case.name:12}{r.setting:9.4g}{r.cells:11,}{r.estimate:10.4f}"
                f"{r.energy_error:10.4f}{r.factor:8.2f}",
                flush=True,
            )
            rows.append(r)
    factors = [r.factor for r in rows]
    print(f"factors from {min(factors):.2f} to {max(factors):.2f}")
    return rows


def order(folder, quick=False):
    """Print how errors on the L fall with the number of cells; return agents and errors.

    Besides √|U/U* − 1|, which can pass through zero, the error of the stress itself in the
    energy norm, integrated over the elements of the truth.
    """
    case = cases()["L"]
    true, stress = truth(case, folder), StressTruth(case)
    print("\nL-shaped body: slopes of error against number of cells")
    print(f"{'':10}{'cells':>10}{'estimate':>10}{'energy':>10}{'stress':>10}")
    tolerances = 0.2 * 0.5 ** (np.arange(0, 7 if quick else 11) / 2)
    jobs = [("spawning", {"tolerance": float(t)}) for t in tolerances]
    jobs += [("uniform", {"resolution": k}) for k in case.resolutions[: 4 if quick else -1]]
    rows = []
    for strategy, how in jobs:
        found = solve(case.scene, strategy=strategy, **how)
        error = sqrt(abs(found.strain_energy / true.strain_energy - 1.0))
        cells = found.summary()["agents"]
        rows.append(Order(strategy, cells, found.error_estimate, error, stress.error(found)))
        told = "".join(f"{value:10.4f}" for value in rows[-1][2:])
        print(f"{strategy:10}{cells:10,}{told}", flush=True)
    for strategy in ("spawning", "uniform"):
        some = [r for r in rows if r.strategy == strategy and r.cells > FEW]
        told = [f"{e} {slope(some, e):.3f}" for e in ("estimate", "energy", "stress")]
        print(f"{strategy}: {', '.join(told)} ({len(some)} answers of more than {FEW} cells)")
    return rows


def growth(folder, quick=False):
    """Print agents and time as the plate grows, under the same load at the same tolerance."""
    print("\nplate's side times 1 to 64, the same load, tolerance 0.02")
    print(f"{'side':>6}{'cells':>16}{'agents':>10}{'time (s)':>10}{'times':>8}")
    rows = []
    for side in (1, 2, 4, 8) if quick else (1, 2, 4, 8, 16, 32, 64):
        scene = plate(side)
        found, seconds, _ = timed(lambda s=scene: solve(s, strategy="spawning", tolerance=0.02))
        rows.append(Cost(side, scene.lattice.size, found.agents, seconds))
        times = seconds / rows[0].seconds
        print(f"{side:6}{scene.lattice.size:16,}{found.agents:10,}{seconds:10.3f}{times:8.2f}")
    return rows


def idle_plate(width, joined):
    """Return the worked plate with `width` times as much beside it that bears nothing."""
    size = 0.2 * (1 + width)
    gap = {"material": "air", "box": [[0.3, 0.0 if not joined else 0.1], [0.34, 0.2]]}
    return Scene(
        body={"size": [size, 0.2], "cells": [20 * (1 + width), 20], "regions": [gap], **PLATE},
        sides={"bottom": "rigid"},
        loads=[pressed((0.09, 0.2), (0.11, 0.2), (0.0, -2.0))],
    )


def idle(folder, quick=False):
    """Print agents and time as idle material is added far from the load."""
    print("\nidle material beside the plate, tolerance 0.02")
    print(f"{'':10}{'width':>7}{'cells':>12}{'agents':>9}{'near':>9}{'time (s)':>10}{'times':>8}")
    rows = []
    for joined in (False, True):
        first = None
        for width in (3, 15, 63) if quick else (3, 15, 63, 255):
            scene = idle_plate(width, joined)
            found, seconds, _ = timed(lambda s=scene: solve(s, strategy="spawning", tolerance=0.02))
            near = int((found.lower[:, 0] < 0.34).sum())
            first = first or seconds
            rows.append(Cost(width, scene.lattice.size, found.agents, seconds))
            print(
                f"{'joined' if joined else 'apart':10}{width:7}{scene.lattice.size:12,}"
                f"{found.agents:9,}{near:9,}{seconds:10.3f}{seconds / first:8.2f}"
            )
    return rows
