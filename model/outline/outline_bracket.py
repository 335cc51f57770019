"""Both bounds on a body with true outlines, and leaves split where they are apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import ConvergenceError

from .arc_triangles import ArcFrames
from .balanced_pieces import SMALL_RESIDUAL, BalancedPieces, LooseError
from .convex_pieces import ON_LINE
from .fitted_displacement import GAUSS, FittedDisplacement
from .outline_problem import OutlineProblem, UnlikeError
from .square_leaves import SquareLeaves
from .true_shapes import CutLeaves, TrueBody
from .weighed_band import WeighedBand

ROUNDING = 1e-7  # share by which the bounds are set wider, for coordinates and forces are rounded
OF_LAW = 1e3 * np.finfo(np.float64).eps
"""The same for the law, times its condition: next to ν = 1/2 it leaves few digits of an energy."""
FASTEST = 0.1  # share of the gap that one step may aim at; where it takes more, all aim at the same
MOST_HALVINGS = 2
"""Of a leaf in one step, which knows nothing of what the smaller ones will be like."""
TURN = 0.6  # angle by which a stressed outline may turn in a leaf, over the root of the tolerance
STRESSED = 0.5  # share of the largest stress along an outline above which it is stressed
SLIVER = 0.1  # what leaves hold less of themselves says nothing of the stress along an outline
LEVELS = 100  # thresholds that are tried for halving leaves, each 0.9 of the one before
AIM = 0.9  # share of the gap asked for that the steps aim at


@dataclass(frozen=True, eq=False)
class OutlineBracket:
    """The work of the loads (twice the energy) from below and from above, and both fields."""

    leaves: SquareLeaves
    lower: float
    upper: float
    fitted: FittedDisplacement
    balanced: BalancedPieces
    share: Floats  # what each leaf adds to upper - lower
    kept: Ints  # which of all leaves, the empty ones among them, these are
    rounding: float  # share by which `bounds` are set wider

    @property
    def bounds(self) -> tuple[float, float]:
        """Both, as far apart as rounding may take them."""
        return self.lower * (1.0 - self.rounding), self.upper * (1.0 + self.rounding)

    def coarse(self, body: TrueBody, tolerance: float) -> Ints:
        """Return how often to halve leaves in which a stressed outline turns by too much.

        The energy does not see a small hole's peak. What turns by little in all, such as a kink
        rounded off, has none: of those that turn by more there are few.
        """
        stress = np.sqrt(self.balanced.mean_stress**2 @ [1.0, 1.0, 2.0])
        filled = self.balanced.area > SLIVER * (self.leaves.size * self.leaves.unit) ** 2
        halvings = np.zeros(len(self.leaves), dtype=np.int64)
        for region in body.regions:
            frames = ArcFrames(region.shape.arcs)
            turn = np.zeros(len(self.leaves))
            for points, share in ((frames.start, 0.25), (frames.tip, 0.5), (frames.end, 0.25)):
                leaf = self.leaves.at(points)
                turn += np.bincount(leaf + 1, share * np.abs(frames.turn), len(turn) + 1)[1:]
            bent = turn > TURN * tolerance**0.5
            stressed = stress > STRESSED * stress[filled & (turn > 0.0)].max(initial=0.0)
            often = np.ceil(np.log2(turn[bent & stressed] / (TURN * tolerance**0.5)))
            halvings[bent & stressed] = np.maximum(halvings[bent & stressed], often)
        return np.minimum(halvings, MOST_HALVINGS)


# returns an error, what each leaf adds to it, and the share of that to aim at
Aim = Callable[[OutlineBracket], tuple[float, Floats, float]]


def error_between(bounds: tuple[float, float]) -> float:
    """Return the largest error of the mean of both stresses in the energy norm, relative."""
    lower, upper = bounds
    return 0.5 * float(np.sqrt(max(upper - lower, 0.0) / lower)) if lower > 0.0 else np.inf


class NotYetError(Exception):
    """The pieces of these cut leaves do not hang together, or miss a part of a pressed outline."""

    def __init__(self, cut: Ints, why: Exception):
        super().__init__(cut, why)
        self.cut, self.why = cut, why


def bracket(
    problem: OutlineProblem, leaves: SquareLeaves, cutting: CutLeaves | None = None
) -> OutlineBracket:
    """Return the bounds on given leaves; leaves without any of the body go."""
    outer, inner = (cutting or CutLeaves(problem.body)).refined(leaves)
    kept = np.union1d(np.flatnonzero(outer.whole >= 0), np.array([*outer.cut], dtype=np.int64))
    if not len(kept):
        raise UnlikeError("they leave nothing of the body")
    leaves = leaves.only(kept)
    outer, inner = outer.only(kept), inner.only(kept)
    fitted = FittedDisplacement(leaves, outer)
    balanced = BalancedPieces(fitted, inner, problem.weight)
    try:
        force, held, loaded = problem.on_balanced(balanced)
        weighed = WeighedBand(problem, balanced) if problem.weight.any() else None
        excess = np.zeros((fitted.nodes, 2))
        if weighed is not None:
            force, excess = force + weighed.force, weighed.excess(fitted)
        upper = balanced.settle(force, held)
        if not balanced.residual <= SMALL_RESIDUAL:
            raise UnlikeError(f"forces balance to {balanced.residual:.1e} only")
    except (LooseError, UnlikeError) as error:
        raise NotYetError(kept[inner.whole < 0], error) from error
    acting = problem.on_fitted(fitted, loaded) - excess
    lower = fitted.settle(acting, problem.held_of(fitted, outer))
    band = problem.band * (fitted.area - balanced.area)
    borne = _borne(balanced, fitted)
    share = balanced.energies() + fitted.energies() + 2.0 * band
    share -= 2.0 * (borne + _work(balanced, fitted, force))
    low, high = lower - band.sum(), upper + band.sum()
    if weighed is not None and weighed.unborne.any():
        unsure, unborne = weighed.unsure(fitted), weighed.unborne.sum()
        done = float(((fitted.weigh(problem.weight) - excess) * fitted.displacement).sum())
        done -= float((borne + _pushed(balanced, fitted, weighed.force)).sum())
        low, high = low - 2.0 * unsure, high + 2.0 * (done + unsure)
        more = 2.0 * (unborne + np.sqrt(unborne * (unborne + max(high - low, 0.0))))
        high += more
        share += (more + 4.0 * unsure) * weighed.unborne / unborne
    return OutlineBracket(leaves, low, high, fitted, balanced, share, kept, rounding_of(problem))


def rounding_of(problem: OutlineProblem) -> float:
    """Return the share by which bounds are set wider for rounding."""
    softest, stiffest = problem.softest, problem.stiffest
    contrast = max(stiff / soft for stiff, soft in zip(stiffest, softest, strict=True))
    law = np.linalg.eigvalsh(stiffest.stiffness).max() / np.linalg.eigvalsh(softest.stiffness).min()
    # a strip of the stiff material that lies on a line but for rounding counts as the soft one
    return float(ROUNDING + ON_LINE * (contrast - 1.0) + OF_LAW * law)


def _borne(balanced: BalancedPieces, fitted: FittedDisplacement) -> Floats:
    """Return the work of the weight within each leaf on the displacement."""
    mean = fitted.displacement[fitted.corner].mean(axis=1)
    out = np.asarray(balanced.area * (mean @ balanced.weight))
    out[balanced.owner] = 0.0  # those that are not whole
    for k in range(3):
        middle = 0.5 * (balanced.corners[:, k] + balanced.corners[:, k - 1])
        moved = fitted.at(balanced.owner, middle) @ balanced.weight
        out += np.bincount(balanced.owner, balanced.cut.area / 3.0 * moved, len(out))
    return np.asarray(out)


def _work(balanced: BalancedPieces, fitted: FittedDisplacement, force: Floats) -> Floats:
    """Return the work of each leaf's tractions on the displacement."""
    leaf, ends, at = balanced.leaf_of, balanced.ends, balanced.on_square
    moved = np.stack([fitted.at(leaf[at], ends[at, k]) for k in (0, 1)], axis=1)
    work = np.einsum("nkd,nkd->n", balanced.moments[at].reshape(-1, 2, 2), moved)
    own = np.where((at | ~balanced.alone)[:, None, None], 0.0, force)
    return _pushed(balanced, fitted, own) + np.bincount(leaf[at], work, len(balanced.area))


