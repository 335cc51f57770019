"""Compute the true answers of the benchmark's problems and of the worked plate.

Plane problems: triangles of order 4, graded geometrically towards every point where the
solution is singular (re-entrant corners, ends of the ground, ends of the load). The block:
a quarter of it, in hexahedra of order 2 graded towards its edges and those of the load. Each
answer is computed on two meshes; what they differ by is printed and goes into the source.
Needs scikit-fem. Run it with

    python benchmarks/finite_element_truth.py            # all; minutes, and 6 GB of memory
    python benchmarks/finite_element_truth.py block      # the block only
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyamg
import skfem as fem
from scipy.sparse import bmat, csr_array
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, eye, sym_grad, trace

from kaju.bench.problems import BLOCK, PIXELS, PLATE, Problem
from kaju.model.reference import Reference

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "kaju" / "bench"
TESTS = ROOT / "tests" / "data"

BLOCK_MESHES = (4, 6)
"""Elements in each graded section of the block's two meshes."""
LOADED_CELL = ((0.10, 0.2), (0.11, 0.2))
"""The worked example presses on cell 10 of 20: x from 100 to 110 mm."""


def law(problem: Problem) -> tuple[float, float]:
    """Return Lamé's λ (of plane stress in two dimensions) and μ."""
    modulus, ratio = problem.youngs_modulus, problem.poissons_ratio
    shear = modulus / (2.0 * (1.0 + ratio))
    if problem.dimension == 2:
        return modulus * ratio / (1.0 - ratio**2), shear
    return modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio)), shear


def graded_triangles(problem: Problem, patch, levels: int) -> fem.MeshTri:
    """Return triangles that get smaller and smaller towards every singular point."""
    nx, ny = problem.picture.shape
    whole = fem.MeshQuad.init_tensor(
        problem.edge * np.arange(nx + 1), problem.edge * np.arange(ny + 1)
    )
    middle = whole.p[:, whole.t].mean(axis=1)
    i, j = np.floor(middle / problem.edge).astype(int)
    mesh = whole.restrict(np.flatnonzero(problem.picture[i, j])).to_meshtri(style="x")
    singular = singular_points(problem, patch)
    for _ in range(levels):
        vertices = mesh.p[:, :, None] - singular.T[:, None, :]
        close = (np.abs(vertices).max(axis=0) < 1e-9 * problem.edge).any(axis=1)
        mesh = mesh.refined(np.flatnonzero(close[mesh.t].any(axis=0)))
    return mesh


def singular_points(problem: Problem, patch) -> np.ndarray:
    """Return re-entrant corners, and the ends of the ground and of the load."""
    padded = np.pad(problem.picture, 1)
    four = padded[:-1, :-1].astype(int) + padded[1:, :-1] + padded[:-1, 1:] + padded[1:, 1:]
    found = [problem.edge * np.argwhere(four == 3), np.array(patch)]
    ground = padded[:, 1].astype(int)
    ends = np.flatnonzero(np.diff(ground))
    found.append(np.stack([problem.edge * ends, 0.0 * ends], axis=1))
    return np.concatenate(found)


def solve(basis: fem.Basis, problem: Problem, patch, held) -> tuple[np.ndarray, float]:
    """Return displacements and strain energy of a mesh."""
    lame, shear = law(problem)

    @fem.BilinearForm
    def stiffness(u, v, w):
        strain = sym_grad(u)
        stress = lame * eye(trace(strain), strain.shape[0]) + 2.0 * shear * strain
        return problem.thickness * ddot(stress, sym_grad(v))

    low, high = (np.asarray(corner) for corner in patch)

    def loaded(x):
        near = 1e-9 * problem.edge
        return np.all((low - near < x.T) & (high + near > x.T), axis=-1).T

    width = (high - low)[0]
    facets = basis.mesh.facets_satisfying(loaded, boundaries_only=True)
    side = fem.FacetBasis(basis.mesh, basis.elem, facets=facets)

    @fem.LinearForm
    def load(v, w):
        return -problem.force / width * v[1]

    matrix, right = stiffness.assemble(basis), load.assemble(side)
    inner = basis.complement_dofs(held)
    u = np.zeros(basis.N)
    u[inner] = splu(matrix[inner][:, inner].tocsc()).solve(right[inner])
    return u, 0.5 * float(u @ right)


