"""One verb for every body that can be solved: scenes and spring networks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, overload

from kaju.errors import OutOfMemoryError, ParameterError
from kaju.model.elastic.arguments import SMALLEST, check_numbers
from kaju.model.results.subjects import question_of
from kaju.model.scene import Scene
from kaju.stopping import Answer, interruptible

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike

    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.goals.quantities import ToleranceAt
    from kaju.model.network import NetworkResult, SpringNetwork
    from kaju.model.network.network_model import NetworkModel
    from kaju.model.outline.outline_result import OutlineResult
    from kaju.model.transfer.load_model import LoadModel

    AnyElastic = ElasticResult | OutlineResult

Strategy = Literal["auto", "uniform", "spawning"]
STRATEGIES = ("auto", "uniform", "spawning")

_OUTLINES = (
    "{name}: is not known of true outlines, whose agents %s; leave it out, or take regions with "
    'outline = "cells"'
)
_TAKEN = {
    "network": (
        "tolerance increments",
        "{name}: belongs to no SpringNetwork; leave it out",
    ),
    "scene": (
        "tolerance resolution strategy tolerance_at previous stage stiffness most_agents",
        "{name}: belongs to no Scene; leave it out",
    ),
    "plane with outlines": (
        "tolerance most_agents previous tolerance_at strategy=spawning stage=1",
        _OUTLINES % "spawn where the tolerance asks for it",
    ),
    "solid with outlines": (
        "resolution strategy=uniform stage=1",
        _OUTLINES % "are equal cells in space, as many as `resolution` says",
    ),
    "stiffness": (
        "tolerance resolution previous stage stiffness strategy=uniform",
        "stiffness: a field of it belongs to equal cells, which know no {name}; leave the one or "
        "the other out",
    ),
}
"""By solver, the options that it takes (or the one value of them), and what is said of others."""


# The overloads only say which subject gives which result; options are checked by name below.
@overload
def solve(subject: Scene | LoadModel | str | Path, *how: Any, **more: Any) -> ElasticResult: ...
@overload
def solve(subject: SpringNetwork | NetworkModel, *how: Any, **more: Any) -> NetworkResult: ...
def solve(
    subject: Scene | SpringNetwork | NetworkModel | LoadModel | str | Path,
    tolerance: float | None = None,
    resolution: int | None = None,
    strategy: Strategy = "auto",
    tolerance_at: ToleranceAt | None = None,
    previous: ElasticResult | OutlineResult | None = None,
    stage: int | None = None,
    *,
    stiffness: ArrayLike | None = None,
    most_agents: int | None = None,
    increments: int | None = None,
) -> AnyElastic | NetworkResult:
    """Return how a body or a network of springs answers its loads.

    Parameters
    ----------
    subject : Scene, SpringNetwork, model or path
        A scene is solved as linear elasticity, a network in large deformation; of a model its
        scene or network is, of a path the scene in it.
    tolerance : float, optional
        Relative error of a scene's answer: in the energy norm, or in what `tolerance_at` names;
        where forces alone act, or moved sides alone, its square is that of the energy. Without
        one the scene's own cells are solved, or `resolution` times as many along every axis;
        agents that spawn take 0.01. Of a network it is the force left in every node, as a share
        of the largest force (1e-12 unless given).
    resolution : int, optional
        Cells per cell of the scene, along every axis. Regions are asked again, so that round
        shapes become rounder. No agent is smaller; with "uniform" all are as small.
    strategy : {"auto", "uniform", "spawning"}
        Where agents may be small: "uniform" everywhere alike, "spawning" only where the
        tolerance asks for it, "auto" by whichever is expected to be done first. The answer's
        notes say what was chosen, and why.
    tolerance_at : optional
        What the tolerance is about instead of the energy norm; agents spawn for it.
        "displacement" is the largest displacement error anywhere, relative to the largest
        displacement. A `Deflection`, a `Stress` or a `Reaction`, or a list of these, is a
        quantity: its error is relative to itself, or to a hundredth of the largest
        displacement, stress or reaction if that is more; of several the worst counts. A
        point, a region or a side stands for its `Deflection`. Within true outlines it is the
        largest stress along one of them, by its name or as ``Stress(name, "hoop")``.
    previous : ElasticResult or OutlineResult, optional
        The answer to a scene on the same cells, of which something was changed, to start from.
        It is continued in the way that it was found, at its tolerance and resolution unless
        others are given; within true outlines by its agents, where body and places of the loads
        are the same.
    stage : int, optional
        Stage of loading; by default the last.
    stiffness : array, optional
        What the materials' moduli are multiplied by: one number above 0 for every cell of the
        scene, indexed as `Scene.from_array` does; where there is no material it is not looked at.
        The cells are solved as they are, or `resolution` times as many along every axis, and
        the tolerance is that of their equations: in a loop that changes the stiffness a little
        each time, 0.01 with the `previous` answer does.
    most_agents : int, optional
        Give up before there are more; by default 4 million, 400,000 in three dimensions.
    increments : int, optional
        Steps in which a network is loaded; 10 unless given.
    method : str, optional
        How a network's equations are solved; see `SpringNetwork.solve`.

    Returns
    -------
    ElasticResult or NetworkResult
        Of a scene always an ElasticResult, whatever the strategy. Short of the tolerance only
        where agents may not be smaller, which its notes say.

    Raises
    ------
    SupportError
        If a part of the body could move without straining.
    ConvergenceError
        If the tolerance asks for too many agents, or an iteration ends above it; `best` holds
        the result so far.
    ParameterError, SceneError
        If an argument or the scene breaks a rule.
    OutOfMemoryError
        If there is not enough memory.
    Interrupted
        After Ctrl-C, a KeyboardInterrupt; `best` holds the result so far.

    Examples
    --------
    >>> from kaju import Scene, solve
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> answer = solve(scene, tolerance=0.05)
    >>> answer.tolerance_kept, answer.error_bound < 0.05
    ('proved', True)
    """
    subject = question_of(subject)
    options: dict[str, Any] = {
        "tolerance": tolerance,
        "resolution": resolution,
        "strategy": None if strategy == "auto" else strategy,
        "tolerance_at": tolerance_at,
        "previous": previous,
        "stage": stage,
        "stiffness": stiffness,
        "most_agents": most_agents,
        "increments": increments,
    }
    given = {name: value for name, value in options.items() if value is not None}
    if isinstance(subject, Scene):
        _refuse_others("scene", given)
        if subject.outlined:
            return interruptible(lambda: _with_memory(_solve_outlined, subject, given))
        return interruptible(lambda: _with_memory(_solve_scene, subject, given))
    from kaju.model.network import SpringNetwork
    from kaju.model.network import solve as solve_network

    if not isinstance(subject, SpringNetwork):
        raise ParameterError(
            "subject: a Scene, a SpringNetwork, a model of one, or the path of a scene is needed, "
            f"got {type(subject).__name__}"
        )
    _refuse_others("network", given)
    return interruptible(lambda: solve_network(subject, **given))


def _refuse_others(solver: str, given: Mapping[str, Any]) -> None:
    """Refuse the first option that is given and that a solver does not take."""
    taken, message = _TAKEN[solver]
    for name, value in given.items():
        if not {name, f"{name}={value}"} & set(taken.split()):
            raise ParameterError(message.format(name=name))


def _with_memory(
    solver: Callable[[Scene, dict[str, Any]], Answer], scene: Scene, given: dict[str, Any]
) -> Answer:
    """Return an answer; where memory runs out, say which options need less."""
    try:
        return solver(scene, given)
    except MemoryError as error:
        if isinstance(error, OutOfMemoryError):
            raise
        raise OutOfMemoryError(
            f"solve: {str(error) or 'memory ran out'}; take a smaller resolution, a larger "
            "tolerance, or fewer agents (most_agents)"
        ) from error


def _solve_outlined(scene: Scene, given: dict[str, Any]) -> AnyElastic:
    """Solve a scene within true outlines: agents that spawn in the plane, equal cells in space."""
    if scene.lattice.dimension == 3:
        _refuse_others("solid with outlines", given)
        from kaju.model.solid.solid_agents import solve_solid

        return solve_solid(scene, given.get("resolution"))
    _refuse_others("plane with outlines", given)
    from kaju.model.outline.outline_result import OutlineResult
    from kaju.model.outline.outlined_scene import solve_outlined

    tolerance, most_agents = given.get("tolerance"), given.get("most_agents")
    previous = given.get("previous")
    check_numbers(tolerance, None, None, most_agents)
    if previous is not None and not isinstance(previous, OutlineResult):
        raise ParameterError(
            "previous: agents within true outlines continue from an OutlineResult, got "
            f"{type(previous).__name__}; leave it out"
        )
    return solve_outlined(scene, tolerance, most_agents, previous, given.get("tolerance_at"))


def _solve_scene(scene: Scene, given: dict[str, Any]) -> ElasticResult:
    """Solve a scene's cells by the strategy asked for, or the one that suits the options."""
    from kaju.model.elastic.caveats import refuse_singular
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.solve import solve as solve_uniform

    strategy, previous = given.get("strategy", "auto"), given.get("previous")
    tolerance, resolution, stage, most_agents, tolerance_at = map(
        given.get, ("tolerance", "resolution", "stage", "most_agents", "tolerance_at")
    )
    if strategy not in STRATEGIES:
        raise ParameterError(f"strategy: must be 'auto', 'uniform' or 'spawning', got {strategy!r}")
    if previous is not None and not isinstance(previous, ElasticResult):
        raise ParameterError(
            f"previous: an ElasticResult is needed to start from, got {type(previous).__name__}"
        )
    check_numbers(tolerance, resolution, stage, most_agents, least=SMALLEST)
    kept: dict[str, Any] = {"stage": stage, "previous": previous}
    if "stiffness" in given:
        _refuse_others("stiffness", given)
        return solve_uniform(scene, tolerance, resolution, stiffness=given["stiffness"], **kept)
    spawned = previous is not None and previous.found.storage == "tree"
    if strategy == "auto" and (tolerance_at is not None or spawned):
        strategy = "spawning"
    if tolerance_at is not None:
        refuse_singular(scene, tolerance_at, stage)
    if strategy == "spawning":
        from kaju.model.elastic.refine.solve_spawning import solve_spawning

        kept |= {"tolerance_at": tolerance_at, "most_agents": most_agents}
        return solve_spawning(scene, tolerance, resolution, **kept)
    if tolerance_at is not None:
        raise ParameterError(
            "tolerance_at: equal cells have no error to choose; take strategy='spawning'"
        )
    if tolerance is None:
        return solve_uniform(scene, None, resolution, **kept)
    from kaju.model.elastic.refine.choice import solve_cheaply, solve_equal

    if strategy == "uniform":
        return solve_equal(scene, tolerance, resolution, **kept)
    return solve_cheaply(scene, tolerance, resolution, most_agents=most_agents, **kept)
