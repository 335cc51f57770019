"""Random bodies put to their bounds: is the truth inside, and is the tolerance kept.

    python benchmarks/bounds.py plane [--bodies 200] [--first 0] [--tolerance 0.05] [--out FILE.csv]
    python benchmarks/bounds.py solids --bodies 40 --tolerance 0.15
    python benchmarks/bounds.py stress    # errors of the mean and of the operator's own stress
    python benchmarks/bounds.py write     # the table in docs/bounds.md, from docs/bounds.csv

Plane bodies of 3 to 6 pixels a side: up to three materials of contrasts up to 1e6, Poisson's ratios
from -0.5 to 0.4999, clamped, on rollers, or both, pressed, pulled and dragged on sides and within.
The truth is that of elements of order 3 graded into every corner; what it is off by itself is taken
from a second one with fewer levels. Solids of 1 to 3 pixels a side alike, with bricks
of order 2 graded to all edges; those of which cells share an edge alone are left out.

The mean stress is off by exactly half the distance of the two stresses (Prager and Synge), so that
bound / true error is the root of true energy / lower bound. Needs scikit-fem.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from peers.graded_bricks import solve_bricks
from shared import ROOT, by_name, of_tests

from kaju import Scene, finite_elements, solve
from kaju.arrays import Floats, Ints
from kaju.errors import ConvergenceError, KajuError
from kaju.model.elastic.moduli import moduli_of
from kaju.model.study.finite_elements import ElementField

FEWER, LEVELS = 6, 10
PARTS = 3, 2
DOCS = ROOT / "docs"
FROM, TO = "<!-- from bounds.csv -->", "<!-- to here -->"
NAMES = ("air", "a", "b", "c")
POWERS = {"a": 0.0, "b": 1.0, "c": 0.5}
"""Of the contrast, by which a material is stiffer than the first."""
COLUMNS = (
    "seed", "status", "agents", "estimate", "bound", "lower", "upper", "doubt", "inside", "ratio",
    "true", "contrast", "ratio_most", "seconds", "why",
)  # fmt: skip
PLANE_SIDES = (
    {"bottom": "rigid"},
    {"bottom": "rigid", "left": "roller"},
    {"bottom": "roller", "left": "rigid"},
    {"bottom": "rigid", "right": "rigid"},
    {"bottom": "roller", "left": "roller"},
)
SOLID_SIDES = (*PLANE_SIDES[:3], {"bottom": "roller", "left": "roller", "front": "roller"})


def pixels(rng: np.random.Generator, shape: Ints) -> tuple[Ints, float]:
    """Return codes of cells, body all over the bottom, and the contrast of their materials."""
    count = int(rng.integers(1, 4))
    codes = rng.integers(1, count + 1, shape) * (rng.random(shape) < rng.choice([0.7, 0.85, 1.0]))
    codes[..., 0] = np.maximum(codes[..., 0], 1)
    return codes, 10 ** rng.uniform(0, rng.choice([0.5, 2, 6]))


def material(name: str, contrast: float, ratio: float) -> dict[str, float]:
    """Return a material."""
    return {"youngs_modulus": 1e9 * contrast ** POWERS[name], "poissons_ratio": ratio}


def body_of(seed: int) -> Scene:
    """Return a random plane body."""
    rng = np.random.default_rng([12, seed])
    codes, contrast = pixels(rng, rng.integers(3, 7, 2))
    plane = str(rng.choice(["stress", "strain"]))
    highest = float(rng.choice([0.35, 0.47, 0.4999]))
    ratios = [float(rng.uniform(-0.5, highest)) if rng.random() < 0.7 else highest for _ in POWERS]
    materials = {n: material(n, contrast, r) for n, r in zip(POWERS, ratios, strict=True)}
    sides = PLANE_SIDES[int(rng.integers(5))]
    solid = np.argwhere(codes > 0)
    loads = []
    for _ in range(int(rng.integers(1, 4))):
        column = int(rng.choice(solid[:, 0]))
        top = int(np.flatnonzero(codes[column]).max())
        along = float(rng.normal()) if rng.random() < 0.4 else 0.0
        loads.append({"cell": [column, top], "side": "top", "force": [along, float(rng.normal())]})
    if rng.random() < 0.3:
        within = solid[int(rng.integers(len(solid)))]
        loads.append({"cell": [int(i) for i in within], "force": [1.0, 0.5]})
    return made_of(codes, materials, sides=sides, loads=loads, plane=plane)


def made_of(codes: Ints, materials: dict[str, dict[str, float]], **others: Any) -> Scene:
    """Return the scene of a body of small cells: 0 is air, 1 to 3 are a, b and c."""
    used = {code: NAMES[code] for code in np.unique(codes).tolist()}
    present = {name: materials[name] for name in used.values() if name in materials}
    return Scene.from_array(codes, legend=used, cell_size=0.01, materials=present, **others)


def graded(scene: Scene, levels: int) -> ElementField:
    """Return what triangles of order 3 answer, graded into every corner."""
    return finite_elements(scene, order=3, levels=levels).field


def solid_of(seed: int) -> Scene:
    """Return a random solid: the materials, supports and kinds of load of the plane bodies."""
    rng = np.random.default_rng([13, seed])
    shape = rng.integers(1, 4, 3)
    codes, contrast = pixels(rng, shape)
    highest = float(rng.choice([0.35, 0.47, 0.4999]))
    used = np.unique(codes)
    names = [NAMES[int(code)] for code in used[used > 0]]
    materials = {n: material(n, contrast, float(rng.uniform(-0.5, highest))) for n in names}
    sides = SOLID_SIDES[int(rng.integers(4))]
    loads = []
    for _ in range(int(rng.integers(1, 4))):
        x, y = (int(rng.integers(n)) for n in shape[:2])
        top = int(np.flatnonzero(codes[x, y]).max())
        along = rng.normal(size=2) if rng.random() < 0.4 else np.zeros(2)
        force = [float(f) for f in (*along, rng.normal())]
        loads.append({"cell": [x, y, top], "side": "top", "force": force})
    return made_of(codes, materials, sides=sides, loads=loads)


def touches_along_an_edge(scene: Scene) -> bool:
    """Tell whether cells of a solid share an edge alone: bricks hold what a line cannot."""
    if scene.lattice.dimension == 2:
        return False
    body = scene.rasterise() >= 0
    for axis in range(3):
        a, b, c, d = (
            np.moveaxis(body, axis, 0)[:, i : i - 1 or None, j : j - 1 or None]
            for i, j in product((0, 1), repeat=2)
        )
        if (((a & d) & ~(b | c)) | ((b & c) & ~(a | d))).any():
            return True
    return False


def truths(scene: Scene) -> list[float]:
    """Return the energies of a finer and a coarser graded mesh."""
    if scene.lattice.dimension == 2:
        return [graded(scene, levels).energy for levels in (LEVELS, FEWER)]
    planes = [range(n + 1) for n in scene.lattice.shape]
    return [solve_bricks(scene, planes, parts).energy for parts in PARTS]


def put_to(scene_of: Callable[[int], Scene], seed: int, tolerance: float) -> dict[str, Any] | None:
    """Return what came of a body; None if it is not held, or its truth is not known."""
    try:
        scene = scene_of(seed)
        if touches_along_an_edge(scene):
            return None
        solve(scene, strategy="uniform", resolution=2)
        truth, less = truths(scene)
        doubt = abs(truth / less - 1.0)
    except KajuError:
        return None
    moduli = [m.youngs_modulus for m in scene.cell_materials]
    row: dict[str, Any] = {
        "seed": seed,
        "contrast": max(moduli) / min(moduli),
        "ratio_most": max(m.poissons_ratio for m in scene.cell_materials),
    }
    began, why = process_time(), ""
    try:
        result = solve(scene, tolerance=tolerance)
    except ConvergenceError as error:
        why, result = str(error)[:80], error.best
    except KajuError as error:
        return row | {"status": "refused", "why": str(error)[:80]}
    row |= {
        "status": "error" if why else result.tolerance_kept,
        "agents": result.agents,
        "estimate": result.error_estimate,
        "doubt": doubt,
        "seconds": round(process_time() - began, 2),
        "why": why or result.no_bound,
    }
    if result.energy_bounds is not None:
        lower, upper = result.energy_bounds
        # Elements come from below, and are off by about what two of their meshes differ in.
        low, high = lower / truth - 1.0, upper / truth - 1.0
        row |= {"bound": result.error_bound, "lower": low, "upper": high}
        row["inside"] = low <= 2.0 * doubt + 1e-8 and high >= -1e-8
        row["ratio"] = float(np.sqrt(truth / lower)) if lower > 0.0 else float("inf")
        row["true"] = float(result.error_bound / row["ratio"])
    return row


def put_all(
    scene_of: Callable[[int], Scene], bodies: int, first: int, tolerance: float, out: Path | None
) -> Iterator[str]:
    """Put so many bodies to their bounds; yield a line for each, and the table of all."""
    rows: list[dict[str, Any]] = []
    seed = first
    while len(rows) < bodies:
        row = put_to(scene_of, seed, tolerance)
        seed += 1
        if row is None:
            continue
        rows.append(row)
        yield " ".join(
            f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items()
        )
        if out:
            pd.DataFrame(rows, columns=COLUMNS).to_csv(out, index=False, float_format="%.4g")
    every = pd.DataFrame(rows, columns=COLUMNS)
    yield table(every)
    wrong = (every["status"] == "proved") & (every["true"].astype(float) > tolerance)
    yield f"true error above the tolerance of {tolerance:g} though proved: {wrong.sum()}"


def plane(
    bodies: int = 200, first: int = 0, tolerance: float = 0.05, out: Path | None = None
) -> Iterator[str]:
    """Put plane bodies to their bounds."""
    return put_all(body_of, bodies, first, tolerance, out)


def solids(
    bodies: int = 200, first: int = 0, tolerance: float = 0.05, out: Path | None = None
) -> Iterator[str]:
    """Put solids of 1 to 3 cells a side to their bounds."""
    return put_all(solid_of, bodies, first, tolerance, out)


def table(rows: pd.DataFrame) -> str:
    """Return what came of bodies as a table."""

    def line(name: str, chosen: pd.DataFrame) -> str:
        bounded = chosen.dropna(subset="bound")
        inside = (bounded["inside"].astype(str) == "True").sum()
        ratio = [f"{bounded['ratio'].quantile(share):.2f}" for share in (0.5, 0.95, 1.0)]
        counts = f"{len(chosen)} | {len(bounded)} | {inside}"
        kept = (chosen["status"] == "proved").sum()
        return f"| {name} | {counts} | {' | '.join(ratio)} | {kept} |"

    groups = {
        "all": rows,
        "contrast below 30": rows[rows["contrast"] < 30],
        "30 to 1,000": rows[rows["contrast"].between(30, 1e3, inclusive="left")],
        "above": rows[rows["contrast"] >= 1e3],
        "Poisson's ratio above 0.45": rows[rows["ratio_most"] > 0.45],
    }
    head = [
        "| bodies | number | with bounds | truth inside | bound / true error: median | 95 % | "
        "largest | tolerance proved |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join(head + [line(name, of) for name, of in groups.items() if len(of)])


def write() -> Iterator[str]:
    """Put the table of the stored run into the page."""
    found = table(pd.read_csv(DOCS / "bounds.csv").dropna(subset="ratio_most"))
    page = (DOCS / "bounds.md").read_text(encoding="utf-8")
    before, rest = page.split(FROM)
    after = rest.split(TO)[1]
    (DOCS / "bounds.md").write_text(f"{before}{FROM}\n{found}\n{TO}{after}", encoding="utf-8")
    yield found


def stress_errors(scene: Scene, truth: ElementField, tolerance: float) -> tuple[int, Floats]:
    """Return agents, and true relative errors in energy: `stress`, `stress_at`, the mean field."""
    result = solve(scene, strategy="spawning", tolerance=tolerance)
    place, weight = np.polynomial.legendre.leggauss(4)
    square = np.zeros(2)
    laws = [
        moduli_of(m.youngs_modulus, m.poissons_ratio, scene.plane) for m in scene.cell_materials
    ]
    lateral, shear = (
        np.array([getattr(law, name) for law in laws], dtype=float)[result.material]
        for name in ("lateral", "shear")
    )
    for (x, wx), (y, wy) in product(zip(place, weight, strict=True), repeat=2):
        points = result.lower + 0.5 * (1.0 + np.array([x, y])) * result.size[:, None]
        gradient = truth.at(points)[1]
        true = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        for kind, strain in enumerate((result.strain, result.strain_at(points))):
            off = strain - true
            volume = np.trace(off, axis1=1, axis2=2)
            energy = shear * (off**2).sum(axis=(1, 2)) + 0.5 * lateral * volume**2
            square[kind] += 0.25 * wx * wy * (energy * result.size**2).sum()
    mean = result.error_bound * np.sqrt(result.energy_bounds[0] / truth.energy)
    return result.agents, np.array([*np.sqrt(square * scene.thickness / truth.energy), mean])


def stress() -> Iterator[str]:
    """Yield how many agents the mean field takes for an equal error."""
    bodies = of_tests("goal_bodies")
    for body in (bodies.plate, bodies.angle, bodies.inclusion):
        truth = graded(body(), LEVELS)
        runs = [stress_errors(body(), truth, t) for t in (0.16, 0.08, 0.04, 0.02)]
        agents = np.log([n for n, _ in runs])
        *others, mean = np.log([errors for _, errors in runs]).T
        rates = [-np.polyfit(agents, own, 1)[0] for own in others]
        yield f"{body.__name__}: rates {rates[0]:.2f}, {rates[1]:.2f}"
        for row, (count, errors) in enumerate(runs):
            relative = "  ".join(f"{error:.4f}" for error in errors)
            shares = [
                np.exp((mean[row] - own[row]) / rate)
                for own, rate in zip(others, rates, strict=True)
            ]
            yield f"  {count:6} agents  {relative}  share {shares[0]:.2f}, {shares[1]:.2f}"


if __name__ == "__main__":
    by_name(__doc__, plane, solids, stress, write, usual=(plane,))
