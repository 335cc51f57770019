"""The generations of agents: how each settles, what is kept of it, and their family."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.moduli import by_law, equivalent_stress, is_rubber
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.results.stored import Column

from .airy import Airy
from .border import Sides, check_held, sides_of
from .displacement import forces_of, way_of
from .elements import DEEPEST_STEP, child_maps
from .leaves import BITS, LeafCells, Mesh, PlaneMesh, corners, mesh_of
from .levels import DIRECT, FieldLevel, descent, handed_down, level_of
from .opinions import Opinions
from .space import SETTLED, Bricks, hats_of

Settled = Opinions | Bricks
Aim = Callable[[Mesh, Sides], list[Sides]]
"""Lays loads on a generation, by its mesh and sides: those whose work a goal is."""


def settled(
    body: PosedBody, leaves: LeafCells, before: Settled | None = None, aims: Sequence[Aim] = ()
) -> Settled:
    """Return agents whose opinions are of least energy, but for what the gap allows."""
    # They are parts of those of the generation before, which this one corrects.
    d, mesh = body.dimension, mesh_of(leaves)
    sides = sides_of(body, mesh)
    law = np.stack([modulus[leaves.kind] for modulus in body.moduli])
    laws = by_law(law)
    family = None
    if before is None:
        check_held(body, mesh, sides, forces_of(sides))
    else:
        family = descent(before.leaves, leaves)
        mesh.part, mesh.first = (one[family[0]] for one in (before.mesh.part, before.mesh.first))
    # Loads and supports that move, each by themselves, then loads of goals: of the same equations.
    kind: Any = Opinions if d == 2 else Bricks
    acts = sides.cases
    loads = [*acts, *(one for aim in aims for one in aim(mesh, sides))]
    for load in loads[len(acts) :] if before is None else ():
        check_held(body, mesh, load, forces_of(load), goal=True)
    fields: list[Any] = [kind(body, mesh, one, law, laws) for one in loads]
    olds: list[Any] = [*before.cases, *before.duals] if before else [None] * len(loads)
    gaps = [0.5 * float(old.shares.sum()) if old else 0.0 for old in olds]
    told: list[Any] = [("fit", fields[0].blocks, way_of(mesh, sides), child_maps(False, d))]
    if isinstance(mesh, PlaneMesh):
        airy = Airy(mesh, sides, body.cell)
        way = airy.way(airy.hanging())[:2]
        told.append(("phi", airy.blocks(fields[0].soft_roots), way, child_maps(True)))
    rubber = d == 2 and is_rubber(body.moduli, body.scene.plane)
    # Levels do not smooth what is nearly incompressible, in the plane.
    direct, levels = 60_000 if rubber else DIRECT[d], []
    for number, (name, blocks, way, maps) in enumerate(told):
        if d == 3 and before is None and len(way[1]) > direct:
            level = FieldLevel(blocks, way[0], *hats_of(fields[0], *way))
        else:
            above = before.levels[number] if before else None
            level = level_of(blocks, way, above, family, maps, direct)
        levels.append(level)
        for field, old, gap in zip(fields, olds, gaps, strict=True):
            begun = np.zeros(blocks.dof.shape)
            if family is not None:
                begun = handed_down(getattr(old, name), family, maps)
            if name == "fit":
                field.fits(level, begun, gap if d == 2 else SETTLED * gap)
            else:
                field.balances(level, begun, gap, old, family and family[0])
    answer: Settled = fields[0]
    if len(acts) > 1:
        answer = kind(body, mesh, sides, law, laws)
        answer.parts, answer.blocks = tuple(fields[:2]), fields[0].blocks
        for name, *_ in told:
            setattr(answer, name, sum(getattr(part, name) for part in answer.parts))
    if isinstance(before, Bricks) and isinstance(answer, Bricks):
        answer.earlier = float(before.shares.sum()), before.energy
    answer.levels, answer.duals = tuple(levels), tuple(fields[len(acts) :])
    return answer


NOBODY = -1  # Parent of the first agents, and first child of those that have none
WORKING = -1  # Retirement of agents that have not retired

_ROW = np.dtype(
    [(name, np.int64) for name in ("code", "size", "parent", "first_child")]
    + [("spawn_step", np.int64), ("retired_step", np.int64)]
    + [("cause", np.float64), ("gap", np.float64), ("chosen", np.bool_)]
)


@dataclass(frozen=True, eq=False, repr=False)
class Generation:
    """One step of spawning: figures of all agents together, then arrays with a row for each."""

    error: float
    """In the energy norm, relative: in the plane proved, in space estimated."""
    energy: float
    """Of the body (J): in the plane the middle of the bounds, in space below the true one."""
    lower: float | None
    """Bounds of the energy (J); None in space."""
    upper: float | None
    code: Annotated[Ints, Column("agents", 0, (1 << 62) - 1)]
    """Morton code of every agent's lower corner."""
    size: Annotated[Ints, Column("agents", 1)]
    """Edge (units) of every agent."""
    gap: Annotated[Floats, Column("agents", 0.0)]
    """What its two opinions differ in, squared (J): its part of the squared error."""
    fitted: Annotated[Floats, Column("agents", 0.0)]
    """Equivalent stress (Pa) of the opinion that fits, in the mean over the agent."""
    balanced: Annotated[Floats, Column("agents", finite=False)]
    """That of the opinion that balances; NaN in space, where there is none."""
    chosen: Annotated[Flags, Column("agents")]
    """Which agents spawn in the next step because of their gap."""

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self.code)

    def __repr__(self) -> str:
        """Return its figures without the arrays."""
        return f"Generation(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"


