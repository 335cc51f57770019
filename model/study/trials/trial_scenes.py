"""Scenes that try the solvers and the rules: each made from a number alone.

Every family is a kind of body, material, support, load or coefficient that is known to give
trouble. The same number gives the same scene on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from kaju.errors import SceneError
from kaju.model.scene import Scene
from kaju.model.scene.pictures import embedded

Codes = NDArray[np.int64]
"""0 is air, 1, 2, … are materials, -1 is rigid; [column, row from the bottom]."""


def _pixels(rng: Generator) -> Codes:
    """Return half-filled pixels, joined and loose ones."""
    shape = rng.integers(2, 10, 2)
    return np.asarray((rng.random(shape) < rng.uniform(0.5, 1.0)) * rng.integers(1, 4, shape))


def _pierced(rng: Generator) -> Codes:
    """Return a plate with a rectangular hole."""
    codes = np.ones(rng.integers(5, 12, 2), dtype=np.int64)
    low = rng.integers(1, 3, 2)
    high = low + rng.integers(1, np.array(codes.shape) - low)
    codes[low[0] : high[0], low[1] : high[1]] = 0
    return codes


def _comb(rng: Generator) -> Codes:
    """Return teeth on a back."""
    codes = np.ones((2 * int(rng.integers(2, 6)) + 1, int(rng.integers(4, 10))), dtype=np.int64)
    codes[1::2, 2:] = 0
    return codes


def _neck(rng: Generator) -> Codes:
    """Return two blocks joined by a neck one cell wide."""
    n = int(rng.integers(2, 5))
    codes = np.ones((2 * n + 1, 3 * n), dtype=np.int64)
    codes[:, n : 2 * n] = 0
    codes[int(rng.integers(0, 2 * n + 1)), n : 2 * n] = 1
    return codes


def _corner_neck(rng: Generator) -> Codes:
    """Return two blocks that touch at a corner."""
    n = int(rng.integers(2, 5))
    codes = np.zeros((2 * n, 2 * n), dtype=np.int64)
    codes[:n, :n] = codes[n:, n:] = 1
    return codes


def _spiral(rng: Generator) -> Codes:
    """Return a wound-up member, one or two cells wide."""
    codes = np.zeros((11, 11), dtype=np.int64)
    place, heading = np.array([0, 0]), np.array([0, 1])
    for length in (10, 10, 10, 8, 8, 6, 6, 4, 4, 2)[: int(rng.integers(3, 11))]:
        for _ in range(length):
            codes[tuple(place)] = 1
            place = place + heading
        heading = np.array([heading[1], -heading[0]])
    codes[tuple(place)] = 1
    wide = int(rng.integers(1, 3))
    return codes.repeat(wide, axis=0).repeat(wide, axis=1)


def _bar(rng: Generator) -> Codes:
    """Return a bar one to three cells wide, lying or standing."""
    codes = np.ones((int(rng.integers(5, 60)), int(rng.integers(1, 4))), dtype=np.int64)
    return codes if rng.random() < 0.5 else codes.T


def _inclusion(rng: Generator) -> Codes:
    """Return a block within another material."""
    codes = np.ones((8, 8), dtype=np.int64)
    low, high = rng.integers(0, 4, 2), rng.integers(4, 9, 2)
    codes[low[0] : high[0], low[1] : high[1]] = 2
    return codes


def _layers(rng: Generator) -> Codes:
    """Return layers of materials, lying, standing, or only one cell thick."""
    codes = np.ones((8, 8), dtype=np.int64)
    first = int(rng.integers(1, 7))
    codes[:, first : first + int(rng.integers(1, 4))] = 2
    return codes if rng.random() < 0.5 else codes.T


def _bridge(rng: Generator) -> Codes:
    """Return two blocks joined by another material."""
    codes = np.ones((9, 6), dtype=np.int64)
    codes[3:6] = 2
    codes[3:6, : int(rng.integers(0, 5))] = 0
    return codes


BODIES: dict[str, Callable[[Generator], Codes]] = {
    "pixels": _pixels,
    "plain": lambda rng: np.ones(rng.integers(1, 12, 2), dtype=np.int64),
    "pierced": _pierced,
    # Stiff cells touch at corners only.
    "checkerboard": lambda rng: 1 + np.indices(tuple(rng.integers(2, 9, 2))).sum(axis=0) % 2,
    "comb": _comb,
    "neck": _neck,
    "corner neck": _corner_neck,
    "spiral": _spiral,
    # Of these grains most touch nothing.
    "dust": lambda rng: (rng.random((9, 9)) < 0.25).astype(np.int64),
    "bar": _bar,
    "inclusion": _inclusion,
    "layers": _layers,
    "bridge": _bridge,
    # Some cells inside the body are rigid.
    "walled": lambda rng: np.where(rng.random((8, 8)) < 0.1, -1, 1),
}
"""Families of bodies: cells drawn by chance."""


def elastic_scene(rng: Generator, family: str) -> Scene:
    """Return a plane or solid body of a family, its supports and loads at random."""
    codes = BODIES[family](rng)
    if not (codes > 0).any():
        codes[0, 0] = 1
    solid = rng.random() < 0.12
    if solid:
        codes = codes[:5, :5, None].repeat(int(rng.integers(1, 4)), axis=2)
        if not (codes > 0).any():
            codes[0, 0, 0] = 1
    names = {0: "air", -1: "rigid", 1: "a", 2: "b", 3: "c"}
    body: dict[str, Any] = {"cell_size": _size(rng)}
    if not solid:
        body |= {
            "plane": str(rng.choice(["stress", "strain"])),
            "thickness": float(10 ** rng.uniform(-4, 0)),
        }
    return _of_cells(
        codes,
        names,
        materials=_materials(rng, [n for k, n in names.items() if k > 0 and k in codes]),
        sides=_sides(rng, codes.ndim),
        loads=[_load(rng, codes) for _ in range(int(rng.integers(1, 4)))],
        rule={"kind": "elastic"},
        **body,
    )


def _of_cells(codes: Codes, names: dict[int, str], **described: Any) -> Scene:
    """Return a scene whose cells are given by codes."""
    legend = {int(code): names[int(code)] for code in np.unique(codes)}
    return Scene.from_array(codes, legend=legend, **described)


def _size(rng: Generator) -> float:
    """Return an edge (m): mostly a common one, at times a tiny or a huge one."""
    return float(10 ** (rng.uniform(-9, 6) if rng.random() < 0.15 else -2))


def _materials(rng: Generator, names: list[str]) -> dict[str, Any]:
    contrast = rng.choice([1.0, 2.0, 4.0, 6.0, 12.0], p=[0.3, 0.3, 0.2, 0.15, 0.05])
    stiffness = 10 ** (rng.uniform(-3, 15) if rng.random() < 0.1 else 11)
    return {
        name: {
            "youngs_modulus": float(stiffness * 10 ** (rng.uniform(-1, 1) * contrast / 2)),
            "poissons_ratio": _poissons_ratio(rng),
        }
        for name in names
    }


def _poissons_ratio(rng: Generator) -> float:
    kind = rng.random()
    if kind < 0.7:
        return float(rng.uniform(0.0, 0.45))
    if kind < 0.85:
        return float(0.5 - 10 ** rng.uniform(-9, -1))
    return float(-1.0 + 10 ** rng.uniform(-4, 0) if kind < 0.95 else rng.uniform(-0.9, 0.0))


def _sides(rng: Generator, dimension: int) -> dict[str, Any]:
    sides: dict[str, Any] = {}
    for name in _names(dimension):
        kind = rng.random()
        if kind < 0.12:
            sides[name] = "rigid"
        elif kind < 0.2:
            sides[name] = "roller"
        elif kind < 0.26:
            sides[name] = {"stiffness": float(10 ** rng.uniform(3, 15))}
        elif kind < 0.3:
            sides[name] = {"displacement": [float(v) for v in rng.normal(0, 1e-6, dimension)]}
    if rng.random() < 0.9:
        sides["bottom"] = "rigid"
    return sides


def _load(rng: Generator, codes: Codes) -> dict[str, Any]:
    """Return a force on a cell, at times a corner one, or a pressure on a side."""
    force = rng.normal(0.0, 1.0, codes.ndim) * 10 ** rng.uniform(-3, 3)
    if rng.random() < 0.2:
        return {"side": "top", "pressure": float(abs(force[0]) + 1e-3)}
    if rng.random() < 0.1:
        turn = [float(f) for f in rng.normal(0.0, 1.0, 3)]
        return {"side": "top", "couple": turn if codes.ndim == 3 else turn[0]}
    solid = np.argwhere(codes > 0)
    cell = solid[-1] if rng.random() < 0.3 else solid[rng.integers(len(solid))]
    load = {"cell": [int(i) for i in cell], "force": [float(f) for f in force]}
    return load if rng.random() < 0.2 else load | _surface(rng, codes, cell)


def _surface(rng: Generator, codes: Codes, cell: Codes) -> dict[str, str]:
    """Return a side of a cell with air or the outside beyond, if there is one."""
    around = np.pad(codes, 1)
    names = _names(codes.ndim)
    for number in rng.permutation(len(names)):
        beyond = cell + 1
        beyond[number // 2] += 2 * (number % 2) - 1
        if around[tuple(beyond)] == 0:
            return {"side": names[number]}
    return {}


def _names(dimension: int) -> list[str]:
    return ["left", "right", *(["front", "back"] if dimension == 3 else []), "bottom", "top"]


def hexagon_scene(rng: Generator) -> Scene:
    """Return a body of hexagons, at times with holes, pressed by its top."""
    codes = np.ones(rng.integers(2, 8, 2), dtype=np.int64)
    if rng.random() < 0.5:
        codes[tuple(rng.integers(0, np.array(codes.shape)))] = 0
    return _of_cells(
        codes,
        {0: "air", 1: "a"},
        materials={"a": {"youngs_modulus": 1e6, "poissons_ratio": 1 / 3}},
        lattice="hexagon",
        cell_size=_size(rng),
        thickness=0.002,
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [float(f) for f in rng.normal(0, 10, 2)]}],
    )


def transfer_scene(rng: Generator) -> Scene:
    """Return a small body under a prescribed rule, its shares often on the edge of growth."""
    lattice = str(rng.choice(["square", "hexagon", "cube"], p=[0.5, 0.25, 0.25]))
    dimension = 3 if lattice == "cube" else 2
    shape = rng.integers(1, 8 if dimension == 2 else 5, dimension)
    codes = np.asarray(rng.choice([1, 1, 1, 2, 0, -1], shape))
    codes[(0,) * dimension] = 1
    force = float(10 ** rng.uniform(-6, 6))
    loads = []
    for _ in range(int(rng.integers(1, 4))):
        cell = rng.permutation(np.argwhere(codes > 0))[0]
        vector = rng.normal(0.0, force, dimension)
        loads.append({"cell": [int(i) for i in cell], "force": [float(v) for v in vector]})
    kinds = ["free", "rigid", "roller"]
    names = ["left", "right", "bottom", "top", *(["front", "back"] if dimension == 3 else [])]
    return _of_cells(
        codes,
        {0: "air", -1: "rigid", 1: "steel", 2: "rubber"},
        cell_size=0.01,
        sides={name: str(rng.choice(kinds)) for name in names},
        loads=loads,
        rule=_rule(rng, dimension, force),
        allow_floating=True,
        **({"thickness": 0.002} if dimension == 2 else {}),
        **({"lattice": lattice} if lattice == "hexagon" else {}),
    )


def _rule(rng: Generator, dimension: int, force: float) -> dict[str, Any]:
    beside = 2 * (dimension - 1)
    forward, friction = rng.uniform(0.0, 1.0, 2) / (1.0, beside)
    beta, own = float(rng.uniform(0.0, 1.0)), float(rng.uniform(0.0, 0.99))
    if rng.random() < 0.5:  # on the edge of growth, on one side or the other
        sum_of_shares = forward + beside * friction
        stretch = (1.0 + rng.choice([-1e-3, -1e-9, 1e-9, 1e-3])) / max(sum_of_shares, 0.1)
        forward, friction = min(forward * stretch, 0.999), min(friction * stretch, 0.999)
        beta = float(rng.choice([beta, 1.0]))
    accumulate = bool(rng.random() < 0.5)
    # Loads judged by themselves, and hardly any too small: they become too many to count.
    odds = [0.9, 0.05, 0.05] if accumulate else [0.95, 0.0, 0.05]
    return {
        "alpha": [own, float(forward), float(friction)],
        "beta": beta,
        "threshold": float(force * rng.choice([10 ** rng.uniform(-4, 1), 1e-280, 1e30], p=odds)),
        "accumulate": accumulate,
    }


DRAWS = 6  # how often a scene is drawn until one describes something; the last may be refused


def described_scene(
    rng: Generator, family: str, rule: str = "elastic", pace: float | None = None
) -> Scene:
    """Return a body of shapes and an image, with weight, beds, moved sides and loads of all kinds.

    `family`: of the body in the image; `pace`: time (s) in which its materials creep.
    """
    return _sensible(lambda: _described(rng, family, rule, pace), Scene.applied)


def _sensible(draw: Callable[[], Scene], ask: Callable[[Scene], object]) -> Scene:
    """Return a scene that answers what it is asked, if one is among the first."""
    for _ in range(DRAWS - 1):
        with suppress(SceneError):
            scene = draw()
            ask(scene)
            return scene
    return draw()


def _described(rng: Generator, family: str, rule: str, pace: float | None) -> Scene:
    solid = rng.random() < 0.15
    codes = BODIES[family](rng)
    shape = tuple(int(n) for n in (rng.integers(2, 6, 3) if solid else codes.shape))
    h = 0.01
    size = h * np.array(shape)
    names = {"a", "b"} | ({"c"} if rng.random() < 0.3 else set())
    materials = _materials(rng, sorted(names))
    for table in materials.values():
        table["density"] = float(rng.uniform(10.0, 1e4))
        if pace is not None:
            k, d_f, d_d = (float(10 ** rng.uniform(-1, 1)) for _ in range(3))
            table["rheology"] = {"K_f": k, "D_f": d_f * pace, "D_d": d_d * pace * 10.0}
    body: dict[str, Any] = {"cell_size": h, "cells": shape, "material": "a"}
    body["regions"] = [] if solid else _pictured(codes)
    body["regions"] += [_region(rng, size, names) for _ in range(int(rng.integers(0, 3)))]
    if not solid:
        body |= {"plane": str(rng.choice(["stress", "strain"])), "thickness": 0.01}
    if rng.random() < 0.4:
        body["gravity"] = [*(float(g) for g in rng.normal(0, 1, len(shape) - 1)), -9.81]
    return Scene(
        body=body,
        materials=materials,
        sides=_sides(rng, len(shape)) if rule == "elastic" else {"bottom": "rigid"},
        loads=[_described_load(rng, size, rule) for _ in range(int(rng.integers(1, 4)))],
        rule={"kind": "elastic"} if rule == "elastic" else _rule(rng, len(shape), 1.0),
    )


def _pictured(codes: Codes) -> list[dict[str, Any]]:
    """Return a body's cells as images that are filled, one for each of its materials."""
    kinds = {0: "air", -1: "rigid", 2: "b"}
    found = [(name, codes == code) for code, name in kinds.items() if (codes == code).any()]
    drawn = [(name, np.where(dark.T[::-1], 0, 255).astype(np.uint8)) for name, dark in found]
    return [{"image": {"file": embedded(pixels)}, "material": name} for name, pixels in drawn]


