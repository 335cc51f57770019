"""One generation of agents, each with its two opinions, and what they prove."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import by_law, is_rubber
from kaju.model.elastic.pair import displacement
from kaju.model.elastic.pair.airy import Airy, compliance, first_stress
from kaju.model.elastic.pair.border import Sides, check_held, sides_of, supports_of
from kaju.model.elastic.pair.elements import (
    CORNERS,
    EDGES,
    FIRST_PART,
    airy_stress,
    child_maps,
    edge_tractions,
    quadratic_values,
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
from kaju.model.elastic.pair.leaf_mesh import LeafMesh, mesh_of
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.levels import Blocks, FieldLevel, rise_of
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene.cell_types import INSIDE

DIRECT = 4_000
"""Up to so many unknowns factors are as quick as levels: measured on the plate, L and hole."""
DIRECT_RUBBER = 60_000
"""So many where a material is nearly incompressible, which levels do not smooth."""
INCOMPRESSIBLE = 20.0
"""C12 / mu from which on they do not: nu = 0.4875; measured on the rubber of the tests."""


@dataclass(frozen=True, eq=False)
class Opinions:
    """Agents with their two opinions; arrays over cases of load: loads, then moved supports."""

    body: PosedBody
    mesh: LeafMesh
    sides: Sides
    law: Floats  # C11, C12 and mu of the agents; shape (3, n)
    size: Floats  # Edges in cells
    fit: Floats  # Unknowns of the displacement of each agent; shape (cases, n, 16)
    phi: Floats  # Those of Airy's function, without its linear part
    levels: tuple[FieldLevel, FieldLevel]  # Equations of the displacement, and of phi
    duals: tuple[Opinions, ...] = ()
    """The same agents under the loads whose work is what goals ask for."""

    @property
    def leaves(self) -> LeafCells:
        """The agents."""
        return self.mesh.leaves

    @cached_property
    def cases(self) -> tuple[Sides, ...]:
        """What acts in each case."""
        return self.sides.cases

    @cached_property
    def tractions(self) -> Floats:
        """Forces that edges hand on to agents, and first moments; (n, 4, 2, 2), all cases."""
        phi = self.phi.sum(axis=0)
        out = np.einsum("ijkl,nl->nijk", edge_tractions(), phi) / self.size[:, None, None, None]
        for edge in range(4):
            normal = 1 if edge < 2 else 0
            out[:, edge, 0, normal] -= 0.5 * self.sides.body[:, normal]
        return np.asarray(out)

    @cached_property
    def _judged(self) -> tuple[Bounds, Floats]:
        """The bounds, and the gap of each agent."""
        cases, shares, total = [], np.zeros(len(self.size)), 0.0
        sums: list[Floats] = []
        for case, acts in enumerate(self.cases):
            loaded = not acts.moved.any()
            stress, fitting = self.fields(case)
            potential = 0.5 * float(energies(fitting, self.law, self.size).sum())
            complementary = 0.5 * float(energies(stress, self.law, self.size).sum())
            borne, given = self.tractions_of_beds(case)
            potential += 0.5 * float(self.on_beds(given, given).sum())
            complementary += 0.5 * float(self.on_beds(borne, borne).sum())
            apart = self.on_beds(borne - given, borne - given)
            if loaded:
                potential -= float(np.vdot(displacement.forces_of(acts), self.fit[case]))
            else:
                complementary -= self.work_of_supports(acts.moved, (case,))
            own = energies(stress - fitting, self.law, self.size)
            np.add.at(own, self.mesh.owner, apart)
            cases.append((potential, complementary, loaded, float(own.sum())))
            shares += own
            sums.append(stress - fitting)
        total = float(shares.sum())
        if len(sums) > 1:
            # The error of both together, should it be larger than that of each.
            both = energies(sums[0] + sums[1], self.law, self.size)
            shares = np.maximum(shares, both)
            total = float(shares.sum())
        locks = is_rubber(self.body.moduli, self.body.scene.plane)
        return bounds_of(cases, total, self.sides.rest, locks), shares

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

    def displacement_at(self, agent: Ints, inside: Floats) -> Floats:
        """Return the displacement at places from 0 to 1 in agents, shape (n, 2); scaled."""
        own = self.fit.sum(axis=0)[agent].reshape(-1, 8, 2)
        return np.asarray(np.einsum("nk,nkd->nd", quadratic_values(inside), own)) + self.sides.shift

    def stresses_at(self, agent: Ints, inside: Floats) -> tuple[Floats, Floats]:
        """Return xx, yy, xy of the stress that balances, and of the strain that fits; scaled."""
        size = self.size[agent, None]
        phi, fit = self.phi.sum(axis=0)[agent], self.fit.sum(axis=0)[agent]
        stress = np.einsum("nki,ni->nk", airy_stress(inside), phi) / size**2
        stress[:, :2] -= self.sides.body[agent] / size * (inside - 0.5)
        strain = np.einsum("nki,ni->nk", strain_rows(inside), fit) / size
        return np.asarray(stress), stress_of(strain, self.law[:, agent])

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body, of the stress that balances; scaled."""
        mesh, borne = self.mesh, ~self.sides.given
        own = self.tractions[mesh.owner, mesh.side, 0] - self.sides.load[mesh.owner, mesh.side, 0]
        own = own - self.sides.straight
        names = [*self.body.scene.lattice.sides, INSIDE]
        which = supports_of(mesh, self.body)
        found = {}
        for number in np.unique(which[borne.any(axis=1)]).tolist():
            here = which == number
            found[names[number]] = np.where(borne[here], own[here], 0.0).sum(axis=0)
        return found

    def _edge_forces(self, case: int) -> Floats:
        """Return forces and moments on the body at its border edges, shape (m, 2, 2)."""
        own = np.einsum(
            "mjkl,ml->mjk", edge_tractions()[self.mesh.side], self.phi[case, self.mesh.owner]
        )
        own = own / self.size[self.mesh.owner, None, None]
        normal = np.where(self.mesh.side < 2, 1, 0)
        rows = np.arange(len(own))
        own[rows, 0, normal] -= 0.5 * self.cases[case].body[self.mesh.owner, normal]
        return np.asarray(own)

    def work_of_supports(self, moved: Floats, cases: Sequence[int] | None = None) -> float:
        """Return the work of what supports bear on how they move, shape (m, 2)."""
        which = range(len(self.cases)) if cases is None else cases
        return sum(float(np.vdot(self._edge_forces(case)[:, 0], moved)) for case in which)

    def work_on(self, fit: Floats) -> float:
        """Return the work of the loads on a displacement of the agents, shape (n, 16)."""
        return float(np.vdot(displacement.forces_of(self.sides), fit))

    def bed_tractions(self, case: int) -> Floats:
        """Return force and moment (over the edge) that beds put on the body, shape (beds, 2)."""
        beds = np.flatnonzero(self.sides.bed > 0.0)
        normal = np.where(self.mesh.side[beds] < 2, 1, 0)
        load = self.cases[case].load[self.mesh.owner[beds], self.mesh.side[beds]]
        own = self._edge_forces(case)[beds] - load
        return np.asarray(own[np.arange(len(beds)), :, normal])

    def tractions_of_beds(self, case: int) -> Floats:
        """Return what beds put on the body by both opinions, at four points; (2, beds, 4)."""
        beds = np.flatnonzero(self.sides.bed > 0.0)
        owner, side = self.mesh.owner[beds], self.mesh.side[beds]
        normal = np.where(side < 2, 1, 0)
        nodes = np.column_stack([EDGES[side], 4 + side])
        u = self.fit[case].reshape(-1, 8, 2)[owner[:, None], nodes, normal[:, None]]
        at = 0.5 * np.polynomial.legendre.leggauss(4)[0]
        moved = u[:, [0]] * (0.5 - at) + u[:, [1]] * (0.5 + at) + u[:, [2]] * (1.0 - 4.0 * at**2)
        force = self.bed_tractions(case)
        traction = (force[:, [0]] + 12.0 * force[:, [1]] * at) / self.size[owner, None]
        return np.stack([traction, -self.sides.bed[beds, None] * moved])

    def on_beds(self, one: Floats, other: Floats) -> Floats:
        """Return the products of two tractions of beds (their energy), by border edge."""
        beds = np.flatnonzero(self.sides.bed > 0.0)
        out, weight = np.zeros(len(self.mesh.border)), 0.5 * np.polynomial.legendre.leggauss(4)[1]
        length = self.size[self.mesh.owner[beds]]
        out[beds] = length / self.sides.bed[beds] * ((one * other) @ weight)
        return out


