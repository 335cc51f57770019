"""Moduli, masks and diagonals of blocks, stored once per type: for blocks with like neighbours.

Where agents of two sizes meet, the moduli of a type are zero: there the strains are irregular rows,
taken from the composite grid.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.multigrid.forest import ACROSS, COARSE, NOTHING, REFINED, REGULAR
from kaju.model.elastic.staggered import axis_pairs, modulus_between
from kaju.model.scene.cell_types import DISPLACED, RIGID, ROLLER

PLACES = ACROSS + 2


class BlockTypes(NamedTuple):
    """The law and the unknowns over the places of blocks, a row for every type."""

    cross: Floats  # C₁₂ of the cells. Shape (types, places)
    along: Floats  # C₁₁ - C₁₂. Shape (types, places)
    shear: Floats  # Modulus of the edges at the cells' lower corners. Shape (types, pairs, places)
    inverse: Floats
    """One over the diagonal of the stiffness, zero where no face is unknown. Shape (types,
    dimension, places)."""
    mask: Floats  # 1 where a face is unknown. Shape (types, dimension, places)
    diagonal: Floats  # Of the stiffness. Shape (types, dimension, places)


def block_types(kinds: Ints, states: Ints, moduli: Moduli) -> tuple[Ints, BlockTypes]:
    """Return every block's type, and these, by its neighbours' kinds and states (`forest`)."""
    seen = np.concatenate([kinds, states], axis=1)
    lots: Ints = np.random.default_rng(0).integers(1, 1 << 62, size=seen.shape[1:])
    _, first, type_of = np.unique((seen + 16) @ lots, return_index=True, return_inverse=True)
    if not np.array_equal(seen[first][type_of], seen):
        _, first, type_of = np.unique(seen, axis=0, return_index=True, return_inverse=True)
    return type_of.ravel(), _types_of(kinds[first], states[first], moduli)


def _types_of(kinds: Ints, states: Ints, moduli: Moduli) -> BlockTypes:
    d = int(np.rint(np.log(kinds.shape[1]) / np.log(3)))
    kind, state = _padded(kinds, d), _padded(states, d)
    counts = state == REGULAR
    for axis, step in product(range(d), (-1, 1)):
        counts &= _shifted(state, axis, step, NOTHING) != REFINED
    material = np.maximum(kind, 0)
    counts &= kind >= 0
    cross = np.where(counts, moduli.lateral[material], 0.0)
    along = np.where(counts, (moduli.stretch - moduli.lateral)[material], 0.0)
    shear = np.stack([_shear(kind, state, pair, moduli.shear) for pair in axis_pairs(d)], axis=1)
    mask = np.stack([_unknown(kind, state, axis) for axis in range(d)], axis=1)
    diagonal = np.zeros(mask.shape)
    for a in range(d):
        total = cross + along
        diagonal[:, a] = total + _shifted(total, a, -1, 0.0)
    for (a, b), modulus in zip(axis_pairs(d), np.moveaxis(shear, 1, 0), strict=True):
        diagonal[:, a] += modulus + _shifted(modulus, b, 1, 0.0)
        diagonal[:, b] += modulus + _shifted(modulus, a, 1, 0.0)
    inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=mask & (diagonal > 0))
    flat = [np.ascontiguousarray(a.reshape(*a.shape[: a.ndim - d], -1)) for a in
            (cross, along, shear, inverse, mask.astype(np.float64), diagonal)]  # fmt: skip
    return BlockTypes(*flat)


def _padded(values: Ints, d: int) -> Ints:
    """Spread values of a block and its neighbours over its places: (n, places, ..., places)."""
    step = np.ones(PLACES, dtype=np.int64)
    step[0], step[-1] = 0, 2
    way = np.zeros((PLACES,) * d, dtype=np.int64)
    for a in range(d):
        way += np.expand_dims(step * 3**a, tuple(b for b in range(d) if b != a))
    return np.asarray(values[:, way])


def _shifted(values: NDArray, axis: int, step: int, beyond: float) -> NDArray:  # type: ignore[type-arg]
    """Return the values one place further along an axis of the places."""
    d = values.ndim - 1
    moved = np.full_like(values, beyond)
    into, out = [slice(None)] * (d + 1), [slice(None)] * (d + 1)
    into[axis + 1] = slice(None, -1) if step > 0 else slice(1, None)
    out[axis + 1] = slice(1, None) if step > 0 else slice(None, -1)
    moved[tuple(into)] = values[tuple(out)]
    return moved


def _within(d: int, upper: tuple[int, ...]) -> Flags:
    """Mark places 1 … B along all axes, and B + 1 along some."""
    p = np.arange(PLACES)
    marked = np.ones((PLACES,) * d, dtype=np.bool_)
    for a in range(d):
        last = ACROSS + (a in upper)
        marked &= np.expand_dims((p >= 1) & (p <= last), tuple(b for b in range(d) if b != a))
    return marked


def _shear(kind: Ints, state: Ints, pair: tuple[int, int], shear: Floats) -> Floats:
    """Return the modulus of edges: none where agents of two sizes meet."""
    a, b = pair
    around = [(kind, state)]
    around += [(_shifted(kind, x, -1, -1), _shifted(state, x, -1, NOTHING)) for x in (b, a)]
    before = [_shifted(v, a, -1, e) for v, e in zip(around[1], (-1, NOTHING), strict=True)]
    # (a-, b-), (a-, b+), (a+, b-), (a+, b+)
    quads = [tuple(before), around[2], around[1], around[0]]
    modulus = modulus_between(np.stack([k for k, _ in quads]), shear)
    irregular = np.any([(s == COARSE) | (s == REFINED) for _, s in quads], axis=0)
    return np.where(irregular | ~_within(kind.ndim - 1, pair), 0.0, modulus)


def _unknown(kind: Ints, state: Ints, axis: int) -> Flags:
    """Mark faces that are a block's own and free to move."""
    d = kind.ndim - 1
    before, state_before = _shifted(kind, axis, -1, -1), _shifted(state, axis, -1, NOTHING)
    held = np.isin(kind, (RIGID, DISPLACED, ROLLER)) | np.isin(before, (RIGID, DISPLACED, ROLLER))
    own = _within(d, ()) & (state_before != REFINED)
    last = _within(d, (axis,)) & ~_within(d, ())
    own |= last & ((state == COARSE) | (state == NOTHING))
    return np.asarray(own & ((kind >= 0) | (before >= 0)) & ~held)


def ghost_rules(kinds: Ints, states: Ints) -> Ints:
    """Tell how displacements are extrapolated beyond sides of blocks: (blocks, 2·dimension)."""
    # 0: in another block; 1: linearly, beyond a free surface; 2: mirrored, beyond a wall.
    d = int(np.rint(np.log(kinds.shape[1]) / np.log(3)))
    rules = np.zeros((len(kinds), 2 * d), dtype=np.int64)
    for side in range(2 * d):
        way = 3**d // 2 + (2 * (side % 2) - 1) * 3 ** (side // 2)
        wall = np.isin(kinds[:, way], (RIGID, DISPLACED))
        rules[:, side] = np.where(states[:, way] == NOTHING, np.where(wall, 2, 1), 0)
    return rules
