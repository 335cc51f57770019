"""Linear bodies in small strain whose parts break: springs of a network, or cells.

Every strain is a *row*: K = Bᵀ k B with a stiffness k for every row of B. With factors of K at
hand, K + V d Vᵀ (a column of V and a loss d < 0 of stiffness for every weakened row) is solved by
putting the lost forces back as loads: u = u₀ − K⁻¹V d e, where the elongations e of those rows
solve (1 + VᵀK⁻¹V d) e = e₀.

Springs between the same two nodes are stretched alike, so they make one row, a *joint*, which
weakens as they break, the weakest first. The rows of squares or cubes are the swelling and the
distortions of every cell, and the shear of every edge between cells. A broken cell keeps so small
a share of its stiffness that it bears nothing to speak of; the edges round it follow it, as their
modulus is the harmonic mean of the cells'.

References
----------
W. W. Hager, "Updating the inverse of a matrix", SIAM Review 31 (1989) 221-239.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, Literal

import numpy as np
import scipy.sparse as sp
from scipy.linalg import helmert
from scipy.linalg.lapack import dposv
from scipy.sparse import csc_array, csr_array, diags_array

from kaju.arrays import Floats, Ints, spread
from kaju.errors import SceneError, require
from kaju.model.elastic.equal import fields, staggered
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.staggered import axis_pairs, edge_modulus, padded, rows_of
from kaju.model.elastic.moduli import strain_of
from kaju.model.network import SpringNetwork
from kaju.model.network.assembler import Assembler, along_springs
from kaju.model.network.equilibrium import DirectSolver, SingularTangentError
from kaju.model.network.springs import spring_lengths_and_directions
from kaju.model.results.mesh import corner_order
from kaju.model.scene import Scene

Measure = Literal["force", "stress", "strain", "energy"]
"""What is exceeded: a spring's tension (N) or a cell's largest principal stress (Pa), the largest
strain, or the energy (J) of either."""


class WeakeningBody:
    """A body under its whole load (a load factor of 1), of parts that break.

    `strain`, shape (r, f): B, elongation of the rows by displacement of the free coordinates;
    `stiffness`, shape (r,): k, energy of a row over half the square of its elongation; `given`,
    shape (r,): elongation by what supports are moved by; `force`, shape (f,): of the load, such
    that F·u is its work (J); `most`: weakened rows from which on there are new factors, in the
    `order` of `splu`. A body that does not resist raises `SingularTangentError`.

    `yielded`: F·u (J); `pull`, `shift`: size of the load, Σ |F| (N), or how far supports are moved
    at most (m).
    """

    precise: ClassVar[float]
    """Share of its resistance that the body must keep for corrections to be precise."""
    parted: ClassVar[float]
    """Share of its first resistance to moved supports below which a body has parted."""
    pull: float
    shift: float

    def __init__(
        self,
        strain: csr_array,
        stiffness: Floats,
        given: Floats,
        force: Floats,
        most: int,
        order: str,
    ) -> None:
        self._strain, self.stiffness = strain, stiffness
        self._given, self._force = given, force
        self._solver = DirectSolver(order)
        self._response = np.empty((len(stiffness), most), order="F")
        self._place = np.full(len(stiffness), -1)
        self._weakened: list[int] = []
        self._yielded_by: Floats = np.empty(0)
        self.broken: list[int] = []
        self._factorise()
        self._unbroken = float(np.abs(self.elongation).max())

    @property
    def stored(self) -> float:
        """Energy in the body (J)."""
        return 0.5 * float(self.stiffness @ self.elongation**2)

    @property
    def pushed(self) -> float:
        """Work that the supports' final forces would do on their displacements (J)."""
        return float((self.stiffness * self.elongation) @ self._given)

    @property
    @abstractmethod
    def shares(self) -> Floats:
        """How much of the load that it survives every part bears; negative: it is pressed."""

    @abstractmethod
    def break_part(self, place: int) -> tuple[int, float]:
        """Break the part at an index of the shares; return its number and the energy (J) freed."""

    def index_of(self, part: int) -> int:
        """Return the index among the shares that stands for a part."""
        return part

    @property
    @abstractmethod
    def points(self) -> tuple[Floats, Ints]:
        """Places of nodes or corners (m), and which of them every spring or cell has."""

    @abstractmethod
    def displacement(self) -> Floats:
        """Return the displacement of the points (m), shape (n, dimension)."""

    @abstractmethod
    def borne(self) -> Floats:
        """Return what every part bears: tension (N) or largest principal stress (Pa)."""

    def weaken(self, rows: Ints, stiffness: Floats) -> float:
        """Give rows less stiffness; return the energy (J) that this releases."""
        lost, before = self.stiffness[rows] - stiffness, self.elongation[rows]
        self.stiffness[rows] = stiffness
        fresh = rows[self._place[rows] < 0]
        first, last = len(self._weakened), len(self._weakened) + len(fresh)
        if last > self._response.shape[1]:
            self._factorise()
        else:
            if len(fresh):
                pulled = self._solver.solve(self._strain[fresh].toarray().T)
                self._response[:, first:last] = self._strain @ pulled
                self._yielded_by = np.append(self._yielded_by, self._force @ pulled)
                self._place[fresh] = np.arange(first, last)
                self._weakened.extend(fresh.tolist())
            if not self._correct():
                self._factorise()
        # Equations of a body that hardly resists lose the digits by which its parts differ.
        if not np.abs(self.elongation).max() * 1e-6 <= self._unbroken:
            raise SingularTangentError(self._solution / np.linalg.norm(self._solution))
        return 0.5 * float(np.sum(lost * before * self.elongation[rows]))

    def solution(self) -> Floats:
        """Return the displacement of the free coordinates, shape (f,)."""
        if self._weakened:
            self._factorise()
        return self._solution

    def _factorise(self) -> None:
        """Factorise the weakened body, and solve with it."""
        matrix = self._strain.T @ (diags_array(self.stiffness) @ self._strain)
        self._solver.factorise(csc_array(matrix))
        self._basis = self.stiffness.copy()
        load = self._force - self._strain.T @ (self.stiffness * self._given)
        self._solution = self._solver.solve(load)
        # A body that hardly resists costs digits: a second step wins them back.
        self._solution += self._solver.solve(load - matrix @ self._solution)
        self.elongation = self._first = self._strain @ self._solution + self._given
        self.yielded = self._first_yielded = float(self._force @ self._solution)
        self._place[self._weakened] = -1
        self._weakened = []
        self._yielded_by = np.empty(0)

    def _correct(self) -> bool:
        """Correct the answer for the weakened rows; tell whether that was precise."""
        root = np.sqrt((self._basis - self.stiffness)[self._weakened])
        response = self._response[:, : len(root)]
        resistance = np.eye(len(root)) - root[:, None] * response[self._weakened] * root
        lower, back, failed = dposv(resistance, root * self._first[self._weakened], lower=1)
        if failed or lower.diagonal().min() ** 2 < self.precise:
            return False
        back *= root
        # Not by BLAS, whose threads wait for each other where others are at work.
        self.elongation = self._first + np.einsum("rw,w->r", response, back)
        self.yielded = self._first_yielded + float(self._yielded_by @ back)
        return True


