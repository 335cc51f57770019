"""Both opinions of agents that outlines cut, and what they prove.

One displacement fits, on a body slightly too large; one stress balances, within a body slightly too
small. Prager and Synge's circle holds with what lies between both bodies.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from kaju.arrays import Flags, Floats, Ints, rigid_motions
from kaju.errors import SceneError, SupportError
from kaju.model.elastic.free_motion import free_motion
from kaju.model.outline.leaf_triangles import leaf_triangles
from kaju.model.outline.posed_outlines import SIDES, OutlinedBody, UnlikeError
from kaju.model.outline.true_shapes import UNIT, covering
from kaju.model.results.cuts import resultants

from .cut_fields import Balancing, CutFitting
from .cut_mesh import Border, CutMesh, mesh_of
from .gap import Bounds, bounds_of, tensors
from .leaves import LeafCells


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
