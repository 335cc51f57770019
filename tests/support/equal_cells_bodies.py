"""Bodies of equal cells whose answers are pinned in `data/equal_cells.npz`.

The file was written by the solver that assembles every level of its hierarchy as a sparse matrix
(version 0.1.0): `answer` of every body. It need not be written again.
"""

from pathlib import Path

import numpy as np

import kaju

TRUTH = Path(__file__).parents[1] / "data" / "equal_cells.npz"

MATERIALS = {
    "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
    "stiff": {"youngs_modulus": 1e15, "poissons_ratio": 0.2},
    "soft": {"youngs_modulus": 1e3, "poissons_ratio": 0.4},
    "mild": {"youngs_modulus": 1e11, "poissons_ratio": -0.4},
    "gum": {"youngs_modulus": 1e7, "poissons_ratio": 0.4999},
}
LEGEND = {0: "a", 1: "air", 2: "stiff", 3: "soft", 4: "mild", 5: "gum", 6: "rigid"}
CLAMPED = {"bottom": "rigid"}


def flat(change=None, shape=(24, 20), sides=CLAMPED, plane="stress", force=(0.3, -2.0)):
    """A plate of cells of 1 cm; `change` writes kinds of cells into it."""
    kinds = np.zeros(shape, int)
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    if change:
        change(kinds, x, y)
    middle, top = 0.01 * (shape[0] // 2), 0.01 * shape[1]  # loads end between faces
    return kaju.Scene.from_array(
        kinds, legend=LEGEND, cell_size=0.01, thickness=0.02, plane=plane, materials=MATERIALS,
        sides=sides,
        loads=[{"region": {"box": [[middle - 0.03, top], [middle + 0.02, top]]}, "force": force}],
    )  # fmt: skip


def solid(change=None, shape=(12, 10, 11), sides=CLAMPED):
    """A block of cubes of 1 cm."""
    kinds = np.zeros(shape, int)
    grid = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    if change:
        change(kinds, *grid)
    loads = [{"cell": [4, 5, shape[2] - 1], "side": "top", "force": [0.5, 0.2, -2.0]}]
    return kaju.Scene.from_array(
        kinds, legend=LEGEND, cell_size=0.01, materials=MATERIALS, sides=sides, loads=loads
    )


def disc(kind):
    """Write a kind into a disc (a cylinder along y in space)."""

    def change(kinds, *place):
        x, y = place[0], place[-1]
        kinds[(x - 11) ** 2 + (y - 9) ** 2 < 16] = kind

    return change


def corner(kinds, x, y):
    kinds[(x > 12) & (y > 9)] = 1


def half(kinds, *place):
    kinds[place[-1] > 5] = 2


def speckled(kinds, x, y):
    kinds[np.random.default_rng(3).random(kinds.shape) < 0.4] = 4


def pores(kinds, x, y):
    kinds[(x % 6 < 2) & (y % 5 > 3) & (y < 18)] = 1


def many(kinds, x, y):
    kinds[(x < 6) & (y > 6)] = 4
    kinds[(x > 15) & (x < 19) & (y > 3) & (y < 12)] = 1
    kinds[(abs(x - 11) < 2) & (y < 5)] = 6
    kinds[(x > 20) & (y < 10)] = 3


def gummy(kinds, x, y):
    kinds[(x > 5) & (x < 14) & (y > 6) & (y < 15)] = 5


def cavity(kind):
    """Write a kind into a ball."""

    def change(kinds, x, y, z):
        kinds[(x - 7) ** 2 + (y - 5) ** 2 + (z - 5) ** 2 < 8] = kind

    return change


BED = {"bottom": {"stiffness": 2e10}}
HELD = {"left": "roller"} | BED | {"right": {"displacement": [1e-9, 2e-9]}}
ROLLERS = {"left": "roller", "front": "roller"}
HELD_3D = ROLLERS | BED | {"right": {"displacement": [1e-9, 2e-9, 0.0]}}

BODIES = {
    "plate": lambda: flat(shape=(32, 16)),
    "odd plate": lambda: flat(shape=(23, 17)),
    "hole": lambda: flat(disc(1)),
    "L": lambda: flat(corner),
    "stiff inclusion": lambda: flat(disc(2)),
    "soft inclusion": lambda: flat(disc(3), shape=(25, 21)),
    "stiff on soft": lambda: flat(half, sides={"bottom": "rigid", "left": "roller"}),
    "speckled": lambda: flat(speckled, plane="strain"),
    "pores": lambda: flat(pores),
    "many": lambda: flat(many, sides={"left": "rigid"}),
    "held in four ways": lambda: flat(disc(1), sides=HELD),
    "plate held in four ways": lambda: flat(shape=(16, 32), sides=HELD),
    "gum": lambda: flat(gummy, plane="strain"),
    "block": lambda: solid(shape=(16, 16, 16)),
    "cavity": lambda: solid(cavity(1)),
    "stiff ball": lambda: solid(cavity(2)),
    "mild cylinder": lambda: solid(disc(4), sides=HELD_3D),
}


def answer(name):
    """Return what is pinned of a body's answer."""
    result = kaju.solve(BODIES[name]())
    return result.displacement, result.strain_energy, result.reactions
