"""One trial: a scene from a number, put to one rule, order or solver, and what came of it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from time import process_time
from typing import Any

import numpy as np
from numpy.random import Generator

from kaju.errors import KajuError
from kaju.model.scene import Scene

from .trial_scenes import BODIES, elastic_scene, hexagon_scene, transfer_scene

ANSWERED, REFUSED, FAILED = "answered", "refused", "failed"

BALANCE = 1e-6
"""Share of the forces by which supports may miss the loads without a word in the notes."""
BALANCE_OF_ERROR = 1e-2
"""The same, as a share of the error that the answer states."""
MOST_AGENTS = 10_000
"""What asks for more is given up, by a named error."""
BOOKS = 1e-12
"""Share of the loads by which the ledger may be off."""
FEW_CELLS, MOST_GENERATIONS = 20, 3000
TRUTH_EVERY = 4
"""Finite elements of high order check every so many plane bodies."""
LEVELS, MOST_SINGULAR = 8, 16
"""How often they are halved round every singular point, and up to how many of these."""
TRUTH = 1e-4
"""Share by which the energy of these elements may be off."""


@dataclass(frozen=True)
class Outcome:
    """What came of a trial.

    Attributes
    ----------
    number : int
        From which the scene was made.
    family, engine : str
        Kind of scene, and what it was put to.
    verdict : {"answered", "refused", "failed"}
        "refused" is an error that kaju names; "failed" is anything that must not happen.
    what : str
        The error or the failure, in words; how it ended, if it was answered.
    agents : int
        How many carried load.
    estimate : float
        Estimated error of the answer in the energy norm, relative; NaN if there is none.
    true_error : float
        The same by graded elements of high order; NaN where they were not asked.
    truth, lower, upper : float
        Energy by these elements, and proven bounds of it (J); NaN if there are none.
    iterations : int
        Iterations, steps or generations.
    seconds : float
        Of processor time.
    """

    number: int
    family: str
    engine: str
    verdict: str
    what: str
    agents: int = 0
    estimate: float = nan
    true_error: float = nan
    truth: float = nan
    lower: float = nan
    upper: float = nan
    iterations: int = 0
    seconds: float = 0.0


class Broken(Exception):  # noqa: N818 (it is a finding, not an error of the program)
    """An answer that must not be."""


def attempt(number: int) -> Outcome:
    """Make the scene of a number, put it to its engine, and judge what comes of it."""
    rng = np.random.default_rng([2026, number])
    family, engine = put_to(number)
    start = process_time()
    told: dict[str, Any]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            told = {"verdict": ANSWERED, **_TO[engine](rng, family, number)}
    except Broken as finding:
        told = {"verdict": FAILED, "what": str(finding)}
    except KajuError as error:
        told = {"verdict": REFUSED, "what": f"{type(error).__name__}: {_line(error)}"}
    except Exception as error:
        told = {"verdict": FAILED, "what": f"raw {type(error).__name__}: {_line(error)}"}
    family = told.pop("family", family)
    return Outcome(number, family, engine, seconds=process_time() - start, **told)


def put_to(number: int) -> tuple[str, str]:
    """Return the family of a trial's scene, and the engine it is put to."""
    families = list(BODIES)
    engine = ENGINES[number % len(ENGINES)]
    return _OWN.get(engine, families[number // len(ENGINES) % len(families)]), engine


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def _transfer(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Pass loads on by chosen shares: they end as the certificate says, and the books balance."""
    from kaju.model.transfer.load_model import EngineName, LoadModel

    scene = transfer_scene(rng)
    # Objects are slow where loads are many: they are tried on the smallest bodies.
    engine: EngineName = "agents" if scene.lattice.size <= FEW_CELLS else "arrays"
    own = _grains() if number % len(ENGINES) == OWN and scene.lattice.kind == "square" else {}
    engine = "agents" if own else engine
    model = LoadModel(scene, engine, allow_unstable=True, max_generations=MOST_GENERATIONS, **own)
    certificate = model.certificate
    radius = certificate.spectral_radius
    if model.accumulate and certificate.generations and radius is not None:
        _demand(radius < 1.0, "stable, and a spectral radius of 1 or more")
    result = model.run(progress=False)
    taken = 0.0
    for stage in result.stages:
        books = stage.ledger
        entered, became = books.applied + books.emitted, books.taken + books.dropped + books.pending
        _demand(
            abs(entered - became) <= BOOKS * max(entered, became),
            f"the books are off by {entered - became:.2e} of {entered:.2e} N",
        )
        _demand(isfinite(books.taken), "a load that is no number was taken")
        taken += books.taken
        if certificate.generations is not None:
            _demand(
                stage.generations <= certificate.generations,
                f"{stage.generations} generations, where the certificate says at most "
                f"{certificate.generations}",
            )
    outcome = result.last.outcome
    ends = certificate.generations is not None and certificate.generations <= MOST_GENERATIONS
    # Loads judged by themselves all end, yet may first become more than a run waits for.
    grew = "grown" in outcome and not (radius is not None and radius < 1.0)
    _demand(grew or not (ends and "stopped" in outcome), f"stable, but {outcome}")
    promise = "stable" if certificate.stable else "may grow"
    return {
        "family": f"{scene.lattice.kind}, {'own agents' if own else promise}",
        "what": outcome,
        "agents": len(result.last.cells),
        "iterations": result.last.generations,
    }


def _grains() -> dict[str, Any]:
    """Return agents of one's own, who draw how much they pass ahead and lose the rest."""
    from dataclasses import replace

    from kaju.agents.material_agent import MaterialAgent

    class Grain(MaterialAgent):
        def __init__(self, model: Any, cell: Any, material: Any, shares: Any) -> None:
            forward = float(model.rng.uniform(0.0, 0.7))
            drawn = replace(shares, forward=forward, friction=float(model.rng.uniform(0.0, 0.3)))
            super().__init__(model, cell, material, drawn)

    return {"material_agent": Grain}


def _equal(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Solve the scene's own cells."""
    from kaju.model.study.solving import solve

    scene = elastic_scene(rng, family)
    return _judged(scene, solve(scene), number)


def _within(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Solve by whatever keeps a tolerance."""
    from kaju.model.study.solving import solve

    scene = elastic_scene(rng, family)
    tolerance = float(rng.choice([0.2, 0.1]))
    return _judged(scene, solve(scene, tolerance=tolerance, most_agents=MOST_AGENTS), number)


def _agents(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Let elastic agents settle, in one of their orders of work."""
    from kaju.agents.elastic_rule import ElasticRule, Order
    from kaju.model.elastic.settling.elastic_model import ElasticModel

    orders: list[Order] = ["wave", "largest first", "multilevel"]
    order = orders[rng.integers(3)]
    scene = elastic_scene(rng, family)
    force = float(np.abs(scene.applied().force).max(initial=0.0))
    threshold = max(force * float(10 ** rng.uniform(-3, 0)), 1e-300)
    scene = scene.replace(rule=ElasticRule(order=order, threshold=threshold))
    model = ElasticModel(scene, max_steps=300)
    run = model.run()
    _demand_finite(run.summary())
    outcome = str(run.outcome)
    _demand("grown" not in outcome, f"stable by its certificate, but {outcome}")
    return {"what": f"{order}: {outcome}", "iterations": model.generation}


def _network(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Press a lattice of springs or a body of hexagons, lightly or until it gives way, or creep."""
    from kaju.model.network.hexagon_body import hexagon_body
    from kaju.model.network.lattices import triangular
    from kaju.model.rheology.creeping import creep
    from kaju.model.rheology.element import ThreeElement
    from kaju.model.rheology.load_history import History
    from kaju.model.study.solving import solve

    if rng.random() < 0.4:
        network, family = hexagon_body(hexagon_scene(rng)), "hexagons"
    else:
        force = float(10 ** rng.uniform(-3, 0.5))
        network = triangular(int(rng.integers(2, 9)), int(rng.integers(2, 9)), force=force)
    agents = {"family": family, "agents": len(network.positions)}
    if rng.random() < 0.6:
        _demand_finite(solve(network).summary())
        return {"what": "in balance", **agents}
    pace = float(10 ** rng.uniform(-3, 3))
    k, d_f, d_d = (float(10 ** rng.uniform(-2, 2)) for _ in range(3))
    law = ThreeElement(K_f=k, D_f=d_f * pace, D_d=d_d * pace)
    history = History.step().hold(5.0 * pace)
    run = creep(network, history, rheology=law, times=[pace, 5.0 * pace], tolerance=1e-2)
    _demand(bool(np.isfinite(run.displacement).all()), "a displacement that is no number")
    return {"what": "creeps", **agents}


def _element(rng: Generator, family: str, number: int) -> dict[str, Any]:
    """Hold a steady force on a three-element material: the scheme has an exact answer."""
    from kaju.model.rheology.element import ThreeElement

    k, d_f, d_d = (float(10 ** rng.uniform(-6, 6)) for _ in range(3))
    element = ThreeElement(K_f=k, D_f=d_f, D_d=d_d if rng.random() < 0.8 else inf)
    step, force = float(10 ** rng.uniform(-6, 6)), float(rng.normal())
    times = step * np.arange(1, 30)
    found = np.asarray(element.creep(force=force, times=times))
    n = np.arange(1, 30)
    exact = force * (n * step / element.D_d - np.expm1(-n * np.log1p(step * k / d_f)) / k)
    _demand(bool(np.isfinite(found).all()), "a displacement that is no number")
    miss = float(np.abs(found - exact).max() / np.abs(exact).max())
    _demand(miss < 1e-9, f"creep is off by {miss:.1e} of the scheme's exact answer")
    return {"what": "creeps", "iterations": 29}


_TO: dict[str, Callable[[Generator, str, int], dict[str, Any]]] = {
    "prescribed rule": _transfer,
    "equal cells": _equal,
    "tolerance": _within,
    "elastic agents": _agents,
    "network": _network,
    "three elements": _element,
}
_OWN = {"network": "lattice", "three elements": "one element", "prescribed rule": "cells"}
ENGINES = (
    "prescribed rule",
    "equal cells",
    "tolerance",
    "prescribed rule",
    "equal cells",
    "elastic agents",
    "network",
    "equal cells",
    "three elements",
    "tolerance",
)
"""Who is tried, in turn."""
OWN = 3
"""In whose turn it is agents of one's own that pass loads on."""


def _judged(scene: Scene, result: Any, number: int) -> dict[str, Any]:
    """Judge an answer of linear elasticity: numbers, balance, and sometimes the truth."""
    told = result.summary()
    _demand_finite(told)
    energy = result.strain_energy
    applied = scene.applied().force
    pulled = any(scene.side_condition(name).kind == "displaced" for name in scene.lattice.sides)
    _demand(energy >= 0.0 or pulled, f"a strain energy of {energy:.2e} J")
    missing = sum(result.reactions.values(), applied.sum(axis=0))
    forces = np.abs(applied).sum() + sum(np.abs(r).sum() for r in result.reactions.values())
    off = float(np.abs(missing).max() / forces) if forces > 0.0 else 0.0
    said = any("unbalanced" in note or "balance to" in note for note in result.notes)
    allowed = max(BALANCE, BALANCE_OF_ERROR * result.error_estimate)
    _demand(said or off <= allowed, f"supports and loads differ by {off:.1e} of the forces")
    truth = _true_energy(scene) if number % TRUTH_EVERY == 0 else nan
    lower = upper = nan
    if truth > 0.0 and result.provable and result.energy_bounds is not None:
        lower, upper = result.energy_bounds
        _demand(
            lower <= truth * (1.0 + TRUTH) and truth <= upper * (1.0 + TRUTH),
            f"the true energy {truth:.6e} J lies outside of its bounds {lower:.6e}, {upper:.6e}",
        )
    true_error = sqrt(abs(energy / truth - 1.0)) if truth > 0.0 else nan
    return {
        "what": str(told["method"]),
        "agents": int(told["agents"]),
        "estimate": float(result.error_estimate),
        "true_error": true_error,
        "truth": truth,
        "lower": lower,
        "upper": upper,
        "iterations": max(len(result.residuals) - 1, 0),
    }


def _true_energy(scene: Scene) -> float:
    """Return the energy by graded elements; NaN if they cannot tell, or only slowly."""
    try:
        from kaju.model.study.finite_elements import finite_elements, singular_points, surroundings

        if scene.lattice.dimension != 2:
            return nan
        if len(singular_points(scene, surroundings(scene))) > MOST_SINGULAR:
            return nan
        return finite_elements(scene, order=4, levels=LEVELS).strain_energy or nan
    except KajuError:
        return nan


def _demand(holds: bool, otherwise: str) -> None:
    if not holds:
        raise Broken(otherwise)


def _demand_finite(told: Any, name: str = "summary") -> None:
    """Refuse numbers that are none, at any depth of a summary."""
    if isinstance(told, dict):
        for key, value in told.items():
            _demand_finite(value, f"{name}.{key}")
    elif isinstance(told, (list, tuple)):
        for item in told:
            _demand_finite(item, name)
    elif isinstance(told, float):
        _demand(isfinite(told), f"{name} is {told}")
