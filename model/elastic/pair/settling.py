"""One generation of agents, settled: both opinions in the plane, one in space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.model.elastic.pair.border import Sides, check_held, sides_of
from kaju.model.elastic.pair.displacement import moved_by, way_of
from kaju.model.elastic.pair.elements import child_maps
from kaju.model.elastic.pair.leaf_mesh import Mesh, mesh_of
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.levels import FieldLevel, descent, handed_down, level_of
from kaju.model.elastic.pair.opinions import Opinions, balance
from kaju.model.elastic.pair.space import MOST_FACTORED, Bricks, Hats
from kaju.model.elastic.posed_body import PosedBody

DIRECT = {2: 4_000, 3: 1_500}
"""Up to so many unknowns factors are as quick as levels: measured on the plate, L and hole."""
DIRECT_RUBBER = 60_000
"""So many in the plane where a material is nearly incompressible, which levels do not smooth."""
INCOMPRESSIBLE = 20.0
"""C12 / mu from which on they do not: nu = 0.4875; measured on the rubber of the tests."""

Settled = Opinions | Bricks
Aim = Callable[[Mesh, Sides, Floats, Floats], Sides]
"""Gives, by the mesh, sides, sizes and law of a generation, the load whose work a goal is."""


def settled(
    body: PosedBody, leaves: LeafCells, before: Settled | None = None, aims: Sequence[Aim] = ()
) -> Settled:
    """Return agents whose opinions are of least energy, but for what the gap allows."""
    # They are parts of those of the generation before, which this one corrects.
    d, mesh = body.dimension, mesh_of(leaves)
    sides, maps = sides_of(body, mesh), child_maps(False, d)
    law = np.stack([modulus[leaves.kind] for modulus in body.moduli])
    if before is None:
        check_held(body, mesh, sides)
    family = descent(before.leaves, leaves) if before else None
    if before is not None and family is not None:
        mesh.part = before.mesh.part[family[0]]
    # The body's own loads, then those of the goals: all have the same equations.
    size = leaves.size / body.cell
    loads = [sides, *(aim(mesh, sides, size, law) for aim in aims)]
    olds: list[Any] = [before, *before.duals] if before else [None] * len(loads)
    fields: list[Any] = []
    for own, old in zip(loads, olds, strict=True):
        fit: Floats = np.zeros((len(own.cases), len(leaves), d * maps.shape[1]))
        if old is not None and family is not None:
            fit = np.stack([handed_down(one, family, maps) for one in old.fit])
        kind: Any = Opinions if d == 2 else Bricks
        fields.append(kind(body, mesh, own, law, fit))
        fields[-1].blocks = blocks = fields[0].blocks
        if own.moved.any():
            fit[-1] = moved_by(mesh, own, blocks.shared(fit[-1]))
    gaps = [0.5 * float(old.shares.sum()) if old else 0.0 for old in olds]
    found: Settled = fields[0]
    direct, free = DIRECT[d], way_of(mesh, sides)
    if d == 2 and np.any(law[1] > INCOMPRESSIBLE * law[2]):
        direct = DIRECT_RUBBER
    if d == 3 and before is None and len(free[1]) > MOST_FACTORED:
        hats: Any = Hats(fields[0], free[1])
        level = FieldLevel(blocks, free[0], hats, hats.rise)
    else:
        level = level_of(blocks, free, before.levels[0] if before else None, family, maps, direct)
    for own, gap in zip(fields, gaps, strict=True):
        own.settle(level, gap)
    found.levels, found.duals = (level,), tuple(fields[1:])
    if d == 2:
        above = before.levels[1] if before else None
        found.levels += (balance(fields, olds, family, gaps, above, direct),)
    else:
        for own, old in zip(fields, olds, strict=True):
            own.earlier = (float(old.shares.sum()), old.energy) if old else None
    return found
