"""Both fields of agents that outlines cut: quadratics, and Clough and Tocher's stress functions.

The unknowns are those of the squares of `elements`: the displacement at vertices and how far it
bulges in the middle of an edge; φ, its slopes at vertices, and the bulge of its normal slope.
Unknowns of vertices that are very near to others count from these: else what neighbours have in
common, which is soft, would drown in what parts them, which is stiff.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from kaju.arrays import Flags, Floats, Ints, nearest
from kaju.factors import factors_of
from kaju.model.outline.posed_outlines import UnlikeError
from kaju.model.outline.true_shapes import TINY, Law

from .cut_mesh import Border, CutMesh, slopes
from .leaves import Entries, coo, followed
from .levels import blocks_of
from .sheets import Sheets

SHORT = 0.1
"""Edges that are shorter, in edges of the agent, join vertices that are near: without them random
bodies 26 and 29 keep errors above 1, where 0.04 is proved."""


class CutField:
    """Values of triangles of least ½ |root own + beside|², less the work of forces.

    Roots are used, not their squares: of needles these have too few digits.
    """

    def __init__(self, mesh: CutMesh, rows: Floats, law: Floats, area: Floats):
        """Take strains or stresses at corners, (n, thirds, 3, 3, 12), moduli, areas of thirds."""
        self.mesh, self.rows, self.area = mesh, rows, rows.shape[1] * area
        own = np.swapaxes(np.linalg.cholesky(law), 1, 2) * np.sqrt(area / 3.0)[:, None, None]
        self._half = own[:, None, None]
        self.root = (self._half @ middles(rows, -3)).reshape(len(rows), -1, 12)
        self.beside = np.zeros(self.root.shape[:2])

    def settle(self, way: sp.csr_array, own: Floats, pull: Floats | float = 0.0) -> Floats:
        """Set own values, from some on, and return the unknowns that `way` makes the rest of."""
        rooted = blocks_of(self.root) @ way
        square = np.bincount(rooted.indices, rooted.data**2, way.shape[1])
        scale = np.where(square > 0.0, square, 1.0) ** -0.5
        rooted.data *= scale[rooted.indices]
        factors = factors_of(rooted.T @ rooted + sp.diags_array(1.0 * (square <= 0.0)))
        self.own, found = own, np.zeros(way.shape[1])
        # of needles rounding leaves the factors few digits
        for _ in range(20):
            rest = scale * pull - rooted.T @ self.felt.ravel()
            turned = factors.solve(rest)
            step = (way @ (scale * turned)).reshape(own.shape)
            slope = float(rest @ turned)
            bent = float((np.einsum("nij,nj->ni", self.root, step) ** 2).sum())
            if slope <= 0.0 or bent <= 0.0:
                break
            self.own = self.own + slope / bent * step
            found = found + slope / bent * scale * turned
            # The second step gains no more of the energy, but for needles.
            if 0.5 * slope**2 / bent < 1e-10 * float((self.felt**2).sum()):
                break
        return found

    @cached_property
    def values(self) -> Floats:
        """Strains or stresses of own values at the corners of thirds, (n, thirds, 3, 3)."""
        return np.asarray((self.rows @ self.own[:, None, None, :, None])[..., 0])

    @property
    def felt(self) -> Floats:
        """What the squares of which are twice the energies."""
        return np.asarray(np.einsum("nij,nj->ni", self.root, self.own) + self.beside)

    def _there(self, leaf: Ints, at: Floats, law: Ints | None = None) -> tuple[Flags, Ints, Floats]:
        """Tell which leaves hold any of the mesh; there, triangle and shares of each point."""
        some = np.isin(leaf, self.mesh.leaf)
        own = None if law is None else law[some]
        return some, *self.mesh.holding(leaf[some], at[some], own)

    def energies(self, leaves: int) -> Floats:
        """Return twice the energy of each leaf."""
        return np.asarray(np.bincount(self.mesh.leaf, (self.felt**2).sum(axis=1), leaves), float)


class CutFitting(CutField):
    """A displacement without gaps: quadratic on triangles."""

    def __init__(
        self,
        mesh: CutMesh,
        border: Border,
        laws: list[Law],
        weight: Floats,
        size: Floats,
        loose: Flags,
    ):
        rows, area = quadratic_strain(mesh.place[mesh.triangle])
        self.stiffness = np.array([law.stiffness for law in laws])[mesh.law]
        super().__init__(mesh, rows[:, None], self.stiffness, area)
        nodes = len(mesh.place)
        of = np.concatenate([mesh.triangle, nodes + mesh.edge], axis=1)
        force = border.forces(mesh)
        np.add.at(force, of, area[:, None, None] / 3.0 * weight)
        fixed = np.zeros((nodes + len(mesh.ends), 2), dtype=np.bool_)
        for axis in (0, 1):
            on = border.held[:, axis]
            fixed[border.ends[on], axis] = fixed[nodes + border.edge[on], axis] = True
        # parts that hang on nothing stay
        fixed[:nodes][loose[mesh.parts]] = True
        fixed[nodes:][loose[mesh.parts[mesh.ends[:, 0]]]] = True
        child, above = near_others(mesh, size, np.asarray(~fixed[:nodes].any(axis=1)))
        # those near to others have what these have, and more of their own
        more = fixed.size + 2 * np.arange(len(child))
        near: Entries = [(2 * child + j, 2 * above + j, 1.0) for j in (0, 1)]
        near += [(2 * child + j, more + j, 1.0) for j in (0, 1)]
        # what is pinned turns by an angle, of each outline one; edges stay straight
        pin = np.isfinite(border.pivot[:, 0])
        start, angle = border.ends[pin, 0], fixed.size + 2 * len(child) + border.outline[pin]
        arm = mesh.place[start] - border.pivot[pin]
        near += [(2 * start, angle, -arm[:, 1]), (2 * start + 1, angle, arm[:, 0])]
        count = fixed.size + 2 * len(child) + int(border.outline.max(initial=0)) + 1
        way, follows = followed(near, count)
        follows[: fixed.size] |= fixed.ravel()
        free = sp.csr_array(way[: fixed.size, np.flatnonzero(~follows)])
        dof = (2 * of[:, :, None] + np.arange(2)).reshape(-1, 12)
        pull = free.T @ force.ravel()
        found = self.settle(sp.csr_array(free[dof.ravel()]), np.zeros(dof.shape), pull)
        self.value = free @ found
        self.work = float(pull @ found)
        """The work of the loads."""

    def displacement_at(self, leaf: Ints, points: Floats) -> Floats:
        """Return the displacement at points of leaves, (n, 2); beyond the body that beside it."""
        some, triangle, share = self._there(leaf, points)
        out = np.zeros((len(points), 2))
        # beside what is rigid or pinned all moves as the nearest vertex
        out[~some] = self.value.reshape(-1, 2)[nearest(self.mesh.place, points[~some])[1]]
        values = np.concatenate([share, 4.0 * share * np.roll(share, -1, axis=1)], axis=1)
        out[some] = np.einsum("nk,nkd->nd", values, self.own[triangle].reshape(-1, 6, 2))
        return out

    def strain_at(self, leaf: Ints, points: Floats, law: Ints) -> Floats:
        """Return the strain (xx, yy, 2 xy) at points of leaves, (n, 3); NaN where none is known.

        On or beside an outline that in what is of one law.
        """
        out = np.full((len(points), 3), np.nan)
        some, triangle, share = self._there(leaf, points, law)
        out[some] = np.einsum("nc,nca->na", share, self.values[triangle, 0])
        return out

    def stresses(self) -> Floats:
        """Return the mean stress of each triangle."""
        return np.asarray(np.einsum("nab,nb->na", self.stiffness, self.values.mean(axis=(1, 2))))


class Balancing(CutField):
    """A stress in balance: Airy's φ, cubic on thirds of triangles."""

    def __init__(
        self, mesh: CutMesh, border: Border, laws: list[Law], weight: Floats, size: Floats
    ):
        self.weight, at = weight, mesh.place[mesh.triangle]
        rows, self.corners, third = stress_rows(at, mesh.normal[mesh.edge])
        compliance = np.array([law.compliance for law in laws])[mesh.law]
        super().__init__(mesh, rows, compliance, third)
        # with the stress that bears the weight; as few rows as there are columns
        stress = self._half @ self.bearing(middles(self.corners, -2))[..., None]
        whole = np.concatenate([self.root, stress.reshape(len(at), -1, 1)], axis=2)
        whole = np.asarray(np.linalg.qr(whole, mode="r"))
        self.root, self.beside = whole[..., :12], whole[..., 12]
        sheets = Sheets(
            mesh.place,
            mesh.triangle,
            len(mesh.ends),
            mesh.parts[mesh.triangle[:, 0]],
            border.rim(mesh, weight),
        )
        if sheets.unbalanced > TINY:
            raise UnlikeError(
                "sides: a part of the body that bears loads hangs on nothing, or could move; hold "
                "it, or join it to what is held"
            )
        free = np.ones(len(mesh.place), dtype=np.bool_)
        free[border.ends[~border.held.all(axis=1)]] = False
        child, above = near_others(mesh, size, free)
        away, more = mesh.place[child] - mesh.place[above], sheets.size + 3 * np.arange(len(child))
        near: Entries = [(3 * child + j, 3 * above + j, 1.0) for j in (0, 1, 2)]
        near += [(3 * child, 3 * above + 1 + axis, away[:, axis]) for axis in (0, 1)]
        near += [(3 * child + j, more + j, 1.0) for j in (0, 1, 2)]
        way, _, known = sheets.way(near, 3 * len(child))
        strip = self._stripped(sheets, len(known))
        way = strip @ way
        self.settle(way, (strip @ known).reshape(-1, 12))

    def _stripped(self, sheets: Sheets, count: int) -> sp.csr_array:
        """Return triangles' unknowns by the shared ones, less linear functions, which bear none."""
        dof = (3 * sheets.corner[:, :, None] + np.arange(3)).reshape(-1, 9)
        dof = np.concatenate([dof, 3 * sheets.points + self.mesh.edge], axis=1)
        at = self.mesh.place[self.mesh.triangle]
        away, row = at - at[:, :1], np.arange(dof.size).reshape(-1, 12)
        entries: Entries = [(row.ravel(), dof.ravel(), 1.0)]
        for j in range(3):
            entries += [(row[:, 3 * j + k], dof[:, k], -1.0) for k in (0, 1, 2)]
            entries += [(row[:, 3 * j], dof[:, 1 + k], -away[:, j, k]) for k in (0, 1)]
        out = coo(entries, (dof.size, count))
        out.eliminate_zeros()
        return out

    def bearing(self, points: Floats) -> Floats:
        """Return the stress (xx, yy, xy) that bears the weight at points: σ_ii = −weight_i x_i."""
        return np.concatenate([-self.weight * points, np.zeros((*points.shape[:-1], 1))], axis=-1)

    def stress_at(self, leaf: Ints, points: Floats, law: Ints) -> Floats:
        """Return the stress (xx, yy, xy) that balances at points of leaves, (n, 3); else NaN."""
        out = np.full((len(points), 3), np.nan)
        some, triangle, share = self._there(leaf, points, law)
        # the third that lies along the edge away from the least share
        rows, least = np.arange(len(triangle)), share.argmin(axis=1)
        third, other = (least + 1) % 3, (least + 2) % 3
        of = np.stack([share[rows, third], share[rows, other], 3.0 * share[rows, least]], axis=1)
        of[:, :2] -= share[rows, least, None]
        stress = np.einsum("nc,nca->na", of, self.values[triangle, third])
        out[some] = stress + self.bearing(points[some])
        return out

    def stresses(self) -> Floats:
        """Return the mean stress of each triangle."""
        return np.asarray(
            self.values.mean(axis=(1, 2)) + self.bearing(self.corners.mean(axis=(1, 2)))
        )


