"""Stress intensity: how strong the stress is that grows without limit at a corner or a crack.

Round the tip of a wedge with free sides the stress is K r^(λ-1) and what has a limit, one K for
each of two modes (M. L. Williams, *Journal of Applied Mechanics* 19, 1952); λ is ½ for a crack.
By Betti's theorem the work that the answer and the field of exponent -λ do on each other through
any arc round the tip is the same: K times the work that the field of exponent λ would do. The mean
is taken over the arcs of a ring, away from the tip, where the answer is good.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError, ResultError
from kaju.model.elastic.corners import MOST_CELLS, ON_EDGE
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult

Complex = NDArray[np.complex128]

RING = 0.5
"""The ring's inner radius, of its outer one: of 0.25 to 0.75 an L's factor differs by 0.03 %."""
CORNER = {True: 0.544483736782464, False: 0.908529189846099}
"""λ of a corner of three quarters, opening or not: sin(3πλ/2) is λ, or -λ."""
WIDTH = 0.7
"""What the width of a slit adds to its factors, over what is there of it and beyond: a slit is
about a third of its width longer than a crack (0.3 to 0.7, tests/elasticity/test_intensity.py)."""


class Intensity(NamedTuple):
    """Stress intensity factors of a crack or a corner.

    On the line that halves the body round the tip the stress across it is K_I (2πr)^(λ_I - 1), the
    shear K_II (2πr)^(λ_II - 1).
    """

    K_I: float
    """Of opening, in Pa·m^(1 - λ_I): for a crack Pa·√m."""
    K_II: float
    """Of shear, in Pa·m^(1 - λ_II)."""
    exponents: tuple[float, float]
    """λ_I and λ_II."""
    error_estimate: float
    """Of the larger factor, in its unit: what a narrower ring tells differently, a share of the
    answer's error, and how wide a slit is."""
    radius: float
    """Outer radius of the ring (m)."""


class _Tip(NamedTuple):
    """The tip of a corner, or of a slit that is as wide as a cell."""

    at: Floats  # m
    half: float  # Half the body's angle there
    slit: float  # Half its width (m); 0 at a corner
    turn: Floats  # Rows: along the bisector of the body there, and across it
    kind: int  # The body's material

    def widest(self, away: Floats) -> Floats:
        """Return the angle from the bisector at which the body ends, so far from the tip."""
        return self.half - np.arcsin(np.minimum(self.slit / away, 1.0)) * (1.0 + ON_EDGE)


def intensity(result: ElasticResult, at: tuple[float, ...]) -> Intensity:
    """Return the stress intensity factors of a crack or a re-entrant corner of a plane body.

    `at` is the corner (m), or the middle of the end of a slit of air one cell wide. The slit
    stands for a crack that is longer by a third of a cell; for 50 cells this is within 2 %.

    Raises
    ------
    ParameterError
        If there is no such corner or slit, with free sides and one material all around.

    Examples
    --------
    >>> from kaju import Scene, solve
    >>> hole = {"box": [[0.1, 0.1], [0.2, 0.2]], "material": "air"}
    >>> body = {"size": [0.2, 0.2], "cells": [8, 8], "material": "steel", "regions": [hole]}
    >>> loads = [{"side": "right", "pressure": -1e6}]
    >>> bracket = Scene(body=body, sides={"left": "rigid"}, loads=loads)
    >>> answer = solve(bracket, tolerance=0.05)
    >>> round(answer.intensity((0.1, 0.1)).exponents[0], 4)
    0.5445
    """
    if result.stiffness is not None:
        raise ResultError(
            "intensity: needs one material all around the tip, and in this answer every cell has "
            "its own stiffness"
        )
    grid = result.grid
    point = np.asarray(at, dtype=np.float64)
    if grid.lattice.dimension != 2 or point.shape != (2,):
        raise ParameterError("at: must be a point (x, y) of a body in the plane, in metres")
    tip = _tip_at(grid, point)
    radius = _room(result, tip)
    # The ring is four cells wide at least; of slits, of a cell's width each.
    least = 16.0 * tip.slit
    if not radius > least:
        raise ParameterError(
            f"at: other edges, loads or materials within {least:.3g} m of the tip change its "
            "stress; take smaller cells"
        )
    modes = [_Mode(tip.half, opens) for opens in (True, False)]
    opening, shear = (_factor(result, tip, mode, radius) for mode in modes)
    inner = [_factor(result, tip, mode, 0.5 * (radius + least)) for mode in modes]
    # Factors of Ls are off by up to 0.33 of the answer's error.
    share = 0.6 * result.found.solution.error + WIDTH * 2.0 * tip.slit / radius
    off = max(abs(opening - inner[0]), abs(shear - inner[1]))
    off += share * max(abs(opening), abs(shear))
    return Intensity(opening, shear, (modes[0].exponent, modes[1].exponent), off, radius)


def _tip_at(grid: Scene, point: Floats) -> _Tip:
    """Return the tip of a corner of cells, or of a slit of one cell's width."""
    if (tip := _seen_at(grid, point)) is None:
        raise ParameterError(
            f"at: {point.tolist()} m is neither a re-entrant corner of cells of one material "
            "nor the middle of the end of a slit one cell wide; `sharp_corners` lists corners"
        )
    if not tip.slit:
        inwards = -0.5 * grid.lattice.cell_size * np.sign(tip.turn[0])  # into the air
        for end in point + np.diag(inwards):
            if _seen_at(grid, end):
                raise ParameterError(
                    f"at: {point.tolist()} m is a corner of the end of a slit one cell wide; ask "
                    f"at the middle of this end, {np.round(end, 9).tolist()} m, as of a crack"
                )
    return tip