Aim = Callable[[LeafMesh, Sides, Floats, Floats], Sides]
"""Gives, by the mesh, sides, sizes and law of a generation, the load whose work a goal is."""


def first(body: PosedBody, leaves: LeafCells, aims: Sequence[Aim] = ()) -> Opinions:
    """Return the first generation."""
    return _solved(body, leaves, None, aims)


def following(before: Opinions, leaves: LeafCells, aims: Sequence[Aim] = ()) -> Opinions:
    """Return a generation that corrects the one before, of which its agents are parts."""
    return _solved(before.body, leaves, before, aims)


def descent(old: LeafCells, new: LeafCells) -> tuple[Ints, Ints]:
    """Return the parent of each agent, and which part of it it is, as `child_maps` counts."""
    parent = np.searchsorted(old.code, new.code, "right") - 1
    ratio = old.size[parent] // new.size
    offset = (new.lower - old.lower[parent]) // new.size[:, None]
    step = np.log2(ratio).astype(np.int64)
    return parent, np.asarray(FIRST_PART[step] + offset[:, 1] * ratio + offset[:, 0])


def _solved(
    body: PosedBody, leaves: LeafCells, before: Opinions | None, aims: Sequence[Aim]
) -> Opinions:
    """Return a generation whose opinions are of least energy, but for what the gap allows."""
    mesh = mesh_of(leaves)
    sides = sides_of(body, mesh)
    size = leaves.size / body.cell
    law = np.stack([modulus[leaves.kind] for modulus in body.moduli])
    laws = by_law(law)
    if before is None:
        check_held(body, mesh, sides)
        family = None
    else:
        family = descent(before.leaves, leaves)
    # The body's own loads, then those of the goals: all have the same equations.
    olds = (before, *before.duals) if before else (None,) * (1 + len(aims))
    fields = [
        _begun(Opinions(body, mesh, own, law, size, *_NOTHING), old, family)
        for own, old in zip(
            [sides, *(aim(mesh, sides, size, law) for aim in aims)], olds, strict=True
        )
    ]
    gaps = [np.inf if old is None else 0.5 * float(old.shares.sum()) for old in olds]
    rubber = bool(np.any(law[1] > INCOMPRESSIBLE * law[2]))
    direct = DIRECT_RUBBER if rubber else DIRECT

    blocks = displacement.blocks_of(mesh, sides, laws, law, body.cell)
    free = displacement.way_of(mesh, sides)
    fits = _level(blocks, free, before.levels[0] if before else None, family, False, direct)
    for own, gap in zip(fields, gaps, strict=True):
        for case, acts in enumerate(own.cases):
            wanted = 0.0 if acts.moved.any() else displacement.forces_of(acts)
            rest = blocks.gather(wanted - blocks.times(own.fit[case]))
            if blocks.extra is not None:
                rest -= blocks.extra @ blocks.shared(own.fit[case])
            own.fit[case] += blocks.own(fits.solve(rest, gap))

    airy = Airy(mesh, sides, body.cell)
    blocks = airy.blocks(laws, size)
    balances = _level(
        blocks, airy.way(), before.levels[1] if before else None, family, True, direct
    )
    for own, gap in zip(fields, gaps, strict=True):
        for case, acts in enumerate(own.cases):
            rest = -blocks.gather(blocks.times(own.phi[case]) + _of_stress_beside(own, acts))
            rest += _of_supports(airy, own, case)
            if acts.moved.any():
                rest += _of_moved(airy, acts)
            own.phi[case] += without_plane(blocks.own(balances.solve(rest, gap)))
    own, *duals = (replace(own, levels=(fits, balances)) for own in fields)
    return replace(own, duals=tuple(duals))


