"""Finite elements on the cells of a scene (scikit-fem): an independent answer.

Nothing of kaju's own solvers takes part. Lengths are in cells of the scene, displacements in
metres, forces in newtons.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError, needing, require
from kaju.factors import factors_of
from kaju.model.elastic.moduli import Moduli, moduli_at, scene_moduli
from kaju.model.elastic.uneven_loads import portions
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER
from kaju.model.scene.lattice import check_boxes
from kaju.model.scene.resolved_body import grid
from kaju.model.study.reference import Reference

Index = NDArray[np.int64]
Field = Callable[[ArrayLike], tuple[Floats, Floats]]
"""Displacement (m) and stress (Pa) at points (m)."""
Finder = Callable[[Floats], Index]
"""Which element holds each place (in cells), shape (dimension, n)."""


def finite_elements(scene: Scene, *, order: int = 2, split: int = 1) -> ElementReference:
    """Solve a scene by finite elements of scikit-fem, which share nothing with kaju's solvers.

    Parameters
    ----------
    scene : Scene
        Of square cells or cubes; its sides are free, rigid or rollers.
    order : {1, 2}
        Order of the polynomials in each element, a square or a cube.
    split : int
        Elements along the edge of a cell.

    Returns
    -------
    ElementReference
        An answer that `kaju.compare` takes as the truth.

    Raises
    ------
    ParameterError
        If an argument, or what the scene has, is not supported.

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
    require(order in (1, 2), f"order: must be 1 or 2, got {order!r}")
    whole = split == int(split) and split >= 1
    require(whole, f"split: must be a whole number from 1, got {split!r}")
    dimension = scene.lattice.dimension
    many = dimension * (order * split) ** dimension * scene.lattice.size
    told = f"scene: some {many:,} unknowns are too many for finite elements, which take 2,000,000"
    told += "; give a coarser scene or a smaller split"
    require(many <= 2_000_000, told)  # factors of more fit into no usual machine's memory
    kinds = surroundings(scene)
    ticks = [np.arange(split * (n - 2) + 1.0) / split for n in kinds.shape]
    box, mesh_of = ("Hex", skfem.MeshHex) if dimension == 3 else ("Quad", skfem.MeshQuad)
    mesh = separated(within_body(mesh_of.init_tensor(*ticks), kinds))
    element = getattr(skfem, f"Element{box}{order}")()
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=2 * order)
    numbers = np.full([split * n for n in scene.lattice.shape], -1)
    lowest = np.rint(split * mesh.p[:, mesh.t].min(axis=1)).astype(np.int64)  # corner, in boxes
    numbers[tuple(lowest)] = np.arange(mesh.nelements)
    words = f"squares or cubes of order {order}, {split} along a cell"
    return solve_on(scene, basis, kinds, lambda place: _box_at(numbers, split, place), words)


def _box_at(numbers: Index, split: int, place: Floats) -> Index:
    """Return the box that holds each place; at a surface one of those inside of the body."""
    found = np.full(place.shape[1], -1)
    most = np.array(numbers.shape)[:, None] - 1
    for corner in np.ndindex(*(2,) * len(place)):
        shift = 1e-9 * (2.0 * np.array(corner) - 1.0)[:, None]
        box = np.clip(np.floor(split * place + shift).astype(np.int64), 0, most)
        found = np.where(found < 0, numbers[tuple(box)], found)
    if (found < 0).any():
        where = ", ".join(f"{value:.4g}" for value in place[:, np.argmin(found)])
        raise ParameterError(f"points: ({where}), in cells, lies outside of the body")
    return found


@dataclass(frozen=True, eq=False)
class ElementReference(Reference):
    """Displacement, stress and strain energy of finite elements, all over the body.

    Its own points are the middles of the cells; these alone are saved, as a `Reference`.
    """

    at: Field | None = None
    load = Reference.load  # type: ignore[assignment]

    def displacement_at(self, points: ArrayLike) -> Floats:
        """Return the displacement (m) at points (m) of the body, both (n, dimension)."""
        assert self.at is not None
        return self.at(points)[0]

    def stress_at(self, points: ArrayLike) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""
        assert self.at is not None
        return self.at(points)[1]

    def save(self, path: str | Path) -> Path:
        """Write what is known in the middles of the cells; see `Reference.save`."""
        known = self.points, self.displacement, self.stress, self.strain_energy, self.source
        return Reference(*known).save(path)


