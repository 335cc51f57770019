"""A body of squares or cubes in small strain whose cells break.

The rows of its energy are the swelling and the distortions of every cell, and the shear of every
edge between cells. A broken cell keeps so small a share of its stiffness that it bears nothing to
speak of; the edges round it follow it, as their modulus is the harmonic mean of the cells'.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import helmert

from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.staggered import (
    Numbering,
    around_edges,
    axis_pairs,
    edge_modulus,
    strain_matrix,
    strain_vector,
)
from kaju.model.elastic.moduli import strain_of
from kaju.model.results.mesh import corner_order
from kaju.model.scene import Scene

from .weakening import WeakeningBody, measured

BREAKS_CORRECTED = 12
"""Breaks from which new factors cost less than more corrections, of six rows or more each."""

KEPT = 1e-10
"""Share of its stiffness that a broken cell keeps."""

_ROUNDING = 1e-9
"""Share of the largest stress below which a stress is none, but for rounding."""


class BreakingCells(WeakeningBody):
    """The cells of a body that are left, under the whole load (a load factor of 1)."""

    precise = 1e-13
    parted = 1e-6

    def __init__(self, scene: Scene, strengths: Floats, measure: str) -> None:
        if scene.body.gravity is not None:
            raise SceneError(
                "body.gravity: the weight of a body would be scaled with its load; leave it out"
            )
        if scene.outlined:
            raise SceneError("body: cells within true outlines do not break; leave outline out")
        grid = grid_of(scene, None)
        if grid.division > 1:
            raise SceneError(f"body: {grid.notes[0]}; give smaller cells (scene.refine(2))")
        self._problem, self._origin = grid.problem, grid.origin
        problem, self._cell_size = grid.problem, scene.lattice.cell_size
        self.pull = float(np.linalg.norm(scene.applied().force, axis=1).sum())
        moved = [np.linalg.norm(side.displacement or 0.0) for side in scene.sides.values()]
        self.shift = float(max(moved, default=0.0))
        self._strengths = strengths
        known = {"stress": self._by_stress, "strain": self._by_strain, "energy": self._by_energy}
        self._bear = measured(measure, known)

        d, solid = problem.dimension, problem.kinds >= 0
        self._numbering = Numbering(problem.face_states)
        self._kinds = problem.kinds[solid].astype(np.int64)
        self._n = n = len(self._kinds)
        number = np.full(problem.kinds.shape, -1)
        number[solid] = np.arange(n)
        edges = {pair: edge_modulus(problem, pair) for pair in axis_pairs(d)}
        # The four cells round every edge that carries shear, -1 beside the body, shape (4, edges);
        # and the sum of their compliances, by which a broken cell softens the edge.
        around = []
        for pair, modulus in edges.items():
            width = [(1, 1) if axis in pair else (0, 0) for axis in range(d)]
            cells = around_edges(np.pad(number, width, constant_values=-1), pair)
            around.append(np.array([cell[modulus > 0] for cell in cells]))
        self._around: Ints = np.concatenate(around, axis=1)
        self._compliance: Floats = 1.0 / problem.moduli.shear[self._kinds]
        self._total = np.append(self._compliance, 0.0)[self._around].sum(axis=0)

        # Swelling and distortions: their moduli stand alone, those of the stretches do not.
        modes = sp.kron(helmert(d, full=True), sp.eye_array(n), format="csr")
        turn = sp.block_diag([modes, sp.eye_array(len(self._total))], format="csr")
        moduli = problem.moduli
        swelling = (moduli.stretch + (d - 1) * moduli.lateral)[self._kinds]
        distortion = np.tile((moduli.stretch - moduli.lateral)[self._kinds], d - 1)
        shear = [modulus[modulus > 0] for modulus in edges.values()]
        bed = self._numbering.gather(problem.spring)
        beds = sp.diags_array(np.ones(len(bed)), format="csr")[bed > 0.0]
        strain = sp.vstack([turn @ strain_matrix(problem, self._numbering), beds], format="csr")
        unit = problem.scales.energy  # J, of displacements that stay scaled
        stiffness = unit * np.concatenate([swelling, distortion, *shear, bed[bed > 0.0]])
        fixed = turn @ strain_vector(problem, problem.fixed)
        given = np.concatenate([fixed, np.zeros(beds.shape[0])])
        self._unit_stress = problem.scales.stress
        self._tensor = self._to_stress(modes, [len(s) for s in shear]) * (self._unit_stress / unit)
        self._whole = np.ones(n, dtype=bool)
        most = BREAKS_CORRECTED * (d + 4 * len(edges))
        force = unit * self._numbering.gather(problem.force)
        super().__init__(sp.csr_array(strain), stiffness, given, force, most, "MMD_AT_PLUS_A")

    def _to_stress(self, modes: sp.csr_array, counts: list[int]) -> sp.csr_array:
        """Return the matrix from forces of rows to the cells' normal and mean shear stresses."""
        # Each edge gives a quarter of its shear stress to every cell round it.
        edge = np.broadcast_to(np.arange(len(self._total)), self._around.shape)
        pair = np.repeat(np.arange(len(counts)), counts)
        there = self._around >= 0
        row = (self._n * pair + self._around)[there]
        value = np.full(len(row), 0.25)
        shear = sp.csr_array(
            (value, (row, edge[there])), shape=(self._n * len(counts), len(self._total))
        )
        return sp.csr_array(sp.block_diag([modes.T, shear], format="csr"))

    def _stress(self) -> Floats:
        """Return the stress tensors of the cells (Pa), shape (n, d, d)."""
        d = self._problem.dimension
        strained = self._tensor.shape[1]
        force = self.stiffness[:strained] * self.elongation[:strained]
        parts = (self._tensor @ force).reshape(-1, self._n)
        tensor = np.empty((self._n, d, d))
        for axis in range(d):
            tensor[:, axis, axis] = parts[axis]
        for (a, b), shear in zip(axis_pairs(d), parts[d:], strict=True):
            tensor[:, a, b] = tensor[:, b, a] = shear
        return tensor

    def _strain_of(self, stress: Floats) -> Floats:
        scaled = stress / self._problem.scales.modulus
        return strain_of(scaled, self._problem.moduli, self._kinds)

    def _by_stress(self) -> Floats:
        return _largest(self._stress())

    def _by_strain(self) -> Floats:
        return _largest(self._strain_of(self._stress()))

    def _by_energy(self) -> Floats:
        """Return energies (J) of cells that are pulled, so that a load twice as large has twice."""
        stress = self._stress()
        volume = self._cell_size**self._problem.dimension * self._problem.thickness
        energy = 0.5 * volume * np.einsum("nab,nab->n", stress, self._strain_of(stress))
        return np.where(_largest(stress) > 0.0, np.sqrt(self._strengths * energy), 0.0)

    @property
    def shares(self) -> Floats:
        """What the cells bear over what they survive."""
        return np.where(self._whole, self._bear() / self._strengths, 0.0)

    def break_part(self, place: int) -> tuple[int, float]:
        """Break a cell; see `WeakeningBody`."""
        self._whole[place] = False
        self.broken.append(place)
        inner = place + self._n * np.arange(self._problem.dimension)
        edge = np.flatnonzero((self._around == place).any(axis=0))
        rows = self._n * self._problem.dimension + edge
        before = self._total[edge]
        self._total[edge] += (1.0 / KEPT - 1.0) * self._compliance[place]
        left = [KEPT * self.stiffness[inner], self.stiffness[rows] * before / self._total[edge]]
        return place, self.weaken(np.concatenate([inner, rows]), np.concatenate(left))

    def place_of(self, cell: int) -> int:
        """Return the place of a cell among the shares: its number."""
        return cell

    @property
    def points(self) -> tuple[Floats, Ints]:
        """Places of the cells' corners (m), and which of them every cell has."""
        shape = tuple(size + 1 for size in self._problem.shape)
        corner = np.indices(shape).reshape(len(shape), -1).T + np.array(self._origin)
        places: Floats = self._cell_size * corner.astype(np.float64)
        cells = np.argwhere(self._problem.kinds[self._problem.inner] >= 0)
        corners = cells[:, None] + corner_order(len(shape)).astype(np.int64)
        numbers = np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), shape)
        return places, np.asarray(numbers, dtype=np.int64)

    def displacement(self) -> Floats:
        """Return the displacement of the cells' corners (m), shape (n, dimension)."""
        moved = tuple(values.copy() for values in self._problem.fixed)
        self._numbering.scatter(self.solution(), moved)
        nodes = fields.node_displacement(self._problem, moved)
        return self._problem.scales.displacement * np.nan_to_num(nodes.reshape(-1, nodes.shape[-1]))

    def borne(self) -> Floats:
        """Return the largest principal stress of the cells (Pa), none of those that broke."""
        return np.where(self._whole, _largest(self._stress()), 0.0)


def _largest(tensors: Floats) -> Floats:
    """Return the largest principal values of symmetric tensors; what is but rounding is none."""
    if tensors.shape[-1] == 3:
        largest = np.linalg.eigvalsh(tensors)[:, -1]
    else:
        mean = 0.5 * (tensors[:, 0, 0] + tensors[:, 1, 1])
        half = 0.5 * (tensors[:, 0, 0] - tensors[:, 1, 1])
        largest = mean + np.hypot(half, tensors[:, 0, 1])
    return np.where(np.abs(largest) > _ROUNDING * np.abs(tensors).max(), largest, 0.0)
