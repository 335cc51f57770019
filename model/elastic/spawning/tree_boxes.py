"""Agents of many sizes as the boxes of which brackets are made."""

from __future__ import annotations

from itertools import product

import numpy as np

from kaju.model.elastic.boxes import (
    Bed,
    Boxes,
    Hanging,
    Held,
    Law,
    Loads,
    Mesh,
    corner_ends,
    parted,
)
from kaju.model.elastic.bracket import Bracket, bracket_of
from kaju.model.scene.kinds import DISPLACED, RIGID, ROLLER

from . import agent_fields as sampling
from .agent_fields import AgentFields
from .balance import Balance
from .composite import Composite, Floats
from .leaves import Flags, Index, morton


def bracket_of_agents(balance: Balance, u: Floats) -> Bracket | str:
    """Hold the true energy between two that can be computed; see `bracket_of`."""
    if balance.grid.dimension == 3 and len(np.unique(balance.grid.leaves.size)) > 1:
        return "the agents of a solid are of many sizes"
    return bracket_of(boxes_of_agents(balance, u))


def boxes_of_agents(balance: Balance, u: Floats) -> Boxes:
    """Return agents of many sizes with the stresses of a solution.

    Parameters
    ----------
    balance : Balance
    u : array, shape (faces,)
        Displacements that balance the forces.
    """
    grid, fields = balance.grid, AgentFields(balance, u)
    leaves, n, d = grid.leaves, len(grid.leaves), grid.dimension
    moduli, kind = grid.ground.moduli, leaves.kind
    law = Law(moduli.stretch[kind], moduli.lateral[kind], moduli.shear[kind])
    shear = {}
    for pair, edges in grid.edges.items():
        tau = edges.modulus * sum(fields.slopes[pair])
        shear[pair] = np.ascontiguousarray(np.moveaxis(tau[edges.of_leaf], 0, 2))
    forces = grid.ground.forces(leaves)
    within = forces.direction < 0
    body = np.zeros((d, n))
    np.add.at(body.T, forces.leaf[within], forces.force[within])
    loads = Loads(forces.leaf[~within], forces.direction[~within], forces.force[~within])
    beside, beyond = grid.beside.T.copy(), np.empty((2 * d, n), dtype=np.int64)
    for side in range(2 * d):
        beyond[side] = _kinds_beyond(grid, side)
        beside[side][grid.master[:, side] < 0] = -1  # smaller ones: they are told as hanging
    hanging = _hanging(grid)
    uneven = _round_corners(grid)
    uneven[hanging.box] = True
    along = np.abs(loads.force).sum(axis=1) > np.abs(
        loads.force[np.arange(len(loads.side)), loads.side // 2]
    )
    uneven[loads.box[along]] = True
    return Boxes(
        grid.length,
        law,
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
        _mesh(grid, fields, law, hanging),
        fields.sides.T,
    )


def _kinds_beyond(grid: Composite, side: int) -> Index:
    beside = grid.beside[:, side]
    kind = grid.leaves.kind[beside].astype(np.int64)
    bare = np.flatnonzero(beside < 0)
    kind[bare] = grid.ground.kinds_at(grid.beyond(side, bare))
    return np.asarray(kind)


def _hanging(grid: Composite) -> Hanging:
    """Return the sides of leaves with two smaller ones before them."""
    box, side = np.nonzero(grid.master < 0)
    if grid.dimension == 3 or not len(box):
        nothing = np.zeros(0, dtype=np.int64)
        return Hanging(nothing, nothing, nothing.reshape(0, 2))
    leaves, each = grid.leaves, np.arange(len(box))
    lower = leaves.lower[box]
    lower[each, side // 2] += np.where(side % 2, leaves.size[box], -1)
    upper = lower.copy()
    upper[each, 1 - side // 2] += leaves.size[box] // 2
    return Hanging(box, side, np.stack([leaves.find(lower), leaves.find(upper)], axis=1))


def _round_corners(grid: Composite) -> Flags:
    """Tell which leaves lie round an edge of which one of the four is air, and shear acts."""
    found = np.zeros(len(grid.leaves), dtype=np.bool_)
    for pair, edges in grid.edges.items():
        around = np.bincount(edges.of_leaf.ravel(), minlength=len(edges.modulus))
        bare = np.zeros(len(edges.modulus), dtype=np.bool_)
        for first, second in product((0, 1), repeat=2):
            edge = edges.of_leaf[:, first, second]
            # A leaf whose side is bare where it meets the edge looks on air, or on a wall.
            for axis, end in zip(pair, (first, second), strict=True):
                bare[edge[grid.beside[:, 2 * axis + end] < 0]] = True
        corner = bare & (around == 3) & (edges.modulus > 0)
        found |= corner[edges.of_leaf].any(axis=(1, 2))
    return found


def _held(grid: Composite, beyond: Index) -> list[Held]:
    found = []
    for side, kinds in enumerate(beyond):
        for kind in (ROLLER, RIGID, DISPLACED):
            at = np.flatnonzero(kinds == kind)
            if not len(at):
                continue
            value = np.zeros((len(at), grid.dimension))
            if kind != RIGID:
                outside = grid.outside(grid.beyond(side, at), side)
                value[outside] = grid.ground.given(side)
            found.append(Held(side, at, ROLLER if kind == ROLLER else RIGID, value))
    return found


def _beds(grid: Composite) -> list[Bed]:
    found = []
    for side, face in enumerate(grid.master.T):
        own = np.flatnonzero((face >= 0) & (grid.spring[np.maximum(face, 0)] > 0))
        if len(own):
            found.append(Bed(side, own, grid.spring[face[own]] / grid.area[face[own]]))
    return found


def _mesh(grid: Composite, fields: AgentFields, law: Law, hanging: Hanging) -> Mesh:
    """Return the nodes: corners of leaves, and of the quarters of those with hanging sides."""
    leaves, n, d = grid.leaves, len(grid.leaves), grid.dimension
    ends = corner_ends(d)
    place = 2 * (leaves.lower + ends[:, None] * leaves.size[:, None])  # in half units
    cut = np.unique(hanging.box)
    thirds = np.array(list(product((0, 1, 2), repeat=d)))
    inner = 2 * leaves.lower[cut] + thirds[:, None] * leaves.size[cut, None]
    points = np.concatenate([place.reshape(-1, d), inner.reshape(-1, d)])
    _, first, number = np.unique(morton(points), return_index=True, return_inverse=True)
    number = number.ravel()
    corner, nine = number[: len(ends) * n].reshape(len(ends), n), number[len(ends) * n :]
    count = len(first)
    if d == 2:
        corner, double = parted(corner, count)
        count += len(double)
    own = np.zeros(count, dtype=np.bool_)
    own[corner] = True
    start = _at_corners(grid, fields, law, corner, count)
    if not len(cut):
        nothing = np.zeros(0, dtype=np.int64)
        none = nothing.reshape(2, 0)
        return Mesh(corner, corner, np.arange(n), grid.length, nothing, none, start)
    nine = nine.reshape(3, 3, len(cut)).copy()
    nine[::2, ::2] = corner[:, cut].reshape(2, 2, len(cut))
    whole = np.ones(n, dtype=np.bool_)
    whole[cut] = False
    quarters = [nine[i : i + 2, j : j + 2].reshape(4, -1) for i in (0, 1) for j in (0, 1)]
    element = np.concatenate([corner[:, whole], *quarters], axis=1)
    owner = np.concatenate([np.flatnonzero(whole), np.tile(cut, 4)])
    edge = np.concatenate([grid.length[whole], np.tile(0.5 * grid.length[cut], 4)])
    middles = [(nine[k, 1], nine[k, ::2]) for k in (0, 2)]
    middles += [(nine[1, k], nine[::2, k]) for k in (0, 2)]
    slave = np.concatenate([middle for middle, _ in middles])
    masters = np.concatenate([between for _, between in middles], axis=1)
    straight = ~own[slave]
    slave, at = np.unique(slave[straight], return_index=True)
    masters = masters[:, straight][:, at]
    start[nine[1, 1]] = start[corner[:, cut]].mean(axis=0)
    return Mesh(corner, element, owner, edge, slave, masters, start)


def _at_corners(
    grid: Composite, fields: AgentFields, law: Law, corner: Index, count: int
) -> Floats:
    """Return displacements at nodes: what the leaves round them say, stiff ones counting more."""
    n, d = len(grid.leaves), grid.dimension
    leaf = np.arange(n)
    walls = sampling.walls_beside(grid, leaf)
    total, weight = np.zeros((count, d)), np.zeros(count)
    for end, node in zip(corner_ends(d), corner, strict=True):
        local = np.broadcast_to(end.astype(np.float64), (n, d))
        weight += np.bincount(node, law.stretch, count)
        for axis in range(d):
            value = sampling.component(fields, leaf, local, walls, axis)
            total[:, axis] += np.bincount(node, law.stretch * value, count)
    return total / np.where(weight > 0.0, weight, 1.0)[:, None]