def _field_at(
    points: ArrayLike, *, basis: Any, u: Floats, edge: float, moduli: Moduli, element_at: Finder
) -> tuple[Floats, Floats]:
    """Return displacement (m) and stress (Pa) at points (m), from a basis on a mesh in cells."""
    n, d = np.shape(points)
    place = np.asarray(points, dtype=np.float64).T / edge
    element = element_at(place)
    local = basis.mapping.invF(place[:, :, None], tind=element)
    moved, slope = np.zeros((d, n)), np.zeros((d, d, n))
    for k in range(basis.Nbfun):
        shape = basis.elem.gbasis(basis.mapping, local, k, tind=element)[0]
        weight = u[basis.element_dofs[k, element]]
        moved += np.asarray(shape)[..., 0] * weight
        slope += shape.grad[..., 0] * weight
    gradient = slope.transpose(2, 0, 1) / edge
    strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
    lateral, shear = (m[element][:, None, None] for m in moduli[1:])
    volume = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(d)
    return moved.T, 2.0 * shear * strain + lateral * volume


def surroundings(scene: Scene) -> Index:
    """Return the kinds of all cells and of one layer of cells around them."""
    check_boxes(scene.lattice, "can be finite elements")
    shape = np.array(scene.lattice.shape)
    found = scene.kinds(grid(0 * shape - 1, shape + 1))
    known = not np.isin(found, (FOUNDATION, DISPLACED)).any()
    require(known, "scene: finite elements know sides that are free, rigid or rollers only")
    return np.asarray(found.reshape(shape + 2))


def cells_of(mesh: Any) -> Index:
    """Return the cell that each element lies in, shape (dimension, elements)."""
    cells: Index = np.floor(mesh.p[:, mesh.t].mean(axis=1)).astype(np.int64)
    return cells


def _faces_of(mesh: Any, facets: Index) -> tuple[Index, Index]:
    """Return the cell and the direction of the face that facets of the boundary lie on."""
    cell = cells_of(mesh)[:, mesh.f2t[0, facets]]
    away = mesh.p[:, mesh.facets[:, facets]].mean(axis=1) - (cell + 0.5)
    axis: Index = np.abs(away).argmax(axis=0)
    upper = np.take_along_axis(away, axis[None], axis=0)[0] > 0
    return cell, 2 * axis + upper


def _stiffness(scene: Scene, basis: Any, moduli: Moduli) -> Any:
    """Return the stiffness matrix of vector-valued elements with these moduli."""
    import skfem
    from skfem.helpers import ddot, div, sym_grad

    @skfem.BilinearForm
    def form(u: Any, v: Any, w: Any) -> Any:
        return w.lateral * div(u) * div(v) + 2.0 * w.shear * ddot(sym_grad(u), sym_grad(v))

    ones = np.ones_like(basis.dx)
    lateral, shear = (modulus[:, None] * ones for modulus in (moduli.lateral, moduli.shear))
    depth = scene.thickness if scene.lattice.dimension == 2 else scene.lattice.cell_size  # m
    return depth * form.assemble(basis, lateral=lateral, shear=shear)


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
    described = force[load], part[row][load], slope[row][load]
    total, moment, _ = portions(own[side], *described, low, size)
    area = size.prod(axis=1)[:, None]
    mean, growth = np.zeros((len(facets), d)), np.zeros((len(facets), d, d))
    np.add.at(mean, side, total / area)
    np.add.at(growth, side, 12.0 * moment / (area * size**2)[:, None])
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


def _held(basis: Any, kinds: Index) -> Index:
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
    scene: Scene, basis: Any, kinds: Index, element_at: Finder, words: str
) -> ElementReference:
    """Solve a scene on the elements of a vector-valued basis on a mesh in cells."""
    import skfem

    moduli = moduli_at(scene_moduli(scene), kinds[tuple(cells_of(basis.mesh) + 1)])
    matrix = _stiffness(scene, basis, moduli)
    right, u = _load_vector(scene, basis), np.zeros(basis.N)
    free = np.setdiff1d(np.arange(basis.N), _held(basis, kinds))
    u[free] = factors_of(matrix[free][:, free]).solve(right[free])
    known: dict[str, Any] = {"basis": basis, "u": u, "moduli": moduli, "element_at": element_at}
    field: Field = partial(_field_at, edge=scene.lattice.cell_size, **known)
    points = scene.lattice.centres(np.argwhere(scene.rasterise() >= 0))
    source = f"finite elements: {words}, {basis.N} unknowns (scikit-fem {skfem.__version__})"
    return ElementReference(points, *field(points), 0.5 * float(u @ right), source, field)


def within_body(whole: Any, kinds: Index) -> Any:
    """Return the part of a mesh whose elements lie in the body."""
    return whole.restrict(np.flatnonzero(kinds[tuple(cells_of(whole) + 1)] >= 0))


def separated(mesh: Any) -> Any:
    """Give elements that share no facet a point each where they touch: it holds nothing."""
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
