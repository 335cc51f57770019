"""The runs that lessons record: what their pages show, and what their texts tell of beside."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import kaju
from kaju.model.network import cut, jittered, pulled, triangular
from kaju.model.network import solve as solve_network

Run = Callable[[], Any]


def plate(cells: int = 20, pressed: int = 10) -> kaju.Scene:
    """Return a steel plate pressed at one cell of its top."""
    return kaju.Scene(
        body={"cell_size": 0.01, "cells": [cells, cells], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [pressed, cells - 1], "force": [0.0, -2.0]}],
        rule=kaju.ElasticRule(),
    )


def spawned(scene: kaju.Scene, tolerance: float = 0.01) -> Run:
    """Let agents spawn until the error is below the tolerance."""
    return lambda: kaju.SpawningModel(scene, tolerance=tolerance).run()


def pressed(width: int, force: float) -> Run:
    """Press a lattice in its middle, in 20 increments."""
    return lambda: solve_network(triangular(width, force=force), 20)


def bitten(damper: float, hold: float) -> Run:
    """Bite a noodle, hold it, and let it go."""

    def run() -> Any:
        history = kaju.History().ramp(1.0, duration=1.0).hold(hold).release(duration=1.0).hold(20.0)
        element = kaju.ThreeElement(K_f=1.0, D_f=1.0, D_d=damper)
        return kaju.creep(triangular(5, force=0.05), history, rheology=element)

    return run


def broad(cells: int) -> kaju.Scene:
    """Return a plate pressed in the middle of its top, of so many cells a side."""
    return kaju.Scene(
        body={"size": [0.2, 0.2], "cells": [cells, cells], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[0.08, 0.2], [0.12, 0.2]]}, "force": [0.0, -2.0]}],
    )


def bar() -> kaju.Scene:
    """Return a bar that is pulled evenly."""
    return kaju.Scene(
        body={"cell_size": 0.01, "cells": [4, 12], "thickness": 0.01, "material": "steel"},
        sides={"bottom": "roller", "left": "roller"},
        loads=[{"side": "top", "force": [0.0, 8.0]}],
    )


def solved(scene: kaju.Scene, resolution: int = 1) -> Run:
    """Solve a scene on its own cells, or on cells so many times smaller."""
    return lambda: kaju.solve(scene, resolution=resolution)


def bridge(load: int = 23, right: str = "roller", **growth: Any) -> Run:
    """Let a bridge grow on a firm left foot and a right one, loaded in one cell of its top."""
    codes = np.ones((47, 21), dtype=int)
    codes[:, 0] = 0
    codes[:2, 0], codes[-2:, 0] = 2, 3
    scene = kaju.Scene.from_array(
        codes,
        legend={0: "air", 1: "steel", 2: "rigid", 3: right},
        cell_size=0.05,
        thickness=0.1,
        loads=[{"cell": [load, 20], "force": [0.0, -1000.0]}],
    )
    usual = {"volume": 0.3, "filter_radius": 1.5, "most_steps": 60, "at_rest": 0.0}
    return lambda: kaju.GrowthModel(scene, **usual | growth).run()


def torn(half: float, scatter: float = 0.1) -> Run:
    """Pull a net with a level cut of 2 · half spacings apart, until it parts."""

    def run() -> Any:
        net = jittered(15, spacing=0.01, stiffness=1e4, seed=1)
        middle, reach = 0.5 * net.positions.max(axis=0), np.array([0.01 * half, 0.0])
        slit = cut(net, middle - reach, middle + reach) if half else net
        return kaju.FractureModel(pulled(slit, displacement=1e-3), scatter=scatter, seed=0).run()

    return run


def holed(across: float, along: float, cells: int = 0, tolerance: float = 0.003) -> Run:
    """Pull a quarter of a plate with an elliptical hole: as it is, or as steps of so many cells."""
    hole = {"ellipse": {"centre": [0.0, 0.0], "radii": [along, across]}, "material": "air"}
    outline = "cells" if cells else "true"
    scene = kaju.Scene(
        body={
            "size": [0.1, 0.1],
            "cells": [cells or 10] * 2,
            "thickness": 0.002,
            "material": "steel",
            "regions": [hole | {"name": "hole", "outline": outline}],
        },
        sides={"left": "roller", "bottom": "roller"},
        loads=[{"side": "right", "force": [2000.0, 0.0]}],
    )
    return solved(scene) if cells else lambda: kaju.solve(scene, tolerance=tolerance)


PAGES: dict[str, dict[str, Run]] = {
    "agents-of-many-sizes": {
        "": spawned(plate()),
        "rough": spawned(plate(), 0.02),
        "fine": spawned(plate(), 0.005),
        "twice-as-large": spawned(plate(40, 20)),
        "hole": spawned(plate().with_region(box=[[0.06, 0.06], [0.14, 0.12]]), 0.02),
        "at-the-edge": spawned(plate(pressed=2)),
    },
    "a-lattice-bends": {
        "": pressed(9, 0.1),
        "0.05-N": pressed(9, 0.05),
        "0.2-N": pressed(9, 0.2),
        "5-wide": pressed(5, 0.1),
        "17-wide": pressed(17, 0.1),
    },
    "a-noodle-remembers": {
        "": bitten(20.0, 5.0),
        "2-s": bitten(20.0, 2.0),
        "10-s": bitten(20.0, 10.0),
        "firm": bitten(200.0, 5.0),
    },
    "two-wrong-answers": {"": spawned(broad(5), 0.005)},
    "bones-and-bridges": {
        "": bridge(),
        "firm": bridge(right="rigid"),
        "quarter": bridge(11),
        "bone": bridge(rule="remodelling", most_steps=160),
        "60": bridge(volume=0.6),
        "15": bridge(volume=0.15),
    },
    "how-things-break": {
        "": torn(2.0),
        "short": torn(1.0),
        "long": torn(4.0),
        "whole": torn(0.0),
        "rough": torn(2.0, scatter=0.7),
    },
    "a-round-hole": {
        "": holed(0.01, 0.01),
        "upright": holed(0.015, 0.005),
        "lying": holed(0.005, 0.015),
        "steps": holed(0.01, 0.01, cells=40),
    },
}
"""What is shown, by lesson and page; the nameless page is the lesson's own."""
EVIDENCE: dict[str, dict[str, Run]] = {
    "agents-of-many-sizes": {"even": solved(plate(), 8)},
    "two-wrong-answers": {"bar": spawned(bar())},
    "a-round-hole": {
        **{f"steps-{n}": holed(0.01, 0.01, cells=n) for n in (20, 80, 160)},
        "coarse": holed(0.01, 0.01, tolerance=0.1),
    },
}
"""Further runs that a recorded lesson tells of."""


@cache
def run(lesson: str, name: str = "") -> Any:
    """Return a run of a lesson; each is done once."""
    return (PAGES[lesson] | EVIDENCE.get(lesson, {}))[name]()
