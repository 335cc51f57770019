"""The rule of load transfer as tables, read by both engines and by the certificate."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kaju.agents.rules import Emission, PrescribedRule, Shares
from kaju.errors import SceneError
from kaju.model.scene.kinds import AIR, RIGID, ROLLER

if TYPE_CHECKING:
    from kaju.model.scene import Scene
    from kaju.model.scene.lattice import Lattice

BOUNDARY_NAMES = {AIR: "free", RIGID: "rigid", ROLLER: "roller"}


class Transfer:
    """Who passes how much to whom: the prescribed rule on a scene's lattice.

    Parameters
    ----------
    scene : Scene
        A scene whose rule is a `PrescribedRule`.

    Raises
    ------
    SceneError
        If a side of the scene asks for something that only the elastic rule can do.
    """

    def __init__(self, scene: Scene) -> None:
        if not isinstance(scene.rule, PrescribedRule):
            raise SceneError(
                "rule.kind: LoadModel passes loads on by a prescribed rule, "
                f'got {scene.rule.kind!r}; set kind = "prescribed", or take ElasticModel'
            )
        self.lattice: Lattice = scene.lattice
        self.rule = scene.rule
        self.materials = scene.cell_materials
        _refuse_elastic_sides(scene)
        self.shares: tuple[Shares, ...] = tuple(
            self.rule.shares(material, self.lattice.dimension) for material in self.materials
        )

    def emissions(self, shares: Shares, direction: int) -> tuple[Emission, ...]:
        """Return what a load along `direction` sends out of an agent with these shares."""
        lattice = self.lattice
        return shares.emissions(
            direction, int(lattice.opposite[direction]), lattice.beside[direction]
        )

    @cached_property
    def tables(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Arm, direction and share of every emission, each (materials, directions, most).

        Rows with fewer emissions are filled up with shares of 0.
        """
        directions = range(self.lattice.directions)
        rows = [[self.emissions(shares, d) for d in directions] for shares in self.shares]
        most = max(1, *(len(row) for material in rows for row in material))
        filler = Emission(0, 0, 0.0)
        full = np.array(
            [[[*row, *[filler] * (most - len(row))] for row in material] for material in rows]
        ).reshape(len(rows), len(directions), most, 3)
        return full[..., 0].astype(np.int64), full[..., 1].astype(np.int64), full[..., 2]

    @cached_property
    def emitted(self) -> NDArray[np.float64]:
        """Sum of the emitted shares per material: by how much loads grow in a generation."""
        total: NDArray[np.float64] = self.tables[2].sum(axis=2).max(axis=1)
        return total

    @cached_property
    def own(self) -> NDArray[np.float64]:
        """Share kept, per material."""
        return np.array([shares.own for shares in self.shares])

    @cached_property
    def turned(self) -> dict[int, NDArray[np.int64]]:
        """For each kind of boundary: where a load along d that came over arm a points next."""
        every = np.arange(self.lattice.directions)
        return {
            AIR: np.tile(every, (len(every), 1)),
            RIGID: np.tile(self.lattice.opposite, (len(every), 1)),
            ROLLER: self.lattice.mirrored,
        }


def split_force(
    lattice: Lattice, force: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Split forces into loads along the directions of the lattice.

    Across squares and cubes a force splits into its components; across hexagons into its
    parts along the two face normals that it lies between.

    Parameters
    ----------
    force : array, shape (n, dimension)
        Forces (N).

    Returns
    -------
    row, direction, magnitude : arrays
        Which force, which direction, and the load along it (N), all above 0.
    """
    magnitude = np.zeros((len(force), lattice.directions))
    if lattice.kind == "hexagon":
        angle = np.arctan2(force[:, 1], force[:, 0]) % (2.0 * np.pi)
        sector = np.minimum((angle / (np.pi / 3.0)).astype(np.int64), 5)
        rest = angle - sector * (np.pi / 3.0)
        size = np.hypot(force[:, 0], force[:, 1]) / np.sin(np.pi / 3.0)
        rows = np.arange(len(force))
        magnitude[rows, sector] = size * np.sin(np.pi / 3.0 - rest)
        magnitude[rows, (sector + 1) % 6] = size * np.sin(rest)
    else:
        magnitude[:, 0::2] = np.maximum(-force, 0.0)
        magnitude[:, 1::2] = np.maximum(force, 0.0)
    row, direction = np.nonzero(magnitude)
    return row, direction, magnitude[row, direction]


def _refuse_elastic_sides(scene: Scene) -> None:
    for side in scene.lattice.sides:
        kind = scene.side_condition(side).kind
        if kind not in ("free", "rigid", "roller"):
            raise SceneError(
                f"sides.{side}: a {kind} side needs the elastic rule; the prescribed rule knows "
                "free, rigid and roller"
            )
