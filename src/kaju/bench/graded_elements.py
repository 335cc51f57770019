"""The truth of plane scenes: finite elements of high order, graded to every singular point.

Triangles that get ever smaller towards re-entrant corners, ends of supports and loads, and
corners of materials; polynomials of order 4 on them. Nothing of kaju's own solvers is used but
the scene and its moduli. Needs scikit-fem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.errors import ParameterError
from kaju.model.elasticity.moduli import moduli_of
from kaju.model.scene import Scene
from kaju.model.scene.kinds import DISPLACED, FOUNDATION, RIGID, ROLLER

Floats = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR = 1e-9
"""Places closer than this (cells) are the same."""


@dataclass(frozen=True, eq=False)
class ElementAnswer:
    """Displacements (m) of a mesh in cells of the scene, and the strain energy (J)."""

    basis: Any
    displacement: Floats
    energy: float
    cell_size: float

    @property
    def unknowns(self) -> int:
        """Number of displacement components."""
        return int(self.basis.N)

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both of shape (n, 2)."""
        return self._at(points)[0]

    def gradient_at(self, points: Floats) -> Floats:
        """Return ∂u_a/∂x_b at points (m) of the body, shape (n, 2, 2)."""
        return self._at(points)[1] / self.cell_size

    def _at(self, points: Floats) -> tuple[Floats, Floats]:
        basis, place = self.basis, points.T / self.cell_size
        element = basis.mesh.element_finder(mapping=basis.mapping)(*place)
        local = basis.mapping.invF(place[:, :, None], tind=element)
        moved, gradient = np.zeros((2, len(points))), np.zeros((2, 2, len(points)))
        for k in range(basis.Nbfun):
            shape = basis.elem.gbasis(basis.mapping, local, k, tind=element)[0]
            weight = self.displacement[basis.element_dofs[k, element]]
            moved += np.asarray(shape)[..., 0] * weight
            gradient += shape.grad[..., 0] * weight
        return moved.T, gradient.transpose(2, 0, 1)


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
    from skfem.helpers import ddot, div, sym_grad

    kinds = surroundings(scene)
    mesh = graded_mesh(kinds, singular_points(scene, kinds), levels)
    elements = (skfem.ElementTriP1, skfem.ElementTriP2, skfem.ElementTriP3, skfem.ElementTriP4)
    basis = skfem.Basis(mesh, skfem.ElementVector(elements[order - 1]()))
    materials = scene.cell_materials
    moduli = moduli_of(
        np.array([m.youngs_modulus for m in materials]),
        np.array([m.poissons_ratio for m in materials]),
        scene.plane,
    )
    kind = kinds[tuple(_cells_of(mesh) + 1)]
    law = {"lateral": moduli.lateral[kind][:, None], "shear": moduli.shear[kind][:, None]}

    @skfem.BilinearForm
    def stiffness(u: Any, v: Any, w: Any) -> Any:
        strain = ddot(sym_grad(u), sym_grad(v))
        return scene.thickness * (w.lateral * div(u) * div(v) + 2.0 * w.shear * strain)

    ones = np.ones_like(basis.dx)
    matrix = stiffness.assemble(basis, **{name: value * ones for name, value in law.items()})
    right = _load(scene, basis)
    u = np.zeros(basis.N)
    free = np.setdiff1d(np.arange(basis.N), _held(basis, kinds))
    u[free] = _direct(matrix[free][:, free].tocsc(), right[free])
    return ElementAnswer(basis, u, 0.5 * float(u @ right), scene.lattice.cell_size)


def _direct(matrix: Any, right: Floats) -> Floats:
    from scipy.sparse.linalg import splu

    # The matrix is symmetric: so may be the order of elimination, which fills in far less.
    found: Floats = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0).solve(right)
    return found


def surroundings(scene: Scene) -> Index:
    """Return the kinds of all cells and of one row of cells around them."""
    if scene.lattice.kind != "square":
        raise ParameterError(
            f"scene: graded elements need square cells, got lattice {scene.lattice.kind!r}"
        )
    cells = np.stack(
        np.meshgrid(*[np.arange(-1, n + 1) for n in scene.lattice.shape], indexing="ij"), axis=-1
    )
    kinds = np.asarray(scene.kinds(cells.reshape(-1, 2))).reshape(cells.shape[:-1])
    for unknown in (FOUNDATION, DISPLACED):
        if (kinds == unknown).any():
            raise ParameterError(
                "scene: graded elements know sides that are free, rigid or rollers only"
            )
    return kinds


