"""A displacement field without gaps: from the faces' displacements to the corners of the boxes.

Every corner begins with the mean of what is round it, weighted by stiffness, and with what the
supports give; between the corners the field is linear along every axis. Such a field is
kinematically admissible, so its potential energy is never below that of the true one. A few steps
of conjugate gradients lower it further.

A box on which smaller ones hang is cut into quarters, so that it follows their corners.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import sqrt

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.bilinear_kernels import (
    add_forces,
    corner_displacements,
    element_stiffness,
    forces,
)
from kaju.model.elastic.bounds.bound_cells import BoundCells, Foundation, corner_ends
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.multigrid.krylov import dot
from kaju.model.scene.cell_types import RIGID, ROLLER

STEPS, MOST_STEPS = 4, 60  # Of conjugate gradients, at least and at most
WORTHWHILE = 0.1
"""So much of the gap between the energies the last few steps must have closed for more."""


def descend(
    v: Floats, residual: Floats, weight: Floats, gap: float, force: Callable[[Floats], Floats]
) -> None:
    """Lower a field's energy by conjugate gradients, as long as that closes enough of a gap."""
    # The displacements `v` and the residual at the nodes are changed in place; `weight` is one over
    # the diagonal, 0 where nodes are held; `gap` is how far the energy may be above its minimum;
    # `force` returns the forces that hold the nodes at a displacement, and may make it fit first.
    search = weight * residual
    before = float(dot(residual.ravel(), search.ravel()))
    gains: list[float] = []
    while before > 0.0 and len(gains) < MOST_STEPS:
        pull = force(search)
        step = before / float(dot(search.ravel(), pull.ravel()))
        v += step * search
        pull *= step
        residual -= pull
        gains.append(0.5 * step * before)
        gap -= gains[-1]
        if len(gains) >= STEPS and sum(gains[-STEPS:]) < WORTHWHILE * gap:
            return
        downhill = np.multiply(weight, residual, out=pull)
        now = float(dot(residual.ravel(), downhill.ravel()))
        search *= now / before
        search += downhill
        before = now


