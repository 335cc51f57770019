"""The generations of agents: how each settles, what is kept of it, and how the tree grows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ResultError
from kaju.model.elastic.moduli import by_law, equivalent_stress, is_rubber
from kaju.model.elastic.pair.border import Sides, check_held, sides_of
from kaju.model.elastic.pair.displacement import moved_by, way_of
from kaju.model.elastic.pair.elements import DEEPEST_STEP, child_maps
from kaju.model.elastic.pair.leaf_mesh import Mesh, mesh_of
from kaju.model.elastic.pair.leaves import BITS, LeafCells, corners
from kaju.model.elastic.pair.levels import DIRECT, FieldLevel, descent, handed_down, level_of
from kaju.model.elastic.pair.opinions import Opinions, balance
from kaju.model.elastic.pair.space import SETTLED, Bricks, hats_of
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.results.stored import Column

DIRECT_RUBBER = 60_000
"""So many in the plane where a material is nearly incompressible, which levels do not smooth."""

Settled = Opinions | Bricks
Aim = Callable[[Mesh, Sides, Floats, Floats], list[Sides]]
"""Lays loads on a generation, by its mesh, sides, sizes and law: those whose work a goal is."""


def settled(
    body: PosedBody, leaves: LeafCells, before: Settled | None = None, aims: Sequence[Aim] = ()
) -> Settled:
    """Return agents whose opinions are of least energy, but for what the gap allows."""
    # They are parts of those of the generation before, which this one corrects.
    d, mesh = body.dimension, mesh_of(leaves)
    sides, maps = sides_of(body, mesh), child_maps(False, d)
    law = np.stack([modulus[leaves.kind] for modulus in body.moduli])
    laws = by_law(law)
    family = None
    if before is None:
        check_held(body, mesh, sides)
    else:
        family = descent(before.leaves, leaves)
        mesh.part = before.mesh.part[family[0]]
    # Loads and supports that move, each by themselves, then loads of goals: of the same equations.
    kind: Any = Opinions if d == 2 else Bricks
    acts, size = sides.cases, leaves.size / body.cell
    loads = [*acts, *(one for aim in aims for one in aim(mesh, sides, size, law))]
    fields: list[Any] = [kind(body, mesh, one, law, laws) for one in loads]
    olds: list[Any] = [*before.cases, *before.duals] if before else [None] * len(loads)
    blocks, gaps = fields[0].blocks, [0.5 * float(old.shares.sum()) if old else 0.0 for old in olds]
    rubber, free = d == 2 and is_rubber(body.moduli, body.scene.plane), way_of(mesh, sides)
    direct = DIRECT_RUBBER if rubber else DIRECT
    if d == 3 and before is None and len(free[1]) > direct:
        level = FieldLevel(blocks, free[0], *hats_of(fields[0], *free))
    else:
        level = level_of(blocks, free, before.levels[0] if before else None, family, maps, direct)
    for field, old, gap in zip(fields, olds, gaps, strict=True):
        field.blocks, field.fit = blocks, np.zeros((len(leaves), d * maps.shape[1]))
        if old is not None and family is not None:
            field.fit = handed_down(old.fit, family, maps)
        if field.sides.moved.any():
            field.fit = moved_by(mesh, field.sides, blocks.shared(field.fit))
        field.settle(level, gap if d == 2 else SETTLED * gap)
    levels = [level]
    if d == 2:
        above = before.levels[1] if before else None
        levels.append(balance(fields, olds, gaps, family, above, direct))
    answer: Settled = fields[0]
    if len(acts) > 1:
        answer = kind(body, mesh, sides, law, laws)
        answer.become_sum(fields[:2])
    if isinstance(before, Bricks) and isinstance(answer, Bricks):
        answer.earlier = float(before.shares.sum()), before.energy
    answer.levels, answer.duals = tuple(levels), tuple(fields[len(acts) :])
    return answer


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


def generation_of(found: Any, chosen: Flags, proved: bool) -> Generation:
    """Return what is kept of a generation of which some agents are to spawn."""
    bounds, body, leaves = found.bounds, found.body, found.leaves
    balanced, fitted = (
        equivalent_stress(stress, body.moduli, leaves.kind, body.asked.plane)
        for stress in found.means
    )
    lower, upper = (bounds.lower, bounds.upper) if proved else (None, None)
    arrays = (leaves.code, leaves.size, found.shares, fitted, balanced, chosen)
    return Generation(bounds.error, bounds.energy, lower, upper, *arrays)


def trees_of(
    first: LeafCells, generations: list[Generation], whole: bool = True
) -> list[LeafCells]:
    """Return the agents of stored generations; refuse some that are not parts of the first ones.

    Within outlines they need not fill these (be `whole`), and halve as often as it takes.
    """
    d, trees, sound = first.dimension, [first], bool(generations)
    for number, one in enumerate(generations):
        leaves, code, size = trees[-1], one.code, one.size
        parent = np.searchsorted(leaves.code, code, "right") - 1
        ratio = leaves.size[parent] // np.maximum(size, 1)
        # They lie side by side, in parents, and fill these.
        sound = sound and bool(np.all(np.diff(code) >= size[:-1] ** d) and np.all(parent >= 0))
        sound = sound and bool(np.all(ratio * size == leaves.size[parent]))
        sound = sound and bool(np.all((code - leaves.code[parent]) % size**d == 0))
        most = BITS[d] if not whole else DEEPEST_STEP if number else 0
        sound = sound and bool(np.all(np.isin(ratio, 2 ** np.arange(most + 1))))
        if sound and whole:
            filled = np.bincount(parent, (size / leaves.size[parent]) ** d, len(leaves))
            sound = bool(np.all(np.abs(filled - 1.0) < 1e-9))
        if not sound:
            break
        trees.append(LeafCells(corners(code, d), size, leaves.kind[parent], code))
        sound = not whole or len(trees[-1].balanced()) == len(code)
    if not sound:
        raise ResultError("its agents do not stand side by side in the body")
    return trees[1:]
