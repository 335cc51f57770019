"""Both opinions of agents in the plane, and what they prove."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.named_supports import support_names
from kaju.model.results.cuts import resultants

from . import elements
from .airy import bed_rows, first_stress, of_tractions
from .displacement import Fitting
from .elements import airy_stress, edge_tractions, on_sides, strains, stresses, without_plane
from .gap import Bounds, at_points, bounds_of, roots_of, stress_of, tensors
from .leaves import PlaneMesh
from .levels import FieldLevel, by_laws


@dataclass(eq=False)
class Opinions(Fitting):
    """Agents with their two opinions."""

    mesh: PlaneMesh
    phi: Floats = field(init=False)
    """Unknowns of Airy's function, without its linear part; shape (n, 16)."""

    def on_border(self) -> Floats:
        """Return forces and first moments on the body at the sides of its border, (m, 2, 2)."""
        owner, side = self.mesh.owner, self.mesh.side
        out = np.einsum("nijl,nl->nij", edge_tractions()[side], self.phi[owner])
        out /= self.size[owner, None, None]
        row = np.arange(len(side))
        out[row, 0, side // 2] -= 0.5 * self.sides.body[owner, side // 2]
        return np.asarray(out)

    @cached_property
    def soft_roots(self) -> list[tuple[Ints | slice, Floats]]:
        """The agents of each law, and a root of their complementary energy by `stresses`."""
        return [
            (agents, at_points(roots_of(law, 2)[1], stresses(), 2)) for agents, law in self.laws
        ]

    def stress_field(self) -> Floats:
        """Return the stress that balances, scaled so that squares add up to twice the energy."""
        size = self.size[:, None]
        own = np.concatenate([self.phi / size, self.sides.even, self.sides.body], axis=1)
        return by_laws(self.soft_roots, own)

    def fields(self) -> tuple[Floats, Floats]:
        """Return both opinions as vectors whose products are energies: of agents, then of beds."""
        balanced, fitted, beds = self.stress_field(), by_laws(self.roots, self.fit), self.on_beds()
        return np.append(balanced, beds[0]), np.append(fitted, beds[1])

    def by_agent(self, products: Floats, with_beds: bool = True) -> Floats:
        """Return sums over each agent, and the beds it lies on, of products of fields."""
        own, beds = np.split(products, [len(products) - 4 * len(self.sides.beds)])
        out: Floats = own.reshape(len(self.size), -1).sum(axis=1)
        if with_beds:
            np.add.at(out, self.mesh.owner[self.sides.beds], beds.reshape(-1, 4).sum(axis=1))
        return out

    @cached_property
    def energies(self) -> Floats:
        """Energy stored in each agent: half-way between those of both opinions."""
        balanced, fitted = self.fields()
        return self.by_agent(0.25 * (balanced**2 + fitted**2), with_beds=False)

    @cached_property
    def _judged(self) -> tuple[Bounds, Floats]:
        """The bounds, and the gap of each agent."""
        told, apart = [], []
        for case in self.cases:
            balanced, fitted = case.fields()
            apart.append(balanced - fitted)
            balances, fits, gap = (float(one @ one) for one in (balanced, fitted, apart[-1]))
            # The energy is the least potential one if supports move; if loads act, minus that.
            lower, upper = 2.0 * case.work_on(case.fit) - fits, balances
            if case.sides.moved.any():
                lower, upper = 2.0 * case.borne(case.sides.moved) - balances, fits
            told.append((0.5 * lower, 0.5 * upper, gap))
        shares = np.sum([self.by_agent(one**2) for one in apart], axis=0)
        if self.parts:
            # The error of both together, should it be larger than that of each.
            shares = np.maximum(shares, self.by_agent(np.sum(apart, axis=0) ** 2))
        return bounds_of(np.transpose(told), float(shares.sum()), self.sides.rest), shares

    bounds = property(lambda told: told._judged[0], doc="What the two opinions prove.")
    shares = property(lambda told: told._judged[1], doc="The gap of each agent.")

    def stresses_at(self, agent: Ints, inside: Floats) -> tuple[Floats, Floats]:
        """Return tensors of the stress that balances and of the strain that fits; scaled."""
        size = self.size[agent, None]
        stress = np.einsum("nki,ni->nk", airy_stress(inside), self.phi[agent]) / size**2
        stress[:, :2] -= self.sides.body[agent] / size * (inside - 0.5)
        strain = np.einsum("nki,ni->nk", elements.strain_rows(inside), self.fit[agent]) / size
        return tensors(stress), tensors(stress_of(strain, self.law[:, agent]))

    @cached_property
    def means(self) -> tuple[Floats, Floats]:
        """Mean tensors over agents: of the stress that balances, of the strain that fits."""
        weights, size = elements.rule(2)[1], self.size[:, None]
        balanced = self.phi @ np.einsum("p,pki->ik", weights, stresses()[..., :16]) / size**2
        strain = self.fit @ np.einsum("p,pki->ik", weights, strains(2)) / size
        return tensors(balanced), tensors(stress_of(strain, self.law))

    def reactions(self) -> dict[str, Floats]:
        """Return what supports bear of the stress that balances, as `resultants`; scaled."""
        mesh, sides = self.mesh, self.sides
        own = self.on_border() - sides.load[mesh.owner, mesh.side]
        own[:, 0] -= sides.straight
        side, axis = np.nonzero(~sides.given)
        # forces at both ends of a side that are as its traction, which is linear
        even, tilt = 0.5 * own[side, 0, axis], own[side, 1, axis]
        at = mesh.place[mesh.on_border[side, :2]].swapaxes(0, 1) / self.body.cell
        rows = np.tile(sides.support[side], 2), at.reshape(-1, 2), np.tile(axis, 2)
        names, force = support_names(self.body.scene), np.append(even - tilt, even + tilt)
        return resultants(names, *rows, force)

    def borne(self, moved: Floats) -> float:
        """Return the work of what supports bear on how they move, shape (m, 2)."""
        return float(np.vdot(self.on_border()[:, 0], moved))

    def on_beds(self) -> Floats:
        """Return what beds bear by both opinions at four points, scaled; shape (2, beds, 4)."""
        mesh, beds, stiffness = self.mesh, self.sides.beds, self.sides.bed[self.sides.beds, None]
        owner, side = mesh.owner[beds], mesh.side[beds]
        points, weight = elements.gauss(4, 1)
        length, line = self.size[owner, None], points.ravel() - 0.5
        u = self.fit.reshape(-1, 8, 2)[owner[:, None], on_sides(2)[side], side[:, None] // 2]
        fitted = -stiffness * (u @ elements.quadratic_values(points).T)
        own = self.on_border() - self.sides.load[mesh.owner, mesh.side]
        force, moment = np.moveaxis(own[beds, :, side // 2], 1, 0)[..., None]
        balanced = (force + 12.0 * moment * line) / length
        scale = np.sqrt(length * weight / stiffness)
        return np.asarray(scale * np.stack([balanced, fitted]))

    def balances(
        self, level: FieldLevel, begun: Floats, gap: float, before: Opinions | None, parent: Ints
    ) -> None:
        """Find the stress that balances of least energy, but for what a gap allows."""
        mesh, sides, load, body = self.mesh, self.sides, self.sides.load, self.sides.body
        self.phi = without_plane(begun)
        if before is not None:
            self.phi += self._of_body_forces(before, parent)
            # What children take of loads that end within sides, and their parents did not.
            body, load, own = np.zeros_like(body), np.zeros_like(load), load[mesh.owner, mesh.side]
            if len(before.sides.ragged):
                more = np.where(sides.given[:, None], own - self.on_border(), 0.0)
                load[mesh.owner, mesh.side] = more
        if load.any() or body.any():
            self.phi += first_stress(mesh, sides, load, body, self.size)
        self.phi += level.blocks.own(level.solve(-level.blocks.gather(self._pull()), gap))

    def _of_body_forces(self, before: Opinions, parent: Ints) -> Floats:
        """Return phi of the even stress of children where one grows within their parents."""
        away = (self.leaves.middle - before.leaves.middle[parent]) / self.body.cell
        even = -before.sides.body[parent] / before.size[parent, None] ** 2 * away
        side, traction = np.arange(4), np.zeros((len(parent), 4, 2, 2))
        push = even[:, side // 2] * self.size[:, None]
        traction[:, side, 0, side // 2] = np.where(side % 2, push, -push)
        return of_tractions(traction, self.size)

    def _pull(self) -> Floats:
        """Return the slopes of the complementary energy by phi of agents, shape (n, 16)."""
        mesh, sides, size = self.mesh, self.sides, self.size
        back = [(agents, root[:, :16].T) for agents, root in self.soft_roots]
        out = by_laws(back, self.stress_field())
        # Supports that move take the work of their forces.
        force = np.einsum("nj,njl->nl", sides.moved, edge_tractions()[mesh.side, 0])
        np.subtract.at(out, mesh.owner, force)
        out /= size[:, None]
        rows = bed_rows(mesh, sides, size)
        np.add.at(out, mesh.owner[sides.beds], np.einsum("bp,bpi->bi", self.on_beds()[0], rows))
        return out