def measured(measure: str, known: Mapping[str, Callable[[], Floats]]) -> Callable[[], Floats]:
    """Return the function of a measure, of those that a body has."""
    require(measure in known, f"measure: {', '.join(map(repr, known))}, got {measure!r}")
    return known[measure]


class BreakingNetwork(WeakeningBody):
    """The springs of a network that are left, under the whole load (a load factor of 1)."""

    precise = 1e-4
    parted = 1e-9

    def __init__(self, network: SpringNetwork, strengths: Floats, measure: str) -> None:
        self.network = network
        length, stiffness = network.initial_length, network.stiffness
        known: dict[str, Callable[[], Floats]] = {
            "force": lambda: strengths / stiffness,
            "strain": lambda: strengths * length,
            "energy": lambda: np.sqrt(2.0 * strengths / stiffness),
        }
        self._limits = measured(measure, known)()  # elongations (m)
        forces, given = network.forces[-1], network.displacements[-1]
        self.pull = float(np.linalg.norm(forces, axis=1).sum())
        self.shift = float(np.linalg.norm(given, axis=1).max())
        self._assembler = Assembler(network)
        ends = np.sort(network.springs, axis=1)
        _, first, joint = np.unique(ends, axis=0, return_index=True, return_inverse=True)
        self._joint = joint.ravel()
        self._order = np.lexsort((self._limits, self._joint))  # by joint, the weakest first
        self._count = np.bincount(self._joint)
        self._start = np.cumsum(self._count) - self._count
        # Stiffness of a joint before each of its breaks: summed from the strongest spring on, so
        # that the last ones have no rounding of those that broke before.
        joints = np.split(stiffness[self._order], self._start[1:])
        self._left = np.concatenate([np.cumsum(springs[::-1])[::-1] for springs in joints])
        self.limit: Floats = self._limits[self._order[self._start]]
        self._gone = np.zeros(len(first), dtype=np.int64)
        springs = network.springs[first]
        direction = spring_lengths_and_directions(network.positions, springs)[1]
        super().__init__(
            _strain_matrix(self._assembler, springs, direction),
            self._left[self._start].copy(),
            np.einsum("ij,ij->i", along_springs(network, given)[first], direction),
            self._assembler.restrict(forces),
            64,  # breaks from which new factors cost less than more corrections
            "NATURAL",  # of the assembler, which keeps the factors sparse
        )

    @property
    def shares(self) -> Floats:
        """Elongations of the joints over those that their weakest springs survive."""
        return np.asarray(self.elongation / self.limit)

    def break_part(self, place: int) -> tuple[int, float]:
        """Take the weakest spring out of a joint; see `WeakeningBody`."""
        first = self._start[place] + self._gone[place]
        self._gone[place] += 1
        spring = int(self._order[first])
        self.broken.append(spring)
        emptied = self._gone[place] == self._count[place]
        self.limit[place] = np.inf if emptied else self._limits[self._order[first + 1]]
        left = 0.0 if emptied else self._left[first + 1]
        return spring, self.weaken(np.array([place]), np.array([left]))

    def index_of(self, spring: int) -> int:
        """Return the joint of a spring."""
        return int(self._joint[spring])

    @property
    def points(self) -> tuple[Floats, Ints]:
        """Places of the nodes (m), and which of them every spring joins."""
        return self.network.positions, self.network.springs

    def displacement(self) -> Floats:
        """Return the displacement of the nodes (m), shape (n, dimension)."""
        moved = self._assembler.expand(self.solution())
        return np.where(self.network.held, self.network.displacements[-1], moved)

    def borne(self) -> Floats:
        """Return the tension of the springs (N), none of those that broke."""
        tension = self.network.stiffness * self.elongation[self._joint]
        tension[self.broken] = 0.0
        return np.asarray(tension)


