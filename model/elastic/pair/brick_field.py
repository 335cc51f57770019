"""What bricks have found: displacement, stress and its estimated error, reactions.

The error is that of the stress against its own mean at the corners (Zienkiewicz and Zhu, *Int. J.
Numer. Methods Eng.* 24, 1987), continued from the points where it is most accurate (Barlow 1976).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import Moduli, von_mises
from kaju.model.elastic.pair import bricks
from kaju.model.elastic.pair.brick_levels import BrickLevel
from kaju.model.scene.cell_types import INSIDE

NO_BOUND = "in space errors are estimated, not proved"


class BrickField:
    """The displacement of one generation, and what is read off it; scaled.

    `beside` is a stress that the displacement's has to meet, shape (leaves, 6): what is left of
    both hands on forces from leaf to leaf.
    """

    def __init__(
        self, level: BrickLevel, moduli: Moduli, master: Floats, beside: Floats | None = None
    ) -> None:
        self.level, self.mesh, self.moduli, self.beside = level, level.mesh, moduli, beside
        self.master = master
        self.moved = level.gathered(master)  # Less the common shift. Shape (leaves, 20, 3)

    @cached_property
    def force(self) -> Floats:
        """Forces on the nodes of leaves. Shape (leaves, 20, 3)."""
        return self.level.force(self.moved)

    def energy(self, work: float) -> float:
        """Return the strain energy, by the loads' work where that is the more accurate.

        Where no side is moved, work less energy is off by the square of what the iteration left.
        """
        own = 0.5 * float(np.vdot(self.moved, self.force))
        return own if self.mesh.given.any() else work - own

    def stresses(self, places: Floats) -> Floats:
        """Return the stresses at places from 0 to 1 in all leaves, shape (leaves, n, 6)."""
        strain = np.einsum(
            "pai,ni->npa", bricks.strain_rows(places), self.moved.reshape(-1, 60), optimize=True
        )
        strain /= self.mesh.edge[:, None, None]
        kind = self.mesh.leaves.kind
        lateral, shear = self.moduli.lateral[kind, None], self.moduli.shear[kind, None]
        volume = lateral * strain[..., :3].sum(axis=2)
        strain *= shear[..., None]
        strain[..., :3] *= 2.0
        strain[..., :3] += volume[..., None]
        return np.asarray(strain if self.beside is None else strain - self.beside[:, None])

    def equivalent(self) -> Floats:
        """Return the equivalent stress in the middle of every leaf."""
        middles = np.arange(len(self.moved)), np.full((len(self.moved), 3), 0.5)
        return von_mises(self.stress_at(*middles))

    @cached_property
    def corner_stress(self) -> Floats:
        """Stress at the corners of leaves: the mean of those of one material round each.

        Shape (leaves, 8, 6).
        """
        points, _ = bricks.gauss(2)
        own = np.einsum("cg,nga->nca", bricks.from_gauss(), self.stresses(points))
        at = self._corners[1]
        count = np.bincount(at.ravel())
        total = [np.bincount(at.ravel(), own[..., a].ravel()) / count for a in range(6)]
        return np.asarray(np.stack(total, axis=1)[at])

    @cached_property
    def _corners(self) -> tuple[Ints, Ints]:
        """Vertices with a material each (as a number), and which of these leaves have."""
        kinds = int(self.mesh.leaves.kind.max()) + 1
        key = self.mesh.vertex * kinds + self.mesh.leaves.kind[:, None]
        found, at = np.unique(key, return_inverse=True)
        return found, at.reshape(key.shape)

    @cached_property
    def _read_stress(self) -> Floats:
        """The same, but that hanging corners take what the large leaf has there: without jumps."""
        mesh, (key, at), found = self.mesh, self._corners, self.corner_stress
        kind, kinds = mesh.leaves.kind, int(mesh.leaves.kind.max()) + 1
        value = np.zeros((len(key), 6))
        value[at] = found
        vertex, owner = mesh.hanging
        row = np.searchsorted(key, vertex * kinds + kind[owner])
        inside = (mesh.place[vertex] - mesh.leaves.lower[owner]) / mesh.leaves.size[owner, None]
        weight = bricks.trilinear(np.asarray(inside, dtype=np.float64))
        # The corners of a leaf may hang themselves, on larger ones.
        for size in np.unique(mesh.leaves.size[owner])[::-1]:
            own = mesh.leaves.size[owner] == size
            own &= (row < len(key)) & (key[np.minimum(row, len(key) - 1)] // kinds == vertex)
            value[row[own]] = np.einsum("nc,nca->na", weight[own], value[at[owner[own]]])
        return np.asarray(value[at])

    @cached_property
    def shares(self) -> Floats:
        """Estimated squared error of every leaf in the energy norm."""
        points, weights = bricks.gauss(3)
        off = np.einsum("gc,nca->nga", bricks.trilinear(points), self.corner_stress)
        off -= self.stresses(points)
        kind = self.mesh.leaves.kind
        lateral, shear = self.moduli.lateral[kind, None], self.moduli.shear[kind, None]
        square = (off[..., :3] ** 2).sum(axis=2) + 2.0 * (off[..., 3:] ** 2).sum(axis=2)
        trace = off[..., :3].sum(axis=2)
        density = (square - lateral / (3.0 * lateral + 2.0 * shear) * trace**2) / (2.0 * shear)
        return np.asarray((density @ weights) * self.mesh.edge**3)

    def displacement_at(self, leaf: Ints, inside: Floats) -> Floats:
        """Return the displacement at places from 0 to 1 in leaves."""
        found = np.einsum("nk,nka->na", bricks.values(inside), self.moved[leaf])
        return np.asarray(found + self.mesh.shift)

    def stress_at(self, leaf: Ints, inside: Floats) -> Floats:
        """Return stress tensors at places from 0 to 1 in leaves."""
        return tensors(np.einsum("nc,nca->na", bricks.trilinear(inside), self._read_stress[leaf]))

    def reactions(self, load: Floats) -> dict[str, Floats]:
        """Return the force of every support on the body, by the loads on the masters."""
        mesh, names = self.mesh, self.mesh.ground.scene.lattice.sides
        # What several sides hold together each of them holds to the same share.
        holders = np.zeros((len(load), 3))
        for holder in mesh.holders:
            holders[holder.masters, holder.axis] += 1.0
        pull = np.where(holders > 0.0, self.level.summed(self.force) - load, 0.0)
        pull /= np.maximum(holders, 1.0)
        found: dict[str, Floats] = {}
        for holder in mesh.holders:
            name = INSIDE if holder.number < 0 else names[holder.number]
            total = found.setdefault(name, np.zeros(3))
            # A shift of a side moves its corners, and leaves the bulges at 0.
            total[holder.axis] += pull[holder.masters & mesh.at_corner, holder.axis].sum()
        for leaf, side, area in self.level.beds:
            axis = side // 2
            given = self.moved[leaf, :, axis] @ bricks.side_loads()[side, 0]
            found.setdefault(names[side], np.zeros(3))[axis] -= float(area[:, 0] @ given)
        return found


def tensors(six: Floats) -> Floats:
    """Return stresses of six numbers as tensors, shape (n, 3, 3)."""
    return np.asarray(six[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]])
