"""Random scenes as Hypothesis strategies: for loads passed on, for elasticity, with outlines."""

import runpy
from pathlib import Path

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st
from plates import loaded
from spawning_bodies import drawn, laws

from kaju import Coefficients, PrescribedRule
from kaju.errors import SceneError

EXAMPLES = Path(__file__).parents[2] / "examples"
Triangles = runpy.run_path(str(EXAMPLES / "triangles" / "triangles.py"))["Triangles"]

share = st.floats(0.0, 0.6)
either = st.booleans()
coefficients = st.builds(
    Coefficients, alpha=st.none() | st.tuples(share, share, share), beta=st.floats(0.0, 1.0)
)


@st.composite
def rules(draw, senses=either):
    alpha = draw(st.none() | st.tuples(share, share, share))
    materials = draw(st.dictionaries(st.sampled_from(["steel", "rubber"]), coefficients))
    return PrescribedRule(
        alpha=alpha,
        beta=draw(st.floats(0.0, 1.0)),
        threshold=draw(st.floats(1e-3, 1.0)),
        accumulate=draw(st.booleans()),
        materials=materials,
        sense=draw(senses),
    )


@st.composite
def scenes(draw, rule=None, senses=either):
    """Small drawn bodies of three lattices, 1×N among them, pressed on at random."""
    columns, rows = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    letters = st.text("aaaab.=", min_size=columns, max_size=columns)
    drawing = draw(st.lists(letters, min_size=rows, max_size=rows))
    body_cells = [
        [column, rows - 1 - row]
        for row, line in enumerate(drawing)
        for column, letter in enumerate(line)
        if letter in "ab"
    ]
    if not body_cells:
        drawing[0] = "a" + drawing[0][1:]
        body_cells = [[0, rows - 1]]
    force = st.floats(-5.0, 5.0)
    sense = st.sampled_from(["push", "pull", None])
    loads = [
        {
            "cell": draw(st.sampled_from(body_cells)),
            "force": [draw(force), draw(force) or -1.0],
            "sense": draw(sense),
        }
        for _ in range(draw(st.integers(1, 3)))
    ]
    held = st.sampled_from(["free", "rigid", "roller"])
    return loaded(
        "\n".join(drawing),
        *loads,
        lattice=draw(st.sampled_from(["square", "hexagon", Triangles])),
        sides={side: draw(held) for side in ("left", "right", "bottom", "top")},
        rule=draw(rules(senses)) if rule is None else rule,
        thickness=0.002,
        allow_floating=True,
    )


# Bodies for elasticity, of families that are known to give trouble: 0 is air, -1 rigid.


def _pierced(rng):
    codes = np.ones(rng.integers(5, 12, 2), dtype=int)
    low = rng.integers(1, 3, 2)
    high = low + rng.integers(1, np.array(codes.shape) - low)
    codes[low[0] : high[0], low[1] : high[1]] = 0
    return codes


def _comb(rng):
    codes = np.ones((2 * rng.integers(2, 6) + 1, rng.integers(4, 10)), dtype=int)
    codes[1::2, 2:] = 0
    return codes


def _neck(rng):
    n = rng.integers(2, 5)
    codes = np.ones((2 * n + 1, 3 * n), dtype=int)
    codes[:, n : 2 * n] = 0
    codes[rng.integers(0, 2 * n + 1), n : 2 * n] = 1
    return codes


def _layers(rng):
    codes = np.ones((8, 8), dtype=int)
    first = rng.integers(1, 7)
    codes[:, first : first + rng.integers(1, 4)] = 2
    return codes if rng.random() < 0.5 else codes.T


def _pixels(rng):
    shape = rng.integers(2, 10, 2)
    return (rng.random(shape) < rng.uniform(0.5, 1.0)) * rng.integers(1, 4, shape)


FAMILIES = {
    "pixels": _pixels,
    "plain": lambda rng: np.ones(rng.integers(1, 12, 2), dtype=int),
    "pierced": _pierced,
    "checkerboard": lambda rng: 1 + np.indices(rng.integers(2, 9, 2)).sum(axis=0) % 2,
    "comb": _comb,
    "neck": _neck,
    "touching at a corner": lambda rng: np.kron(np.eye(2, dtype=int), np.ones((3, 3), dtype=int)),
    "dust": lambda rng: (rng.random((9, 9)) < 0.25).astype(int),
    "bar": lambda rng: np.ones((rng.integers(5, 60), rng.integers(1, 4)), dtype=int),
    "layers": _layers,
    "walled": lambda rng: np.where(rng.random((8, 8)) < 0.1, -1, 1),
}
POISSONS = (
    st.floats(0.0, 0.45)
    | st.floats(-9, -1).map(lambda e: 0.5 - 10**e)
    | st.floats(-4, -1).map(lambda e: 10**e - 1)
)
HELD = (
    st.sampled_from(["free", "free", "free", "rigid", "roller"])
    | st.floats(3, 15).map(lambda e: {"stiffness": 10**e})
    | st.tuples(*2 * [st.floats(-1e-6, 1e-6)]).map(lambda u: {"displacement": list(u)})
)


