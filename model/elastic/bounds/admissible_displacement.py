"""A displacement field without gaps: from the faces' displacements to the nodes of the boxes.

Every corner begins with the mean of what is round it, weighted by stiffness, and with what the
supports give. Between the corners the field is linear along every axis, and in the plane every edge
has a quadratic besides (serendipity elements). Such a field is kinematically admissible, so its
potential energy is never below that of the true one. Some steps of conjugate gradients lower it
further: they find the quadratics, which a staggered grid's answer has no room for though its faces
are accurate enough for them (superconvergence).

A box on which smaller ones hang is cut into quarters, so that it follows their corners.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import sqrt
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.bilinear_kernels import (
    FEW,
    LawForms,
    add_forces,
    node_displacements,
)
from kaju.model.elastic.bounds.bound_cells import BoundCells, Foundation, corner_ends
from kaju.model.elastic.bounds.shape_functions import (
    BULGE,
    EDGES,
    element_stiffness,
    mean_slopes,
    mean_values,
    shape_slopes,
    shape_values,
    side_mass,
)
from kaju.model.elastic.equal.krylov import dot
from kaju.model.elastic.moduli import Moduli
from kaju.model.scene.cell_types import RIGID, ROLLER

MOST_QUADRATIC = 500_000  # Boxes of more take linear fields only: memory
STEPS, MOST_STEPS = 4, 300  # Of conjugate gradients, at least and at most
RUBBER, RUBBER_STEPS = 1e3, 40
"""From so many times the shear modulus on a lateral one makes the energy rest for some steps."""
WORTHWHILE = 0.1
"""So much of the gap between the energies the last few steps must have closed for more."""


def fits_quadratics(dimension: int, boxes: int) -> bool:
    """Tell whether fields of so many boxes are quadratic: bounds are of second order then."""
    return dimension == 2 and boxes <= MOST_QUADRATIC


def descend(
    v: Floats,
    residual: Floats,
    weight: Floats,
    gap: float,
    force: Callable[[Floats], Floats],
    least: int = STEPS,
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
        curvature = float(dot(search.ravel(), pull.ravel()))
        if not curvature > 0.0:  # Of an exact answer rounding is all that is left
            return
        step = before / curvature
        v += step * search
        pull *= step
        residual -= pull
        gains.append(0.5 * step * before)
        gap -= gains[-1]
        if len(gains) >= least and sum(gains[-least:]) < WORTHWHILE * abs(gap):
            return
        downhill = np.multiply(weight, residual, out=pull)
        now = float(dot(residual.ravel(), downhill.ravel()))
        search *= now / before
        search += downhill
        before = now


class Slaves(NamedTuple):
    """Nodes whose displacement follows from others'."""

    node: Ints  # Shape (n,)
    masters: Ints  # Shape (masters, n)
    weights: tuple[float, ...]  # Of each master


