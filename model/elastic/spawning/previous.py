"""Agents that a previous answer has left, and what becomes of them where something was changed."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ParameterError
from kaju.model.elastic.krylov import dot
from kaju.model.elastic.problem import ACTIVE

from .aims import Aimed
from .balance import Balance
from .composite import Composite
from .field import interpolation
from .generations import Spawning
from .ground import Ground
from .held import HALVED, first_agents
from .leaves import Leaves
from .retire import even_share, retired

WORTHWHILE = 0.85
"""Agents retire if no more than this share is left of those that there would be otherwise."""
LEAST = 0.4
"""Spawning once leaves at least this share of an error."""


class Standing(NamedTuple):
    """Agents before they settle."""

    balance: Balance
    displacement: Floats
    """Where they start from. Shape (faces,)."""
    notes: list[str]


def check_previous(previous: Ground, ground: Ground) -> None:
    """Refuse agents that stand on other cells."""
    cells = [
        f"{' x '.join(map(str, g.scene.lattice.shape))} cells of {g.scene.lattice.cell_size:g} m"
        for g in (previous, ground)
    ]
    if previous.scene.lattice != ground.scene.lattice:
        raise ParameterError(
            f"previous: its agents stand on {cells[0]}, those of the scene on {cells[1]}; solve "
            "without it, or at the same resolution"
        )


class Heirs:
    """Agents on new ground that begin with those of a previous answer, `before`."""

    def __init__(self, ground: Ground, before: Leaves) -> None:
        self.ground, self.before = ground, before

    @cached_property
    def first(self) -> tuple[Balance, list[str]]:
        """The agents that would be the first ones otherwise, and what is to be noted."""
        return first_agents(self.ground)

    def take_up(self, previous: Spawning) -> Standing:
        """Return the agents of the previous answer."""
        # On the same body they stay as they are. Where it changed they are kept as far as they lie
        # inside of what the first agents would be.
        old, ground = previous.balance, self.ground
        if of_same_body(old, ground):
            balance = old.loaded_by(ground)
            balance.grid.leaves = balance.grid.leaves.as_first()
            start = previous.displacement * _unit(old.grid.ground, ground)
            notes = [note for note in previous.notes if note.endswith(HALVED)]
            return Standing(balance, _scaled(balance, start), notes)
        return self._stand(self._placed(old.grid.leaves), old, previous.displacement)

    def regroup(self, balance: Balance, u: Floats, aimed: Aimed) -> Standing | None:
        """Let agents retire that are not needed, and others spawn, after they have settled."""
        # None if those that stand may as well stay.
        leaves, part, ground = balance.grid.leaves, aimed.part, self.ground
        allowed = max(aimed.allowed, LEAST * float(part.sum()))
        share = even_share(leaves, part, allowed, ground.smallest)
        fewer, part = retired(leaves, part, share)
        spawning = (part > share) & (fewer.size > ground.smallest)
        wanted = fewer.split(spawning, 0, np.zeros(len(fewer)))
        children = (1 << leaves.dimension) - 1
        enough = WORTHWHILE * (len(leaves) + children * np.count_nonzero(aimed.chosen))
        unfit = ground.unevenly_loaded(leaves).any()
        if len(wanted) > enough and not unfit:
            return None
        placed = self._placed(wanted)
        return None if len(placed) > enough and not unfit else self._stand(placed, balance, u)

    def retired(self, now: Leaves) -> int:
        """Return for how many of the previous agents a larger one stands now."""
        at = now.find(self.before.lower)
        return int(np.count_nonzero((at >= 0) & (now.size[at] > self.before.size)))

    def _placed(self, leaves: Leaves) -> Leaves:
        return refined_by(self.first[0].grid.leaves, leaves, self.ground.smallest).balanced(0)

    def _stand(self, leaves: Leaves, old: Balance, u: Floats) -> Standing:
        balance = Balance(Composite(self.ground, leaves))
        start = _scaled(balance, carried(old, u, balance.grid))
        return Standing(balance, start, list(self.first[1]))


def of_same_body(old: Balance, ground: Ground) -> bool:
    """Tell whether agents may stay as they are, whatever their loads."""
    grid, before = old.grid, old.grid.ground
    same = ground.scene.same_body(before.scene) and grid.leaves.size.min() >= ground.smallest
    moved = grid.value.any() or old.offset.any()
    return same and (not moved or ground.scales == before.scales)


def refined_by(first: Leaves, kept: Leaves, smallest: int) -> Leaves:
    """Return the first agents, as small as those kept inside of them: all of them new."""
    d = first.dimension
    owner = first.find(kept.lower)
    inside = (owner >= 0) & (kept.size < first.size[owner]) & (kept.size >= smallest)
    owner, parts = owner[inside], kept.only(inside)
    volume = np.zeros(len(first), dtype=np.int64)
    np.add.at(volume, owner, parts.size**d)
    whole = volume == first.size**d
    partly = (volume > 0) & ~whole
    split = _split_down(first.only(partly), parts.only(partly[owner]))
    groups = [first.only(volume == 0), parts.only(whole[owner]), split]
    lower = np.concatenate([group.lower for group in groups])
    size = np.concatenate([group.size for group in groups])
    zeros = np.zeros(len(size))
    kind = first.kind[first.find(lower)]
    return Leaves.of(lower, size, kind, zeros.astype(np.int64), zeros)


def _split_down(leaves: Leaves, parts: Leaves) -> Leaves:
    """Split leaves until none is larger than a part inside of it."""
    while len(parts):
        owner = leaves.find(parts.lower)
        larger = leaves.size[owner] > parts.size
        chosen = np.zeros(len(leaves), dtype=np.bool_)
        chosen[owner[larger]] = True
        leaves = leaves.split(chosen, 0, np.zeros(len(leaves)))
        parts = parts.only(larger)
    return leaves


def _unit(old: Ground, new: Ground) -> float:
    return old.scales.displacement / new.scales.displacement


def carried(old: Balance, u: Floats, grid: Composite) -> Floats:
    """Return the displacement of old agents at the faces of new ones; 0 where there were none."""
    leaves, found = grid.leaves, grid.value.copy()
    for axis in range(grid.dimension):
        face = np.flatnonzero((grid.axis == axis) & (grid.state == ACTIVE))
        owner, place = grid.owner[face], grid.place[face]
        lower, size = leaves.lower[owner], leaves.size[owner, None]
        cell = np.clip(np.floor(place).astype(np.int64), lower, lower + size - 1)
        held = old.grid.leaves.find(cell)
        there = held >= 0
        face, place, held = face[there], place[there], held[there]
        matrix, constant = interpolation(old.grid, place.astype(np.float64), held, axis)
        found[face] = (matrix @ u + constant) * _unit(old.grid.ground, grid.ground)
    return found


def _scaled(balance: Balance, u: Floats) -> Floats:
    """Return the multiple of the free faces' displacements that is nearest to the solution."""
    free, grid = balance.free, balance.grid
    x = np.where(grid.state == ACTIVE, u, 0.0)
    right = (balance.load - balance.pull)[free]
    force = balance.strains.T @ balance.stress(balance.strains @ x) + grid.spring * x
    whole = float(dot(x, force))
    share = float(dot(x[free], right)) / whole if whole > 0.0 else 0.0
    return np.where(grid.state == ACTIVE, share * x, grid.value)
