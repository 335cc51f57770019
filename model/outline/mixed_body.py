"""Bodies of several materials that meet along true outlines: what a leaf holds of each.

Where an outline's two polygons leave it open which of two materials there is, one bound takes a
law that is no stiffer than both, the other one a law that is no softer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .convex_pieces import Corners, Parts, split
from .laws import AIR, Law
from .true_shapes import Held, OfRegions, TrueRegion

_Painted = list[tuple[Law, Corners]]
"""Convex pieces that fill a square, each of a law."""


@dataclass(frozen=True)
class MixedRegion(TrueRegion):
    """A shape, and what it is filled with."""

    law: Law


@dataclass(frozen=True)
class MixedBody(OfRegions):
    """A box of a law, and regions of others that cover it one after the other."""

    law: Law
    regions: tuple[MixedRegion, ...]

    @property
    def solid(self) -> bool:
        """Whether the box is a body where no region covers it."""
        return self.law != AIR

    @property
    def laws(self) -> tuple[Law, ...]:
        """What the body is made of."""
        laws = dict.fromkeys([self.law, *(region.law for region in self.regions)])
        return tuple(law for law in laws if law != AIR)

    def held(self, squares: list[Corners], outer: bool) -> list[Held]:
        """Return what squares hold of each law: all of it no softer than it is, or no stiffer."""
        found: list[Held] = []
        for painted in self._painted(squares, outer):
            of: dict[Law, list[Corners]] = {}
            for law, piece in painted:
                of.setdefault(law, []).append(piece)
            of.pop(AIR, None)
            found.append(of)
        return found

    def _painted(self, squares: list[Corners], outer: bool) -> list[_Painted]:
        held: list[_Painted] = [[(self.law, square)] for square in squares]
        for region in self.regions:
            core, reach = (region.shape.parts(squares, way) for way in (False, True))
            for k in range(len(squares)):
                if reach[k]:
                    held[k] = list(_covered(held[k], region.law, core[k], reach[k], outer))
        return held


def _covered(
    painted: _Painted, law: Law, core: Parts, reach: Parts, stiffer: bool
) -> Iterator[tuple[Law, Corners]]:
    """Yield pieces, and in place of what a region covers those of its law.

    In the band between what it covers at least and at most, both laws are possible.
    """
    for before, piece in painted:
        either = before.with_other(law, stiffer)
        inside, outside = split([piece], core if either == before else reach)
        band: list[Corners] = []
        if either not in (before, law):
            inside, band = split(inside, core)
        yield from ((law, part) for part in inside)
        yield from ((either, part) for part in band)
        yield from ((before, part) for part in outside)
