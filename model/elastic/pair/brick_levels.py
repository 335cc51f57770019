"""The equations of bricks: conjugate gradients, with the generations before as levels.

The spaces of the generations lie within one another, so a V-cycle through them needs no operators
of its own: what a coarse generation has to give is carried down exactly (Brandt 1977; for nested
finite elements Bramble, Pasciak and Xu 1990). No matrix is assembled but that of the first
generation: all bricks of a material have the same one, times their edge.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats, Ints
from kaju.factors import factors_of
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.pair import bricks
from kaju.model.elastic.pair.brick_mesh import BrickMesh
from kaju.model.elastic.pair.levels import chebyshev
from kaju.stopping import interrupt_requested

MOST_ITERATIONS = 200
MOST_FACTORED = 6_000
"""Unknowns of a matrix that is factorised: 8,000 take half a second, and grow with the power 2."""


class BrickLevel:
    """The stiffness of one generation, and how it is solved."""

    def __init__(self, mesh: BrickMesh, moduli: Moduli) -> None:
        self.mesh = mesh
        # From masters to the nodes of every leaf, one row for each.
        self.gather = sp.csr_array(mesh.ties[mesh.node.ravel()])
        self.scatter = sp.csr_array(self.gather.T)
        self.materials = _by_kind(mesh, moduli)
        self.below: BrickLevel | HatLevel | None = None
        leaf, side, stiffness = mesh.bed
        area = stiffness * mesh.edge[leaf] ** 2
        self.beds = [
            (leaf[side == one], int(one), area[side == one, None]) for one in np.unique(side)
        ]

    def force(self, moved: Floats) -> Floats:
        """Return the forces on the nodes of leaves by their displacements, shape (n, 20, 3)."""
        flat = moved.reshape(-1, 60)
        found = np.empty_like(flat)
        for leaves, matrix in self.materials:
            found[leaves] = flat[leaves] @ matrix
        found *= self.mesh.edge[:, None]
        force = found.reshape(-1, 20, 3)
        for leaf, side, area in self.beds:
            axis = side // 2
            force[leaf, :, axis] += area * (moved[leaf, :, axis] @ bricks.side_masses()[side])
        return force

    def gathered(self, master: Floats) -> Floats:
        """Return the displacement of the nodes of leaves by that of the masters."""
        return np.asarray((self.gather @ master).reshape(-1, 20, 3))

    def summed(self, force: Floats) -> Floats:
        """Return the forces on masters by those on the nodes of leaves."""
        return np.asarray(self.scatter @ force.reshape(-1, 3))

    def apply(self, x: Floats) -> Floats:
        """Return the scaled stiffness times a vector of what is free to move."""
        force = self.summed(self.force(self.gathered(self.scale * x)))
        return np.asarray(self.scale * force)

    def first(self) -> None:
        """Begin: factorise the matrix, or stand on hats if it is large."""
        self._set_scale()
        mesh, n = self.mesh, len(self.mesh.leaves)
        if mesh.open.sum() > MOST_FACTORED:
            self.below = HatLevel(mesh, self.materials)
            self._smoothed(self.below.prolong)
            return
        blocks = np.empty((n, 60, 60))
        for leaves, matrix in self.materials:
            blocks[leaves] = matrix
        blocks *= mesh.edge[:, None, None]
        for leaf, side, area in self.beds:
            own = slice(side // 2, None, 3)
            blocks[leaf, own, own] += area[:, :, None] * bricks.side_masses()[side]
        place = (3 * mesh.node[:, :, None] + np.arange(3)).reshape(n, 60)
        row, column = (
            np.broadcast_to(p, blocks.shape).ravel() for p in (place[:, :, None], place[:, None])
        )
        whole = sp.csr_array((blocks.ravel(), (row, column)), shape=(3 * mesh.nodes,) * 2)
        ties = sp.csr_array(sp.kron(mesh.ties, sp.eye_array(3)))
        self.places = np.flatnonzero(mesh.open.ravel())
        ties = sp.csr_array(ties[:, self.places] @ sp.diags_array(self.scale.ravel()[self.places]))
        self.factors = factors_of(sp.csc_array(ties.T @ whole @ ties))

    def on(self, below: BrickLevel, parent: Ints, child: Ints) -> None:
        """Stand on the generation before: `child` of `parent` is each leaf, as in `descents`."""
        self._set_scale()
        self.below, mesh = below, self.mesh
        # Every master takes its value from one leaf that has it.
        first = np.empty(mesh.nodes, dtype=np.int64)
        flat = mesh.node.ravel()
        first[flat[::-1]] = np.arange(flat.size)[::-1]
        leaf, own = np.divmod(first[mesh.free], 20)
        block = bricks.descents()[child[leaf], own]
        row = np.repeat(np.arange(len(leaf)), 20)
        column = (20 * parent[leaf][:, None] + np.arange(20)).ravel()
        shape = (len(leaf), 20 * len(below.mesh.leaves))
        self._smoothed(sp.csr_array((block.ravel(), (row, column)), shape=shape) @ below.gather)

    def _smoothed(self, prolong: sp.csr_array) -> None:
        """Take the way up from the level below, and find the top of the scaled spectrum."""
        self.prolong = prolong
        self.prolong.eliminate_zeros()
        self.restrict = sp.csr_array(self.prolong.T)
        x = np.random.default_rng(0).standard_normal(self.scale.shape)
        for _ in range(8):
            x = self.apply(x)
            top = float(np.linalg.norm(x))
            x /= top
        self.top = 1.1 * top

    def _set_scale(self) -> None:
        """Scale by the roots of the diagonal; what is held has 0 there."""
        mesh = self.mesh
        diagonal = np.empty((len(mesh.leaves), 60))
        for leaves, matrix in self.materials:
            diagonal[leaves] = np.diag(matrix)
        diagonal *= mesh.edge[:, None]
        own = diagonal.reshape(-1, 20, 3)
        for leaf, side, area in self.beds:
            own[leaf, :, side // 2] += area * np.diag(bricks.side_masses()[side])
        weight = self.scatter.copy()
        weight.data = weight.data**2
        diagonal = weight @ own.reshape(-1, 3)
        self.root = np.sqrt(np.where(mesh.open, diagonal, 0.0))
        self.scale = np.divide(1.0, self.root, out=np.zeros_like(self.root), where=self.root > 0.0)

    def smooth(self, r: Floats) -> Floats:
        """Return a correction that takes the upper part of the spectrum."""
        return chebyshev(self.apply, r, self.top)

    def cycle(self, r: Floats) -> Floats:
        """Return about what the inverse gives: a symmetric V-cycle."""
        if self.below is None:
            found = np.zeros_like(r)
            found.ravel()[self.places] = self.factors.solve(r.ravel()[self.places])
            return found
        z = self.smooth(r)
        left = self.restrict @ (self.root * (r - self.apply(z)))
        below = self.below
        z = z + self.root * (self.prolong @ (below.scale * below.cycle(below.scale * left)))
        return np.asarray(z + self.smooth(r - self.apply(z)))

    def solve(self, load: Floats, enough: float) -> tuple[Floats, list[float], float]:
        """Return the masters' displacement by loads on them, residuals, and what is left.

        Ends when a step gains less energy than `enough`, or rounding stops it.
        """
        b = self.scale * load
        size = float(np.linalg.norm(b)) or 1.0
        if self.below is None:
            x = self.cycle(b)
            left = float(np.linalg.norm(b - self.apply(x))) / size
            return self.scale * x, [1.0, left], 0.0
        x, r = np.zeros_like(b), b
        z = self.cycle(r)
        p, product = z, float(np.vdot(r, z))
        residuals, gain, first = [1.0], 0.0, 0.0
        for _ in range(MOST_ITERATIONS):
            if product <= 0.0:
                break
            q = self.apply(p)
            length = product / float(np.vdot(p, q))
            x, r = x + length * p, r - length * q
            gain = 0.5 * length * product
            first = first or gain
            residuals.append(float(np.linalg.norm(r)) / size)
            if gain <= max(enough, 1e-13 * first) or interrupt_requested():
                break
            z = self.cycle(r)
            after = float(np.vdot(r, z))
            p, product = z + after / product * p, after
        return self.scale * x, residuals, gain


class HatLevel:
    """Trilinear functions on boxes larger than the leaves of a fine first generation.

    They know nothing of the body's shape but what the leaves in each box say: enough to carry what
    is smooth.
    """

    def __init__(self, mesh: BrickMesh, materials: list[tuple[Ints | slice, Floats]]) -> None:
        box = int(mesh.leaves.size.max())
        while True:
            corner = (mesh.leaves.lower // box)[:, None] + bricks.CORNERS
            key = (corner[..., 0] << 42) | (corner[..., 1] << 21) | corner[..., 2]
            found, hat = np.unique(key, return_inverse=True)
            if 3 * len(found) <= MOST_FACTORED:
                break
            box *= 2
        hat = hat.reshape(-1, 8)
        place = mesh.leaves.lower[:, None] + bricks.CORNERS * mesh.leaves.size[:, None, None]
        inside = place / box - (mesh.leaves.lower // box)[:, None]
        weight = bricks.trilinear(inside.reshape(-1, 3)).reshape(-1, 8, 8)
        # Corners that are held take nothing.
        open_ = np.ones((mesh.nodes, 3))
        open_[mesh.free] = mesh.open
        down = np.einsum("nch,nca,ab->ncahb", weight, open_[mesh.vertex], np.eye(3))
        down = down.reshape(-1, 24, 24)
        blocks = np.empty((len(hat), 24, 24))
        for leaves, matrix in materials:
            blocks[leaves] = matrix[:24, :24]
        blocks = down.transpose(0, 2, 1) @ (blocks * mesh.edge[:, None, None]) @ down
        unknown = (3 * hat[:, :, None] + np.arange(3)).reshape(-1, 24)
        row, column = np.repeat(unknown, 24, axis=1), np.tile(unknown, (1, 24))
        n = 3 * len(found)
        whole = sp.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(n, n))
        diagonal = whole.diagonal()
        # A little on the diagonal: hats that hardly touch the body must not be divided by.
        more = np.where(diagonal > 0.0, 1e-10 * diagonal, 1.0)
        self.factors = factors_of(sp.csc_array(whole + sp.diags_array(more)))
        self.scale = np.ones((len(found), 3))
        masters = np.flatnonzero(mesh.free[: len(mesh.place)])
        first = np.empty(len(mesh.place), dtype=np.int64)
        flat = mesh.vertex.ravel()
        first[flat[::-1]] = np.arange(flat.size)[::-1]
        leaf, own = np.divmod(first[masters], 8)
        rows = np.repeat(np.arange(len(masters)), 8)
        entries = (weight[leaf, own].ravel(), (rows, hat[leaf].ravel()))
        self.prolong = sp.csr_array(entries, shape=(int(mesh.free.sum()), len(found)))

    def cycle(self, r: Floats) -> Floats:
        """Return the exact answer."""
        return np.asarray(self.factors.solve(r.ravel()).reshape(r.shape))


def _by_kind(mesh: BrickMesh, moduli: Moduli) -> list[tuple[Ints | slice, Floats]]:
    """Return the leaves of every material, and the stiffness of its unit cube."""
    kinds = np.unique(mesh.leaves.kind)
    found: list[tuple[Ints | slice, Floats]] = []
    for kind in kinds:
        own = slice(None) if len(kinds) == 1 else np.flatnonzero(mesh.leaves.kind == kind)
        found.append((own, bricks.stiffness(moduli.lateral[kind], moduli.shear[kind])))
    return found
