"""Networks that break beside what is known: stress intensity, bundles of fibres, kinks, time.

    python benchmarks/fracture.py                # all of it
    python benchmarks/fracture.py intensity      # stress intensity and strength of a cut network
    python benchmarks/fracture.py bundles        # 100,000 fibres: Daniels' strength, avalanches
    python benchmarks/fracture.py kinks [--nets 24]     # where slanted cuts go on
    python benchmarks/fracture.py prices         # 200 breaks of 10,000 nodes
    python benchmarks/fracture.py ledgers        # work = stored + released; the same again
    python benchmarks/fracture.py cells          # 200 breaks of 10,000 cells, and their ledger

Processors wait for each other where others work beside: set OPENBLAS_NUM_THREADS=1 there.

References
----------
H. Tada, P. C. Paris, G. R. Irwin, "The Stress Analysis of Cracks Handbook", ASME 2000.
H. E. Daniels, "The statistical theory of the strength of bundles of threads", Proc. Royal Society
A 183 (1945) 405-435.
P. C. Hemmer, A. Hansen, "The distribution of simultaneous fiber failures in fiber bundles",
Journal of Applied Mechanics 59 (1992) 909-914.
F. Erdogan, G. C. Sih, "On the crack extension in plates under plane loading and transverse shear",
Journal of Basic Engineering 85 (1963) 519-525.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import numpy as np
from shared import by_name, timed

import kaju
from kaju.arrays import Floats, Ints
from kaju.model.network import SpringNetwork, cut, jittered, pulled, triangular

TIP = 0.18  # By how many spacings the tip of a cut lies beyond half of the springs that were cut

PEAK = 0.37  # The same, of the tip of the field in which the first spring breaks


def slit(width: int, rows: int, half: float) -> tuple[SpringNetwork, float]:
    """Return a lattice with a level cut, pulled by 1 N a spacing, and half the cut's length."""
    whole, middle = triangular(width, rows), 0.5 * (width - 1)
    level = 0.5 * np.sqrt(3.0) * (rows // 2 + 0.5)
    network = cut(whole, (middle - half, level), (middle + half, level))
    return pulled(network, width - 1.0), (len(whole.springs) - len(network.springs)) / 4.0


def first_break(network: SpringNetwork) -> kaju.FractureResult:
    """Break the spring that bears most."""
    return kaju.FractureModel(network, scatter=0.0, most_breaks=1).run()


def intensity() -> Iterator[str]:
    """Yield stress intensities by the energy that longer cuts release, and strengths."""
    modulus = 2.0 / np.sqrt(3.0)
    for width, rows, halves in (
        (81, 141, (6, 8, 12, 16, 20)),
        (161, 281, (6, 8, 12, 16, 24, 32, 40)),
    ):
        found, scaled = [], []
        for half in halves:
            gives = []
            for change in (-0.5, 0.5):
                once = first_break(slit(width, rows, half + change + 0.01)[0])
                gives.append(once.displacement[0] / once.force[0])
            network, true = slit(width, rows, half + 0.01)
            released = 0.25 * (width - 1.0) ** 2 * (gives[1] - gives[0])  # by each of two tips
            share = 2.0 * (true + TIP) / (width - 1.0)
            factor = 1.0 - 0.025 * share**2 + 0.06 * share**4
            wanted = factor * np.sqrt(np.pi * (true + TIP) / np.cos(0.5 * np.pi * share))
            found.append(np.sqrt(released * modulus) / wanted)
            bent = np.cos(np.pi * true / (width - 1.0))
            scaled.append(first_break(network).largest_load_factor * np.sqrt((true + PEAK) / bent))
        yield (
            f"{width} x {rows}, half cuts of {', '.join(map(str, halves))} spacings: stress "
            f"intensity over the handbook's {', '.join(f'{ratio:.4f}' for ratio in found)}; "
            f"strength · √(a / cos(πa/W)) varies by {max(scaled) / min(scaled) - 1.0:.2%}"
        )


def bundle(count: int) -> SpringNetwork:
    """Return fibres side by side, each of 1 N/m, under 1 N."""
    return SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0]],
        np.tile([[0, 1]], (count, 1)),
        held=[[True, True], [False, True]],
        forces=[[0.0, 0.0], [1.0, 0.0]],
    )


def exponent(sizes: Ints, least: int, most: int) -> float:
    """Return the likeliest power of the sizes between two bounds."""
    sizes = sizes[(sizes >= least) & (sizes <= most)]
    powers, possible = np.linspace(1.5, 3.5, 401), np.arange(least, most + 1.0)
    normal = np.log([(possible**-power).sum() for power in powers])
    return float(powers[np.argmax(-powers * np.log(sizes).mean() - normal)])