_NOTHING: Any = np.zeros((0, 0, 16)), np.zeros((0, 0, 16)), ()
"""Fields and levels of a generation that has not begun."""


def _begun(new: Opinions, before: Opinions | None, family: tuple[Ints, Ints] | None) -> Opinions:
    """Return a generation with a displacement that fits and a stress that balances, any."""
    mesh, sides, size = new.mesh, new.sides, new.size
    if before is None or family is None:
        fit, phi = np.zeros((2, len(sides.cases), len(size), 16))
        if sides.moved.any():
            fit[-1] = displacement.moved_by(mesh, sides)
        if sides.load.any() or sides.body.any():
            phi[0] = without_plane(first_stress(mesh, sides, size))
        return replace(new, fit=fit, phi=phi)
    parent, part = family
    fit = np.stack([_handed_down(one, parent, part, False) for one in before.fit])
    phi = np.stack([_handed_down(one, parent, part, True) for one in before.phi])
    phi[0] += _of_body_forces(before, parent, new.leaves)
    phi = without_plane(phi)
    if new.body.ends_within:
        phi[0] += _of_finer_loads(before, mesh, sides, parent, phi[0], size)
    return replace(new, fit=fit, phi=phi)


def _handed_down(own: Floats, parent: Ints, part: Ints, balances: bool) -> Floats:
    """Return the parts of what an agent holds that its children begin with."""
    out = own[parent]
    some = np.flatnonzero(part)
    out[some] = np.einsum("nij,nj->ni", child_maps(balances)[part[some]], out[some])
    return out


