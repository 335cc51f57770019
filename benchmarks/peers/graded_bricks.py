"""The truth of scenes of cubes: bricks of order 2, graded to planes where edges are singular.

Volume changes are integrated by two points an axis, which keeps nearly incompressible bodies
from locking (Hughes, The Finite Element Method, ch. 4). Needs scikit-fem and pyamg.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kaju.agents.elastic_rule import Moduli
from kaju.arrays import Floats
from kaju.factors import factors_of
from kaju.model.scene import Scene
from kaju.model.study.finite_elements import (
    ElementField,
    cells_of,
    depth,
    element_moduli,
    multigrid,
    solve_on,
    surroundings,
)

DIRECT = 60_000  # Up to this many unknowns are factorised
RESIDUAL = 1e-11


def solve_bricks(scene: Scene, singular: Sequence[Sequence[int]], parts: int) -> ElementField:
    """Solve a scene of cubes.

    `scene`: of few cells. Sides are free, rigid or rollers; forces enter by faces of cells;
    `singular`: along each axis the grid planes, counted in cells, towards which bricks get thinner;
    `parts`: bricks along a cell that such a plane bounds; along others half as many.
    """
    import skfem

    kinds = surroundings(scene)
    whole = skfem.MeshHex.init_tensor(
        *(
            graded_ticks(n, planes, parts, (parts + 1) // 2)
            for n, planes in zip(scene.lattice.shape, singular, strict=True)
        )
    )
    mesh = whole.restrict(np.flatnonzero(kinds[tuple(cells_of(whole) + 1)] >= 0))
    element = skfem.ElementHex2()
    scalar = skfem.Basis(mesh, element, intorder=4)
    matrix = depth(scene) * _stiffness(element_moduli(scene, mesh, kinds), scalar)
    # Where nothing acts within, one point a brick will do, which takes far less memory.
    inside = bool((scene.applied().direction < 0).any())
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=4 if inside else 1)

    def solve(matrix: Any, right: Floats, motions: Floats) -> Floats:
        if len(right) <= DIRECT:
            return factors_of(matrix).solve(right)
        return multigrid(matrix.tocsr(), right, motions, RESIDUAL)

    return solve_on(scene, basis, kinds, solve, matrix)


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


def _stiffness(moduli: Moduli, basis: Any) -> Any:
    """Return the stiffness from products of first derivatives, far quicker than a vector's form."""
    import skfem
    from scipy.sparse import block_array

    few = skfem.Basis(basis.mesh, basis.elem, intorder=3)

    def product(points: Any, modulus: Floats, a: int, b: int) -> Any:
        form = skfem.BilinearForm(lambda u, v, w: w.modulus * v.grad[a] * u.grad[b])
        return form.assemble(points, modulus=modulus[:, None] * np.ones_like(points.dx))

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