def generation_of(found: Any, chosen: Flags) -> Generation:
    """Return what is kept of a generation of which some agents are to spawn."""
    bounds, body, leaves, unit = found.bounds, found.body, found.leaves, found.body.scales
    *balanced, fitted = (
        unit.stress * equivalent_stress(stress, body.moduli, leaves.kind, body.asked.plane)
        for stress in found.means
    )
    both = bounds.lower, bounds.upper
    lower, upper = (None if body.no_bound else unit.energy * x for x in both)
    first = balanced[0] if balanced else np.full(len(leaves), np.nan)
    arrays = (leaves.code, leaves.size, unit.energy * found.shares, fitted, first, chosen)
    return Generation(bounds.error, unit.energy * bounds.energy, lower, upper, *arrays)


class Family:
    """All agents as rows of a table, in the order in which they spawned.

    An agent that spawns retires: its children take its place. To keep neighbours of similar
    size, a child may spawn children of its own in the same step.

    Attributes
    ----------
    rows : structured array, shape (agents,)
        With the fields

        - code, size: Morton code of the lower corner, and edge (units);
        - parent: row of the parent, -1 for the first agents;
        - first_child: row of the first of its 4 (in three dimensions 8) children, which
          follow one another; -1 without;
        - spawn_step, retired_step: when it spawned, 0 for the first agents, and when it
          retired, -1 if it has not;
        - cause: gap (J) of its parent, for which it spawned; 0 for the first agents, NaN for
          those that keep neighbours alike in size;
        - gap: what its two opinions differ in, or did at last (J); NaN if it has had none;
        - chosen: whether it spawned children for that gap, or will in the next step.
    working : int array
        Rows of the agents that have not retired, along a space-filling curve.
    step : int
        Number of the last generation.
    metre : float
        Length (m) of the unit in which generations count.
    """

    def __init__(self, dimension: int, metre: float) -> None:
        self.dimension, self.metre = dimension, metre
        self.rows = np.empty(0, dtype=_ROW)
        self.working: Ints = np.empty(0, dtype=np.int64)
        self.step = -1

    @classmethod
    def of(cls, generations: Iterable[Generation], dimension: int, metre: float) -> Family:
        """Return the family of the agents that stood in generations, gaps in J."""
        family = cls(dimension, metre)
        for generation in generations:
            family.grow(generation.code, generation.size)
            family.settle(generation.gap, generation.chosen)
        return family

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, dimension)."""
        return np.asarray(corners(self.rows["code"], self.dimension) * self.metre)

    @property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return np.asarray(self.rows["size"] * self.metre)

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        size = self.rows["size"]
        largest = size[self.rows["spawn_step"] == 0].max()
        return np.asarray(np.rint(np.log2(largest / size)), dtype=np.int64)

    def grow(self, code: Ints, size: Ints) -> None:
        """Add the agents of the next generation (units), in the order of their codes."""
        self.step += 1
        if self.step == 0:
            self.working = self._append(code, size, NOBODY, 0.0)
            return
        # Parents spawn until the working agents are those of the generation.
        working = self.working
        while True:
            own = self.rows[working]
            held, parents = divided(own["code"], own["size"], code, size, self.dimension)
            self.rows["retired_step"][working[~held]] = self.step  # they hold nothing
            working = working[held]
            if not parents.any():
                break
            working = np.append(working[~parents], self._spawn(working[parents]))
            working = working[np.argsort(self.rows["code"][working])]
        self.working = working

    def settle(self, gap: Floats, chosen: Flags) -> None:
        """Note the gaps (J) of the working agents, and which are marked."""
        self.rows["gap"][self.working] = gap
        self.rows["chosen"][self.working] = chosen

    def standing(self, step: int) -> Ints:
        """Return the rows of the agents of a generation, along a space-filling curve."""
        spawned, retired = self.rows["spawn_step"], self.rows["retired_step"]
        there = np.flatnonzero((spawned <= step) & ((retired == WORKING) | (retired > step)))
        return there[np.argsort(self.rows["code"][there])]

    def children(self, row: int) -> range:
        """Return the rows of an agent's children."""
        first = int(self.rows["first_child"][row])
        return range(0) if first == NOBODY else range(first, first + (1 << self.dimension))

    def _spawn(self, parents: Ints) -> Ints:
        """Let agents retire; return the rows of their children."""
        many, rows = 1 << self.dimension, self.rows
        half = rows["size"][parents] // 2
        # The codes of a family follow one another, as far apart as a child has unit cells.
        code = rows["code"][parents, None] + np.arange(many) * half[:, None] ** self.dimension
        cause = np.where(rows["chosen"][parents], rows["gap"][parents], np.nan)
        rows["retired_step"][parents] = self.step
        rows["first_child"][parents] = len(rows) + many * np.arange(len(parents))
        half, parents, cause = (np.repeat(values, many) for values in (half, parents, cause))
        return self._append(code.ravel(), half, parents, cause)

    def _append(self, code: Ints, size: Ints, parent: Ints | int, cause: Floats | float) -> Ints:
        fresh = np.zeros(len(code), dtype=_ROW)
        fresh["code"], fresh["size"], fresh["parent"], fresh["cause"] = code, size, parent, cause
        fresh["first_child"], fresh["retired_step"] = NOBODY, WORKING
        fresh["spawn_step"], fresh["gap"] = self.step, np.nan
        self.rows = np.concatenate([self.rows, fresh])
        return np.arange(len(self.rows) - len(fresh), len(self.rows))


