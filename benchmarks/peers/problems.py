"""The bodies that are benchmarked: what is asked, at any resolution, and the true answer.

All of them are pictures of square or cubic cells that stand on rigid ground and are pressed
on part of their top. The true displacements were computed by finite elements of high order on
meshes graded towards every corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kaju import Scene
from kaju.arrays import Flags, Floats
from kaju.model.study.reference import Reference

_PIXELS = """
....................
...##############...
..################..
..################..
.########....######.
.#######......#####.
.######........####.
.######........####.
.######........####.
.#######......####..
..########....####..
..###############...
..##############....
.######..#######....
.#####....#######...
.####......#######..
.####......########.
######......########
######......########
######......########
"""


@dataclass(frozen=True, eq=False)
class Problem:
    """A body of cells on rigid ground, pressed on part of its top."""

    name: str
    picture: Flags  # Which cells are material, indexed [x, y(, z)]
    edge: float  # Edge of the picture's cells (m)
    youngs_modulus: float  # (Pa)
    poissons_ratio: float
    thickness: float  # (m), of plane bodies
    patch: tuple[tuple[float, ...], tuple[float, ...]]
    """Lower and upper corner (m) of the loaded part of the top."""
    force: float  # Total force (N), downwards

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.picture.ndim

    @property
    def points(self) -> Floats:
        """Middles of the picture's cells (m): off corners, where no grid converges quickly."""
        return np.asarray(self.edge * (np.argwhere(self.picture) + 0.5))

    def scene(self, division: int) -> Scene:
        """Return the body with every cell of the picture split `division` times per axis."""
        top = [0.0] * (self.dimension - 1) + [-self.force]
        body: dict[str, object] = {"thickness": self.thickness} if self.dimension == 2 else {}
        described = {
            "materials": {
                "solid": {
                    "youngs_modulus": self.youngs_modulus,
                    "poissons_ratio": self.poissons_ratio,
                }
            },
            "sides": {"bottom": "rigid"},
            "loads": [{"region": {"box": [list(p) for p in self.patch]}, "force": top}],
        }
        if self.picture.all():
            body |= {
                "cells": [division * n for n in self.picture.shape],
                "cell_size": self.edge / division,
                "material": "solid",
            }
            return Scene(body=body, **described)
        return Scene.from_array(
            self.split(division).astype(np.int64),
            legend={0: "air", 1: "solid"},
            cell_size=self.edge / division,
            **body,
            **described,
        )

    def split(self, division: int) -> Flags:
        """Return the picture with every cell split `division` times per axis."""
        return np.kron(self.picture, np.ones((division,) * self.dimension, dtype=np.bool_))

    @property
    def lame(self) -> tuple[float, float]:
        """Both moduli of Lamé (Pa), in the plane those of plane stress times the thickness."""
        shear = self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))
        ratio = self.poissons_ratio
        if self.dimension == 2:
            return 2.0 * shear * ratio / (1.0 - ratio) * self.thickness, shear * self.thickness
        return 2.0 * shear * ratio / (1.0 - 2.0 * ratio), shear

    def pressed(self, middles: Floats, size: float) -> Flags:
        """Tell which cells of a `size`, or facets (0), lie below the load, by their middles (m)."""
        lower, upper = np.array(self.patch)
        near = 1e-9 * self.edge
        across = (middles[:, :-1] > lower[:-1] - near) & (middles[:, :-1] < upper[:-1] + near)
        at_top = np.abs(middles[:, -1] + 0.5 * size - lower[-1]) < near
        return np.asarray(across.all(axis=1) & at_top)

    def truth(self) -> Reference:
        """Return the true displacements at `points`."""
        return Reference.load(Path(__file__).with_name(f"truth_{self.name}.npz"))

    def error(self, displacement: Floats) -> tuple[float, float]:
        """Return the largest and the r.m.s. error of displacements, as shares of the largest."""
        truth = self.truth().displacement_at(self.points)
        size = np.linalg.norm(truth, axis=1).max()
        away = np.linalg.norm(displacement - truth, axis=1) / size
        return float(away.max()), float(np.sqrt(np.mean(away**2)))


PLATE = Problem(
    name="plate",
    picture=np.ones((20, 20), dtype=np.bool_),
    edge=0.01,
    youngs_modulus=206e9,
    poissons_ratio=0.3,
    thickness=0.002,
    patch=((0.09, 0.2), (0.11, 0.2)),
    force=2.0,
)
BLOCK = Problem(
    name="block",
    picture=np.ones((8, 8, 8), dtype=np.bool_),
    edge=0.125,
    youngs_modulus=1.0,
    poissons_ratio=0.3,
    thickness=1.0,
    patch=((0.375, 0.375, 1.0), (0.625, 0.625, 1.0)),
    force=1.0,
)
PIXELS = Problem(
    name="pixels",
    picture=np.array([[letter == "#" for letter in row] for row in _PIXELS.split()[::-1]]).T,
    edge=0.01,
    youngs_modulus=206e9,
    poissons_ratio=0.3,
    thickness=0.002,
    patch=((0.08, 0.19), (0.12, 0.19)),
    force=2.0,
)
PROBLEMS = {problem.name: problem for problem in (PLATE, BLOCK, PIXELS)}
