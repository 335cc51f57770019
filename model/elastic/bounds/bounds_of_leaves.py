"""Agents of many sizes as the boxes of which energy bounds are made."""

from __future__ import annotations

from itertools import product

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.bound_cells import (
    BoundCells,
    Foundation,
    Hanging,
    HeldSides,
    Mesh,
    corner_ends,
    entered,
    split_nodes,
)
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields, corner_values
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.scene.cell_types import DISPLACED, RIGID, ROLLER


def boxes_of_agents(balance: Equilibrium, u: Floats) -> BoundCells:
    """Return agents of many sizes with the stresses of displacements that balance the forces."""
    grid, fields = balance.grid, CellFields(balance, u)
    leaves, n, d = grid.leaves, len(grid.leaves), grid.dimension
    shear = {
        pair: np.ascontiguousarray(np.moveaxis(fields.edge_shear[pair][edges.of_leaf], 0, 2))
        for pair, edges in grid.edges.items()
    }
    forces = grid.ground.forces(leaves)
    body, loads = entered(forces.leaf, forces.direction, forces.force, n)
    beside = np.where(grid.master < 0, -1, grid.beside).T.copy()  # smaller ones are hanging
    beyond, hanging = grid.kinds.T, Hanging(*grid.hanging)
    uneven = _round_corners(grid)
    uneven[hanging.box] = True
    uneven[loads.dragged] = True
    return BoundCells(
        grid.length,
        grid.law,
        fields.normal_stress,
        shear,
        body / grid.length**d,
        beside,
        np.where(beyond == DISPLACED, RIGID, beyond),
        uneven,
        hanging,
        loads,
        list(_held(grid, beyond)),
        list(_beds(grid)),
        _mesh(grid, fields),
        fields.sides.T,
        forces.uneven or Portions.none(d),
    )


def _round_corners(grid: CompositeGrid) -> Flags:
    """Tell which leaves lie round an edge of which one of the four is air, and shear acts."""
    found = np.zeros(len(grid.leaves), dtype=np.bool_)
    for pair, edges in grid.edges.items():
        quarters = np.zeros(len(edges.modulus), dtype=np.int64)
        bare = np.zeros(len(edges.modulus), dtype=np.bool_)
        for first, second in product((0, 1), repeat=2):
            edge = edges.of_leaf[:, first, second]
            there = np.zeros(len(edges.modulus), dtype=np.int64)
            there[edge] = 1
            quarters += there
            # A leaf whose side is bare where it meets the edge looks on air, or on a wall.
            for axis, end in zip(pair, (first, second), strict=True):
                bare[edge[grid.beside[:, 2 * axis + end] < 0]] = True
        corner = bare & (quarters == 3) & (edges.modulus > 0)
        found |= corner[edges.of_leaf].any(axis=(1, 2))
    return found


def _held(grid: CompositeGrid, beyond: Ints) -> list[HeldSides]:
    found = []
    for side, kinds in enumerate(beyond):
        for kind in (ROLLER, RIGID, DISPLACED):
            at = np.flatnonzero(kinds == kind)
            if not len(at):
                continue
            value = np.zeros((len(at), grid.dimension))
            if kind != RIGID:
                value[grid.outer[at, side]] = grid.ground.given(side)
            found.append(HeldSides(side, at, ROLLER if kind == ROLLER else RIGID, value))
    return found


def _beds(grid: CompositeGrid) -> list[Foundation]:
    found = []
    for side, face in enumerate(grid.master.T):
        own = np.flatnonzero((face >= 0) & (grid.spring[np.maximum(face, 0)] > 0))
        if len(own):
            found.append(Foundation(side, own, grid.spring[face[own]] / grid.area[face[own]]))
    return found


