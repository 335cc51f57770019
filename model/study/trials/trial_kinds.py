"""Kinds of trial: each a function that draws from a number, asks for an answer and judges it."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from math import inf, isfinite, nan, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.random import Generator

import kaju
from kaju.errors import AgentError, KajuError

from . import trial_scenes as drawn
from .trial import Broken, Facts, demand, demand_finite, demand_sound, family_of, trial

MOST_AGENTS = 10_000  # answers that take more are given up, by a named error
FEW_CELLS, MOST_GENERATIONS = 20, 3000
TRUTH_EVERY = 4  # finite elements of high order check every so many plane bodies of a kind
LEVELS, MOST_SINGULAR = 8, 16  # halvings round every singular point, and up to how many of these
TRUTH = 1e-4  # share by which the energy of these elements may be off
OWN = 3  # the turn of agents of one's own, modulo 10


def _passed_on(scene: kaju.Scene, engine: Any, most: int, **own: Any) -> kaju.LoadModel:
    """Return a model that may grow, up to so many generations; chance is the same every time."""
    return kaju.LoadModel(scene, engine, rng=1, allow_unstable=True, max_generations=most, **own)


@trial("prescribed rule", 0, 3)
def _transfer(rng: Generator, number: int) -> Facts:
    """Pass loads on by chosen shares: they end as the certificate says, and the ledger balances."""
    scene = drawn.transfer_scene(rng)
    turn = number % 10 == OWN and scene.lattice.kind == "square"
    own = {"material_agent": Grain} if turn else {}
    # Objects are slow where loads are many: they are tried on the smallest bodies.
    engine = "agents" if own or scene.lattice.size <= FEW_CELLS else "arrays"
    model = _passed_on(scene, engine, MOST_GENERATIONS, **own)
    certificate = model.certificate
    radius = certificate.spectral_radius
    if model.accumulate and certificate.generations and radius is not None:
        demand(radius < 1.0, "stable, and a spectral radius of 1 or more")
    result = model.run(progress=False)
    demand_sound(result)
    for stage in result.stages:
        demand(isfinite(stage.ledger.taken), "a load that is no number was taken")
        if certificate.generations is not None:
            demand(
                stage.generations <= certificate.generations,
                f"{stage.generations} generations, where the certificate says at most "
                f"{certificate.generations}",
            )
    outcome = result.last.outcome
    ends = certificate.generations is not None and certificate.generations <= MOST_GENERATIONS
    # Loads judged by themselves all end, yet may first become more than a run waits for.
    grew = "grown" in outcome and not (radius is not None and radius < 1.0)
    demand(grew or not (ends and "stopped" in outcome), f"stable, but {outcome}")
    promise = "stable" if certificate.stable else "may grow"
    return {
        "family": f"{scene.lattice.kind}, {'own agents' if own else promise}",
        "what": outcome,
        "agents": len(result.last.cells),
        "iterations": result.last.generations,
    }


class Grain(kaju.MaterialAgent):
    """An agent of one's own, which draws how much it passes ahead and loses the rest."""

    def __init__(self, model: Any, cell: Any, material: Any, shares: Any) -> None:
        forward = float(model.rng.uniform(0.0, 0.7))
        drawn = replace(shares, forward=forward, friction=float(model.rng.uniform(0.0, 0.3)))
        super().__init__(model, cell, material, drawn)


def _solved(
    name: str,
    turns: tuple[int, ...],
    scene_of: Callable[[Generator, str], kaju.Scene],
    asks_of: Callable[[Generator], dict[str, Any]],
) -> None:
    """Enter a kind that solves scenes as it asks for, and judges with the truth in between."""

    @trial(name, *turns)
    def kind(rng: Generator, number: int) -> Facts:
        scene, asks = scene_of(rng, family_of(number)), asks_of(rng)
        # At another resolution regions are asked again: the scene's cells are not that body.
        known = asks.get("resolution") in (None, 1) and number // 20 % TRUTH_EVERY == 0
        return _judged(scene, kaju.solve(scene, **asks), known)


def _within(*tolerances: float) -> Callable[[Generator], dict[str, Any]]:
    return lambda rng: {"tolerance": float(rng.choice(tolerances)), "most_agents": MOST_AGENTS}


