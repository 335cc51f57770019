"""Networks that break beside what is known: stress intensity (Tada), bundles of fibres (Daniels).

    python benchmarks/fracture.py    # a minute

H. Tada, P. C. Paris, G. R. Irwin, "The Stress Analysis of Cracks Handbook", ASME 2000.
H. E. Daniels, Proc. Royal Society A 183 (1945) 405-435.
"""

from __future__ import annotations

import numpy as np

import kaju
from kaju.model.network import SpringNetwork, cut, pulled, triangular

WIDTH, ROWS, TIP = 81, 141, 0.18  # by so many spacings the tip lies beyond the springs cut
FIBRES = 100_000


def slit(half: float) -> tuple[SpringNetwork, float]:
    """Return a lattice with a level cut, pulled by 1 N a spacing, and half the cut's length."""
    whole, middle = triangular(WIDTH, ROWS), 0.5 * (WIDTH - 1)
    level = 0.5 * np.sqrt(3.0) * (ROWS // 2 + 0.5)
    network = cut(whole, (middle - half, level), (middle + half, level))
    return pulled(network, WIDTH - 1.0), (len(whole.springs) - len(network.springs)) / 4.0


def gives(half: float) -> float:
    """Return how far the load moves for 1 N when the first spring of a cut lattice breaks."""
    once = kaju.FractureModel(slit(half)[0], scatter=0.0, most_breaks=1).run()
    return float(once.displacement[0] / once.force[0])


for half in (6, 8, 12, 16, 20):
    # What a cut longer by two halves of a spacing releases, at each of two tips.
    released = 0.25 * (WIDTH - 1.0) ** 2 * (gives(half + 0.51) - gives(half - 0.49))
    length = slit(half + 0.01)[1] + TIP
    share = 2.0 * length / (WIDTH - 1.0)
    shape = (1.0 - 0.025 * share**2 + 0.06 * share**4) / np.sqrt(np.cos(0.5 * np.pi * share))
    found = np.sqrt(released * 2.0 / np.sqrt(3.0)) / (shape * np.sqrt(np.pi * length))
    print(f"half a cut of {half} spacings: stress intensity over the handbook's {found:.4f}")

fibres = SpringNetwork.build(
    [[0.0, 0.0], [1.0, 0.0]],
    np.tile([[0, 1]], (FIBRES, 1)),
    held=[[True, True], [False, True]],
    forces=[[0.0, 0.0], [1.0, 0.0]],
)
broken = kaju.FractureModel(fibres, seed=0, weibull=5.0).run()
sizes = broken.avalanche_sizes[:-1]
sizes = sizes[sizes <= 100]
powers, possible = np.linspace(1.5, 3.5, 401), np.arange(1.0, 101.0)
normal = np.log([(possible**-power).sum() for power in powers])
likeliest = powers[np.argmax(-powers * np.log(sizes).mean() - normal)]
print(
    f"strength a fibre {broken.largest_load_factor / FIBRES:.4f}, Daniels "
    f"{(5.0 * np.e) ** -0.2:.4f}; exponent of the avalanches {likeliest:.2f}, known 2.5"
)