@st.composite
def elastic_scenes(draw, extreme=True):
    """Bodies of cells drawn by chance, stiff beside soft, held and loaded in every way."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    codes = FAMILIES[draw(st.sampled_from(sorted(FAMILIES)))](rng)
    if not (codes > 0).any():
        codes[0, 0] = 1
    solid = draw(st.integers(0, 9)) == 0 and (codes[:4, :4] > 0).any()
    if solid:
        codes = codes[:4, :4, None].repeat(draw(st.integers(1, 3)), axis=2)
    contrast = draw(st.sampled_from([1, 2, 4, 12] if extreme else [1, 2]))
    modulus = st.floats(-contrast / 2, contrast / 2).map(lambda e: 1e11 * 10**e)
    law = st.tuples(modulus, POISSONS if extreme else st.floats(0.0, 0.4))
    materials = laws(*(draw(law) if (codes == k).any() else (1.0, 0.0) for k in (1, 2, 3)))
    names = ["left", "right", *(["front", "back"] if solid else []), "bottom", "top"]
    held = st.sampled_from(["free", "rigid", "roller"]) if solid else HELD
    sides = {name: draw(held) for name in names} | {"bottom": "rigid"}
    force = st.floats(-1e3, 1e3).filter(lambda f: abs(f) > 1e-3)
    loads = []
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.sampled_from(np.argwhere(codes > 0).tolist()))
        on_cell = {"cell": at, "force": [draw(force) for _ in names[::2]]}
        loads.append(draw(st.sampled_from([on_cell, {"side": "top", "pressure": draw(force)}])))
    body = {"cell_size": 10.0 ** draw(st.integers(-9, 6) if extreme else st.just(-2))}
    if not solid:
        body |= {"plane": draw(st.sampled_from(["stress", "strain"])), "thickness": 0.01}
    try:
        return drawn(
            np.where(codes < 0, 4, codes), materials, loads,
            sides=sides, rule={"kind": "elastic"}, **body,
        )  # fmt: skip
    except SceneError:  # loose grains, or faces that are held
        reject()


@st.composite
def shapes(draw, size):
    """A shape somewhere in or beside a plate (m), as a region describes it."""
    low = [size * draw(st.floats(-0.1, 0.7)) for _ in "xy"]
    span = [size * draw(st.floats(0.15, 0.5)) for _ in "xy"]
    box = [low, [a + b for a, b in zip(low, span, strict=True)]]
    centre = [a + 0.5 * b for a, b in zip(low, span, strict=True)]
    radius = 0.5 * min(span)
    (x0, y0), (x1, y1) = box
    corners = [[x0, y0], [x1, y0], [centre[0], y1]]
    every = [
        {"box": box},
        {"disk": {"centre": centre, "radius": radius}},
        {"ring": {"centre": centre, "inner": 0.4 * radius, "outer": radius}},
        {"ellipse": {"centre": centre, "radii": [0.5 * s for s in span], "angle": 20.0}},
        {"slot": {"ends": box, "radius": 0.3 * radius}},
        {"rounded_box": {"box": box, "radius": 0.4 * radius}},
        {"polygon": corners},
        {"path": f"M {x0} {y0} H {x1} Q {x1} {y1} {centre[0]} {y1} Z"},
    ]
    return draw(st.sampled_from(every))


@st.composite
def outlined_scenes(draw):
    """A plate with holes or inclusions of true outlines, its loads on the top or an outline."""
    regions = [
        {
            **draw(shapes(0.1)),
            "material": draw(st.sampled_from(["air", "air", "b"])),
            "outline": "true",
            "name": f"line {number}",
        }
        for number in range(draw(st.integers(1, 2)))
    ]
    hole = next((one["name"] for one in regions if one["material"] == "air"), None)
    place = draw(st.sampled_from([{"side": "top"}, *([{"outline": hole}] if hole else [])]))
    of = {"size": [0.1, 0.1], "thickness": 0.01, "material": "a", "regions": regions}
    of |= {"plane": draw(st.sampled_from(["stress", "strain"]))}
    ratio = st.floats(0.0, 0.45)
    materials = laws((1e9, draw(ratio)), (1e11, draw(ratio)))
    of |= {"materials": dict(zip("ab", materials, strict=True))}
    try:
        return loaded([4, 4], {**place, "pressure": draw(st.sampled_from([-1e5, 1e5]))}, **of)
    except SceneError:  # a shape beside the plate
        reject()
