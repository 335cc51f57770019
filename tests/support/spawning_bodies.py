"""Bodies on rigid ground; `tests/data/spawning` has them by graded finite elements."""

import numpy as np
from plates import loaded
from scipy.ndimage import label

from kaju import Scene

CELL = 0.01
STEEL = {"youngs_modulus": 206e9, "poissons_ratio": 0.3}
BRASS = {"youngs_modulus": 100e9, "poissons_ratio": 0.4}
FOAM = {"youngs_modulus": 206e5, "poissons_ratio": 0.2}
RUBBER = {"youngs_modulus": 1e6, "poissons_ratio": 0.4999}


def laws(*pairs):
    """Return materials by Young's modulus and Poisson's ratio of each."""
    return [{"youngs_modulus": modulus, "poissons_ratio": ratio} for modulus, ratio in pairs]


def drawn(codes, materials, loads, **changes):
    """A scene of codes (0 is air, k the k-th material) or rows of letters: . is air, = rigid."""
    if isinstance(codes[0], str):
        codes = np.array([[".abc=".index(letter) for letter in row] for row in codes]).T[:, ::-1]
    used = np.unique(codes).astype(int).tolist()
    names = ("air", "a", "b", "c", "rigid")
    described = {"cell_size": CELL, "sides": {"bottom": "rigid"}} | changes
    return Scene.from_array(
        np.asarray(codes, dtype=int),
        legend={k: names[k] for k in used},
        materials={names[k]: materials[k - 1] for k in used if 0 < k < 4},
        loads=loads,
        **described,
    )


def on_top(codes, column, force):
    """Return a force on the uppermost cell of a column."""
    row = np.flatnonzero(codes[column]).max()
    return {"cell": [int(column), int(row)], "side": "top", "force": list(force)}


def ragged(seed, material=STEEL, **body):
    """A random body of 12 × 12 pixels, under an upright and an oblique force."""
    rng = np.random.default_rng(seed)
    codes = (rng.random((6, 6)) < 0.75).repeat(2, axis=0).repeat(2, axis=1)
    codes ^= rng.random(codes.shape) < 0.08
    codes[:, 0] = True
    codes = joined(codes)
    loads = [on_top(codes, 3, (0.0, -2.0)), on_top(codes, 8, (0.5, -1.0))]
    return drawn(codes, [material], loads, **body)


def joined(codes):
    """Return the part that stands on the ground; where cells touch at a corner it is filled."""
    while True:
        parts, _ = label(codes)
        codes = parts == parts[0, 0]
        a, b, c, d = codes[:-1, :-1], codes[1:, :-1], codes[:-1, 1:], codes[1:, 1:]
        touching = np.argwhere((a & d & ~b & ~c) | (b & c & ~a & ~d))
        if not len(touching):
            return codes
        for i, j in touching:
            codes[i : i + 2, j : j + 2] = True


def pressed(codes, materials, start, end, force=(0.0, -100.0), **body):
    """The same under a force on a part of its top."""
    top = CELL * np.shape(codes)[1]
    load = {"region": {"box": [[start, top], [end, top]]}, "force": list(force)}
    return drawn(codes, materials, [load], **body)


def pierced():
    """A plate of steel on brass with a round hole, pressed on all over its top."""
    x = (np.arange(16) + 0.5) / 16 - 0.5
    along, up = np.meshgrid(x, x, indexing="ij")
    codes = np.where(up > 0, 1, 2)
    codes[np.hypot(along, up) < 0.25] = 0
    return drawn(codes, [STEEL, BRASS], [{"side": "top", "pressure": 1e6}])


def rubber():
    """A thick slice of rubber, ν = 0.4999, pressed on a part of its top."""
    return pressed(np.ones((16, 16)), [RUBBER], 0.04, 0.08, plane="strain")


def rubber_corner():
    """An L of rubber, pushed aside."""
    codes = np.ones((12, 12))
    codes[6:, 6:] = 0
    return pressed(codes, [RUBBER], 0.0, 0.06, [10.0, -50.0], plane="strain")


def inclusion(outside, inside):
    """A rectangle within another material."""
    codes = np.ones((12, 12))
    codes[3:7, 5:9] = 2
    return pressed(codes, [outside, inside], 0.03, 0.06)


def blotched():
    """Steel and foam by chance, so that steel never touches steel at a corner only."""
    codes = 1 + (np.random.default_rng(2).random((6, 6)) < 0.4).repeat(2, axis=0).repeat(2, axis=1)
    return pressed(codes, [STEEL, FOAM], 0.03, 0.06)


def quarter(poissons_ratio, inside=None):
    """A quarter of a cube of edge 2, pressed on in the middle; perhaps with something inside."""
    regions = [] if inside is None else [{"material": "b", "box": [[0, 0, 0.25], [0.5, 0.5, 0.5]]}]
    materials = {"a": {"youngs_modulus": 1.0, "poissons_ratio": poissons_ratio}}
    materials |= {} if inside is None else {"b": inside}
    of = {"cell_size": 0.25, "material": "a", "regions": regions, "materials": materials}
    of |= {"sides": {"bottom": "rigid", "left": "roller", "front": "roller"}}
    return loaded([4] * 3, {"cell": [0, 0, 3], "side": "top", "force": [0.0, 0.0, -1.0]}, **of)


def under_a_patch(dimension=2, cells=8, force=(-1.0,)):
    """Return a block of 1 m, pressed on in a part of its top; the force's last components."""
    low, high = [0.25] * (dimension - 1) + [1.0], [0.5] * (dimension - 1) + [1.0]
    whole = [0.0] * (dimension - len(force)) + list(force)
    load = {"region": {"box": [low, high]}, "force": whole}
    return loaded([cells] * dimension, load, size=[1.0] * dimension)


PLANE = {
    "ragged-1": lambda: ragged(1),
    "ragged-2": lambda: ragged(2),
    "ragged-3": lambda: ragged(3),
    "pierced": pierced,
    "rubber": rubber,
    "rubber-corner": rubber_corner,
    "rubber-ragged": lambda: ragged(2, RUBBER, plane="strain"),
    "steel-in-foam": lambda: inclusion(FOAM, STEEL),
    "foam-in-steel": lambda: inclusion(STEEL, FOAM),
    "blotched": blotched,
}

SOLID = {
    "cube": lambda: quarter(0.3),
    "cube-rubber": lambda: quarter(0.4999),
    "cube-inclusion": lambda: quarter(0.3, {"youngs_modulus": 0.01, "poissons_ratio": 0.2}),
}
BODIES = PLANE | SOLID
