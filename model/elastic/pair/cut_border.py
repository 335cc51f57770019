"""Where bodies within outlines end: supports and loads there, and what of φ they make known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from kaju.arrays import Flags, Floats, Ints
from kaju.model.outline.posed_outlines import SIDES, OutlinedBody, UnlikeError
from kaju.model.outline.true_shapes import TINY, pieces_of

from .cut_mesh import THIRDS, CutMesh
from .sheets import Rim


@dataclass(frozen=True, eq=False)
class Border:
    """Edges beyond which there is no body, and what is known there."""

    owner: Ints  # triangle that each is a side of
    side_of: Ints  # which of its sides it is
    edge: Ints
    ends: Ints  # vertices, the body to the left, shape (n, 2)
    at: Floats  # where these are, shape (n, 2, 2)
    given: Floats  # forces of the tractions, shape (n, 2)
    tilted: Floats  # by how much more tractions are at the end than in the middle, as forces
    held: Flags  # components of the displacement, shape (n, 2)
    side: Ints  # number of the array's side, -1 on an outline
    outline: Ints  # region whose outline it lies on, -1 for none

    @property
    def run(self) -> Floats:
        """From end to end of each edge."""
        return self.at[:, 1] - self.at[:, 0]

    @property
    def outward(self) -> Floats:
        """Outward normals, times the lengths of edges."""
        return np.stack([self.run[:, 1], -self.run[:, 0]], axis=1)

    @classmethod
    def of(cls, mesh: CutMesh, body: OutlinedBody, along: list[Floats]) -> Border:
        """Return the border of a mesh under the loads and supports of a body."""
        owner, side_of = np.nonzero(mesh.beside[mesh.edge, 1] < 0)
        edge, ends = mesh.edge[owner, side_of], mesh.around[owner, side_of]
        at = mesh.place[ends]
        run = at[:, 1] - at[:, 0]
        length = np.hypot(*run.T)
        traction, tilt = np.zeros((2, len(edge), 2))
        held = np.zeros((len(edge), 2), dtype=np.bool_)
        side = np.full(len(edge), -1)
        for number, (name, (axis, upper)) in enumerate(SIDES.items()):
            on = (at[:, :, axis] == (body.shape[axis] if upper else 0.0)).all(axis=1)
            side[on] = number
            held[np.ix_(on, body.held.get(name, ()))] = True
            if name in body.sides:
                if not on.any():
                    raise UnlikeError(f"{name} has no body to be loaded")
                force, own, (slope, couple) = np.split(body.sides[name], [2, 4])
                traction[on] = own + force / length[on].sum()
                pull = _bent(at[on, :, 1 - axis], length[on], couple) * (1 if axis else -1)
                pull += slope * at[on, :, 1 - axis]
                traction[on, axis] += pull.mean(axis=1)
                tilt[on, axis] = 0.5 * (pull[:, 1] - pull[:, 0])
        outline = _outline_of(at, side < 0, along)
        outward = np.stack([run[:, 1], -run[:, 0]], axis=1) / length[:, None]
        for one in body.outlines:
            on = outline == one.region
            if one.facing is not None:
                on &= outward @ one.facing < -TINY
            traction[on] = outward[on] @ one.stress
        traction[held] = tilt[held] = 0.0
        given, tilted = traction * length[:, None], tilt * length[:, None]
        return cls(owner, side_of, edge, ends, at, given, tilted, held, side, outline)

    def rim(self, mesh: CutMesh, weight: Floats) -> Rim:
        """Return how φ and its slopes grow along the border."""
        # tractions that φ makes good: those asked for less those of what bears the weight
        load = self.given[:, None] + self.at * weight * self.outward[:, None]
        load += (np.array([-1.0, 1.0])[:, None, None] * self.tilted).swapaxes(0, 1)
        turn = np.stack([-load[..., 1], load[..., 0]], axis=2)
        slope, bulge = turn.mean(axis=1), (turn[:, 0] - turn[:, 1]) / 8.0
        rise = ((0.5 * slope + bulge * (2.0 / 3.0)) * self.run).sum(axis=1)
        across = (bulge * mesh.normal[self.edge]).sum(axis=1)
        growth = np.column_stack([rise, slope])
        return Rim(self.owner, THIRDS[self.side_of], self.edge, ~self.held, growth, across)

    def forces(self, mesh: CutMesh) -> Floats:
        """Return the work of the tractions on the unknowns of a displacement."""
        out = np.zeros((len(mesh.place) + len(mesh.ends), 2))
        for k in (0, 1):
            np.add.at(out, self.ends[:, k], 0.5 * self.given + (2 * k - 1) / 6.0 * self.tilted)
        out[len(mesh.place) + self.edge] += self.given * (2.0 / 3.0)
        return out


def _bent(at: Floats, length: Floats, couple: float) -> Floats:
    """Return the stresses of a couple at ends of edges, (n, 2), linear along a side."""
    middle = at.mean(axis=1)
    off = middle - (length * middle).sum() / length.sum()
    inertia = (length * (off**2 + length**2 / 12.0)).sum()
    return np.asarray(couple / inertia * (at - middle[:, None] + off[:, None]))


def _outline_of(at: Floats, inner: Flags, along: list[Floats]) -> Ints:
    """Return the region on whose outline edges lie, by the straight pieces of each; -1 for none."""
    outline = np.full(len(at), -1)
    for region, line in enumerate(along):
        outline[inner & (pieces_of(line, at)[0] >= 0)] = region
    # others lie along the sides of leaves, or stand for slivers that were left out
    on, rest = np.flatnonzero(outline >= 0), np.flatnonzero(inner & (outline < 0))
    if len(on) and len(rest):
        near = cKDTree(at[on].mean(axis=1)).query(at[rest].mean(axis=1))[1]
        outline[rest] = outline[on[near]]
    return outline
