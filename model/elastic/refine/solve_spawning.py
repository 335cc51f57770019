"""`kaju.solve` with a tolerance: agents spawn where load is left unbalanced."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from kaju.errors import ConvergenceError, ParameterError
from kaju.model.elastic.arguments import TOLERANCE, check_numbers
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.goals.goals import Asked, aim_of, asked
from kaju.model.elastic.goals.quantities import ToleranceAt
from kaju.model.elastic.leaf_agents import LeafAgents
from kaju.model.elastic.posed_body import PosedBody, ground_of
from kaju.model.elastic.refine.block_loop import spawner_of
from kaju.model.elastic.refine.generations import Spawning
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Lattice
from kaju.stopping import NOTE, interrupt_requested

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
    start_from = None
    if previous is not None and before is not None:
        check_previous(before.ground.scene.lattice, ground.scene.lattice)
        alike = goals == previous.tolerance_at and tolerance <= (previous.tolerance or 0.0)
        start_from = before if alike and serves(before, ground) else None
    spawner = spawner_of(ground, tolerance, most_agents, aim_of(goals, ground), start_from)
    while not spawner.finished and not (spawner.generations and interrupt_requested()):
        spawner.step()
    spawning = spawner.outcome()
    if before is not None:
        # For so many agents a larger one stands now.
        old, now = before.leaves, spawning.leaves
        at = np.maximum(np.searchsorted(now.code, old.code, side="right") - 1, 0)
        inside = old.lower - now.lower[at]
        here = np.all((inside >= 0) & (inside < now.size[at, None]), axis=1)
        spawning.retired = int(np.count_nonzero(here & (now.size[at] > old.size)))
    spawning.notes += [note] if note else []
    spawning.notes += [NOTE] if interrupt_requested() else []
    seconds = perf_counter() - start
    result = answer_of(spawning, scene, stage, tolerance, resolution, goals, seconds)
    if spawning.stopped == "agents":
        raise ConvergenceError(
            f"solve: {result.agents} agents leave an estimated error of "
            f"{spawning.aimed.error:.2g}, and a tolerance of {tolerance:g} needs more than the "
            f"{spawner.most_agents} allowed; take a larger tolerance, or allow more by "
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


def answer_of(
    spawning: Spawning,
    scene: Scene,
    stage: int | None,
    tolerance: float,
    resolution: int | None,
    tolerance_at: Asked,
    seconds: float,
) -> ElasticResult:
    """Return agents as they are as a result, with what there is to be said of them."""
    spawning.notes += rest_of(spawning, tolerance, resolution)
    shear = spawning.ground.moduli.shear
    contrast = float(shear.max() / shear.min())
    if tolerance_at is not None and contrast >= CONTRAST:
        spawning.notes.append(
            f"materials differ by a factor of {contrast:.1g} in stiffness: where stiff parts touch "
            "at corners only, the estimated error may be far from the true one"
        )
    found = LeafAgents(spawning, stage)
    return ElasticResult(scene, stage, found, seconds, tolerance, resolution, tolerance_at)


def _continued(
    previous: ElasticResult | None, tolerance: float | None, resolution: int | None
) -> tuple[Spawning | None, float, int | None]:
    """Return the previous agents, and what was not given as it was for them."""
    if previous is None:
        return None, TOLERANCE if tolerance is None else tolerance, resolution
    found = previous.found
    if not isinstance(found, LeafAgents):
        raise ParameterError(
            "previous: spawning agents continue from agents that have spawned, and its cells are "
            "all equal; take strategy='uniform', or leave `previous` out"
        )
    tolerance = previous.tolerance if tolerance is None else tolerance
    resolution = previous.resolution if resolution is None else resolution
    return found.spawning, TOLERANCE if tolerance is None else tolerance, resolution


def rest_of(spawning: Spawning, tolerance: float, resolution: int | None) -> list[str]:
    """Return what agents that ended, or stand, above the tolerance leave to be said."""
    if spawning.reached or spawning.stopped not in ("", "depth", "blind"):
        return []
    error = spawning.aimed.error
    above = f"an estimated error of {error:.2g}, above the tolerance of {tolerance:g}"
    if not spawning.stopped:
        steps = len(spawning.generations)
        return [f"looked at after {steps} steps, which leave {above}"]
    if spawning.stopped == "blind":
        return [f"bounds far above what agents see of their errors leave {above}"]
    remedy = "a larger resolution allows smaller ones"
    if resolution is None:
        remedy = "look for a point that is almost a hinge, where stiff parts touch at a corner"
    return [f"the smallest agents allowed leave {above}; {remedy}"]


def check_previous(previous: Lattice, lattice: Lattice) -> None:
    """Refuse agents that stand on other cells."""
    if previous != lattice:
        before, now = (
            f"{' x '.join(map(str, one.shape))} cells of {one.cell_size:g} m"
            for one in (previous, lattice)
        )
        raise ParameterError(
            f"previous: its agents stand on {before}, those of the scene on {now}; solve without "
            "it, or on the same cells"
        )


def serves(previous: Spawning, ground: PosedBody) -> bool:
    """Tell whether agents may begin as those of a previous answer ended."""
    # Where body or places of the loads have changed, others are soon found afresh, and are fewer.
    before, leaves, scene = previous.ground, previous.leaves, ground.scene
    sides = [scene.side_condition(name) for name in scene.lattice.sides]
    moved = any(side.displacement is not None for side in sides)
    return (
        scene.same_body(before.scene)
        and ground.loaded_where(before)
        and not (moved and ground.scales != before.scales)
        and int(leaves.size.min()) >= ground.smallest
        and not ground.unevenly_loaded(leaves).any()
    )
