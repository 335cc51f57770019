"""Stress intensity: how strong the stress is that grows without limit at a corner or a crack.

Round the tip of a wedge with free sides the stress is K r^(λ-1) and what has a limit, one K for
each of two modes (M. L. Williams, *Journal of Applied Mechanics* 19, 1952); λ is ½ for a crack.
By Betti's theorem the work that the answer and the field of exponent -λ do on each other through
any arc round the tip is the same: K times the work that the field of exponent λ would do. The mean
is taken over the arcs of a ring, away from the tip, where the answer is good.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError
from kaju.model.elastic.corners import ON_EDGE
from kaju.model.results.result import BodyResult
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR

Complex = NDArray[np.complex128]

RING = 0.5
"""The ring's inner radius, of its outer one: of 0.25 to 0.75 an L's factor differs by 0.03 %."""
POINTS = 12, 120  # Gauss points of the ring across and around: of 8 times as many 2e-5 apart
FEWEST = 4  # So many cells the ring is wide at least; of slits, of a cell's width each
WIDTH = 0.7
"""What the width of a slit adds to its factors, over what is there of it and beyond: a slit is
about a third of its width longer than a crack (0.3 to 0.7, tests/elasticity/test_intensity.py)."""
FELT = 0.6  # Share of the answer's error that factors may have: of Ls up to 0.33 were needed
FARTHEST = 500  # So many cells round a tip are looked through
DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


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
    """Where a tip is (m), half the body's angle there, its bisector, half the width of the slit."""

    at: Floats
    half: float
    towards: float
    slit: float


def intensity(
    result: BodyResult, error: float, at: tuple[float, ...], radius: float | None
) -> Intensity:
    """Return the factors from an answer with an error; see `ElasticResult.intensity`."""
    grid = result.grid
    point = np.asarray(at, dtype=np.float64)
    if grid.lattice.dimension != 2 or point.shape != (2,):
        raise ParameterError("at: must be a point (x, y) of a body in the plane, in metres")
    tip = _tip_at(grid, point)
    room = _room(result, tip)
    least = 2.0 * FEWEST * grid.lattice.cell_size if tip.slit else 0.0
    if radius is None:
        radius = room
    elif not 0.0 < radius <= room * (1.0 + ON_EDGE):
        raise ParameterError(
            f"radius: must lie above 0 and within {room:.4g} m, where no other edge, load or "
            f"material is near, got {radius:.4g}"
        )
    if not radius > least:
        raise ParameterError(
            f"at: the slit is {2 * tip.slit:.3g} m wide, so its stress is that of a crack only "
            f"farther than {least:.3g} m from its end; other edges or loads are nearer than "
            "that: take smaller cells"
        )
    modes = [_Mode(tip.half, opens) for opens in (True, False)]
    opening, shear = (_factor(result, tip, mode, radius) for mode in modes)
    inner = [_factor(result, tip, mode, 0.5 * (radius + least)) for mode in modes]
    off = max(abs(opening - inner[0]), abs(shear - inner[1]))
    share = FELT * error + WIDTH * 2.0 * tip.slit / room
    off += share * max(abs(opening), abs(shear))
    return Intensity(opening, shear, (modes[0].exponent, modes[1].exponent), off, float(radius))


def _tip_at(grid: Scene, point: Floats) -> _Tip:
    """Return the tip of a corner of cells, or of a slit of one cell's width."""
    h = grid.lattice.cell_size
    place = point / h
    on_line = np.abs(place - np.rint(place)) <= ON_EDGE
    if on_line.all():
        corner = np.rint(place).astype(np.int64)
        quarters = np.array([[0, 0], [-1, 0], [-1, -1], [0, -1]])
        kinds = grid.kinds(corner + quarters)
        if (kinds >= 0).sum() == 3 and len(set(kinds[kinds >= 0].tolist())) == 1 and AIR in kinds:
            missing = int(np.flatnonzero(kinds == AIR)[0])
            towards = np.pi / 4 + np.pi / 2 * missing + np.pi
            return _Tip(point, 0.75 * np.pi, towards, 0.0)
    elif on_line.any():
        across = int(np.flatnonzero(~on_line)[0])
        middle = abs(place[across] - np.floor(place[across]) - 0.5) <= ON_EDGE
        ahead = np.floor(place + ON_EDGE).astype(np.int64)
        for direction in DIRECTIONS if middle else ():
            if direction[across]:
                continue
            cell = ahead - (direction < 0)
            side = np.eye(2, dtype=np.int64)[across]
            behind = cell - direction
            around = grid.kinds(np.stack([cell, behind, behind + side, behind - side]))
            if around[1] == AIR and np.all(around[[0, 2, 3]] == around[0]) and around[0] >= 0:
                return _Tip(point, np.pi, float(np.arctan2(direction[1], direction[0])), 0.5 * h)
    raise ParameterError(
        f"at: {point.tolist()} m is neither a re-entrant corner of cells of one material "
        "nor the middle of the end of a slit one cell wide; `sharp_corners` lists corners"
    )


