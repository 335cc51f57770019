"""Finite elements on the cells of a scene (scikit-fem): the independent answer.

Nothing of kaju's own solvers takes part. Triangles are graded towards every point where the
solution is singular, which makes them the truth of plane bodies. Lengths are in cells of the
scene, displacements in metres, forces in newtons.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError, needing
from kaju.factors import factors_of, rigid_motions
from kaju.model.elastic.bounds.uneven_loads import Portions
from kaju.model.elastic.moduli import Moduli, moduli_of
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER
from kaju.model.scene.selection import Uneven
from kaju.model.study.reference import Reference

Index = NDArray[np.int64]

NEAREST = 16  # elements that are asked first for a point
ROUNDING = 1e-9
DIRECT = 400_000  # more unknowns are found by pyamg, which needs less memory than factors
RESIDUAL = 1e-10
ORDERS = {"triangles": (1, 2, 3, 4), "boxes": (1, 2)}
MOST_CELLS = 1_000_000  # more do not fit in memory as elements


def finite_elements(
    scene: Scene,
    *,
    elements: Literal["triangles", "boxes"] | None = None,
    order: int = 2,
    levels: int = 8,
    split: int = 1,
) -> ElementReference:
    """Solve a scene by finite elements of scikit-fem, which share nothing with kaju's solvers.

    Parameters
    ----------
    scene : Scene
        Of square cells or cubes; its sides are free, rigid or rollers.
    elements : {"triangles", "boxes"}, optional
        Four triangles a cell, graded towards singular points, or squares (cubes). By default
        triangles in the plane, boxes in space.
    order : int
        Of the polynomials: triangles 1 to 4, boxes 1 or 2.
    levels : int
        How often the triangles around every singular point are halved; boxes are not graded.
    split : int
        Parts along the edge of a cell, of boxes.

    Returns
    -------
    ElementReference
        What `kaju.compare` takes as the answer that is believed.

    Raises
    ------
    MissingExtraError
        If scikit-fem is missing (or, above 400,000 unknowns, pyamg).
    ParameterError
        If an argument is outside its rule, or elements cannot tell what the scene asks for.

    Examples
    --------
    >>> import kaju
    >>> body = {"size": [0.2, 0.1], "cells": [4, 2], "thickness": 0.01, "material": "steel"}
    >>> pulled = [{"side": "right", "pressure": -1e6}]
    >>> scene = kaju.Scene(body=body, sides={"left": "roller", "bottom": "roller"}, loads=pulled)
    >>> elements = kaju.finite_elements(scene)
    >>> float(elements.stress_at([[0.1, 0.05]])[0, 0, 0].round())
    1000000.0
    >>> kaju.compare(kaju.solve(scene), elements).displacement.max_error < 1e-6
    True
    """
    with needing("finite_elements needs scikit-fem: pip install 'kaju[fem]'"):
        import skfem
    solid = scene.lattice.dimension == 3
    shape = elements or ("boxes" if solid else "triangles")
    if shape not in ORDERS or (solid and shape == "triangles"):
        allowed = "'boxes' in space, 'triangles' or 'boxes' in the plane"
        raise ParameterError(f"elements: must be {allowed}, got {elements!r}")
    if order not in ORDERS[shape]:
        raise ParameterError(f"order: {shape} have orders {ORDERS[shape]}, got {order!r}")
    for name, value, least in (("levels", levels, 0), ("split", split, 1)):
        if value != int(value) or value < least:
            raise ParameterError(f"{name}: must be a whole number from {least}, got {value!r}")
    cells = int(np.prod(scene.lattice.shape)) * split**scene.lattice.dimension
    if cells > MOST_CELLS:
        raise ParameterError(
            f"scene: {cells:,} cells are too many for finite elements in memory, which is "
            f"{MOST_CELLS:,}; give a coarser scene"
        )
    kinds = surroundings(scene)
    if shape == "triangles":
        family = [getattr(skfem, f"ElementTriP{k}") for k in ORDERS[shape]]
        mesh = graded_mesh(kinds, singular_points(scene, kinds), levels)
        words = f"triangles of order {order}" + (f", {levels} times halved" if levels else "")
        # Exact for products of slopes and for loads that are uniform in an element.
        degree = max(2 * order - 2, order)
    else:
        family = [getattr(skfem, f"Element{'Hex' if solid else 'Quad'}{k}") for k in ORDERS[shape]]
        mesh = box_mesh(kinds, split)
        words, degree = f"boxes of order {order}, {split} along a cell", 2 * order
    basis = skfem.Basis(mesh, skfem.ElementVector(family[order - 1]()), intorder=degree)
    field = solve_on(scene, basis, kinds)
    points = scene.lattice.centres(np.argwhere(scene.rasterise() >= 0))
    moved, _, stress = field.at(points)
    source = f"finite elements: {words}, {basis.N} unknowns (scikit-fem {skfem.__version__})"
    return ElementReference(points, moved, stress, field.energy, source, field)


@dataclass(frozen=True, eq=False)
class ElementReference(Reference):
    """Displacement, stress and strain energy of finite elements, defined all over the body.

    Its own points are the middles of the cells; these alone are saved and loaded again.
    """

    field: ElementField | None = None
    """The elements' own unknowns; None if it comes from a file."""

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both (n, dimension)."""
        return super().displacement_at(points) if self.field is None else self.field.at(points)[0]

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""
        return super().stress_at(points) if self.field is None else self.field.at(points)[2]


@dataclass(frozen=True, eq=False)
class ElementField:
    """The unknowns of elements, and what they say at points."""

    basis: Any  # vector-valued, on a mesh in cells
    displacement: Floats  # of every unknown (m)
    energy: float  # (J)
    cell_size: float  # (m)
    moduli: Moduli  # of every element (Pa)

    @property
    def unknowns(self) -> int:
        """Number of displacement components."""
        return int(self.basis.N)

    def at(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Return displacement (m), its gradient ∂u_a/∂x_b and stress (Pa) at points (m)."""
        basis, (n, d) = self.basis, np.shape(points)
        place = np.asarray(points, dtype=np.float64).T / self.cell_size
        element = _elements_around(basis, place)
        local = basis.mapping.invF(place[:, :, None], tind=element)
        moved, slope = np.zeros((d, n)), np.zeros((d, d, n))
        for k in range(basis.Nbfun):
            shape = basis.elem.gbasis(basis.mapping, local, k, tind=element)[0]
            weight = self.displacement[basis.element_dofs[k, element]]
            moved += np.asarray(shape)[..., 0] * weight
            slope += shape.grad[..., 0] * weight
        gradient = slope.transpose(2, 0, 1) / self.cell_size
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        lateral, shear = (m[element][:, None, None] for m in self.moduli[1:])
        volume = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(d)
        return moved.T, gradient, 2.0 * shear * strain + lateral * volume


