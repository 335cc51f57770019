"""The balance of forces on composite faces: stiffness, loads, and what supports take."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from kaju.model.elasticity.problem import ACTIVE, FIXED
from kaju.model.elasticity.reactions import INSIDE
from kaju.model.scene.kinds import AIR, FOUNDATION, ROLLER

from .composite import Composite, Floats
from .edges import Edges
from .field import oriented
from .ground import LeafForces
from .leaves import Flags, Index


class Balance:
    """Energy and forces of a composite grid, as matrices; all scaled.

    Attributes
    ----------
    grid : Composite
    strains : sparse array
        Strains of the leaves, axis by axis, then of the edges, pair by pair, by the faces.
    offset : array
        The strains that displaced walls cause by themselves.
    load : array, shape (faces,)
        External force on every face.
    surface_shear : dict from pair of axes to array
        Shear stress that loads along the surface put on the edges.
    """

    def __init__(self, grid: Composite) -> None:
        self.grid = grid
        n, d = len(grid.leaves), grid.dimension
        sides = np.arange(n) * 2 * d
        stretches = []
        for axis in range(d):
            difference = grid.mean[sides + 2 * axis + 1] - grid.mean[sides + 2 * axis]
            stretches.append(sp.diags_array(1.0 / grid.length) @ difference)
        shears, constants = [], [np.zeros(n * d)]
        for edges in grid.edges.values():
            first, second = edges.gradients
            stiff = sp.diags_array((edges.modulus > 0).astype(np.float64))
            shears.append(stiff @ (first.matrix + second.matrix))
            constants.append(np.where(edges.modulus > 0, first.constant + second.constant, 0.0))
        self.strains = sp.csr_array(sp.vstack([*stretches, *shears], format="csr"))
        self.offset = np.concatenate(constants)
        self.surface_shear = {p: np.zeros(len(e.modulus)) for p, e in grid.edges.items()}
        self.load = self._loads(grid.ground.forces(grid.leaves))

    @cached_property
    def law(self) -> sp.csr_array:
        """Stresses times volumes by strains."""
        grid, d = self.grid, self.grid.dimension
        moduli, kind = grid.ground.moduli, grid.leaves.kind
        volume = grid.length**d
        along = sp.diags_array(volume * moduli.stretch[kind])
        cross = sp.diags_array(volume * moduli.lateral[kind])
        blocks = [[along if a == b else cross for b in range(d)] for a in range(d)]
        shear = np.concatenate([e.modulus * e.weight for e in grid.edges.values()])
        return sp.csr_array(
            sp.block_diag([sp.block_array(blocks), sp.diags_array(shear)], format="csr")
        )

    @cached_property
    def stiffness(self) -> sp.csr_array:
        """Force on every face by displacements of the faces: symmetric."""
        matrix = self.strains.T @ (self.law @ self.strains)
        return sp.csr_array(matrix + sp.diags_array(self.grid.spring))

    @cached_property
    def free(self) -> Index:
        """Faces that are free to move."""
        return np.flatnonzero(self.grid.state == ACTIVE)

    @cached_property
    def pull(self) -> Floats:
        """Force that holds every face while the free ones rest."""
        grid = self.grid
        if not grid.value.any() and not self.offset.any():
            return np.zeros(grid.size)
        given = self.strains @ grid.value + self.offset
        return np.asarray(self.strains.T @ (self.law @ given))

    @cached_property
    def given_energy(self) -> float:
        """Twice the energy stored while the free faces rest."""
        given = self.strains @ self.grid.value + self.offset
        return float(given @ (self.law @ given))

    def force(self, displacement: Floats) -> Floats:
        """Return the force that holds every face at a displacement."""
        stress = self.law @ (self.strains @ displacement + self.offset)
        return np.asarray(self.strains.T @ stress + self.grid.spring * displacement)

    def energy(self, displacement: Floats) -> float:
        """Return the energy stored in body and foundation."""
        strain = self.strains @ displacement + self.offset
        bed = float(self.grid.spring @ displacement**2)
        return 0.5 * (float(strain @ (self.law @ strain)) + bed)

    def reactions(self, displacement: Floats) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        grid, d = self.grid, self.grid.dimension
        names = [*grid.ground.scene.lattice.sides, INSIDE]
        totals = np.zeros((2 * d + 1, d))
        touched = np.zeros(2 * d + 1, dtype=np.bool_)
        held = grid.state == FIXED
        hold = np.where(held, self.force(displacement) - self.load, -grid.spring * displacement)
        some = grid.support >= 0
        np.add.at(totals, (grid.support[some], grid.axis[some]), hold[some])
        touched[grid.support[some]] = True
        stress = self.law @ (self.strains @ displacement + self.offset)
        start = len(grid.leaves) * d
        for pair, edges in grid.edges.items():
            shear = stress[start : start + len(edges.modulus)]
            start += len(edges.modulus)
            for a, gradient in zip(pair, edges.gradients, strict=True):
                wall = gradient.wall >= 0
                np.add.at(totals[:, a], gradient.wall[wall], (gradient.pull * shear)[wall])
                touched[gradient.wall[wall]] = True
        return {name: totals[i] for i, name in enumerate(names) if touched[i]}

    def _loads(self, forces: LeafForces) -> Floats:
        """Enter forces into faces; see `kaju.model.elasticity.loads`."""
        grid, d = self.grid, self.grid.dimension
        share = np.zeros(len(grid.leaves) * 2 * d)
        couple = np.zeros(grid.size)
        leaf, way = forces.leaf, forces.direction
        for axis in range(d):
            value = forces.force[:, axis]
            middle = (way < 0) & (value != 0)
            normal = (way >= 0) & (way // 2 == axis) & (value != 0)
            along = (value != 0) & ~middle & ~normal
            for end in (0, 1):
                np.add.at(share, leaf[middle] * 2 * d + 2 * axis + end, 0.5 * value[middle])
            np.add.at(share, leaf[normal] * 2 * d + way[normal], value[normal])
            for side in np.unique(way[along]):
                here = along & (way == side)
                couple += self._drag(share, axis, int(side), leaf[here], value[here])
        return np.asarray(grid.mean.T @ share + couple)

    def _drag(self, share: Floats, axis: int, side: int, leaf: Index, value: Floats) -> Floats:
        """Enter forces along `axis` by the side `side`: a drag and, on a surface, a couple."""
        grid, d = self.grid, self.grid.dimension
        normal, upper = divmod(side, 2)
        beyond = grid.beside[leaf, side]
        bare = beyond < 0
        kind = np.full(len(leaf), 0)
        kind[bare] = grid.ground.kinds_at(grid.beyond(side, leaf[bare]))
        surface = np.isin(kind, (AIR, ROLLER, FOUNDATION)) & bare
        for end in (0, 1):
            whole = np.where(bare, 0.5, 0.25) * value
            np.add.at(share, leaf * 2 * d + 2 * axis + end, whole)
            np.add.at(share, beyond[~bare] * 2 * d + 2 * axis + end, 0.25 * value[~bare])
        pair = (min(axis, normal), max(axis, normal))
        edges, taken = grid.edges[pair], leaf[surface]
        turned = oriented(edges, axis == pair[0])[1]
        outward = (2.0 * upper - 1.0) * value[surface]
        stress = 0.5 * outward / grid.length[taken] ** (d - 1)
        np.add.at(self.surface_shear[pair], turned[taken, :, upper], stress[:, None])
        moment = 0.5 * grid.length[taken] * outward
        return _couple(edges, (axis == pair[0], upper), taken, moment)


def _couple(edges: Edges, place: tuple[bool, int], leaf: Index, moment: Floats) -> Floats:
    """Return the couples of tractions: the surface moves by more than the leaf's middle.

    By (h/2)·∂u_a/∂n outwards, which is −(h/2)·∂u_n/∂a beside a known shear strain. Where no
    surface lies beside, ∂u_a/∂n is taken from the inner edges.
    """
    first, upper = place
    (slope, tilt), turned = oriented(edges, first)  # of u_a along the normal, of u_n along a
    outer, inner = turned[leaf, :, upper], turned[leaf, :, 1 - upper]
    tilts: Flags = np.logical_and(tilt.valid[outer], tilt.wall[outer] < 0)
    slopes = slope.valid[inner] & (tilts.sum(axis=1) == 0)[:, None]
    total = np.zeros(slope.matrix.shape[1])
    for gradient, edge, some, sign in ((tilt, outer, tilts, -1.0), (slope, inner, slopes, 1.0)):
        share = some / np.maximum(some.sum(axis=1), 1)[:, None]
        weight = np.zeros(len(edges.modulus))
        np.add.at(weight, edge, sign * moment[:, None] * share)
        total += gradient.matrix.T @ weight
    return total