_solved("equal cells", (1, 4, 7), drawn.elastic_scene, lambda rng: {})
_solved("tolerance", (2, 9), drawn.elastic_scene, _within(0.2, 0.1))
_solved(
    "described, equal",
    (10, 11),
    drawn.described_scene,
    lambda rng: {"resolution": int(rng.integers(0, 4)) or None},
)
_solved("described, tolerance", (12, 13), drawn.described_scene, _within(0.3, 0.1))


def _judged(scene: kaju.Scene, result: Any, known: bool) -> Facts:
    """Judge an answer of linear elasticity: numbers, balance, and sometimes the truth."""
    summary = demand_sound(result)
    energy = result.strain_energy
    pulled = any(scene.side_condition(name).kind == "displaced" for name in scene.lattice.sides)
    demand(energy >= 0.0 or pulled, f"a strain energy of {energy:.2e} J")
    truth = _true_energy(result.grid) if known else nan
    lower = upper = nan
    if truth > 0.0 and result.provable and result.energy_bounds is not None:
        lower, upper = result.energy_bounds
        demand(
            lower <= truth * (1.0 + TRUTH) and truth <= upper * (1.0 + TRUTH),
            f"the true energy {truth:.6e} J lies outside of its bounds {lower:.6e}, {upper:.6e}",
        )
    return {
        "what": str(summary["method"]),
        "agents": int(summary["agents"]),
        "estimate": float(result.error_estimate),
        "true_error": sqrt(abs(energy / truth - 1.0)) if truth > 0.0 else nan,
        "truth": truth,
        "lower": lower,
        "upper": upper,
        "iterations": max(len(result.residuals) - 1, 0),
    }


def _true_energy(scene: kaju.Scene) -> float:
    """Return the energy by graded elements; NaN if they cannot tell, or only slowly."""
    from kaju.model.study.finite_elements import singular_points, surroundings

    try:
        if scene.lattice.dimension != 2:
            return nan
        if len(singular_points(scene, surroundings(scene))) > MOST_SINGULAR:
            return nan
        return kaju.finite_elements(scene, order=4, levels=LEVELS).strain_energy or nan
    except KajuError:
        return nan


@trial("elastic agents", 5)
def _agents(rng: Generator, number: int) -> Facts:
    """Let elastic agents settle, in one of their orders of work."""
    order: Any = ["wave", "largest first", "multilevel"][rng.integers(3)]
    scene = drawn.elastic_scene(rng, family_of(number))
    force = float(np.abs(scene.applied().force).max(initial=0.0))
    threshold = max(force * float(10 ** rng.uniform(-3, 0)), 1e-300)
    scene = scene.replace(rule=kaju.ElasticRule(order=order, threshold=threshold))
    model = kaju.ElasticModel(scene, max_steps=300)
    run = model.run()
    demand_sound(run)
    outcome = str(run.outcome)
    demand("grown" not in outcome, f"stable by its certificate, but {outcome}")
    return {"what": f"{order}: {outcome}", "iterations": model.generation}


@trial("network", 6)
def _network(rng: Generator, number: int) -> Facts:
    """Press a lattice of springs or a body of hexagons, lightly or until it gives way, or creep."""
    from kaju.model.network.hexagon_body import hexagon_body
    from kaju.model.network.spring_lattices import triangular

    family = "lattice"
    if rng.random() < 0.4:
        network, family = hexagon_body(drawn.hexagon_scene(rng)), "hexagons"
    else:
        force = float(10 ** rng.uniform(-3, 0.5))
        network = triangular(int(rng.integers(2, 9)), int(rng.integers(2, 9)), force=force)
    agents = {"family": family, "agents": len(network.positions)}
    if rng.random() < 0.6:
        demand_sound(kaju.solve(network))
        return {"what": "in balance", **agents}
    pace = float(10 ** rng.uniform(-3, 3))
    k, d_f, d_d = (float(10 ** rng.uniform(-2, 2)) for _ in range(3))
    law = kaju.ThreeElement(K_f=k, D_f=d_f * pace, D_d=d_d * pace)
    history = kaju.History.step().hold(5.0 * pace)
    run = kaju.creep(network, history, rheology=law, times=[pace, 5.0 * pace], tolerance=1e-2)
    demand_sound(run)
    demand(bool(np.isfinite(run.displacement).all()), "a displacement that is no number")
    return {"what": "creeps", **agents}