def _elements_around(basis: Any, place: Floats) -> Index:
    """Return the element that holds each place, or comes closest to it.

    The mesh's own finder makes no allowance for rounding, which counts in triangles of 1e-5.
    """
    from scipy.spatial import cKDTree

    corners = basis.mesh.p[:, basis.mesh.t]
    if corners.shape[1] == 2 ** len(place):  # boxes, which lie along the axes
        low, high = corners.min(axis=1).T - ROUNDING, corners.max(axis=1).T + ROUNDING
        return np.array([np.argmax(np.all((p >= low) & (p <= high), axis=1)) for p in place.T])

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
    found: Index = near[np.arange(len(near)), inside.argmax(axis=1)]
    for lost in np.flatnonzero(inside.max(axis=1) < -ROUNDING):
        found[lost] = depth_within(place[:, [lost]], np.arange(len(middles))[None]).argmax()
    return found


def surroundings(scene: Scene) -> Index:
    """Return the kinds of all cells and of one layer of cells around them."""
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


def depth(scene: Scene) -> float:
    """Return what turns stresses times cells into forces: thickness, or the cells' edge (m)."""
    d = scene.lattice.dimension
    return scene.thickness if d == 2 else scene.lattice.cell_size


def cells_of(mesh: Any) -> Index:
    """Return the cell that each element lies in, shape (dimension, elements)."""
    cells: Index = np.floor(mesh.p[:, mesh.t].mean(axis=1)).astype(np.int64)
    return cells


