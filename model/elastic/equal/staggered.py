"""The staggered-grid law of elasticity, in the fewest lines of NumPy, and as a matrix.

Unknown is the normal displacement of every face (Harlow & Welch 1965; Virieux 1986). With
lengths in cell edges a cell's strain ε_aa is the difference of its two faces normal to a,
and the shear strain γ_ab at an edge is ∂u_a/∂b + ∂u_b/∂a from the four faces round it. The
energy ½Σ(C₁₁ε² + 2C₁₂εε') over the cells plus ½ΣK_ab γ_ab² over the edges is quadratic; its
gradient is the force that holds every face in place.

An edge's modulus K is the harmonic mean of the four cells round it: zero beside air (a
free surface carries no shear), and with rigid cells counted as infinitely stiff it becomes
twice μ at a wall, which is the one-sided gradient over half a cell.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints, spread
from kaju.model.elastic.moduli import Moduli, moduli_at
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID

from .problem import ACTIVE, ElasticProblem, FaceFields

Pair = tuple[int, int]

REENTRANT_WEIGHT = 0.5
"""Share of its shear modulus that a corner keeps when one of its four cells is air.

Free of traction it would have none, by area it would have 3/4. One half gives the smallest
error of the energy on an L-shaped body and on ragged ones, where 0 and 3/4 are off to opposite
sides.
"""


class Strains(NamedTuple):
    """Stretch of cells per axis, and shear of edges per pair of axes."""

    cells: FaceFields
    edges: dict[Pair, Floats]


def axis_pairs(dimension: int) -> list[Pair]:
    """Return the pairs of axes (a, b), a < b, that have a shear strain."""
    return list(combinations(range(dimension), 2))


def cut(dimension: int, axis: int, part: slice) -> tuple[slice, ...]:
    """Return an index that takes `part` along one axis and everything along the others."""
    index = [slice(None)] * dimension
    index[axis] = part
    return tuple(index)


def ends(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what is at the lower and the upper end of every step along an axis: views."""
    low, high = (cut(values.ndim, axis, part) for part in (slice(None, -1), slice(1, None)))
    return values[low], values[high]


def padded(values: NDArray[Any], axes: Iterable[int], fill: Any = None) -> NDArray[Any]:
    """Return values with one more before and behind along some axes: a fill, or as the last."""
    width = [(int(axis in axes),) * 2 for axis in range(values.ndim)]
    if fill is None:
        return np.pad(values, width, "edge")
    return np.pad(values, width, constant_values=fill)


def cell_modulus(problem: ElasticProblem, per_material: Floats) -> Floats:
    """Spread a modulus over the cells, zero where there is no material."""
    modulus: Floats = np.append(per_material, 0.0)[np.maximum(problem.kinds, -1)]
    return modulus


def edge_modulus(problem: ElasticProblem, pair: Pair) -> Floats:
    """Return the shear modulus of the edges between the axes of a pair."""
    # Shape: one more than the cells (ghosts included) along both axes of the pair.
    if problem.edges is not None:
        return problem.edges[pair]
    kinds, shear = padded(problem.kinds, pair, AIR), problem.moduli.shear

    def summed(values: NDArray[Any]) -> NDArray[Any]:
        """Return the sum over the four cells round every edge of what a kind has."""
        return reduce(np.add, around_edges(values.take(kinds, mode="wrap"), pair))

    # Kinds that are no material are negative: they count from the end of these tables. Cells are
    # counted in digits of base 16: those of body or rigid, those of body, and those of air.
    of_kind = np.pad(np.full(len(shear), 0x011, dtype=np.int16), (0, -DISPLACED))
    of_kind[[RIGID, DISPLACED]], of_kind[AIR] = 0x001, 0x100
    counts = summed(of_kind)
    # The harmonic mean of four cells that are body or rigid; a share of it at re-entrant corners.
    table = np.arange(0x401)
    bodies, corner = (table >> 4) & 0xF, table >> 4 == 0x13
    factors = np.where((table & 0xF == 4) & (bodies > 0), 4.0, 0.0)
    factors[corner] = 3.0 * REENTRANT_WEIGHT
    if len(shear) == 1:
        return np.asarray((factors * shear / np.maximum(bodies, 1)).take(counts))
    total: Floats = summed(np.pad(1.0 / shear, (0, -DISPLACED)))
    modulus: Floats = factors.take(counts)
    return np.divide(modulus, total, out=modulus, where=total > 0.0)


