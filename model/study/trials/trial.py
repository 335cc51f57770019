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

Told = dict[str, Any]
Kind = Callable[[Generator, int], Told]


@dataclass(frozen=True)
class Outcome:
    """What came of a trial."""

    number: int
    """From which the scene was made."""
    family: str
    engine: str
    """Kind of scene, and what it was put to."""
    verdict: str
    """One of "answered"; "refused" is an error that kaju names, "failed" is anything that must not
    happen, "not finished" is what the machine was too busy for."""
    what: str
    """The error or the failure, in words; how it ended, if it was answered."""
    agents: int = 0
    """How many carried load."""
    estimate: float = nan
    """Estimated error of the answer in the energy norm, relative; NaN if there is none."""
    true_error: float = nan
    """The same by graded elements of high order; NaN where they were not asked."""
    truth: float = nan
    lower: float = nan
    upper: float = nan
    """Energy by these elements, and proven bounds of it (J); NaN if there are none."""
    iterations: int = 0
    """Iterations, steps or generations."""
    seconds: float = 0.0
    """Of processor time."""


class Broken(Exception):  # noqa: N818 (it is a finding, not an error of the program)
    """An answer that must not be."""


KINDS: dict[str, Kind] = {}
"""All kinds of trial, by name."""
TURNS: dict[int, str] = {}
"""Who is tried, in turn: the kind whose turn it is, by a trial's number modulo 20 (or else 40)."""


def trial(name: str, *turns: int) -> Callable[[Kind], Kind]:
    """Let a function be a kind of trial: it draws from a number, judges, and tells of it.

    `*turns`: its turns among twenty, which no other kind has, or the later ones of them, from
    20 to 39, which it takes from the kind that has both.
    """

    def known(kind: Kind) -> Kind:
        KINDS[name] = kind
        TURNS.update(dict.fromkeys(turns, name))
        return kind

    return known


def attempt(number: int, engine: str = "") -> Outcome:
    """Make the scene of a number, put it to an engine, its own unless given; judge the answer."""
    turn = put_to(number)
    engine = engine or turn
    rng = np.random.default_rng([2026, number])
    start = process_time()
    told: Told
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            told = {"verdict": ANSWERED, **KINDS[engine](rng, number)}
    except Broken as finding:
        told = {"verdict": FAILED, "what": str(finding)}
    except KajuError as error:
        told = {"verdict": REFUSED, "what": f"{type(error).__name__}: {_line(error)}"}
    except Exception as error:
        told = {"verdict": FAILED, "what": f"raw {type(error).__name__}: {_line(error)}"}
    family = told.pop("family", "") or family_of(number)
    return Outcome(number, family, engine, seconds=process_time() - start, **told)


def put_to(number: int) -> str:
    """Return the kind whose turn a number is."""
    from . import trial_kinds  # noqa: F401 (they enter themselves)

    return TURNS.get(number % 40, TURNS[number % 20])


def family_of(number: int) -> str:
    """Return the family of bodies whose turn a number is."""
    from .trial_scenes import BODIES

    return list(BODIES)[number // 10 % len(BODIES)]


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def demand(holds: bool, otherwise: str) -> None:
    """Call an answer broken unless something holds."""
    if not holds:
        raise Broken(otherwise)


def demand_finite(told: Any, name: str = "summary") -> None:
    """Refuse numbers that are none, at any depth of a summary."""
    if isinstance(told, dict):
        for key, value in told.items():
            demand_finite(value, f"{name}.{key}")
    elif isinstance(told, (list, tuple)):
        for item in told:
            demand_finite(item, name)
    elif isinstance(told, float):
        demand(isfinite(told), f"{name} is {told}")


def demand_sound(result: Any) -> Told:
    """Return an answer's summary; call it broken if a number is none, or books do not balance."""
    told: Told = result.summary()
    demand_finite(told)
    for check in result.checks():
        demand(
            check.holds,
            f"{check.what}: off by {check.off:.1e}, where {check.allowed:.0e} is allowed",
        )
    return told
