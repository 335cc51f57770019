"""Agents in blocks as the boxes of which energy bounds are made.

The stresses of regular agents, among others of their size and material, follow from the arrays of
the blocks at once. Irregular ones touch another size or material, or the surface, or are loaded:
they are taken from a window of them and their neighbours as a composite grid (`bounds_of_leaves`).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.bound_cells import BoundCells, Mesh, corner_ends, entered
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.elastic.moduli import Moduli, moduli_at, normal_stress
from kaju.model.elastic.multigrid.blocks import BlockOperator, Window
from kaju.model.elastic.multigrid.forest import ACROSS, REGULAR, corners, offsets
from kaju.model.elastic.staggered import Pair, axis_pairs


def boxes_of_blocks(blocks: BlockOperator, u: Floats) -> BoundCells:
    """Return agents with the stresses of displacements at all places that balance."""
    forest, d = blocks.forest, blocks.forest.dimension
    leaves, many, n = forest.leaves, len(forest.corners), forest.count
    row_of = np.full(len(forest) + 1, -1)
    row_of[leaves] = np.arange(len(leaves))
    near = row_of[forest.beside[leaves]]

    def ahead(row: Ints | slice, step: Ints) -> Ints:
        """Return the agents a step from those of blocks, -1 where no block of their size is."""
        offset, corner = _stepped(d, tuple(step))
        there = near[row][:, offset]
        return np.where(there >= 0, many * there + corner, -1)

    loaded = np.flatnonzero(forest.loaded)
    forces = forest.ground.forces(forest.cells(leaves[loaded]))
    own = many * loaded[:, None] + np.arange(many)
    leaf = own.ravel()[forces.leaf]
    alike = (blocks.states[leaves] == REGULAR) & (forest.kinds[leaves] == forest.kind[leaves, None])
    irregular = (~alike).astype(np.float32) @ _touching(d) > 0
    irregular.ravel()[leaf[forces.direction >= 0]] = True
    chosen, row = irregular.copy(), np.flatnonzero(irregular.any(axis=1))
    for step in offsets(d):
        about = ahead(row, step)[irregular[row]]
        chosen.ravel()[about[about >= 0]] = True
    row = np.flatnonzero(chosen.any(axis=1))
    window = Window(forest, leaves[row], chosen[row])
    local = boxes_of_agents(window.balance, window.displacement(u))
    agent = np.flatnonzero(chosen)  # Those of the window, in their order
    inner = np.flatnonzero(irregular.ravel()[agent])
    box = agent[inner]

    def put(values: NDArray[Any], part: NDArray[Any]) -> NDArray[Any]:
        values[..., box] = part[..., inner]
        return values

    places, stride = blocks.shape[2], blocks.layout.stride
    at = (places * np.arange(len(leaves))[:, None] + (forest.corners + 1) @ stride).ravel()
    size = np.repeat(forest.size[leaves] / forest.ground.cell, many)
    kind = np.repeat(forest.kind[leaves], many)
    law = moduli_at(forest.ground.moduli, kind)
    faces = [u[leaves, a].ravel() for a in range(d)]
    sigma, shear, moved, start = _plain(faces, at, stride, size, law)
    sides = [sign * axis for axis in np.eye(d, dtype=np.int64) for sign in (-1, 1)]
    beside, corner = (
        np.stack([ahead(slice(None), step).ravel() for step in steps])
        for steps in (sides, corner_ends(d))
    )
    body, loads = entered(leaf, forces.direction, forces.force, n)
    hanging, portions = local.hanging, forces.uneven or Portions.none(d)
    return BoundCells(
        size,
        law,
        put(sigma, local.sigma),
        {pair: put(tau, local.shear[pair]) for pair, tau in shear.items()},
        body / size**d,
        put(beside, np.where(local.beside >= 0, agent[local.beside], -1)),
        put(np.tile(kind, (2 * d, 1)), local.kind),
        put(np.zeros(n, dtype=np.bool_), local.uneven),
        hanging._replace(box=agent[hanging.box], fine=agent[hanging.fine]),
        loads,
        [held._replace(box=agent[held.box]) for held in local.held],
        [bed._replace(box=agent[bed.box]) for bed in local.beds],
        _mesh(corner, size, start, local.mesh, agent, inner),
        put(moved, local.moved),
        portions._replace(box=own.ravel()[portions.box]),
    )


def _mesh(corner: Ints, size: Floats, start: Floats, local: Mesh, agent: Ints, inner: Ints) -> Mesh:
    """Return the nodes: those at lower corners of agents are numbered like these."""
    # `local` are the nodes of a window of some `agent`s, of which it gives those `inner`.
    n, inside = len(size), len(agent)
    more = np.arange(inside, len(local.owner))  # parts of boxes that are cut
    element = np.concatenate([agent, n + np.arange(len(more))])
    from_window = np.concatenate([inner, more])
    node = np.full(len(local.start), -1)
    node[local.corner[0]] = agent
    seen = np.zeros(len(local.start), dtype=np.bool_)
    seen[local.element[:, from_window]] = True
    used = np.flatnonzero(seen)
    fresh = used[node[used] < 0]
    node[fresh] = n + np.arange(len(fresh))
    start = np.concatenate([start, np.empty((len(fresh), start.shape[1]))])
    start[node[used]] = local.start[used]
    corner[:, agent[inner]] = node[local.corner[:, inner]]
    elements = np.concatenate([corner, np.empty((len(corner), len(more)), np.int64)], axis=1)
    elements[:, element[from_window]] = node[local.element[:, from_window]]
    parts = np.tile(np.arange(n), (len(corner), 1))
    parts[:, agent[inner]] = element[local.parts[:, inner]]
    edge = np.concatenate([size, np.empty(len(more))])
    edge[element] = local.edge
    owner = np.concatenate([np.arange(n), agent[local.owner[more]]])
    return Mesh(corner, elements, owner, edge, parts, node[local.slave], node[local.masters], start)


def _plain(
    faces: list[Floats], at: Ints, step: Ints, size: Floats, law: Moduli
) -> tuple[Floats, dict[Pair, Floats], Floats, Floats]:
    """Return stresses, displacements of sides, and of lower corners, of regular agents."""
    # `faces` are the displacements by places, `at` the places of the agents, and `step` how far
    # these are apart along every axis.
    d = len(faces)
    moved = np.stack([faces[a][at + end * step[a]] for a in range(d) for end in (0, 1)])
    sigma = normal_stress(law, (moved[1::2] - moved[::2]) / size)
    shear, start = {}, np.empty((len(at), d))
    for a, b in axis_pairs(d):
        turn = faces[a] - np.roll(faces[a], step[b]) + faces[b] - np.roll(faces[b], step[a])
        ends = np.add.outer([0, step[a]], [0, step[b]])
        shear[a, b] = turn[at + ends[..., None]] * (law.shear / size)
    for a, mean in enumerate(faces):
        for b in (b for b in range(d) if b != a):
            mean = 0.5 * (mean + np.roll(mean, step[b]))
        start[:, a] = mean[at]
    return sigma, shear, moved, start


@cache
def _touching(d: int) -> Floats:
    """Tell which agents of a block touch the neighbours at all `offsets`, shape (3^d, agents)."""
    step = offsets(d)[:, None]
    last = np.where(step > 0, ACROSS - 1, 0)
    return np.asarray(np.all((step == 0) | (corners(d) == last), axis=2).astype(np.float32))


@cache
def _stepped(d: int, step: tuple[int, ...]) -> tuple[Ints, Ints]:
    """Return in which of a block's neighbours the agents a step on are, and their numbers there."""
    place = corners(d) + step
    number = np.empty((ACROSS,) * d, dtype=np.int64)
    number[tuple(corners(d).T)] = np.arange(len(place))
    return (place // ACROSS + 1) @ 3 ** np.arange(d), number[tuple((place % ACROSS).T)]