class AdmissibleDisplacement:
    """Displacements of the corners of boxes, shape (nodes, dimension)."""

    def __init__(self, boxes: BoundCells) -> None:
        self.boxes, self.mesh = boxes, boxes.mesh
        self._ends = corner_ends(boxes.dimension)
        scale = self.mesh.edge ** (boxes.dimension - 2)
        self._moduli = Moduli(*(modulus[self.mesh.owner] * scale for modulus in boxes.law))
        self._load = self.forces()
        # What supports give (NaN: nothing), and whether they give a node two displacements at once.
        self.given, self.jumps = self._supports()
        self.displacement = self.mesh.start
        self.hold()
        self._residual = np.zeros_like(self.displacement)

    def hold(self) -> None:
        """Make the field fit: at the supports, and along straight sides."""
        self.displacement = np.where(np.isnan(self.given), self.displacement, self.given)
        self._straighten(self.displacement)

    def _straighten(self, v: Floats) -> None:
        """Put the middles of straight sides between their ends."""
        v[self.mesh.slave] = v[self.mesh.masters].mean(axis=0)

    def _restrict(self, force: Floats) -> None:
        """Move the forces on middles of straight sides to their ends: the adjoint."""
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
        self._restrict(load)
        return load

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
        add_forces(self.mesh.element, self._moduli, v, out)
        for bed in self.boxes.beds:
            axis = bed.side // 2
            node = self.boxes.side_nodes(bed.box, bed.side)
            # The mass matrix of a side: what an even bed does to its corners.
            ends = corner_ends(d - 1)
            mass = 2.0 ** -np.abs(ends[:, None] - ends).sum(axis=2) / 3.0 ** (d - 1)
            pull = np.tensordot(mass, v[node, axis] * self._bed_stiffness(bed), 1)
            out[:, axis] += np.bincount(node.ravel(), pull.ravel(), len(out))
        self._restrict(out)
        return out

    def _bed_stiffness(self, bed: Foundation) -> Floats:
        """Return the stiffness of each part of the boxes' sides on a bed."""
        return bed.stiffness * (0.5 * self.boxes.size[bed.box]) ** (self.boxes.dimension - 1)

    def settle(self, above: float) -> None:
        """Minimise by conjugate gradients, as long as that is worth while."""
        # `above` is the complementary energy of a stress that balances, less the work at moved
        # walls: the potential energy of no field is below its negative.
        diagonal = self._diagonal()
        free = np.isnan(self.given) & (diagonal > 0.0)
        free[self.mesh.slave] = False
        weight = np.where(free, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
        self._residual = self._load - self.force(self.displacement)
        gap = above + self.whole_energy() - self.work()

        def straight_force(search: Floats) -> Floats:
            self._straighten(search)
            return self.force(search)

        descend(self.displacement, self._residual, weight, gap, straight_force)

    def scale(self, share: float) -> None:
        """Multiply the field by a number."""
        self.displacement *= share
        self._residual = (1.0 - share) * self._load + share * self._residual

    def _diagonal(self) -> Floats:
        d = self.boxes.dimension
        # Of a corner's own function every component has the same stiffness.
        one = [form[0, 0] for form in element_stiffness(d)]
        own = sum(share * modulus for share, modulus in zip(one, self._moduli, strict=True))
        column = np.zeros(len(self.mesh.start))
        for node in self.mesh.element:
            column += np.bincount(node, own, len(column))
        out = np.repeat(column[:, None], d, axis=1)
        for bed in self.boxes.beds:
            node = self.boxes.side_nodes(bed.box, bed.side)
            stiff = np.broadcast_to(self._bed_stiffness(bed) / 3.0 ** (d - 1), node.shape)
            out[:, bed.side // 2] += np.bincount(node.ravel(), stiff.ravel(), len(out))
        self._restrict(out)
        return out

    def energies(self) -> Floats:
        """Return the strain energy of every box, scaled."""
        moved = corner_displacements(self.mesh.element, self.displacement)
        energy = 0.5 * np.einsum("ni,ni->n", moved, forces(self._moduli, moved))
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
        force = self._load - self._residual
        return 0.5 * float(dot(self.displacement.ravel(), force.ravel()))

    def _located(self, box: Ints, inside: Floats) -> tuple[Ints, Floats]:
        """Return the elements in which places in boxes lie, and the places in these."""
        d, parts = self.boxes.dimension, self.mesh.parts
        upper = (inside >= 0.5).astype(np.int64)
        element = parts[upper @ (1 << np.arange(d)[::-1]), box]
        cut = (parts[0, box] != parts[1, box])[:, None]
        return element, np.where(cut, 2.0 * inside - upper, inside)

    def displacement_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the displacement at a place in each of n boxes, shape (n, d) from 0 to 1."""
        element, local = self._located(box, inside)
        share = np.where(self._ends[:, None], local, 1.0 - local).prod(axis=2)
        values = self.displacement[self.mesh.element[:, element]]
        return np.asarray(np.einsum("cn,cna->na", share, values))

    def strain_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the strain tensors, shape (n, d, d), there."""
        return self._strains(*self._located(box, inside))

    def _strains(self, element: Ints | slice, local: Floats) -> Floats:
        share = np.where(self._ends[:, None], local, 1.0 - local)
        values, d = self.displacement[self.mesh.element[:, element]], self.boxes.dimension
        slope = np.empty((values.shape[1], d, d))
        for b in range(d):
            along = np.delete(share, b, axis=2).prod(axis=2) * (2.0 * self._ends[:, None, b] - 1.0)
            slope[:, :, b] = np.einsum("cn,cna->na", along, values)
        slope /= self.mesh.edge[element, None, None]
        return np.asarray(0.5 * (slope + slope.transpose(0, 2, 1)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, d, d)."""
        mesh, d = self.mesh, self.boxes.dimension
        # The mean over an element is what there is in its middle.
        strain = self._strains(slice(None), np.full((1, d), 0.5))
        strain *= ((mesh.edge / self.boxes.size[mesh.owner]) ** d)[:, None, None]
        columns = strain.reshape(-1, d * d).T
        mean = [np.bincount(mesh.owner, column, len(self.boxes.size)) for column in columns]
        return np.asarray(np.stack(mean, axis=1).reshape(-1, d, d), np.float64)

    def work_on_beds(self, borne: Callable[[int, Ints], Floats]) -> float:
        """Return the work on the field of what beds bear, linear on the halves of sides."""
        d, size, total = self.boxes.dimension, self.boxes.size, 0.0
        points = [0.25 + sign / sqrt(48.0) for sign in (-1, 1)]  # of Gauss in half a side
        for side, box, _ in self.boxes.beds:
            axis, upper = divmod(side, 2)
            for half, modes in enumerate(borne(side, box).swapaxes(0, 1)):
                for place in product(points, repeat=d - 1):
                    along = 0.5 * corner_ends(d - 1)[half] + place
                    inside = np.tile(np.insert(along, axis, upper), (len(box), 1))
                    moved = self.displacement_at(box, inside)[:, axis]
                    stress = modes @ np.array([1.0, *(2.0 * np.array(place) - 0.5)])
                    work = float(np.vdot(stress * moved, size[box] ** (d - 1)))
                    total += (2.0 * upper - 1.0) * work / 4.0 ** (d - 1)
        return total
