"""The peer: bilinear (trilinear) finite elements of scikit-fem on the same cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from kaju.arrays import Flags, Floats
from kaju.factors import rigid_motions

from .problems import Problem

RESIDUAL = 1e-6
"""Relative residual at which the iteration ends: well below the error of these grids."""


def solve(
    problem: Problem, division: int, solver: Literal["direct", "multigrid"]
) -> Callable[[], Floats]:
    """Solve a problem and return a function that looks the displacements up.

    Parameters
    ----------
    problem : Problem
    division : int
        Elements per edge of a cell of the picture; even, so that its middle is a node.
    solver : {"direct", "multigrid"}
        `scipy.sparse.linalg.spsolve`, or conjugate gradients with pyamg's smoothed
        aggregation, which is given the rigid body modes.
    """
    basis = _basis(problem, division)
    matrix, load = _stiffness(problem, basis), _load(problem, basis)
    held = basis.get_dofs(lambda x: x[-1] < 1e-9 * problem.edge).flatten()
    free = np.setdiff1d(np.arange(basis.N), held)
    reduced, right = matrix[free][:, free], load[free]
    u = np.zeros(basis.N)
    if solver == "direct":
        from scipy.sparse.linalg import spsolve

        u[free] = spsolve(reduced.tocsc(), right)
    else:
        blocks = reduced.tobsr((problem.dimension, problem.dimension))
        u[free] = iterated(blocks, right, rigid_body_modes(basis.doflocs)[free])
    return lambda: _at(problem, basis, u)


def _basis(problem: Problem, division: int) -> Any:
    import skfem

    size = problem.edge / division
    grid = [size * np.arange(n * division + 1) for n in problem.picture.shape]
    kind = skfem.MeshQuad if problem.dimension == 2 else skfem.MeshHex
    mesh = kind.init_tensor(*grid)
    if not problem.picture.all():
        middle = mesh.p[:, mesh.t].mean(axis=1)
        cells = tuple(np.floor(middle / problem.edge).astype(np.int64))
        mesh = mesh.restrict(np.flatnonzero(problem.picture[cells]))
    linear = skfem.ElementQuad1() if problem.dimension == 2 else skfem.ElementHex1()
    return skfem.Basis(mesh, skfem.ElementVector(linear), intorder=2)


def _stiffness(problem: Problem, basis: Any) -> Any:
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    lame, shear = lame_parameters(problem.youngs_modulus, problem.poissons_ratio)
    if problem.dimension == 2:  # plane stress
        lame = 2.0 * lame * shear / (lame + 2.0 * shear)
    stiffness: skfem.BilinearForm = linear_elasticity(lame, shear)
    return problem.thickness * stiffness.assemble(basis)


def _load(problem: Problem, basis: Any) -> Floats:
    import skfem

    lower, upper = (np.asarray(corner) for corner in problem.patch)
    near = 1e-9 * problem.edge

    def pressed(x: Floats) -> Flags:
        within = [(a - near < c) & (c < b + near) for a, c, b in zip(lower, x, upper, strict=True)]
        return np.asarray(np.logical_and.reduce(within))

    facets = basis.mesh.facets_satisfying(pressed, boundaries_only=True)
    side = skfem.FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=2)
    traction = problem.force / float(np.prod((upper - lower)[:-1]))
    return skfem.LinearForm(lambda v, w: -traction * v[-1]).assemble(side)


def rigid_body_modes(places: Floats) -> Floats:
    """Return all shifts and turns, which strain nothing.

    Parameters
    ----------
    places : array, shape (dimension, n)
        Where each unknown is (m); the components of a node follow one another.

    Returns
    -------
    array, shape (n, 3) in the plane, (n, 6) in space
    """
    axis = np.arange(places.shape[1]) % len(places)
    return rigid_motions(places.T, axis)


def iterated(matrix: Any, right: Floats, modes: Floats, residual: float = RESIDUAL) -> Floats:
    """Solve by conjugate gradients with pyamg's smoothed aggregation; modes: rigid ones."""
    import pyamg

    hierarchy = pyamg.smoothed_aggregation_solver(matrix, B=modes)
    return hierarchy.solve(right, tol=residual, accel="cg", maxiter=2000)


def _at(problem: Problem, basis: Any, u: Floats) -> Floats:
    from scipy.spatial import cKDTree

    _, vertex = cKDTree(basis.mesh.p.T).query(problem.points)
    return u[basis.nodal_dofs[:, vertex]].T
