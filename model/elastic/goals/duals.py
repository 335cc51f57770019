"""What a goal asks of a body: where it is taken, a load whose work it is, and how it is read.

A place gives the points over which a quantity counts, whatever the sizes of the agents; and the
box whose ends agents can have, over which a load can be laid. The dual load of a displacement is a
force at its place, that of a stress an even stress in the agents there, that of a reaction the
movement of its support (Maxwell's influence functions).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import KajuError, ParameterError, suggestion
from kaju.model.elastic.corners import ON_EDGE
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.goals import quantities
from kaju.model.elastic.goals.quantities import Deflection, Goal, Place, Quantity, Reaction, Stress
from kaju.model.elastic.moduli import Moduli, equivalent_stress
from kaju.model.elastic.named_supports import support_names
from kaju.model.elastic.pair.border import Sides, torn
from kaju.model.elastic.pair.elements import gauss
from kaju.model.elastic.pair.gap import stress_of, tensors
from kaju.model.elastic.pair.leaves import LeafCells, Mesh
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.outline.posed_outlines import OutlinedBody
from kaju.model.scene import Scene, body_cells
from kaju.model.scene.regions import LoadRegion

if TYPE_CHECKING:
    from kaju.model.elastic.pair.answer import PairAgents

SMALL = 0.01  # Of the largest: errors of smaller values are relative to this share
NEAREST = (
    "agents cannot end where the place ends; the error is that of the nearest box where they "
    "can end"
)
TORN = "its support meets another: moved alone it would tear the body"


@dataclass(frozen=True, eq=False)
class Where:
    """A place in a body; lengths in the cells of the scene that says where the body is."""

    scene: Scene
    name: str
    lower: Floats
    upper: Floats
    flat: int | None = None  # The axis along which a box has no thickness
    cell: Ints | None = None  # That a point lies in

    def points(self, found: Found) -> tuple[Floats, Ints, Floats]:
        """Return points (m) of agents, the cells they lie in, and weights."""
        h, lower, size = self.scene.lattice.cell_size, found.lower, found.size
        if self.cell is not None:
            return h * self.lower[None], self.cell[None], np.ones(1)
        agent = np.flatnonzero(self._met(lower, size))
        first = np.maximum(lower[agent], self.lower)
        span = np.minimum(lower[agent] + size[agent, None], self.upper) - first
        d = len(self.lower)
        across = [axis for axis in range(d) if axis != self.flat]
        points, share = gauss(3, len(across))  # which are exact for quadratics
        inside = np.full((len(points), d), 0.5)
        inside[:, across] = points
        weight = span[:, across].prod(axis=1)[:, None] * share
        place = (first[:, None] + inside * span[:, None]).reshape(-1, d)
        # An outline may leave a part of an agent only.
        held = found.holds(h * place)
        place, weight = place[held], weight.ravel()[held]
        agent = np.repeat(agent, len(inside))[held]
        if not len(agent):
            raise ParameterError(f"goal: there is no body at {self.name}")
        low, high = np.floor(lower[agent]), np.ceil(lower[agent] + size[agent, None]) - 1
        cell = np.clip(np.floor(place), low, np.maximum(high, low)).astype(np.int64)
        return h * place, cell, weight / weight.sum()

    def within(self, body: PosedBody, section: bool) -> Where:
        """Return the smallest box round it whose ends agents can have, or a `section` of them."""
        # Should a goal ask for it, they can end at multiples of this part of a cell.
        step = max(body.cell // (16 if body.dimension == 2 else 2), body.smallest) / body.cell
        near, flat = ON_EDGE / step, self.flat if section else None
        first, last = np.floor(self.lower / step + near), np.ceil(self.upper / step - near)
        if self.cell is not None:
            first = np.clip(first, self.cell / step, (self.cell + 1) / step - 1)
            last = first + 1
        # The plane of a section is widened to either side that it has.
        thin = last <= first
        first[thin] -= 1
        last[thin] += 1
        if flat is not None:
            first[flat] = last[flat] = np.rint(self.lower[flat] / step)
        return Where(self.scene, self.name, first * step, last * step, flat)

    def aligned(self, leaves: LeafCells, cell: float) -> LeafCells:
        """Return agents of so many units a cell of which none lies across an end."""
        while True:
            low, high, size = leaves.lower / cell, leaves.upper / cell, leaves.size / cell
            across = (low < self.lower) & (self.lower < high)
            across |= (low < self.upper) & (self.upper < high)
            chosen = self._met(low, size) & across.any(axis=1)
            if not chosen.any():
                return leaves
            leaves = leaves.split(chosen)

    def cover(self, leaves: LeafCells, cell: float) -> tuple[Ints, Ints, Floats]:
        """Return its agents, their sides if it is flat (else -1), and shares of it."""
        low, size = leaves.lower / cell, leaves.size / cell
        agent, thick = np.flatnonzero(self._met(low, size)), leaves.dimension
        if not len(agent):
            raise ParameterError(f"goal: there is no body at {self.name}")
        side = np.full(len(agent), -1)
        if self.flat is not None:
            side = 2 * self.flat + (low[agent, self.flat] < self.lower[self.flat])
            thick -= 1
        share = size[agent] ** thick
        return agent, side, share / share.sum()

    def _met(self, lower: Floats, size: Floats) -> Flags:
        """Tell which agents lie in reach; on top of a section only those with nothing below."""
        upper = lower + size[:, None]
        met = (lower < self.upper) & (upper > self.lower)
        if self.flat is not None:
            axis, plane = self.flat, self.lower[self.flat]
            # Within outlines edges of agents are fractions of cells, and rounded.
            met[:, axis] = (lower[:, axis] < plane - ON_EDGE) & (plane <= upper[:, axis] + ON_EDGE)
            top = np.abs(lower[:, axis] - plane) <= ON_EDGE
            below = np.floor(np.maximum(lower, self.lower)).astype(np.int64)
            below[:, axis] = np.ceil(plane) - 1
            met[:, axis] |= top & (self.scene.kinds(below) < 0)
        return np.asarray(met.all(axis=1))


def where_of(at: Place, scene: Scene) -> Where:
    """Return the place of a body that is meant."""
    if isinstance(at, str):
        return _side(at, scene)
    if isinstance(at, dict):
        return _box(at, scene)
    d = scene.lattice.dimension
    if len(at) != d:
        raise ParameterError(
            f"goal: {list(at)} must have {d} coordinates (m), one for each axis of the cells"
        )
    point = np.array([at])
    if np.isfinite(point).all():
        cells, found = body_cells(scene, point)
        if found.all():
            place = np.clip(point[0] / scene.lattice.cell_size, cells[0], cells[0] + 1)
            return Where(scene, f"{at}", place, place, cell=cells[0])
    raise ParameterError(
        f"goal: ({', '.join(f'{x:g}' for x in at)}) m lies outside the body; choose a place in or "
        "on it"
    )


def without_outline(name: str, scene: Scene) -> str:
    """Say what to do where a region is asked for that has no outline to ask for."""
    if scene.lattice.dimension == 2:
        return f'{name!r} is a region of cells; give it outline = "true"'
    return f"{name!r} is a region in space; ask for a point, a box or a side"


def _side(name: str, scene: Scene) -> Where:
    lattice = scene.lattice
    if name in [region.name for region in scene.body.regions]:
        raise ParameterError(f"goal: {without_outline(name, scene)}")
    if name not in lattice.sides:
        raise ParameterError(
            f"goal: there is no side {name!r}{suggestion(name, lattice.sides)}; there is "
            f"{', '.join(lattice.sides)}"
        )
    axis, upper = divmod(lattice.sides.index(name), 2)
    low, high = np.zeros(lattice.dimension), np.asarray(lattice.shape, dtype=np.float64)
    low[axis] = high[axis] = high[axis] if upper else 0.0
    return Where(scene, f"{name!r}", low, high, axis)


def _box(region: dict[str, Any], scene: Scene) -> Where:
    lattice = scene.lattice
    if set(region) != {"box"}:
        raise ParameterError(
            "goal: a place is a point, a side, or a box such as "
            f'{{"box": [[0, 0], [0.1, 0.2]]}}, got {region}'
        )
    try:
        box = LoadRegion(**region)
        flat = box.flat_axis(lattice, "goal.box")
    except KajuError as error:
        message = str(error)
        raise ParameterError(
            message if message.startswith("goal") else f"goal: {message}"
        ) from None
    low, high = np.asarray(box.box) / lattice.cell_size
    if flat is not None and abs(low[flat] - np.rint(low[flat])) < ON_EDGE:
        low[flat] = high[flat] = np.rint(low[flat])
    elif flat is None:
        low, high = np.clip((low, high), 0.0, lattice.shape)
    return Where(scene, f"{region}", low, high, flat)


Found: TypeAlias = "CellAgents | PairAgents"
"""Agents whose fields are read."""


class DualGoal(ABC):
    """A quantity of a body; of a scene it can only be read."""

    where: Where
    # If agents spawn: the body, and where on it dual loads act, as near as agents can end
    body: PosedBody
    box: Where
    no_bound = ""  # Why nothing is proved of it

    def __init__(self, quantity: Quantity, body: PosedBody | Scene) -> None:
        self.quantity = quantity
        self.scene = body if isinstance(body, Scene) else body.scene
        if isinstance(body, PosedBody):
            self.body, self.no_bound = body, body.no_bound
        self.directions = np.ones((1, 1))
        if not isinstance(quantity, Stress):
            self.directions = quantities.directions_of(quantity.along, self.scene.lattice.dimension)
        if not isinstance(quantity, Reaction):
            self.where = where_of(quantity.at, self.scene)
            if isinstance(body, PosedBody):
                self.box = self.where.within(body, isinstance(quantity, Deflection))
                off = np.abs([self.box.lower - self.where.lower, self.box.upper - self.where.upper])
                self.no_bound = self.no_bound or (NEAREST if off.max() > ON_EDGE else "")

    @abstractmethod
    def loaded(self, mesh: Mesh, sides: Sides, found: Found | None) -> list[Sides]:
        """Return the body under each component's dual load, by what was found before, if any."""

    @abstractmethod
    def read(self, found: Found) -> Floats:
        """Return the quantity of agents."""

    def by_works(self, read: float, works: float, fitted: float, sides: Sides) -> float:
        """Return a component by the works of its dual load: on the truth, on what fits."""
        return works

    def goal(self, value: Floats, error: float, largest: dict[type[Quantity], float]) -> Goal:
        """Return what has been found, with what its error is relative to."""
        least = SMALL * largest[type(self.quantity)]
        scale = max(float(np.linalg.norm(value)), least)
        return Goal(self.quantity, tuple(value.tolist()), error, scale, self.no_bound)


