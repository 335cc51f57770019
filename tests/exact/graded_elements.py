"""Triangles graded towards every singular point: the truth of plane bodies, by scikit-fem."""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju import Scene
from kaju.arrays import Floats
from kaju.model.scene.cell_types import RIGID, ROLLER
from kaju.model.study.finite_elements import (
    ElementReference,
    Index,
    separated,
    solve_on,
    surroundings,
    within_body,
)

NEAREST = 16  # elements that are asked first for a point
ROUNDING = 1e-9


def graded_elements(scene: Scene, *, order: int = 3, levels: int = 8) -> ElementReference:
    """Solve a plane scene by four triangles a cell, halved `levels` times at singular points."""
    import skfem

    kinds = surroundings(scene)
    mesh = graded_mesh(kinds, singular_points(scene, kinds), levels)
    # Exact for products of slopes and for loads that are uniform in an element.
    element = skfem.ElementVector(getattr(skfem, f"ElementTriP{order}")())
    basis = skfem.Basis(mesh, element, intorder=max(2 * order - 2, order))
    words = f"triangles of order {order}, {levels} times halved"
    return solve_on(scene, basis, kinds, lambda place: _triangle_at(basis, place), words)


def _triangle_at(basis: Any, place: Floats) -> Index:
    """Return the element that holds each place, or comes closest to it.

    The mesh's own finder makes no allowance for rounding, which counts in triangles of 1e-5.
    """
    from scipy.spatial import cKDTree

    corners = basis.mesh.p[:, basis.mesh.t]

    def depth_within(places: Floats, elements: Index) -> Floats:
        # The smallest barycentric coordinate of each place, shape (1, places), in its elements.
        many = elements.shape[1]
        repeated = np.repeat(places, many, axis=1)[:, :, None]
        local = basis.mapping.invF(repeated, elements.ravel())[..., 0]
        smallest = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0))
        return np.asarray(smallest.reshape(-1, many))

    middles = corners.mean(axis=1).T
    ranks = np.arange(1, min(NEAREST, len(middles)) + 1)
    near = np.asarray(cKDTree(middles).query(place.T, ranks)[1], dtype=np.int64)
    inside = depth_within(place, near)
    found = near[np.arange(len(near)), inside.argmax(axis=1)]
    for lost in np.flatnonzero(inside.max(axis=1) < -ROUNDING):
        found[lost] = depth_within(place[:, [lost]], np.arange(len(middles))[None]).argmax()
    return found


def graded_mesh(kinds: Index, singular: Floats, levels: int) -> Any:
    """Return four triangles a cell, halved `levels` times around singular points (in cells)."""
    import skfem
    from scipy.spatial import cKDTree

    ticks = [np.arange(n - 1.0) for n in kinds.shape]
    mesh = within_body(skfem.MeshQuad.init_tensor(*ticks).to_meshtri(style="x"), kinds)
    corner = (singular == np.floor(singular)).all(axis=1)
    tree, within = cKDTree(singular[corner]), singular[~corner]
    for _ in range(levels if len(singular) else 0):
        near = np.equal(tree.query(mesh.p.T)[0], 0.0)[mesh.t].any(axis=0)
        facets = mesh.boundary_facets()  # some points lie within the side of a cell
        ends = mesh.p[:, mesh.facets[:, facets]]
        low, high = ends.min(axis=1).T - ROUNDING, ends.max(axis=1).T + ROUNDING
        for point in within:
            there = ((point >= low) & (point <= high)).all(axis=1)
            near[mesh.f2t[0, facets[there]]] = True
        mesh = mesh.refined(np.flatnonzero(near))
    return separated(mesh)


def singular_points(scene: Scene, kinds: Index) -> Floats:
    """Return where stresses or their slopes are unbounded in a plane scene, in cells.

    Around a grid point that is not on a straight surface, support or interface the four
    cells do not pair up; and the loads on two surface faces in line may differ, or end within.
    """
    a, b, c, d = kinds[:-1, :-1], kinds[1:, :-1], kinds[:-1, 1:], kinds[1:, 1:]
    four = np.stack([a, b, c, d])
    straight = ((a == b) & (c == d)) | ((a == c) & (b == d))
    solid = (four >= 0).sum(axis=0)
    on_ground = np.isin(four, (RIGID, ROLLER)).any(axis=0)
    # Two free sides at a right angle bend nothing; neither does a place without a body.
    plain = straight | (solid == 0) | ((solid == 1) & ~on_ground)
    return np.unique(np.concatenate([np.argwhere(~plain), _ends_of_loads(scene)]), axis=0) + 0.0


def _ends_of_loads(scene: Scene) -> Floats:
    """Return the ends of faces whose traction is not that of the next face in line, in cells."""
    applied = scene.applied()
    on_face = applied.direction >= 0
    face = (applied.direction[on_face], *applied.cells[on_face].T)
    traction = np.zeros((4, *scene.lattice.shape, 2))
    np.add.at(traction, face, applied.force[on_face])
    ends = []
    for axis, upper in np.ndindex(2, 2):
        # Faces of one direction, those in line along the first axis; nothing before and after.
        lines = np.moveaxis(traction[2 * axis + upper], 1 - axis, 0)
        lines = np.pad(lines, [(1, 1), (0, 0), (0, 0)])
        size, step = np.abs(lines).max(axis=2), np.abs(np.diff(lines, axis=0)).max(axis=2)
        found = np.argwhere(step > ROUNDING * np.maximum(size[1:], size[:-1]))
        found[:, 1] += upper
        ends.append(found if axis else found[:, ::-1])
    if applied.uneven is not None:  # loads that begin or end within faces
        row, part, _ = applied.uneven
        axes, uppers = np.divmod(applied.direction[row], 2)
        within = applied.cells[row][:, None] + part
        within[np.arange(len(row)), :, axes] = (applied.cells[row, axes] + uppers)[:, None]
        ends.append(within[(within != np.floor(within)).any(axis=2)])
    return np.concatenate(ends)