def _room(result: BodyResult, tip: _Tip) -> float:
    """Return how far from a tip there is nothing but it (m): other edges, loads, materials."""
    grid, h = result.grid, result.grid.lattice.cell_size
    lower, upper = grid.bounds()
    reach = min(int((upper - lower).max()), FARTHEST)
    first = np.floor(tip.at / h + ON_EDGE).astype(np.int64)
    low, high = np.maximum(lower - 1, first - reach), np.minimum(upper + 1, first + reach)
    ranges = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
    cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2)
    away = (cells + 0.5) * h - tip.at
    turned = _turned(away, -tip.towards)
    angle = np.abs(np.arctan2(turned[:, 1], turned[:, 0]))
    empty = (
        (turned[:, 0] < 0.0) & (np.abs(turned[:, 1]) < tip.slit) if tip.slit else angle > tip.half
    )
    own = grid.kinds(_ahead(grid, tip))
    other = grid.kinds(cells) != np.where(empty, AIR, own)
    applied = grid.applied(result.stage)
    loaded = np.isin(grid.lattice.key(np.maximum(cells, 0)), grid.lattice.key(applied.cells))
    gap = np.maximum(np.abs(away[other | loaded]) - 0.5 * h, 0.0)
    return float(np.linalg.norm(gap, axis=1).min(initial=reach * h))


def _turned(points: Floats, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True)
class _Mode:
    """A field without force on the sides of a wedge: potentials a z^λ and b z^λ (Kolosov)."""

    half: float
    opens: bool

    @property
    def exponent(self) -> float:
        """The least λ of the mode."""
        sign = 1.0 if self.opens else -1.0

        def free(x: float) -> float:
            return float(np.sin(2 * x * self.half) + sign * x * np.sin(2 * self.half))

        return 0.5 if self.half == np.pi else float(brentq(free, 0.5, 0.99))

    def potentials(self, exponent: float) -> tuple[complex, complex]:
        """Return a and b, for a stress of 1 (2πr)^(λ-1) ahead of the tip."""
        turn = np.cos(2 * exponent * self.half), exponent * np.cos(2 * self.half)
        if self.opens:
            b = -(turn[0] + turn[1])
            unit = exponent * (exponent + 1 + b)
        else:
            b = turn[0] - turn[1]
            unit = exponent * (exponent - 1 + b)
        size = (2 * np.pi) ** (exponent - 1) / unit * (1.0 if self.opens else 1.0j)
        return size, size * b

    def fields(self, z: Complex, exponent: float, shear: float, kolosov: float) -> _Fields:
        """Return displacements and stresses at places round the tip."""
        a, b = self.potentials(exponent)
        power = z ** (exponent - 1.0)
        phi, slope, psi = a * power * z, exponent * a * power, b * power * z
        curve = (exponent - 1.0) * slope * np.conj(z) / z + exponent * b * power
        moved = (kolosov * phi - z * np.conj(slope) - np.conj(psi)) / (2.0 * shear)
        total, difference = 4.0 * slope.real, 2.0 * curve
        yy, xy = 0.5 * (total + difference.real), 0.5 * difference.imag
        stress = np.stack([[total - yy, xy], [xy, yy]])
        return np.stack([moved.real, moved.imag]), stress


_Fields = tuple[Floats, Floats]


def _factor(result: BodyResult, tip: _Tip, mode: _Mode, outer: float) -> float:
    """Return the factor of a mode from a ring round the tip."""
    material = result.scene.cell_materials[int(result.grid.kinds(_ahead(result.grid, tip))[0])]
    nu = material.poissons_ratio
    shear = material.youngs_modulus / (2.0 * (1.0 + nu))
    kolosov = 3.0 - 4.0 * nu if result.scene.plane == "strain" else (3.0 - nu) / (1.0 + nu)
    (rings, across), (angles, around) = (np.polynomial.legendre.leggauss(n) for n in POINTS)
    inner = RING * outer
    r = (inner + 0.5 * (outer - inner) * (rings + 1.0))[:, None]
    widest = tip.half - np.arcsin(tip.slit / r) * (1.0 + ON_EDGE)
    angle = widest * angles
    weight = 0.5 * (outer - inner) * across[:, None] * widest * around * r
    # From 1 within to 0 without, smoothly: -∂q/∂r.
    s = (r - inner) / (outer - inner)
    weight = weight * 6.0 * s * (1.0 - s) / (outer - inner)
    z = (r * np.exp(1j * angle)).ravel()
    normal = np.stack([z.real, z.imag]) / np.abs(z)

    def work(first: _Fields, second: _Fields) -> float:
        pulls = [np.einsum("ijn,jn->in", stress, normal) for _, stress in (first, second)]
        density = (pulls[0] * second[0] - pulls[1] * first[0]).sum(axis=0)
        return float(weight.ravel() @ density)

    points = tip.at + _turned(np.stack([z.real, z.imag], axis=1), tip.towards)
    turn = _turned(np.eye(2), tip.towards)
    moved = (result.displacement_at(points) @ turn.T).T
    stress = np.einsum("ai,nij,bj->abn", turn, result.stress_at(points), turn)
    dual = mode.fields(z, -mode.exponent, shear, kolosov)
    return work((moved, stress), dual) / work(mode.fields(z, mode.exponent, shear, kolosov), dual)


def _ahead(grid: Scene, tip: _Tip) -> Ints:
    """Return the cell in which the body lies ahead of a tip."""
    step = 0.5 * _turned(np.eye(2)[:1], tip.towards)
    return np.floor(tip.at / grid.lattice.cell_size + step).astype(np.int64)
