"""Growth beside the 88-line method: designs judged by both solvers, and what a step costs.

The peer is rewritten in `peers/optimality.py`, on bilinear elements, with SciPy's SuperLU.
Processor time of one thread each, by turns, compiling not counted.

    python benchmarks/growth.py
"""

from __future__ import annotations

import os
from functools import partial
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before any of them is loaded

import numpy as np
from peers.optimality import POWER, VOID, Beam, Bilinear, optimised
from shared import timed

import kaju
from kaju.arrays import Floats
from kaju.model.growth.growth_rules import Compliance

CASES = {
    "half beam 150 x 50": (Beam("half beam", (150, 50)), 0.5, 2.4),
    "cantilever 160 x 100": (Beam("cantilever", (160, 100)), 0.4, 4.0),
}


def compliances(beam: Beam, density: Floats) -> tuple[float, float]:
    """Return F·u of a design by bilinear elements, and by kaju's equal cells."""
    scene, stiffness = beam.scene(), VOID + (1.0 - VOID) * density**POWER
    field = np.ones(scene.lattice.shape)
    field[:, -density.shape[1] :] = stiffness
    return Bilinear(beam).feel(stiffness)[0], 2.0 * kaju.solve(scene, stiffness=field).strain_energy


for name, (beam, volume, radius) in CASES.items():
    options = {"volume": volume, "filter_radius": radius, "at_rest": 0.0}
    for kind in ("density", "sensitivity"):
        grown = kaju.GrowthModel(beam.scene(), rule=Compliance(kind), most_steps=60, **options)
        ours = compliances(beam, grown.run(progress=False).density[:, -beam.cells[1] :])
        theirs = compliances(beam, optimised(beam, volume, radius, kind))
        bilinear, own = np.divide(ours, theirs)
        print(f"{name}, {kind} filter: F·u over the peer's {bilinear:.4f}; by kaju {own:.4f}")
    grown, times = kaju.GrowthModel(beam.scene(), most_steps=10_000, **options), []
    grown.step()
    for _ in range(3):
        own = timed(partial(grown.run, 10, progress=False))[1]
        peer = timed(partial(optimised, beam, volume, radius, steps=3))[1]
        times.append((100.0 * own, peer / 3.0 * 1e3))
    own, peer = map(median, zip(*times, strict=True))
    print(f"{name}: a step {own:.1f} ms, the peer {peer:.0f} ms: {peer / own:.1f} times")
