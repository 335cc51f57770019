"""What follows from the faces' displacements: values at nodes and cells, in SI units."""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from kaju.model.scene.kinds import RIGID

from .problem import ABSENT, ElasticProblem, FaceFields, Floats
from .staggered import Strains, axis_pairs, cut, strains, stresses


def node_displacement(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of the corners of the cells (scaled).

    A node's displacement is the mean of the faces round it. At a free surface, where faces
    lie on one side only, the line through the two nearest ones is prolonged. Nodes without
    body get NaN.

    Returns
    -------
    array, shape (n + 1 along every axis, dimension)
    """
    states = problem.face_states()
    nodes = []
    for axis, values in enumerate(u):
        field = np.where(states[axis] == ABSENT, np.nan, values)
        for across in range(problem.dimension):
            if across != axis:
                field = _between(field, across, _wall(problem, axis, across, field))
        inner = tuple(slice(1, -1) if a == axis else slice(None) for a in range(problem.dimension))
        nodes.append(field[inner])
    return np.stack(nodes, axis=-1)


def _wall(problem: ElasticProblem, axis: int, across: int, field: Floats) -> NDArray[np.bool_]:
    """Tell which values belong to ghost faces inside rigid ground."""
    rigid = problem.kinds == RIGID
    d = problem.dimension
    width = [(1, 1) if a == axis else (0, 0) for a in range(d)]
    padded = np.pad(rigid, width, mode="edge")
    wall = padded[cut(d, axis, slice(None, -1))] & padded[cut(d, axis, slice(1, None))]
    if wall.shape != field.shape:
        return np.zeros(field.shape, dtype=np.bool_)
    return np.asarray(wall, dtype=np.bool_)


def _between(field: Floats, axis: int, wall: NDArray[np.bool_]) -> Floats:
    """Return values half-way between neighbours along an axis, prolonged at the ends of a body.

    Beside a wall the wall's own value holds, for it lies half a cell nearer than a face.
    """
    lines = np.moveaxis(field, axis, 0)
    fixed = np.moveaxis(wall, axis, 0)
    gap = np.full((1, *lines.shape[1:]), np.nan)
    padded = np.concatenate([gap, lines, gap])
    low, high = padded[1:-2], padded[2:-1]
    low_wall, high_wall = fixed[:-1], fixed[1:]
    mean = 0.5 * (low + high)
    mean = np.where(low_wall & ~high_wall, low, np.where(high_wall & ~low_wall, high, mean))
    before, after = padded[:-3], padded[3:]
    from_low = np.where(np.isnan(before), low, 1.5 * low - 0.5 * before)
    from_high = np.where(np.isnan(after), high, 1.5 * high - 0.5 * after)
    mean = np.where(np.isnan(mean), np.where(np.isnan(high), from_low, from_high), mean)
    return np.moveaxis(mean, 0, axis)


def cell_means(problem: ElasticProblem, u: FaceFields) -> Floats:
    """Return the displacement of the cells' middles (scaled); NaN outside of the body.

    Returns
    -------
    array, shape (cells along every axis, dimension)
    """
    d = problem.dimension
    solid = problem.kinds[problem.inner] >= 0
    values = [
        0.5 * (v[cut(d, a, slice(None, -1))] + v[cut(d, a, slice(1, None))])[problem.inner]
        for a, v in enumerate(u)
    ]
    return np.where(solid[..., None], np.stack(values, axis=-1), np.nan)


def stress_parts(problem: ElasticProblem, u: FaceFields) -> Strains:
    """Return stresses (scaled) of cells per axis and of edges per pair, without the rim."""
    stress = stresses(problem, strains(u))
    edges = {}
    for pair, tau in stress.edges.items():
        whole = tau + problem.surface_shear.get(pair, 0.0)
        index = tuple(slice(1, -1) for _ in range(problem.dimension))
        edges[pair] = np.asarray(whole)[index]
    return Strains(tuple(s[problem.inner] for s in stress.cells), edges)


def cell_tensor(problem: ElasticProblem, parts: Strains) -> Floats:
    """Return stress tensors of the cells: normal stresses, and the mean shear of their edges.

    Returns
    -------
    array, shape (cells along every axis, dimension, dimension); NaN outside of the body
    """
    d = problem.dimension
    solid = problem.kinds[problem.inner] >= 0
    tensor = np.full((*problem.shape, d, d), np.nan)
    for axis in range(d):
        tensor[..., axis, axis] = np.where(solid, parts.cells[axis], np.nan)
    for a, b in axis_pairs(d):
        tau = reduce(_mean_along, (a, b), parts.edges[a, b])
        tensor[..., a, b] = tensor[..., b, a] = np.where(solid, tau, np.nan)
    return tensor


def _mean_along(values: Floats, axis: int) -> Floats:
    low, high = (cut(values.ndim, axis, s) for s in (slice(None, -1), slice(1, None)))
    return np.asarray(0.5 * (values[low] + values[high]))


def strain_tensor(problem: ElasticProblem, stress: Floats) -> Floats:
    """Return the strain tensors that belong to stress tensors (both scaled) of the cells."""
    d = problem.dimension
    kinds = np.maximum(problem.kinds[problem.inner], 0)
    shear, lateral, stretch = (
        getattr(problem.moduli, name)[kinds] for name in ("shear", "lateral", "stretch")
    )
    trace = np.trace(stress, axis1=-2, axis2=-1)
    # In d dimensions the trace of σ is (C₁₁ + (d−1)C₁₂) times the trace of ε.
    volume = trace / (stretch + (d - 1) * lateral)
    identity = np.eye(d)
    return np.asarray(
        (stress - (lateral * volume)[..., None, None] * identity) / (2 * shear)[..., None, None]
    )


def von_mises(stress: Floats, out_of_plane: Floats | float = 0.0) -> Floats:
    """Return the equivalent stress of von Mises.

    `out_of_plane` is σ_zz of two-dimensional tensors, zero in plane stress.
    """
    d = stress.shape[-1]
    normal = [stress[..., a, a] for a in range(d)] + ([out_of_plane] if d == 2 else [])
    shear = sum(stress[..., a, b] ** 2 for a, b in axis_pairs(d))
    x, y, z = normal
    return np.asarray(np.sqrt(0.5 * ((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) + 3 * shear))
