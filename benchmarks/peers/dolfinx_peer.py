"""A peer: bilinear finite elements of dolfinx, solved by conjugate gradients with hypre.

dolfinx comes with Debian or conda rather than from PyPI, so it often lives in another Python
than kaju. Hence this file is a script of its own: it needs NumPy and dolfinx only, reads one
``.npz`` file that says what to solve, and writes another one with the answer:

    python3 dolfinx_peer.py question.npz answer.npz
"""

from __future__ import annotations

import resource
import sys
import time
from typing import Any

import numpy as np


def solve(question: dict[str, Any], division: int) -> tuple[Any, Any]:
    """Return the mesh's nodes and their displacements."""
    import ufl
    from dolfinx import fem, mesh
    from dolfinx.fem import petsc as assembly
    from mpi4py import MPI
    from petsc4py import PETSc

    nodes, cells = grid(question["picture"], division, float(question["edge"]))
    d = nodes.shape[1]
    form = "quadrilateral" if d == 2 else "hexahedron"
    body = mesh.create_mesh(
        MPI.COMM_SELF, cells, nodes, ufl.Mesh(ufl.VectorElement("Lagrange", form, 1))
    )
    space = fem.VectorFunctionSpace(body, ("Lagrange", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    modulus, ratio = float(question["youngs_modulus"]), float(question["poissons_ratio"])
    shear = modulus / (2.0 * (1.0 + ratio))
    lame = modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    if d == 2:  # plane stress
        lame = modulus * ratio / (1.0 - ratio**2)
    strain = ufl.sym(ufl.grad(u))
    stress = lame * ufl.tr(strain) * ufl.Identity(d) + 2.0 * shear * strain
    thickness = float(question["thickness"])
    energy = fem.form(thickness * ufl.inner(stress, ufl.sym(ufl.grad(v))) * ufl.dx)
    lower, upper = question["patch"]
    near = 1e-9 * float(question["edge"])

    def pressed(x: Any) -> Any:
        within = [(a - near < c) & (c < b + near) for a, c, b in zip(lower, x, upper)]  # noqa: B905
        return np.logical_and.reduce(within)

    facets = np.sort(mesh.locate_entities_boundary(body, d - 1, pressed))
    tags = mesh.meshtags(body, d - 1, facets, np.ones(len(facets), dtype=np.int32))
    side = ufl.Measure("ds", domain=body, subdomain_data=tags)(1)
    traction = float(question["force"]) / float(np.prod((upper - lower)[:-1]))
    work = fem.form(-fem.Constant(body, PETSc.ScalarType(traction)) * v[d - 1] * side)
    ground = fem.locate_dofs_geometrical(space, lambda x: x[d - 1] < near)
    held = fem.dirichletbc(np.zeros(d, dtype=PETSc.ScalarType), ground, space)
    matrix = assembly.assemble_matrix(energy, bcs=[held])
    matrix.assemble()
    right = assembly.assemble_vector(work)
    assembly.apply_lifting(right, [energy], bcs=[[held]])
    assembly.set_bc(right, [held])
    solver = PETSc.KSP().create(MPI.COMM_SELF)
    solver.setOperators(matrix)
    solver.setType("cg")
    solver.getPC().setType("hypre")
    solver.getPC().setHYPREType("boomeramg")
    options = PETSc.Options()
    options["pc_hypre_boomeramg_strong_threshold"] = 0.25 if d == 2 else 0.5
    solver.setTolerances(rtol=float(question["residual"]), max_it=1000)
    solver.setFromOptions()
    moved = fem.Function(space)
    solver.solve(right, moved.vector)
    if solver.getConvergedReason() < 0:
        raise RuntimeError(f"hypre did not converge: {solver.getConvergedReason()}")
    return space.tabulate_dof_coordinates()[:, :d], moved.x.array.reshape(-1, d)


def grid(picture: Any, division: int, edge: float) -> tuple[Any, Any]:
    """Return nodes and the cells between them, corners in tensor order (x fastest)."""
    fine = picture
    for axis in range(picture.ndim):
        fine = fine.repeat(division, axis=axis)
    shape = tuple(n + 1 for n in fine.shape)
    cells = np.argwhere(fine)
    corners = [
        np.ravel_multi_index(tuple((cells + np.array(corner[::-1])).T), shape)
        for corner in np.ndindex(*(2,) * picture.ndim)
    ]
    used, numbers = np.unique(np.stack(corners, axis=1), return_inverse=True)
    nodes = edge / division * np.stack(np.unravel_index(used, shape), axis=1)
    return nodes, numbers.reshape(len(cells), -1).astype(np.int64)


def at_points(nodes: Any, moved: Any, points: Any, size: float) -> Any:
    """Return the displacements of those nodes that lie at points."""
    place = {tuple(cell): row for row, cell in enumerate(np.rint(nodes / size).astype(int))}
    return moved[[place[tuple(cell)] for cell in np.rint(points / size).astype(int)]]


def main() -> None:
    """Answer one question: warm up, measure, write."""
    with np.load(sys.argv[1]) as file:
        question = dict(file)
    division = int(question["division"])
    solve(question, 2)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times: list[float] = []
    while len(times) < (1 if times and times[0] > float(question["long"]) else 3):
        began = time.perf_counter()
        nodes, moved = solve(question, division)
        times.append(time.perf_counter() - began)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    size = float(question["edge"]) / division
    found = at_points(nodes, moved, question["points"], size)
    np.savez(sys.argv[2], times=times, memory=(peak - before) / 1e3, displacement=found)


if __name__ == "__main__":
    main()
