"""Adaptive refinement by blocks of agents, on a forest.

Gauss-Seidel smoothing goes through agents and blocks in order, so an iteration that ends early is
not quite symmetric, and of two mirror images only one might be marked. Where body, supports and
loads are symmetric, a displacement is therefore replaced by the mean of itself and its image.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import MOST_QUADRATIC
from kaju.model.elastic.bounds.bound_cells import BoundCells
from kaju.model.elastic.bounds.bounds_of_blocks import boxes_of_blocks
from kaju.model.elastic.bounds.energy_bounds import PROVED_AT
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields
from kaju.model.elastic.multigrid import block_kernels as kernels
from kaju.model.elastic.multigrid.block_cycle import BlockCycle, Root
from kaju.model.elastic.multigrid.block_types import PLACES
from kaju.model.elastic.multigrid.blocks import BlockOperator, Window
from kaju.model.elastic.multigrid.forest import ACROSS, Forest, first_forest, offsets
from kaju.model.elastic.multigrid.krylov import Iteration, dot
from kaju.model.elastic.multigrid.nested import WORST
from kaju.model.elastic.pair.quadtree import LeafCells, morton
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.problem import is_rubber
from kaju.model.elastic.refine.estimator import Indicator
from kaju.model.elastic.refine.generations import Spawning
from kaju.model.elastic.refine.refine_loop import LeafLoop, RefineLoop, Target
from kaju.model.elastic.refine.targets import Aimed
from kaju.model.scene.cell_types import RIGID, ROLLER

LAST = 1e-9  # The last generation's forces balance to this share of the loads
ON_THE_WAY = 0.07
"""Every generation is iterated to this share of the error before, the last one further."""
CYCLE = {2: 0.1, 3: 0.25}
"""Share of a smooth error, like that of a prolonged displacement, left by a V-cycle."""
FEWEST = 0.5  # Agents times the tolerance to the power of 3, in the simplest of solids
SPREAD = 3.0  # Agents, of which fewer are expected at least, are about this many times more
AT_ONCE = 2_000  # Blocks whose stresses are worked out together
FIRST = 3_000  # With fewer expected agents single ones are as quick
MOST_AGENTS = {2: 4_000_000, 3: 400_000}
"""What fits in some 14 GB: about 3.5 kB an agent, in three dimensions 10 to 30 kB."""
IN_BLOCKS = 4_000_000  # The same in blocks, of solids: about 1 kB an agent
PROVED_IN_BLOCKS = {2: 20_000_000, 3: 4_000_000}  # Agents whose bounds the loop works out
BOUNDED_EARLY = {2: (0, 0), 3: (25_000, 100_000)}
"""Between so many agents bounds are worked out once before the end: in a cube under a small load
their ratio to the estimate is 0.84 at 4,000 agents, 0.75 at 33,000, and 0.77 at 590,000."""
MEASURED = 0.95
"""Share of the target that the last generation aims at, once that ratio is known: a cube under a
small load keeps 0.02 with 590,000 agents, and with 790,000 where it is guessed."""
CONTRAST = 100.0  # Of materials, up to which the law on coarse cells serves as a coarse level
ROUNDING = 1e-12  # Loads that differ from their images by less, of the largest, are symmetric


def blocks_for(ground: PosedBody, tolerance: float) -> Forest | None:
    """Return the first blocks for a scene; None where single agents do better."""
    # In the plane bounds of second order keep any tolerance with few agents. Blocks know no
    # foundations, prescribed displacements, contrasts above 100, or nearly incompressible
    # materials. Single agents are also quicker where few are needed, or fewer than the first blocks
    # hold, for instance in bodies of fine shape.
    moduli, scene = ground.moduli, ground.scene
    conditions = [scene.side_condition(name) for name in scene.lattice.sides]
    unusual = any(c.displacement is not None or c.stiffness for c in conditions)
    rubber = is_rubber(moduli, scene.plane)
    contrast = moduli.shear.max() / moduli.shear.min()
    expected = FEWEST / tolerance**3
    if ground.dimension == 2 or rubber or unusual or contrast > CONTRAST or expected < FIRST:
        return None
    forest = first_forest(ground)
    return None if forest is None or forest.count > SPREAD * expected else forest


class BlockSpawning(Spawning):
    """Agents in blocks, and their generations; arrays over agents are made on demand."""

    def __init__(
        self, blocks: BlockOperator, u: Floats, root: Root, allowed: float, **ended: Any
    ) -> None:
        self.blocks, self.u, self.root, self._allowed = blocks, u, root, allowed
        self.retired = 0
        vars(self).update(ended)

    @cached_property
    def leaves(self) -> LeafCells:
        """The agents, with the load (N) of their parent for which they spawned."""
        cells = self.blocks.forest.agents
        cause, unit = cells.cause.copy(), self.ground.scales.force
        for step in range(1, len(self.generations)):
            before = self.generations[step - 1]
            here = np.flatnonzero((cells.step == step) & (cause > 0))
            parent = np.searchsorted(before.code, cells.code[here], side="right") - 1
            cause[here] = before.load[parent] * unit
        return replace(cells, cause=cause)

    @property
    def ground(self) -> PosedBody:
        """The posed body."""
        return self.blocks.forest.ground

    @cached_property
    def _window(self) -> Window:
        return Window(self.blocks.forest, self.blocks.forest.leaves)

    @property
    def balance(self) -> Equilibrium:  # type: ignore[override]
        """The composite grid of all agents."""
        return self._window.balance

    @cached_property
    def displacement(self) -> Floats:  # type: ignore[override]
        """Displacement of all its faces."""
        return self._window.displacement(self.u)

    def near(self, agent: Ints) -> tuple[CellFields, Ints]:
        """Return fields of a window that holds agents, and their places in it."""
        forest = self.blocks.forest
        block = forest.leaves[np.unique(agent // len(forest.corners))]
        around = forest.with_neighbours(block)
        if 2 * len(around) > len(forest.leaves):
            return self.fields, agent
        window = Window(forest, around)
        fields = CellFields(window.balance, window.displacement(self.u))
        return fields, window.leaves.find(self.leaves.lower[agent])

    @property
    def moved(self) -> Floats:
        """Displacement of the agents' middles, shape (agents, dimension)."""
        blocks, forest, u = self.blocks, self.blocks.forest, self.u.copy()
        blocks.fill_coarse(u)
        stride = blocks.layout.stride
        place = (forest.corners + 1) @ stride
        found = np.empty((len(forest.leaves), len(place), forest.dimension))
        for a in range(forest.dimension):
            own = u[forest.leaves, a]
            found[:, :, a] = 0.5 * (own[:, place] + own[:, place + stride[a]])
        return found.reshape(-1, forest.dimension)

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors of the agents, shape (agents, dimension, dimension)."""
        many, leaves = len(self.blocks.forest.corners), self.blocks.forest.leaves
        parts = []
        for first in range(0, len(leaves), AT_ONCE):
            agent = np.arange(first * many, min(first + AT_ONCE, len(leaves)) * many)
            fields, agent = self.near(agent)
            parts.append(fields.stress[agent])
        return np.concatenate(parts)

    def boxes(self) -> BoundCells:
        """Return the agents as energy bounds need them."""
        u = self.u.copy()
        self.blocks.fill_coarse(u)
        return boxes_of_blocks(self.blocks, u)

    def reactions(self) -> dict[str, Floats]:
        """Return the force of every support on the body."""
        forest, leaves = self.blocks.forest, self.blocks.forest.leaves
        held = np.isin(forest.kinds[leaves], (RIGID, ROLLER)).any(axis=1)
        block = leaves[held | forest.loaded]
        window = Window(forest, forest.with_neighbours(block))
        own = np.isin(window.block, block)
        return window.balance.reactions(window.displacement(self.u), own)

    @cached_property
    def indicator(self) -> Indicator:  # type: ignore[override]
        """What each agent leaves unbalanced."""
        return self.blocks.indicator(self.u)

    @property
    def aimed(self) -> Aimed:  # type: ignore[override]
        """The error that the tolerance limits, and the agents' contributions to it."""
        unmarked = np.zeros(self.blocks.forest.count, dtype=np.bool_)
        return Aimed(self.error, self.indicator.square, unmarked, self._allowed)