def block_stiffness(basis: fem.Basis) -> csr_array:
    """Return the block's stiffness from the nine products of first derivatives.

    Far quicker than a vector-valued form of order 2. Components alternate.
    """
    lame, shear = law(BLOCK)
    products = {
        (a, b): fem.BilinearForm(lambda u, v, w, a=a, b=b: v.grad[a] * u.grad[b]).assemble(basis)
        for a in range(3)
        for b in range(a, 3)
    }
    products |= {(b, a): product.T for (a, b), product in products.items() if a != b}
    straight = shear * sum(products[a, a] for a in range(3))
    blocks = [[lame * products[a, b] + shear * products[b, a] for b in range(3)] for a in range(3)]
    for a in range(3):
        blocks[a][a] = blocks[a][a] + straight
    order = np.arange(3 * basis.N).reshape(3, -1).T.ravel()
    return csr_array(bmat(blocks, format="csr"))[order][:, order]


def block_load(basis: fem.Basis) -> np.ndarray:
    """Return the pressure on the quarter's part of the patch, components alternating."""
    low = BLOCK.patch[0][0] - 1e-9

    def loaded(x):
        return (x[2] > 1.0 - 1e-12) & (x[0] > low) & (x[1] > low)

    facets = basis.mesh.facets_satisfying(loaded, boundaries_only=True)
    side = fem.FacetBasis(basis.mesh, basis.elem, facets=facets)
    pressure = fem.LinearForm(lambda v, w: -BLOCK.force / 0.25**2 * v).assemble(side)
    return np.stack([0.0 * pressure, 0.0 * pressure, pressure], axis=1).ravel()


def rigid_body_modes(places: np.ndarray) -> np.ndarray:
    """Return the shifts and turns of places, shape (3, n), in three dimensions."""
    modes = np.zeros((places.shape[1], 3, 6))
    modes[:, range(3), range(3)] = 1.0
    for turn, (a, b) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
        modes[:, a, turn], modes[:, b, turn] = -places[b], places[a]
    return modes.reshape(-1, 6)


def at_points(basis: fem.Basis, problem: Problem, u, points) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement and stress at points of the mesh."""
    lame, shear = law(problem)
    mesh, mapping = basis.mesh, basis.mapping
    element = np.asarray(mesh.element_finder(mapping=mapping)(*points.T))
    local = mapping.invF(points.T[:, :, None], tind=element)
    d = problem.dimension
    moved, gradient = np.zeros((d, len(points))), np.zeros((d, d, len(points)))
    for k in range(basis.Nbfun):
        shape = basis.elem.gbasis(mapping, local, k, tind=element)[0]
        weight = u[basis.element_dofs[k, element]]
        moved += np.asarray(shape)[..., 0] * weight
        gradient += shape.grad[..., 0] * weight
    strain = 0.5 * (gradient + gradient.transpose(1, 0, 2))
    stress = 2.0 * shear * strain
    stress += lame * np.trace(strain)[None, None] * np.eye(d)[:, :, None]
    return moved.T, stress.transpose(2, 0, 1)


def in_the_plane(problem: Problem, patch, levels: int, points):
    """Solve a plane problem; return displacement, stress and energy."""
    mesh = graded_triangles(problem, patch, levels)
    basis = fem.Basis(mesh, fem.ElementVector(fem.ElementTriP4()))
    held = basis.get_dofs(lambda x: x[1] < 1e-9 * problem.edge)
    u, energy = solve(basis, problem, patch, held)
    return (*at_points(basis, problem, u, points), energy, basis.N)


def graded(towards: dict[int, int], sections: int, count: int) -> np.ndarray:
    """Return positions in eighths of the block's edge, every eighth among them.

    `towards` names the sections that get denser, to their lower (0) or upper (1) end.
    """
    positions = [np.zeros(1)]
    for section in range(sections):
        x = np.linspace(0.0, 1.0, (count if section in towards else (count + 1) // 2) + 1)[1:]
        if section in towards:
            x = 1.0 - (1.0 - x) ** 2 if towards[section] else x**2
        positions.append(section + x)
    return BLOCK.edge * np.concatenate(positions)


def block(count: int, points) -> tuple[np.ndarray, float, int]:
    """Solve the block's quarter x, y < ½ and mirror it; return displacement and energy."""
    across = graded({0: 0, 2: 1, 3: 0}, 4, count)
    upwards = graded({0: 0, 7: 1}, 8, count)
    mesh = fem.MeshHex.init_tensor(across, across, upwards)
    basis = fem.Basis(mesh, fem.ElementHex2())
    low, middle = basis.doflocs < 1e-12, basis.doflocs > 0.5 - 1e-12
    held = np.stack([low[2] | middle[0], low[2] | middle[1], low[2]], axis=1).ravel()
    matrix, right = block_stiffness(basis), block_load(basis)
    u = np.zeros(len(right))
    reduced = matrix[~held][:, ~held]
    modes = rigid_body_modes(basis.doflocs)[~held]
    hierarchy = pyamg.smoothed_aggregation_solver(reduced, B=modes)
    u[~held] = hierarchy.solve(right[~held], tol=1e-11, accel="cg", maxiter=2000)
    energy = 0.5 * float(u @ right)
    folded = np.minimum(points, [0.5, 0.5, 1.0])
    mirrored = points[:, :2] > 0.5
    folded[:, :2] = np.where(mirrored, 1.0 - points[:, :2], points[:, :2])
    moved = interpolated(basis, u.reshape(-1, 3), folded)
    moved[:, :2] *= np.where(mirrored, -1.0, 1.0)
    return moved, 4.0 * energy, len(u)


