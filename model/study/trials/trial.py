"""One trial: what a kind of trial draws from a number, and what came of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, nan
from time import process_time
from typing import Any

import numpy as np
from numpy.random import Generator

from kaju.errors import KajuError

ANSWERED, REFUSED, FAILED, UNFINISHED = VERDICTS = "answered", "refused", "failed", "not finished"

Facts = dict[str, Any]  # fields of an `Outcome`
Kind = Callable[[Generator, int], Facts]


@dataclass(frozen=True)
class Outcome:
    """What came of a trial."""

    number: int  # from which the scene was made
    family: str  # of scenes
    engine: str  # what the scene was put to
    verdict: str  # answered; refused: an error of kaju's; failed: a bug; not finished: busy machine
    what: str  # the error or the failure; how it ended, if it was answered
    agents: int = 0  # how many carried load
    estimate: float = nan  # error in the energy norm, relative, as the answer estimates it
    true_error: float = nan  # the same by graded elements of high order
    truth: float = nan  # energy by these elements (J)
    lower: float = nan  # proven bounds of the energy (J)
    upper: float = nan
    iterations: int = 0  # or steps, or generations
    seconds: float = 0.0  # of processor time


class Broken(Exception):  # noqa: N818 (it is a finding, not an error of the program)
    """An answer that must not be."""


KINDS: dict[str, Kind] = {}
"""All kinds of trial, by name."""
TURNS: dict[int, str] = {}
"""The kind whose turn it is, by a trial's number modulo 20 (or else 40)."""


def trial(name: str, *turns: int) -> Callable[[Kind], Kind]:
    """Let a function be a kind of trial: it draws from a number, judges, and returns its facts.

    `*turns`: its turns among twenty, which no other kind has, or the later ones of them, from
    20 to 39, which it takes from the kind that has both.
    """

    def enter(kind: Kind) -> Kind:
        KINDS[name] = kind
        TURNS.update(dict.fromkeys(turns, name))
        return kind

    return enter


def attempt(number: int, engine: str = "") -> Outcome:
    """Make the scene of a number, put it to an engine, its own unless given; judge the answer."""
    engine = engine or put_to(number)
    rng = np.random.default_rng([2026, number])
    start = process_time()
    facts: Facts
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            facts = {"verdict": ANSWERED, **KINDS[engine](rng, number)}
    except Broken as finding:
        facts = {"verdict": FAILED, "what": str(finding)}
    except Exception as error:
        raw = "" if isinstance(error, KajuError) else "raw "
        message = " ".join(str(error).split())[:300]
        facts = {"verdict": FAILED if raw else REFUSED}
        facts["what"] = f"{raw}{type(error).__name__}: {message}"
    family = facts.pop("family", "") or family_of(number)
    return Outcome(number, family, engine, seconds=process_time() - start, **facts)


def put_to(number: int) -> str:
    """Return the kind whose turn a number is."""
    from . import trial_kinds  # noqa: F401 (they enter themselves)

    return TURNS.get(number % 40, TURNS[number % 20])


def family_of(number: int) -> str:
    """Return the family of bodies whose turn a number is."""
    from .trial_scenes import BODIES

    return list(BODIES)[number // 10 % len(BODIES)]


def demand(holds: bool, otherwise: str) -> None:
    """Call an answer broken unless something holds."""
    if not holds:
        raise Broken(otherwise)


def demand_finite(value: Any, name: str = "summary") -> None:
    """Refuse numbers that are none, at any depth of a summary."""
    if isinstance(value, dict):
        for key, part in value.items():
            demand_finite(part, f"{name}.{key}")
    elif isinstance(value, (list, tuple)):
        for part in value:
            demand_finite(part, name)
    elif isinstance(value, float):
        demand(isfinite(value), f"{name} is {value}")


def demand_sound(result: Any) -> Facts:
    """Return an answer's summary; call it broken if a number is none, or a balance is missed."""
    summary: Facts = result.summary()
    demand_finite(summary)
    for check in result.checks():
        demand(
            check.holds,
            f"{check.what}: off by {check.off:.1e}, where {check.allowed:.0e} is allowed",
        )
    return summary


CORPUS: dict[tuple[int, str], str] = {
    (732, "tolerance"): "a solid on which 10,000 agents were given millions of cells",
    (1262, "tolerance"): "forces beside those of a moved side, which left them hardly any digits",
    (2962, "tolerance"): "a solid next to ν = -1 that hardly balanced",
    (5162, "tolerance"): "forces that did not balance, without a word",
    (5219, "tolerance"): "leftovers that no side passes on: a proof without end",
    (6589, "tolerance"): "forces that no agent passes on",
    (8529, "tolerance"): "a solid given to millions of cells",
    (1124, "equal cells"): "factors of a part on a soft bed",
    (287, "equal cells"): "rounding that leaves nothing of an answer",
    (753, "described, tolerance"): "an error that no bound holds, as an infinite number",
    (792, "described, tolerance"): "the same, of loads that a wall bears where they act",
    (1770, "described, equal"): "the truth of other cells than those that were solved",
    (4738, "misbehaving agents"): "True as a direction, which masked an array",
    (4954, "goals"): "a share of loads that move nothing, by which it was divided",
    (335, "saved"): "a run on halved cells, which was not read again",
    (796, "network"): "a network that crept for ever",
    (5036, "network"): "a network that buckled while it crept",
    (945, "elastic agents"): "next to ν = 1/2, newtons that rounding lost, as if none may be",
    (3748, "true outlines"): "corners in line but for rounding, a pocket of itself without end",
    (20068, "true outlines"): "next to ν = 1/2, bounds that rounding put in the wrong order",
}
"""Every trial that has ever failed, with why, by number and kind: they run first."""
