"""Pixel bodies in finite elements (scikit-fem): the independent answer.

Every pixel becomes split² (split³) quadrilaterals (hexahedra) of order 1 or 2. The body
stands clamped on its lower side. Forces press on faces of cells, as `CellLoads` says.
"""

from dataclasses import dataclass

import numpy as np
import skfem as fem
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, div, sym_grad

from kaju.model.elastic.moduli import moduli_of

ELEMENTS = {
    (2, 1): fem.ElementQuad1,
    (2, 2): fem.ElementQuad2,
    (3, 1): fem.ElementHex1,
    (3, 2): fem.ElementHex2,
}


@fem.BilinearForm
def volume_form(u, v, _):
    return div(u) * div(v)


@fem.BilinearForm
def strain_form(u, v, _):
    return 2 * ddot(sym_grad(u), sym_grad(v))


def stiffness(basis, lateral, shear):
    """Return the stiffness matrix; pixels are all alike, so that one element tells all."""
    one = fem.Basis(basis.mesh.restrict([0]), basis.elem)
    local = np.ix_(one.element_dofs[:, 0], one.element_dofs[:, 0])
    volume, strain = (f.assemble(one).toarray()[local] for f in (volume_form, strain_form))
    values = volume[..., None] * lateral + strain[..., None] * shear
    rows, columns = np.broadcast_arrays(basis.element_dofs[:, None], basis.element_dofs[None])
    shape = (basis.N, basis.N)
    return coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsc()


@dataclass(frozen=True)
class ElementAnswer:
    """Displacement of the elements' nodes and strain energy, for unit thickness."""

    basis: fem.Basis
    displacement: np.ndarray
    energy: float

    def displacement_at(self, points):
        """Return the displacement at points of the body, shape (n, dimension)."""
        basis = self.basis
        element = basis.mesh.element_finder(mapping=basis.mapping)(*points.T)
        local = basis.mapping.invF(points.T[:, :, None], tind=element)
        moved = np.zeros(points.shape)
        for k in range(basis.Nbfun):
            shape = np.asarray(basis.elem.gbasis(basis.mapping, local, k, tind=element)[0])
            moved += (shape[..., 0] * self.displacement[basis.element_dofs[k, element]]).T
        return moved


def pixel_mesh(kinds, cell_size, split):
    """Return the elements of the cells that are of a material, and each one's kind."""
    ticks = [cell_size / split * np.arange(split * n + 1) for n in kinds.shape]
    kind = fem.MeshQuad if kinds.ndim == 2 else fem.MeshHex
    whole = kind.init_tensor(*ticks)
    where = np.floor(whole.p[:, whole.t].mean(axis=1) / cell_size).astype(int)
    solid = np.flatnonzero(kinds[tuple(where)] >= 0)
    mesh = whole.restrict(solid)
    where = np.floor(mesh.p[:, mesh.t].mean(axis=1) / cell_size).astype(int)
    return mesh, kinds[tuple(where)]


def solve_elements(kinds, materials, cell_size, loads, *, plane=None, split=1, order=2):
    """Solve a pixel body that is clamped below; see `make_problem` for the arguments."""
    d = kinds.ndim
    mesh, kind = pixel_mesh(kinds, cell_size, split)
    basis = fem.Basis(mesh, fem.ElementVector(ELEMENTS[d, order]()))
    moduli = moduli_of(*np.array(materials, float).T, plane or (None if d == 3 else "stress"))
    matrix = stiffness(basis, moduli.lateral[kind], moduli.shear[kind])
    right = np.zeros(basis.N)
    for cell, direction, force in zip(*loads, strict=True):
        right += face_load(mesh, basis.elem, cell, int(direction), force, cell_size)
    free = basis.complement_dofs(basis.get_dofs(lambda x: x[-1] < 1e-9 * cell_size))
    u = np.zeros(basis.N)
    # The matrix is symmetric: so may be the order of elimination, which fills in far less.
    factors = splu(matrix[free][:, free], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    u[free] = factors.solve(right[free])
    return ElementAnswer(basis, u, 0.5 * float(u @ right))


def face_load(mesh, element, cell, direction, force, cell_size):
    """Return the load vector of a force spread over one face of a cell."""
    axis, upper = divmod(direction, 2)
    low, high = cell * cell_size, (cell + 1) * cell_size
    low[axis] = high[axis] = (cell[axis] + upper) * cell_size
    near = 1e-6 * cell_size
    middle = mesh.p[:, mesh.facets].mean(axis=1).T
    facets = np.flatnonzero(np.all((middle > low - near) & (middle < high + near), axis=1))
    side = fem.FacetBasis(mesh, element, facets=facets)
    traction = force / cell_size ** (mesh.dim() - 1)

    @fem.LinearForm
    def load(v, w):
        return sum(t * component for t, component in zip(traction, v, strict=True))

    return load.assemble(side)