class Displaced(DualGoal):
    """The mean displacement of a place."""

    def loaded(self, mesh: Mesh, sides: Sides, found: Found | None) -> list[Sides]:
        """Return the body under a force along each direction, on agents or their sides."""
        agent, side, share = self.box.cover(mesh.leaves, self.body.cell)
        within, out = side < 0, []
        for along in self.directions:
            own, force = sides.at_rest(), share[:, None] * along
            own.body[agent[within]] = force[within]
            own.load[agent[~within], side[~within], 0] = force[~within]
            # On what is held no force does any work.
            own.load[mesh.owner, mesh.side] *= ~sides.held[:, None]
            out.append(own)
        return out

    def read(self, found: Found) -> Floats:
        """Return the mean over the place's points."""
        place, cell, weight = self.where.points(found)
        return np.asarray(self.directions @ (weight @ found.displacement_at(place, cell)))

    def by_works(self, read: float, works: float, fitted: float, sides: Sides) -> float:
        """Return the mean; what is held moves besides, without work, and so do all together."""
        return read + works - fitted


class Stressed(DualGoal):
    """The mean stress of a place."""

    def __init__(self, quantity: Stress, body: PosedBody | Scene) -> None:
        super().__init__(quantity, body)
        d = self.scene.lattice.dimension
        self._pairs = [(k, k) for k in range(d)] + list(combinations(range(d), 2))
        known: dict[str, Any] = {
            quantities.AXES[a] + quantities.AXES[b]: (a, b) for a, b in sorted(self._pairs)
        }
        known[quantities.VON_MISES], asked = None, quantity.component
        if not {asked, asked[::-1]} & {*known}:
            raise ParameterError(f"goal: there is no stress {asked!r}; there is {', '.join(known)}")
        self._component = known.get(asked, known.get(asked[::-1]))
        if self._component is None and not self.no_bound:
            self.no_bound = "the equivalent stress is no linear quantity, and only such are proved"

    def loaded(self, mesh: Mesh, sides: Sides, found: Found | None) -> list[Sides]:
        """Return the body under the stress of the strain by which the quantity grows."""
        agent, _, share = self.box.cover(mesh.leaves, self.body.cell)
        strain = np.eye(len(self._pairs))[self._pairs.index(self._component or (0, 0))]
        if self._component is None and found is not None:
            strain = self._slope(found)
        law = np.array([modulus[mesh.leaves.kind[agent]] for modulus in self.body.moduli])
        own, stress = sides.at_rest(), stress_of(np.tile(strain, (len(agent), 1)), law)
        own.even[agent] = (share * self.body.cell / mesh.leaves.size[agent])[:, None] * stress
        return [own]

    def read(self, found: Found) -> Floats:
        """Return the mean over the place's points."""
        place, cell, weight = self.where.points(found)
        stress = np.mean(found.stresses_at(place, cell), axis=0)
        law = found.law_at(place, cell)
        return np.array([weight @ self._measured(stress, law, found.moduli)])

    def _measured(self, stress: Floats, law: Ints, moduli: Moduli) -> Floats:
        if self._component is None:
            return equivalent_stress(stress, moduli, law, self.scene.plane)
        return np.asarray(stress[:, self._component[0], self._component[1]])

    def _slope(self, found: Found) -> Floats:
        """Return the slopes of the equivalent stress by the components of the mean stress."""
        place, cell, weight = self.where.points(found)
        mean = np.tensordot(weight, np.mean(found.stresses_at(place, cell), axis=0), 1)
        step = 1e-4 * float(np.abs(mean).max()) or 1.0
        by = step * tensors(np.eye(len(self._pairs)))
        law = np.repeat(found.law_at(place, cell)[:1], len(by))
        ends = [self._measured(mean + sign * by, law, found.moduli) for sign in (1, -1)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * step))


