"""The bodies that are measured: from a plate under a small load to a drawing with no plain side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from kaju import Scene
from kaju.model.validation.graded_elements import singular_points
from kaju.model.validation.scene_elements import surroundings

STEEL = {"material": "steel"}
PLATE = {"thickness": 2e-3, **STEEL}
DISTANCES = 0.5 ** np.arange(1, 12, 2)
"""From singular places, where displacements are compared (cells)."""


@dataclass(frozen=True)
class Case:
    """A body and how finely it is solved.

    Attributes
    ----------
    name, title : str
    scene : Scene
    tolerances : tuple of float
        For spawning, from large to small.
    resolutions : tuple of int
        For equal cells, per cell of the scene.
    elements : int
        Finite elements end before they have more unknowns.
    singular : three tuples of int
        In space, the grid planes with singular edges, along every axis.
    """

    name: str
    title: str
    scene: Scene
    tolerances: tuple[float, ...]
    resolutions: tuple[int, ...]
    elements: int
    singular: tuple[tuple[int, ...], ...] = ()

    @property
    def points(self) -> np.ndarray:
        """Where displacements are compared (m).

        Corners and middles of the body's cells; and points ever closer to every place where
        the solution is singular, or would be if it were not spread: re-entrant corners, ends
        of the ground, ends of loads. There the largest error is.
        """
        kinds, h = surroundings(self.scene), self.scene.lattice.cell_size
        cells = np.argwhere(self.scene.rasterise() >= 0)
        d = cells.shape[1]
        ends = np.stack(np.meshgrid(*[[0, 1]] * d), axis=-1).reshape(-1, d)
        corners = np.unique((cells[:, None] + ends).reshape(-1, d), axis=0)
        singular = singular_points(self.scene, kinds) if d == 2 else _load_corners(self.scene)
        return h * np.concatenate([corners, cells + 0.5, _around(singular, kinds)])


def _load_corners(scene: Scene) -> np.ndarray:
    """Return the corners of loaded faces on top of a block (cells)."""
    applied = scene.applied()
    ends = np.array([[i, j, 1] for i in (0, 1) for j in (0, 1)])
    return np.unique((applied.cells[:, None] + ends).reshape(-1, 3), axis=0)


def _around(places: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """Return points of the body in many directions and at many distances from places (cells)."""
    d = places.shape[1]
    ways = np.stack(np.meshgrid(*[[-1.0, -0.4, 0.0, 0.4, 1.0]] * d), axis=-1).reshape(-1, d)
    steps = np.concatenate([ways * distance for distance in DISTANCES])
    points = (places[:, None] + steps).reshape(-1, d)
    # Those on a surface are of the body if the cell on either side is.
    beside = [np.floor(points + s * 1e-9).astype(int) + 1 for s in (-1, 1)]
    inside = [kinds[tuple(np.clip(c, 0, np.array(kinds.shape) - 1).T)] >= 0 for c in beside]
    whole = np.all((points >= 0) & (points <= np.array(kinds.shape) - 2), axis=1)
    return np.unique(points[(inside[0] | inside[1]) & whole], axis=0)


def pressed(lower, upper, force):
    """Return a force that is spread evenly over a part of a surface."""
    return {"region": {"box": [list(lower), list(upper)]}, "force": list(force)}


def plate(side=1, width=0.02, at=None):
    """Return the worked plate, `side` times as wide and high, under 2 N on a part of its top."""
    size = 0.2 * side
    at = 0.5 * (size - width) if at is None else at
    return Scene(
        body={"size": [size] * 2, "cells": [20 * side] * 2, **PLATE},
        sides={"bottom": "rigid"},
        loads=[pressed((at, size), (at + width, size), (0.0, -2.0))],
    )


def two_loads():
    """Return a plate four times as wide, with a load near either end."""
    return Scene(
        body={"size": [0.8, 0.2], "cells": [80, 20], **PLATE},
        sides={"bottom": "rigid"},
        loads=[
            pressed((0.05, 0.2), (0.06, 0.2), (0.0, -2.0)),
            pressed((0.74, 0.2), (0.75, 0.2), (0.5, -1.0)),
        ],
    )


def l_shape():
    """Return a thick L whose upright arm is dragged aside."""
    return Scene(
        body={"cell_size": 0.1, "drawing": "####....\n" * 4 + "########\n" * 4, "plane": "strain"},
        legend={"#": "steel", ".": "air"},
        sides={"bottom": "rigid"},
        loads=[pressed((0.0, 0.8), (0.4, 0.8), (100.0, 0.0))],
    )


def pierced():
    """Return a plate with a round hole of cells, which stay when they are split."""
    x = (np.arange(32) + 0.5) / 32 - 0.5
    codes = (np.hypot(*np.meshgrid(x, x)) > 0.25).astype(int)
    return Scene.from_array(
        codes,
        legend={0: "air", 1: "steel"},
        cell_size=0.2 / 32,
        thickness=2e-3,
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "pressure": 1e6}],
    )


def drawing():
    """Return a body read from a picture: a lump on two feet with two holes, 48 pixels wide."""
    y, x = (np.mgrid[0:48, 0:48] + 0.5) / 48
    x, y = x - 0.5, 1.0 - y
    turn = np.arctan2(y - 0.5, x)
    edge = 0.36 + 0.05 * np.cos(3 * turn + 0.7) + 0.03 * np.sin(7 * turn) + 0.02 * np.cos(11 * turn)
    body = np.hypot(x, y - 0.5) < edge
    body |= (np.abs(np.abs(x) - 0.22 + 0.12 * y) < 0.09) & (y < 0.4)
    body &= np.hypot(x + 0.12, y - 0.6) > 0.09 + 0.02 * np.cos(5 * turn)
    body &= np.hypot((x - 0.13) / 1.6, y - 0.45) > 0.06
    with TemporaryDirectory() as folder:
        path = Path(folder) / "body.png"
        Image.fromarray(np.where(body, 0, 255).astype(np.uint8)).save(path)
        return Scene.from_image(
            path,
            legend={"black": "steel", "white": "air"},
            cell_size=0.005,
            thickness=2e-3,
            sides={"bottom": "rigid"},
            loads=_on_top(body[::-1].T),
        )


def _on_top(body):
    """Return a force on the highest cells of a picture, at most four beside one another."""
    row = int(np.flatnonzero(body.any(axis=0)).max())
    columns = np.flatnonzero(body[:, row])[:4]
    lower, upper = 0.005 * columns.min(), 0.005 * (columns.max() + 1)
    height = 0.005 * (row + 1)
    return [pressed((lower, height), (upper, height), (0.3, -2.0))]


def block(cells=16, patch=1):
    """Return a quarter of a cube, clamped below, under a small square in the middle of its top.

    The cube's edge is 1 m, its quarter stands on rollers where it was cut. `cells` are those
    along its height, the load is on `patch` × `patch` of them.
    """
    width = patch / cells
    return Scene(
        body={"cells": [cells // 2, cells // 2, cells], "cell_size": 1.0 / cells, **STEEL},
        sides={"bottom": "rigid", "left": "roller", "front": "roller"},
        loads=[pressed((0.0, 0.0, 1.0), (width, width, 1.0), (0.0, 0.0, -1.0))],
    )


def cases():
    """Return all cases by name."""
    found = [
        Case("plate", "plate, 20 mm loaded", plate(), FALL, (1, 2, 4, 8, 16, 32, 64), 300_000),
        Case(
            "off-centre",
            "plate, 10 mm loaded off centre",
            plate(width=0.01, at=0.04),
            FALL,
            (1, 2, 4, 8, 16, 32, 64),
            300_000,
        ),
        Case(
            "two-loads", "long plate, two loads", two_loads(), FALL, (1, 2, 4, 8, 16, 32), 300_000
        ),
        Case("L", "L-shaped body", l_shape(), FALL, (1, 2, 4, 8, 16, 32, 64, 128), 300_000),
        Case("hole", "plate with a hole", pierced(), FALL, (1, 2, 4, 8, 16), 300_000),
        Case("drawing", "body from a picture", drawing(), FALL, (1, 2, 4, 8, 16), 300_000),
        Case(
            "block",
            "block, small patch loaded",
            block(),
            (0.4, 0.3, 0.2, 0.15, 0.1, 0.07),
            (1, 2, 4, 8),
            150_000,
            ((1, 8), (1, 8), (0, 16)),
        ),
    ]
    return {case.name: case for case in found}


FALL = (0.2, 0.1, 0.05, 0.025, 0.0125)
