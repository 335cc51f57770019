"""Load transfer, stage by stage and generation by generation, on an engine of either kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Self

from kaju.agents.parameter import is_number
from kaju.agents.rules import ShareRule
from kaju.errors import StabilityError, brief, require
from kaju.model.scene import Scene
from kaju.model.stepper import Stepper, counted, not_balanced

from .array_engine import ArrayEngine
from .stability import MOST_GROWN, Certificate, certify, not_known
from .stage import Stage
from .transfer import Transfer
from .transfer_result import TransferResult


class LoadTransfer(Stepper[TransferResult]):
    """Loads that pass through a body, stage by stage, until they are at rest.

    `engine_of` makes the engine from the tables of the rule; `own` names classes of agents of
    one's own, about which nothing is certain before the run; `ordered`: an order decides when it
    ends. It begins with `reset`. On arrays it runs by itself, and waits for no import of Mesa;
    `LoadModel` runs it with agents.
    """

    parameters: Mapping[str, Any] = MappingProxyType({})  # of agents of your own

    def __init__(
        self,
        scene: Scene,
        allow_unstable: bool = False,
        max_generations: int = 10_000,
        *,
        rule: ShareRule | None = None,
        own: list[str] | None = None,
        ordered: bool = False,
        engine_of: Callable[[Transfer], Any] = ArrayEngine,
    ) -> None:
        self.scene, self.allow_unstable = scene, allow_unstable
        self.max_generations, self.own = max_generations, tuple(own or ())
        told = f"max_generations: must be a number from 1 upwards, got {brief(max_generations)}"
        require(is_number(max_generations) and max_generations >= 1, told)
        self.transfer = Transfer(scene, rule)
        self.certificate: Certificate = not_known(own) if own else certify(self.transfer, ordered)
        refused = self.certificate.known and not self.certificate.stable
        if refused and not allow_unstable:
            told = f"{self.certificate.verdict}; to watch the loads grow, set allow_unstable=True"
            raise StabilityError(f"{told} (`kaju run --allow-unstable`)")
        self.engine = engine_of(self.transfer)

    def reset(self) -> Self:
        """Go to the first stage, before any load was taken; return it, ready to run."""
        self.finished: list[Stage] = []
        self.running, self.steps, self.seconds = True, 0, 0.0
        self._begin_stage(1)
        return self

    def _begin_stage(self, stage: int) -> None:
        self.stage, self._over = stage, False
        live_on = stage > 1 and self.scene.loading == "continue"
        self._generations_before = self.engine.generation if live_on else 0
        self.engine.start(*self.transfer.loads(stage), live_on=live_on)

    def advance(self) -> None:
        """Let one generation of loads be taken."""
        self.begin()
        self.engine.act()
        self.end()

    def begin(self) -> None:
        """Begin a generation; a new stage begins when one is at rest."""
        if self._over:
            self.finished.append(self._stage())
            self._begin_stage(self.stage + 1)
        self._taken_before = self.engine.taken
        if self.engine.pending != 0.0:
            self.engine.begin()

    def end(self) -> None:
        """End a generation: boundaries give back, and loads arrive."""
        self.engine.end()
        self._over = bool(self._end())
        more = self.engine.pending == 0.0 and self.stage < self.scene.stages
        self.running = more or not self._over

    def _end(self) -> str:
        """Return why the current stage is over, in words; empty while loads travel."""
        engine = self.engine
        generation, pending, applied = engine.generation, engine.pending, engine.applied
        after = f"after {counted(generation, 'generation')}"
        if pending == 0.0 and generation == self._generations_before:
            gamma = self.transfer.rule.threshold
            return f"no load exceeds the threshold of {gamma:g} N: nothing happens"
        if pending == 0.0:
            return f"at rest {after}"
        watched = not (self.certificate.known or self.allow_unstable)
        if not pending <= (1e3 if watched else MOST_GROWN) * applied:  # or NaN
            told = f"stopped {after}: the loads have grown to"
            told += f" {pending / applied:.0e} times the applied ones"
            remedy = "; shares are for each newton taken, not newtons; to watch them grow further,"
            remedy += " set allow_unstable=True (`kaju run --allow-unstable`)"
            return told + remedy if watched else told
        if engine.most_at_one > 30_000:
            told = f"stopped {after}: {engine.most_at_one:,} loads wait at one agent, each of"
            told += " another size;"
            return f"{told} accumulate = true adds up loads that meet"
        if generation - self._generations_before >= self.max_generations:
            told = f"stopped after max_generations = {self.max_generations} with loads on their way"
            stuck = bool(engine.taken - self._taken_before <= 1e-9 * pending)
            return told + "; in the last generation no agent took what waits for it" * stuck
        return ""

    @property
    def outcome(self) -> str:
        """How the current stage ended, in words; empty while loads travel."""
        return self._stage().outcome if self._end() else ""

    def _stage(self, otherwise: str = "") -> Stage:
        """Return what the current stage has left behind so far, and how it ended, or else."""
        stage: Stage = self.engine.stage(self.stage / self.scene.stages)
        outcome, imbalance = self._end() or otherwise, stage.ledger.imbalance
        if self.engine.pending == 0.0 and not imbalance <= 1e-9:  # or NaN
            outcome = not_balanced(counted(self.engine.generation, "generation"), imbalance)
        return replace(stage, outcome=outcome)

    def result(self) -> TransferResult:
        """Return what has been computed so far."""
        last = self._stage(f"interrupted after {counted(self.engine.generation, 'generation')}")
        return TransferResult(
            scene=self.scene,
            stages=(*self.finished, last),
            certificate=self.certificate,
            seconds=self.seconds,
            parameters=dict(self.parameters),
            own_agents=self.own,
        )

    def progress(self) -> str:
        """Return a line of progress."""
        stage, generation = f"stage {self.stage} of {self.scene.stages}", self.engine.generation
        return f"{stage}, generation {generation}, {self.engine.pending:.3g} N on the way"