def _mesh(grid: CompositeGrid, fields: CellFields) -> Mesh:
    """Return the nodes: corners of leaves, and of the parts of those that smaller ones touch."""
    leaves, n, d = grid.leaves, len(grid.leaves), grid.dimension
    ends = corner_ends(d)
    thirds = np.array(list(product((0, 1, 2), repeat=d)))

    # Corners count in halves of the smallest leaf. Their numbers may overflow, but two points do
    # not get the same one: no body is so wide.
    half = int(leaves.size.min()).bit_length() - 1
    row = (2 * int(leaves.upper.max()) >> half) + 1

    def keys(leaf: Ints, third: Ints) -> Ints:
        number = np.zeros((len(third), len(leaf)), dtype=np.int64)
        for lower, thirds in zip(leaves.lower[leaf].T, third.T, strict=True):
            number = number * row + ((2 * lower + thirds[:, None] * leaves.size[leaf]) >> half)
        return number

    cut = _touched_by_smaller(grid)
    corners, inner = keys(np.arange(n), 2 * ends), keys(cut, thirds)
    key = np.concatenate([corners.ravel(), inner.ravel()])
    first, number = np.unique(key, return_inverse=True)
    # A box has a node of its lattice at the corners that lie in the same half along every axis.
    nearby = [np.all((third == 1) | (2 * ends == third), axis=1) for third in thirds]
    octants = [1 << k for k in range(len(ends))]
    octants += [int((1 << np.flatnonzero(near)).sum()) for near in nearby]
    at_corners, at_thirds = np.split(number, [corners.size])
    nodes = [*at_corners.reshape(corners.shape), *at_thirds.reshape(inner.shape)]
    nodes, double = split_nodes(nodes, octants, len(first))
    corner, count = np.stack(nodes[: len(ends)]), len(first) + len(double)
    # What the leaves round a node say, stiff ones counting more.
    start, weight = np.zeros((count, d)), np.zeros(count)
    for values, node in zip(corner_values(fields), corner, strict=True):
        weight += np.bincount(node, grid.law.stretch, count)
        for axis, value in enumerate(values):
            start[:, axis] += np.bincount(node, grid.law.stretch * value, count)
    start /= np.where(weight > 0.0, weight, 1.0)[:, None]
    # The first part of a box that is cut stands in its place, the others after all boxes.
    lattice = np.stack(nodes[len(ends) :]).reshape(*[3] * d, len(cut))
    cut_up = [lattice[tuple(slice(i, i + 2) for i in end)] for end in ends]
    more = n + np.arange((len(ends) - 1) * len(cut)).reshape(len(ends) - 1, len(cut))
    parts = np.tile(np.arange(n), (len(ends), 1))
    parts[1:, cut] = more
    owner = np.concatenate([np.arange(n), np.tile(cut, len(more))])
    element = np.empty((len(ends), len(owner)), dtype=np.int64)
    element[:, :n] = corner
    for part, elements in zip(cut_up, (cut, *more), strict=True):
        element[:, elements] = part.reshape(len(ends), len(cut))
    slave, masters = [], []
    for third, near in zip(thirds, nearby, strict=True):
        if 1 < near.sum() < len(ends):
            between = corner[near][:, cut]
            slave.append(lattice[tuple(third)])
            masters.append(np.tile(between, (len(ends) // 2 // len(between), 1)))
    start[lattice[(1,) * d]] = start[corner[:, cut]].mean(axis=0)
    own = np.zeros(count, dtype=np.bool_)
    own[corner] = True
    middle, at = np.unique(np.concatenate(slave), return_index=True)
    straight = ~own[middle]
    ends_of = np.concatenate(masters, axis=1)[:, at[straight]]
    edge = np.where(parts[0] == parts[-1], 1.0, 0.5)[owner] * grid.length[owner]
    return Mesh(corner, element, owner, edge, parts, middle[straight], ends_of, start)


def _touched_by_smaller(grid: CompositeGrid) -> Ints:
    """Return the leaves with corners of smaller ones on a side, or in solids on an edge."""
    size, found = grid.leaves.size, np.zeros(len(grid.leaves), dtype=np.bool_)
    found[grid.hanging[0]] = True
    for edges in grid.edges.values() if grid.dimension == 3 else ():
        least = np.full(len(edges.modulus), size.max())
        for own in edges.of_leaf.reshape(len(size), 4).T:
            np.minimum.at(least, own, size)
        found |= (least[edges.of_leaf] < size[:, None, None]).any(axis=(1, 2))
    return np.flatnonzero(found)