def near_others(mesh: CutMesh, size: Floats, free: Flags) -> tuple[Ints, Ints]:
    """Return the vertices that are very near to others, and those that they count from.

    Triangles between them are needles. Along the shortest of short edges all that hang together
    count from one of them, or from those that are not free.
    """
    length, most, n = np.hypot(*mesh.run.T), np.zeros(len(mesh.ends)), len(mesh.place)
    np.maximum.at(most, mesh.edge, size[mesh.leaf, None])
    short = length < SHORT * most
    # beyond all vertices stands one from which others start, rather those that are not free
    every, last = np.arange(n), np.full(n, n)
    weight = np.concatenate([length[short], np.where(free, 1e300, 1e-300)])
    pairs = np.concatenate([mesh.ends[short], np.column_stack([every, last])])
    a, b = pairs.T.astype(np.int32)  # older SciPy takes no other
    tree = minimum_spanning_tree(sp.csr_array((weight, (a, b)), shape=(n + 1, n + 1)))
    above = breadth_first_order(tree, n, directed=False)[1][:n]
    child = np.flatnonzero(above < n)
    return child, above[child].astype(np.int64)


def middles(rows: Floats, axis: int) -> Floats:
    """Return what is linear on triangles in the middles of their edges, by that at corners."""
    return np.asarray(0.5 * (rows + np.roll(rows, -1, axis)))


