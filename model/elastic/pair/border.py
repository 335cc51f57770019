"""What holds and loads a plane body, side by side of its agents: the data of both opinions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SupportError
from kaju.model.elastic.free_motion import free_motion, unheld
from kaju.model.elastic.moduli import moduli_at
from kaju.model.elastic.pair.elements import EDGE_OF_SIDE, SIDE_OF_EDGE
from kaju.model.elastic.pair.leaf_mesh import LeafMesh
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.uneven_loads import data_error, softest
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER


@dataclass(frozen=True, eq=False)
class Sides:
    """Supports of border edges, and loads of agents; scaled, lengths in cells."""

    held: Flags  # Whether each component is held on a border edge; shape (m, 2)
    given: Flags  # Whether the traction is given: neither held nor borne by a bed; shape (m, 2)
    moved: Floats  # How far it is moved where it is held, less `shift`; shape (m, 2)
    shift: Floats  # Movement that all supports have in common; shape (2,)
    bed: Floats  # Stiffness per area of the bed across it, 0 without; shape (m,)
    # By agent, edge, force or first moment about the edge's middle (over its length), axis
    load: Floats  # Shape (n, 4, 2, 2)
    straight: Floats  # Loads on held components, which are the support's at once; shape (m, 2)
    body: Floats  # Forces within agents; shape (n, 2)
    # Work of the loads on an even strain of each agent (xx, yy, twice xy), over its edge: that of
    # a stress times the edge. Shape (n, 3)
    even: Floats
    rest: float  # Energy norm of what the agents do not take of loads that end within sides
    ragged: Ints  # The agents with such loads

    @property
    def cases(self) -> tuple[Sides, ...]:
        """What is solved for by itself: the loads, and the supports that move."""
        if not (self.loaded and self.moved.any()):
            return (self,)
        still = replace(self, moved=np.zeros_like(self.moved))
        arrays = {name: np.zeros_like(getattr(self, name)) for name in ("load", "body", "even")}
        return still, replace(self, **arrays)

    @property
    def loaded(self) -> bool:
        """Whether forces act."""
        return bool(self.load.any() or self.body.any() or self.even.any())


def sides_of(body: PosedBody, mesh: LeafMesh) -> Sides:
    """Return supports and loads of a body."""
    leaves, n, m = mesh.leaves, len(mesh.leaves), len(mesh.border)
    normal = np.where(mesh.side < 2, 1, 0)
    across = np.arange(2) == normal[:, None]
    # The unit cell beyond the middle of each edge says what is there.
    beyond = (mesh.place[mesh.ends[mesh.border]].sum(axis=1) // 2).astype(np.int64)
    beyond[np.arange(m), normal] -= mesh.side % 2 == 0
    kind = body.kinds_at(beyond)
    outer = ((beyond < 0) | (beyond >= body.extent)).any(axis=1)
    held = np.isin(kind, (RIGID, DISPLACED))[:, None] | ((kind == ROLLER)[:, None] & across)
    moved, bed = np.zeros((m, 2)), np.zeros(m)
    for side in range(4):
        here = outer & (SIDE_OF_EDGE[mesh.side] == side)
        some = here & np.isin(kind, (DISPLACED, ROLLER))
        moved[some] = body.given(side)
        bed[here & (kind == FOUNDATION)] = body.foundation(side)
    moved[~held] = 0.0
    shift = _common_shift(moved, held, bed)
    moved = np.where(held, moved - shift, 0.0)
    given = ~held & ~((bed > 0.0)[:, None] & across)
    load, inside = np.zeros((n, 4, 2, 2)), np.zeros((n, 2))
    forces = body.forces(leaves)
    within = forces.direction < 0
    np.add.at(inside, forces.leaf[within], forces.force[within])
    edge = EDGE_OF_SIDE[forces.direction[~within]]
    np.add.at(load[:, :, 0], (forces.leaf[~within], edge), forces.force[~within])
    rest, ragged = 0.0, np.zeros(0, dtype=np.int64)
    if forces.uneven is not None and len(forces.uneven.box):
        uneven, size = forces.uneven, leaves.size / body.cell
        ragged = np.unique(uneven.box[uneven.rest > 0.0])
        along = np.where(uneven.side < 2, 1, 0)
        moment = uneven.moment[np.arange(len(along)), :, along] / size[uneven.box, None]
        np.add.at(load[:, :, 1], (uneven.box, EDGE_OF_SIDE[uneven.side]), moment)
        law = moduli_at(body.moduli, leaves.kind)
        rest = data_error(uneven, size, softest(law.stretch, law.lateral, law.shear, 2))
    own = load[mesh.owner, mesh.side]
    straight = np.where(held, own[:, 0], 0.0)
    load[mesh.owner, mesh.side] = np.where(held[:, None], 0.0, own)
    even = np.zeros((n, 3))
    return Sides(held, given, moved, shift, bed, load, straight, inside, even, rest, ragged)


def _common_shift(moved: Floats, held: Flags, bed: Floats) -> Floats:
    """Return the movement that all supports have in common: it strains nothing."""
    # Of bodies that move by much more than they stretch rounding would leave no strains.
    shift = np.zeros(2)
    for axis in range(2):
        values = moved[held[:, axis], axis]
        if len(values) and values.min() * values.max() > 0.0 and not bed.any():
            shift[axis] = min(values.min(), values.max(), key=abs)
    return shift


def check_held(body: PosedBody, mesh: LeafMesh, sides: Sides) -> None:
    """Refuse a body of which a part could move without straining, or whose supports tear it."""
    part = mesh.parts()
    resisted = ~sides.given
    ends = mesh.ends[mesh.border]
    place = mesh.place[ends] / body.cell
    rows = np.zeros((*resisted.shape, 2, 3))  # edge, component, end, motion
    rows[:, 0, :, 0] = rows[:, 1, :, 1] = 1.0
    for number in range(int(part.max()) + 1):
        own = part[mesh.owner] == number
        middle = place[own].mean(axis=(0, 1))
        rows[own, 0, :, 2] = middle[1] - place[own][..., 1]
        rows[own, 1, :, 2] = place[own][..., 0] - middle[0]
        stops = rows[own][resisted[own]].reshape(-1, 3)
        motion = free_motion(stops, 2)
        if motion:
            cell = mesh.leaves.lower[np.flatnonzero(part == number)[0]] // body.cell
            raise unheld(cell, motion, touched=len(stops) > 0)
    apart = np.flatnonzero(torn(mesh, sides))
    if len(apart):
        vertex = apart[0]
        at = mesh.place[vertex] / body.cell * body.scene.lattice.cell_size
        raise SupportError(
            f"sides: the supports give the corner at ({at[0]:.4g}, {at[1]:.4g}) m two "
            "displacements at once, which takes energy without limit; let one of the two "
            "sides be a roller, or take equal cells (no tolerance), whose answer depends "
            "on their size"
        )


def torn(mesh: LeafMesh, sides: Sides) -> Flags:
    """Tell which vertices supports give two displacements at once."""
    least, most = np.full((mesh.vertices, 2), np.inf), np.full((mesh.vertices, 2), -np.inf)
    for end in mesh.ends[mesh.border].T:
        np.minimum.at(least, end, np.where(sides.held, sides.moved, np.inf))
        np.maximum.at(most, end, np.where(sides.held, sides.moved, -np.inf))
    return np.asarray(((most > least) & (least < np.inf)).any(axis=1))


def supports_of(mesh: LeafMesh, body: PosedBody) -> Ints:
    """Return the side of the array that each border edge lies on, behind these if on none."""
    middle = mesh.place[mesh.ends[mesh.border]].mean(axis=1)
    outer = (middle == 0.0) | (middle == body.extent)
    outer = outer[np.arange(len(middle)), np.where(mesh.side < 2, 1, 0)]
    return np.where(outer, SIDE_OF_EDGE[mesh.side], len(body.scene.lattice.sides))


def corner_numbers(corner: Ints) -> Ints:
    """Return the unknowns phi, phi_x, phi_y of vertices, in the order of these; (n, 3 k)."""
    return np.asarray(3 * corner[:, :, None] + np.arange(3)).reshape(len(corner), -1)
