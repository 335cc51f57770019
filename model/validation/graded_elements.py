"""The truth of plane scenes: finite elements of high order, graded to every singular point.

Triangles that get ever smaller towards re-entrant corners, ends of supports and loads, and
corners of materials; polynomials of order 4 on them. Nothing of kaju's own solvers is used but
the scene and its moduli. Needs scikit-fem.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.scene import Scene
from kaju.model.scene.kinds import RIGID, ROLLER

from .scene_elements import ElementAnswer, Index, answer_of, cell_mesh, surroundings

NEAR = 1e-9
"""Forces that differ by less than this share are the same."""


def solve_graded(scene: Scene, levels: int, order: int = 4) -> ElementAnswer:
    """Solve a plane scene of square cells.

    Parameters
    ----------
    scene : Scene
        Not too many cells: each becomes four triangles and more. Sides are free, rigid or
        rollers.
    levels : int
        How often the triangles around every singular point are halved.
    order : {1, 2, 3, 4}
        Of the polynomials.

    Raises
    ------
    ParameterError
        If the scene is none of these.
    """
    import skfem

    kinds = surroundings(scene)
    mesh = graded_mesh(kinds, singular_points(scene, kinds), levels)
    elements = (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3, skfem.ElementTriP4)
    basis = skfem.Basis(mesh, skfem.ElementVector(elements[order - 1]()))
    return answer_of(scene, basis, kinds)


def singular_points(scene: Scene, kinds: Index) -> Floats:
    """Return where stresses or their slopes are unbounded, in cells of the scene.

    Around a grid point that is not on a straight surface, support or interface the four
    cells do not pair up; and the loads on two surface faces in line may differ.

    Raises
    ------
    ParameterError
        If the scene is not plane.
    """
    if scene.lattice.dimension != 2:
        raise ParameterError("scene: graded triangles need a plane body, got three dimensions")
    a, b, c, d = kinds[:-1, :-1], kinds[1:, :-1], kinds[:-1, 1:], kinds[1:, 1:]
    four = np.stack([a, b, c, d])
    straight = ((a == b) & (c == d)) | ((a == c) & (b == d))
    solid = (four >= 0).sum(axis=0)
    on_ground = np.isin(four, (RIGID, ROLLER)).any(axis=0)
    # Two free sides at a right angle bend nothing; neither does a place without a body.
    plain = straight | (solid == 0) | ((solid == 1) & ~on_ground)
    return np.unique(np.concatenate([np.argwhere(~plain), _ends_of_loads(scene)]), axis=0) + 0.0


def _ends_of_loads(scene: Scene) -> Index:
    applied = scene.applied()
    traction: dict[tuple[int, ...], Floats] = {}
    for cell, way, force in zip(applied.cells, applied.direction, applied.force, strict=True):
        if way >= 0:
            key = (int(way), *map(int, cell))
            traction[key] = traction.get(key, 0.0) + force
    ends = []
    for (way, *cell), force in traction.items():
        axis, upper = divmod(way, 2)
        for step in (-1, 1):
            beside = list(cell)
            beside[1 - axis] += step
            other = traction.get((way, *beside), np.zeros(2))
            if np.abs(other - force).max() > NEAR * np.abs(force).max():
                end = list(cell)
                end[axis] += upper
                end[1 - axis] += step == 1
                ends.append(end)
    return np.array(ends, dtype=np.int64).reshape(-1, 2)


def graded_mesh(kinds: Index, singular: Floats, levels: int) -> Any:
    """Return triangles on the body's cells, halved `levels` times around singular points."""
    from scipy.spatial import cKDTree

    mesh = cell_mesh(kinds)
    tree = cKDTree(singular)
    for _ in range(levels):
        sharp = np.equal(tree.query(mesh.p.T)[0], 0.0)
        mesh = mesh.refined(np.flatnonzero(sharp[mesh.t].any(axis=0)))
    return _parted(mesh, kinds)


def _parted(mesh: Any, kinds: Index) -> Any:
    """Give cells that touch at a corner only a point each: one point holds nothing together."""
    body = kinds >= 0
    a, b, c, d = body[:-1, :-1], body[1:, :-1], body[:-1, 1:], body[1:, 1:]
    apart = (a & d & ~b & ~c) | (b & c & ~a & ~d)
    p, t = mesh.p, mesh.t.copy()
    middle = p[0][t].mean(axis=0)
    for place in np.argwhere(apart):
        (number,) = np.flatnonzero((p[:, : mesh.p.shape[1]] == place[:, None]).all(axis=0))
        t[:, middle > place[0]] = np.where(
            t[:, middle > place[0]] == number, p.shape[1], t[:, middle > place[0]]
        )
        p = np.concatenate([p, p[:, [number]]], axis=1)
    return type(mesh)(p, t) if apart.any() else mesh
