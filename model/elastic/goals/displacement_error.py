"""The largest displacement error anywhere, and the agents that spawn to make it smaller.

The stiffness K of the agents lacks what the displacement curves within them: C'C, if C u are
the second differences whose squares the indicator adds up. So the force C'C u is missing in
the balance, and the displacement is off by about

    e = (K + C'C)⁻¹ C'C u

everywhere, also far from where it curves. An agent's own field adds what it cannot represent:
the energy η² of its error over its own stiffness μ h^(d-2), as a displacement. Both have a
factor, found on 22 bodies in two and three dimensions: there the largest sum of all agents is
0.6 to 2.6 times the true largest error, but for the first few agents of one ragged body (4.1).

That is enough to mark agents. The estimate for a result comes from children: from how far they move
when every agent has spawned once.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats
from kaju.model.elastic.bounds.energy_bounds import EnergyBounds
from kaju.model.elastic.cells.cell_equilibrium import Equilibrium
from kaju.model.elastic.cells.cell_fields import CellFields, displacement_at
from kaju.model.elastic.cells.composite_grid import CompositeGrid
from kaju.model.elastic.equal.krylov import Iteration, dot
from kaju.model.elastic.multigrid.nested import NestedMultigrid, settle
from kaju.model.elastic.refine.estimator import Curvature, Indicator
from kaju.model.elastic.refine.refine_loop import RefineLoop, Target
from kaju.model.elastic.refine.targets import SPARE, Aimed

FAR, LOCAL = 1.6, 1.1  # Factors of the two parts
SURE, OF_GAP = 1.5, 0.35
"""The result's error is so many times the estimate, or at least this share of the energy's gap."""
OF_CHILDREN = 2.6
"""The result's error is so many times what children change: at sharp corners that is a third."""
MOST_SPLIT = {2: 100_000, 3: 8_000}  # Of more agents no children are tried
INSIDE = 1e-3
"""So far from an agent's corners its displacement is compared, as a share of its edge."""
SETTLED = 1e-4  # Children settle to this share
ACCURACY, ROUGHLY = 1e-6, 0.02
"""To which share of itself the far-reaching part is solved: for the result, while spawning."""
BEHIND = 0.125  # Agents whose own part is a smaller share of the largest one wait for the next step


class DisplacementError(NamedTuple):
    """Estimated displacement errors of the agents, relative to the largest displacement."""

    far: Floats  # What comes from the curvature of all agents. Shape (agents,)
    local: Floats  # What each cannot follow within itself. Shape (agents,)

    @property
    def largest(self) -> float:
        """The largest displacement error of all."""
        return float((self.far + self.local).max())


def told_error(
    balance: Equilibrium, u: Floats, indicator: Indicator, bracket: EnergyBounds | str
) -> float:
    """Return a displacement error that the true one hardly exceeds."""
    # Where stiff parts nearly touch, not even children see what lies between them; the bounds of
    # the energy do.
    grid, hierarchy = balance.grid, NestedMultigrid(balance)
    if len(grid.leaves) > MOST_SPLIT[grid.dimension]:
        error = SURE * displacement_error(balance, u, indicator, hierarchy).largest
    else:
        error = OF_CHILDREN * changed_by_children(balance, u, hierarchy)
    if isinstance(bracket, str) or not bracket.upper > 0.0:
        return error
    gap = (bracket.upper - bracket.lower) / (bracket.upper + bracket.lower)
    return max(error, OF_GAP * gap)


def changed_by_children(balance: Equilibrium, u: Floats, hierarchy: NestedMultigrid) -> float:
    """Return how far children of all agents move corners and middles of theirs, relative."""
    # They become the finest level of the hierarchy.
    grid, leaves = balance.grid, balance.grid.leaves
    largest = float(np.linalg.norm(CellFields(balance, u).displacement, axis=1).max())
    if largest == 0.0:
        return 0.0
    young = leaves.split(leaves.size > 1, 0, np.zeros(len(leaves))).balanced(0)
    finer = Equilibrium(CompositeGrid(grid.ground, young))
    moved = hierarchy.grow(finer, u)
    settle(finer, hierarchy, moved, SETTLED)
    old, new, away = CellFields(balance, u), CellFields(finer, moved), 0.0
    for at in [*product((INSIDE, 1.0 - INSIDE), repeat=grid.dimension), (0.5,)]:
        place = leaves.lower + np.array(at) * leaves.size[:, None]
        child = young.find(np.floor(place).astype(np.int64))
        change = displacement_at(new, place, child)
        change -= displacement_at(old, place, np.arange(len(leaves)))
        away = max(away, float(np.linalg.norm(change, axis=1).max()))
    return away / largest


def displacement_error(
    balance: Equilibrium,
    u: Floats,
    indicator: Indicator,
    hierarchy: NestedMultigrid,
    accuracy: float = ACCURACY,
) -> DisplacementError:
    """Return how far off the displacement of each agent is."""
    # The balance is the finest generation of the hierarchy; the far-reaching part is solved to a
    # share `accuracy` of itself.
    grid = balance.grid
    largest = float(np.linalg.norm(CellFields(balance, u).displacement, axis=1).max())
    unit = 1.0 / largest if largest > 0.0 else 0.0
    # (K + C'C)⁻¹ C'C u: along the solution of K alone, to the least energy of both. Where little
    # but bending within the agents resists, K alone goes much too far.
    curvature, free = Curvature(balance), balance.free
    force = curvature.force(curvature.of(u))[free]
    off = np.zeros(grid.size)

    def done(run: Iteration) -> bool:
        return run.errors[-1] <= accuracy

    off[free] = hierarchy.solve(force, off[free], done).solution
    second = curvature.of(off, curvature.resting)
    work = float(dot(force, off[free]))
    whole = work + float(curvature.energy(second, second).sum())
    off *= work / whole if whole > 0.0 else 0.0
    far = np.linalg.norm(CellFields(balance, off).displacement, axis=1)
    stiffness = grid.law.shear * grid.length ** (grid.dimension - 2)
    local = np.sqrt(indicator.square / stiffness)
    return DisplacementError(FAR * unit * far, LOCAL * unit * local)


class DisplacementTarget(Target):
    """The largest displacement error anywhere, relative to the largest displacement."""

    def estimate(self, spawner: RefineLoop) -> Aimed:
        """Return the estimated error of settled agents, and the marks for the next generation."""
        balance, square = spawner.balance, spawner.indicator.square
        error = displacement_error(
            balance, spawner.displacement, spawner.indicator, spawner.hierarchy, ROUGHLY
        )
        far, local = float(error.far.max()), float(error.local.max())
        wanted = SPARE * spawner.tolerance
        marked = _follows_badly(error, wanted)
        marked &= balance.grid.leaves.size > balance.grid.ground.smallest
        worst = int((error.far + error.local).argmax())
        allowed = max(wanted - float(error.local[worst]), 0.5 * wanted)
        if error.largest > wanted and far > allowed:
            marked |= spawner.mark(square, allowed / far * float(square.sum()))
        part = far * _share(square) + local * _share(error.local**2)
        allowed = wanted / error.largest if error.largest > 0.0 else 1.0
        return Aimed(error.largest, part, marked, allowed * float(part.sum()))


def _follows_badly(error: DisplacementError, wanted: float) -> Flags:
    """Tell which agents' local part exceeds what the far part leaves, and half of the tolerance."""
    own = np.maximum(wanted - error.far, 0.5 * wanted)
    return np.asarray(error.local > np.maximum(own, BEHIND * error.local.max()))


def _share(part: Floats) -> Floats:
    return part / (part.sum() or 1.0)
