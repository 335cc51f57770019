"""The opinion that fits: a displacement without gaps, by quadratics of least potential energy."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.posed_body import PosedBody

from .border import Sides, grips
from .elements import gauss, nodes, on_sides, quadratic_values, rule, side_loads, strains
from .gap import at_points, roots_of
from .leaves import LeafCells, Mesh
from .levels import Blocks, FieldLevel, summed


@dataclass(eq=False)
class Fitting:
    """Agents with a displacement that fits; scaled."""

    body: PosedBody
    mesh: Mesh
    sides: Sides
    law: Floats  # C11, C12 and mu of the agents; shape (3, n)
    laws: list[tuple[Ints | slice, Floats]]  # The agents of each law, and that law
    fit: Floats = field(init=False)
    """Unknowns of the displacement of each agent; shape (n, unknowns)."""
    parts: tuple[Any, ...] = field(default=(), init=False)
    """The same under loads, and under supports that move, if both act."""
    levels: tuple[FieldLevel, ...] = field(default=(), init=False)
    """Equations of the displacement, in the plane also those of phi."""
    duals: tuple[Any, ...] = field(default=(), init=False)
    """The same agents under the loads whose work is what goals ask for."""

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.mesh.leaves

    @cached_property
    def size(self) -> Floats:
        """Edges in cells."""
        return np.asarray(self.leaves.size / self.body.cell)

    @cached_property
    def roots(self) -> list[tuple[Ints | slice, Floats]]:
        """The agents of each law, and a root of their energy by their unknowns."""
        d = self.body.dimension
        return [
            (agents, at_points(roots_of(law, d)[0], strains(d), d)) for agents, law in self.laws
        ]

    @property
    def cases(self) -> tuple[Any, ...]:
        """The parts, or itself if it has none."""
        return self.parts or (self,)

    @cached_property
    def blocks(self) -> Blocks:
        """The stiffness of the agents and of the beds."""
        d, sides, mesh = self.body.dimension, self.sides, self.mesh
        dof = (d * mesh.node[:, :, None] + np.arange(d)).reshape(len(mesh.node), -1)
        size = d * (len(mesh.place) + len(mesh.ends))
        matrices = [(agents, root.T @ root) for agents, root in self.roots]
        beds, extra = sides.beds, None
        if len(beds):
            unknown = d * mesh.on_border[beds] + (mesh.side[beds] // 2)[:, None]
            area = self.size[mesh.owner[beds]] ** (d - 1)
            points, weights = gauss(3, d - 1)
            root = np.sqrt(weights)[:, None] * quadratic_values(points)
            value = (sides.bed[beds] * area)[:, None, None] * (root.T @ root)
            extra = summed(value, unknown, sp.eye_array(size, format="csr"))
        return Blocks(dof, matrices, self.size ** (d - 2), None, size, extra)

    def fits(self, level: FieldLevel, begun: Floats, gap: float) -> None:
        """Find the displacement that fits of least energy, but for what a gap allows."""
        self.blocks, self.fit = level.blocks, begun
        if self.sides.moved.any():
            self.fit = moved_by(self.mesh, self.sides, self.blocks.shared(begun))
        self.fit = self.fit + self.blocks.own(level.solve(-self._left(), gap))

    def _left(self) -> Floats:
        """Return the forces that nodes take of agents and beds, less the loads."""
        blocks = self.blocks
        return blocks.apply(blocks.shared(self.fit)) - blocks.gather(forces_of(self.sides))

    def displacement_at(self, agent: Ints, inside: Floats) -> Floats:
        """Return the displacement at places from 0 to 1 in agents, shape (n, d); scaled."""
        values = quadratic_values(inside)
        own = self.fit[agent].reshape(*values.shape, inside.shape[1])
        return np.asarray(np.einsum("nk,nkd->nd", values, own)) + self.sides.shift

    def work_on(self, fit: Floats) -> float:
        """Return the work of the loads on a displacement of the agents."""
        return float(np.vdot(forces_of(self.sides), fit))


def way_of(mesh: Mesh, sides: Sides) -> tuple[sp.csr_array, Ints]:
    """Return what all unknowns are by the free ones, and which these are."""
    d = sides.held.shape[1]
    # What a held node follows is held as well.
    stays = np.asarray(held_by(mesh, sides).any(axis=0))
    vertex, along, _ = grips(mesh, sides)
    stays[vertex, along] = True
    held = mesh.masters(stays)
    ties, follows = mesh.tied
    free = np.flatnonzero((~(follows[:, None] | held)).ravel())
    both = sp.csr_array(sp.kron(ties, sp.eye_array(d), format="csr"))
    return sp.csr_array(both[:, free]), free


def held_by(mesh: Mesh, sides: Sides) -> Flags:
    """Tell which components of nodes each support holds, shape (supports, nodes, d)."""
    d = sides.held.shape[1]
    supports = 1 + max(2 * d, sides.support.max(initial=0))
    found = np.zeros((supports, len(mesh.place) + len(mesh.ends), d), dtype=np.bool_)
    side, axis = np.nonzero(sides.held)
    found[sides.support[side, None], mesh.on_border[side], axis[:, None]] = True
    return found


def moved_by(mesh: Mesh, sides: Sides, shared: Floats) -> Floats:
    """Return the unknowns of agents of a displacement, which becomes as given where it is held."""
    d = sides.held.shape[1]
    holds = held_by(mesh, sides)
    far = np.zeros((len(holds), d))
    for support in range(len(holds)):
        here = sides.moved[sides.support == support]
        far[support] = here.max(axis=0, initial=0.0) + here.min(axis=0, initial=0.0)
    # Where supports meet that move apart (in space) a node moves by their mean.
    given = (holds * far[:, None]).sum(axis=0) / np.maximum(holds.sum(axis=0), 1)
    given[len(mesh.place) :] = 0.0
    value = np.where(holds.any(axis=0), given, shared.reshape(-1, d))
    return np.asarray((mesh.tied[0] @ value)[mesh.node].reshape(len(mesh.node), -1))


def forces_of(sides: Sides) -> Floats:
    """Return the forces of the loads on the agents' own unknowns."""
    d = sides.held.shape[1]
    (points, weights), out = rule(d), np.zeros((len(sides.body), len(nodes(d)), d))
    if sides.body.any():
        out += sides.body[:, None] * (weights @ quadratic_values(points))[:, None]
    for side in np.flatnonzero(sides.load.any(axis=(0, 2, 3))):
        out[:, on_sides(d)[side]] += np.einsum("ngc,gk->nkc", sides.load[:, side], side_loads(d))
    own = out.reshape(len(out), -1)
    if sides.even.any():
        own += sides.even @ np.einsum("pki,p->ki", strains(d), weights)
    return own