def _region(rng: Generator, size: NDArray[np.float64], names: set[str]) -> dict[str, Any]:
    """Return a shape anywhere in or beside the body, filled with anything."""
    material = str(rng.choice([*sorted(names), "air"]))
    low, span = size * rng.uniform(-0.1, 0.8, len(size)), size * rng.uniform(0.1, 0.5, len(size))
    round_ = {"centre": (low + span / 2).tolist(), "radius": float(span.min() / 2)}
    shapes: list[dict[str, Any]] = [
        {"box": [low.tolist(), (low + span).tolist()]},
        {"ball" if len(size) == 3 else "disk": round_},
    ]
    if len(size) == 2:
        turned = low + span * rng.uniform(0.0, 1.0, (int(rng.integers(3, 7)), 2))
        shapes.append({"polygon": turned.tolist()})
    return {**shapes[rng.integers(len(shapes))], "material": material}


def _described_load(rng: Generator, size: NDArray[np.float64], rule: str) -> dict[str, Any]:
    """Return a load by point, side or region: a force, a couple, or a pressure that may slope."""
    d = len(size)
    force = [float(f) for f in rng.normal(0.0, 1.0, d) * 10 ** rng.uniform(-1, 3)]
    low, high = np.sort(size * rng.uniform(0.0, 1.0, (2, d)), axis=0)
    flat = low.copy(), high.copy()
    for end in flat:  # a box without thickness, on the top: its ends lie anywhere on the faces
        end[-1] = size[-1]
    places: list[dict[str, Any]] = [
        {"side": str(rng.choice(_names(d)[: 2 * d]))},
        {"region": {"box": [end.tolist() for end in flat]}},
        {"region": {"box": [low.tolist(), high.tolist()]}},
        {"point": (size * rng.uniform(0.0, 1.0, d)).tolist()},
    ]
    kind = int(rng.integers(4))
    place = places[rng.integers(4 if kind == 0 else 2)]
    if kind == 0:
        return {**place, "force": force}
    if kind == 1 and rule == "elastic":
        return {**place, "couple": force[0] * 0.01 if d == 2 else [0.01 * f for f in force]}
    load = {**place, "pressure": float(rng.normal(0.0, 1e4))}
    if kind == 3:
        load["pressure_slope"] = [float(s) for s in rng.normal(0.0, 1e5, d)]
    return load