def interpolated(basis: fem.Basis, u: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return values at points of a mesh of bricks."""
    corners = basis.mesh.p[:, basis.mesh.t]
    low, high = corners.min(axis=1) - 1e-12, corners.max(axis=1) + 1e-12
    element = [int(np.argmax(np.all((p >= low.T) & (p <= high.T), axis=1))) for p in points]
    local = basis.mapping.invF(points.T[:, :, None], tind=np.array(element))
    moved = np.zeros(points.shape)
    for k in range(basis.Nbfun):
        shape = basis.elem.gbasis(basis.mapping, local, k, tind=np.array(element))[0]
        moved += np.asarray(shape)[..., 0][:, None] * u[basis.element_dofs[k, element]]
    return moved


def gap(fine: np.ndarray, coarse: np.ndarray) -> float:
    """Return the largest difference as a share of the largest value."""
    return float(np.abs(fine - coarse).max() / np.abs(fine).max())


def write(path: Path, points, displacement, stress, energy, source: str) -> None:
    path.parent.mkdir(exist_ok=True)
    print(Reference(points, displacement, stress, energy, source).save(path))
    print("   ", source)


def plane_truth(problem: Problem, patch, points, path: Path, stressed: bool) -> None:
    """Compute a plane problem on two meshes and store the finer answer."""
    coarse, _, less, _ = in_the_plane(problem, patch, 10, points)
    fine, stress, energy, unknowns = in_the_plane(problem, patch, 16, points)
    source = (
        f"finite elements: graded triangles of order 4, {unknowns} unknowns (scikit-fem "
        f"{fem.__version__}); displacement within {gap(fine, coarse):.0e}, energy within "
        f"{abs(energy / less - 1.0):.0e} of the answer with 10 instead of 16 levels"
    )
    write(path, points, fine, stress if stressed else None, energy, source)


def worked_plate_points() -> np.ndarray:
    """Return the middles of the cells, and points along the loaded column and three rows."""
    middles = 0.005 + 0.01 * np.stack(np.meshgrid(*[np.arange(20)] * 2), axis=-1).reshape(-1, 2)
    every = 0.0025 * np.arange(1, 80)
    lines = [np.stack([np.full(79, 0.105), every], axis=1)]
    lines += [np.stack([every, np.full(79, height)], axis=1) for height in (0.195, 0.155, 0.105)]
    points = np.concatenate([middles, *lines])
    _, first = np.unique(np.rint(points / 1e-6).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def plates() -> None:
    """Write the references of the plane problems."""
    name = "plate_finite_elements"
    plane_truth(PLATE, LOADED_CELL, worked_plate_points(), TESTS / f"{name}.npz", True)
    corners = PLATE.edge * np.argwhere(np.ones((21, 21)))
    plane_truth(PLATE, LOADED_CELL, corners, TESTS / f"{name}_corners.npz", False)
    for problem in (PLATE, PIXELS):
        path = PACKAGE / f"truth_{problem.name}.npz"
        plane_truth(problem, problem.patch, problem.points, path, False)


def cube() -> None:
    """Write the reference of the block."""
    points = BLOCK.points
    (coarse, less, _), (fine, energy, unknowns) = (block(n, points) for n in BLOCK_MESHES)
    source = (
        f"finite elements: graded hexahedra of order 2 on a quarter, {unknowns} unknowns "
        f"(scikit-fem {fem.__version__}); displacement within {gap(fine, coarse):.0e}, energy "
        f"within {abs(energy / less - 1.0):.0e} of the answer with {BLOCK_MESHES[0]} instead of "
        f"{BLOCK_MESHES[1]} elements to a graded eighth"
    )
    write(PACKAGE / "truth_block.npz", points, fine, None, energy, source)


if __name__ == "__main__":
    if "block" not in sys.argv:
        plates()
    cube()
