"""What every finite element peer needs of a scene: its cells, loads, supports and stiffness.

Lengths are in cells of the scene, displacements in metres, forces in newtons.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.factors import factors_of
from kaju.model.elastic.moduli import Moduli, moduli_of
from kaju.model.scene import Scene
from kaju.model.scene.kinds import DISPLACED, FOUNDATION, RIGID, ROLLER

Index = NDArray[np.int64]

NEAREST = 16
"""Elements that are asked first for a point."""
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class ElementAnswer:
    """Displacements (m) of triangles, tetrahedra or bricks, and the strain energy (J).

    Attributes
    ----------
    basis : skfem.Basis
        Vector-valued, on a mesh in cells.
    displacement : array, shape (unknowns,)
    energy : float
    cell_size : float
    """

    basis: Any
    displacement: Floats
    energy: float
    cell_size: float

    @property
    def unknowns(self) -> int:
        """Number of displacement components."""
        return int(self.basis.N)

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both (n, dimension)."""
        return self._at(points)[0]

    def gradient_at(self, points: Floats) -> Floats:
        """Return ∂u_a/∂x_b at points (m) of the body, shape (n, dimension, dimension)."""
        return self._at(points)[1]

    def _at(self, points: Floats) -> tuple[Floats, Floats]:
        basis, (n, d) = self.basis, points.shape
        place = points.T / self.cell_size
        element = _elements_around(basis, place)
        local = basis.mapping.invF(place[:, :, None], tind=element)
        moved, gradient = np.zeros((d, n)), np.zeros((d, d, n))
        for k in range(basis.Nbfun):
            shape = basis.elem.gbasis(basis.mapping, local, k, tind=element)[0]
            weight = self.displacement[basis.element_dofs[k, element]]
            moved += np.asarray(shape)[..., 0] * weight
            gradient += shape.grad[..., 0] * weight
        return moved.T, gradient.transpose(2, 0, 1) / self.cell_size


def _elements_around(basis: Any, place: Floats) -> Index:
    """Return the element that holds each place, or comes closest to it.

    The mesh's own finder knows no rounding, which counts beside triangles graded to 1e-5.
    """
    from scipy.spatial import cKDTree

    corners = basis.mesh.p[:, basis.mesh.t]
    if corners.shape[1] == 2 ** len(place):  # bricks, which lie along the axes
        low, high = corners.min(axis=1).T - ROUNDING, corners.max(axis=1).T + ROUNDING
        return np.array([np.argmax(np.all((p >= low) & (p <= high), axis=1)) for p in place.T])
    middles = corners.mean(axis=1)
    nearest = cKDTree(middles.T).query(place.T, min(NEAREST, middles.shape[1]))[1]
    near = np.asarray(nearest, dtype=np.int64).reshape(place.shape[1], -1)
    found = np.empty(len(near), dtype=np.int64)
    depth_in = np.empty(len(near))
    for point in range(len(near)):
        found[point], depth_in[point] = _deepest(basis, place[:, point], near[point])
    for lost in np.flatnonzero(depth_in < -ROUNDING):
        found[lost], _ = _deepest(basis, place[:, lost], np.arange(middles.shape[1]))
    return found


def _deepest(basis: Any, point: Floats, elements: Index) -> tuple[int, float]:
    """Return the element that a point lies deepest in, and its smallest barycentric coordinate."""
    local = basis.mapping.invF(np.repeat(point[:, None, None], len(elements), axis=1), elements)
    local = local[..., 0]
    depth_in = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0))
    best = int(depth_in.argmax())
    return int(elements[best]), float(depth_in[best])


def surroundings(scene: Scene) -> Index:
    """Return the kinds of all cells and of one layer of cells around them.

    Raises
    ------
    ParameterError
        If cells are neither squares nor cubes, or sides neither free, rigid nor rollers.
    """
    if not scene.lattice.boxes:
        raise ParameterError(
            f"scene: finite elements need square cells or cubes, got {scene.lattice.kind}s"
        )
    ranges = [np.arange(-1, n + 1) for n in scene.lattice.shape]
    cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1)
    found = scene.kinds(cells.reshape(-1, len(ranges)))
    if np.isin(found, (FOUNDATION, DISPLACED)).any():
        raise ParameterError(
            "scene: finite elements know sides that are free, rigid or rollers only"
        )
    return np.asarray(found.reshape(cells.shape[:-1]))


def scene_moduli(scene: Scene) -> Moduli:
    """Return the moduli (Pa) of the scene's materials."""
    materials = scene.cell_materials
    return moduli_of(
        np.array([m.youngs_modulus for m in materials]),
        np.array([m.poissons_ratio for m in materials]),
        scene.plane,
    )


def depth(scene: Scene) -> float:
    """Return what turns stresses times cells into forces: thickness, or the cells' edge (m)."""
    d = scene.lattice.dimension
    return scene.thickness if d == 2 else scene.lattice.cell_size


def cells_of(mesh: Any) -> Index:
    """Return the cell that each element lies in, shape (dimension, elements)."""
    cells: Index = np.floor(mesh.p[:, mesh.t].mean(axis=1)).astype(np.int64)
    return cells


def faces_of(mesh: Any, facets: Index) -> tuple[Index, Index]:
    """Return the cell and the direction of the face that facets of the boundary lie on."""
    cell = cells_of(mesh)[:, mesh.f2t[0, facets]]
    away = mesh.p[:, mesh.facets[:, facets]].mean(axis=1) - (cell + 0.5)
    axis: Index = np.abs(away).argmax(axis=0)
    upper = np.take_along_axis(away, axis[None], axis=0)[0] > 0
    return cell, 2 * axis + upper


