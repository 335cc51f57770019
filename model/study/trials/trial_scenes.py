"""Scenes that try the solvers and the rules: each made from a number alone.

Every family is a way in which bodies, materials, supports, loads or coefficients are known to
give trouble. The same number gives the same scene on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from kaju.model.scene import Scene

Codes = NDArray[np.int64]
"""0 is air, 1, 2, … are materials, -1 is rigid; [column, row from the bottom]."""

ELASTIC = "kind", "elastic"


def _pixels(rng: Generator) -> Codes:
    """Return half-filled pixels, joined and loose ones."""
    shape = rng.integers(2, 10, 2)
    return np.asarray((rng.random(shape) < rng.uniform(0.5, 1.0)) * rng.integers(1, 4, shape))


def _plain(rng: Generator) -> Codes:
    """Return a full plate."""
    return np.ones(rng.integers(1, 12, 2), dtype=np.int64)


def _pierced(rng: Generator) -> Codes:
    """Return a plate with a rectangular hole."""
    codes = np.ones(rng.integers(5, 12, 2), dtype=np.int64)
    low = rng.integers(1, 3, 2)
    high = low + rng.integers(1, np.array(codes.shape) - low)
    codes[low[0] : high[0], low[1] : high[1]] = 0
    return codes


def _checkerboard(rng: Generator) -> Codes:
    """Return two materials by turns: stiff cells touch at corners only."""
    n = rng.integers(2, 9, 2)
    return 1 + np.add.outer(np.arange(n[0]), np.arange(n[1])) % 2


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
    place, way = np.array([0, 0]), np.array([0, 1])
    for length in (10, 10, 10, 8, 8, 6, 6, 4, 4, 2)[: int(rng.integers(3, 11))]:
        for _ in range(length):
            codes[tuple(place)] = 1
            place = place + way
        way = np.array([way[1], -way[0]])
    codes[tuple(place)] = 1
    wide = int(rng.integers(1, 3))
    return codes.repeat(wide, axis=0).repeat(wide, axis=1)


def _dust(rng: Generator) -> Codes:
    """Return grains of which most touch nothing."""
    return np.asarray((rng.random((9, 9)) < 0.25).astype(np.int64))


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


def _walled(rng: Generator) -> Codes:
    """Return rigid cells inside the body."""
    codes = np.ones((8, 8), dtype=np.int64)
    codes[rng.random((8, 8)) < 0.1] = -1
    return codes


BODIES: dict[str, Callable[[Generator], Codes]] = {
    "pixels": _pixels,
    "plain": _plain,
    "pierced": _pierced,
    "checkerboard": _checkerboard,
    "comb": _comb,
    "neck": _neck,
    "corner neck": _corner_neck,
    "spiral": _spiral,
    "dust": _dust,
    "bar": _bar,
    "inclusion": _inclusion,
    "layers": _layers,
    "bridge": _bridge,
    "walled": _walled,
}


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
    legend = {0: "air", -1: "rigid", 1: "a", 2: "b", 3: "c"}
    body: dict[str, Any] = {"cell_size": _size(rng)}
    if not solid:
        body |= {
            "plane": str(rng.choice(["stress", "strain"])),
            "thickness": float(10 ** rng.uniform(-4, 0)),
        }
    return Scene.from_array(
        codes,
        legend={int(code): legend[int(code)] for code in np.unique(codes)},
        materials=_materials(rng, [n for k, n in legend.items() if k > 0 and k in codes]),
        sides=_sides(rng, codes.ndim),
        loads=[_load(rng, codes) for _ in range(int(rng.integers(1, 4)))],
        rule={"kind": "elastic"},
        **body,
    )


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
    return Scene.from_array(
        codes,
        legend={0: "air", 1: "a"} if (codes == 0).any() else {1: "a"},
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
    legend = {0: "air", -1: "rigid", 1: "steel", 2: "rubber"}
    return Scene.from_array(
        codes,
        legend={int(code): legend[int(code)] for code in np.unique(codes)},
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
