"""Random bodies put to their bounds: is the truth inside, and is the tolerance kept.

    python benchmarks/bounds.py [--bodies 200] [--first 0] [--tolerance 0.05] [--out FILE.csv]
    python benchmarks/bounds.py --solids --bodies 40 --tolerance 0.15
    python benchmarks/bounds.py --stress     # errors of the mean and of the operator's own stress
    python benchmarks/bounds.py --write      # the table in docs/bounds.md, from docs/bounds.csv

Plane bodies of 3 to 6 pixels a side: up to three materials of contrasts up to 1e6, Poisson's ratios
from -0.5 to 0.4999, clamped, on rollers, or both, pressed, pulled and dragged on sides and within.
The truth is that of elements of order 3 graded into every corner; what it is off by itself is taken
from a second one with fewer levels. Solids of 1 to 3 pixels a side (`--solids`) alike, with bricks
of order 2 graded to all edges; those of which cells share an edge alone are left out.

The mean stress is off by exactly half the distance of the two stresses (Prager and Synge), so that
bound / true error is the root of true energy / lower bound. Needs scikit-fem.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from time import process_time

import numpy as np
from peers.graded_bricks import solve_bricks

from kaju import Scene, finite_elements, solve
from kaju.arrays import Floats
from kaju.errors import ConvergenceError, KajuError
from kaju.model.elastic.moduli import moduli_of
from kaju.model.study.finite_elements import ElementField

sys.path.append(str(Path(__file__).parent.parent / "tests" / "support"))

from goal_bodies import angle, inclusion, plate

FEWER, LEVELS = 6, 10
PARTS = 3, 2
DOCS = Path(__file__).parent.parent / "docs"
FROM, TO = "<!-- from bounds.csv -->", "<!-- to here -->"
NAMES = ("air", "a", "b", "c")
COLUMNS = (
    "seed", "status", "agents", "estimate", "bound", "lower", "upper", "doubt", "inside", "ratio",
    "true", "contrast", "ratio_most", "seconds", "why",
)  # fmt: skip


def body_of(seed: int) -> Scene:
    """Return a random plane body."""
    rng = np.random.default_rng([12, seed])
    shape = rng.integers(3, 7, 2)
    count = int(rng.integers(1, 4))
    codes = rng.integers(1, count + 1, shape) * (rng.random(shape) < rng.choice([0.7, 0.85, 1.0]))
    codes[:, 0] = np.maximum(codes[:, 0], 1)
    contrast = 10 ** rng.uniform(0, rng.choice([0.5, 2, 6]))
    plane = str(rng.choice(["stress", "strain"]))
    highest = float(rng.choice([0.35, 0.47, 0.4999]))
    materials = {
        name: {
            "youngs_modulus": 1e9 * contrast**power,
            "poissons_ratio": float(rng.uniform(-0.5, highest)) if rng.random() < 0.7 else highest,
        }
        for name, power in zip("abc", (0.0, 1.0, 0.5), strict=True)
    }
    sides = [
        {"bottom": "rigid"},
        {"bottom": "rigid", "left": "roller"},
        {"bottom": "roller", "left": "rigid"},
        {"bottom": "rigid", "right": "rigid"},
        {"bottom": "roller", "left": "roller"},
    ][int(rng.integers(5))]
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


def made_of(codes: np.ndarray, materials: dict[str, dict[str, float]], **others: object) -> Scene:
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
    count = int(rng.integers(1, 4))
    codes = rng.integers(1, count + 1, shape) * (rng.random(shape) < rng.choice([0.7, 0.85, 1.0]))
    codes[:, :, 0] = np.maximum(codes[:, :, 0], 1)
    contrast = 10 ** rng.uniform(0, rng.choice([0.5, 2, 6]))
    highest = float(rng.choice([0.35, 0.47, 0.4999]))
    used = np.unique(codes)
    materials = {
        NAMES[int(c)]: {
            "youngs_modulus": 1e9 * contrast ** (0.0, 1.0, 0.5)[int(c) - 1],
            "poissons_ratio": float(rng.uniform(-0.5, highest)),
        }
        for c in used[used > 0]
    }
    sides = [
        {"bottom": "rigid"},
        {"bottom": "rigid", "left": "roller"},
        {"bottom": "roller", "left": "rigid"},
        {"bottom": "roller", "left": "roller", "front": "roller"},
    ][int(rng.integers(4))]
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
    cells = np.indices(scene.lattice.shape).reshape(3, -1).T
    body = (scene.kinds(cells) >= 0).reshape(scene.lattice.shape)
    for axis in range(3):
        a, b, c, d = (
            np.moveaxis(body, axis, 0)[:, i : i - 1 or None, j : j - 1 or None]
            for i, j in product((0, 1), repeat=2)
        )
        if (((a & d) & ~(b | c)) | ((b & c) & ~(a | d))).any():
            return True
    return False


def truths(scene: Scene) -> tuple[float, float]:
    """Return the energies of a finer and a coarser graded mesh."""
    if scene.lattice.dimension == 2:
        return tuple(graded(scene, levels).energy for levels in (LEVELS, FEWER))
    planes = [range(n + 1) for n in scene.lattice.shape]
    return tuple(solve_bricks(scene, planes, parts).energy for parts in PARTS)


def put_to(
    scene_of: Callable[[int], Scene], seed: int, tolerance: float
) -> dict[str, object] | None:
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
    about: dict[str, object] = {
        "contrast": max(moduli) / min(moduli),
        "ratio_most": max(m.poissons_ratio for m in scene.cell_materials),
    }
    began, why = process_time(), ""
    try:
        result = solve(scene, tolerance=tolerance)
    except ConvergenceError as error:
        why, result = str(error)[:80], error.best
    except KajuError as error:
        return {"seed": seed, "status": "refused", "why": str(error)[:80]} | about
    seconds = process_time() - began
    row: dict[str, object] = {
        "seed": seed,
        "status": result.tolerance_kept if not why else "error",
        "agents": result.agents,
        "estimate": result.error_estimate,
        "doubt": doubt,
        "seconds": round(seconds, 2),
        "why": why or result.no_bound,
    } | about
    if result.energy_bounds is not None:
        lower, upper = result.energy_bounds
        # Elements come from below, and are off by about what two of their meshes differ in.
        low, high = lower / truth - 1.0, upper / truth - 1.0
        row |= {"bound": result.error_bound, "lower": low, "upper": high}
        row["inside"] = low <= 2.0 * doubt + 1e-8 and high >= -1e-8
        row["ratio"] = float(np.sqrt(truth / lower)) if lower > 0.0 else float("inf")
        row["true"] = float(result.error_bound / row["ratio"])
    return row


def told(rows: list[dict[str, object]], tolerance: float) -> str:
    """Return the figures in a few lines."""
    bounded = [row for row in rows if "bound" in row]
    ratio = np.array([row["ratio"] for row in bounded], dtype=float)
    true = np.array([row["true"] for row in bounded], dtype=float)
    said = np.array([row["status"] == "proved" for row in bounded])
    count = {s: sum(row["status"] == s for row in rows) for s in {str(r["status"]) for r in rows}}
    seconds = np.array([row.get("seconds", 0.0) for row in rows], dtype=float)
    return "\n".join(
        [
            f"bodies {len(rows)}: {count}",
            f"with a bound {len(bounded)} ({len(bounded) / len(rows):.1%})",
            f"truth inside {sum(bool(row['inside']) for row in bounded)} of {len(bounded)}",
            f"bound / true error: median {np.median(ratio):.3f}, "
            f"95 % {np.quantile(ratio, 0.95):.3f}, "
            f"largest {ratio.max():.3f}",
            f"true error above the tolerance of {tolerance:g} though proved: "
            f"{np.count_nonzero((true > tolerance) & said)}",
            f"seconds: median {np.median(seconds):.2f}, largest {seconds.max():.1f}",
        ]
    )


def table(rows: list[dict[str, str]]) -> str:
    """Return what came of bodies as a table."""

    def line(name: str, chosen: list[dict[str, str]]) -> str:
        bounded = [row for row in chosen if row["bound"]]
        ratio = np.array([float(row["ratio"]) for row in bounded])
        inside = sum(row["inside"] == "True" for row in bounded)
        kept = sum(row["status"] == "proved" for row in chosen)
        told = f"{np.median(ratio):.2f} | {np.quantile(ratio, 0.95):.2f} | {ratio.max():.2f}"
        return f"| {name} | {len(chosen)} | {len(bounded)} | {inside} | {told} | {kept} |"

    near = [row for row in rows if float(row["ratio_most"]) > 0.45]
    groups = {
        "all": rows,
        "contrast below 30": [row for row in rows if float(row["contrast"]) < 30],
        "30 to 1,000": [row for row in rows if 30 <= float(row["contrast"]) < 1e3],
        "above": [row for row in rows if float(row["contrast"]) >= 1e3],
        "Poisson's ratio above 0.45": near,
    }
    head = [
        "| bodies | number | with bounds | truth inside | bound / true error: median | 95 % | "
        "largest | tolerance proved |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*head, *(line(name, chosen) for name, chosen in groups.items() if chosen)])


def write() -> None:
    """Put the table of the stored run into the page."""
    with (DOCS / "bounds.csv").open(newline="") as stream:
        found = table([row for row in csv.DictReader(stream) if row["ratio_most"]])
    page = (DOCS / "bounds.md").read_text(encoding="utf-8")
    before, rest = page.split(FROM)
    after = rest.split(TO)[1]
    (DOCS / "bounds.md").write_text(f"{before}{FROM}\n{found}\n{TO}{after}", encoding="utf-8")


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


def compare_stresses() -> None:
    """Tell how many agents the mean field takes for an equal error."""
    for body in (plate, angle, inclusion):
        truth = graded(body(), LEVELS)
        runs = [stress_errors(body(), truth, t) for t in (0.16, 0.08, 0.04, 0.02)]
        agents = np.log([n for n, _ in runs])
        *others, mean = np.log([errors for _, errors in runs]).T
        rates = [-np.polyfit(agents, own, 1)[0] for own in others]
        print(f"{body.__name__}: rates {rates[0]:.2f}, {rates[1]:.2f}")
        for row, (count, errors) in enumerate(runs):
            told = "  ".join(f"{error:.4f}" for error in errors)
            shares = [
                np.exp((mean[row] - own[row]) / rate)
                for own, rate in zip(others, rates, strict=True)
            ]
            print(f"  {count:6} agents  {told}  share {shares[0]:.2f}, {shares[1]:.2f}")


def main() -> None:
    """Put bodies to their bounds, and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=200)
    parser.add_argument("--solids", action="store_true", help="solids of 1 to 3 cells a side")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--tolerance", type=float, default=0.05)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--stress", action="store_true")
    asked = parser.parse_args()
    if asked.stress:
        compare_stresses()
        return
    if asked.write:
        write()
        return
    rows: list[dict[str, object]] = []
    seed = asked.first
    while len(rows) < asked.bodies:
        row = put_to(solid_of if asked.solids else body_of, seed, asked.tolerance)
        seed += 1
        if row is None:
            continue
        rows.append(row)
        print(
            " ".join(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items())
        )
        sys.stdout.flush()
        if asked.out:
            with asked.out.open("w", newline="") as stream:
                writer = csv.DictWriter(stream, COLUMNS)
                writer.writeheader()
                writer.writerows(
                    {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()}
                    for row in rows
                )
    print(told(rows, asked.tolerance))


if __name__ == "__main__":
    main()
