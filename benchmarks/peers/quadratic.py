"""The adaptive peer: quadratic triangles from a coarse start, refined where residuals are large.

The square of a triangle's error in the energy norm is estimated by what its stress leaves
unbalanced inside, and by the jumps of traction on its sides (Verfürth, A Posteriori Error
Estimation Techniques, 2013, ch. 1; here for elasticity):

    η² = h²/2μ ∫ |div σ|² + Σ h_F/2μ ∫ |jump|²

where a jump counts half for either neighbour, and on a free side is t − σn. The triangles that
hold a given share of the sum are refined (Dörfler 1996). Matrices of all triangles are made in one
product. Of the mesh alone scikit-fem takes care.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints

from .bilinear import Solver, assembled, solved
from .problems import Problem

MARKED = 0.6  # The triangles with the largest η² that hold this share of the sum are refined
MOST = 400_000  # Triangles at which it ends
SIDES = ((0, 1), (1, 2), (0, 2))
"""Corners of the sides, as scikit-fem numbers them; behind every side's middle is a node."""
GAUSS = ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))
VERTICES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))


def shapes(points: Floats) -> Floats:
    """Return the six shape functions at points of the reference triangle, shape (6, n)."""
    x, y = points
    corner = np.array([1.0 - x - y, x, y])
    middle = [4.0 * corner[i] * corner[j] for i, j in SIDES]
    return np.concatenate([corner * (2.0 * corner - 1.0), middle])


def slopes(point: tuple[float, float]) -> Floats:
    """Return the slopes of the shape functions at a point, shape (6, 2)."""
    x, y = point
    corner, along = np.array([1.0 - x - y, x, y]), np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    middle = [4.0 * (corner[i] * along[j] + corner[j] * along[i]) for i, j in SIDES]
    return np.concatenate([(4.0 * corner[:, None] - 1.0) * along, middle])


_AT_GAUSS = np.array([slopes(point) for point in GAUSS])
PRODUCTS = np.einsum("qia,qjb->abij", _AT_GAUSS, _AT_GAUSS) / 6.0
"""Integrals of products of slopes over the reference triangle."""
AT_VERTICES = np.array([slopes(point) for point in VERTICES])


@dataclass(frozen=True, eq=False)
class QuadraticAnswer:
    """Displacements on a mesh."""

    mesh: Any
    displacement: Floats  # Of the vertices, then of the middles of sides (m). Shape (nodes, 2)
    energy: float  # Strain energy (J)
    squares: Floats  # η² (J). Shape (triangles,)

    @property
    def error_estimate(self) -> float:
        """Estimated relative error in the energy norm."""
        return sqrt(self.squares.sum() / (2.0 * self.energy))

    def at(self, points: Floats) -> Floats:
        """Return the displacements at points (m), shape (n, 2)."""
        found = self.mesh.element_finder()(*points.T)
        local = self.mesh.mapping().invF(points.T[:, :, None], tind=found)[..., 0]
        return np.einsum("in,nia->na", shapes(local), self.displacement[_nodes(self.mesh)[found]])


def adaptive(problem: Problem, solver: Solver) -> Iterator[QuadraticAnswer]:
    """Yield answers on finer and finer meshes of a plane body."""
    mesh = coarse_mesh(problem)
    while mesh.nelements <= MOST:
        answer = solve(problem, mesh, solver)
        yield answer
        worst = np.argsort(answer.squares)[::-1]
        held = np.cumsum(answer.squares[worst])
        mesh = mesh.refined(worst[: np.searchsorted(held, MARKED * held[-1]) + 1])


def coarse_mesh(problem: Problem) -> Any:
    """Return few triangles: between the ends of the load, or the picture's own cells."""
    import skfem

    if not problem.picture.all():
        ticks = [problem.edge * np.arange(n + 1) for n in problem.picture.shape]
        mesh = skfem.MeshTri.init_tensor(*ticks)
        cells = np.floor(mesh.p[:, mesh.t].mean(axis=1) / problem.edge).astype(int)
        return mesh.restrict(np.flatnonzero(problem.picture[tuple(cells)]))
    width, height = problem.edge * np.array(problem.picture.shape)
    first, last = problem.patch[0][0], problem.patch[1][0]
    across = [0.0, 0.5 * first, first, last, 0.5 * (last + width), width]
    up = height * np.array([0.0, 0.3, 0.6, 0.8, 1.0])
    return skfem.MeshQuad.init_tensor(np.array(across), up).to_meshtri(style="x")


