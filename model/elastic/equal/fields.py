"""What follows from the faces' displacements: values at nodes, in cells and anywhere; scaled."""

from __future__ import annotations

from functools import reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints, moved, spread
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.named_supports import support_names, supports_inside
from kaju.model.results.cuts import resultants
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import FOUNDATION, RIGID, ROLLER

from . import staggered
from .problem import ABSENT, ACTIVE, FIXED, ElasticProblem, FaceFields
from .staggered import Strains, cell_modulus, cut, ends, internal_force, padded, stresses


def node_displacement(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of the cells' corners (scaled), shape (n + 1, ..., dimension)."""
    # A node's displacement is the mean of the faces round it. At a free surface, where faces lie on
    # one side only, it is prolonged half a cell (see `_edge_values`). Nodes without body get NaN.
    d = problem.dimension
    nodes = []
    for axis in range(d):
        routes = []
        for across in (a for a in range(d) if a != axis):
            field, wall = _edge_values(problem, u, axis, across)
            for third in (a for a in range(d) if a not in (axis, across)):
                field, wall = _between(field, third, wall)
            routes.append(field[problem.inner])
        nodes.append(sum(routes[1:], start=routes[0]) / len(routes))
    return np.stack(nodes, axis=-1)


def corner_energies(nodes: Floats, body: Flags, moduli: Moduli) -> Floats:
    """Return each cell's energy (scaled) of the corners' displacement, multilinear in the body.

    By the points of Gauss; the change of volume is that of the cell's middle, or it would lock. NaN
    for cells ten times as stiff as one beside them, with which they share corners, and at corners
    that are all that joins cells.
    """
    d = body.ndim
    steps = np.array([*product((0, 1), repeat=d)])
    parts = [tuple(slice(e, e + n) for e, n in zip(p, body.shape, strict=True)) for p in steps]
    corners = np.stack([nodes[part][body] for part in parts], axis=1).reshape(len(moduli.shear), -1)
    softest = np.full(nodes.shape[:-1], np.inf)
    for part in parts:
        softest[part] = np.minimum(softest[part], spread(moduli.shear, body, np.inf))
    softest[_hinges(body)] = 0.0
    beside = np.min([softest[part][body] for part in parts], axis=0)
    size = corners.shape[1]
    sheared, swelling = np.zeros((size, size)), np.zeros(size)
    for at in product((0.5 - 12**-0.5, 0.5 + 12**-0.5), repeat=d):
        along = np.eye(d, dtype=np.bool_)[:, None]
        weight = np.where(steps, at, 1.0 - np.array(at))
        slope = np.where(along, 2.0 * steps - 1.0, weight).prod(axis=2)
        slopes = np.einsum("jc,ik->ijck", slope, np.eye(d)).reshape(d, d, size)
        strain = 0.5 * (slopes + np.swapaxes(slopes, 0, 1)).reshape(-1, size)
        sheared += strain.T @ strain / 2**d
        swelling += np.einsum("iik->k", slopes) / 2**d
    energy = moduli.shear * np.einsum("nk,nk->n", corners @ sheared, corners)
    energy += 0.5 * moduli.lateral * (corners @ swelling) ** 2
    return np.where(moduli.shear <= 10.0 * beside, energy, np.nan)


def _hinges(body: Flags) -> Flags:
    """Tell at which corners cells of a body meet that no faces join there."""
    # Cells round a corner, less what joins two, more what joins four, less all: the parts they are.
    parts: Any = 0
    for spans in product((0, 1), repeat=body.ndim):
        joined = np.pad(body, 1)
        for axis in np.flatnonzero(spans).tolist():
            joined = np.logical_and(*ends(joined, axis))
        number = joined.astype(np.int64)
        for axis in np.flatnonzero(np.equal(spans, 0)).tolist():
            number = np.add(*ends(number, axis))
        parts = parts + (-1) ** sum(spans) * number
    return np.asarray(parts > 1)


def _edge_values(
    problem: ElasticProblem, u: FaceFields, axis: int, across: int
) -> tuple[Floats, Flags]:
    """Return one component's displacement on the edges between two axes, and which are walls."""
    # At a free surface the displacement half a cell beyond the last face follows from its slope.
    # The shear γ there is known (that of the load, or none), so the slope is γ − ∂u_n/∂s; the line
    # through the last two faces gives a second one, a cell deeper. Their mean is taken.
    states = problem.face_states
    field = np.where(states[axis] == ABSENT, np.nan, u[axis])
    # Ghosts inside rigid ground, or at its edge, are the wall's own.
    below, above = ends(padded(problem.kinds, (axis,)), axis)
    walls = ((below == RIGID) | (above == RIGID)) & (below < 0) & (above < 0)
    values, wall = _between(field, across, walls)
    before, after = _sides(np.where(states[across] == ABSENT, np.nan, u[across]), axis)
    low, high = _sides(field, across)
    free = _sides(np.where(states[axis] == ACTIVE, 1.0, np.nan), across)
    one_sided = (np.isnan(low) != np.isnan(high)) & ~(np.isnan(free[0]) & np.isnan(free[1]))
    at = np.nonzero(one_sided)
    slope = before[at] - after[at]
    pair = (min(axis, across), max(axis, across))
    if pair in problem.surface_shear:
        shear = cell_modulus(problem, problem.moduli.shear)
        around = np.where(shear > 0, shear, np.nan)
        for a in pair:
            around = np.fmax(*_sides(around, a))
        given = problem.surface_shear[pair][at] / around[at]
        slope = np.where(np.isnan(around[at]), 0.0, given) + slope
    surface = np.where(np.isnan(high[at]), low[at] + 0.5 * slope, high[at] - 0.5 * slope)
    values[at] = np.where(np.isnan(surface), values[at], 0.5 * (values[at] + surface))
    return values, wall


def _sides(
    field: NDArray[Any], axis: int, beyond: float = np.nan
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the neighbours below and above every place between faces, and beyond the ends."""
    return ends(padded(field, (axis,), beyond), axis)


def _between(field: Floats, axis: int, wall: Flags) -> tuple[Floats, Flags]:
    """Return values half-way between neighbours along an axis, prolonged at the ends of a body."""
    # Beside a wall the wall's own value holds, for it lies half a cell nearer than a face.
    line, count = padded(padded(field, (axis,), np.nan), (axis,), np.nan), field.shape[axis] + 1
    parts = [line[cut(field.ndim, axis, slice(k, k + count))] for k in range(4)]
    low_wall, high_wall = _sides(wall, axis, False)
    mean = 0.5 * (parts[1] + parts[2])
    at = np.nonzero(low_wall != high_wall)
    mean[at] = np.where(low_wall[at], parts[1][at], parts[2][at])
    at = np.nonzero(np.isnan(mean))
    before, low, high, after = (part[at] for part in parts)
    from_low = np.where(np.isnan(before), low, 1.5 * low - 0.5 * before)
    from_high = np.where(np.isnan(after), high, 1.5 * high - 0.5 * after)
    mean[at] = np.where(np.isnan(high), from_low, from_high)
    return mean, low_wall | high_wall


def cell_means(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of the cells' middles (scaled); NaN outside of the body."""
    means = np.stack([_mean_along(v, a)[problem.inner] for a, v in enumerate(u)], axis=-1)
    means[problem.kinds[problem.inner] < 0] = np.nan
    return means


def stress_parts(problem: ElasticProblem, u: FaceFields) -> Strains:
    """Return stresses (scaled) of cells per axis and of edges per pair, without the ghost layer."""
    stress = stresses(problem, staggered.strains(u))
    edges = {}
    for pair, tau in stress.edges.items():
        edges[pair] = np.asarray(tau + problem.surface_shear.get(pair, 0.0))[problem.inner]
    return Strains(tuple(s[problem.inner] for s in stress.cells), edges)


def cell_tensor(problem: ElasticProblem, parts: Strains, kept: Any = ...) -> Floats:
    """Return stress tensors of the cells: normal stresses, and the mean shear of their edges."""
    # Of all, or of those kept; NaN outside of the body.
    d, kinds = problem.dimension, problem.kinds[problem.inner][kept]
    tensor = np.empty((*kinds.shape, d, d))
    for axis in range(d):
        tensor[..., axis, axis] = parts.cells[axis][kept]
    for a, b in staggered.axis_pairs(d):
        tau = reduce(_mean_along, (a, b), parts.edges[a, b])[kept]
        tensor[..., a, b] = tensor[..., b, a] = tau
    tensor[kinds < 0] = np.nan
    return tensor


def _mean_along(values: Floats, axis: int) -> Floats:
    low, high = ends(values, axis)
    return np.asarray(0.5 * (low + high))


def at_nodes(nodes: Floats, cells: Ints, local: Floats) -> Floats:
    """Interpolate linearly between the nodes of the cell that each point lies in."""
    # `local` is the place within the cell, 0 to 1 along every axis.
    total: Floats = np.zeros((len(cells), nodes.shape[-1]))
    for corner in product((0, 1), repeat=cells.shape[1]):
        weight = np.prod(np.where(corner, local, 1.0 - local), axis=1)
        total += weight[:, None] * nodes[tuple((cells + corner).T)]
    return total


def stress_at(parts: Strains, kinds: NDArray[np.int32], cells: Ints, local: Floats) -> Floats:
    """Return stress tensors at points, shape (points, dimension, dimension)."""
    # Normal stresses run linearly from the cell's middle, by the differences to neighbours of the
    # same material; shear stresses between the cell's edges.
    d = cells.shape[1]
    tensor = np.zeros((len(cells), d, d))
    for axis in range(d):
        tensor[:, axis, axis] = _along_slopes(parts.cells[axis], kinds, cells, local)
    for (a, b), tau in parts.edges.items():
        corners = np.array([[moved(moved(cells, a, i), b, j) for j in (0, 1)] for i in (0, 1)])
        around = tau[tuple(np.moveaxis(corners, -1, 0))]
        low, high = (1.0 - local[:, b]) * around[:, 0] + local[:, b] * around[:, 1]
        tensor[:, a, b] = tensor[:, b, a] = (1.0 - local[:, a]) * low + local[:, a] * high
    return tensor


def _along_slopes(stress: Floats, kinds: NDArray[np.int32], cells: Ints, local: Floats) -> Floats:
    own, kind = stress[tuple(cells.T)], kinds[tuple(cells.T)]
    total: Floats = own.copy()
    for axis in range(cells.shape[1]):
        rise, count = np.zeros(len(cells)), np.zeros(len(cells))
        for step in (-1, 1):
            at = cells.copy()
            at[:, axis] = np.clip(at[:, axis] + step, 0, kinds.shape[axis] - 1)
            there = tuple(at.T)
            same = (kinds[there] == kind) & (at[:, axis] != cells[:, axis])
            rise += np.where(same, step * (stress[there] - own), 0.0)
            count += same
        total += (local[:, axis] - 0.5) * rise / np.maximum(count, 1)
    return total


def reactions(
    problem: ElasticProblem,
    u: FaceFields,
    scene: Scene,
    origin: tuple[int, ...] | Ints,
    counted: tuple[Flags, ...] | None = None,
) -> dict[str, Floats]:
    """Return the force of every support on the body, then its couple, by `support_names`.

    See `resultants`; scaled. `origin` is the scene's cell that is the arrays' first; `counted`
    are the faces that count, if the cells are a part of a body.
    """
    found: list[Any] = []
    kinds, nothing, shape = problem.kinds, 2 * problem.dimension, scene.lattice.shape
    side, names = np.full(kinds.shape, -1, dtype=np.int16), support_names(scene)
    inner = np.nonzero(np.isin(kinds, (RIGID, ROLLER)))
    # counted from the end, below all sides
    side[inner] = supports_inside(scene, np.transpose(inner) - 1 + origin) - len(names)
    for index in range(nothing):
        axis, upper = divmod(index, 2)
        end = origin[axis] + problem.shape[axis] == shape[axis]
        # Ends of arrays that were cut to the body are no sides: cells inside may hold it there.
        if end if upper else origin[axis] == 0:
            np.moveaxis(side, axis, 0)[-upper] = index
    holding = np.where(np.isin(kinds, (RIGID, ROLLER, FOUNDATION)), side, nothing)
    for axis, force in enumerate(internal_force(problem, u)):
        held, spring = problem.face_states[axis] == FIXED, problem.spring[axis]
        at = np.nonzero((held | (spring > 0.0)) & (True if counted is None else counted[axis]))
        # The load on a fixed face goes straight into the support.
        pull = np.where(held[at], force[at] - problem.force[axis][at], -spring[at] * u[axis][at])
        # The side whose cells hold a face; below 0 if cells inside the array do.
        owner = np.minimum(*(side[at] for side in _sides(holding, axis, nothing)))
        place = np.transpose(at) - 1.0 + 0.5 * (np.arange(problem.dimension) != axis)
        # The body is held where it ends, not at faces within a support or half a cell beyond it.
        on = np.logical_or(*(body[at] for body in _sides(kinds >= 0, axis, False)))
        spot = np.where(on[:, None], place, np.nan)
        found.append((owner, place, np.full(len(pull), axis), pull, spot))
    of, place, along, pull, spot = (np.concatenate(one) for one in zip(*found, strict=True))
    some = np.isin(of, of[pull != 0.0])
    half = 0.5 * (np.arange(problem.dimension) != along[some, None])
    spots = np.concatenate([spot[some] - half, spot[some] + half])
    of, along, pull = (np.tile(one[some], 2) for one in (of, along, 0.5 * pull))
    place = np.tile(place[some], (2, 1))
    return resultants(names, of, place, along, pull, spots)
