"""The adaptive peer: triangles or tetrahedra of scikit-fem, refined where residuals are large.

The square of an element's error in the energy norm is estimated by what its stress leaves
unbalanced inside, and by the jumps of traction on its sides (Babuška & Rheinboldt 1978;
Verfürth, A Posteriori Error Estimation Techniques, 2013, ch. 1; here for elasticity):

    η² = h²/2μ ∫ |f + div σ|² + Σ h_F/2μ ∫ |jump|²

where a jump counts half for either neighbour, and on a free side is t − σn. Elements whose
error is more than half the largest are refined.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt
from typing import Any

import numpy as np

from kaju.agents.elastic_rule import Moduli
from kaju.arrays import Floats
from kaju.model.scene import Scene
from kaju.model.study.finite_elements import (
    ElementField,
    Index,
    cell_mesh,
    densities,
    depth,
    held,
    multigrid,
    solve_on,
    surroundings,
)

from .finite_elements import RESIDUAL

SHARE = 0.5
"""Elements with more than this share of the largest η are refined."""
DIRECT = {2: 30_000, 3: 5_000}
"""Up to this many unknowns `scipy.sparse.linalg.spsolve` is quicker than pyamg."""


def solve_elements(scene: Scene, mesh: Any, order: int = 1) -> ElementField:
    """Solve a scene on triangles or tetrahedra that are laid in cells.

    Parameters
    ----------
    mesh : skfem mesh
        Made of `cell_mesh` by refinement.
    order : {1, 2}
        Of the polynomials.
    """
    import skfem

    elements = {
        2: (skfem.ElementTriP1, skfem.ElementTriP2),
        3: (skfem.ElementTetP1, skfem.ElementTetP2),
    }
    element = elements[mesh.dim()][order - 1]()
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2 * order - 1)

    def solve(matrix: Any, right: Floats, motions: Floats) -> Floats:
        if len(right) <= DIRECT[mesh.dim()]:
            from scipy.sparse.linalg import spsolve

            return np.asarray(spsolve(matrix.tocsc(), right))
        return multigrid(matrix.tocsr(), right, motions, RESIDUAL)

    return solve_on(scene, basis, surroundings(scene), solve)


def adaptive(scene: Scene, order: int = 1) -> Iterator[tuple[ElementField, float]]:
    """Yield answers on meshes refined where residuals are large, and their estimated error.

    The error is relative, in the energy norm.
    """
    mesh = cell_mesh(surroundings(scene))
    while True:
        answer = solve_elements(scene, mesh, order)
        square = squared_errors(scene, answer)
        yield answer, sqrt(square.sum() / (2.0 * answer.energy))
        mesh = mesh.refined(np.flatnonzero(square > SHARE**2 * square.max()))


def squared_errors(scene: Scene, answer: ElementField) -> Floats:
    """Return η² of every element (J)."""
    import skfem

    basis, mesh = answer.basis, answer.basis.mesh
    unit = 2.0 * depth(scene) * answer.moduli.shear
    facets = mesh.boundary_facets()
    traction, weight = densities(scene, mesh, facets)

    vertices = skfem.Basis(mesh, basis.elem, quadrature=_at_corners(mesh.dim()))
    stress = _stress(scene, answer.moduli, vertices.interpolate(answer.displacement).grad)
    left = weight + _divergence(mesh, stress)
    size = basis.dx.sum(axis=1) ** (1.0 / mesh.dim())
    total: Floats = size**2 * basis.dx.sum(axis=1) * (left**2).sum(axis=0) / unit

    sides = [skfem.InteriorFacetBasis(mesh, basis.elem, side=side) for side in (0, 1)]
    pulls = [_traction(scene, answer, side) for side in sides]
    jump = _length(sides[0]) * (((pulls[0] - pulls[1]) ** 2).sum(axis=0) * sides[0].dx).sum(axis=1)
    for side in sides:
        np.add.at(total, side.tind, 0.5 * jump / unit[side.tind])

    free = _free_components(basis, facets, answer, surroundings(scene))
    surface = skfem.FacetBasis(mesh, basis.elem, facets=facets)
    left = traction[..., None] - _traction(scene, answer, surface)
    left = np.where(free[..., None], left, 0.0)
    jump = _length(surface) * ((left**2).sum(axis=0) * surface.dx).sum(axis=1)
    np.add.at(total, surface.tind, jump / unit[surface.tind])
    return total


def _at_corners(dimension: int) -> tuple[Floats, Floats]:
    corners = np.concatenate([np.zeros((dimension, 1)), np.eye(dimension)], axis=1)
    return corners, np.ones(dimension + 1)


def _stress(scene: Scene, moduli: Moduli, gradient: Floats) -> Floats:
    """Return stresses times `depth`, as forces per area in cells; shape of the gradient."""
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    volume = moduli.lateral[:, None] * np.trace(strain)
    unit = np.eye(len(gradient))[:, :, None, None]
    return depth(scene) * (2.0 * moduli.shear[:, None] * strain + unit * volume)


def _divergence(mesh: Any, stress: Floats) -> Floats:
    """Return the divergence of stresses that run linearly between the corners of elements."""
    slopes = mesh.mapping().invDF(_at_corners(mesh.dim())[0][:, :1])[..., 0]
    grown = stress[..., 1:] - stress[..., :1]
    return np.einsum("abek,kbe->ae", grown, slopes)


def _traction(scene: Scene, answer: ElementField, side: Any) -> Floats:
    moduli = Moduli(*(modulus[side.tind] for modulus in answer.moduli))
    stress = _stress(scene, moduli, np.asarray(side.interpolate(answer.displacement).grad))
    return np.einsum("abfq,bfq->afq", stress, side.normals)


def _length(side: Any) -> Floats:
    return side.dx.sum(axis=1) ** (1.0 / (side.mesh.dim() - 1))


def _free_components(basis: Any, facets: Index, answer: ElementField, kinds: Index) -> Any:
    """Tell which components of traction are given on facets of the boundary."""
    fixed = np.zeros(basis.N, dtype=np.bool_)
    fixed[held(basis, kinds)] = True
    # A component is held where it is at all corners of a facet.
    corner = basis.nodal_dofs[:, basis.mesh.facets[:, facets]]
    return ~fixed[corner].all(axis=1)
