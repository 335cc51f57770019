"""The opinion that fits: a displacement without gaps, by quadratics of least potential energy."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.pair.border import Sides
from kaju.model.elastic.pair.elements import EDGES, forms, rule, strains
from kaju.model.elastic.pair.leaf_mesh import LeafMesh
from kaju.model.elastic.pair.levels import Blocks

MEANS = np.array([0.25] * 4 + [1.0 / 3.0] * 4)
"""Means of the eight quadratics over the square."""
ON_EDGE = np.array([[1 / 3, 1 / 6, 1 / 3], [1 / 6, 1 / 3, 1 / 3], [1 / 3, 1 / 3, 8 / 15]])
"""Mean products of the three functions on an edge: its two ends, and its bulge."""


def blocks_of(
    mesh: LeafMesh, sides: Sides, laws: list[tuple[Ints | slice, Floats]], law: Floats, cell: int
) -> Blocks:
    """Return the stiffness of the agents and of the beds; `law` has C11, C12 and mu of each."""
    node = np.concatenate([mesh.corner, mesh.vertices + mesh.edge], axis=1)
    dof = (2 * node[:, :, None] + np.arange(2)).reshape(len(node), 16)
    size = 2 * (mesh.vertices + mesh.edges)
    matrices = [(agents, np.einsum("kij,k->ij", forms(False), one)) for agents, one in laws]
    beds = np.flatnonzero(sides.bed > 0.0)
    extra = None
    if len(beds):
        edge = mesh.border[beds]
        nodes = np.column_stack([mesh.ends[edge], mesh.vertices + edge])
        unknown = 2 * nodes + np.where(mesh.side[beds] < 2, 1, 0)[:, None]
        value = (sides.bed[beds] * mesh.length[edge] / cell)[:, None, None] * ON_EDGE
        at = np.repeat(unknown, 3, axis=1).ravel(), np.tile(unknown, (1, 3)).ravel()
        extra = sp.csr_array((value.ravel(), at), shape=(size, size))
    return Blocks(dof, matrices, np.ones(len(node)), None, size, extra)


def ties_of(mesh: LeafMesh) -> tuple[sp.csr_array, Flags]:
    """Return what all nodes are by those that follow no other, and which do follow others."""
    nodes = mesh.vertices + mesh.edges
    start, end = mesh.ends[mesh.whole].T
    bulge = mesh.vertices + mesh.whole
    follows = np.zeros(nodes, dtype=np.bool_)
    follows[mesh.middle] = follows[mesh.vertices + mesh.halves] = True
    own = np.flatnonzero(~follows)
    # On a hanging edge the middle is the value of the whole edge's parabola there, and the bulge
    # of each half is a quarter of its bulge.
    rows = [own, mesh.middle, mesh.middle, mesh.middle, *(mesh.vertices + mesh.halves)]
    columns = [own, start, end, bulge, bulge, bulge]
    values = np.repeat([1.0, 0.5, 0.5, 1.0, 0.25, 0.25], [len(row) for row in rows])
    return followed(np.concatenate(rows), np.concatenate(columns), values, nodes), follows


def way_of(mesh: LeafMesh, sides: Sides) -> tuple[sp.csr_array, Ints]:
    """Return what all unknowns are by the free ones, and which these are."""
    (way, follows), nodes = ties_of(mesh), mesh.vertices + mesh.edges
    held = np.zeros((nodes, 2), dtype=np.bool_)
    for node in (*mesh.ends[mesh.border].T, mesh.vertices + mesh.border):
        np.logical_or.at(held, node, sides.held)
    free = np.flatnonzero((~(follows[:, None] | held)).ravel())
    both = sp.csr_array(sp.kron(way, sp.eye_array(2), format="csr"))
    return sp.csr_array(both[:, free]), free


def followed(rows: Ints, columns: Ints, values: Floats, size: int) -> sp.csr_array:
    """Return what unknowns are by those that follow no other: those they follow may do so, too."""
    way: sp.csr_array[np.float64] = sp.csr_array((values, (rows, columns)), shape=(size, size))
    while True:
        next_way: sp.csr_array[np.float64] = sp.csr_array(way @ way)
        if next_way.nnz == way.nnz and np.abs((next_way - way).data).max(initial=0.0) < 1e-12:
            return way
        way = next_way


def moved_by(mesh: LeafMesh, sides: Sides) -> Floats:
    """Return a displacement that is as given where it is held, and 0 at all other free corners."""
    value = np.zeros((mesh.vertices + mesh.edges, 2))
    for end in mesh.ends[mesh.border].T:
        edge, axis = np.nonzero(sides.held)
        value[end[edge], axis] = sides.moved[edge, axis]
    value = ties_of(mesh)[0] @ value
    node = np.concatenate([mesh.corner, mesh.vertices + mesh.edge], axis=1)
    return np.asarray(value[node].reshape(len(node), 16))


def forces_of(sides: Sides) -> Floats:
    """Return the forces of the loads on the agents' own unknowns, shape (n, 16)."""
    out = sides.body[:, None] * MEANS[:, None]
    force, moment = sides.load[:, :, 0], sides.load[:, :, 1]
    for edge, (start, end) in enumerate(EDGES):
        out[:, start] += 0.5 * force[:, edge] - moment[:, edge]
        out[:, end] += 0.5 * force[:, edge] + moment[:, edge]
        out[:, 4 + edge] += 2.0 / 3.0 * force[:, edge]
    even = np.einsum("pki,p->ki", strains(), rule()[1])
    return np.asarray(out.reshape(len(out), 16) + sides.even @ even)