def large_scene(rng: Generator) -> Scene:
    """Return a plate or a block of 10⁵ cells with holes and two materials."""
    solid = rng.random() < 0.25
    shape = (46, 46, 47) if solid else (316, 317)
    size = 0.01 * np.array(shape)
    regions = [_region(rng, size, {"a", "b"}) for _ in range(int(rng.integers(0, 12)))]
    return Scene(
        body={"cell_size": 0.01, "cells": shape, "material": "a", "regions": regions},
        materials=_materials(rng, ["a", "b"]),
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [float(f) for f in rng.normal(0.0, 1e3, len(shape))]}],
        rule={"kind": "elastic"},
    )


def outlined_scene(rng: Generator) -> Scene:
    """Return a plate of true outlines: drawn in air, or cut out of it; some on lines of cells."""
    from kaju.model.outline.outlined_scene import problem_of

    return _sensible(lambda: _outlined(rng), problem_of)


def _outlined(rng: Generator) -> Scene:
    """Return one, its loads on sides and outlines."""
    cells, h = rng.integers(2, 10, 2), _size(rng)
    solid, straight = bool(rng.random() < 0.6), bool(rng.random() < 0.3)
    regions = []
    for number in range(int(rng.integers(1, 5))):
        first = number == 0 and not solid
        span: NDArray[np.float64] = cells * rng.uniform(*((0.7, 1.3) if first else (0.1, 0.5)), 2)
        middle = cells * (0.4 if first else rng.uniform(0.05, 0.95, 2))
        if rng.random() < 0.3:
            beside = rng.choice([0.0, 1e-9, 1e-6, 1e-3])
            middle, span = np.round(middle) + beside, 2.0 * np.ceil(0.5 * span)
        drawn = _outline(rng, np.asarray(h * middle, dtype=float), 0.5 * h * span, straight)
        material = "a" if first or rng.random() < 0.1 else "air"
        regions.append({**drawn, "material": material, "outline": "true", "name": f"line {number}"})
    body: dict[str, Any] = {
        "cell_size": h,
        "cells": cells.tolist(),
        "material": "a" if solid else "air",
        "plane": str(rng.choice(["stress", "strain"])),
        "thickness": float(10 ** rng.uniform(-4, 0)),
        "regions": regions,
    }
    materials = _materials(rng, ["a"])
    if straight and rng.random() < 0.7:
        body["gravity"] = [float(rng.normal()), -9.81]
        materials["a"]["density"] = float(rng.uniform(10.0, 1e4))
    # Beds and moved sides are refused: hardly any are drawn.
    held = {k: v for k, v in _sides(rng, 2).items() if isinstance(v, str) or rng.random() < 0.1}
    places = [{"side": name} for name in _names(2) if name not in held and solid]
    lines = [{"outline": r["name"]} for r in regions if r["material"] != body["material"]]
    places += lines or [{"side": "top"}]
    loads: list[dict[str, Any]] = []
    for place in rng.permutation(np.array(places))[: int(rng.integers(1, 3))]:
        force = rng.normal(0.0, 1.0, 2) * 10 ** rng.uniform(-3, 3)
        acts = {"pressure": float(force[0])} if rng.random() < 0.5 else {"force": force.tolist()}
        loads.append({**place, **acts})
    own = rng.spawn(1)[0]  # so that cases of before are drawn as they were
    if "gravity" not in body and own.random() < 0.4:  # holes that no load acts on are filled
        loaded = [load.get("outline") for load in loads]
        for one in regions:
            if one["name"] not in loaded and own.random() < 0.7:
                one["material"] = "b"
        materials |= _materials(own, ["b"])
    rule = {"kind": "elastic"}
    return Scene(body=body, materials=materials, sides=held, loads=loads, rule=rule)


