"""`kaju.solve` with a tolerance: agents spawn where load is left unbalanced."""

from __future__ import annotations

from time import perf_counter

from kaju.errors import ConvergenceError, ParameterError
from kaju.model.elastic.arguments import TOLERANCE, check_numbers
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.scene import Scene
from kaju.stopping import NOTE, stopped

from .block_spawner import blocks_for, spawn
from .generations import Spawning
from .goals import Asked, aim_of, asked
from .ground import ground_of
from .previous import check_previous, count_retired, serves
from .quantities import ToleranceAt
from .tree_agents import TreeAgents

MOST_AGENTS = {2: 4_000_000, 3: 400_000}
"""What fits in some 14 GB: about 3.5 kB an agent, in three dimensions 10 to 30 kB."""
IN_BLOCKS = {2: 20_000_000, 3: 4_000_000}
"""The same in blocks: about 300 B an agent, in three dimensions 1 kB."""
CONTRAST = 1e4
"""Of materials, from which on estimates of what a tolerance is about were seen to fail."""


def solve_spawning(
    scene: Scene,
    tolerance: float | None = None,
    resolution: int | None = None,
    *,
    tolerance_at: ToleranceAt | None = None,
    stage: int | None = None,
    most_agents: int | None = None,
    previous: ElasticResult | None = None,
    note: str = "",
) -> ElasticResult:
    """Solve a scene by agents of many sizes: `kaju.solve` with the strategy "spawning".

    The first agents are as large as the body, its materials, supports and loads let them
    be. Those that leave most load unbalanced spawn 4 (in three dimensions 8) children of
    half their size, and all settle again, until the estimated error is within the tolerance.
    The scene's cells say where the body is; it is never rasterised as a whole.

    What is not given is as in the previous answer, whose agents are those to begin with where the
    body and the places of the loads are the same, and the tolerance is not larger. `note` is what
    else is to be said of the answer.
    """
    start = perf_counter()
    before, tolerance, resolution = _continued(previous, tolerance, resolution)
    if previous is not None and tolerance_at is None:
        tolerance_at = previous.tolerance_at
    goals = asked(tolerance_at)
    check_numbers(tolerance, resolution, stage, most_agents)
    ground = ground_of(scene, stage, resolution)
    in_blocks = goals is None and blocks_for(ground, tolerance) is not None
    most = IN_BLOCKS if in_blocks else MOST_AGENTS
    limit = most_agents or most[ground.dimension]
    start_from = None
    if previous is not None and before is not None:
        check_previous(before.ground, ground)
        alike = goals == previous.tolerance_at and tolerance <= (previous.tolerance or 0.0)
        start_from = before if alike and serves(before, ground) else None
    spawning = spawn(ground, tolerance, limit, aim_of(goals, ground), start_from)
    if before is not None:
        spawning.retired = count_retired(before.leaves, spawning.leaves)
    spawning.notes += [note] if note else []
    seconds = perf_counter() - start
    how = (scene, stage, tolerance, resolution)
    return answer_of(spawning, *how, limit, seconds, goals)


def answer_of(
    spawning: Spawning,
    scene: Scene,
    stage: int | None,
    tolerance: float,
    resolution: int | None,
    limit: int,
    seconds: float,
    tolerance_at: Asked = None,
) -> ElasticResult:
    """Return agents that have ended as a result."""
    spawning.notes += [NOTE] if stopped() else []
    spawning.notes += rest_of(spawning, tolerance, resolution)
    spawning.notes += doubts_of(spawning, tolerance_at)
    found = TreeAgents(spawning, stage)
    result = ElasticResult(scene, stage, found, seconds, tolerance, resolution, tolerance_at)
    if spawning.stopped == "agents":
        raise ConvergenceError(
            f"solve: {result.agents} agents leave an estimated error of "
            f"{spawning.aimed.error:.2g}, and a tolerance of {tolerance:g} needs more than the "
            f"{limit} allowed; take a larger tolerance, or allow more by "
            "most_agents. The error's `best` holds the result so far",
            result.residuals,
            result,
        )
    if spawning.stopped == "iteration":
        raise ConvergenceError(
            f"solve: {max(len(result.residuals) - 1, 0)} iterations leave a relative residual "
            f"of {result.residuals[-1]:.2g}; take materials of a smaller contrast, a larger "
            "tolerance, or strategy='uniform'. The error's `best` holds the result so far",
            result.residuals,
            result,
        )
    return result


def _continued(
    previous: ElasticResult | None, tolerance: float | None, resolution: int | None
) -> tuple[Spawning | None, float, int | None]:
    """Return the previous agents, and what was not given as it was for them."""
    if previous is None:
        return None, TOLERANCE if tolerance is None else tolerance, resolution
    found = previous.found
    if not isinstance(found, TreeAgents):
        raise ParameterError(
            "previous: spawning agents continue from agents that have spawned, and its cells are "
            "all equal; take strategy='uniform', or leave `previous` out"
        )
    tolerance = previous.tolerance if tolerance is None else tolerance
    resolution = previous.resolution if resolution is None else resolution
    return found.spawning, TOLERANCE if tolerance is None else tolerance, resolution


def doubts_of(spawning: Spawning, tolerance_at: Asked) -> list[str]:
    """Return where the error of what a tolerance is about cannot be told."""
    shear = spawning.ground.moduli.shear
    contrast = float(shear.max() / shear.min())
    if tolerance_at is None or contrast < CONTRAST:
        return []
    return [
        f"materials differ by a factor of {contrast:.1g} in stiffness: where stiff parts touch at "
        "corners only, the estimated error may be far from the true one"
    ]


def rest_of(spawning: Spawning, tolerance: float, resolution: int | None) -> list[str]:
    """Return what agents that ended, or stand, above the tolerance leave to be said."""
    if spawning.reached or spawning.stopped not in ("", "depth", "blind"):
        return []
    above = (
        f"an estimated error of {spawning.aimed.error:.2g}, above the tolerance of {tolerance:g}"
    )
    if not spawning.stopped:
        steps = len(spawning.generations)
        return [f"looked at after {steps} steps, which leave {above}"]
    if spawning.stopped == "blind":
        return [f"bounds far above what agents see of their errors leave {above}"]
    remedy = "a larger resolution allows smaller ones"
    if resolution is None:
        remedy = "look for a point that is almost a hinge, where stiff parts touch at a corner"
    return [f"the smallest agents allowed leave {above}; {remedy}"]
