"""Growth beside its peer: designs judged by both solvers, and what a step costs.

    python benchmarks/growth.py           # designs [--steps 60], prices [--repeat 3]
    python benchmarks/growth.py truth     # the designs in tests/data/half_beam_designs.npz
    python benchmarks/growth.py large     # 1,000 x 500 cells from grey
    python benchmarks/growth.py local     # the local rule: starts, grey, stability
    python benchmarks/growth.py refined   # the same radius on ever finer grids
    python benchmarks/growth.py michell   # rising columns towards Michell's truss
    python benchmarks/growth.py volumes   # the same grid with ever less material
    python benchmarks/growth.py plain     # no filter: checkerboards, and the claim on finer cells
    python benchmarks/growth.py pictures  # draw what docs/growth.md shows, into docs/pictures

The peer is the 88-line method rewritten in `peers/optimality.py`, with SciPy's SuperLU in minimum
degree order, and with PARDISO where pypardiso is installed. Processor time, both in one run, by
turns, of one thread each: threads that wait for work spin in the other's time. The first steps, in
which kaju may compile, are not counted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from statistics import median
from time import process_time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before any of them is loaded
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from peers.optimality import POWER, VOID, Beam, Bilinear, optimised
from shared import ROOT, TESTS, by_name, timed

import kaju
from kaju.arrays import Floats
from kaju.model.growth.growth_result import GrowthResult
from kaju.model.growth.growth_rules import Compliance, Remodelling

DATA = TESTS / "data" / "half_beam_designs.npz"
PICTURES = ROOT / "docs" / "pictures"
CASES = {
    "half beam 150 x 50": (Beam("half beam", (150, 50)), 0.5, 2.4),
    "cantilever 160 x 100": (Beam("cantilever", (160, 100)), 0.4, 4.0),
}
MICHELL = 5.001
"""Least Σ |force| · length of a truss for the cantilever 1.6 × 1 under F = 1, over F · height: by a
ground structure of 32 × 20 cells (linear programming)."""


def by_kaju(beam: Beam, density: Floats) -> float:
    """Return the compliance of a design by equal cells, solved exactly."""
    scene = beam.scene()
    field = np.ones(scene.lattice.shape)
    field[:, -density.shape[1] :] = VOID + (1.0 - VOID) * density**POWER
    return 2.0 * kaju.solve(scene, stiffness=field).strain_energy


def by_peer(beam: Beam, density: Floats) -> float:
    """Return the compliance of a design by bilinear elements."""
    return Bilinear(beam).feel(VOID + (1.0 - VOID) * density**POWER)[0]


def model_of(
    beam: Beam, volume: float, radius: float, steps: int, **more: object
) -> kaju.GrowthModel:
    """Return a model that takes all of its steps."""
    options = {"volume": volume, "filter_radius": radius, "most_steps": steps, "at_rest": 0.0}
    return kaju.GrowthModel(beam.scene(), keep=False, **options | more)


def grown(beam: Beam, volume: float, radius: float, filter: str, steps: int) -> Floats:
    """Return what kaju grows, in the peer's shape."""
    found = model_of(beam, volume, radius, steps, rule=Compliance(filter)).run(progress=False)
    return found.density[:, -beam.cells[1] :]


def designs(steps: int = 60) -> Iterator[str]:
    """Yield the compliances of both designs by both solvers."""
    for name, (beam, volume, radius) in CASES.items():
        for filter in ("density", "sensitivity"):
            ours = grown(beam, volume, radius, filter, steps)
            theirs = optimised(beam, volume, radius, filter)
            ratios = [judge(beam, ours) / judge(beam, theirs) for judge in (by_peer, by_kaju)]
            yield (
                f"{name}, {filter} filter: F·u of kaju's design / the peer's "
                f"{ratios[0]:.4f} by bilinear elements, {ratios[1]:.4f} by kaju"
            )