class Supported(DualGoal):
    """The force of a support."""

    def __init__(self, quantity: Reaction, body: PosedBody | Scene) -> None:
        super().__init__(quantity, body)
        self._name = quantity.side
        names = support_names(self.scene)
        if isinstance(body, PosedBody) and quantity.side not in names:
            told = f"goal: there is no support {quantity.side!r}{suggestion(quantity.side, names)}"
            raise ParameterError(f"{told}; there may be {', '.join(names)}")
        self.support = names.index(quantity.side) if quantity.side in names else -1

    def loaded(self, mesh: Mesh, sides: Sides, found: Found | None) -> list[Sides]:
        """Return the body with the support moved along each direction, and nothing else."""
        here, d, out = sides.support == self.support, mesh.leaves.dimension, []
        beds = np.flatnonzero(here & (sides.bed > 0.0))
        owner, side = mesh.owner[beds], mesh.side[beds]
        size = mesh.leaves.size[owner] / self.body.cell
        for along in self.directions:
            own = sides.at_rest()
            own.moved[:] = np.where(here[:, None] & sides.held, along, 0.0)
            if d == 2 and torn(mesh, own).any():
                own.moved[:], self.no_bound = 0.0, TORN
            # A bed's own movement is a force on the body.
            push = sides.bed[beds] * size ** (d - 1) * along[side // 2]
            own.load[owner, side, 0, side // 2] = push
            out.append(own)
        return out

    def read(self, found: Found) -> Floats:
        """Return the force."""
        reactions = found.reactions()
        if self._name not in reactions:
            raise ParameterError(
                f"goal: nothing holds the body at {self._name!r}; supports are "
                f"{', '.join(reactions) or 'missing'}"
            )
        return np.asarray(self.directions @ reactions[self._name][: self.directions.shape[1]])

    def by_works(self, read: float, works: float, fitted: float, sides: Sides) -> float:
        """Return the force: beds bear what their movement works, others nothing that is known."""
        return -works if sides.bed[sides.support == self.support].any() else read - works


def goal_of(quantity: Quantity, body: PosedBody | Scene) -> DualGoal:
    """Return a quantity as a goal of a body; of a scene it can only be read."""
    if isinstance(quantity, Deflection):
        return Displaced(quantity, body)
    if isinstance(quantity, Stress):
        return Stressed(quantity, body)
    return Supported(quantity, body)


def aligned(goals: list[DualGoal], body: PosedBody | OutlinedBody) -> LeafCells:
    """Return first agents of a body that are as small as the places of goals ask for."""
    leaves = body.start()
    for goal in goals:
        if not isinstance(goal, Supported):
            leaves = goal.box.aligned(leaves, body.cell)
    return leaves.balanced()