def quadratic_strain(at: Floats) -> tuple[Floats, Floats]:
    """Return the strain (xx, yy, 2 xy) at the corners of triangles, (n, 3, 3, 12), and areas.

    The unknowns are both components at the three corners, then on the three edges.
    """
    slope, area = slopes(at)
    gradient = np.zeros((len(at), 3, 6, 2))
    gradient[:, :, :3] = slope[:, None]
    for k in range(3):
        a, b = k, (k + 1) % 3
        gradient[:, a, 3 + k] = 4.0 * slope[:, b]
        gradient[:, b, 3 + k] = 4.0 * slope[:, a]
    out = np.zeros((len(at), 3, 3, 12))
    out[..., 0, 0::2] = out[..., 2, 1::2] = gradient[..., 0]
    out[..., 1, 1::2] = out[..., 2, 0::2] = gradient[..., 1]
    return out, area


def stress_rows(at: Floats, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """Return stresses (xx, yy, xy) of Clough and Tocher's triangles, by thirds.

    At the corners of each third, (n, 3, 3, 3, 12), these corners (n, 3, 3, 2), and the areas of
    thirds (n,). The unknowns are φ and its slopes at the corners, then the bulges on the edges
    along `normal`, (n, 3, 2).

    φ is cubic on each third, given by its values at Bézier points: those beside the corners follow
    from slopes, those within a third from the slope in the middle of its edge, the inner ones
    are means, for that makes slopes go on (R. W. Clough, J. L. Tocher, 1965).
    """
    n, middle = len(at), at.mean(axis=1)

    def beside(corner: int, towards: Floats) -> Floats:
        out = np.zeros((n, 12))
        out[:, 3 * corner] = 1.0
        out[:, 3 * corner + 1 : 3 * corner + 3] = (towards - at[:, corner]) / 3.0
        return out

    own = [beside(k, at[:, k]) for k in range(3)]
    inward = [beside(k, middle) for k in range(3)]
    there = [beside(k, at[:, (k + 1) % 3]) for k in range(3)]
    back = [beside((k + 1) % 3, at[:, k]) for k in range(3)]
    corners = np.stack(
        [np.stack([at[:, k], at[:, (k + 1) % 3], middle], axis=1) for k in range(3)], axis=1
    )
    slope, area = slopes(corners.reshape(-1, 3, 2))
    slope = slope.reshape(n, 3, 3, 2)
    within = []
    for k in range(3):
        b = (k + 1) % 3
        p, q, r = np.einsum("ncd,nd->cn", slope[:, k], normal[:, k])[:, :, None]
        asked = np.zeros((n, 12))
        for corner in (k, b):
            asked[:, 3 * corner + 1 : 3 * corner + 3] = 0.5 * normal[:, k]
        asked[:, 9 + k] = 1.0
        known = 0.25 * (p * own[k] + q * there[k] + r * inward[k])
        known += 0.5 * (p * there[k] + q * back[k])
        known += 0.25 * (p * back[k] + q * own[b] + r * inward[b])
        within.append((asked / 3.0 - known) / (0.5 * r))
    inner = [(inward[k] + within[k] + within[k - 1]) / 3.0 for k in range(3)]
    core = sum(inner) / 3.0
    rows = np.zeros((n, 3, 3, 3, 12))
    # A Bézier point's place in a row is the sum of those of the corners that it is nearest to.
    place, net = np.array([0, 1, 4]), np.zeros((n, 13, 12))
    about = (place[:, None, None] + place[:, None] + place).reshape(3, 9)
    for k in range(3):
        b = (k + 1) % 3
        points = own[k], there[k], back[k], own[b], inward[k], within[k], inward[b]
        net[:, [0, 1, 2, 3, 4, 5, 6, 8, 9, 12]] = np.stack([*points, inner[k], inner[b], core], 1)
        x, y = np.moveaxis(slope[:, k], 2, 0)
        twice = [
            y[:, :, None] * y[:, None],
            x[:, :, None] * x[:, None],
            -x[:, :, None] * y[:, None],
        ]
        rows[:, k] = 6.0 * np.stack(twice, 1).reshape(n, 1, 3, 9) @ net[:, about]
    return rows, corners, area.reshape(n, 3)[:, 0]