def _level(
    blocks: Blocks,
    free: tuple[sp.csr_array, Ints],
    before: FieldLevel | None,
    family: tuple[Ints, Ints] | None,
    balances: bool,
    direct: int,
) -> FieldLevel:
    """Return the equations of a generation for its free unknowns."""
    way, unknown = free
    if before is None or family is None or way.shape[1] <= direct:
        return FieldLevel(blocks, way, before, None, direct)
    parent, part = family
    rise = rise_of(blocks, unknown, before.blocks, parent, child_maps(balances)[part])
    return FieldLevel(blocks, way, before, rise, direct)


def _of_body_forces(before: Opinions, parent: Ints, leaves: LeafCells) -> Floats:
    """Return phi of the even stress that children have of a stress that grows within parents."""
    if not before.sides.body.any():
        return np.zeros((len(parent), 16))
    size = leaves.size / before.body.cell
    middle = (leaves.lower + 0.5 * leaves.size[:, None]) / before.body.cell
    old = before.leaves
    away = middle - ((old.lower + 0.5 * old.size[:, None]) / before.body.cell)[parent]
    even = -before.sides.body[parent] / before.size[parent, None] ** 2 * away
    return np.asarray(np.einsum("nk,ki->ni", even * size[:, None] ** 2, _EVEN))


def _even() -> Floats:
    """Return phi of stresses xx and yy of one, on the unit square."""
    out = np.zeros((2, 16))
    for corner, place in enumerate(CORNERS):
        for k, x in enumerate(place[::-1]):  # xx = phi_yy
            out[k, 3 * corner] = 0.5 * x * x
            out[k, 3 * corner + 2 - k] = x
    return out


_EVEN = _even()


