"""Both opinions of agents that outlines cut, and what they prove.

One displacement fits, on a body slightly too large; one stress balances, within a body slightly too
small. Prager and Synge's circle holds with what lies between both bodies. Quadratics fit; Clough
and Tocher's stress functions balance.

The unknowns are those of the squares of `elements`: the displacement at vertices and how far it
bulges in the middle of an edge; φ, its slopes at vertices, and the bulge of its normal slope.
Unknowns of vertices that are very near to others count from these: else what neighbours have in
common, which is soft, would drown in what parts them, which is stiff.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from kaju.arrays import Flags, Floats, Ints, nearest, rigid_motions
from kaju.errors import SceneError, SupportError
from kaju.factors import factors_of
from kaju.model.elastic.free_motion import free_motion
from kaju.model.outline.leaf_triangles import leaf_triangles
from kaju.model.outline.posed_outlines import SIDES, OutlinedBody, UnlikeError
from kaju.model.outline.true_shapes import TINY, UNIT, Law, covering
from kaju.model.results.cuts import resultants

from .cut_mesh import Border, CutMesh, mesh_of, slopes
from .gap import Bounds, bounds_of, tensors
from .leaves import Entries, LeafCells, coo, followed
from .levels import blocks_of
from .sheets import Sheets

SHORT = 0.1
"""Edges that are shorter, in edges of the agent, join vertices that are near: without them random
bodies 26 and 29 keep errors above 1, where 0.04 is proved."""


def loose_parts(mesh: CutMesh, border: Border, body: OutlinedBody) -> Flags:
    """Return which parts of the body nothing holds and nothing loads; refuse loaded ones."""
    own, count = mesh.parts[border.ends[:, 0]], int(mesh.parts.max()) + 1
    loose = np.zeros(count, dtype=np.bool_)
    for number in range(count):
        edge, axis = np.nonzero(border.held & (own == number)[:, None])
        points = border.spots[edge].reshape(-1, 2) - border.at[edge[:1], 0]
        motion = free_motion(rigid_motions(points, np.repeat(axis, 2)), 2)
        loose[number] = bool(motion)
        if motion and (body.weight.any() or border.given[own == number].any()):
            x, y = body.edge * border.at[own == number].mean(axis=(0, 1))
            part, join = "the body", ""
            if count > 1:
                part = f"the part of the body round ({x:.3g}, {y:.3g}) m, apart from the rest"
                join = ", or join it to what is held (does a region cut it off?)"
            raise SupportError(
                f"sides: the supports do not hold {part}: it could {motion}; hold it by [sides] "
                f'such as left = "rigid" or bottom = "roller"{join}'
            )
    return loose


class CutPair:
    """Both fields on leaves, and what each leaf adds to their gap."""

    def __init__(self, body: OutlinedBody, leaves: LeafCells):
        self.body = body
        every = covering(leaves, body.shape)
        body.true.refine(every)
        at = every.find(leaves.lower)
        held = np.isin(np.arange(len(every)), at)
        bodies = [leaf_triangles(body.true, every, held, most) for most in (True, False)]
        # agents that hold nothing of either body are none
        filled = np.isin(at, np.concatenate([one[1].leaf for one in bodies]))
        leaves, at = leaves.only(filled), at[filled]
        row = np.full(len(every), -1)
        row[at] = np.arange(len(at))
        meshes, edges = [], []
        for _, triangles, along in bodies:
            meshes.append(mesh_of(triangles._replace(leaf=row[triangles.leaf])))
            if not len(meshes[-1].place):
                raise UnlikeError(body.asked.nothing_left)
            edges.append(Border.of(meshes[-1], body, along))
        self.borders = edges[0], edges[1]
        if not any(one.any() for one in (edges[1].given, edges[1].tilted, body.weight)):
            raise SceneError("loads: there are none, or they cancel: no energy to bound; give one")
        (laws, others), self.along = (one[0] for one in bodies), bodies[1][2]
        self.laws = laws, others
        n, size = len(leaves), np.asarray(leaves.size * UNIT, dtype=np.float64)
        loose = loose_parts(meshes[0], edges[0], body)
        self.loose = int(loose.sum())
        """Parts of the body that hang on nothing, and bear nothing."""
        self.fitting = CutFitting(meshes[0], edges[0], laws, body.weight, size, loose)
        self.balancing = Balancing(meshes[1], edges[1], others, body.weight, size)
        self.displacement_at = self.fitting.displacement_at
        both = self.fitting, self.balancing
        self.area = np.stack([np.bincount(one.mesh.leaf, one.area, n) for one in both])
        # the material that has most of each; the last column is of laws between two materials
        own = body.own_laws
        part = np.zeros((n, len(own) + 1))
        for field, its in zip(both, self.laws, strict=True):
            number = np.array([own.index(law) if law in own else -1 for law in its])
            np.add.at(part, (field.mesh.leaf, number[field.mesh.law]), field.area)
        self.leaves = replace(leaves, kind=part[:, :-1].argmax(axis=1))
        fitted, balanced = self.fitting.energies(n), self.balancing.energies(n)
        between = np.maximum(self.area[0] - self.area[1], 0.0)
        stored, (within, beyond) = body.bands(edges[1].shares)
        # what only one of both bodies has may be loaded along any outline
        density = np.where(self.area[1] > 0.0, 0.0, stored.max())
        for border, mesh in zip(edges, meshes, strict=True):
            np.maximum.at(density, mesh.leaf[border.owner], stored[border.outline])
        # the weight there counts as its share of all
        weighed = between / self.area[1].sum() * balanced.sum() * bool(body.no_bound)
        band = density * between + 2.0 * weighed
        self.shares = np.maximum(fitted + balanced - 2.0 * self._crossed() + band, 0.0)
        self.energies = 0.25 * (fitted + balanced)
        """Of each leaf, half-way between those of both fields."""
        lower = 2.0 * self.fitting.work - float((fitted + weighed).sum()) - beyond
        upper = float((balanced + weighed).sum()) + within
        # as far apart as rounding may take them
        self.lower, self.upper = lower - body.rounding * abs(lower), upper * (1.0 + body.rounding)

    @cached_property
    def gap(self) -> float:
        """What both bounds of twice the energy are apart; or the sum of shares, if that is more."""
        return float(max(self.upper - self.lower, self.shares.sum()))

    @cached_property
    def bounds(self) -> Bounds:
        """What both energies prove."""
        lower, upper = 0.5 * self.lower, 0.5 * self.upper
        return bounds_of(np.array([[lower], [upper], [2.0 * (upper - lower)]]), self.gap, 0.0)

    def _crossed(self) -> Floats:
        """Return ∫ σ : ε of each leaf, nearly so where the triangles of both fields differ."""
        own, mesh = self.balancing, self.balancing.mesh
        # three points within each third, off the edges of triangles
        points = 0.5 * (own.corners + own.corners.mean(axis=2, keepdims=True))
        stress = 0.5 * (own.values + own.values.mean(axis=2, keepdims=True)) + own.bearing(points)
        leaf, law = np.repeat(mesh.leaf, 9), np.repeat(mesh.law, 9)
        strain = np.nan_to_num(self.fitting.strain_at(leaf, points.reshape(-1, 2), law))
        work = (stress.reshape(-1, 3) * strain).sum(axis=1) * np.repeat(own.area / 9.0, 9)
        return np.asarray(np.bincount(leaf, work, len(self.leaves)), dtype=np.float64)

    @cached_property
    def means(self) -> tuple[Floats, Floats]:
        """Mean tensors over what leaves hold: of the stress that balances, and that fits."""
        found = []
        for field in (self.balancing, self.fitting):
            total = np.zeros((len(self.leaves), 3))
            np.add.at(total, field.mesh.leaf, field.area[:, None] * field.stresses())
            found.append(total)
        some = [area[:, None] > 0.0 for area in self.area]  # else it is what the other one says
        with np.errstate(divide="ignore", invalid="ignore"):
            balanced, fitted = found[0] / self.area[1][:, None], found[1] / self.area[0][:, None]
        balanced, fitted = np.where(some[1], balanced, fitted), np.where(some[0], fitted, balanced)
        return tensors(balanced), tensors(fitted)

    def stresses_at(
        self, leaf: Ints, places: Floats, material: Ints | None = None
    ) -> tuple[Floats, Floats]:
        """Return tensors of the stress that balances and of the strain that fits, at places."""
        own = self.body.own_laws
        if material is None:
            material = self.body.material_at(self.body.edge * places)
        law = np.array([list(self.laws[0]).index(one) for one in own])[material]
        strain = self.fitting.strain_at(leaf, places, law)
        fitted = np.einsum("na,nab->nb", strain, np.array([one.stiffness for one in own])[material])
        balanced = self.balancing.stress_at(leaf, places, law)
        fitted = np.where(np.isfinite(fitted), fitted, balanced)
        return tensors(np.where(np.isfinite(balanced), balanced, fitted)), tensors(fitted)

    @cached_property
    def at_corners(self) -> tuple[Ints, Floats, tuple[Floats, Floats]]:
        """Whose corners of triangles these are, where, and both stresses there."""
        mesh = self.balancing.mesh
        leaf, at = np.repeat(mesh.leaf, 3), mesh.place[mesh.triangle]
        inside = (at + 1e-6 * (at.mean(axis=1, keepdims=True) - at)).reshape(-1, 2)
        return leaf, at.reshape(-1, 2), self.stresses_at(leaf, inside, self.leaves.kind[leaf])

    def reactions(self) -> dict[str, Floats]:
        """Return what supports bear of the stress that balances, as `resultants`."""
        mesh, border = self.balancing.mesh, self.borders[1]
        # along an edge that stress is linear: two places stand for it
        at = border.at.mean(axis=1) + np.array([-1.0, 1.0])[:, None, None] * border.run / 12**0.5
        leaf, law = mesh.leaf[border.owner], mesh.law[border.owner]
        own = tensors(np.stack([self.balancing.stress_at(leaf, one, law) for one in at]))
        borne = np.where(border.held, 0.5 * np.einsum("pnab,nb->pna", own, border.outward), 0.0)
        of = np.where(border.side >= 0, border.side, len(SIDES) + border.outline)
        names = {k: name for k, name in enumerate(SIDES) if name in self.body.held}
        names |= {len(SIDES) + which: name for which, name in self.body.rigid.items()}
        edge, axis = np.nonzero(border.held)
        # forces at both ends of an edge that are as its traction
        even, tilt = borne.mean(axis=0), np.diff(borne, axis=0)[0] / 12**0.5
        force = np.stack([even - tilt, even + tilt])[:, edge, axis].ravel()
        rows = np.tile(of[edge], 2), border.at[edge].swapaxes(0, 1).reshape(-1, 2)
        found, spots = dict.fromkeys(names.values(), np.zeros(3)), border.spots[edge]
        spots = spots.swapaxes(0, 1).reshape(-1, 2)
        return found | resultants(names, *rows, np.tile(axis, 2), force, spots)


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
        if not some.all():  # beside what is rigid or pinned all moves as the nearest vertex
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