def bundles() -> Iterator[str]:
    """Yield strengths of 100,000 fibres and the exponents of their avalanches."""
    count, modulus = 100_000, 5.0
    cases = {
        "Weibull k = 5": ({"weibull": modulus}, (modulus * np.e) ** (-1.0 / modulus)),
        "uniform strengths": ({"strength": 0.5, "scatter": 1.0 - 1e-9}, 0.25),
    }
    for name, (options, daniels) in cases.items():
        fibres = bundle(count)
        broken, seconds = timed(
            lambda net=fibres, how=options: kaju.FractureModel(net, seed=0, **how).run()
        )
        sizes = broken.avalanche_sizes[:-1]
        ranges = ((1, 100), (10, 1000))
        powers = [f"{exponent(sizes, *bounds):.2f} from {bounds}" for bounds in ranges]
        yield (
            f"{name}: strength a fibre {broken.largest_load_factor / count:.4f}, "
            f"Daniels {daniels:.4f}; "
            f"{len(sizes)} avalanches, exponent {', '.join(powers)}; {seconds:.1f} s"
        )


def of_largest_hoop_stress(slant: float) -> float:
    """Return the angle (degrees) at which a cut goes on that is slanted (degrees) in tension."""
    along = np.tan(np.radians(slant))  # of shear to opening
    return float(np.degrees(2.0 * np.arctan((1.0 - np.sqrt(1.0 + 8.0 * along**2)) / (4.0 * along))))


def kinks_of(whole: SpringNetwork, slant: float, half: float = 14.0) -> list[float]:
    """Return the angles (degrees) to the cut at which the first breaks leave its two tips."""
    along = np.array([np.cos(np.radians(slant)), np.sin(np.radians(slant))])
    middle = 0.5 * whole.positions.max(axis=0) + 0.013
    tips = middle - half * along, middle + half * along
    network = pulled(cut(whole, *tips))
    broken = kaju.FractureModel(network, scatter=0.0, most_breaks=20).run()
    places = network.positions[network.springs[broken.broken]].mean(axis=1)
    angles = []
    for tip, ahead in zip(tips, (-along, along), strict=True):
        axes = np.array([ahead, [-ahead[1], ahead[0]]])
        away: Floats = (places - tip) @ axes.T
        distance = np.hypot(*away.T)
        near = (away[:, 0] > -1.5) & (distance < 9.0)
        if near.sum() >= 4:
            mean = (away[near] * distance[near, None]).sum(axis=0)
            angles.append(float(np.degrees(np.arctan2(mean[1], mean[0]))))
    return angles


def kinks(nets: int = 24) -> Iterator[str]:
    """Yield where cuts under mixed mode go on, in jittered nets and in the regular lattice."""
    for slant in (20.0, 45.0):
        angles = [kinks_of(jittered(85, 145, seed=seed), slant) for seed in range(nets)]
        # The two tips of a net are not independent: the error is that of the nets' means.
        means = np.array([np.mean(pair) for pair in angles if pair])
        regular = kinks_of(triangular(85, 145), slant)
        yield (
            f"cut slanted by {slant:g}°: kink {means.mean():.1f} ± "
            f"{means.std(ddof=1) / np.sqrt(len(means)):.1f}° over {len(means)} jittered nets, "
            f"largest hoop stress {of_largest_hoop_stress(slant):.1f}°; regular lattice "
            f"{', '.join(f'{angle:.1f}' for angle in regular)}°"
        )


def prices() -> Iterator[str]:
    """Yield what 200 breaks of 10,000 nodes cost."""
    network, _ = slit(101, 101, 2.0)
    seconds = []
    for _ in range(3):
        model = kaju.FractureModel(network, scatter=0.3, seed=0, most_breaks=200)
        # Of the clock: threads that wait count as work of the processor.
        broken, spent = timed(model.run, perf_counter)
        seconds.append(spent)
    yield (
        f"{len(network.positions)} nodes, {len(network.springs)} springs: {broken.breaks} breaks "
        f"in {min(seconds):.2f} s (the best of three)"
    )


def ledgers() -> Iterator[str]:
    """Yield the largest error of the ledger of energy, and whether runs are the same again."""
    network, _ = slit(41, 61, 4.0)
    subjects = {"under forces": network, "moved": pulled(network, displacement=1.0)}
    for name, subject in subjects.items():
        runs = [kaju.FractureModel(subject, scatter=0.5, seed=1).run() for _ in range(2)]
        one, other = runs
        off = np.abs(one.work - one.stored - one.released).max() / one.work.max()
        same = np.array_equal(one.load_factor, other.load_factor)
        yield f"{name}: {one.breaks} breaks, ledger off by {off:.1e}, the same again: {same}"


def cells() -> Iterator[str]:
    """Yield what breaks of a notched plate of 10,000 cells cost, and the error of their ledger."""
    scene = kaju.Scene(
        body={"cells": [100, 100], "cell_size": 0.01, "thickness": 0.1, "material": "steel"},
        sides={"bottom": "rigid", "top": {"displacement": [0.0, 1e-4]}},
    ).with_region(box=[[0.0, 0.5], [0.2, 0.52]])
    model = kaju.FractureModel(scene, strength=1e8, weibull=3.0, seed=1, most_breaks=200)
    broken, seconds = timed(model.run, perf_counter)
    off = np.abs((broken.work - broken.stored - broken.released) / broken.work).max()
    yield (
        f"{len(broken.largest_load_factors)} cells: {broken.breaks} breaks in {seconds:.1f} s, "
        f"{broken.outcome}; ledger off by {off:.1e}"
    )


if __name__ == "__main__":
    by_name(__doc__, intensity, bundles, kinks, prices, ledgers, cells)