def element_moduli(scene: Scene, mesh: Any, kinds: Index) -> Moduli:
    """Return the moduli (Pa) of every element; see `surroundings` for `kinds`."""
    kind = kinds[tuple(cells_of(mesh) + 1)]
    constants = [(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials]
    youngs_modulus, poissons_ratio = np.array(constants).T
    moduli = moduli_of(youngs_modulus, poissons_ratio, scene.plane)
    return Moduli(*(modulus[kind] for modulus in moduli))


def _faces_of(mesh: Any, facets: Index) -> tuple[Index, Index]:
    """Return the cell and the direction of the face that facets of the boundary lie on."""
    cell = cells_of(mesh)[:, mesh.f2t[0, facets]]
    away = mesh.p[:, mesh.facets[:, facets]].mean(axis=1) - (cell + 0.5)
    axis: Index = np.abs(away).argmax(axis=0)
    upper = np.take_along_axis(away, axis[None], axis=0)[0] > 0
    return cell, 2 * axis + upper


def stiffness(scene: Scene, basis: Any, moduli: Moduli) -> Any:
    """Return the stiffness matrix of vector-valued elements with these moduli."""
    import skfem
    from skfem.helpers import ddot, div, sym_grad

    @skfem.BilinearForm
    def form(u: Any, v: Any, w: Any) -> Any:
        return w.lateral * div(u) * div(v) + 2.0 * w.shear * ddot(sym_grad(u), sym_grad(v))

    ones = np.ones_like(basis.dx)
    lateral, shear = (modulus[:, None] * ones for modulus in (moduli.lateral, moduli.shear))
    return depth(scene) * form.assemble(basis, lateral=lateral, shear=shear)


def _tractions(scene: Scene, mesh: Any, facets: Index) -> tuple[Floats, Floats]:
    """Return the mean of the loads on facets of the boundary, and its growth along each axis.

    Both are for unit area. Linear in a facet, they have the force and the moments of the loads as
    described, also of those that end within a face.
    """
    import pandas as pd

    d, applied = scene.lattice.dimension, scene.applied()
    row = np.flatnonzero(applied.direction >= 0)
    cells, direction, force = applied.cells[row], applied.direction[row], applied.force[row]
    if (scene.kinds(cells + scene.lattice.normals[direction].astype(int)) >= 0).any():
        raise ParameterError("scene: a force enters by a face inside the body, not by its surface")
    part = np.tile([[0.0], [1.0]], (len(applied.force), 1, d))
    slope = np.zeros((len(applied.force), d, d))
    if applied.uneven is not None:
        part[applied.uneven.row], slope[applied.uneven.row] = applied.uneven[1:]
    cell, own = _faces_of(mesh, facets)
    sizes = (*scene.lattice.shape, 2 * d)
    loads = pd.DataFrame({"face": np.ravel_multi_index((*cells.T, direction), sizes)})
    sides = pd.DataFrame({"face": np.ravel_multi_index((*cell, own), sizes)})
    both = loads.reset_index(names="load").merge(sides.reset_index(names="side"), on="face")
    load, side = both["load"].to_numpy(), both["side"].to_numpy()
    corners = mesh.p[:, mesh.facets[:, facets[side]]]
    low, size = (corners.min(axis=1) - cell[:, side]).T, np.ptp(corners, axis=1).T
    size[np.arange(len(side)), own[side] // 2] = 1.0  # across a side: any
    described = Uneven(load, part[row][load], slope[row][load])
    found = Portions.of(side, own[side], force[load], described, low, size)
    area = size.prod(axis=1)[:, None]
    mean, growth = np.zeros((len(facets), d)), np.zeros((len(facets), d, d))
    np.add.at(mean, side, found.force / area)
    np.add.at(growth, side, 12.0 * found.moment / (area * size**2)[:, None])
    return mean, growth


def _load_vector(scene: Scene, basis: Any) -> Floats:
    """Return the forces on the unknowns: of weight in the elements, of tractions on facets."""
    import skfem

    mesh, applied = basis.mesh, scene.applied()
    total = np.zeros(basis.N)
    inside = applied.direction < 0
    if inside.any():
        weight = np.zeros((*scene.lattice.shape, scene.lattice.dimension))  # of a cell's volume
        np.add.at(weight, tuple(applied.cells[inside].T), applied.force[inside])
        total += _assembled(weight[tuple(cells_of(mesh))].T[:, :, None], basis)
    facets = mesh.boundary_facets()
    mean, growth = _tractions(scene, mesh, facets)
    loaded = mean.any(axis=1) | growth.any(axis=(1, 2))
    if loaded.any():
        side = skfem.FacetBasis(mesh, basis.elem, facets=facets[loaded])
        middle = mesh.p[:, mesh.facets[:, facets[loaded]]].mean(axis=1)
        away = np.asarray(side.global_coordinates()) - middle[:, :, None]
        linear = np.einsum("fab,bfq->afq", growth[loaded], away)
        total += _assembled(mean[loaded].T[:, :, None] + linear, side)
    return total


def _assembled(density: Floats, basis: Any) -> Floats:
    """Return the load vector of a force density, at the points of elements or facets."""
    import skfem

    names = [f"force_{axis}" for axis in range(len(density))]
    form = skfem.LinearForm(lambda v, w: sum(w[name] * v[a] for a, name in enumerate(names)))
    ones = np.ones_like(basis.dx)
    values = {name: part * ones for name, part in zip(names, density, strict=True)}
    return np.asarray(form.assemble(basis, **values))


def held(basis: Any, kinds: Index) -> Index:
    """Return the unknowns that rigid cells and rollers hold; see `surroundings` for `kinds`."""
    facets = basis.mesh.boundary_facets()
    cell, direction = _faces_of(basis.mesh, facets)
    beyond = cell + 1
    beyond[direction // 2, np.arange(len(direction))] += 2 * (direction % 2) - 1
    kind = kinds[tuple(beyond)]
    parts = [basis.get_dofs(facets[kind == RIGID]).flatten()]
    for axis in range(len(cell)):
        sliding = facets[(kind == ROLLER) & (direction // 2 == axis)]
        parts.append(basis.get_dofs(sliding).all([f"u^{axis + 1}"]))
    return np.unique(np.concatenate(parts).astype(np.int64))


def solve_on(
    scene: Scene,
    basis: Any,
    kinds: Index,
    solve: Callable[[Any, Floats, Floats], Floats] | None = None,
    matrix: Any = None,
) -> ElementField:
    """Solve a scene on the elements of a vector-valued basis on a mesh in cells.

    `solve`: from a matrix, the forces and the rigid motions of its unknowns to the unknowns.
    """
    moduli = element_moduli(scene, basis.mesh, kinds)
    matrix = stiffness(scene, basis, moduli) if matrix is None else matrix
    right, u = _load_vector(scene, basis), np.zeros(basis.N)
    free = np.setdiff1d(np.arange(basis.N), held(basis, kinds))
    d = basis.mesh.dim()
    motions = rigid_motions(basis.doflocs.T, np.arange(basis.N) % d)[free]
    u[free] = (solve or _solved)(matrix[free][:, free], right[free], motions)
    return ElementField(basis, u, 0.5 * float(u @ right), scene.lattice.cell_size, moduli)


def _solved(matrix: Any, right: Floats, motions: Floats) -> Floats:
    """Solve by elimination or, if there are many unknowns, by `multigrid`."""
    if len(right) <= DIRECT:
        return factors_of(matrix).solve(right)
    return multigrid(matrix.tocsr(), right, motions, RESIDUAL)


def multigrid(matrix: Any, right: Floats, motions: Floats, residual: float) -> Floats:
    """Solve by conjugate gradients with pyamg's smoothed aggregation, to a relative residual."""
    with needing("finite_elements needs pyamg for so many unknowns: pip install 'kaju[amg]'"):
        import pyamg
    hierarchy = pyamg.smoothed_aggregation_solver(matrix, B=motions)
    return np.asarray(hierarchy.solve(right, tol=residual, accel="cg", maxiter=2000))


def box_mesh(kinds: Index, split: int) -> Any:
    """Return squares (cubes) on the body's cells, `split` along the edge of each."""
    import skfem

    ticks = [np.arange(split * (n - 2) + 1.0) / split for n in kinds.shape]
    kind = skfem.MeshQuad if len(ticks) == 2 else skfem.MeshHex
    return _separated(_within_body(kind.init_tensor(*ticks), kinds))


def _within_body(whole: Any, kinds: Index) -> Any:
    return whole.restrict(np.flatnonzero(kinds[tuple(cells_of(whole) + 1)] >= 0))


def graded_mesh(kinds: Index, singular: Floats, levels: int) -> Any:
    """Return four triangles a cell, halved `levels` times around singular points (in cells)."""
    import skfem
    from scipy.spatial import cKDTree

    ticks = [np.arange(n - 1.0) for n in kinds.shape]
    mesh = _within_body(skfem.MeshQuad.init_tensor(*ticks).to_meshtri(style="x"), kinds)
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
    return _separated(mesh)


def _separated(mesh: Any) -> Any:
    """Give elements that touch at a corner only a point each: one point holds nothing together.

    Corners of elements are joined through the facets that elements share.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners, count = mesh.t.shape
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    one, other = mesh.f2t[:, inner]
    pairs = []
    for vertex in mesh.facets[:, inner]:
        own = [(mesh.t[:, e] == vertex).argmax(axis=0) * count + e for e in (one, other)]
        pairs.append(np.stack(own))
    links = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(links.shape[1]), tuple(links)), shape=(corners * count,) * 2)
    number, label = connected_components(graph, directed=False)
    if number == mesh.p.shape[1]:
        return mesh
    _, first = np.unique(label, return_index=True)
    return type(mesh)(mesh.p[:, mesh.t.ravel()[first]], label.reshape(mesh.t.shape))


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
