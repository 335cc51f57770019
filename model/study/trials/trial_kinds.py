"""Kinds of trial: each a function that draws from a number, asks for an answer and judges it."""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.random import Generator

from kaju.errors import AgentError, KajuError
from kaju.model.scene import Scene

from .trial import Broken, Told, demand, demand_checks, demand_finite, family_of, trial
from .trial_scenes import described_scene, elastic_scene, hexagon_scene, large_scene, transfer_scene

MOST_AGENTS = 10_000
"""What asks for more is given up, by a named error."""
FEW_CELLS, MOST_GENERATIONS = 20, 3000
TRUTH_EVERY = 4
"""Finite elements of high order check every so many plane bodies."""
LEVELS, MOST_SINGULAR = 8, 16
"""How often they are halved round every singular point, and up to how many of these."""
TRUTH = 1e-4
"""Share by which the energy of these elements may be off."""
OWN = 3
"""In whose turn it is agents of one's own that pass loads on."""


@trial("prescribed rule", 0, 3)
def _transfer(rng: Generator, number: int) -> Told:
    """Pass loads on by chosen shares: they end as the certificate says, and the books balance."""
    from kaju.model.transfer.load_model import EngineName, LoadModel

    scene = transfer_scene(rng)
    # Objects are slow where loads are many: they are tried on the smallest bodies.
    engine: EngineName = "agents" if scene.lattice.size <= FEW_CELLS else "arrays"
    own = _grains() if number % 10 == OWN and scene.lattice.kind == "square" else {}
    engine = "agents" if own else engine
    model = LoadModel(scene, engine, allow_unstable=True, max_generations=MOST_GENERATIONS, **own)
    certificate = model.certificate
    radius = certificate.spectral_radius
    if model.accumulate and certificate.generations and radius is not None:
        demand(radius < 1.0, "stable, and a spectral radius of 1 or more")
    result = model.run(progress=False)
    demand_checks(result)
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


@trial("equal cells", 1, 4, 7)
def _equal(rng: Generator, number: int) -> Told:
    """Solve the scene's own cells."""
    from kaju.model.study.solving import solve

    scene = elastic_scene(rng, family_of(number))
    return _judged(scene, solve(scene), number)


@trial("tolerance", 2, 9)
def _within(rng: Generator, number: int) -> Told:
    """Solve by whatever keeps a tolerance."""
    from kaju.model.study.solving import solve

    scene = elastic_scene(rng, family_of(number))
    tolerance = float(rng.choice([0.2, 0.1]))
    return _judged(scene, solve(scene, tolerance=tolerance, most_agents=MOST_AGENTS), number)


@trial("elastic agents", 5)
def _agents(rng: Generator, number: int) -> Told:
    """Let elastic agents settle, in one of their orders of work."""
    from kaju.agents.elastic_rule import ElasticRule, Order
    from kaju.model.elastic.settling.elastic_model import ElasticModel

    orders: list[Order] = ["wave", "largest first", "multilevel"]
    order = orders[rng.integers(3)]
    scene = elastic_scene(rng, family_of(number))
    force = float(np.abs(scene.applied().force).max(initial=0.0))
    threshold = max(force * float(10 ** rng.uniform(-3, 0)), 1e-300)
    scene = scene.replace(rule=ElasticRule(order=order, threshold=threshold))
    model = ElasticModel(scene, max_steps=300)
    run = model.run()
    demand_finite(run.summary())
    outcome = str(run.outcome)
    demand("grown" not in outcome, f"stable by its certificate, but {outcome}")
    return {"what": f"{order}: {outcome}", "iterations": model.generation}


@trial("network", 6)
def _network(rng: Generator, number: int) -> Told:
    """Press a lattice of springs or a body of hexagons, lightly or until it gives way, or creep."""
    from kaju.model.network.hexagon_body import hexagon_body
    from kaju.model.network.spring_lattices import triangular
    from kaju.model.rheology.creeping import creep
    from kaju.model.rheology.element import ThreeElement
    from kaju.model.rheology.load_history import History
    from kaju.model.study.solving import solve

    family = "lattice"
    if rng.random() < 0.4:
        network, family = hexagon_body(hexagon_scene(rng)), "hexagons"
    else:
        force = float(10 ** rng.uniform(-3, 0.5))
        network = triangular(int(rng.integers(2, 9)), int(rng.integers(2, 9)), force=force)
    agents = {"family": family, "agents": len(network.positions)}
    if rng.random() < 0.6:
        demand_finite(solve(network).summary())
        return {"what": "in balance", **agents}
    pace = float(10 ** rng.uniform(-3, 3))
    k, d_f, d_d = (float(10 ** rng.uniform(-2, 2)) for _ in range(3))
    law = ThreeElement(K_f=k, D_f=d_f * pace, D_d=d_d * pace)
    history = History.step().hold(5.0 * pace)
    run = creep(network, history, rheology=law, times=[pace, 5.0 * pace], tolerance=1e-2)
    demand(bool(np.isfinite(run.displacement).all()), "a displacement that is no number")
    return {"what": "creeps", **agents}


