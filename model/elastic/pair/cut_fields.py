"""Both fields of agents that outlines cut, on squares and triangles.

The squares are those of `elements`, the triangles those of `cut_elements`; both have their
unknowns at vertices and edges. Unknowns of vertices that are very near to others count from these:
else what neighbours have in common, which is soft, would drown in what parts them, which is stiff.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of
from kaju.model.outline.true_shapes import Law

from .cut_border import Border, Known
from .cut_elements import integrated, quadratic_strain, stress_rows
from .cut_mesh import CutMesh
from .elements import forms, means, rule, stresses
from .leaf_mesh import Entries, coo, followed, on_cubic, on_parabola

SHORT = 0.1  # edges that are shorter, in edges of the agent, join vertices that are near
NOTHING = 1e-14  # coefficients below are rounding of 0, lengths in edges of the first agents
MOST_STEPS = 20  # of conjugate gradients
SHIFT = 1e-14
"""On a diagonal of 1: rounding alone would leave factors of needles indefinite. Conjugate gradients
take it out again. Energies of bodies with slivers of 3e-9 to 1e-7 are then bounded to 2e-7, where
they were bounded to 0.1."""
SETTLED = 1e-10  # share of the energy gained so far by which the last of them gains less


def law_parts(laws: list[Law], balances: bool) -> Floats:
    """Return moduli or compliances of like and unlike normal stresses, and of shear, (n, 3)."""
    matrix = np.array([law.compliance if balances else law.stiffness for law in laws])
    return matrix[:, [0, 0, 2], [0, 1, 2]]


class Solved:
    """Least ½ uᵀ K u − fᵀ u, by factors."""

    def __init__(self, matrix: sp.csr_array):
        diagonal = matrix.diagonal()
        self._scale = np.where(diagonal > 0.0, diagonal, 1.0) ** -0.5
        scale = sp.diags_array(self._scale)
        scaled = scale @ matrix @ scale + sp.diags_array((diagonal <= 0.0) + SHIFT)
        self._factors = factors_of(sp.csc_array(scaled))

    def __call__(self, force: Floats) -> Floats:
        """Return u."""
        return np.asarray(self._scale * self._factors.solve(self._scale * force))


class Near:
    """Vertices that are very near to others, and what they count from.

    Triangles between them are needles. In common unknowns what neighbours do together, which is
    soft, would drown in what parts them, which is stiff.
    """

    def __init__(self, mesh: CutMesh, size: Floats, free: Flags):
        self.mesh, whole = mesh, mesh.hanging
        # vertices in the middle of sides follow the ends of these
        rests = {
            m: [int(a), int(b)]
            for m, (a, b) in zip(whole[1].tolist(), mesh.ends[whole[0]], strict=True)
        }
        length, most = np.hypot(*mesh.run.T), np.zeros(len(mesh.ends))
        np.maximum.at(most, mesh.triangle_edge.ravel(), np.repeat(size[mesh.triangle_leaf], 3))
        short = np.flatnonzero(length < SHORT * most)
        root: dict[int, int] = {}

        def top(vertex: int) -> int:
            while vertex in root:
                vertex = root[vertex]
            return vertex

        def counts_from(vertex: int, on: int) -> bool:
            todo = [vertex]
            while todo:
                one = todo.pop()
                if one == on:
                    return True
                todo += rests.get(one, [])
            return False

        pairs = []
        for edge in short[np.argsort(length[short])].tolist():
            a, b = (top(int(vertex)) for vertex in mesh.ends[edge])
            for above, child in ((a, b), (b, a)):
                loose = a != b and free[child] and child not in rests
                if loose and not counts_from(above, child):
                    rests[child], root[child] = [above], above
                    pairs.append((child, above))
                    break
        self.pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def of_points(self) -> sp.csr_array:
        """Return what values at vertices, two each, are by what counts from others."""
        child, above = self.pairs.T
        n = 2 * len(self.mesh.place)
        return _summed([(2 * child + j, 2 * above + j, 1.0) for j in (0, 1)], n)

    def of_slopes(self, ties: Entries) -> sp.csr_array:
        """Return what φ, its slopes and bulges are by what counts from others, or is tied."""
        mesh, (child, above) = self.mesh, self.pairs.T
        away = mesh.place[child] - mesh.place[above]
        entries: Entries = [(3 * child + j, 3 * above + j, 1.0) for j in (0, 1, 2)]
        entries += [(3 * child, 3 * above + 1 + axis, away[:, axis]) for axis in (0, 1)]
        return _summed(entries + ties, 3 * len(mesh.place) + len(mesh.ends))


def _summed(entries: Entries, size: int) -> sp.csr_array:
    """Return what unknowns are, where each is its own and what it has of others, further on."""
    one = sp.csr_array(sp.eye_array(size, format="csr"))
    step = power = coo(entries, (size, size))
    step.sum_duplicates()
    while power.nnz:
        one, power = one + power, power @ step
        power.eliminate_zeros()
    return sp.csr_array(one)


def _assembled(matrix: Floats, dof: Ints, count: int) -> sp.csr_array:
    """Return the sum of the matrices of elements."""
    rows = np.broadcast_to(dof[:, :, None], matrix.shape).ravel()
    columns = np.broadcast_to(dof[:, None], matrix.shape).ravel()
    return sp.csr_array((matrix.ravel(), (rows, columns)), shape=(count, count))


def _diagonal(blocks: Floats) -> sp.csr_array:
    """Return a matrix of blocks along its diagonal."""
    n, m = blocks.shape[:2]
    return sp.csr_array(
        sp.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(n * m, n * m))
    )


class CutFitting:
    """A displacement without gaps on squares and triangles: quadratic on all edges."""

    def __init__(
        self,
        mesh: CutMesh,
        border: Border,
        laws: list[Law],
        weight: Floats,
        size: Floats,
        loose: Flags,
    ):
        self.mesh = mesh
        nodes = len(mesh.place)
        count = 2 * (nodes + len(mesh.ends))
        of = np.concatenate([mesh.square, nodes + mesh.square_edge], axis=1)
        self.square_dof = (2 * of[:, :, None] + [0, 1]).reshape(-1, 16)
        of = np.concatenate([mesh.triangle, nodes + mesh.triangle_edge], axis=1)
        self.triangle_dof = (2 * of[:, :, None] + [0, 1]).reshape(-1, 12)
        self._square = np.einsum("lk,kij->lij", law_parts(laws, False), forms(False))
        self.strain, self.area = quadratic_strain(mesh.place[mesh.triangle])
        stiffness = np.array([law.stiffness for law in laws])
        self._triangle = integrated(self.strain, stiffness[mesh.triangle_law], self.area)
        self.force = self._forces(border, weight)
        way = self._way(border, size, loose)
        self.unknowns = way.shape[1]
        matrix = _assembled(self._square[mesh.square_law], self.square_dof, count)
        matrix = sp.csr_array(
            way.T @ (matrix + _assembled(self._triangle, self.triangle_dof, count)) @ way
        )
        solve = Solved(matrix)
        self.value = way @ solve(way.T @ self.force)
        self.value += way @ solve(way.T @ (self.force - self._borne(count)))
        self.square, self.triangle = self.value[self.square_dof], self.value[self.triangle_dof]

    def _forces(self, border: Border, weight: Floats) -> Floats:
        """Return the work of the loads on the unknowns."""
        mesh, nodes, force = self.mesh, len(self.mesh.place), border.forces(self.mesh)
        if weight.any():
            size = mesh.place[mesh.square[:, 3]] - mesh.place[mesh.square[:, 0]]
            of = np.concatenate([mesh.square, nodes + mesh.square_edge], axis=1)
            np.add.at(force, of, means(2)[:, None] * (size**2)[:, :1, None] * weight)
            for of in (mesh.triangle, nodes + mesh.triangle_edge):
                np.add.at(force, of, self.area[:, None, None] / 3.0 * weight)
        return force.ravel()

    def _way(self, border: Border, size: Floats, loose: Flags) -> sp.csr_array:
        """Return what the unknowns are by the free ones; parts that hang on nothing stay."""
        mesh, nodes = self.mesh, len(self.mesh.place)
        total = nodes + len(mesh.ends)
        fixed = np.zeros((total, 2), dtype=np.bool_)
        for axis in (0, 1):
            on = border.held[:, axis]
            fixed[border.ends[on], axis] = fixed[nodes + border.edge[on], axis] = True
        fixed[:nodes][loose[mesh.parts]] = True
        fixed[nodes:][loose[mesh.parts[mesh.ends[:, 0]]]] = True
        whole, middle, halves = mesh.hanging
        ends = on_parabola(middle, mesh.ends[whole], nodes + whole, nodes + halves)
        tie, slave = followed(ends, total)
        both = sp.kron(tie, sp.eye_array(2), format="csr")
        near = Near(mesh, size, ~(slave | fixed.any(axis=1))[:nodes]).of_points()
        every = sp.block_diag([near, sp.eye_array(2 * len(mesh.ends))], format="csc")
        free = np.flatnonzero(~(slave[:, None] | fixed).ravel())
        return sp.csr_array(both @ every[:, free])

    def _borne(self, count: int) -> Floats:
        out = np.zeros(count)
        for matrix, dof in (
            (self._square[self.mesh.square_law], self.square_dof),
            (self._triangle, self.triangle_dof),
        ):
            np.add.at(out, dof, np.einsum("nij,nj->ni", matrix, self.value[dof]))
        return out

    @property
    def work(self) -> float:
        """The work of the loads."""
        return float(self.force @ self.value)

    def energies(self, leaves: int) -> Floats:
        """Return twice the energy of each leaf."""
        mesh = self.mesh
        square = np.einsum("ni,nij,nj->n", self.square, self._square[mesh.square_law], self.square)
        triangle = np.einsum("ni,nij,nj->n", self.triangle, self._triangle, self.triangle)
        out = np.zeros(leaves)
        np.add.at(out, mesh.square_leaf, square)
        np.add.at(out, mesh.triangle_leaf, triangle)
        return out


class Balancing:
    """A stress in balance: Airy's φ, cubic on fourths of squares and on thirds of triangles."""

    def __init__(
        self, mesh: CutMesh, border: Border, laws: list[Law], weight: Floats, size: Floats
    ):
        self.mesh, self.weight = mesh, weight
        nodes = len(mesh.place)
        self._count = 3 * nodes + len(mesh.ends)
        at = (3 * mesh.square[:, :, None] + [0, 1, 2]).reshape(-1, 12)
        self.square_dof = np.concatenate([at, 3 * nodes + mesh.square_edge], axis=1)
        at = (3 * mesh.triangle[:, :, None] + [0, 1, 2]).reshape(-1, 9)
        self.triangle_dof = np.concatenate([at, 3 * nodes + mesh.triangle_edge], axis=1)
        edge = (mesh.place[mesh.square[:, 3]] - mesh.place[mesh.square[:, 0]])[:, :1]
        self.size = edge[:, 0]
        self.scale = np.hstack([*[np.ones_like(edge), edge, edge] * 4, *[edge] * 4])
        unit = np.einsum("lk,kij->lij", law_parts(laws, True), forms(True))
        self._square = unit[mesh.square_law] / self.size[:, None, None] ** 2
        at, normal = mesh.place[mesh.triangle], mesh.normal[mesh.triangle_edge]
        self.rows, self.corners, self.third = stress_rows(at, normal)
        compliance = np.array([law.compliance for law in laws])
        of = compliance[mesh.triangle_law]
        # stresses in the middles of the edges of thirds as rows whose squares add up to the energy:
        # of needles the matrix of unknowns has too few digits
        middle = 0.5 * (self.rows + np.roll(self.rows, -1, axis=2))
        root = np.swapaxes(np.linalg.cholesky(of), 1, 2) * np.sqrt(self.third / 3.0)[:, None, None]
        rows = np.einsum("nab,nkcbi->nkcai", root, middle).reshape(-1, 27, 12)
        self._root: Floats = np.asarray(np.linalg.qr(rows, mode="r"))
        self._bear(of, compliance)
        known = Known(mesh, border, weight)
        tie, ties, beyond = self._ties(known)
        slave = np.asarray(tie.diagonal() == 0.0)
        free = np.asarray(~(slave | known.fixed))
        own_free: Flags = np.asarray(free[: 3 * nodes].reshape(-1, 3).all(axis=1))
        near = sp.csc_array(Near(mesh, size, own_free).of_slopes(ties))
        own = sp.csr_array(near[:, np.flatnonzero(free)])
        plane = sp.csr_array(tie @ known.free)
        self._settle(own, plane, tie @ known.value + beyond, known)

    def _settle(self, own: sp.csr_array, plane: sp.csr_array, start: Floats, known: Known) -> None:
        """Solve for the rest of φ, by own unknowns and linear functions of free borders."""
        strip = [self._stripped(k) for k in (0, 1)]
        blocks = [_diagonal(self._square), _diagonal(self._root)]
        every = sp.csr_array(sp.hstack([own, plane]))
        ways = [_cleaned(strip[0] @ plane), _cleaned(strip[1] @ every)]
        self.unknowns, first = every.shape[1], own.shape[1]
        square = _assembled(
            self._square * self.scale[:, :, None] * self.scale[:, None],
            self.square_dof,
            self._count,
        )
        stiff = blocks[0] @ ways[0]
        gather = coo(
            [(np.arange(self.square_dof.size), self.square_dof.ravel(), self.scale.ravel())],
            (self.square_dof.size, self._count),
        )
        mixed = sp.csr_array(own.T @ (gather.T @ stiff))
        whole = sp.block_array([[own.T @ square @ own, mixed], [mixed.T, ways[0].T @ stiff]])
        rooted = sp.csr_array(blocks[1] @ ways[1])
        matrix = sp.csr_array(whole + rooted.T @ rooted)
        solve = Solved(matrix)
        self.square = (strip[0] @ start).reshape(-1, 16)
        self.triangle = (strip[1] @ start).reshape(-1, 12)
        self._across(known)

        def moved(found: Floats) -> tuple[Floats, Floats]:
            square = strip[0] @ (own @ found[:first]) + ways[0] @ found[first:]
            return square.reshape(-1, 16), (ways[1] @ found).reshape(-1, 12)

        def left() -> Floats:
            slope, other = (one.ravel() for one in self._slopes())
            beside = np.concatenate([own.T @ (gather.T @ slope), ways[0].T @ slope])
            return np.asarray(-(ways[1].T @ other) - beside)

        # conjugate gradients: of needles rounding leaves the factors few digits
        rest = left()
        direction = solve(rest)
        power, gained = float(rest @ direction), 0.0
        for _ in range(MOST_STEPS):
            whole, cut = moved(direction)
            pull = float(rest @ direction)
            bent = float((np.einsum("nij,nj->ni", self._square, whole) * whole).sum())
            bent += float((np.einsum("nij,nj->ni", self._root, cut) ** 2).sum())
            if pull <= 0.0 or bent <= 0.0:
                break
            self.square += pull / bent * whole
            self.triangle += pull / bent * cut
            gain = 0.5 * pull**2 / bent
            gained += gain
            if gain < SETTLED * gained:
                break
            before, rest = rest, left()
            turned = solve(rest)
            share = max(float((rest - before) @ turned) / power, 0.0)
            direction, power = turned + share * direction, float(rest @ turned)

    def _stripped(self, kind: int) -> sp.csr_array:
        """Return elements' unknowns by the shared ones, less linear functions, which bear none."""
        mesh = self.mesh
        dof, vertex = ((self.square_dof, mesh.square), (self.triangle_dof, mesh.triangle))[kind]
        (n, m), k = dof.shape, vertex.shape[1]
        away = mesh.place[vertex] - mesh.place[vertex[:, :1]]
        row = m * np.arange(n)[:, None] + np.arange(m)
        entries: Entries = [(row.ravel(), dof.ravel(), 1.0)]
        for j in range(k):
            for axis in (-1, 0, 1):
                entries.append((row[:, 3 * j + 1 + axis], dof[:, 1 + axis], -1.0))
                if axis >= 0:
                    entries.append((row[:, 3 * j], dof[:, 1 + axis], -away[:, j, axis]))
        out = coo(entries, (n * m, self._count))
        if kind == 0:
            out = sp.csr_array(sp.diags_array(self.scale.ravel()) @ out)
        out.eliminate_zeros()
        return out

    def _across(self, known: Known) -> None:
        """Add what elements that a ray crosses see of φ beyond it."""
        mesh = self.mesh
        for vertex, field, scale in (
            (mesh.square, self.square, self.scale), (mesh.triangle, self.triangle, None),
        ):  # fmt: skip
            at = mesh.place[vertex]
            for ray in known.rays:
                middle = np.broadcast_to(at.mean(axis=1, keepdims=True), at.shape)
                passed = ray.passed(middle, at)
                crossed = np.flatnonzero(passed.any(axis=1))
                own = passed[crossed, :, None] * ray.at(at[crossed])
                slope = own[:, 0, 1:].copy()
                own[..., 0] -= own[:, :1, 0] + np.einsum(
                    "nkd,nd->nk", at[crossed] - at[crossed, :1], slope
                )
                own[..., 1:] -= slope[:, None]
                own = own.reshape(len(crossed), 3 * vertex.shape[1])
                field[crossed, : own.shape[1]] += (
                    own if scale is None else own * scale[crossed, : own.shape[1]]
                )

    def _ties(self, known: Known) -> tuple[sp.csr_array, Entries, Floats]:
        """Return what all unknowns are by those that follow none, and what beyond rays is added."""
        mesh, nodes, count = self.mesh, len(self.mesh.place), self._count
        whole, middle, halves = mesh.hanging
        a, b = mesh.ends[whole].T
        run, row = mesh.run[whole], np.arange(len(whole))
        axis = (run[:, 0] == 0.0).astype(np.int64)
        length = run[row, axis]
        bulge = 3 * nodes + whole
        ties: Entries = []
        beyond = np.zeros(count)
        for end, sign in ((a, 1.0), (b, -1.0)):
            of = on_cubic(middle, end, sign, axis, length)
            ties += of
            for ray in known.rays:
                # an end is seen from the middle
                passed = ray.passed(mesh.place[middle], mesh.place[end])
                jump = passed[:, None] * ray.at(mesh.place[end])
                for rows, columns, values in of:
                    np.add.at(beyond, rows, values * jump[row, columns - 3 * end])
        ties.append((3 * middle + 2 - axis, bulge, 1.0))
        ties += [(3 * nodes + half, bulge, 0.25) for half in halves]
        follow = coo(ties, (count, count))
        total, further = beyond, follow @ beyond
        while further.any():
            total, further = total + further, follow @ further
        return followed(ties, count)[0], ties, total

    def _slopes(self) -> tuple[Floats, Floats]:
        return (
            np.einsum("nij,nj->ni", self._square, self.square) + self._square_load,
            np.einsum("nji,nj->ni", self._root, self._rooted()) + self._triangle_load,
        )

    def _rooted(self) -> Floats:
        return np.asarray(np.einsum("nij,nj->ni", self._root, self.triangle))

    def _bear(self, of: Floats, compliance: Floats) -> None:
        """Set what the stress that bears the weight, σ_ii = −weight_i x_i, adds to the energy."""
        self._square_load = np.zeros((len(self.mesh.square), 16))
        self._triangle_load = np.zeros((len(self.mesh.triangle), 12))
        self._square_own = np.zeros(len(self.mesh.square))
        self._triangle_own = np.zeros(len(self.mesh.triangle))
        if not self.weight.any():
            return
        mesh, (points, weights, _) = self.mesh, rule()
        points = mesh.place[mesh.square[:, 0]][:, None] + self.size[:, None, None] * points
        strain = np.einsum("nab,nqb->nqa", compliance[mesh.square_law], self.bearing(points))
        self._square_load = np.einsum("q,qai,nqa->ni", weights, stresses(), strain)
        own = np.einsum("q,nqa,nqa->n", weights, self.bearing(points), strain)
        self._square_own = self.size**2 * own
        middle = 0.5 * (self.corners + np.roll(self.corners, -1, axis=2))
        rows = 0.5 * (self.rows + np.roll(self.rows, -1, axis=2))
        strain = np.einsum("nab,nkcb->nkca", of, self.bearing(middle))
        share = self.third / 3.0
        self._triangle_load = share[:, None] * np.einsum("nkcai,nkca->ni", rows, strain)
        self._triangle_own = share * np.einsum("nkca,nkca->n", self.bearing(middle), strain)

    def bearing(self, points: Floats) -> Floats:
        """Return the stress (xx, yy, xy) that bears the weight at points."""
        out = np.zeros((*points.shape[:-1], 3))
        out[..., :2] = -self.weight * points
        return out

    def energies(self, leaves: int) -> Floats:
        """Return twice the complementary energy of each leaf."""
        mesh = self.mesh
        square = np.einsum("ni,nij,nj->n", self.square, self._square, self.square)
        square += 2.0 * (self.square * self._square_load).sum(axis=1) + self._square_own
        triangle = (self._rooted() ** 2).sum(axis=1)
        triangle += 2.0 * (self.triangle * self._triangle_load).sum(axis=1) + self._triangle_own
        out = np.zeros(leaves)
        np.add.at(out, mesh.square_leaf, square)
        np.add.at(out, mesh.triangle_leaf, triangle)
        return out


def _cleaned(matrix: sp.csr_array) -> sp.csr_array:
    """Return a matrix without what is rounding of 0."""
    matrix = sp.csr_array(matrix)
    matrix.data[np.abs(matrix.data) < NOTHING] = 0.0
    matrix.eliminate_zeros()
    return matrix
