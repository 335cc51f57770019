"""A displacement field without gaps: from the faces' displacements to the corners of the boxes.

Every corner takes the mean of what is round it, weighted by stiffness, and what the supports
give; between the corners it is linear along every axis. Such a field is kinematically
admissible, so its potential energy is never below that of the true one. A few steps of conjugate
gradients let it sink further.

A box on which smaller ones hang is cut into quarters, so that it follows their corners.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from kaju.model.scene.kinds import RIGID, ROLLER

from .boxes import Boxes, Index, corner_ends
from .problem import Floats

STEPS = 4
"""Of conjugate gradients: more lower the energy by little."""


class CompatibleField:
    """Displacements of the corners of boxes.

    Parameters
    ----------
    boxes : Boxes

    Attributes
    ----------
    displacement : array, shape (nodes, dimension)
    jumps : bool
        Whether supports give a corner two displacements at once: no field without gaps has that.
    """

    def __init__(self, boxes: Boxes) -> None:
        self.boxes, self.mesh = boxes, boxes.mesh
        self._ends = corner_ends(boxes.dimension)
        self._strain, self._stiffness = _element(self._ends)
        owner, power = self.mesh.owner, boxes.dimension - 2
        self._moduli = [modulus[owner] * self.mesh.edge**power for modulus in boxes.law]
        self._load = self._forces()
        self._given, self.jumps = self._supports()
        self.displacement = np.where(np.isnan(self._given), self.mesh.start, self._given)
        self._straighten(self.displacement)

    def _straighten(self, v: Floats) -> None:
        """Put the middles of straight sides between their ends."""
        low, high = self.mesh.masters
        v[self.mesh.slave] = 0.5 * (v[low] + v[high])

    def _lead(self, force: Floats) -> None:
        """Hand the forces on middles of straight sides to their ends."""
        slave = self.mesh.slave
        for master in self.mesh.masters:
            np.add.at(force, master, 0.5 * force[slave])
        force[slave] = 0.0

    def _gathered(self, node: Index, force: Floats) -> Floats:
        """Add forces, shape (..., dimension), up at nodes of shape (...)."""
        at, count = node.ravel(), len(self.mesh.start)
        flat = force.reshape(len(at), force.shape[-1])
        return np.stack([np.bincount(at, column, count) for column in flat.T], axis=1)

    def _forces(self) -> Floats:
        boxes, mesh, d = self.boxes, self.mesh, self.boxes.dimension
        each = (boxes.body[:, mesh.owner] * mesh.edge**d / len(self._ends)).T
        load = self._gathered(mesh.element, np.broadcast_to(each, (len(self._ends), *each.shape)))
        for side in range(2 * d):
            on = boxes.loads.side == side
            node = boxes.side_nodes(boxes.loads.box[on], side)
            share = np.broadcast_to(boxes.loads.force[on] / len(node), (*node.shape, d))
            load += self._gathered(node, share)
        self._lead(load)
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
                for node in self.boxes.side_nodes(held.box, held.side):
                    for component in [axis] if kind == ROLLER else range(self.boxes.dimension):
                        old, new = given[node, component], held.value[:, component]
                        jumps |= bool(np.any(~np.isnan(old) & (old != new)))
                        given[node, component] = new
        return given, jumps

    def force(self, v: Floats) -> Floats:
        """Return the forces that hold corners at a displacement."""
        moved = self._element_values(v)
        held = np.zeros_like(moved)
        for matrix, modulus in zip(self._stiffness, self._moduli, strict=True):
            held += (matrix @ moved) * modulus
        d = self.boxes.dimension
        out = self._gathered(
            self.mesh.element, held.reshape(len(self._ends), d, -1).transpose(0, 2, 1)
        )
        for bed in self.boxes.beds:
            axis = bed.side // 2
            node = self.boxes.side_nodes(bed.box, bed.side)
            pull = _bed_matrix(d) @ (v[node, axis] * self._bed_stiffness(bed.box, bed.stiffness))
            out[:, axis] += np.bincount(node.ravel(), pull.ravel(), len(out))
        self._lead(out)
        return out

    def _bed_stiffness(self, box: Index, stiffness: Floats) -> Floats:
        return stiffness * self.boxes.size[box] ** (self.boxes.dimension - 1)

    def _element_values(self, v: Floats) -> Floats:
        """Return the displacements of the elements' corners, shape (2^d · d, elements)."""
        return v[self.mesh.element].transpose(0, 2, 1).reshape(-1, len(self.mesh.owner))

    def settle(self, steps: int = STEPS) -> None:
        """Take some steps of conjugate gradients towards the least potential energy."""
        diagonal = self._diagonal()
        free = np.isnan(self._given) & (diagonal > 0.0)
        free[self.mesh.slave] = False
        weight = np.where(free, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
        left = np.where(free, self._load - self.force(self.displacement), 0.0)
        z = weight * left
        way, before = z.copy(), float(np.vdot(left, z))
        for _ in range(steps):
            if before <= 0.0:
                return
            self._straighten(way)
            pull = np.where(free, self.force(way), 0.0)
            step = before / float(np.vdot(way, pull))
            self.displacement += step * way
            left -= step * pull
            z = weight * left
            now = float(np.vdot(left, z))
            way, before = z + now / before * way, now

    def _diagonal(self) -> Floats:
        d = self.boxes.dimension
        own = np.stack(
            [
                sum(
                    matrix[k, k] * modulus
                    for matrix, modulus in zip(self._stiffness, self._moduli, strict=True)
                )
                for k in range(len(self._ends) * d)
            ]
        )
        out = self._gathered(
            self.mesh.element, own.reshape(len(self._ends), d, -1).transpose(0, 2, 1)
        )
        for bed in self.boxes.beds:
            node = self.boxes.side_nodes(bed.box, bed.side)
            own = np.broadcast_to(
                self._bed_stiffness(bed.box, bed.stiffness) / 3.0 ** (d - 1), node.shape
            )
            out[:, bed.side // 2] += np.bincount(node.ravel(), own.ravel(), len(out))
        self._lead(out)
        return out

    def energies(self) -> Floats:
        """Return the strain energy of every box, scaled."""
        moved = self._element_values(self.displacement)
        energy = 0.5 * sum(
            np.einsum("in,in->n", moved, matrix @ moved) * modulus
            for matrix, modulus in zip(self._stiffness, self._moduli, strict=True)
        )
        return np.asarray(np.bincount(self.mesh.owner, energy, len(self.boxes.size)), np.float64)

    def work(self) -> float:
        """Return the work of the loads."""
        return float(np.vdot(self._load, self.displacement))

    def whole_energy(self) -> float:
        """Return the energy in body and bed."""
        return 0.5 * float(np.vdot(self.displacement, self.force(self.displacement)))

    def mean_strains(self) -> Floats:
        """Return the mean strain tensors of the boxes, shape (boxes, d, d)."""
        mesh, d = self.mesh, self.boxes.dimension
        moved = self.displacement[mesh.element]  # ends, elements, component
        gradient = np.einsum("kb,kna->nab", self._strain, moved) / mesh.edge[:, None, None]
        share = (mesh.edge / self.boxes.size[mesh.owner]) ** d
        mean = np.stack(
            [
                np.bincount(mesh.owner, share * column, len(self.boxes.size))
                for column in gradient.reshape(-1, d * d).T
            ],
            axis=1,
        ).reshape(-1, d, d)
        return np.asarray(0.5 * (mean + mean.transpose(0, 2, 1)))


def _bed_matrix(dimension: int) -> Floats:
    """Return the forces at the corners of a side on an even bed by their displacements."""
    ends = corner_ends(dimension - 1)
    apart = np.abs(ends[:, None] - ends).sum(axis=2)
    return np.asarray(2.0**-apart / 3.0 ** (dimension - 1))


def _element(ends: Index) -> tuple[Floats, tuple[Floats, Floats, Floats]]:
    """Return the mean gradients of the corners' functions, and the three matrices of a box.

    The stiffness of a box of unit edge is C₁₁ times the first, C₁₂ the second, μ the third.
    """
    d = ends.shape[1]
    size = len(ends) * d
    matrices = [np.zeros((size, size)) for _ in range(3)]
    mean = np.zeros((len(ends), d))
    points = np.array(list(product((0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)), repeat=d)))
    for point in points:
        gradient = np.ones((len(ends), d))
        for axis in range(d):
            for other in range(d):
                value = np.where(ends[:, other] == 1, point[other], 1.0 - point[other])
                slope = 2.0 * ends[:, other] - 1.0
                gradient[:, axis] *= slope if other == axis else value
        mean += gradient / len(points)
        rows = np.zeros((d, size))
        for axis in range(d):
            rows[axis, axis::d] = gradient[:, axis]
        along = rows.T @ rows
        whole = rows.sum(axis=0)
        matrices[0] += along / len(points)
        matrices[1] += (np.outer(whole, whole) - along) / len(points)
        for a in range(d):
            for b in range(a + 1, d):
                shear = np.zeros(size)
                shear[a::d], shear[b::d] = gradient[:, b], gradient[:, a]
                matrices[2] += np.outer(shear, shear) / len(points)
    return mean, (matrices[0], matrices[1], matrices[2])