def _of_finer_loads(
    before: Opinions, mesh: LeafMesh, sides: Sides, parent: Ints, phi: Floats, size: Floats
) -> Floats:
    """Return phi of what children take of loads that end within sides, not their parents."""
    # On a parent's side force and couples of the rest are none: only vertices within it move.
    own = np.einsum("mjkl,ml->mjk", edge_tractions()[mesh.side], phi[mesh.owner])
    own /= size[mesh.owner, None, None]
    normal = np.where(mesh.side < 2, 1, 0)
    rows = np.arange(len(own))
    own[rows, 0, normal] -= 0.5 * sides.body[mesh.owner, normal]
    rest = np.where(sides.given[:, None], sides.load[mesh.owner, mesh.side] - own, 0.0)
    uneven = before.sides.load[parent[mesh.owner], mesh.side, 1].any(axis=1)
    uneven |= np.abs(rest).max(axis=(1, 2)) > 1e-9 * np.abs(sides.load).max(initial=1e-300)
    halved = before.size[parent[mesh.owner]] > size[mesh.owner]
    own_rows = np.flatnonzero(uneven & halved & sides.given.all(axis=1))
    out = np.zeros_like(phi)
    if not len(own_rows):
        return out
    # Side by side of parents, in the order along them.
    start = mesh.ends[mesh.border[own_rows], 0]
    along = np.where(mesh.side[own_rows] < 2, 0, 1)
    place = mesh.place[start, along]
    group = parent[mesh.owner[own_rows]] * 4 + mesh.side[own_rows]
    order = np.lexsort((place, group))
    own_rows, group = own_rows[order], group[order]
    opening = np.flatnonzero(np.diff(group, prepend=-1))
    # Walking with rising coordinates the body is on the left of lower edges along x, and of
    # right ones along y; on the others tractions change sign.
    side = mesh.side[own_rows]
    sign = np.where(np.isin(side, (0, 3)), 1.0, -1.0)
    force, moment = (sign[:, None] * rest[own_rows, k] for k in (0, 1))
    length = size[mesh.owner[own_rows]]
    axis = np.where(side < 2, 0, 1)
    flow = np.column_stack([-force[:, 1], force[:, 0]])  # growth of phi_x, phi_y
    twist = np.column_stack([-moment[:, 1], moment[:, 0]])

    def before_each(growth: Floats) -> Floats:
        total = np.cumsum(growth, axis=0) - growth
        return total - np.repeat(total[opening], np.diff([*opening, len(growth)]), axis=0)

    slope = before_each(flow)
    rows = np.arange(len(side))
    # phi grows by the mean slope: that at the start, half the flow, less the couple.
    rise = length * (slope[rows, axis] + 0.5 * flow[rows, axis] - twist[rows, axis])
    value = before_each(rise[:, None])[:, 0]
    last = np.concatenate([opening[1:], [len(side)]]) - 1
    for end in (0, 1):
        at = slope + end * flow
        height = value + end * rise
        outer = opening if end == 0 else last
        at[outer], height[outer] = 0.0, 0.0
        corner = EDGES[side, end]
        owner = mesh.owner[own_rows]
        np.add.at(out, (owner, 3 * corner), height)
        for k in (0, 1):
            np.add.at(out, (owner, 3 * corner + 1 + k), at[:, k] * length)
    across = 1 - axis
    # A parabola of the slope across: its middle is off the mean of its ends by 3/2 of the couple.
    np.add.at(out, (mesh.owner[own_rows], 12 + side), -1.5 * twist[rows, across] * length)
    # The neighbours at the vertices between are agents of the same side, and have them as well.
    return out


def _of_stress_beside(generation: Opinions, acts: Sides) -> Floats:
    """Return what stress besides that of phi puts on phi, shape (n, 16)."""
    own = beside_phi(acts, generation.size)
    if own is None:
        return np.zeros((len(generation.size), 16))
    like, unlike, shear = (one[:, None] for one in compliance(generation.law))
    xx, yy, xy = np.moveaxis(own, -1, 0)
    strain = np.stack([like * xx + unlike * yy, unlike * xx + like * yy, shear * xy], axis=-1)
    return np.asarray(np.einsum("npk,pki,p->ni", strain, stresses(), rule()[1]))


def _of_supports(airy: Airy, generation: Opinions, case: int) -> Floats:
    """Return what beds put on phi by the tractions that they bear already."""
    beds = np.flatnonzero(airy.sides.bed > 0.0)
    out = np.zeros(airy.size)
    if len(beds):
        force = generation.bed_tractions(case)
        length = generation.size[airy.mesh.owner[beds]]
        ends = (force[:, [0]] + force[:, [1]] * np.array([-6.0, 6.0])) / length[:, None]
        mass = np.array([[1 / 3, 1 / 6], [1 / 6, 1 / 3]])
        strain = (length / airy.sides.bed[beds])[:, None] * (ends @ mass)
        # A traction outwards is the normal stress on upper and on lower sides alike, but the force
        # on a lower side points to lower coordinates.
        sign = np.where(np.isin(airy.mesh.side[beds], (0, 2)), -1.0, 1.0)
        out = -(airy.bed_rows(beds).T @ (sign[:, None] * strain).ravel())
    return np.asarray(out)


def _of_moved(airy: Airy, sides: Sides) -> Floats:
    """Return what moved supports put on phi: the work of the forces by its slopes at both ends."""
    out = np.zeros(airy.size)
    rows = np.arange(len(sides.moved))
    back = np.where(np.isin(airy.mesh.side, (1, 2)), -1.0, 1.0)
    for end, sign in ((0, -1.0), (1, 1.0)):
        vertex = airy._seen(rows, end)
        np.add.at(out, 3 * vertex + 2, sign * back * sides.moved[:, 0])
        np.add.at(out, 3 * vertex + 1, -sign * back * sides.moved[:, 1])
    return out
