"""One verb for every body that can be solved: scenes and spring networks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

from kaju.errors import ParameterError
from kaju.model.scene import Scene

if TYPE_CHECKING:
    from kaju.model.elasticity.elastic_result import ElasticResult
    from kaju.model.network import NetworkResult, SpringNetwork


@overload
def solve(subject: Scene, **how: Any) -> ElasticResult: ...
@overload
def solve(subject: SpringNetwork, **how: Any) -> NetworkResult: ...
def solve(subject: Scene | SpringNetwork, **how: Any) -> ElasticResult | NetworkResult:
    """Return how a body or a network of springs answers its loads.

    Parameters
    ----------
    subject : Scene or SpringNetwork
        A scene is solved as linear elasticity, a network in large deformation.
    **how
        For a scene: `tolerance`, `resolution`, `strategy`, as in
        `kaju.model.elasticity.solve`. For a network: `increments`, `method`, `tolerance`, as
        in `kaju.model.network.solve`.

    Raises
    ------
    ParameterError
        If the subject is neither.
    """
    if isinstance(subject, Scene):
        from kaju.model.elasticity.solve import solve as solve_scene

        return solve_scene(subject, **how)
    from kaju.model.network import SpringNetwork
    from kaju.model.network import solve as solve_network

    if isinstance(subject, SpringNetwork):
        return solve_network(subject, **how)
    raise ParameterError(
        f"subject: a Scene or a SpringNetwork is needed, got {type(subject).__name__}"
    )