def solve(problem: Problem, mesh: Any, solver: Solver) -> QuadraticAnswer:
    """Solve a plane problem on a mesh."""
    (a, b, c), nodes = mesh.p[:, mesh.t].transpose(1, 0, 2), _nodes(mesh)
    edges = np.stack([b - a, c - a], axis=1)
    twice_area = np.abs(edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    inverse = np.linalg.inv(edges.transpose(2, 0, 1))  # reference coordinates by place
    count = mesh.nvertices + mesh.nfacets

    facets = mesh.boundary_facets()
    ends = mesh.p[:, mesh.facets[:, facets]]
    near = 1e-9 * problem.edge
    ground = np.abs(ends[1]).max(axis=0) < near
    held = np.zeros(count, dtype=np.bool_)
    held[mesh.facets[:, facets[ground]].ravel()] = True
    held[mesh.nvertices + facets[ground]] = True

    matrix = _matrix(problem, nodes, inverse, twice_area, held)
    traction = np.zeros((2, len(facets)))
    loaded = problem.pressed(ends.mean(axis=1).T, 0.0)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]))
    traction[1, loaded] = -problem.force / lengths[loaded].sum()
    load, force = np.zeros((count, 2)), (traction * lengths).T
    for corner in mesh.facets[:, facets]:
        np.add.at(load, corner, force / 6.0)
    load[mesh.nvertices + facets] = force * 2 / 3
    places = np.concatenate([mesh.p.T, mesh.p[:, mesh.facets].mean(axis=1).T])
    found = np.zeros((count, 2))
    found[~held] = solved(matrix, load[~held].ravel(), places[~held], solver).reshape(-1, 2)
    energy = 0.5 * float((load * found).sum())
    stress = _stress(problem, found[nodes], inverse)
    free = ~held[mesh.nvertices + facets]
    squares = _squares(problem, mesh, stress, inverse, traction * free, free)
    return QuadraticAnswer(mesh, found, energy, squares)


def _nodes(mesh: Any) -> Ints:
    """Return the six nodes of every triangle."""
    return np.concatenate([mesh.t, mesh.nvertices + mesh.t2f]).T


def _matrix(problem: Problem, nodes: Ints, inverse: Floats, twice_area: Floats, held: Flags) -> Any:
    """Return the stiffness of the nodes that are not held."""
    lateral, shear = problem.lame
    scaled = inverse * np.sqrt(twice_area)[:, None, None]
    products = np.einsum("abij,nac,nbd->ncdij", PRODUCTS, scaled, scaled, optimize=True)
    both = shear * (products[:, 0, 0] + products[:, 1, 1])
    local = np.empty((len(nodes), 6, 2, 6, 2))
    for a in range(2):
        for b in range(2):
            block = lateral * products[:, a, b] + shear * products[:, b, a]
            local[:, :, a, :, b] = block + both if a == b else block
    number = np.where(held, -1, np.cumsum(~held) - 1)[nodes]
    return assembled(local.reshape(len(nodes), 12, 12), number)


def _stress(problem: Problem, moved: Floats, inverse: Floats) -> Floats:
    """Return stresses times thickness (N/m) at the vertices, shape (3, triangles, 2, 2)."""
    lateral, shear = problem.lame
    gradient = np.einsum("vir,nrc,nia->vnac", AT_VERTICES, inverse, moved, optimize=True)
    volume = np.trace(gradient, axis1=2, axis2=3)[..., None, None] * np.eye(2)
    return np.asarray(lateral * volume + shear * (gradient + gradient.swapaxes(2, 3)))


def _squares(
    problem: Problem, mesh: Any, stress: Floats, inverse: Floats, given: Floats, free: Flags
) -> Floats:
    """Return η² of every triangle (J); `given` and `free` are of the facets of the boundary."""
    twice_area = 1.0 / np.abs(np.linalg.det(inverse))
    growth = stress[1:] - stress[:1]
    inside = np.einsum("rnac,nrc->na", growth, inverse)
    total = 0.5 * twice_area**2 * (inside**2).sum(axis=1)

    ends = mesh.p[:, mesh.facets]
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along)
    normal = np.stack([along[1], -along[0]]) / length

    def traction(side: int) -> Floats:
        """Return what the triangles of a side pull with, at both ends of every facet."""
        triangle = mesh.f2t[side]
        local = [np.argmax(mesh.t[:, triangle] == corner, axis=0) for corner in mesh.facets]
        return np.array([np.einsum("fac,cf->af", stress[at, triangle], normal) for at in local])

    def squared(jump: Floats) -> Floats:
        """Return the integral over every facet of a jump that runs linearly between its ends."""
        first, last = jump
        return (first**2 + first * last + last**2).sum(axis=0) / 3.0

    one, other = traction(0), traction(1)
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    shared = 0.5 * length[inner] ** 2 * squared((one - other)[..., inner])
    for side in (0, 1):
        np.add.at(total, mesh.f2t[side, inner], shared)
    facets = mesh.boundary_facets()
    triangle = mesh.f2t[0, facets]
    outwards = ends[:, :, facets].mean(axis=1) - mesh.p[:, mesh.t[:, triangle]].mean(axis=1)
    sign = np.sign((outwards * normal[:, facets]).sum(axis=0))
    missing = np.where(free, given - sign * one[..., facets], 0.0)
    np.add.at(total, triangle, length[facets] ** 2 * squared(missing))
    return np.asarray(total / (2.0 * problem.lame[1]))