def prices(repeat: int = 3) -> Iterator[str]:
    """Yield what a step costs, and 60 of them."""
    solvers = ["superlu"] + ["pardiso"] * (find_spec("pypardiso") is not None)
    for name, (beam, volume, radius) in CASES.items():
        model = model_of(beam, volume, radius, 10_000)

        def steps(model: kaju.GrowthModel = model) -> None:
            for _ in range(10):
                model.step()

        steps()
        ours, theirs = [], {solver: [] for solver in solvers}
        for _ in range(repeat):
            ours.append(timed(steps)[1] / 10)
            for solver, found in theirs.items():
                more = {"steps": 3, "solver": solver}
                found.append(timed(partial(optimised, beam, volume, radius, **more))[1] / 3)
        own = median(ours)
        for solver, found in theirs.items():
            yield (
                f"{name}: a step {1e3 * own:.1f} ms, the peer by {solver} "
                f"{1e3 * median(found):.0f} ms: {median(found) / own:.1f} times"
            )


def large(steps: int = 60) -> Iterator[str]:
    """Yield what 1,000 × 500 cells cost from grey, and from coarse to fine, to their proof."""
    kaju.GrowthModel(Beam("cantilever", (64, 32)).scene(), most_steps=2).run(progress=False)
    for courses in (((1, steps),), ((4, 40), (2, 20), (1, 12))):
        start, began = None, process_time()
        for k, most in courses:
            beam = Beam("cantilever", (1000 // k, 500 // k), 10 // k)
            model = model_of(beam, 0.4, max(4.0 / k, 1.5), most, start=start)
            result = model.run(progress=False)
            start = np.kron(model.design.reshape(beam.cells), np.ones((2, 2)))
        spent, counts = process_time() - began, " + ".join(str(most) for _, most in courses)
        low, high = (2.0 * bound for bound in result.answer.energy_bounds)
        yield (
            f"1,000 x 500, {counts} steps: {spent:.1f} s, F·u {result.compliance:.2f}, proved to "
            f"lie between {low:.2f} and {high:.2f} in {process_time() - began - spent:.1f} s more"
        )


def overlap(one: Floats, other: Floats) -> float:
    """Return the share of filled volume that two designs have in common."""
    return float(np.minimum(one, other).sum() / np.maximum(one, other).sum())


def local() -> Iterator[str]:
    """Yield what the local rule makes of three starts, and where it becomes unstable."""
    beam = Beam("cantilever", (96, 60))
    starts = {
        "full": np.ones(beam.cells),
        "half": np.full(beam.cells, 0.5),
        "random": np.random.default_rng(0).uniform(0.2, 1.0, beam.cells),
    }
    found = {}
    for name, start in starts.items():
        rule = Remodelling(stimulus=0.0333)
        model = kaju.GrowthModel(beam.scene(), rule=rule, start=start, most_steps=160, keep=False)
        found[name] = result = model.run(progress=False)
        yield (
            f"from {name}: volume {result.volumes[-1]:.3f}, F·u {result.compliance:.2f}, grey "
            f"{result.grey:.3f}, {result.outcome}"
        )
    half = found["half"].density
    for name in ("full", "random"):
        yield f"overlap of half and {name}: {overlap(half, found[name].density):.3f}"
    for power in (1.0, 3.0):
        for share in (0.7, 0.9, 1.1, 1.3, 2.0):
            gain = share * 2.0 / (power + 1.0)
            rule = Remodelling(0.02, gain, 0.0, (power, power), allow_unstable=True)
            options = {"start": starts["half"], "most_steps": 100, "at_rest": 0.0, "keep": False}
            model = kaju.GrowthModel(beam.scene(), rule=rule, **options)
            moving = np.mean(model.run(progress=False).changes[-8:])
            yield f"p = {power:g}, gain {share:g} of the limit: largest change a step {moving:.1e}"


def refined() -> Iterator[str]:
    """Yield compliances of one design problem on ever finer grids, the radius held in metres."""
    last = None
    for k in (1, 2, 4, 8):
        beam, radius = Beam("cantilever", (80 * k, 50 * k), 2 * k), 2.0 * k
        result = model_of(beam, 0.4, radius, 100).run(progress=False)
        change = "" if last is None else f", {result.compliance / last - 1.0:+.2%}"
        yield f"{80 * k} x {50 * k}, radius {radius:g}: F·u {result.compliance:.2f}{change}"
        last = result.compliance


def volumes() -> Iterator[str]:
    """Yield how far designs are from Michell's truss on one grid, the less material the farther."""
    beam = Beam("cantilever", (320, 200), 4)
    for volume in (0.5, 0.3, 0.2, 0.1):
        result = model_of(beam, volume, 1.8, 60).run(progress=False)
        yield f"volume {volume:g} on 320 columns: {michell_ratio(result, beam):.3f}"


def michell_ratio(result: GrowthResult, beam: Beam) -> float:
    """Return F·u · volume over the square of Michell's bound: 1 for a truss of no width."""
    filled = result.volumes[-1] * result.cells.size
    return float(result.compliance * filled / (MICHELL * beam.cells[1]) ** 2)


def michell() -> Iterator[str]:
    """Yield how near designs come to Michell's truss: F·u · volume over the square of its bound."""
    start = None
    for k in (1, 2, 4):
        beam = Beam("cantilever", (160 * k, 100 * k), 2 * k)
        model = model_of(beam, 0.3, 1.8, 60 if k < 4 else 40, start=start)
        result = model.run(progress=False)
        yield f"{beam.cells[0]} columns: {michell_ratio(result, beam):.3f}"
        start = np.kron(model.design.reshape(beam.cells), np.ones((2, 2)))


def checkerboards(density: Floats) -> int:
    """Return at how many corners full and empty cells alternate."""
    a, b, c, d = density[:-1, :-1], density[1:, 1:], density[1:, :-1], density[:-1, 1:]
    return int((np.abs(a + b - c - d) > 1.6).sum())


def plain() -> Iterator[str]:
    """Yield what grows without a filter, and whether finer cells uphold its compliance."""
    beam, fine = Beam("cantilever", (160, 100)), Beam("cantilever", (640, 400), 8)
    found = {
        "kaju": (grown(beam, 0.4, 1.0, "density", 60), by_kaju),
        "bilinear elements": (optimised(beam, 0.4, 1.0), by_peer),
    }
    for name, (density, judge) in found.items():
        claimed, upheld = judge(beam, density), by_kaju(fine, np.kron(density, np.ones((4, 4))))
        yield (
            f"{name}: {checkerboards(density)} checkerboard places, F·u claimed {claimed:.2f}, on "
            f"cells four times finer {upheld:.2f}"
        )


def pictures() -> Iterator[str]:
    """Draw trusses of falling volume, and designs without a filter; yield the files."""
    from matplotlib.figure import Figure

    beam = Beam("cantilever", (160, 100))
    fine = Beam("cantilever", (320, 200), 4)
    rows: dict[str, dict[str, Floats]] = {
        "growth_volumes": {
            f"volume {volume:g}": model_of(fine, volume, 1.8, 60).run(progress=False).density
            for volume in (0.5, 0.3, 0.1)
        },
        "growth_plain": {
            "kaju": grown(beam, 0.4, 1.0, "density", 60),
            "bilinear elements": optimised(beam, 0.4, 1.0),
        },
    }
    for name, designs in rows.items():
        figure = Figure((3.2 * len(designs), 2.3), layout="constrained")
        for ax, (title, density) in zip(
            figure.subplots(1, len(designs)), designs.items(), strict=True
        ):
            ax.imshow(density.T, cmap="Greys", vmin=0.0, vmax=1.0, origin="lower")
            ax.set_title(title, fontsize=9)
            ax.set_axis_off()
        target = PICTURES / f"{name}.png"
        figure.savefig(target, dpi=110)
        yield str(target)


def truth(steps: int = 60) -> Iterator[str]:
    """Write the peer's half beams for the tests."""
    beam, volume, radius = CASES["half beam 150 x 50"]
    found = {
        filter: np.rint(1e4 * optimised(beam, volume, radius, filter, steps)).astype(np.uint16)
        for filter in ("density", "sensitivity")
    }
    np.savez_compressed(DATA, **found)
    yield str(DATA)


if __name__ == "__main__":
    beside = (designs, prices)
    others = (large, local, refined, michell, volumes, plain, pictures, truth)
    by_name(__doc__, *beside, *others, usual=beside)
