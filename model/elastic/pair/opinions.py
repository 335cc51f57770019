"""Both opinions of agents in the plane, and what they prove."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import is_rubber
from kaju.model.elastic.pair.airy import Airy, compliance, first_stress, stress_within
from kaju.model.elastic.pair.border import Sides, support_names
from kaju.model.elastic.pair.displacement import Fitting, forces_of
from kaju.model.elastic.pair.elements import (
    CORNERS,
    airy_stress,
    child_maps,
    edge_tractions,
    on_sides,
    rule,
    strain_rows,
    stresses,
    without_plane,
)
from kaju.model.elastic.pair.gap import (
    Bounds,
    beside_phi,
    bounds_of,
    energies,
    fields_at_rule,
    stress_of,
)
from kaju.model.elastic.pair.leaf_mesh import PlaneMesh, backwards
from kaju.model.elastic.pair.levels import FieldLevel, handed_down, level_of


@dataclass(eq=False)
class Opinions(Fitting):
    """Agents with their two opinions."""

    mesh: PlaneMesh
    phi: Floats = field(init=False)
    """Unknowns of Airy's function, without its linear part; shape (cases, n, 16)."""

    def tractions(self, case: int) -> Floats:
        """Return forces that sides hand on to agents, and first moments; shape (n, 4, 2, 2)."""
        out = np.einsum("ijkl,nl->nijk", edge_tractions(), self.phi[case])
        out /= self.size[:, None, None, None]
        for side in range(4):
            out[:, side, 0, side // 2] -= 0.5 * self.cases[case].body[:, side // 2]
        return np.asarray(out)

    def on_border(self, case: int) -> Floats:
        """Return forces and first moments on the body at the sides of its border, (m, 2, 2)."""
        return self.tractions(case)[self.mesh.owner, self.mesh.side]

    @cached_property
    def _judged(self) -> tuple[Bounds, Floats]:
        """The bounds, and the gap of each agent."""
        cases: list[tuple[float, float, bool, float]] = []
        shares: Floats = np.zeros(len(self.size))
        sums: list[Floats] = []
        for case, acts in enumerate(self.cases):
            loaded = not acts.moved.any()
            stress, fitting = self.fields(case)
            potential = 0.5 * float(energies(fitting, self.law, self.size).sum())
            complementary = 0.5 * float(energies(stress, self.law, self.size).sum())
            borne, given = self.tractions_of_beds(case)
            potential += 0.5 * float(self.on_beds(given, given).sum())
            complementary += 0.5 * float(self.on_beds(borne, borne).sum())
            if loaded:
                potential -= float(np.vdot(forces_of(acts), self.fit[case]))
            else:
                complementary -= self.work_of_supports(acts.moved, case)
            own = energies(stress - fitting, self.law, self.size)
            np.add.at(own, self.mesh.owner, self.on_beds(borne - given, borne - given))
            cases.append((potential, complementary, loaded, float(own.sum())))
            shares += own
            sums.append(stress - fitting)
        if len(sums) > 1:
            # The error of both together, should it be larger than that of each.
            shares = np.maximum(shares, energies(sums[0] + sums[1], self.law, self.size))
        locks = is_rubber(self.body.moduli, self.body.scene.plane)
        return bounds_of(cases, float(shares.sum()), self.sides.rest, locks), shares

    def fields(self, case: int) -> tuple[Floats, Floats]:
        """Return both stresses of a case at the points of the rule."""
        own = self.fit[case], self.phi[case], self.cases[case]
        return fields_at_rule(*own, self.size, self.law)

    @property
    def bounds(self) -> Bounds:
        """What the two opinions prove."""
        return self._judged[0]

    @property
    def shares(self) -> Floats:
        """The gap of each agent: its part of the squared distance of both opinions."""
        return self._judged[1]

    def stresses_at(self, agent: Ints, inside: Floats) -> tuple[Floats, Floats]:
        """Return tensors of the stress that balances and of the strain that fits; scaled."""
        size = self.size[agent, None]
        phi, fit = self.phi.sum(axis=0)[agent], self.fit.sum(axis=0)[agent]
        stress = np.einsum("nki,ni->nk", airy_stress(inside), phi) / size**2
        stress[:, :2] -= self.sides.body[agent] / size * (inside - 0.5)
        strain = np.einsum("nki,ni->nk", strain_rows(inside), fit) / size
        return tensors(stress), tensors(stress_of(strain, self.law[:, agent]))

    def stress_at(self, agent: Ints, inside: Floats) -> Floats:
        """Return the mean of both: the stress whose error the gap tells exactly."""
        balanced, fitted = self.stresses_at(agent, inside)
        return 0.5 * (balanced + fitted)

    @cached_property
    def means(self) -> tuple[Floats, Floats]:
        """Mean tensors over agents: of the stress that balances, of the strain that fits."""
        weights, size = rule()[1], self.size[:, None]
        rows = np.einsum("p,pki->ik", weights, stresses())
        balanced = self.phi.sum(axis=0) @ rows / size**2
        strain = self.fit.sum(axis=0) @ np.einsum("p,pki->ik", weights, strain_rows(rule()[0]))
        return tensors(balanced), tensors(stress_of(strain / size, self.law))

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body, of the stress that balances; scaled."""
        sides, borne = self.sides, ~self.sides.given
        own = np.sum([self.on_border(case) for case in range(len(self.cases))], axis=0)[:, 0]
        own = own - sides.load[self.mesh.owner, self.mesh.side, 0] - sides.straight
        names = support_names(self.body)
        return {
            names[k]: np.where(borne & (sides.support == k)[:, None], own, 0.0).sum(axis=0)
            for k in np.unique(sides.support[borne.any(axis=1)])
        }

    def work_of_supports(self, moved: Floats, case: int) -> float:
        """Return the work of what supports bear on how they move, shape (m, 2)."""
        return float(np.vdot(self.on_border(case)[:, 0], moved))

    def bed_tractions(self, case: int) -> Floats:
        """Return force and moment (over the side) that beds put on the body, shape (beds, 2)."""
        mesh, beds = self.mesh, self.sides.beds
        own = self.on_border(case) - self.cases[case].load[mesh.owner, mesh.side]
        return np.asarray(own[beds, :, mesh.side[beds] // 2])

    def tractions_of_beds(self, case: int) -> Floats:
        """Return what beds put on the body by both opinions, at four points; (2, beds, 4)."""
        mesh, beds = self.mesh, self.sides.beds
        if not len(beds):
            return np.zeros((2, 0, 4))
        owner, side = mesh.owner[beds], mesh.side[beds]
        own = self.fit[case].reshape(-1, 8, 2)
        u = own[owner[:, None], on_sides(2)[side], side[:, None] // 2]
        at = 0.5 * np.polynomial.legendre.leggauss(4)[0]
        moved = u[:, [0]] * (0.5 - at) + u[:, [1]] * (0.5 + at) + u[:, [2]] * (1.0 - 4.0 * at**2)
        force = self.bed_tractions(case)
        traction = (force[:, [0]] + 12.0 * force[:, [1]] * at) / self.size[owner, None]
        return np.stack([traction, -self.sides.bed[beds, None] * moved])

    def on_beds(self, one: Floats, other: Floats) -> Floats:
        """Return the products of two tractions of beds (their energy), by side of the border."""
        beds, out = self.sides.beds, np.zeros(len(self.mesh.border))
        if not len(beds):
            return out
        weight = 0.5 * np.polynomial.legendre.leggauss(4)[1]
        length = self.size[self.mesh.owner[beds]]
        out[beds] = length / self.sides.bed[beds] * ((one * other) @ weight)
        return out


def tensors(three: Floats) -> Floats:
    """Return stresses xx, yy, xy as tensors, shape (n, 2, 2)."""
    return np.asarray(three[:, [[0, 2], [2, 1]]])


def balance(
    fields: list[Opinions],
    olds: list[Any],
    family: tuple[Ints, Ints] | None,
    gaps: list[float],
    before: FieldLevel | None,
    direct: int,
) -> FieldLevel:
    """Give agents under each set of loads the stress that balances, of least energy."""
    found = fields[0]
    airy = Airy(found.mesh, found.sides, found.body.cell)
    blocks = airy.blocks(found.laws, found.size)
    level = level_of(blocks, airy.way(), before, family, child_maps(True), direct)
    for own, old, gap in zip(fields, olds, gaps, strict=True):
        own.phi = _begun(own, old, family)
        for case, acts in enumerate(own.cases):
            rest = -blocks.gather(blocks.times(own.phi[case]) + _of_stress_beside(own, acts))
            rest += _of_beds(airy, own, case) + _of_moved(airy, acts)
            own.phi[case] += without_plane(blocks.own(level.solve(rest, gap)))
    return level


def _begun(new: Opinions, before: Opinions | None, family: tuple[Ints, Ints] | None) -> Floats:
    """Return a stress that balances, any."""
    sides, size = new.sides, new.size
    if before is None or family is None:
        phi: Floats = np.zeros((len(new.cases), len(size), 16))
        if sides.load.any() or sides.body.any():
            phi[0] = without_plane(first_stress(new.mesh, sides, size))
        return phi
    phi = np.stack([handed_down(one, family, child_maps(True)) for one in before.phi])
    phi[0] += _of_body_forces(before, family[0], new)
    phi = without_plane(phi)
    if new.body.ends_within:
        new.phi = phi
        phi[0] += without_plane(_of_finer_loads(new, family[0]))
    return phi


def _of_body_forces(before: Opinions, parent: Ints, new: Opinions) -> Floats:
    """Return phi of the even stress that children have of a stress that grows within parents."""
    middles = [(one.leaves.lower + 0.5 * one.leaves.size[:, None]) for one in (before, new)]
    away = (middles[1] - middles[0][parent]) / new.body.cell
    even = -before.sides.body[parent] / before.size[parent, None] ** 2 * away
    # phi of stresses xx and yy of one, on the unit square: xx = phi_yy.
    phi = np.zeros((2, 16))
    for k, x in enumerate(CORNERS.T[::-1]):
        phi[k, 0:12:3], phi[k, 2 - k : 12 : 3] = 0.5 * x * x, x
    return np.asarray((even * new.size[:, None] ** 2) @ phi)


def _of_finer_loads(new: Opinions, parent: Ints) -> Floats:
    """Return phi of what children take of loads that end within sides, not their parents."""
    # On a parent's side force and couples of the rest are none.
    mesh, sides, rest = new.mesh, new.sides, np.zeros_like(new.sides.load)
    load = sides.load[mesh.owner, mesh.side] - new.on_border(0)
    rest[mesh.owner, mesh.side] = np.where(sides.given[:, None], load, 0.0)
    return stress_within(mesh, rest, new.size, parent)


def _of_stress_beside(generation: Opinions, acts: Sides) -> Floats:
    """Return what stress besides that of phi puts on phi, shape (n, 16)."""
    own = beside_phi(acts, generation.size)
    if own is None:
        return np.zeros((len(generation.size), 16))
    like, unlike, shear = (one[:, None] for one in compliance(generation.law))
    xx, yy, xy = np.moveaxis(own, -1, 0)
    strain = np.stack([like * xx + unlike * yy, unlike * xx + like * yy, shear * xy], axis=-1)
    return np.asarray(np.einsum("npk,pki,p->ni", strain, stresses(), rule()[1]))


def _of_beds(airy: Airy, generation: Opinions, case: int) -> Floats:
    """Return what beds put on phi by the tractions that they bear already."""
    mesh, beds, out = generation.mesh, generation.sides.beds, np.zeros(airy.size)
    if len(beds):
        force = generation.bed_tractions(case)
        length = generation.size[mesh.owner[beds]]
        ends = (force[:, [0]] + force[:, [1]] * np.array([-6.0, 6.0])) / length[:, None]
        mass = np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]])
        strain = (length / generation.sides.bed[beds])[:, None] * (ends @ mass)
        # A traction outwards is the normal stress on upper and on lower sides alike, but the force
        # on a lower side points to lower coordinates.
        sign = 2.0 * (mesh.side[beds] % 2) - 1.0
        out = -(airy.bed_rows(beds).T @ (sign[:, None] * strain).ravel())
    return np.asarray(out)


def _of_moved(airy: Airy, sides: Sides) -> Floats:
    """Return what moved supports put on phi: the work of the forces by its slopes at both ends."""
    out, rows = np.zeros(airy.size), np.flatnonzero(sides.moved.any(axis=1))
    back = np.where(backwards(airy.mesh.side[rows]), -1.0, 1.0)
    for end, sign in ((0, -1.0), (1, 1.0)):
        vertex = airy.seen(rows, end)
        np.add.at(out, 3 * vertex + 2, sign * back * sides.moved[rows, 0])
        np.add.at(out, 3 * vertex + 1, -sign * back * sides.moved[rows, 1])
    return out
