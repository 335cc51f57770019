"""Which faces are coupled on every level of a hierarchy, and how P'AP follows from level to level.

A level's stiffness is an array of coefficients: entry e = (a, b, d) couples the face of
component a at place q with the face of component b at q + d. It is symmetric, so b > a is
stored, and for b = a only half of the offsets. P'AP (Galerkin's condition) is formed one axis after
the other: along its normal a face follows its coarse faces by (1 | ½ ½), across it by (¾ ¼),
everywhere. Beyond the surface there are coarse faces too, *ghosts*, as unknowns like any others, so
that free surfaces and walls need no weights of their own.

Places have three axes; a plane has only one place along the middle one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints

Offset = tuple[int, int, int]
Entry = tuple[int, int, Offset]
"""Two components and the offset from the first's face to the second's."""

NORMAL = {-1: 0.5, 0: 1.0, 1: 0.5}
ACROSS = {-1: 0.25, 0: 0.75, 1: 0.75, 2: 0.25}
"""Weights of a coarse face for fine ones, by their distance from twice its place."""
TOGETHER = 4  # Terms that are added at once


class Terms(NamedTuple):
    """Sums of weighted rows: `place` (sum, row, entry, shift) and `weight` of every term."""

    place: Ints  # Ordered by sums, `TOGETHER` to the group. Shape (terms, 4)
    weight: Floats  # Shape (terms,)
    rows: Ints  # The rows that terms name, by their distance along the first two axes. Shape (n, 2)
    sums: int  # Number of sums


class Stencil(NamedTuple):
    """The entries of one level and how they couple its faces."""

    entries: tuple[Entry, ...]
    couplings: Ints
    """Component, other component, offset of the other, entry, offset of where it is stored: an
    entry serves its own row and, mirrored, the other one. A component's first is its own. Shape
    (couplings, 9)."""
    starts: Ints  # First coupling of every component, and the end
    own: Ints
    next: Ints
    """Entries of a face with itself, and with its next in the row."""


def axes_of(dimension: int) -> tuple[int, ...]:
    """Return the axes of places that components are normal to."""
    return (0, 2) if dimension == 2 else (0, 1, 2)


def _unit(axis: int, length: int = 1) -> Offset:
    first, second, third = (length * (axis == k) for k in range(3))
    return first, second, third


def _add(one: Offset, other: Offset) -> Offset:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _opposite(offset: Offset) -> Offset:
    return -offset[0], -offset[1], -offset[2]


@lru_cache
def finest_entries(dimension: int) -> tuple[tuple[Entry, ...], Ints]:
    """Return the entries of the finest level, and what they are made of."""
    # An entry is sign · (modulus + modulus) / 2 or the whole sum; the columns are: sign (±1 for a
    # sum, 0 for one modulus taken negative, 2 for the diagonal), then twice a row of the law (0:
    # C₁₁, 1: C₁₂, 1 + a + b: the edges between components) and the axis along which it is shifted,
    # with the length of the shift.
    axes = axes_of(dimension)
    entries: list[Entry] = []
    made: list[tuple[int, ...]] = []

    def note(a: int, b: int, offset: Offset, sign: int, *moduli: tuple[int, int, int]) -> None:
        entries.append((a, b, offset))
        made.append((sign, *moduli[0], *moduli[-1]))

    for a in range(dimension):
        along = axes[a]
        note(a, a, (0, 0, 0), 2, (0, 0, 0))
        note(a, a, _unit(along), 0, (0, 0, 0))
        note(a, a, _unit(along, -1), 0, (0, along, -1))
        for b in range(dimension):
            if b != a:
                note(a, a, _unit(axes[b]), 0, (1 + a + b, axes[b], 1))
                note(a, a, _unit(axes[b], -1), 0, (1 + a + b, 0, 0))
        for b in range(a + 1, dimension):
            edge, side, back = 1 + a + b, axes[b], _unit(along, -1)
            note(a, b, (0, 0, 0), 1, (1, 0, 0), (edge, 0, 0))
            note(a, b, _unit(side), -1, (1, 0, 0), (edge, side, 1))
            note(a, b, back, -1, (1, along, -1), (edge, 0, 0))
            note(a, b, _add(_unit(side), back), 1, (1, along, -1), (edge, side, 1))
    return tuple(entries), np.array(made, dtype=np.int64)


@lru_cache
def coarsening(dimension: int, depth: int) -> tuple[tuple[Terms, ...], Stencil]:
    """Return the sums, axis by axis, that lead to the level at a depth, and its stencil."""
    if depth > 3:
        return coarsening(dimension, 3)  # From there on all levels are alike.
    if depth == 1:
        entries = finest_entries(dimension)[0]
        sources = {entry: ((0, 0), slot, 0) for slot, entry in enumerate(entries)}
    else:
        entries = coarsening(dimension, depth - 1)[1].entries
        sources = {}
        for slot, (a, b, way) in enumerate(entries):
            sources[a, b, way] = ((0, 0), slot, 0)
            if a == b and any(way):
                back = _opposite(way)
                sources[a, b, back] = ((back[0], back[1]), slot, back[2])
    steps = []
    for axis in axes_of(dimension):
        terms, entries = _step(dimension, axis, sources)
        steps.append(terms)
        sources = {entry: ((0, 0), slot, 0) for slot, entry in enumerate(entries)}
    return tuple(steps), stencil_of(dimension, entries)


def _step(
    dimension: int, axis: int, sources: dict[Entry, tuple[tuple[int, int], int, int]]
) -> tuple[Terms, tuple[Entry, ...]]:
    """Return the sums that coarsen one axis, and the entries that they make."""
    axes = axes_of(dimension)
    found: dict[Entry, list[tuple[tuple[int, int], int, int, float]]] = {}
    for (a, b, way), (row, slot, shift) in sources.items():
        ours, theirs = (NORMAL if axes[c] == axis else ACROSS for c in (a, b))
        for fine, weight in ours.items():
            for other, other_weight in theirs.items():
                between = fine + way[axis] - other
                if between % 2:
                    continue
                new = _add(way, _unit(axis, between // 2 - way[axis]))
                # An offset whose first step, up to the axis, is backward is stored the other way.
                if a == b and next((step < 0 for step in new[: axis + 1] if step), False):
                    continue
                if axis == 2:  # Rows were split into even and odd places.
                    source = ((fine % 2, 0), slot, fine // 2 - 2)
                else:
                    source = (_add((*row, 0), _unit(axis, fine))[:2], slot, shift)
                found.setdefault((a, b, new), []).append((*source, weight * other_weight))
    entries = tuple(sorted(found))
    rows = sorted({term[0] for terms in found.values() for term in terms})
    number = {row: k for k, row in enumerate(rows)}
    place, weights = [], []
    for slot, entry in enumerate(entries):
        terms = found[entry]
        terms += [(*terms[0][:3], 0.0)] * (-len(terms) % TOGETHER)
        place += [(slot, number[row], source, shift) for row, source, shift, _ in terms]
        weights += [weight for *_, weight in terms]
    return (Terms(np.array(place), np.array(weights), np.array(rows), len(entries)), entries)


def stencil_of(dimension: int, entries: tuple[Entry, ...]) -> Stencil:
    """Return the stencil of a level with given entries."""
    zero: Offset = (0, 0, 0)
    found: list[tuple[int, ...]] = []
    for slot, (a, b, way) in enumerate(entries):
        found.append((a, b, *way, slot, *zero))
        if a != b or any(way):
            back = _opposite(way)
            found.append((b, a, *back, slot, *back))
    found.sort(key=lambda c: (c[0], c[:5] != (c[0], c[0], *zero), c[6:9], c[5]))
    starts = np.searchsorted([c[0] for c in found], range(dimension + 1))
    number = {entry: slot for slot, entry in enumerate(entries)}
    own, after = (
        np.array([number[c, c, way] for c in range(dimension)]) for way in (zero, (0, 0, 1))
    )
    return Stencil(entries, np.array(found), starts.astype(np.int64), own, after)