def _seen_at(grid: Scene, point: Floats) -> _Tip | None:
    """Return the tip that there is at a point, if there is one."""
    place = point / grid.lattice.cell_size
    off = np.abs(place - np.rint(place))
    line, middle = (np.abs(off - end) <= ON_EDGE for end in (0.0, 0.5))
    # A corner without a cell, and a slit that ends in a face, are air in two of eight directions
    # that lie side by side.
    angle = np.pi / 8.0 * (2.0 * np.arange(8) + 1.0)
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    kinds = grid.kinds(np.floor(place + 0.75 * ways).astype(np.int64))
    x, y = -ways[kinds == AIR].sum(axis=0) / (2.0 * np.cos(np.pi / 8.0))
    body = np.unique(kinds[kinds != AIR])
    air = (kinds == AIR).sum() == 2 and np.hypot(x, y) > 1.0 - ON_EDGE
    if air and len(body) == 1 and body[0] >= 0 and line.any() and (line | middle).all():
        corner = bool(line.all())
        slit = 0.0 if corner else 0.5 * grid.lattice.cell_size
        half = 0.75 * np.pi if corner else np.pi
        return _Tip(point, half, slit, np.array([[x, y], [-y, x]]), int(body[0]))
    return None


def _room(result: ElasticResult, tip: _Tip) -> float:
    """Return how far from a tip there is nothing but it (m): other edges, loads, materials."""
    grid, h = result.grid, result.grid.lattice.cell_size
    first = np.floor(tip.at / h + ON_EDGE).astype(np.int64)
    low, high = grid.bounds()
    reach = int(0.5 * MOST_CELLS**0.5)
    low, high = np.maximum(low - 1, first - reach), np.minimum(high + 1, first + reach)
    cells = np.indices(tuple(high - low)).reshape(2, -1).T + low
    away = (cells + 0.5) * h - tip.at
    x, y = tip.turn @ away.T
    empty = np.abs(np.arctan2(y, x)) > tip.widest(np.hypot(x, y))
    other = grid.kinds(cells) != np.where(empty, AIR, tip.kind)
    applied = grid.applied(result.stage)
    loaded = np.isin(grid.lattice.key(np.maximum(cells, 0)), grid.lattice.key(applied.cells))
    gap = np.maximum(np.abs(away[other | loaded]) - 0.5 * h, 0.0)
    return float(np.linalg.norm(gap, axis=1).min(initial=reach * h))


@dataclass(frozen=True)
class _Mode:
    """A field without force on the sides of a wedge: potentials a z^λ and b z^λ (Kolosov)."""

    half: float
    opens: bool

    @property
    def exponent(self) -> float:
        """The least λ of the mode."""
        return 0.5 if self.half == np.pi else CORNER[self.opens]

    def fields(
        self, z: Complex, exponent: float, shear: float, kolosov: float
    ) -> tuple[Floats, Floats]:
        """Return displacements and stresses at places, of a stress (2πr)^(λ-1) ahead of the tip."""
        sign, turn = 2.0 * self.opens - 1.0, 2.0 * self.half
        b = -sign * np.cos(exponent * turn) - exponent * np.cos(turn)
        a = (2 * np.pi) ** (exponent - 1) / (exponent * (exponent + sign + b))
        power = (a if self.opens else 1j * a) * z ** (exponent - 1.0)
        phi, slope, psi = power * z, exponent * power, b * power * z
        curve = (exponent - 1.0) * slope * np.conj(z) / z + exponent * b * power
        moved = (kolosov * phi - z * np.conj(slope) - np.conj(psi)) / (2.0 * shear)
        yy, xy = 2.0 * slope.real + curve.real, curve.imag
        stress = np.stack([[4.0 * slope.real - yy, xy], [xy, yy]])
        return np.stack([moved.real, moved.imag]), stress


def _factor(result: ElasticResult, tip: _Tip, mode: _Mode, outer: float) -> float:
    """Return the factor of a mode from a ring round the tip."""
    _, lateral, shear = (float(modulus[tip.kind]) for modulus in scene_moduli(result.scene))
    law = shear, (lateral + 3.0 * shear) / (lateral + shear)  # The second is Kolosov's
    # Gauss points across and around: of 8 times as many factors are 2e-5 apart.
    (rings, across), (angles, around) = (np.polynomial.legendre.leggauss(n) for n in (12, 120))
    # The radius as a share of the ring's width, and from 1 within to 0 without, smoothly: -∂q/∂r
    s = 0.5 * (rings[:, None] + 1.0)
    r, slope = outer * (RING + (1.0 - RING) * s), 6.0 * s * (1.0 - s)
    widest = tip.widest(r)
    weight = (0.5 * across[:, None] * widest * around * r * slope).ravel()
    z = (r * np.exp(1j * widest * angles)).ravel()
    normal = np.stack([z.real, z.imag]) / np.abs(z)

    def work(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> float:
        pulls = [np.einsum("ijn,jn->in", stress, normal) for _, stress in (first, second)]
        return float(weight @ (pulls[0] * second[0] - pulls[1] * first[0]).sum(axis=0))

    points = tip.at + np.stack([z.real, z.imag], axis=1) @ tip.turn
    moved = tip.turn @ result.displacement_at(points).T
    stress = np.einsum("ai,nij,bj->abn", tip.turn, result.stress_at(points), tip.turn)
    dual = mode.fields(z, -mode.exponent, *law)
    return work((moved, stress), dual) / work(mode.fields(z, mode.exponent, *law), dual)
