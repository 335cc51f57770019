"""What holds and loads a body, side by side of its agents: the data of both opinions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints, rigid_motions
from kaju.errors import ParameterError, SupportError
from kaju.model.elastic.free_motion import balanced, free_motion, unheld
from kaju.model.elastic.moduli import moduli_at
from kaju.model.elastic.named_supports import supports_inside
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.uneven_loads import data_error
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER

from .leaves import Mesh, beyond


@dataclass(frozen=True, eq=False)
class Sides:
    """Supports of the m sides of the border, and loads of the n agents; scaled, in cells."""

    support: Ints  # Which of `support_names` each lies on, where it is held; shape (m,)
    held: Flags  # Whether each component is held there; shape (m, d)
    given: Flags  # Whether the traction is given: neither held nor borne by a bed; shape (m, d)
    moved: Floats  # How far it is moved where it is held, less `shift`; shape (m, d)
    shift: Floats  # Movement that all supports have in common; shape (d,)
    bed: Floats  # Stiffness per area of the bed across it, 0 without; shape (m,)
    # By agent, side, force or first moment along each of its axes about its middle (over its
    # length), component
    load: Floats  # Shape (n, 2 d, d, d)
    straight: Floats  # Loads on held components, which are the support's at once; shape (m, d)
    body: Floats  # Forces within agents; shape (n, d)
    # Work of the loads on an even strain of each agent (normal strains, twice the shear strains),
    # over its edge: that of a stress times the edge, in space times its square
    even: Floats
    rest: float  # Energy norm of what the agents do not take of loads that end within sides
    ragged: Ints  # The agents with such loads

    @property
    def cases(self) -> tuple[Sides, ...]:
        """What is solved for by itself: the loads, and the supports that move."""
        forces = self.load.any() or self.body.any() or self.even.any()
        if not (forces and self.moved.any()):
            return (self,)
        still = replace(self, moved=np.zeros_like(self.moved))
        return still, replace(self, **self.nothing("load", "body", "even"))

    def at_rest(self) -> Sides:
        """Return the same supports, which do not move, without loads."""
        arrays = self.nothing("moved", "shift", "load", "straight", "body", "even")
        return replace(self, rest=0.0, ragged=np.zeros(0, dtype=np.int64), **arrays)

    def nothing(self, *names: str) -> dict[str, Any]:
        """Return some of the arrays with zeros in place of all values."""
        return {name: np.zeros_like(getattr(self, name)) for name in names}

    @property
    def beds(self) -> Ints:
        """The sides of the border that lie on a bed."""
        return np.flatnonzero(self.bed)


def sides_of(body: PosedBody, mesh: Mesh) -> Sides:
    """Return supports and loads of a body."""
    leaves, n, m, d = mesh.leaves, len(mesh.leaves), len(mesh.side), body.dimension
    across = np.arange(d) == (mesh.side // 2)[:, None]
    # The unit cell beyond the middle of each side says what is there.
    unit = np.empty((m, d), dtype=np.int64)
    for side in range(2 * d):
        here = mesh.side == side
        unit[here] = beyond(leaves, side)[mesh.owner[here]]
    kind = body.scene.kinds(unit // body.cell)
    outer = ((unit < 0) | (unit >= body.extent)).any(axis=1)
    support = mesh.side.astype(np.int64)
    support[~outer] = supports_inside(body.scene, unit[~outer] // body.cell)
    held = np.isin(kind, (RIGID, DISPLACED))[:, None] | ((kind == ROLLER)[:, None] & across)
    moved, bed, scales = np.zeros((m, d)), np.zeros(m), body.scales
    for side, name in enumerate(body.scene.lattice.sides):
        condition = body.scene.side_condition(name)
        moved[support == side] = np.array(condition.displacement or [0.0] * d) / scales.displacement
        stiffness = (condition.stiffness or 0.0) * scales.length / scales.modulus
        bed[(support == side) & (kind == FOUNDATION)] = stiffness
    moved[~held] = 0.0
    # What all supports move alike strains nothing: of bodies that move by much more than they
    # stretch rounding would leave no strains.
    shift = np.zeros(d)
    for axis in range(d):
        values = moved[held[:, axis], axis]
        if len(values) and values.min() * values.max() > 0.0 and not bed.any():
            shift[axis] = min(values.min(), values.max(), key=abs)
    moved = np.where(held, moved - shift, 0.0)
    given = ~held & ~((bed > 0.0)[:, None] & across)
    load, inside, leaf, rest = body.forces(leaves)
    law = moduli_at(body.moduli, leaves.kind)
    lost = data_error(leaf, rest, leaves.size / body.cell, law, d)
    ragged = np.unique(leaf[rest > 0.0])
    own = load[mesh.owner, mesh.side]
    straight = np.where(held, own[:, 0], 0.0)
    load[mesh.owner, mesh.side] = np.where(held[:, None], 0.0, own)
    even = np.zeros((n, d * (d + 1) // 2))
    return Sides(
        support, held, given, moved, shift, bed, load, straight, inside, even, lost, ragged
    )


def grips(mesh: Mesh, sides: Sides) -> tuple[Ints, Ints, Ints]:
    """Return vertices on beds that stay where they are, along which axis, and an agent of each.

    One for every motion of a part along its bed that nothing else stops: it bears nothing, as
    `check_held` sees to. They are the same in all generations.
    """
    d, part, found = mesh.leaves.dimension, mesh.part[mesh.owner], []
    for number in np.unique(part[sides.beds]):
        free = np.flatnonzero(sides.given[part == number].all(axis=0))
        side = sides.beds[part[sides.beds] == number]
        vertex = mesh.on_border[side, : 1 << (d - 1)].ravel()
        order = np.lexsort(mesh.place[vertex].T)
        # In space the one at the far corner keeps the part from turning on its bed.
        for at, axis in zip(order[[0, 0, -1]], [*free, *free[1:]], strict=False):
            found.append((vertex[at], axis, mesh.owner[side[at >> (d - 1)]]))
    vertex, axis, owner = np.array(found, dtype=np.int64).reshape(-1, 3).T
    return vertex, axis, owner


def check_held(
    body: PosedBody, mesh: Mesh, sides: Sides, forces: Floats, goal: bool = False
) -> None:
    """Refuse a body of which a part could move without straining, or whose supports tear it.

    But for what `grips` stop if the loads, the `forces` on the agents' own unknowns, do not push it
    there; be they those of a `goal`.
    """
    part, d = mesh.part, body.dimension
    place = mesh.place[mesh.on_border[:, : 1 << (d - 1)]] / body.cell
    for number in range(int(part.max()) + 1):
        side, axis = np.nonzero(~sides.given & (part[mesh.owner] == number)[:, None])
        points = place[side].reshape(-1, d)
        middle = points.mean(axis=0) if len(points) else np.zeros(d)
        rows = rigid_motions(points - middle, np.repeat(axis, 1 << (d - 1)))
        if not (motion := free_motion(rows, d)):
            continue
        own = np.flatnonzero(part == number)
        if rests := bool(sides.bed[part[mesh.owner] == number].any()):
            corners = mesh.place[mesh.corner[own]].repeat(d, axis=1).reshape(-1, d) / body.cell
            force = forces[own, : d << d].ravel()
            motions = rigid_motions(corners - middle, np.arange(len(force)) % d)
            if balanced(rows, motions, force):
                continue
        if goal:
            raise ParameterError(
                f"goal: the body could {motion} on its bed, so how far it does is not known; ask "
                "for what is across the bed, or hold the body by a rigid or roller cell or side"
            )
        raise unheld(mesh.leaves.lower[own[0]] // body.cell, motion, len(points) > 0, rests)
    apart = np.flatnonzero(torn(mesh, sides))
    if len(apart) and d == 2:
        at = mesh.place[apart[0]] / body.cell * body.scene.lattice.cell_size
        raise SupportError(
            f"sides: the supports give the corner at ({at[0]:.4g}, {at[1]:.4g}) m two "
            "displacements at once, which needs infinite energy; make one of the two sides a "
            "roller, or solve without a tolerance, on equal cells, whose answer then "
            "depends on their size"
        )


def torn(mesh: Mesh, sides: Sides) -> Flags:
    """Tell which vertices supports give two displacements at once."""
    d = sides.held.shape[1]
    least, most = np.full((len(mesh.place), d), np.inf), np.full((len(mesh.place), d), -np.inf)
    for vertex in mesh.on_border[:, : 1 << (d - 1)].T:
        np.minimum.at(least, vertex, np.where(sides.held, sides.moved, np.inf))
        np.maximum.at(most, vertex, np.where(sides.held, sides.moved, -np.inf))
    return np.asarray(((most > least) & (least < np.inf)).any(axis=1))
