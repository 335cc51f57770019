"""Agents within outlines halve where they disagree most with themselves, as others do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.pair.cut_pair import CutPair
from kaju.model.elastic.pair.loop import AIM, STALLED, halvings
from kaju.stopping import interrupt_requested

from .arc_triangles import ArcFrames
from .leaf_polygons import VagueError, leaf_polygons
from .outline_problem import OutlineProblem, UnlikeError
from .square_leaves import SquareLeaves

PATIENCE = 6  # times that cut leaves are halved, all of them, to find out what hangs together
MOST_HALVINGS = 2  # of a leaf in one step, for a stressed outline
TURN = 0.6  # angle by which a stressed outline may turn in a leaf, over the root of the tolerance
STRESSED = 0.5  # share of the largest stress along an outline above which it is stressed
SLIVER = 0.1  # what leaves hold less of themselves says nothing of the stress along an outline


@dataclass(frozen=True)
class Aimed:
    """What a generation says about what the tolerance is about."""

    error: float
    part: Floats  # of each leaf in it
    wanted: float  # share of it that is aimed at
    first: Ints  # how often leaves are to be halved whatever their part


class OutlineLoop:
    """The agents of a body, generation by generation."""

    def __init__(
        self,
        problem: OutlineProblem,
        tolerance: float,
        most: int,
        leaves: SquareLeaves | None = None,
        aim: Callable[[CutPair], Aimed] | None = None,
    ):
        self.problem, self.tolerance, self._most = problem, tolerance, most
        self._leaves = leaves or SquareLeaves.first(problem.shape)
        self._aim = aim
        self.stopped = ""
        """Why it ended short of the tolerance: "agents", "depth", "interrupt"."""

    def run(self, keep: Callable[[CutPair], None]) -> CutPair:
        """Return the generation that knows best, of a peak the last; `keep` gets all."""
        least, best, without_gain = np.inf, None, 0
        while True:
            pair = self._found()
            keep(pair)
            aimed = self._aimed(pair)
            without_gain = without_gain + 1 if aimed.error > 0.99 * least else 0
            reached = aimed.error <= self.tolerance
            if best is None or aimed.error < least or self._aim is not None or reached:
                best, least = pair, aimed.error
            often = aimed.first
            if not reached:
                leaves = pair.leaves
                sharp = leaves.at(self.problem.body.sharp()[0])
                sharp = np.unique(sharp[sharp >= 0])
                left = AIM**2 * aimed.wanted * float(aimed.part.sum())
                often = np.maximum(often, halvings(aimed.part, left, sharp))
            often = np.minimum(often, np.log2(pair.leaves.size).astype(np.int64))
            finer = pair.leaves.split(often)
            many, ended = len(finer) > self._most, without_gain >= STALLED or not often.any()
            if many or ended or interrupt_requested():
                if least > self.tolerance:
                    self.stopped = "agents" if many else "depth" if ended else "interrupt"
                return best
            self._leaves = finer

    def _aimed(self, pair: CutPair) -> Aimed:
        coarse = coarse_along(pair, self.tolerance)
        if self._aim is not None:
            found = self._aim(pair)
            return Aimed(found.error, found.part, found.wanted, np.maximum(found.first, coarse))
        wanted = (self.tolerance / pair.error) ** 2 if np.isfinite(pair.error) else 0.0
        return Aimed(pair.error, pair.share, min(wanted, 1.0), coarse)

    def _found(self) -> CutPair:
        """Return both fields; leaves of which it is not known what they hold are halved."""
        patience = PATIENCE
        while True:
            try:
                return CutPair(self.problem, self._leaves)
            except VagueError as vague:
                leaves, why = vague.leaves, UnlikeError("they touch themselves, or others")
            except UnlikeError as error:
                # coarse pieces may not hang together
                patience, why = patience - 1, error
                leaves = np.unique(leaf_polygons(self.problem.body, self._leaves, False)[2].place)
            smallest = self._leaves.size[leaves].min(initial=2) < 2
            if not patience or not len(leaves) or smallest or len(self._leaves) > self._most:
                raise why
            self._leaves = self._leaves.split(np.isin(np.arange(len(self._leaves)), leaves))


def coarse_along(pair: CutPair, tolerance: float) -> Ints:
    """Return how often to halve leaves in which a stressed outline turns by too much.

    The energy does not see a small hole's peak. What turns by little in all, such as a kink
    rounded off, has none: of those that turn by more there are few.
    """
    leaves, body = pair.leaves, pair.problem.body
    stress = np.sqrt(pair.mean_stress**2 @ [1.0, 1.0, 2.0])
    filled = pair.area[1] > SLIVER * (leaves.size * leaves.unit) ** 2
    often = np.zeros(len(leaves), dtype=np.int64)
    for region in body.regions:
        frames = ArcFrames(region.arcs)
        turn = np.zeros(len(leaves))
        for points, share in ((frames.start, 0.25), (frames.tip, 0.5), (frames.end, 0.25)):
            leaf = leaves.at(points)
            turn += np.bincount(leaf + 1, share * np.abs(frames.turn), len(turn) + 1)[1:]
        bent = turn > TURN * tolerance**0.5
        stressed = stress > STRESSED * stress[filled & (turn > 0.0)].max(initial=0.0)
        more = np.ceil(np.log2(turn[bent & stressed] / (TURN * tolerance**0.5)))
        often[bent & stressed] = np.maximum(often[bent & stressed], more)
    return np.minimum(often, MOST_HALVINGS)