def divided(code: Ints, size: Ints, later: Ints, sizes: Ints, d: int) -> tuple[Flags, Flags]:
    """Tell which agents hold any of later ones, and which of these hold smaller ones."""
    at, end = np.searchsorted(later, [code, code + size**d])
    held = end > at
    return held, sizes[at[held]] < size[held]


def trees_of(
    first: LeafCells, generations: list[Generation], whole: bool = True
) -> list[LeafCells]:
    """Return the agents of stored generations; refuse some that do not descend from the first."""
    # Within outlines they need not fill these (be `whole`), and halve as often as it takes.
    d, trees = first.dimension, [first]
    if not generations:
        raise ResultError("it holds no generation of agents")
    for number, one in enumerate(generations):
        leaves, most = trees[-1], (DEEPEST_STEP if number else 0) if whole else BITS[d]
        for _ in range(most):
            held, parents = divided(leaves.code, leaves.size, one.code, one.size, d)
            leaves = leaves.only(held)
            if not parents.any():
                break
            leaves = leaves.split(parents)
        sound = np.array_equal(leaves.code, one.code) and np.array_equal(leaves.size, one.size)
        if whole:
            sound &= (leaves.size**d).sum() == (first.size**d).sum()
            sound &= len(leaves.balanced()) == len(leaves)
        if not sound:
            raise ResultError("its agents do not stand side by side in the body")
        trees.append(leaves)
    return trees[1:]
