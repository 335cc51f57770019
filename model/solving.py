"""One verb for every body that can be solved: scenes and spring networks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

from kaju.errors import ParameterError
from kaju.model.scene import Scene

if TYPE_CHECKING:
    from kaju.model.elasticity.elastic_result import ElasticResult
    from kaju.model.network import NetworkResult, SpringNetwork
    from kaju.model.spawning.spawned_result import SpawnedResult


@overload
def solve(subject: Scene, **how: Any) -> ElasticResult | SpawnedResult: ...
@overload
def solve(subject: SpringNetwork, **how: Any) -> NetworkResult: ...
def solve(
    subject: Scene | SpringNetwork, **how: Any
) -> ElasticResult | SpawnedResult | NetworkResult:
    """Return how a body or a network of springs answers its loads.

    Parameters
    ----------
    subject : Scene or SpringNetwork
        A scene is solved as linear elasticity, a network in large deformation.
    **how
        For a scene: `tolerance`, `resolution`, `stage`, `strategy`, and `previous`, the answer
        to a scene of which something was changed, to start from.

        With the strategy "auto" (unless given) and a tolerance, the relative error in the
        energy norm is at most the tolerance, by whichever is expected to be cheaper: equal
        cells so small that they keep it, or agents that spawn where they have to. The result's
        notes say which, and why; see `kaju.model.spawning.choice`. Without a tolerance the
        scene's own cells are solved, or `resolution` times as many along every axis. A
        previous answer is continued in the way that it was found.

        With "spawning" agents are small only where the tolerance, an error in the energy norm
        or in what `tolerance_at` names, asks for it: see `kaju.model.spawning.solve`.

        With "uniform" all cells are equal, and the tolerance is only that to which their
        equations are solved: see `kaju.model.elasticity.solve`.

        For a network: `increments`, `method`, `tolerance`, as in `kaju.model.network.solve`.

    Raises
    ------
    ParameterError
        If the subject is neither.
    """
    if isinstance(subject, Scene):
        return _solve_scene(subject, **how)
    from kaju.model.network import SpringNetwork
    from kaju.model.network import solve as solve_network

    if isinstance(subject, SpringNetwork):
        return solve_network(subject, **how)
    raise ParameterError(
        f"subject: a Scene or a SpringNetwork is needed, got {type(subject).__name__}"
    )


def _solve_scene(scene: Scene, strategy: str = "auto", **how: Any) -> ElasticResult | SpawnedResult:
    from kaju.model.elasticity.solve import solve as solve_uniform
    from kaju.model.spawning.choice import solve_cheaply
    from kaju.model.spawning.solve import solve_spawning

    if strategy not in ("auto", "uniform", "spawning"):
        raise ParameterError(f"strategy: must be 'auto', 'uniform' or 'spawning', got {strategy!r}")
    given = {name: value for name, value in how.items() if value is not None}
    if strategy == "auto" and _asks_for_agents(given):
        strategy = "spawning"
    if strategy == "spawning":
        return solve_spawning(scene, **given)
    if "tolerance_at" in given:
        raise ParameterError(
            "tolerance_at: equal cells have no error to choose; take strategy='spawning'"
        )
    if strategy == "auto" and "tolerance" in given:
        return solve_cheaply(scene, **given)
    return solve_uniform(scene, **given)


def _asks_for_agents(given: dict[str, Any]) -> bool:
    from kaju.model.spawning.spawned_result import SpawnedResult

    return "tolerance_at" in given or isinstance(given.get("previous"), SpawnedResult)