def stiffness(scene: Scene, basis: Any, kind: Index) -> Any:
    """Return the stiffness matrix of vector-valued elements of the given kinds."""
    import skfem
    from skfem.helpers import ddot, div, sym_grad

    moduli, ones = scene_moduli(scene), np.ones_like(basis.dx)

    @skfem.BilinearForm
    def form(u: Any, v: Any, w: Any) -> Any:
        return w.lateral * div(u) * div(v) + 2.0 * w.shear * ddot(sym_grad(u), sym_grad(v))

    lateral, shear = (modulus[kind][:, None] * ones for modulus in (moduli.lateral, moduli.shear))
    return depth(scene) * form.assemble(basis, lateral=lateral, shear=shear)


def densities(scene: Scene, mesh: Any, facets: Index) -> tuple[Floats, Floats]:
    """Return forces per facet of the boundary and per element, each for unit area or volume.

    Forces in the middle of cells are spread over these.

    Raises
    ------
    ParameterError
        If a force enters by a face between two cells of the body.
    """
    d, shape = scene.lattice.dimension, scene.lattice.shape
    applied = scene.applied()
    on_faces, within = np.zeros((d, 2 * d, *shape)), np.zeros((d, *shape))
    surface = applied.direction >= 0
    beyond = applied.cells[surface] + scene.lattice.normals[applied.direction[surface]].astype(int)
    if (scene.kinds(beyond) >= 0).any():
        raise ParameterError("scene: a force enters by a face inside the body, not by its surface")
    for axis in range(d):
        force = applied.force[:, axis]
        place = (applied.direction[surface], *applied.cells[surface].T)
        np.add.at(on_faces[axis], place, force[surface])
        np.add.at(within[axis], tuple(applied.cells[~surface].T), force[~surface])
    cell, way = faces_of(mesh, facets)
    return on_faces[:, way, *cell], within[:, *cells_of(mesh)]


def load_vector(scene: Scene, basis: Any) -> Floats:
    """Return the forces on the unknowns of vector-valued elements."""
    import skfem

    facets = basis.mesh.boundary_facets()
    traction, weight = densities(scene, basis.mesh, facets)
    loaded = np.abs(traction).max(axis=0) > 0.0
    total = _push(weight, basis) if weight.any() else np.zeros(basis.N)
    if loaded.any():
        side = skfem.FacetBasis(basis.mesh, basis.elem, facets=facets[loaded])
        total += _push(traction[:, loaded], side)
    return total


def _push(density: Floats, basis: Any) -> Floats:
    import skfem

    names = [f"force_{axis}" for axis in range(len(density))]
    form = skfem.LinearForm(lambda v, w: sum(w[name] * v[a] for a, name in enumerate(names)))
    ones = np.ones_like(basis.dx)
    values = {name: part[:, None] * ones for name, part in zip(names, density, strict=True)}
    return np.asarray(form.assemble(basis, **values))


def held(basis: Any, kinds: Index) -> Index:
    """Return the unknowns that rigid cells and rollers hold; see `surroundings` for `kinds`."""
    facets = basis.mesh.boundary_facets()
    cell, way = faces_of(basis.mesh, facets)
    beyond = cell + 1
    beyond[way // 2, np.arange(len(way))] += 2 * (way % 2) - 1
    kind = kinds[tuple(beyond)]
    parts = [basis.get_dofs(facets[kind == RIGID]).flatten()]
    for axis in range(len(cell)):
        sliding = facets[(kind == ROLLER) & (way // 2 == axis)]
        parts.append(basis.get_dofs(sliding).all([f"u^{axis + 1}"]))
    return np.unique(np.concatenate(parts).astype(np.int64))


def cell_mesh(kinds: Index) -> Any:
    """Return triangles (tetrahedra) on the body's cells, four (six) in each."""
    import skfem

    ticks = [np.arange(n - 1.0) for n in kinds.shape]
    if len(ticks) == 2:
        whole = skfem.MeshQuad.init_tensor(*ticks).to_meshtri(style="x")
    else:
        whole = skfem.MeshTet.init_tensor(*ticks)
    return whole.restrict(np.flatnonzero(kinds[tuple(cells_of(whole) + 1)] >= 0))


def factorised(matrix: Any, right: Floats, _free: Index) -> Floats:
    """Solve by elimination, in an order that suits symmetric matrices."""
    return factors_of(matrix).solve(right)


def answer_of(
    scene: Scene,
    basis: Any,
    kinds: Index,
    solve: Callable[[Any, Floats, Index], Floats] = factorised,
    matrix: Any = None,
) -> ElementAnswer:
    """Solve a scene on the elements of a basis.

    Parameters
    ----------
    scene : Scene
        Of square cells or cubes.
    basis : skfem.Basis
        Vector-valued, on a mesh in cells.
    kinds : int array
        What is where; see `surroundings`.
    solve : callable
        From a matrix, what acts, and which unknowns these are, to the unknowns.
    matrix : sparse array, optional
        The stiffness of all unknowns; `stiffness` unless given.
    """
    if matrix is None:
        matrix = stiffness(scene, basis, kinds[tuple(cells_of(basis.mesh) + 1)])
    right, u = load_vector(scene, basis), np.zeros(basis.N)
    free = np.setdiff1d(np.arange(basis.N), held(basis, kinds))
    u[free] = solve(matrix[free][:, free], right[free], free)
    return ElementAnswer(basis, u, 0.5 * float(u @ right), scene.lattice.cell_size)