@trial("three elements", 8)
def _element(rng: Generator, number: int) -> Told:
    """Hold a steady force on a three-element material: the scheme has an exact answer."""
    from kaju.model.rheology.element import ThreeElement

    k, d_f, d_d = (float(10 ** rng.uniform(-6, 6)) for _ in range(3))
    element = ThreeElement(K_f=k, D_f=d_f, D_d=d_d if rng.random() < 0.8 else inf)
    step, force = float(10 ** rng.uniform(-6, 6)), float(rng.normal())
    times = step * np.arange(1, 30)
    found = np.asarray(element.creep(force=force, times=times))
    n = np.arange(1, 30)
    exact = force * (n * step / element.D_d - np.expm1(-n * np.log1p(step * k / d_f)) / k)
    demand(bool(np.isfinite(found).all()), "a displacement that is no number")
    miss = float(np.abs(found - exact).max() / np.abs(exact).max())
    demand(miss < 1e-9, f"creep is off by {miss:.1e} of the scheme's exact answer")
    return {"family": "one element", "what": "creeps", "iterations": 29}


def _judged(scene: Scene, result: Any, number: int) -> Told:
    """Judge an answer of linear elasticity: numbers, balance, and sometimes the truth."""
    told = result.summary()
    demand_finite(told)
    demand_checks(result)
    energy = result.strain_energy
    pulled = any(scene.side_condition(name).kind == "displaced" for name in scene.lattice.sides)
    demand(energy >= 0.0 or pulled, f"a strain energy of {energy:.2e} J")
    truth = _true_energy(result.grid) if number % TRUTH_EVERY == 0 else nan
    lower = upper = nan
    if truth > 0.0 and result.provable and result.energy_bounds is not None:
        lower, upper = result.energy_bounds
        demand(
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


@trial("described, equal", 10, 11)
def _described(rng: Generator, number: int) -> Told:
    """Solve what scenes can describe, on cells of a resolution that is asked for."""
    from kaju.model.study.solving import solve

    scene, resolution = described_scene(rng, family_of(number)), int(rng.integers(0, 4)) or None
    # At another resolution regions are asked again: elements on the scene's cells know no truth.
    told = TRUTH_EVERY * number if resolution in (None, 1) else 1
    return _judged(scene, solve(scene, resolution=resolution), told)


@trial("described, tolerance", 12, 13)
def _described_within(rng: Generator, number: int) -> Told:
    """Solve what scenes can describe by whatever keeps a tolerance."""
    from kaju.model.study.solving import solve

    scene, tolerance = described_scene(rng, family_of(number)), float(rng.choice([0.3, 0.1]))
    return _judged(scene, solve(scene, tolerance=tolerance, most_agents=MOST_AGENTS), number)


@trial("goals", 14)
def _goals(rng: Generator, number: int) -> Told:
    """Ask for a quantity at two tolerances: what is certain of it must be so at both."""
    from kaju.model.elastic.spawning.quantities import Deflection, Stress
    from kaju.model.study.solving import solve

    scene = described_scene(rng, family_of(number))
    size = np.array(scene.lattice.extent)
    low = size * rng.uniform(0.0, 0.6, len(size))
    box = [low.tolist(), (low + 0.4 * size).tolist()]
    point = (size * rng.uniform(0.05, 0.95, len(size))).tolist()
    places: list[Any] = ["top", point, {"box": box}]
    place = places[rng.integers(3)]
    goals = [Deflection(place, "y"), Stress(place, "yy"), Stress({"box": box}, "von_mises")]
    goal: Any = goals[rng.integers(3)]
    ends = []
    for tolerance in (0.3, 0.1):
        result = solve(
            scene, tolerance=tolerance, tolerance_at=goal, strategy="spawning",
            most_agents=MOST_AGENTS,
        )  # fmt: skip
        demand_finite(result.summary())
        demand_checks(result)
        (found,) = result.goals
        if found.error_bound is not None:
            ends.append((float(np.max(found.value)), float(found.error_bound)))
    if len(ends) == 2:
        (one, off), (other, less) = ends
        room = (1.0 + 1e-9) * (off + less) + 1e-9 * max(abs(one), abs(other))
        demand(
            abs(one - other) <= room,
            f"{one:.6e} ± {off:.1e} and {other:.6e} ± {less:.1e} are both certain",
        )
    return {"what": type(goal).__name__, "agents": result.agents}


@trial("saved", 15)
def _saved(rng: Generator, number: int) -> Told:
    """Save an answer and read it: the same; turn a bit over: refused, or nothing depended on it."""
    from kaju.model.elastic.settling.elastic_model import ElasticModel
    from kaju.model.results.archive import seal_of
    from kaju.model.results.result import load_result
    from kaju.model.study.solving import solve
    from kaju.model.transfer.load_model import LoadModel

    way = int(rng.integers(4))
    if way == 0:
        result: Any = LoadModel(
            transfer_scene(rng), "arrays", allow_unstable=True, max_generations=100
        ).run(progress=False)
    elif way == 1:
        result = ElasticModel(elastic_scene(rng, family_of(number)), max_steps=50).run()
    else:
        scene = described_scene(rng, family_of(number))
        asks: dict[str, Any] = {"tolerance": 0.3, "most_agents": MOST_AGENTS} if way == 2 else {}
        result = solve(scene, **asks)
    seal = seal_of(*result._stored())
    with TemporaryDirectory() as folder:
        path = result.save(Path(folder) / "answer.npz")
        try:
            again = load_result(path)
        except KajuError as error:
            raise Broken(f"what was saved cannot be read: {error}") from error
        demand(seal_of(*again._stored()) == seal, "read again it is another answer")
        demand_checks(again)
        data = bytearray(path.read_bytes())
        data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            same = seal_of(*load_result(path)._stored()) == seal
        except KajuError:
            same = True
        demand(same, "with a bit turned over it was read as another answer")
    return {"family": type(result).__name__, "what": "the same"}


@trial("pages", 16)
def _page(rng: Generator, number: int) -> Told:
    """Write a page of a scene, a run or an answer."""
    from kaju.model.study.solving import solve
    from kaju.model.transfer.load_model import LoadModel
    from kaju.view.page.export import export_page

    way = int(rng.integers(3))
    shown: Any
    if way == 0:
        shown = solve(described_scene(rng, family_of(number)))
    else:
        shown = transfer_scene(rng)
        if way == 1:
            model = LoadModel(shown, "arrays", allow_unstable=True, max_generations=200)
            shown = model.run(progress=False)
    with TemporaryDirectory() as folder:
        path = export_page(shown, Path(folder) / "page.html")
        demand(b"kaju-data" in path.read_bytes(), "a page without data")
        demand(len(list(Path(folder).iterdir())) == 1, "something is left beside the page")
    return {"family": type(shown).__name__, "what": "a page"}


@trial("creeping bodies", 17)
def _creeping(rng: Generator, number: int) -> Told:
    """Let a body of one or two laws creep, by the prescribed rule or elastically."""
    from kaju.model.rheology.creeping import creep
    from kaju.model.rheology.load_history import History

    pace = float(10 ** rng.uniform(-3, 3))
    scene = described_scene(rng, family_of(number), pace=pace)
    if rng.random() < 0.3:
        sides = dict.fromkeys(scene.sides, "rigid")
        scene = scene.replace(sides=sides).with_overrides({"rule.kind": "prescribed"})
    history = History.step().hold(3.0 * pace)
    if rng.random() < 0.5:
        history = history.release().hold(3.0 * pace)
    result = creep(scene, history, times=[pace, 3.0 * pace], tolerance=1e-2)
    demand_finite(result.summary())
    demand_checks(result)
    return {"what": "creeps", "iterations": int(result.state.steps)}


@trial("misbehaving agents", 18)
def _misbehaving(rng: Generator, number: int) -> Told:
    """Let agents or ground answer nonsense: refused by name, or harmless as the books show."""
    from kaju.agents.boundary_agent import RigidBoundaryAgent
    from kaju.agents.material_agent import MaterialAgent
    from kaju.model.transfer.load_model import LoadModel

    worst: list[Any] = [nan, inf, -1.0, 1e308, 0.0, 3.0, None, "half", 1j, 10**400, [], True]
    nonsense: Any = worst[rng.integers(len(worst))]
    field, turn = int(rng.integers(4)), float(rng.uniform(0.0, 0.5))

    def changed(self: Any, load: Any) -> Any:
        emissions = [list(emission) for emission in MaterialAgent.emissions(self, load)]
        if emissions and self.model.rng.random() < turn:
            emissions[0][field] = nonsense
        return tuple(map(tuple, emissions))

    def returned(self: Any, load: Any, arm: int) -> Any:
        return self.turn(load, arm)._replace(magnitude=nonsense)

    own: dict[str, Any] = {"material_agent": type("Mine", (MaterialAgent,), {"emissions": changed})}
    if rng.random() < 0.3:
        ground = type("Ground", (RigidBoundaryAgent,), {"give_back": returned})
        own = {"boundary_agents": {"rigid": ground}}
    try:
        model = LoadModel(
            transfer_scene(rng), "agents", allow_unstable=True, max_generations=50, **own
        )
        result = model.run(progress=False)
    except AgentError as error:
        return {"family": "refused", "what": str(error).partition(":")[0]}
    demand_finite(result.summary())
    demand_checks(result)
    return {"family": "harmless", "what": result.last.outcome}


@trial("prescribed, described; large", 19)
def _prescribed(rng: Generator, number: int) -> Told:
    """Pass weight and described loads on; every fifth time solve a body of 10⁵ cells."""
    from kaju.model.study.solving import solve
    from kaju.model.transfer.load_model import LoadModel

    if number // 20 % 5 == 0:
        scene = large_scene(rng)
        return {"family": "10⁵ cells", **_judged(scene, solve(scene), 1)}
    scene = described_scene(rng, family_of(number), rule="prescribed")
    model = LoadModel(scene, "arrays", allow_unstable=True, max_generations=300)
    result = model.run(progress=False)
    demand_finite(result.summary())
    demand_checks(result)
    return {"what": result.last.outcome, "agents": len(result.last.cells)}
