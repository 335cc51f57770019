"""The truth of scenes of cubes: bricks of order 2, graded to planes where edges are singular.

Volume changes are integrated by two points an axis, which keeps nearly incompressible bodies
from locking (Hughes, The Finite Element Method, ch. 4). Needs scikit-fem and pyamg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.scene import Scene
from kaju.model.validation.scene_elements import Index, cells_of, factorised, scene_moduli

DIRECT = 60_000
"""Up to this many unknowns are factorised."""
RESIDUAL = 1e-11
NEAR = 1e-9


@dataclass(frozen=True, eq=False)
class BrickAnswer:
    """Displacements (m) of a mesh in cells of the scene, and the strain energy (J)."""

    basis: Any
    displacement: Floats
    energy: float
    cell_size: float

    @property
    def unknowns(self) -> int:
        """Number of displacement components."""
        return self.displacement.size

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both of shape (n, 3)."""
        basis, place = self.basis, points / self.cell_size
        corners = basis.mesh.p[:, basis.mesh.t]
        low, high = corners.min(axis=1).T - NEAR, corners.max(axis=1).T + NEAR
        element = np.array([np.argmax(np.all((p >= low) & (p <= high), axis=1)) for p in place])
        local = basis.mapping.invF(place.T[:, :, None], tind=element)
        moved = np.zeros(points.shape)
        for k in range(basis.Nbfun):
            shape = np.asarray(basis.elem.gbasis(basis.mapping, local, k, tind=element)[0])
            moved += shape[..., 0][:, None] * self.displacement[basis.element_dofs[k, element]]
        return moved


def solve_bricks(
    scene: Scene, singular: Sequence[Sequence[int]], parts: int, elsewhere: int | None = None
) -> BrickAnswer:
    """Solve a scene of cubes.

    Parameters
    ----------
    scene : Scene
        Of few cells. Sides are free, rigid or rollers; forces enter by faces of cells.
    singular : three sequences of int
        Along each axis the grid planes, counted in cells, towards which bricks get thinner.
    parts : int
        Bricks along a cell that such a plane bounds.
    elsewhere : int, optional
        Bricks along other cells; half as many, unless given.

    Raises
    ------
    ParameterError
        If a side is held in another way.
    """
    import skfem

    shape = scene.lattice.shape
    whole = skfem.MeshHex.init_tensor(
        *(
            graded_ticks(n, planes, parts, elsewhere or (parts + 1) // 2)
            for n, planes in zip(shape, singular, strict=True)
        )
    )
    kinds = scene.rasterise()
    solid = kinds[tuple(cells_of(whole))] >= 0
    mesh = whole.restrict(np.flatnonzero(solid))
    basis = skfem.Basis(mesh, skfem.ElementHex2(), intorder=4)
    matrix = scene.lattice.cell_size * _stiffness(scene, basis, kinds[tuple(cells_of(mesh))])
    right = _load(scene, basis)
    free = ~_held(scene, basis)
    u = np.zeros(len(right))
    u[free] = _solve(matrix[free][:, free], right[free], basis.doflocs, free)
    return BrickAnswer(basis, u.reshape(-1, 3), 0.5 * float(u @ right), scene.lattice.cell_size)


def graded_ticks(cells: int, singular: Sequence[int], parts: int, elsewhere: int) -> Floats:
    """Return grid positions (cells) that crowd quadratically towards the singular planes."""
    along = np.linspace(0.0, 1.0, parts + 1)[1:]
    positions = [np.zeros(1)]
    for cell in range(cells):
        below, above = cell in singular, cell + 1 in singular
        if below and above:
            upper = along > 0.5
            local = np.where(upper, 1.0 - 2.0 * (1.0 - along) ** 2, 2.0 * along**2)
        elif below:
            local = along**2
        elif above:
            local = 1.0 - (1.0 - along) ** 2
        else:
            local = np.linspace(0.0, 1.0, elsewhere + 1)[1:]
        positions.append(cell + local)
    return np.concatenate(positions)


def _stiffness(scene: Scene, basis: Any, kind: Index) -> Any:
    """Return the stiffness from the nine products of first derivatives; components alternate.

    Far quicker than a vector-valued form.
    """
    import skfem
    from scipy.sparse import block_array

    moduli = scene_moduli(scene)
    few = skfem.Basis(basis.mesh, basis.elem, intorder=3)

    def product(points: Any, modulus: Floats, a: int, b: int) -> Any:
        form = skfem.BilinearForm(lambda u, v, w: w.modulus * v.grad[a] * u.grad[b])
        return form.assemble(points, modulus=modulus[kind][:, None] * np.ones_like(points.dx))

    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    shear = {pair: product(basis, moduli.shear, *pair) for pair in pairs}
    volume = {pair: product(few, moduli.lateral, *pair) for pair in pairs}
    for a, b in pairs:
        shear[b, a], volume[b, a] = shear[a, b].T, volume[a, b].T
    straight = shear[0, 0] + shear[1, 1] + shear[2, 2]
    blocks = [[volume[a, b] + shear[b, a] for b in range(3)] for a in range(3)]
    for a in range(3):
        blocks[a][a] = blocks[a][a] + straight
    order = np.arange(3 * basis.N).reshape(3, -1).T.ravel()
    return block_array(blocks).tocsr()[order][:, order]


def _load(scene: Scene, basis: Any) -> Floats:
    import skfem

    applied, mesh = scene.applied(), basis.mesh
    total = np.zeros((basis.N, 3))
    facets = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1).T
    for cell, way, force in zip(applied.cells, applied.direction, applied.force, strict=True):
        axis, upper = divmod(int(way), 2)
        low, high = cell.astype(np.float64), cell + 1.0
        low[axis] = high[axis] = cell[axis] + upper
        on = np.all((middle > low - NEAR) & (middle < high + NEAR), axis=1)
        side = skfem.FacetBasis(mesh, basis.elem, facets=facets[on])
        total += np.outer(skfem.LinearForm(lambda v, w: v).assemble(side), force)
    return total.ravel()


def _held(scene: Scene, basis: Any) -> NDArray[np.bool_]:
    held = np.zeros((basis.N, 3), dtype=np.bool_)
    for number, name in enumerate(scene.lattice.sides):
        kind = scene.side_condition(name).kind
        if kind not in ("free", "rigid", "roller"):
            raise ParameterError(
                f"sides.{name}: graded bricks know free, rigid and roller, got {kind!r}"
            )
        axis, upper = divmod(number, 2)
        on = np.abs(basis.doflocs[axis] - upper * scene.lattice.shape[axis]) < NEAR
        if kind == "rigid":
            held[on] = True
        elif kind == "roller":
            held[on, axis] = True
    return held.ravel()


def _solve(matrix: Any, right: Floats, places: Floats, free: NDArray[np.bool_]) -> Floats:
    if len(right) <= DIRECT:
        return factorised(matrix, right)
    import pyamg

    from .finite_elements import rigid_body_modes

    modes = rigid_body_modes(np.repeat(places, 3, axis=1))[free]
    hierarchy = pyamg.smoothed_aggregation_solver(matrix.tocsr(), B=modes)
    return np.asarray(hierarchy.solve(right, tol=RESIDUAL, accel="cg", maxiter=2000))
