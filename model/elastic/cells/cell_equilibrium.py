"""Equilibrium on a composite grid: stiffness BᵀDB, loads, energy, reactions."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.cells.composite_grid import CompositeGrid, sum_rows
from kaju.model.elastic.cells.leaf_loads import FaceLoads, face_loads
from kaju.model.elastic.equal.krylov import dot
from kaju.model.elastic.equal.problem import ACTIVE, FIXED
from kaju.model.elastic.moduli import Moduli, normal_stress
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import INSIDE


class Equilibrium:
    """Energy and forces of a composite grid, as matrices; all scaled.

    `strains` is the strain matrix B: rows are the normal strains of the leaves, axis by axis, then
    the shear strains of the edges, pair by pair. `offset` are the strains by displaced walls alone.
    """

    def __init__(self, grid: CompositeGrid) -> None:
        self.grid = grid
        n, d = len(grid.leaves), grid.dimension
        sides = np.arange(n) * 2 * d
        # Sides of leaves are numbered leaf by leaf, lower and upper one of each axis.
        stretches = []
        for axis in range(d):
            ends = np.stack([sides + 2 * axis, sides + 2 * axis + 1], axis=1)
            stretches.append(
                sum_rows(grid.mean, ends, np.array([-1.0, 1.0]) / grid.length[:, None])
            )
        shears, constants = [], [np.zeros(n * d)]
        for edges in grid.edges.values():
            first, second = edges.gradients
            both = sp.vstack([first.matrix, second.matrix], format="csr")
            stiff, each = edges.modulus > 0, np.arange(len(edges.modulus))
            pair = np.stack([each, each + len(each)], axis=1)
            shears.append(sum_rows(both, pair, np.repeat(stiff[:, None], 2, axis=1).astype(float)))
            constants.append(np.where(stiff, first.constant + second.constant, 0.0))
        self.strains = sp.csr_array(sp.vstack([*stretches, *shears], format="csr"))
        self.offset = np.concatenate(constants)

    @cached_property
    def entered(self) -> FaceLoads:
        """The scene's loads on faces, walls and edges."""
        return face_loads(self.grid)

    @property
    def load(self) -> Floats:
        """External force on every face."""
        return self.entered.face

    def loaded_by(self, ground: PosedBody) -> Equilibrium:
        """Return the same grid and matrices under the loads of another posed body."""
        twin = copy(self)
        twin.grid = copy(self.grid)
        twin.grid.ground = ground
        twin.__dict__.pop("entered", None)
        return twin

    @cached_property
    def _moduli(self) -> Moduli:
        """Moduli times volumes: of the leaves' normal strains, and of the edges' shear strains."""
        grid = self.grid
        volume = grid.length**grid.dimension
        shear = np.concatenate([e.modulus * e.weight for e in grid.edges.values()])
        return Moduli(volume * grid.law.stretch, volume * grid.law.lateral, shear)

    def stress(self, strain: Floats) -> Floats:
        """Return the stresses times volumes, D times the strains."""
        law = self._moduli
        sides = self.grid.dimension * len(law.stretch)
        normal = normal_stress(law, strain[:sides].reshape(-1, len(law.stretch)))
        return np.concatenate([normal.ravel(), law.shear * strain[sides:]])

    def stiffness(self, faces: Ints | None = None) -> sp.csr_array:
        """Return the stiffness matrix BᵀDB of some faces, by default of all: symmetric."""
        faces = np.arange(self.grid.size) if faces is None else faces
        along, cross, shear = self._moduli
        n, d = len(along), self.grid.dimension
        own = self.strains if len(faces) == self.grid.size else self.strains[:, faces]
        stretches = [own[axis * n : (axis + 1) * n] for axis in range(d)]
        # Normal stresses are (c11 - c12) times their own strain and c12 times the change of volume.
        rows = sp.csr_array(sp.vstack([own, sum(stretches[1:], start=stretches[0])], format="csr"))
        modulus = np.concatenate([*[along - cross] * d, shear, cross])
        stress = sp.csr_array(
            (rows.data * np.repeat(modulus, np.diff(rows.indptr)), rows.indices, rows.indptr),
            shape=rows.shape,
        )
        matrix = sp.csr_array(rows.T.tocsr() @ stress)
        foundation = self.grid.spring[faces]
        return sp.csr_array(matrix + sp.diags_array(foundation)) if foundation.any() else matrix

    @cached_property
    def free(self) -> Ints:
        """Faces that are free to move."""
        return np.flatnonzero(self.grid.state == ACTIVE)

    @cached_property
    def pull(self) -> Floats:
        """Lift: the force on every face by the prescribed displacements alone."""
        grid = self.grid
        if not grid.value.any() and not self.offset.any():
            return np.zeros(grid.size)
        return np.asarray(self.strains.T @ self.stress(self.strain(grid.value)))

    def strain(self, displacement: Floats) -> Floats:
        """Return the strains at a displacement."""
        return np.asarray(self.strains @ displacement + self.offset)

    def force(self, displacement: Floats) -> Floats:
        """Return the external force on every face that balances a displacement."""
        stress = self.stress(self.strain(displacement))
        return np.asarray(self.strains.T @ stress + self.grid.spring * displacement)

    def energy(self, displacement: Floats) -> float:
        """Return the energy stored in body and foundation."""
        strain = self.strain(displacement)
        foundation = float(dot(self.grid.spring, displacement**2))
        return 0.5 * (float(dot(strain, self.stress(strain))) + foundation)

    def reactions(self, displacement: Floats, own: Flags | None = None) -> dict[str, Floats]:
        """Return the force of every support on the body, or on its part of the `own` leaves."""
        grid, d = self.grid, self.grid.dimension
        own = np.ones(len(grid.leaves), dtype=np.bool_) if own is None else own
        names = [*grid.ground.scene.lattice.sides, INSIDE]
        totals = -self.entered.wall
        touched = np.asarray(totals.any(axis=1))
        fixed = grid.state == FIXED
        hold = np.where(fixed, self.force(displacement) - self.load, -grid.spring * displacement)
        some = (grid.support >= 0) & own[grid.owner]
        np.add.at(totals, (grid.support[some], grid.axis[some]), hold[some])
        touched[grid.support[some]] = True
        # Walls also take the shear of edges on them: the rows of the edges follow those of leaves.
        stress = self.stress(self.strain(displacement))
        start = len(grid.leaves) * d
        for pair, edges in grid.edges.items():
            shear = stress[start : start + len(edges.modulus)]
            start += len(edges.modulus)
            counts = np.zeros(len(shear), dtype=np.bool_)
            counts[edges.of_leaf[own]] = True
            for a, gradient in zip(pair, edges.gradients, strict=True):
                wall = (gradient.wall >= 0) & counts
                np.add.at(totals[:, a], gradient.wall[wall], (gradient.pull * shear)[wall])
                touched[gradient.wall[wall]] = True
        return {name: totals[i] for i, name in enumerate(names) if touched[i]}