def energy_of_cells(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the energy stored in every cell, without ghosts."""
    # An edge's energy belongs to the cells round it by their compliances. So a cell's energy is its
    # stiffness times the derivative of all energy by that, at given displacements.
    strain = strains(u)
    stress = stresses(problem, strain)
    pairs = zip(stress.cells, strain.cells, strict=True)
    energy = np.add.reduce([0.5 * sigma * epsilon for sigma, epsilon in pairs])
    compliance = cell_modulus(problem, 1.0 / problem.moduli.shear)
    for pair, gamma in strain.edges.items():
        total = np.add.reduce(around_edges(padded(compliance, pair, 0.0), pair))
        share = np.zeros_like(total)
        np.divide(0.5 * stress.edges[pair] * gamma, total, out=share, where=total > 0.0)
        energy += compliance * np.add.reduce(around_edges(share, pair))
    return np.asarray(energy[problem.inner])


def around_edges(cells: NDArray[Any], pair: Pair) -> list[NDArray[Any]]:
    """Return the four cells round every edge."""
    return [corner for side in ends(cells, pair[0]) for corner in ends(side, pair[1])]


def strains(u: FaceFields) -> Strains:
    """Return the strains of face displacements (with ghosts, lengths in cell edges)."""
    d = len(u)
    cells = tuple(np.diff(values, axis=axis) for axis, values in enumerate(u))
    edges = {}
    for a, b in axis_pairs(d):
        along = np.diff(padded(u[a], (b,)), axis=b)
        edges[a, b] = along + np.diff(padded(u[b], (a,)), axis=a)
    return Strains(cells, edges)


def stresses(problem: ElasticProblem, strain: Strains) -> Strains:
    """Return normal stresses of the cells and shear stresses of the edges (scaled)."""
    stretch = cell_modulus(problem, problem.moduli.stretch)
    lateral = cell_modulus(problem, problem.moduli.lateral)
    volume = np.add.reduce(strain.cells)
    cells = tuple(lateral * volume + (stretch - lateral) * e for e in strain.cells)
    edges = {p: edge_modulus(problem, p) * gamma for p, gamma in strain.edges.items()}
    return Strains(cells, edges)


def internal_force(problem: ElasticProblem, u: FaceFields) -> FaceFields:
    """Return the force that holds every face at the displacement `u`: the plain twin."""
    # It is the gradient of the strain energy with respect to the face displacements, plus the force
    # of the foundation.
    stress, forces = stresses(problem, strains(u)), []
    for axis, values in enumerate(u):
        force = problem.spring[axis] * values
        low, high = ends(force, axis)
        high += stress.cells[axis]
        low -= stress.cells[axis]
        for pair, tau in stress.edges.items():
            if axis in pair:
                across = pair[0] + pair[1] - axis
                before, behind = ends(tau, across)
                force += before
                force -= behind
        forces.append(force)
    return tuple(forces)


class Numbering:
    """Numbers for the faces that are free to move, axis after axis.

    `states` are those of all faces by axis, ghosts included, `number` the active ones' numbers, -1
    elsewhere; `size` is how many are active.
    """

    def __init__(self, states: tuple[NDArray[np.int8], ...]) -> None:
        self.states = states
        self.number = []
        self.size = 0
        for state in states:
            active, first = state == ACTIVE, self.size
            self.size += int(np.count_nonzero(active))
            self.number.append(spread(np.arange(first, self.size), active, -1))

    def gather(self, fields: FaceFields) -> Floats:
        """Pick the active faces' values into one vector."""
        return np.concatenate([v[s == ACTIVE] for v, s in zip(fields, self.states, strict=True)])

    def scatter(self, vector: Floats, fields: FaceFields) -> None:
        """Write a vector of active faces back into face arrays."""
        for values, number in zip(fields, self.number, strict=True):
            active = number >= 0
            values[active] = vector[number[active]]


def stiffness_matrix(
    problem: ElasticProblem, numbering: Numbering, moduli: Moduli | None = None
) -> sp.csr_array:
    """Assemble the stiffness matrix of the active faces."""
    # `moduli` may replace the problem's own: the mixed form leaves the pressure's part out.
    rows = strain_matrix(problem, numbering)
    law = moduli_at(moduli or problem.moduli, problem.kinds[problem.kinds >= 0])
    axes = range(problem.dimension)
    normal = [[sp.diags_array(law.stretch if a == b else law.lateral) for b in axes] for a in axes]
    edges = [edge_modulus(problem, pair) for pair in axis_pairs(problem.dimension)]
    shear = sp.diags_array(np.concatenate([k[k > 0] for k in edges]))
    stress = sp.csr_array(sp.block_diag([sp.block_array(normal), shear], format="csr"))
    springs = numbering.gather(problem.spring)
    matrix = rows.T.tocsr() @ (stress @ rows)
    if springs.any():
        matrix = matrix + sp.diags_array(springs)
    return sp.csr_array(matrix)


def strain_matrix(problem: ElasticProblem, numbering: Numbering) -> sp.csr_array:
    """Return the matrix from active faces to the stretches of cells and shears of edges."""
    d = problem.dimension
    blocks = []
    solid = problem.kinds >= 0
    for axis in range(d):
        low, high = ends(numbering.number[axis], axis)
        blocks.append(_differences(numbering.size, [(low[solid], -1.0), (high[solid], 1.0)]))
    for pair in axis_pairs(d):
        stiff = edge_modulus(problem, pair) > 0
        terms = []
        for axis, across in (pair, pair[::-1]):
            low, high = ends(padded(numbering.number[axis], (across,), -1), across)
            terms += [(low[stiff], -1.0), (high[stiff], 1.0)]
        blocks.append(_differences(numbering.size, terms))
    return sp.csr_array(sp.vstack(blocks, format="csr"))


def rows_of(problem: ElasticProblem) -> tuple[Numbering, sp.csr_array, Floats, Floats, Floats]:
    """Return a body whose stiffness, or whose strains at rest, change, as rows of strain: B.

    K = Bᵀ k B: of cells along each axis, edges, springs of the bed. First the active faces, then
    the elongation of every row by their displacement (B), and by what sides are moved by; the
    stiffness of the bed's springs, which are the last rows; and the force on the faces.
    """
    numbering = Numbering(problem.face_states)
    springs = numbering.gather(problem.spring)
    on_bed = sp.eye_array(numbering.size, format="csr")[springs > 0.0]
    matrix = sp.vstack([strain_matrix(problem, numbering), on_bed], format="csr")
    strain, solid = strains(problem.fixed), problem.kinds >= 0
    edges = [shear[edge_modulus(problem, pair) > 0] for pair, shear in strain.edges.items()]
    cells = (stretch[solid] for stretch in strain.cells)
    given = np.concatenate([*cells, *edges, np.zeros(on_bed.shape[0])])
    load = numbering.gather(problem.force)
    return numbering, sp.csr_array(matrix), given, springs[springs > 0.0], load


def _differences(columns: int, terms: list[tuple[Ints, float]]) -> sp.csr_array:
    """Return a matrix with one row per entry of the terms, given as (columns, weight)."""
    count = len(terms[0][0])
    row = np.concatenate([np.flatnonzero(index >= 0) for index, _ in terms])
    column = np.concatenate([index[index >= 0] for index, _ in terms])
    value = np.concatenate([np.full(np.count_nonzero(i >= 0), w) for i, w in terms])
    return compact(row, column, value, (count, columns))


def compact(row: Ints, column: Ints, value: Floats, shape: tuple[int, int]) -> sp.csr_array:
    """Return a sparse matrix with indices of half the size, where they suffice."""
    kind = np.int32 if max(len(value), *shape) < 2**31 else np.int64
    return sp.csr_array((value, (row.astype(kind), column.astype(kind))), shape=shape)
