"""The generations of agents: what is kept of each, and how the tree grows from one to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultFileError
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.pair.elements import DEEPEST_STEP
from kaju.model.elastic.pair.leaves import LeafCells, corners
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.elastic.scales import Scales
from kaju.model.results.archive import Archive
from kaju.model.scene import Scene


class Generation(NamedTuple):
    """One step of spawning: figures of all agents together, then arrays with a row for each."""

    agents: int
    error: float
    """In the energy norm, relative: in the plane proved, in space estimated."""
    energy: float
    """Of the body (J): in the plane the middle of the bounds, in space below the true one."""
    lower: float
    """Bounds of the energy (J); NaN in space."""
    upper: float
    code: Ints
    """Morton code of every agent's lower corner."""
    size: Ints
    """Edge (units) of every agent."""
    gap: Floats
    """What its two opinions differ in, squared (J): its part of the squared error."""
    fitted: Floats
    """Equivalent stress (Pa) of the opinion that fits, in the mean over the agent."""
    balanced: Floats
    """That of the opinion that balances; NaN in space, where there is none."""
    chosen: Flags
    """Which agents spawn in the next step because of their gap."""

    def __repr__(self) -> str:
        """Return its figures without the arrays."""
        return f"Generation(agents={self.agents}, error={self.error:.3g}, energy={self.energy:.6g})"

    def in_units(self, energy: float, stress: float) -> Generation:
        """Return it with energies and stresses times units of these."""
        names = {"energy": energy, "lower": energy, "upper": energy, "gap": energy}
        names |= {"fitted": stress, "balanced": stress}
        return self._replace(**{name: unit * getattr(self, name) for name, unit in names.items()})


FIGURES = 5  # So many figures stand before the arrays
_ARRAYS: dict[str, tuple[Any, dict[str, Any]]] = {
    "code": ("i", {"low": 0, "high": (1 << 62) - 1}),
    "size": ("i", {"low": 1}),
    "gap": ("f", {"low": 0.0}),
    "fitted": ("f", {"low": 0.0}),
    "balanced": ("f", {"finite": False}),
    "chosen": ("b", {}),
}


def halvings(size: Ints, largest: int) -> Ints:
    """Return how often the largest edge would be halved to give each edge (units)."""
    return np.asarray(np.rint(np.log2(largest / size)), dtype=np.int64)


def family_of(
    before: LeafCells, code: Ints, size: Ints, gap: Floats, chosen: Flags
) -> tuple[Ints, Ints, Floats]:
    """Return the parents of the agents of the next generation, their steps and their causes."""
    parent = np.searchsorted(before.code, code, "right") - 1
    ratio = before.size[parent] // size
    step = np.where(ratio > 1, before.step.max(initial=0) + 1, before.step[parent])
    # Of a child whose parent spawned in the same step nobody knew the gap.
    own = np.where(chosen[parent] & (ratio == 2), gap[parent], np.nan)
    return parent, step, np.where(ratio > 1, own, before.cause[parent])


def stored(generations: list[Generation]) -> dict[str, NDArray[Any]]:
    """Return what is stored of generations: figures, and arrays one after another."""
    arrays: dict[str, NDArray[Any]] = {
        f"history.{name}": np.concatenate([getattr(one, name) for one in generations])
        for name in _ARRAYS
    }
    return arrays | {"history.figures": np.array([one[:FIGURES] for one in generations])}


def generations_of(archive: Archive) -> list[Generation]:
    """Return the stored generations."""
    figures = archive.array("history.figures", "f", (None, FIGURES), finite=False)
    count = np.nan_to_num(figures[:, 0]).astype(np.int64)
    if not len(count) or count.min() < 1:
        raise ResultFileError(f"{archive.path}: 'history.figures' must name agents")
    columns = [
        archive.array(f"history.{name}", kind, (int(count.sum()),), **rule)
        for name, (kind, rule) in _ARRAYS.items()
    ]
    parts = [np.split(column, np.cumsum(count)[:-1]) for column in columns]
    return [
        Generation(int(agents), *own, *part)
        for (agents, *own), *part in zip(figures.tolist(), *parts, strict=True)
    ]


def trees_of(archive: Archive, first: LeafCells, generations: list[Generation]) -> list[LeafCells]:
    """Return the agents of stored generations; refuse some that are not parts of the first ones."""
    d, leaves = first.dimension, first
    nothing = np.zeros(len(first))
    trees = [replace(first, step=nothing.astype(np.int64), cause=nothing)]
    sound = np.array_equal(generations[0].code, first.code)
    sound = sound and np.array_equal(generations[0].size, first.size)
    for last, one in pairwise(generations):
        if not sound:
            break
        code, size = one.code, one.size
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
            _, step, cause = family_of(leaves, code, size, last.gap, last.chosen)
            own = corners(code, d), size, leaves.kind[parent], step, cause, code
            leaves = LeafCells(*own)
            sound = len(leaves.balanced(0)) == len(leaves)
            trees.append(leaves)
    if not sound:
        raise ResultFileError(
            f"{archive.path}: its agents do not stand side by side in the body: the file is "
            "damaged; compute it again"
        )
    return trees


class GrownAgents:
    """What agents of many sizes tell in the plane and in space alike; scaled."""

    generations: list[Generation]

    if TYPE_CHECKING:  # what either has of its own

        @property
        def ground(self) -> PosedBody:
            """The posed body."""

        @property
        def leaves(self) -> LeafCells:
            """The agents."""

        @property
        def _shape(self) -> tuple[Callable[[Floats], Floats], Floats, Floats]:
            """Shape functions, their numbers for each agent, and the shift of all."""

    @property
    def grid(self) -> Scene:
        """The scene on the cells that say where the body is."""
        return self.ground.scene

    @property
    def scales(self) -> Scales:
        """Units of the scaled values."""
        return self.ground.scales

    @property
    def moduli(self) -> Moduli:
        """Scaled moduli of every material."""
        return self.ground.moduli

    @property
    def count(self) -> int:
        """Number of agents."""
        return len(self.leaves)

    @property
    def lower(self) -> Floats:
        """Lower corners of the agents."""
        return np.asarray(self.leaves.lower / self.ground.cell)

    @property
    def size(self) -> Floats:
        """Edges of the agents."""
        return np.asarray(self.leaves.size / self.ground.cell)

    @property
    def material(self) -> Ints:
        """Index of each agent's material, which is that of its moduli."""
        return self.leaves.kind

    law = material

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        return halvings(self.leaves.size, int(self.generations[0].size.max()))

    @property
    def spawn_step(self) -> Ints:
        """Step in which each agent spawned; 0 for the first."""
        return self.leaves.step

    @property
    def farthest(self) -> float:
        """Largest displacement at corners, on sides and in the middles of agents."""
        values, moved, shift = self._shape
        places = 0.5 * np.array(list(product(range(3), repeat=moved.shape[2])))
        found = (np.tensordot(moved, row, (1, 0)) + shift for row in values(places))
        return max(float(np.linalg.norm(u, axis=1).max()) for u in found)

    @property
    def solution(self) -> Self:
        """Itself: it has the figures of its solution."""
        return self
