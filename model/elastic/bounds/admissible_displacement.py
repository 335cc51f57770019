"""A displacement field without gaps: from the faces' displacements to the corners of the boxes.

Every corner takes the mean of what is round it, weighted by stiffness, and what the supports
give; between the corners it is linear along every axis. Such a field is kinematically
admissible, so its potential energy is never below that of the true one. A few steps of conjugate
gradients let it sink further.

A box on which smaller ones hang is cut into quarters, so that it follows their corners.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds import bilinear_kernels as kernels
from kaju.model.elastic.bounds.bound_cells import BoundCells, corner_ends
from kaju.model.elastic.multigrid.krylov import dot
from kaju.model.scene.cell_types import RIGID, ROLLER

STEPS, MOST_STEPS = 4, 60  # Of conjugate gradients, at least and at most
WORTHWHILE = 0.1
"""So much of the gap between the energies the last few steps must have closed for more."""


def sink(
    v: Floats, left: Floats, weight: Floats, gap: float, force: Callable[[Floats], Floats]
) -> None:
    """Let a field sink by conjugate gradients, as long as that closes enough of a gap."""
    # The displacements `v` and the forces `left` at the nodes go along; `weight` is one over the
    # diagonal, 0 where nodes are held; `gap` is how far the energy may be above what it can sink
    # to; `force` returns what holds the nodes at a displacement, and may make it fit first.
    way = weight * left
    before = float(dot(left.ravel(), way.ravel()))
    gains: list[float] = []
    while before > 0.0 and len(gains) < MOST_STEPS:
        pull = force(way)
        step = before / float(dot(way.ravel(), pull.ravel()))
        v += step * way
        left -= step * pull
        now = float(np.einsum("ia,ia,ia->", weight, left, left))
        gains.append(0.5 * step * before)
        gap -= gains[-1]
        if len(gains) >= STEPS and sum(gains[-STEPS:]) < WORTHWHILE * gap:
            return
        way *= now / before
        way += weight * left
        before = now


class AdmissibleDisplacement:
    """Displacements of the corners of boxes, shape (nodes, dimension).

    `left` are the loads less the forces that hold them, known once the field has settled; `given`
    what supports give (NaN: nothing); `jumps` tells whether supports give a corner two
    displacements at once: no field without gaps has that.
    """

    def __init__(self, boxes: BoundCells) -> None:
        self.boxes, self.mesh = boxes, boxes.mesh
        self._ends = corner_ends(boxes.dimension)
        owner, power = self.mesh.owner, boxes.dimension - 2
        self._moduli = [modulus[owner] * self.mesh.edge**power for modulus in boxes.law]
        self._load = self.forces()
        self.given, self.jumps = self._supports()
        self.displacement = self.mesh.start
        self.hold()
        self.left = np.zeros_like(self.displacement)

    def hold(self) -> None:
        """Make the field fit: at the supports, and along straight sides."""
        self.displacement = np.where(np.isnan(self.given), self.displacement, self.given)
        self._straighten(self.displacement)

    def _straighten(self, v: Floats) -> None:
        """Put the middles of straight sides between their ends."""
        v[self.mesh.slave] = v[self.mesh.masters].mean(axis=0)

    def _lead(self, force: Floats) -> None:
        """Hand the forces on middles of straight sides to their ends."""
        slave = self.mesh.slave
        for master in self.mesh.masters:
            np.add.at(force, master, force[slave] / len(self.mesh.masters))
        force[slave] = 0.0

    def _gathered(self, node: Ints, force: Floats) -> Floats:
        """Add forces, shape (..., dimension), up at nodes of shape (...)."""
        at, count = node.ravel(), len(self.mesh.start)
        flat = force.reshape(len(at), force.shape[-1])
        return np.stack([np.bincount(at, column, count) for column in flat.T], axis=1)

    def forces(self, across: bool = True) -> Floats:
        """Return the loads at the nodes, or only those along surfaces."""
        boxes, mesh, d = self.boxes, self.mesh, self.boxes.dimension
        load = np.zeros_like(mesh.start)
        if across and boxes.body.any():
            each = (boxes.body[:, mesh.owner] * mesh.edge**d / len(self._ends)).T
            shape = (len(self._ends), *each.shape)
            load += self._gathered(mesh.element, np.broadcast_to(each, shape))
        for side in range(2 * d):
            on = boxes.loads.side == side
            box, force = boxes.loads.box[on], boxes.loads.force[on]
            if not across:
                force[:, side // 2] = 0.0
            node = boxes.side_nodes(box, side)
            share = np.broadcast_to(force / len(node) ** 2, (*node.shape, d))
            load += self._gathered(node, share)
            # What loads add that lie unevenly on the side: linear tractions.
            uneven = boxes.uneven_loads.some(boxes.uneven_loads.side == side)
            node, parts = boxes.side_nodes(uneven.box, side), mesh.parts[:, uneven.box]
            cut, axes = parts[0] != parts[1], [a for a in range(d) if a != side // 2]
            ends = 2.0 * corner_ends(d - 1) - 1.0
            along = np.einsum("nik,ek->eni", uneven.moment[:, :, axes], ends)
            along = along / (boxes.size[uneven.box, None] * len(node) ** 2)
            # On a whole side by its corners; on parts by where these lie, and by their corners.
            share = np.where(cut[:, None], 3.0 * along[None] + along[:, None], 2.0 * along[:, None])
            load += self._gathered(node, share)
        self._lead(load)
        return load

    def middles(self, box: Ints, side: int) -> Ints:
        """Return the nodes in the middle of a plane box's side where smaller ones hang, else -1."""
        hanging, found = self.boxes.hanging, np.full(len(self.boxes.size), -1)
        here = hanging.box[hanging.side == side]
        found[here] = self.boxes.side_nodes(here, side)[1, 0]
        return np.asarray(found[box])

    def _supports(self) -> tuple[Floats, bool]:
        """Return the given displacements (NaN where free), and whether they contradict."""
        given = np.full_like(self.mesh.start, np.nan)
        jumps = False
        for kind in (ROLLER, RIGID):
            for held in self.boxes.held:
                if held.kind != kind:
                    continue
                axis = held.side // 2
                sides = self.boxes.side_nodes(held.box, held.side)
                for node in sides.reshape(-1, sides.shape[-1]):
                    for component in [axis] if kind == ROLLER else range(self.boxes.dimension):
                        old, new = given[node, component], held.value[:, component]
                        jumps |= bool(np.any(~np.isnan(old) & (old != new)))
                        given[node, component] = new
        return given, jumps

    def force(self, v: Floats) -> Floats:
        """Return the forces that hold corners at a displacement."""
        d, out = self.boxes.dimension, np.zeros_like(v)
        stretch, lateral, shear = self._moduli
        kernels.pull(self.mesh.element, stretch, lateral, shear, v, out)
        for bed in self.boxes.beds:
            axis = bed.side // 2
            node = self.boxes.side_nodes(bed.box, bed.side)
            pull = v[node, axis] * self._bed_stiffness(bed.box, bed.stiffness)
            # What an even bed does to the corners of a side, by their displacements.
            ends = corner_ends(d - 1)
            shared = 2.0 ** -np.abs(ends[:, None] - ends).sum(axis=2) / 3.0 ** (d - 1)
            pull = np.tensordot(shared, pull, 1)
            out[:, axis] += np.bincount(node.ravel(), pull.ravel(), len(out))
        self._lead(out)
        return out

    def _bed_stiffness(self, box: Ints, stiffness: Floats) -> Floats:
        """Return the stiffness of each part of the boxes' sides on a bed."""
        return stiffness * (0.5 * self.boxes.size[box]) ** (self.boxes.dimension - 1)

    def settle(self, above: float) -> None:
        """Let the field sink by conjugate gradients, as long as that is worth while."""
        # `above` is the complementary energy of a stress that balances, less the work at moved
        # walls: the potential energy of no field is below its negative.
        diagonal = self._diagonal()
        free = np.isnan(self.given) & (diagonal > 0.0)
        free[self.mesh.slave] = False
        weight = np.where(free, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
        self.left = self._load - self.force(self.displacement)
        gap = above + self.whole_energy() - self.work()

        def straight_force(way: Floats) -> Floats:
            self._straighten(way)
            return self.force(way)

        sink(self.displacement, self.left, weight, gap, straight_force)

    def stretch(self, share: float) -> None:
        """Multiply the field by a number."""
        self.displacement *= share
        self.left = (1.0 - share) * self._load + share * self.left

    def _diagonal(self) -> Floats:
        d = self.boxes.dimension
        # Of a corner's own function every component has the same stiffness.
        one = [form[0, 0] for form in kernels.element_stiffness(d)]
        own = sum(share * modulus for share, modulus in zip(one, self._moduli, strict=True))
        column = np.zeros(len(self.mesh.start))
        for node in self.mesh.element:
            column += np.bincount(node, own, len(column))
        out = np.repeat(column[:, None], d, axis=1)
        for bed in self.boxes.beds:
            node = self.boxes.side_nodes(bed.box, bed.side)
            stiff = self._bed_stiffness(bed.box, bed.stiffness) / 3.0 ** (d - 1)
            stiff = np.broadcast_to(stiff, node.shape)
            out[:, bed.side // 2] += np.bincount(node.ravel(), stiff.ravel(), len(out))
        self._lead(out)
        return out

    def energies(self) -> Floats:
        """Return the strain energy of every box, scaled."""
        moved = kernels.moved_corners(self.mesh.element, self.displacement)
        stretch, lateral, shear = self._moduli
        force = kernels.forces(stretch, lateral, shear, moved)
        energy = 0.5 * np.einsum("ni,ni->n", moved, force)
        return np.asarray(np.bincount(self.mesh.owner, energy, len(self.boxes.size)), np.float64)

    def work(self) -> float:
        """Return the work of the loads."""
        return float(dot(self._load.ravel(), self.displacement.ravel()))

    def work_of_rest(self) -> float:
        """Return the work of what an iteration has left of the loads."""
        boxes, total = self.boxes, 0.0
        if boxes.rest is None:
            return total
        for side, rest in enumerate(boxes.rest):
            axis, upper = divmod(side, 2)
            if rest.any():
                own = self.displacement[:, axis].copy()
                on = self.mesh.corner[self._ends[:, axis] == upper]
                force = rest * boxes.size ** (boxes.dimension - 1)
                total += (1 - 2 * upper) * float(np.sum(force * sum(own[node] for node in on)))
        return total / (len(self._ends) // 2)

    def whole_energy(self) -> float:
        """Return the energy in body and bed, once settled."""
        pull = self._load - self.left
        return 0.5 * float(dot(self.displacement.ravel(), pull.ravel()))

    def _placed(self, box: Ints, inside: Floats) -> tuple[Ints, Floats, Floats]:
        """Return the nodes round places in boxes, the place between them, and the parts' edges."""
        d, parts = self.boxes.dimension, self.mesh.parts
        upper = (inside >= 0.5).astype(np.int64)
        element = parts[upper @ (1 << np.arange(d)[::-1]), box]
        cut = (parts[0, box] != parts[1, box])[:, None]
        local = np.where(cut, 2.0 * inside - upper, inside)
        return self.mesh.element[:, element], local, self.mesh.edge[element]

    def displacement_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the displacement at a place in each of n boxes, shape (n, d) from 0 to 1."""
        node, local, _ = self._placed(box, inside)
        share = np.where(self._ends[:, None], local, 1.0 - local).prod(axis=2)
        return np.asarray(np.einsum("cn,cna->na", share, self.displacement[node]))

    def strain_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the strain tensors, shape (n, d, d), there."""
        node, local, edge = self._placed(box, inside)
        share = np.where(self._ends[:, None], local, 1.0 - local)
        values, d = self.displacement[node], self.boxes.dimension
        slope = np.empty((len(box), d, d))
        for b in range(d):
            others = np.delete(share, b, axis=2).prod(axis=2) * (2.0 * self._ends[:, None, b] - 1.0)
            slope[:, :, b] = np.einsum("cn,cna->na", others, values) / edge[:, None]
        return np.asarray(0.5 * (slope + slope.transpose(0, 2, 1)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, d, d)."""
        mesh, d = self.mesh, self.boxes.dimension
        share = (mesh.edge / self.boxes.size[mesh.owner]) ** d / mesh.edge / (1 << (d - 1))
        mean = np.empty((len(self.boxes.size), d, d))
        for a in range(d):
            at_corners = self.displacement[:, a][mesh.element]
            for b in range(d):
                slope = share * ((2.0 * self._ends[:, b] - 1.0) @ at_corners)
                mean[:, a, b] = np.bincount(mesh.owner, slope, len(mean))
        return np.asarray(0.5 * (mean + mean.transpose(0, 2, 1)))
