"""The opinion that balances: a stress that hands on exactly what arrives.

First agents, as rigid blocks, hand on forces and couples by their edges: the least squares of
the tractions that balance all loads. Airy's function then makes of this stress the one of least
complementary energy: read `sheets` on its border.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from kaju.arrays import Flags, Floats, Ints
from kaju.factors import factors_of

from . import elements
from .border import Sides, grips
from .elements import CORNERS, EDGES, edge_tractions, gauss, on_sides, without_plane
from .leaves import Entries, PlaneMesh, followed
from .levels import Blocks, summed
from .sheets import Rim, Sheets


class Airy(Sheets):
    """Unknowns of phi of squares."""

    def __init__(self, mesh: PlaneMesh, sides: Sides, cell: int) -> None:
        self.mesh, self.sides, self.cell = mesh, sides, cell
        # With the square on the left one goes back along the axis on its left and upper sides.
        ends, none = on_sides(2)[mesh.side, :2], np.zeros((len(mesh.side), 3))
        ends = np.where(np.isin(mesh.side, (0, 3))[:, None], ends[:, ::-1], ends)
        pin = none[:, 1:] + np.nan
        rim = Rim(mesh.owner, ends, mesh.border, sides.given, none, none[:, 0], pin)
        super().__init__(mesh.place / cell, mesh.corner, len(mesh.ends), mesh.part, rim)
        corner = (3 * self.corner[:, :, None] + np.arange(3)).reshape(-1, 12)
        self.dof = np.concatenate([corner, 3 * self.points + mesh.edge], axis=1)
        self.h = mesh.leaves.size / cell
        self.scale = self.h[:, None] ** ([0.0, 1.0, 1.0] * 4 + [1.0] * 4)

    def start_of(self, hole: Flags) -> tuple[float, float]:
        """Return a place from which a cut begins, the same in every generation."""
        ends, unit = self.ends[:, hole], 1.0 / self.cell
        right = ends[..., 0].max()
        height = ends[:, (ends[..., 0] == right).all(axis=0), 1].min()
        return right - 0.5 * unit, height + 0.5 * unit

    def on_cut(self, x: float, y: float) -> Flags:
        """Tell which agents descend from first ones that a cut crosses."""
        # So the functions of a generation are among those of the next one.
        first = self.mesh.first[:, None]
        low = self.mesh.leaves.lower // first * first
        on = (low < [np.inf, y * self.cell]) & (low + first > np.array([x, y]) * self.cell)
        return np.asarray(on.all(axis=1))

    def blocks(self, roots: list[tuple[Ints | slice, Floats]]) -> Blocks:
        """Return the compliance of the agents and of the beds."""
        matrices = [(agents, root[:, :16].T @ root[:, :16]) for agents, root in roots]
        beds, rows = None, bed_rows(self.mesh, self.sides, self.h)
        if len(rows):
            owner = self.mesh.owner[self.sides.beds]
            rows = rows * self.scale[owner, None]
            every = sp.eye_array(self.size, format="csr")
            beds = summed(rows.swapaxes(1, 2) @ rows, self.dof[owner], every)
        return Blocks(self.dof, matrices, self.h**-2.0, self.scale, self.size, beds, without_plane)

    def hanging(self) -> Entries:
        """Let the middles of whole edges, and the bulges of their halves, follow these."""
        mesh, whole, half = self.mesh, self.mesh.whole, self.mesh.halves[0]
        at = np.zeros(len(mesh.ends), dtype=np.int64)
        at[mesh.edge.ravel()] = np.arange(mesh.edge.size)
        agent, number = np.divmod(at, 4)
        # They are as in the two parts of the agent of the whole edge that lie along this: the
        # middle is a corner of the first. Slopes of parts count in half its edge.
        (first, last), maps = EDGES.T, elements.child_maps(True)
        part = 1 + CORNERS.astype(np.int64) @ [1, 2]
        rows = [maps[part[first], 3 * last + k] for k in range(3)]
        rows += [maps[part[end], 12 + np.arange(4)] for end in (first, last)]
        own = agent[whole]
        shrunk = (0.5 * self.h[own, None]) ** [0.0, 1.0, 1.0, 1.0, 1.0]
        values = np.stack(rows, axis=1)[number[whole]] * self.scale[own, None] / shrunk[:, :, None]
        follows = [*(3 * mesh.middle + np.arange(3)[:, None]), *(3 * self.points + mesh.halves)]
        row, k, column = np.nonzero(values)
        entry = np.array(follows)[k, row], self.dof[own[row], column], values[row, k, column]
        # Between that agent and the one of a half the sheet changes by as much in the middle as at
        # the end of both.
        sheet = self.beyond[self.corner[agent[:, None], EDGES[number]]]
        return [entry, *self.jumps(mesh.middle, sheet[half, 0] - sheet[half, 1] - sheet[whole, 0])]


def bed_rows(mesh: PlaneMesh, sides: Sides, size: Floats) -> Floats:
    """Return a root of the energy of beds, at four points each, by phi of agents: (beds, 4, 16)."""
    owner, side = mesh.owner[sides.beds], mesh.side[sides.beds]
    points, weight = gauss(4, 1)
    force, moment = np.moveaxis(edge_tractions()[side, :, side // 2], 1, 0)[:, :, None]
    root = np.sqrt(weight / (size[owner] ** 3 * sides.bed[sides.beds])[:, None])
    return np.asarray(root[..., None] * (force + 12.0 * (points - 0.5) * moment))


def first_stress(mesh: PlaneMesh, sides: Sides, load: Floats, body: Floats, size: Floats) -> Floats:
    """Return phi of each agent, (n, 16), of a stress that balances loads of agents."""
    # Agents are rigid blocks: `works` are the works of tractions of their sides, forces and first
    # moments, on their motions. `hands` are such tractions of what edges hand on: a force, and the
    # first moment of its component across.
    side, axis, sign = np.arange(4), np.arange(4) // 2, np.array([-1.0, 1.0, -1.0, 1.0])
    works, hands = np.zeros((3, 4, 2, 2)), np.zeros((4, 3, 2, 2))
    works[0, :, 0, 0] = works[1, :, 0, 1] = 1.0
    works[2, side, 0, 1 - axis] = 0.5 * sign * [1.0, 1.0, -1.0, -1.0]
    works[2, side, 1, axis] = [-1.0, -1.0, 1.0, 1.0]
    hands[:, 0, 0, 0] = hands[:, 1, 0, 1] = hands[side, 2, 1, axis] = sign
    # A row of `matrix` is a force on an agent, or its couple over its edge.
    n, number = len(mesh.leaves), np.arange(3 * len(mesh.ends)).reshape(-1, 3)
    own = mesh.edge[:, elements.EDGE_OF_SIDE]
    row, column = np.arange(3 * n).reshape(n, 3, 1, 1), number[own][:, None]
    share = np.einsum("rsij,seij->rse", works, hands)
    at, values = np.broadcast_arrays(row, column, share)[:2], np.broadcast_to(share, (n, 3, 4, 3))
    matrix = sp.csr_array((values.ravel(), tuple(x.ravel() for x in at)), (3 * n, number.size))
    # Unknown is what edges hand on but where the traction is given; halves follow the whole edge.
    free = np.ones((len(mesh.ends), 3), dtype=np.bool_)
    free[mesh.border, :2] = ~sides.given
    free[mesh.border, 2] = ~sides.given[np.arange(len(mesh.border)), mesh.side // 2]
    start, end = mesh.place[mesh.ends[mesh.whole].T]
    whole, across, follow = number[mesh.whole], np.where(end > start, 1, 0)[:, 0], Entries()
    for half, lean in zip(mesh.halves, (-1.5, 1.5), strict=True):
        follow += [(number[half, k], whole[:, k], (0.5, 0.5, 0.25)[k]) for k in range(3)]
        follow.append((number[half, across], whole[:, 2], lean))
    every, follows = followed(follow, number.size)
    chosen = np.flatnonzero(free.ravel() & ~follows)
    # The least squares, in which first moments weigh as tractions of the same size.
    weight = np.tile([1.0, 1.0, 1.0 / 12.0], len(mesh.ends))[chosen]
    balance = sp.csr_array(matrix @ every[:, chosen])
    wanted = np.einsum("rsij,nsij->nr", works, -load)
    wanted[:, :2] -= body
    # What no load pushes a part to do along its bed needs no edge to be stopped.
    _, along, agent = grips(mesh, sides)
    stays = sp.diags_array(np.isin(np.arange(3 * n), 3 * agent + along).astype(np.float64))
    normal = sp.csc_array(balance @ sp.diags_array(weight) @ balance.T + stays)
    factors = factors_of(normal)
    found = factors.solve(wanted.ravel())
    found = found + factors.solve(wanted.ravel() - normal @ found)
    flow = (every[:, chosen] @ (weight * (balance.T @ found))).reshape(-1, 3)
    traction = load + np.einsum("nse,seij->nsij", flow[own], hands)
    # A body force is met by a stress that grows along each axis: half of it at either end.
    traction[:, side, 0, axis] += 0.5 * body[:, axis]
    return of_tractions(traction, size)


def of_tractions(traction: Floats, size: Floats) -> Floats:
    """Return phi of agents by forces and first moments on their sides that balance."""
    phi = np.einsum("ijkl,njkl->ni", elements.airy_of_tractions(), traction)
    return without_plane(size[:, None] * phi)