class AdmissibleDisplacement:
    """Displacements of the nodes of boxes, shape (nodes, dimension).

    The nodes are the corners of elements (`Mesh`) and, if it is `quadratic`, their edges, whose
    entries are how far the middle is off the straight line between the ends.
    """

    def __init__(self, boxes: BoundCells) -> None:
        self.boxes, self.mesh = boxes, boxes.mesh
        d = boxes.dimension
        self.quadratic = fits_quadratics(d, len(boxes.size))
        self.element, self._edge_keys = self.mesh.element, np.zeros(0, dtype=np.int64)
        masters = self.mesh.masters
        self._slaves = [Slaves(self.mesh.slave, masters, (1.0 / len(masters),) * len(masters))]
        if self.quadratic:
            self._add_edges()
        scale, law = self.mesh.edge ** (d - 2), np.stack(boxes.law)[:, self.mesh.owner]
        self._stiffness = LawForms(law, element_stiffness(d, self.quadratic), scale)
        # Of many boxes the compiled loop over bilinear fields takes the moduli.
        self._moduli = None
        if not self.quadratic and len(self.mesh.owner) > FEW:
            self._moduli = Moduli(*(law * scale))
        self._count = len(self.mesh.start) + len(self._edge_keys)
        self._load = self.forces()
        # What supports give (NaN: nothing), and whether they give a node two displacements at once.
        self.given, self.jumps = self._supports()
        self.displacement = np.zeros((self._count, d))
        self.displacement[: len(self.mesh.start)] = self.mesh.start
        self.hold()
        self._residual = np.zeros_like(self.displacement)

    def _add_edges(self) -> None:
        """Give every edge of an element a node, and the halves of straight sides the side's."""
        corner, slave, (first, last) = self.mesh.element, self.mesh.slave, self.mesh.masters
        own = [self._edge_key(corner[i], corner[j]) for i, j in EDGES]
        key = [
            *own,
            *(self._edge_key(*ends) for ends in ((first, last), (first, slave), (last, slave))),
        ]
        self._edge_keys, number = np.unique(np.concatenate(key), return_inverse=True)
        number += len(self.mesh.start)
        edges, of_sides = np.split(number, [4 * corner.shape[1]])
        self.element = np.concatenate([corner, edges.reshape(4, -1)])
        whole, *halves = of_sides.reshape(3, -1)
        self._sides = whole
        # A quadratic over a side is one on each half, of a quarter of its height.
        self._slaves = [
            Slaves(slave, np.stack([first, last, whole]), (0.5, 0.5, 1.0)),
            *(Slaves(half, whole[None], (0.25,)) for half in halves),
        ]

    def _edge_key(self, first: Ints, last: Ints) -> Ints:
        """Return a number for the edge between two corners."""
        return np.minimum(first, last) * len(self.mesh.start) + np.maximum(first, last)

    def halves(self) -> tuple[Ints, Floats]:
        """Return the axes and lengths of straight sides with a node in the middle."""
        edges = self.element[4:]
        axis, length = np.zeros(self._count, dtype=np.int64), np.zeros(self._count)
        axis[edges[2:]] = 1
        length[edges] = 2.0 * self.mesh.edge
        half = self._slaves[1].node
        return axis[half], length[half]

    def side_nodes(self, box: Ints, side: int) -> Ints:
        """Return the nodes of the elements on a side of boxes, shape (functions, parts, n)."""
        corners = self.boxes.side_nodes(box, side)
        if not self.quadratic:
            return corners
        edge = np.searchsorted(self._edge_keys, self._edge_key(*corners))
        return np.concatenate([corners, (len(self.mesh.start) + edge)[None]])

    def hold(self) -> None:
        """Make the field fit: at the supports, and along straight sides."""
        self.displacement = np.where(np.isnan(self.given), self.displacement, self.given)
        self._straighten(self.displacement)

    def _straighten(self, v: Floats) -> None:
        """Let the nodes within straight sides follow those of the sides."""
        for slaves in self._slaves:
            v[slaves.node] = 0.0
            for master, weight in zip(slaves.masters, slaves.weights, strict=True):
                v[slaves.node] += weight * v[master]

    def _restrict(self, force: Floats) -> None:
        """Move the forces on nodes within straight sides to those of the sides: the adjoint."""
        for slaves in self._slaves:
            for master, weight in zip(slaves.masters, slaves.weights, strict=True):
                np.add.at(force, master, weight * force[slaves.node])
            force[slaves.node] = 0.0

    def _gathered(self, node: Ints, force: Floats) -> Floats:
        """Add forces, shape (..., dimension), up at nodes of shape (...)."""
        at = node.ravel()
        flat = force.reshape(len(at), force.shape[-1])
        return np.stack([np.bincount(at, column, self._count) for column in flat.T], axis=1)

    def forces(self) -> Floats:
        """Return the loads at the nodes."""
        boxes, mesh, d = self.boxes, self.mesh, self.boxes.dimension
        load = np.zeros((self._count, d))
        if boxes.body.any():
            each = (boxes.body[:, mesh.owner] * mesh.edge**d).T
            share = mean_values(d, self.quadratic)[:, None, None] * each
            load += self._gathered(self.element, share)
        parts = 1 << (d - 1)
        # An even load's shares for the functions of a side.
        even = np.full(parts, 1.0 / parts)
        even = np.append(even, BULGE) if self.quadratic else even
        for side in range(2 * d):
            on = boxes.loads.side == side
            box, force = boxes.loads.box[on], boxes.loads.force[on]
            node = self.side_nodes(box, side)
            share = even[:, None, None, None] * np.broadcast_to(force / parts, (*node.shape[1:], d))
            load += self._gathered(node, share)
            # What loads add that lie unevenly on the side: linear tractions.
            uneven = boxes.uneven_loads.some(boxes.uneven_loads.side == side)
            node, part = self.side_nodes(uneven.box, side), mesh.parts[:, uneven.box]
            cut, axes = part[0] != part[1], [a for a in range(d) if a != side // 2]
            ends = 2.0 * corner_ends(d - 1) - 1.0
            along = np.einsum("nik,ek->eni", uneven.moment[:, :, axes], ends)
            along = along / (boxes.size[uneven.box, None] * parts**2)
            # On a whole side by its corners; on parts by where these lie, and by their corners.
            share = np.where(cut[:, None], 3.0 * along[None] + along[:, None], 2.0 * along[:, None])
            if self.quadratic:
                # Of an odd traction a quadratic feels the means of the halves alone.
                share = np.concatenate([share, np.where(cut[:, None], 4.0 * along, 0.0)[None]])
            load += self._gathered(node, share)
        self._restrict(load)
        return load

    def _supports(self) -> tuple[Floats, bool]:
        """Return the given displacements (NaN where free), and whether they contradict."""
        given = np.full((self._count, self.boxes.dimension), np.nan)
        corners, jumps = len(self.mesh.start), False
        for kind in (ROLLER, RIGID):
            for held in self.boxes.held:
                if held.kind != kind:
                    continue
                axis = held.side // 2
                sides = self.side_nodes(held.box, held.side)
                for node in sides.reshape(-1, sides.shape[-1]):
                    straight = node >= corners
                    for component in [axis] if kind == ROLLER else range(self.boxes.dimension):
                        new = np.where(straight, 0.0, held.value[:, component])
                        old = given[node, component]
                        jumps |= bool(np.any(~np.isnan(old) & (old != new)))
                        given[node, component] = new
        if self.quadratic:
            given[self._sides] = np.where(np.isnan(given[self.mesh.slave]), given[self._sides], 0.0)
        return given, jumps

    def force(self, v: Floats) -> Floats:
        """Return the forces that hold nodes at a displacement."""
        out = np.zeros_like(v)
        if self._moduli is not None:
            add_forces(self.element, self._moduli, v, out)
        else:
            each = self._stiffness.apply(node_displacements(self.element, v))
            at = self.element.T.ravel()
            for a in range(len(out.T)):
                out[:, a] = np.bincount(at, each[:, a :: len(out.T)].ravel(), len(out))
        mass = side_mass(self.boxes.dimension, self.quadratic)
        for bed in self.boxes.beds:
            axis = bed.side // 2
            node = self.side_nodes(bed.box, bed.side)
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
        for slaves in self._slaves:
            free[slaves.node] = False
        weight = np.where(free, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
        self._residual = self._load - self.force(self.displacement)
        gap = above + self.whole_energy() - self.work()

        def straight_force(search: Floats) -> Floats:
            self._straighten(search)
            return self.force(search)

        rubber = bool(np.any(self.boxes.law.lateral > RUBBER * self.boxes.law.shear))
        least = RUBBER_STEPS if rubber else STEPS
        descend(self.displacement, self._residual, weight, gap, straight_force, least)

    def scale(self, share: float) -> None:
        """Multiply the field by a number."""
        self.displacement *= share
        self._residual = (1.0 - share) * self._load + share * self._residual

    def _diagonal(self) -> Floats:
        """Return the diagonal of the stiffness, that of slaves shared out among their masters."""
        d, out = self.boxes.dimension, np.zeros_like(self.displacement)
        own = self._stiffness.diagonal().reshape(-1, len(self.element), d)
        for node, each in zip(self.element, own.swapaxes(0, 1), strict=True):
            for a in range(d):
                out[:, a] += np.bincount(node, each[:, a], len(out))
        mass = side_mass(d, self.quadratic).diagonal()[:, None, None]
        for bed in self.boxes.beds:
            node = self.side_nodes(bed.box, bed.side)
            stiff = np.broadcast_to(self._bed_stiffness(bed) * mass, node.shape)
            out[:, bed.side // 2] += np.bincount(node.ravel(), stiff.ravel(), len(out))
        self._restrict(out)
        return out

    def energies(self) -> Floats:
        """Return the strain energy of every box, scaled."""
        moved = node_displacements(self.element, self.displacement)
        energy = 0.5 * np.einsum("ni,ni->n", moved, self._stiffness.apply(moved))
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
            box = np.flatnonzero(rest)
            node = self.side_nodes(box, side)
            moved = self.displacement[node, axis].mean(axis=1)  # over the parts of the side
            corners = node.shape[1]
            mean = moved[:corners].mean(axis=0) + BULGE * moved[corners:].sum(axis=0)
            force = rest[box] * boxes.size[box] ** (boxes.dimension - 1)
            total += (1 - 2 * upper) * float(np.vdot(force, mean))
        return total

    def whole_energy(self) -> float:
        """Return the energy in body and bed, once settled."""
        force = self._load - self._residual
        return 0.5 * float(dot(self.displacement.ravel(), force.ravel()))

    def located(self, box: Ints, inside: Floats) -> tuple[Ints, Floats]:
        """Return the elements in which places in boxes lie, and the places in these."""
        d, parts = self.boxes.dimension, self.mesh.parts
        upper = (inside >= 0.5).astype(np.int64)
        element = parts[upper @ (1 << np.arange(d)[::-1]), box]
        cut = (parts[0, box] != parts[1, box])[:, None]
        return element, np.where(cut, 2.0 * inside - upper, inside)

    def displacement_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the displacement at a place in each of n boxes, shape (n, d) from 0 to 1."""
        element, local = self.located(box, inside)
        values = self.displacement[self.element[:, element]]
        return np.asarray(np.einsum("cn,cna->na", shape_values(local, self.quadratic), values))

    def strain_at(self, box: Ints, inside: Floats) -> Floats:
        """Return the strain tensors, shape (n, d, d), there."""
        element, local = self.located(box, inside)
        values = self.displacement[self.element[:, element]]
        slopes = np.einsum("cnb,cna->nab", shape_slopes(local, self.quadratic), values)
        slopes /= self.mesh.edge[element, None, None]
        return np.asarray(0.5 * (slopes + slopes.transpose(0, 2, 1)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, d, d)."""
        mesh, d = self.mesh, self.boxes.dimension
        values = self.displacement[self.element]
        slopes = np.einsum("cb,cna->nab", mean_slopes(d, self.quadratic), values)
        slopes *= (mesh.edge ** (d - 1) / self.boxes.size[mesh.owner] ** d)[:, None, None]
        columns = (0.5 * (slopes + slopes.transpose(0, 2, 1))).reshape(-1, d * d).T
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