def spawner_of(
    ground: PosedBody,
    tolerance: float,
    most_agents: int | None,
    aim: Target | None = None,
    previous: Spawning | None = None,
) -> RefineLoop:
    """Return a loop over blocks where these serve, or else over single agents."""
    forest = blocks_for(ground, tolerance) if aim is None else None
    most = most_agents or (MOST_AGENTS[ground.dimension] if forest is None else IN_BLOCKS)
    if most_agents is None and aim is None and ground.dimension == 2:
        most = MOST_QUADRATIC
    if forest is not None and forest.count <= most:
        before = previous if isinstance(previous, BlockSpawning) else None
        return BlockLoop(forest, tolerance, most, before)
    return LeafLoop(ground, tolerance, most, aim, previous)


class BlockLoop(RefineLoop):
    """Agents that spawn block by block, on a forest; see `RefineLoop`."""

    most_proved = PROVED_IN_BLOCKS

    def __init__(
        self,
        forest: Forest,
        tolerance: float,
        most_agents: int,
        previous: BlockSpawning | None = None,
    ) -> None:
        super().__init__(forest.ground, tolerance, most_agents)
        self._reduction = CYCLE[forest.dimension]
        self._mirrors: tuple[int, ...] = ()
        if previous is None:
            blocks = BlockOperator(forest)
            self.root = Root(blocks)
            self.root.check_held(blocks)
            self._stand(blocks)
        else:
            self.root, self.error = previous.root, previous.error
            old = previous.u.copy()
            previous.blocks.fill_coarse(old)
            self._stand(BlockOperator(previous.blocks.forest.loaded_by(forest.ground)), old)
        self._mirrors = mirrors(self.blocks)

    @property
    def leaves(self) -> LeafCells:
        """The agents of this generation."""
        return self.blocks.forest.agents

    @property
    def agents(self) -> int:
        """How many agents there are."""
        return self.blocks.forest.count

    @property
    def smallest(self) -> Flags:
        """Which blocks are as small as may be."""
        forest = self.blocks.forest
        return np.asarray(forest.size[forest.leaves] <= self.ground.smallest)

    @property
    def sharp(self) -> Ints:
        """Blocks at points where stress is singular."""
        return np.unique(self.blocks.forest.holding(self.ground.sharp)[0])

    def outcome(self) -> BlockSpawning:
        """Return the agents as they are."""
        levels = self.blocks.forest.depth
        own = (self.blocks, self.displacement, self.root, self.aimed.allowed)
        return BlockSpawning(*own, **self._ended(levels))

    def _stand(self, blocks: BlockOperator, old: Floats | None = None) -> None:
        """Set the blocks of this generation, at the displacement `old` of the last, prolonged."""
        self.blocks = blocks
        self.multigrid = BlockCycle(blocks, self.root)
        self.displacement = (
            blocks.zeros() if old is None else blocks.prolonged(old, self.multigrid.ghost_rules)
        )

    def _spawn(self, marked: Flags) -> None:
        before = self.blocks.forest
        split = np.zeros(len(before), dtype=np.bool_)
        split[before.leaves[marked]] = True
        self._stand(BlockOperator(before.refined(split, len(self.generations))), self.displacement)

    def _solve(self, *, for_good: bool) -> tuple[Iteration, float]:
        # Corrections estimate the error before the last cycle, which has reduced it once more.
        share = min(ON_THE_WAY * self.error, WORST)

        def done(run: Iteration) -> bool:
            if not for_good:
                return self._reduction * run.errors[-1] <= share
            return max(run.residuals[-1], run.errors[-1]) <= LAST

        load, u = self.blocks.load, self.displacement
        run = self.multigrid.solve(load, u, done)
        if not run.converged and self.multigrid.real is not np.float64:
            self.multigrid = BlockCycle(self.blocks, self.root, np.float64)
            run = self.multigrid.solve(load, u, done)
        symmetrise(self.blocks, u, self._mirrors)
        return run, self._reduction * run.errors[-1]

    def _expect_bounds(self) -> None:
        # Bounds of blocks that have not settled would say little.
        if self._due(*BOUNDED_EARLY[self.ground.dimension]):
            self._settle(for_good=True)
            self._measure_share(settled=True)
            self.aimed = self.aim.estimate(self)
            if self._share != PROVED_AT[self.ground.dimension]:
                self.spare = MEASURED

    def _estimate(self) -> tuple[float, Floats, Floats]:
        u, loaded = self.displacement, self.blocks.loaded
        energy = 0.5 * dot(self.blocks.load[loaded].ravel(), u[loaded].ravel())
        self.blocks.fill_coarse(u)
        return energy, *self.blocks.errors(u)

    def _bound_cells(self) -> BoundCells:
        return boxes_of_blocks(self.blocks, self.displacement)