def _outline(
    rng: Generator, middle: NDArray[np.float64], half: NDArray[np.float64], straight: bool
) -> dict[str, Any]:
    """Return a shape about a point (m), within half of its width and height (m)."""
    turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(3, 8))))
    reach = half * rng.uniform(0.4, 1.0, (len(turns), 1))
    corners = middle + reach * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    box = [(middle - half).tolist(), (middle + half).tolist()]
    centre, radius = middle.tolist(), float(half.min())
    shapes: list[dict[str, Any]] = [
        {"box": box},
        {"polygon": corners.tolist()},
        {"disk": {"centre": centre, "radius": radius}},
        {"ring": {"centre": centre, "inner": radius * rng.uniform(0.3, 0.8), "outer": radius}},
        {"ellipse": {"centre": centre, "radii": half.tolist(), "angle": rng.uniform(0, 90)}},
        {"slot": {"ends": box, "radius": radius * rng.uniform(0.1, 0.5)}},
        {"rounded_box": {"box": box, "radius": radius * rng.uniform(0.1, 0.9)}},
        {"path": _path(rng, corners)},
    ]
    return shapes[rng.integers(2 if straight else len(shapes))]


def _path(rng: Generator, corners: NDArray[np.float64]) -> str:
    """Return a smooth closed path by the middles of a polygon's sides."""
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    text = [f"M {middles[-1][0]} {middles[-1][1]}"]
    for (x, y), (to_x, to_y) in zip(corners, middles, strict=True):
        text.append(str(rng.choice([f"Q {x} {y}", f"C {x} {y} {x} {y}"])) + f" {to_x} {to_y}")
    return f"{' '.join(text)} Z"
