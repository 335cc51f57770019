"""The runs that lessons record: what their pages show, and what their texts tell of beside."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

import kaju
from kaju.errors import BucklingError
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


def spawned(scene: kaju.Scene, tolerance: float = 0.01) -> Any:
    """Let agents spawn until the error is below the tolerance."""
    return kaju.SpawningModel(scene, tolerance=tolerance).run()


def pressed(width: int) -> Any:
    """Press a lattice in its middle, in steps of 0.02 N, until it buckles on the way to 0.4 N."""
    try:
        return solve_network(triangular(width, force=0.4), 20)
    except BucklingError as buckled:
        return buckled.result


def bitten(damper: float, hold: float) -> Any:
    """Bite a noodle, hold it, and let it go."""
    history = kaju.History().ramp(1.0, duration=1.0).hold(hold).release(duration=1.0).hold(20.0)
    element = kaju.ThreeElement(K_f=1.0, D_f=1.0, D_d=damper)
    return kaju.creep(triangular(5, force=0.05), history, rheology=element)


def broad(cells: int, half: float = 0.02) -> kaju.Scene:
    """Return a plate of so many cells a side, pressed so far round the middle of its top."""
    return kaju.Scene(
        body={"size": [0.2, 0.2], "cells": [cells, cells], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[0.1 - half, 0.2], [0.1 + half, 0.2]]}, "force": [0.0, -2.0]}],
    )


def bar() -> kaju.Scene:
    """Return a bar that is pulled evenly."""
    return kaju.Scene(
        body={"cell_size": 0.01, "cells": [4, 12], "thickness": 0.01, "material": "steel"},
        sides={"bottom": "roller", "left": "roller"},
        loads=[{"side": "top", "force": [0.0, 8.0]}],
    )


def bridge(load: int = 23, right: str = "roller", **growth: Any) -> Any:
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
    return kaju.GrowthModel(scene, tolerance=1e-6, **usual | growth).run()


def torn(half: float, scatter: float = 0.1, seed: int = 0, finer: int = 1) -> Any:
    """Pull a net with a level cut of 2 · half centimetres apart, until it parts."""
    net = jittered(14 * finer + 1, spacing=0.01 / finer, stiffness=1e4, seed=seed + 1)
    middle, reach = 0.5 * net.positions.max(axis=0), np.array([0.01 * half, 0.0])
    slit = cut(net, middle - reach, middle + reach) if half else net
    return kaju.FractureModel(pulled(slit, displacement=1e-3), scatter=scatter, seed=seed).run()


def holed(across: float, along: float, cells: int = 0, tolerance: float | None = 0.003) -> Any:
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
    return kaju.solve(scene, tolerance)


PAGES: dict[str, dict[str, Run]] = {
    "agents-of-many-sizes": {
        "": partial(spawned, plate()),
        "rough": partial(spawned, plate(), 0.02),
        "fine": partial(spawned, plate(), 0.005),
        "twice-as-large": partial(spawned, plate(40, 20)),
        "hole": partial(spawned, plate().with_region(box=[[0.06, 0.06], [0.14, 0.12]]), 0.02),
        "at-the-edge": partial(spawned, plate(pressed=2)),
    },
    "a-lattice-bends": {
        "": partial(pressed, 9),
        "5-wide": partial(pressed, 5),
        "17-wide": partial(pressed, 17),
    },
    "a-noodle-remembers": {
        "": partial(bitten, 20.0, 5.0),
        "2-s": partial(bitten, 20.0, 2.0),
        "10-s": partial(bitten, 20.0, 10.0),
        "firm": partial(bitten, 200.0, 5.0),
    },
    "two-wrong-answers": {"": partial(spawned, broad(5), 0.005)},
    "bones-and-bridges": {
        "": bridge,
        "firm": partial(bridge, right="rigid"),
        "quarter": partial(bridge, 11),
        "bone": partial(bridge, rule="remodelling", most_steps=160),
        "60": partial(bridge, volume=0.6),
        "15": partial(bridge, volume=0.15),
    },
    "how-things-break": {
        "": partial(torn, 2.0),
        "short": partial(torn, 1.0),
        "long": partial(torn, 4.0),
        "whole": partial(torn, 0.0),
        "fine": partial(torn, 2.0, finer=2),
        "fine-whole": partial(torn, 0.0, finer=2),
        "rough": partial(torn, 2.0, scatter=0.7),
    },
    "a-round-hole": {
        "": partial(holed, 0.01, 0.01),
        "upright": partial(holed, 0.015, 0.005),
        "lying": partial(holed, 0.005, 0.015),
        "steps": partial(holed, 0.01, 0.01, cells=40, tolerance=None),
        "steps-fine": partial(holed, 0.01, 0.01, cells=40, tolerance=0.005),
        "more": partial(holed, 0.01, 0.01, tolerance=0.001),
    },
}
"""What is shown, by lesson and page; the nameless page is the lesson's own."""
EVIDENCE: dict[str, dict[str, Run]] = {
    "agents-of-many-sizes": {"sixteenth": partial(spawned, plate(), 0.00125)},
    "two-wrong-answers": {"bar": partial(spawned, bar()), "on": partial(spawned, broad(5), 0.001)},
    "how-things-break": {
        **{f"net-{seed}": partial(torn, 2.0, seed=seed) for seed in (1, 2, 3)},
        **{f"rough-{seed}": partial(torn, 2.0, scatter=0.7, seed=seed) for seed in (1, 2, 3)},
        **{f"fine-{seed}": partial(torn, 2.0, seed=seed, finer=2) for seed in (1, 2, 3)},
        **{f"fine-whole-{seed}": partial(torn, 0.0, seed=seed, finer=2) for seed in (1, 2, 3)},
    },
    "a-round-hole": {
        "steps-larger": partial(holed, 0.01, 0.01, cells=40, tolerance=0.01),
        "steps-tiny": partial(holed, 0.01, 0.01, cells=40, tolerance=0.002),
        "fewer": partial(holed, 0.01, 0.01, tolerance=0.02),
        "coarse": partial(holed, 0.01, 0.01, tolerance=0.1),
    },
}
"""Further runs that a recorded lesson tells of."""


@cache
def run(lesson: str, name: str = "") -> Any:
    """Return a run of a lesson; each is done once."""
    return (PAGES[lesson] | EVIDENCE.get(lesson, {}))[name]()