def mirrors(blocks: BlockOperator) -> tuple[int, ...]:
    """Return the axes along which body, supports and loads are symmetric."""
    forest = blocks.forest
    found = []
    largest = float(np.abs(blocks.load).max(initial=0.0))
    for axis in range(forest.dimension):
        partner, mirrored = partners(forest, axis), offsets(forest.dimension)
        if (partner < 0).any():
            continue
        # Column of every mirrored offset: offsets (-1, 0, 1) are counted in base three.
        mirrored[:, axis] *= -1
        column = (mirrored + 1) @ 3 ** np.arange(forest.dimension)
        alike = np.array_equal(forest.kinds[forest.leaves][:, column], forest.kinds[partner])
        off = np.abs(_image(blocks, blocks.load, axis, partner) - blocks.load[forest.leaves])
        off *= blocks.types.mask[blocks.type_of[1, forest.leaves]]
        if alike and float(off.max(initial=0.0)) <= ROUNDING * largest:
            found.append(axis)
    return tuple(found)


def partners(forest: Forest, axis: int) -> Ints:
    """Return the images of the leaf blocks along an axis, -1 where there is none."""
    lower, size = forest.lower[forest.leaves], forest.size[forest.leaves] * ACROSS
    # The image's lower corner is the mirrored upper one; it is found among the sorted codes.
    image = lower.copy()
    ends = lower[:, axis] + size
    image[:, axis] = lower[:, axis].min() + ends.max() - ends
    code = morton(lower)
    at = np.minimum(np.searchsorted(code, morton(image)), len(code) - 1)
    alike = np.all(lower[at] == image, axis=1) & (size[at] == size)
    return np.where(alike, forest.leaves[at], -1)


def symmetrise(blocks: BlockOperator, u: Floats, axes: tuple[int, ...]) -> None:
    """Replace a displacement by the mean of itself and its images, in place."""
    leaves = blocks.forest.leaves
    for axis in axes:
        partner = partners(blocks.forest, axis)
        if (partner < 0).any():
            continue
        mean = 0.5 * (u[leaves] + _image(blocks, u, axis, partner))
        u[leaves] = mean * blocks.types.mask[blocks.type_of[1, leaves]]


def _image(blocks: BlockOperator, u: Floats, axis: int, partner: Ints) -> Floats:
    """Return the leaf blocks' image, shape (leaves, dimension, places)."""
    d = blocks.forest.dimension
    u = u.copy()
    kernels.exchange_halos(u, blocks.forest.beside, blocks.layout.halo)
    own = u[partner].reshape(len(partner), d, *(PLACES,) * d)
    image = np.flip(own, axis=axis + 2).copy()
    # A cell's lower face is its image's upper one (one place on), with the opposite displacement.
    normal = np.roll(image[:, axis], 1, axis=axis + 1)
    image[:, axis] = -normal
    return image.reshape(len(partner), d, -1)
