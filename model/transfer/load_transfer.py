"""Load transfer, stage by stage and generation by generation, without Mesa."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from time import perf_counter
from types import MappingProxyType
from typing import Any
from warnings import warn

from kaju.agents.rules import ShareRule
from kaju.errors import StabilityError
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Lattice
from kaju.progress import progress_line
from kaju.stepping import Until, step_to_end

from .array_engine import ArrayEngine
from .stability import Certificate, certify, not_known
from .stage import Ledger, News, Stage, Totals
from .transfer import Transfer, states_of
from .transfer_result import TransferResult

MOST_GROWTH = 1e12
"""A run whose waiting loads exceed the applied ones by this factor is stopped."""

MOST_GROWTH_UNKNOWN = 1e3
"""The same for agents of one's own, of which no certificate says that their loads end."""

MOST_AT_ONE = 30_000
"""A run is stopped when more loads than this, each of another size, wait at one agent."""

MOST_IMBALANCE = 1e-9
"""At rest is only what accounts for all loads but this share of them."""


class LoadTransfer:
    """Load transfer on arrays; `LoadModel` is the same as a Mesa model, with agents as objects."""

    engine: Any
    running: bool
    parameters: Mapping[str, Any] = MappingProxyType({})

    def __init__(
        self,
        scene: Scene,
        allow_unstable: bool = False,
        max_generations: int = 10_000,
        *,
        rule: ShareRule | None = None,
    ) -> None:
        self._describe(scene, allow_unstable, max_generations, rule, [])
        self.engine = ArrayEngine(scene, self.transfer)
        self.running = True
        self._begin()

    def _describe(
        self,
        scene: Scene,
        allow_unstable: bool,
        max_generations: int,
        rule: ShareRule | None,
        own: list[str],
    ) -> None:
        """Certify the run; `own` names classes of one's own, about which nothing is certain."""
        self.scene, self.allow_unstable = scene, allow_unstable
        self.max_generations = max_generations
        self.transfer = Transfer(scene, rule)
        self.certificate: Certificate = not_known(own) if own else certify(scene, self.transfer)
        if not (own or self.certificate.stable or allow_unstable):
            raise StabilityError(
                f"{self.certificate.verdict}; to watch it grow all the same, "
                "set allow_unstable=True (`kaju run --allow-unstable`)"
            )

    def _begin(self) -> None:
        self.finished: list[Stage] = []
        self.seconds = 0.0
        self._begin_stage(1)

    def _begin_stage(self, stage: int) -> None:
        self.stage = stage
        self._stage_is_over = False
        live_on = stage > 1 and self.scene.loading == "continue"
        self._generations_before = self.generation if live_on else 0
        states = states_of(self.scene, stage, self.transfer.rule.sense)
        self.engine.start(*states, live_on=live_on)

    def begin_step(self) -> None:
        """Begin a generation; a new stage begins when one is at rest."""
        self._began = perf_counter()
        if self._stage_is_over:
            self.finished.append(self._stage(self._outcome))
            self._begin_stage(self.stage + 1)
        if not self.at_rest:
            self.engine.begin()

    def step(self) -> None:
        """Let one generation of loads be taken."""
        self.begin_step()
        self.engine.act()
        self.end_step()

    def end_step(self) -> None:
        """End a generation: boundaries have given back, and loads wait to be taken."""
        self.engine.end()
        self._stage_is_over = bool(self._end)
        more = self.at_rest and self.stage < self.scene.stages
        self.running = more or not self._stage_is_over
        self.seconds += perf_counter() - self._began

    @property
    def lattice(self) -> Lattice:
        """The scene's lattice."""
        return self.scene.lattice

    @property
    def generation(self) -> int:
        """Steps taken in the current stage."""
        return int(self.engine.generation)

    @property
    def pending(self) -> float:
        """Sum of the loads that wait to be taken (N)."""
        return float(self.engine.pending)

    @property
    def at_rest(self) -> bool:
        """Whether no load waits to be taken in the current stage."""
        return self.pending == 0.0

    @property
    def _end(self) -> str:
        """Why the current stage is over, in words; empty while loads travel."""
        generation, pending, applied = self.generation, self.pending, self.engine.applied
        watched = not (self.certificate.known or self.allow_unstable)
        stopped = f"stopped after {generation} generations: "
        if pending == 0.0 and generation == self._generations_before:
            gamma = self.transfer.rule.threshold
            return f"no load exceeds the threshold of {gamma:g} N: nothing happens"
        if pending == 0.0:
            return f"at rest after {generation} generations"
        # Turned round, so that loads that are not a number stop the run, too.
        if not pending <= (MOST_GROWTH_UNKNOWN if watched else MOST_GROWTH) * applied:
            growth = f"the loads have grown to {pending / applied:.0e} times the applied ones"
            remedy = (
                "; to watch them grow further, set allow_unstable=True "
                "(`kaju run --allow-unstable`)"
            )
            return stopped + growth + (remedy if watched else "")
        if self.engine.most_at_one > MOST_AT_ONE:
            return (
                f"{stopped}at one agent {self.engine.most_at_one:,} loads wait, each of another "
                "size; accumulate = true adds up loads that meet"
            )
        if generation - self._generations_before >= self.max_generations:
            return f"stopped after max_generations = {self.max_generations} with loads on their way"
        return ""

    def _outcome(self, ledger: Ledger) -> str:
        """Return how the current stage ended, in words; empty while loads travel."""
        if self.at_rest and not ledger.imbalance <= MOST_IMBALANCE:
            return (
                f"ended after {self.generation} generations with a ledger that does not balance: "
                f"{ledger.imbalance:.1e} of all loads are not accounted for"
            )
        return self._end

    @property
    def outcome(self) -> str:
        """How the current stage ended, in words; empty while loads travel."""
        return self._stage(self._outcome).outcome if self._end else ""

    def _stage(self, outcome: Callable[[Ledger], str]) -> Stage:
        """Return what the current stage has left behind so far."""
        stage: Stage = self.engine.stage(self.stage / self.scene.stages, outcome)
        return stage

    def since(self, generation: int, agents: int = 0) -> News:
        """Return what has happened in the stage after a generation, and agents beyond so many."""
        news: News = self.engine.since(generation, agents)
        return news

    @property
    def totals(self) -> Totals:
        """What each agent of the current stage has done by now, in the order of `Stage`."""
        totals: Totals = self.engine.totals()
        return totals

    def run(self, until: Until | None = None, progress: bool | None = None) -> TransferResult:
        """Step to the end, so many times, or until a question is answered yes; return the result.

        `progress`: show a progress line; None: on a terminal, when the run takes over two seconds.
        """
        if isinstance(until, bool):  # until 0.1 this came first
            warn("run: progress is a keyword, run(progress=...)", DeprecationWarning, stacklevel=2)
            until, progress = None, until
        with progress_line(progress) as report:
            return step_to_end(
                self,
                until,
                self.result,
                lambda: report(
                    f"stage {self.stage} of {self.scene.stages}, generation {self.generation}, "
                    f"{self.pending:.3g} N on the way"
                ),
            )

    def result(self) -> TransferResult:
        """Return what has been computed so far."""

        def outcome(ledger: Ledger) -> str:
            return self._outcome(ledger) or f"interrupted after {self.generation} generations"

        return TransferResult(
            scene=self.scene,
            stages=(*self.finished, self._stage(outcome)),
            certificate=self.certificate,
            seconds=self.seconds,
            parameters=dict(self.parameters),
        )
