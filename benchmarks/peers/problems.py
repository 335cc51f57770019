"""The bodies that are benchmarked: what is asked, at any resolution, and the true answer.

All of them are pictures of square or cubic cells that stand on rigid ground and are pressed
on part of their top. The true displacements were computed by finite elements of high order on
meshes graded towards every corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    """A body of cells on rigid ground, pressed on part of its top: of steel unless told."""

    name: str
    picture: Flags  # Which cells are material, indexed [x, y(, z)]
    patch: tuple[tuple[float, ...], tuple[float, ...]]
    """Lower and upper corner (m) of the loaded part of the top."""
    edge: float = 0.01  # Edge of the picture's cells (m)
    youngs_modulus: float = 206e9  # (Pa)
    poissons_ratio: float = 0.3
    thickness: float = 0.002  # (m), of plane bodies
    force: float = 2.0  # Total force (N), downwards

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
        body: dict[str, Any] = {"cell_size": self.edge / division}
        body |= {"thickness": self.thickness} if self.dimension == 2 else {}
        law = {"youngs_modulus": self.youngs_modulus, "poissons_ratio": self.poissons_ratio}
        described = {
            "materials": {"solid": law},
            "sides": {"bottom": "rigid"},
            "loads": [{"region": {"box": [list(p) for p in self.patch]}, "force": top}],
        }
        if self.picture.all():
            body |= {"cells": [division * n for n in self.picture.shape], "material": "solid"}
            return Scene(body=body, **described)
        codes = self.split(division).astype(np.int64)
        return Scene.from_array(codes, legend={0: "air", 1: "solid"}, **body, **described)

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


PLATE = Problem("plate", np.ones((20, 20), dtype=np.bool_), patch=((0.09, 0.2), (0.11, 0.2)))
BLOCK = Problem(
    name="block",
    picture=np.ones((8, 8, 8), dtype=np.bool_),
    patch=((0.375, 0.375, 1.0), (0.625, 0.625, 1.0)),
    edge=0.125,
    youngs_modulus=1.0,
    thickness=1.0,
    force=1.0,
)
_LETTERS = np.array([list(row) for row in _PIXELS.split()[::-1]]).T
PIXELS = Problem("pixels", _LETTERS == "#", patch=((0.08, 0.19), (0.12, 0.19)))
PROBLEMS = {problem.name: problem for problem in (PLATE, BLOCK, PIXELS)}