@trial("three elements", 8)
def _element(rng: Generator, number: int) -> Facts:
    """Hold a steady force on a three-element material: the scheme has an exact answer."""
    k, d_f, d_d = (float(10 ** rng.uniform(-6, 6)) for _ in range(3))
    element = kaju.ThreeElement(K_f=k, D_f=d_f, D_d=d_d if rng.random() < 0.8 else inf)
    step, force = float(10 ** rng.uniform(-6, 6)), float(rng.normal())
    n = np.arange(1, 30)
    found = np.asarray(element.creep(force=force, times=step * n))
    exact = force * (n * step / element.D_d - np.expm1(-n * np.log1p(step * k / d_f)) / k)
    demand(bool(np.isfinite(found).all()), "a displacement that is no number")
    miss = float(np.abs(found - exact).max() / np.abs(exact).max())
    demand(miss < 1e-9, f"creep is off by {miss:.1e} of the scheme's exact answer")
    return {"family": "one element", "what": "creeps", "iterations": 29}


@trial("goals", 14)
def _goals(rng: Generator, number: int) -> Facts:
    """Ask for a quantity at two tolerances: what is certain of it must be so at both."""
    scene = drawn.described_scene(rng, family_of(number))
    size = np.array(scene.lattice.extent)
    low = size * rng.uniform(0.0, 0.6, len(size))
    box = {"box": [low.tolist(), (low + 0.4 * size).tolist()]}
    point = (size * rng.uniform(0.05, 0.95, len(size))).tolist()
    places: list[Any] = ["top", point, box]
    place = places[rng.integers(3)]
    goals = [kaju.Deflection(place, "y"), kaju.Stress(place, "yy"), kaju.Stress(box, "von_mises")]
    goal: Any = goals[rng.integers(3)]
    certain = []
    asked = {"tolerance_at": goal, "strategy": "spawning", "most_agents": MOST_AGENTS}
    for tolerance in (0.3, 0.1):
        result: Any = kaju.solve(scene, tolerance=tolerance, **asked)
        demand_sound(result)
        (found,) = result.goals
        if found.error_bound is not None:
            value, off = float(np.max(found.value)), float(found.error_bound)
            certain.append((value - off, value + off))
    demand_one_truth(certain)
    return {"what": type(goal).__name__, "agents": result.agents}


def demand_one_truth(certain: list[tuple[float, float]]) -> None:
    """Call answers broken if no value lies within the bounds of all."""
    lower = max((low for low, _ in certain), default=-inf)
    upper = min((high for _, high in certain), default=inf)
    room = 1e-9 * max(abs(lower), abs(upper)) if certain else 0.0
    demand(lower <= upper + room, f"no value lies within all of {certain}, which are certain")


@trial("true outlines", 23, 28)
def _outlined(rng: Generator, number: int) -> Facts:
    """Solve a body of true outlines on two grids: both bounds hold one energy; save and read."""
    scene = drawn.outlined_scene(rng)
    certain = []
    for times, tolerance in ((1, 0.2), (int(rng.integers(2, 4)), 0.1)):
        lattice = scene.lattice
        grid = {"cells": [times * n for n in lattice.shape], "cell_size": lattice.cell_size / times}
        finer = scene.with_overrides({f"body.{key}": value for key, value in grid.items()})
        result: Any = kaju.solve(finer, tolerance=tolerance, most_agents=MOST_AGENTS)
        summary = demand_sound(result)
        demand(
            tuple(summary["energy_bounds"]) == result.energy_bounds,
            "bounds that the summary does not hold",
        )
        demand(result.error_bound <= tolerance, "a tolerance that is not kept")
        for name in result.hoops:
            demand_finite(result.outline_stress(name)[1].tolist(), "hoop stress")
        certain.append(result.energy_bounds)
    demand_one_truth(certain)
    summary = {"family": f"{len(result.hoops)} outlines", "what": "proved", "agents": result.agents}
    return {**_read_again(rng, result), **summary}


@trial("saved", 15)
def _saved(rng: Generator, number: int) -> Facts:
    """Save an answer and read it."""
    variant = int(rng.integers(4))
    if variant == 0:
        result: Any = _passed_on(drawn.transfer_scene(rng), "arrays", 100).run(progress=False)
    elif variant == 1:
        result = kaju.ElasticModel(drawn.elastic_scene(rng, family_of(number)), max_steps=50).run()
    else:
        scene = drawn.described_scene(rng, family_of(number))
        asks: dict[str, Any] = (
            {"tolerance": 0.3, "most_agents": MOST_AGENTS} if variant == 2 else {}
        )
        result = kaju.solve(scene, **asks)
    return {"what": "the same", **_read_again(rng, result)}


