"""The generations of agents: what is kept of each, and how the tree grows from one to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.moduli import equivalent_stress
from kaju.model.elastic.pair.elements import DEEPEST_STEP
from kaju.model.elastic.pair.leaves import LeafCells, corners
from kaju.model.elastic.pair.settling import Settled
from kaju.model.results.stored import Column


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

    def in_units(self, energy: float, stress: float) -> Generation:
        """Return it with energies and stresses times units of these."""
        lower, upper = (x if x is None else energy * x for x in (self.lower, self.upper))
        return replace(
            self,
            energy=energy * self.energy,
            lower=lower,
            upper=upper,
            gap=energy * self.gap,
            fitted=stress * self.fitted,
            balanced=stress * self.balanced,
        )


def halvings(size: Ints, largest: int) -> Ints:
    """Return how often the largest edge would be halved to give each edge (units)."""
    return np.asarray(np.rint(np.log2(largest / size)), dtype=np.int64)


def generation_of(found: Settled, chosen: Flags) -> Generation:
    """Return what is kept of a generation of which some agents are to spawn."""
    bounds, body, leaves = found.bounds, found.body, found.leaves
    balanced, fitted = (
        equivalent_stress(stress, body.moduli, leaves.kind, body.scene.plane)
        for stress in found.means
    )
    lower, upper = (bounds.lower, bounds.upper) if body.dimension == 2 else (None, None)
    arrays = (leaves.code, leaves.size, found.shares, fitted, balanced, chosen)
    return Generation(bounds.error, bounds.energy, lower, upper, *arrays)


def trees_of(first: LeafCells, generations: list[Generation]) -> list[LeafCells]:
    """Return the agents of stored generations; refuse some that are not parts of the first ones."""
    d, trees = first.dimension, [first]
    sound = bool(generations) and np.array_equal(generations[0].code, first.code)
    sound = sound and np.array_equal(generations[0].size, first.size)
    for one in generations[1:]:
        if not sound:
            break
        leaves, code, size = trees[-1], one.code, one.size
        parent = np.searchsorted(leaves.code, code, "right") - 1
        ratio = leaves.size[parent] // np.maximum(size, 1)
        # They lie side by side, in parents, and fill these.
        sound = bool(np.all(np.diff(code) >= size[:-1] ** d) and np.all(parent >= 0))
        sound = sound and bool(np.all(np.isin(ratio, 2 ** np.arange(DEEPEST_STEP + 1))))
        sound = sound and bool(np.all(ratio * size == leaves.size[parent]))
        sound = sound and bool(np.all((code - leaves.code[parent]) % size**d == 0))
        filled = np.bincount(parent, (size / leaves.size[parent]) ** d, len(leaves))
        sound = sound and bool(np.all(np.abs(filled - 1.0) < 1e-9))
        if sound:
            trees.append(LeafCells(corners(code, d), size, leaves.kind[parent], code))
            sound = len(trees[-1].balanced()) == len(code)
    if not sound:
        raise ResultError("its agents do not stand side by side in the body")
    return trees