def singular_points(scene: Scene, kinds: Index) -> Floats:
    """Return where stresses or their slopes are unbounded, in cells of the scene.

    Around a grid point that is not on a straight surface, support or interface the four
    cells do not pair up; and the loads on two surface faces in line may differ.
    """
    a, b, c, d = kinds[:-1, :-1], kinds[1:, :-1], kinds[:-1, 1:], kinds[1:, 1:]
    four = np.stack([a, b, c, d])
    straight = ((a == b) & (c == d)) | ((a == c) & (b == d))
    solid = (four >= 0).sum(axis=0)
    held = np.isin(four, (RIGID, ROLLER)).any(axis=0)
    # Two free sides at a right angle bend nothing; neither does a place without a body.
    plain = straight | (solid == 0) | ((solid == 1) & ~held)
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
    import skfem
    from scipy.spatial import cKDTree

    nx, ny = (n - 2 for n in kinds.shape)
    whole = skfem.MeshQuad.init_tensor(np.arange(nx + 1.0), np.arange(ny + 1.0))
    body = kinds[tuple(_cells_of(whole) + 1)] >= 0
    mesh = whole.restrict(np.flatnonzero(body)).to_meshtri(style="x")
    tree = cKDTree(singular)
    for _ in range(levels):
        sharp = np.equal(tree.query(mesh.p.T)[0], 0.0)
        mesh = mesh.refined(np.flatnonzero(sharp[mesh.t].any(axis=0)))
    return mesh


def _cells_of(mesh: Any) -> Index:
    """Return the cell that each element lies in, shape (2, elements)."""
    cells: Index = np.floor(mesh.p[:, mesh.t].mean(axis=1)).astype(np.int64)
    return cells


def _faces(mesh: Any, facets: Index) -> tuple[Index, Index]:
    """Return the cell and the direction of the face that facets of the boundary lie on."""
    cell = _cells_of(mesh)[:, mesh.f2t[0, facets]]
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    away = middle - (cell + 0.5)
    axis: Index = np.abs(away).argmax(axis=0)
    upper = np.take_along_axis(away, axis[None], axis=0)[0] > 0
    return cell, 2 * axis + upper


def _load(scene: Scene, basis: Any) -> Floats:
    """Return the forces on the nodes; those in the middle of cells are spread over these."""
    import skfem

    mesh, shape = basis.mesh, scene.lattice.shape
    facets = mesh.boundary_facets()
    cell, way = _faces(mesh, facets)
    applied = scene.applied()
    on_faces = np.zeros((2, 4, *shape))
    within = np.zeros((2, *shape))
    surface = applied.direction >= 0
    for axis in range(2):
        force = applied.force[:, axis]
        place = (applied.direction[surface], *applied.cells[surface].T)
        np.add.at(on_faces[axis], place, force[surface])
        np.add.at(within[axis], tuple(applied.cells[~surface].T), force[~surface])
    traction = on_faces[:, way, cell[0], cell[1]]
    loaded = np.abs(traction).max(axis=0) > 0.0
    side = skfem.FacetBasis(mesh, basis.elem, facets=facets[loaded])
    density = within[:, *_cells_of(mesh)]
    total: Floats = _push(density, basis)
    if loaded.any():
        total = total + _push(traction[:, loaded], side)
    return total


def _push(density: Floats, basis: Any) -> Floats:
    """Return the load vector of forces per length or area, one for each element or facet."""
    import skfem

    ones = np.ones_like(basis.dx)
    form = skfem.LinearForm(lambda v, w: w.x_force * v[0] + w.y_force * v[1])
    found: Floats = form.assemble(
        basis, x_force=density[0][:, None] * ones, y_force=density[1][:, None] * ones
    )
    return found


def _held(basis: Any, kinds: Index) -> Index:
    """Return the displacement components that rigid cells and rollers hold."""
    mesh = basis.mesh
    facets = mesh.boundary_facets()
    cell, way = _faces(mesh, facets)
    beyond = cell + 1
    beyond[way // 2, np.arange(len(way))] += 2 * (way % 2) - 1
    kind = kinds[tuple(beyond)]
    parts = [basis.get_dofs(facets[kind == RIGID]).flatten()]
    for axis, name in enumerate(("u^1", "u^2")):
        sliding = facets[(kind == ROLLER) & (way // 2 == axis)]
        parts.append(basis.get_dofs(sliding).all([name]))
    return np.unique(np.concatenate(parts).astype(np.int64))