def _read_again(rng: Generator, result: Any) -> Facts:
    """Save and read: the same; turn a bit over: refused, or nothing depended on it."""
    saved = pickle.dumps(result._stored())
    with TemporaryDirectory() as folder:
        path = result.save(Path(folder) / "answer.npz")
        try:
            again = kaju.load_result(path)
        except KajuError as error:
            raise Broken(f"what was saved cannot be read: {error}") from error
        demand(pickle.dumps(again._stored()) == saved, "read again it is another answer")
        demand_sound(again)
        data = bytearray(path.read_bytes())
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            same = pickle.dumps(kaju.load_result(path)._stored()) == saved
        except KajuError:
            same = True
        demand(same, "with a bit turned over it was read as another answer")
    return {"family": type(result).__name__}


@trial("pages", 16)
def _page(rng: Generator, number: int) -> Facts:
    """Write a page of a scene, a run or an answer."""
    variant = int(rng.integers(3))
    shown: Any
    if variant == 0:
        shown = kaju.solve(drawn.described_scene(rng, family_of(number)))
    else:
        shown = drawn.transfer_scene(rng)
        if variant == 1:
            shown = _passed_on(shown, "arrays", 200).run(progress=False)
    with TemporaryDirectory() as folder:
        path = kaju.export_page(shown, Path(folder) / "page.html")
        demand(b"kaju-data" in path.read_bytes(), "a page without data")
        demand(len(list(Path(folder).iterdir())) == 1, "something is left beside the page")
    return {"family": type(shown).__name__, "what": "a page"}


@trial("creeping bodies", 17)
def _creeping(rng: Generator, number: int) -> Facts:
    """Let a body of one or two laws creep, by the prescribed rule or elastically."""
    pace = float(10 ** rng.uniform(-3, 3))
    scene = drawn.described_scene(rng, family_of(number), pace=pace)
    if rng.random() < 0.3:
        sides = dict.fromkeys(scene.sides, "rigid")
        scene = scene.replace(sides=sides).with_overrides({"rule.kind": "prescribed"})
    history = kaju.History.step().hold(3.0 * pace)
    if rng.random() < 0.5:
        history = history.release().hold(3.0 * pace)
    result: Any = kaju.creep(scene, history, times=[pace, 3.0 * pace], tolerance=1e-2)
    demand_sound(result)
    return {"what": "creeps", "iterations": int(result.state.steps)}


@trial("misbehaving agents", 18)
def _misbehaving(rng: Generator, number: int) -> Facts:
    """Let agents or ground answer nonsense: refused by name, or harmless as the ledger shows."""
    mine, rigid = kaju.MaterialAgent, kaju.RigidBoundaryAgent
    worst: list[Any] = [nan, inf, -1.0, 1e308, 0.0, 3.0, None, "half", 1j, 10**400, [], True]
    nonsense: Any = worst[rng.integers(len(worst))]
    field, turn = int(rng.integers(4)), float(rng.uniform(0.0, 0.5))

    def changed(self: Any, load: Any) -> Any:
        emissions = [list(emission) for emission in mine.emissions(self, load)]
        if emissions and self.model.rng.random() < turn:
            emissions[0][field] = nonsense
        return tuple(map(tuple, emissions))

    def returned(self: Any, load: Any, arm: int) -> Any:
        return self.turn(load, arm)._replace(magnitude=nonsense)

    own: dict[str, Any] = {"material_agent": type("Mine", (mine,), {"emissions": changed})}
    if rng.random() < 0.3:
        own = {"boundary_agents": {"rigid": type("Ground", (rigid,), {"give_back": returned})}}
    try:
        result = _passed_on(drawn.transfer_scene(rng), "agents", 50, **own).run(progress=False)
    except AgentError as error:
        return {"family": "refused", "what": str(error).partition(":")[0]}
    demand_sound(result)
    return {"family": "harmless", "what": result.last.outcome}


@trial("prescribed, described; large", 19)
def _prescribed(rng: Generator, number: int) -> Facts:
    """Pass weight and described loads on; every fifth time solve a body of 10⁵ cells."""
    if number // 20 % 5 == 0:
        scene = drawn.large_scene(rng)
        return {"family": "10⁵ cells", **_judged(scene, kaju.solve(scene), False)}
    scene = drawn.described_scene(rng, family_of(number), rule="prescribed")
    result = _passed_on(scene, "arrays", 300).run(progress=False)
    demand_sound(result)
    return {"what": result.last.outcome, "agents": len(result.last.cells)}