def _strain_matrix(assembler: Assembler, springs: Ints, direction: Floats) -> csr_array:
    """Return elongation per displacement of the free coordinates, shape (springs, f)."""
    count, dimension = direction.shape
    number = np.full(assembler.network.positions.size, -1)
    number[assembler.free] = np.arange(len(assembler.free))
    column = number[dimension * springs[:, :, None] + np.arange(dimension)]
    value = np.stack([direction, -direction], axis=1)
    row = np.broadcast_to(np.arange(count)[:, None, None], column.shape)
    free = column >= 0
    return csr_array((value[free], (row[free], column[free])), shape=(count, len(assembler.free)))


CELLS_CORRECTED = 12
"""Breaks from which new factors cost less than more corrections, of six rows or more each."""

KEPT = 1e-10
"""Share of its stiffness that a broken cell keeps."""


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
        known: dict[str, Callable[[], Floats]] = {
            "stress": lambda: _largest(self._stress()),
            "strain": lambda: _largest(self._strain_of(self._stress())),
            "energy": self._by_energy,
        }
        self._bear = measured(measure, known)

        d, solid = problem.dimension, problem.kinds >= 0
        self._numbering, rows, given, bed, load = rows_of(problem)
        self._kinds = problem.kinds[solid].astype(np.int64)
        self._n = n = len(self._kinds)
        number = spread(np.arange(n), solid, -1)
        edges = {pair: edge_modulus(problem, pair) for pair in axis_pairs(d)}
        # The four cells round every edge that carries shear, -1 beside the body, shape (4, edges);
        # and the sum of their compliances, by which a broken cell softens the edge.
        around = []
        for pair, modulus in edges.items():
            cells = staggered.around_edges(padded(number, pair, -1), pair)
            around.append(np.array([cell[modulus > 0] for cell in cells]))
        self._around: Ints = np.concatenate(around, axis=1)
        self._compliance: Floats = 1.0 / problem.moduli.shear[self._kinds]
        self._total = np.append(self._compliance, 0.0)[self._around].sum(axis=0)

        # Swelling and distortions: their moduli stand alone, those of the stretches do not.
        modes = sp.kron(helmert(d, full=True), sp.eye_array(n), format="csr")
        others = sp.eye_array(len(self._total) + len(bed))
        turn = sp.block_diag([modes, others], format="csr")
        moduli = problem.moduli
        swelling = (moduli.stretch + (d - 1) * moduli.lateral)[self._kinds]
        distortion = np.tile((moduli.stretch - moduli.lateral)[self._kinds], d - 1)
        shear = [modulus[modulus > 0] for modulus in edges.values()]
        unit = problem.scales.energy  # J, of displacements that stay scaled
        stiffness = unit * np.concatenate([swelling, distortion, *shear, bed])
        self._tensor = self._to_stress(modes, [len(s) for s in shear]) * (
            problem.scales.stress / unit
        )
        self._whole = np.ones(n, dtype=bool)
        most = CELLS_CORRECTED * (d + 4 * len(edges))
        strain, given = sp.csr_array(turn @ rows), np.asarray(turn @ given)
        super().__init__(strain, stiffness, given, unit * load, most, "MMD_AT_PLUS_A")

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
    largest = np.linalg.eigvalsh(tensors)[:, -1]
    return np.where(np.abs(largest) > 1e-9 * np.abs(tensors).max(), largest, 0.0)