def _pushed(balanced: BalancedPieces, fitted: FittedDisplacement, force: Floats) -> Floats:
    """Return the work of linear tractions, by their moments, on the displacement of each leaf."""
    at = np.flatnonzero(force.any(axis=(1, 2)))
    leaf, start, force = balanced.leaf_of[at], balanced.ends[at, 0], force[at]
    run = balanced.ends[at, 1] - start
    out = np.zeros(len(balanced.area))
    for g in GAUSS:
        traction = (2.0 - 3.0 * g) * force[:, 0] + (3.0 * g - 1.0) * force[:, 1]
        work = (traction * fitted.at(leaf, start + g * run)).sum(axis=1)
        out += np.bincount(leaf, work, len(out))
    return out


def spawn(
    problem: OutlineProblem,
    tolerance: float,
    most: int,
    before: SquareLeaves | None = None,
    keep: Callable[[OutlineBracket], None] = lambda found: None,
    aim: Aim | None = None,
) -> OutlineBracket:
    """Return bounds whose error is within a tolerance, leaves split where the gap is.

    They begin as small as those before; `keep` gets the bounds of every generation, and an aim puts
    another error in the place of theirs. Raises SupportError if the body could move without
    straining, ConvergenceError if it takes more leaves than `most`.
    """
    if not problem.held_whole:
        raise LooseError
    leaves, cutting = SquareLeaves.first(problem.shape), CutLeaves(problem.body)
    if before is not None:
        leaves = leaves.as_small_as(before)
    patience = 6
    while True:
        try:
            found = bracket(problem, leaves, cutting)
        except NotYetError as not_yet:  # coarse pieces may not
            patience -= 1
            if not patience or len(leaves) > most or not len(not_yet.cut):
                raise not_yet.why from None
            leaves = leaves.split(np.isin(np.arange(len(leaves)), not_yet.cut))
            continue
        keep(found)
        if aim is None:
            error, part = error_between(found.bounds), found.share
            wanted = (tolerance / max(error, tolerance)) ** 2
        else:
            error, part, wanted = aim(found)
        reached = error <= tolerance
        halvings = np.zeros(len(leaves), dtype=np.int64)
        halvings[found.kept] = found.coarse(problem.body, tolerance)
        if not reached and part.any():
            shared = _halvings(part, wanted)
            halvings[found.kept] = np.maximum(halvings[found.kept], shared)
        finer = leaves.split(np.minimum(halvings, np.log2(leaves.size).astype(np.int64)))
        if len(leaves) < len(finer) <= most:
            leaves = finer
            continue
        if not reached:
            raise ConvergenceError(
                f"tolerance: {tolerance:g} takes more than {most:,} agents (most_agents), or "
                f"smaller ones than there are; the error {'bound' if aim is None else 'estimate'} "
                f"is {error:.3g} so far",
                best=found,
            )
        return found


def _halvings(share: Floats, wanted: float) -> Ints:
    """Return how often to halve leaves for a share of the gap, as smooth fields would have it.

    There a leaf's fourths add a fourth of what it added: least leaves have what all add alike.
    """
    wanted = max(AIM * wanted, np.finfo(np.float64).tiny)  # none is asked of an infinite gap
    aim = wanted ** (1.0 / max(np.ceil(np.log(wanted) / np.log(FASTEST)), 1.0)) * share.sum()
    halvings = np.zeros(len(share), dtype=np.int64)
    for level in share.max() * 0.9 ** np.arange(LEVELS):
        often = np.ceil(np.log(np.maximum(share, 1e-300) / level) / np.log(16.0))
        halvings = np.clip(often, 0.0, MOST_HALVINGS).astype(np.int64)
        if (share / 4.0**halvings).sum() <= aim:
            break
    return halvings
