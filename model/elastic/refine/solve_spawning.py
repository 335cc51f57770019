"""`kaju.solve` by agents that spawn: adaptive refinement until a tolerance is kept."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from kaju.arrays import first_largest
from kaju.errors import ConvergenceError, ParameterError
from kaju.model.elastic.arguments import TOLERANCE, check_numbers
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.corners import singular_at
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.goals.goals import Asked, aim_of, asked
from kaju.model.elastic.goals.quantities import ToleranceAt
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.pair.octree import BrickAgents, BrickLoop
from kaju.model.elastic.posed_body import PosedBody, ground_of
from kaju.model.elastic.refine.generations import Spawning
from kaju.model.elastic.refine.refine_loop import LeafLoop, RefineLoop, Target
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Lattice
from kaju.stopping import NOTE, interrupt_requested

MOST_AGENTS = 400_000
"""Of goals: what fits in some 14 GB, at 10 to 30 kB an agent."""
CONTRAST = 1e4
"""Contrast of materials from which on error estimates of goals were seen to fail."""


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
    """Solve a scene by agents of many sizes: `kaju.solve` with a tolerance.

    The first agents are as large as the body, its materials, supports and loads let them
    be. Those that leave most load unbalanced spawn 4 (in three dimensions 8) children of
    half their size, and all settle again, until the estimated error is within the tolerance.
    The scene's cells say where the body is; it is never rasterised as a whole.

    Arguments that are not given are those of the previous answer. Its agents are the first ones if
    the body and the places of the loads are the same, and the tolerance is not larger. `note` is
    added to the answer's notes.
    """
    start = perf_counter()
    before = None if previous is None else _spawning_of(previous)
    if previous is not None:
        tolerance = previous.tolerance if tolerance is None else tolerance
        resolution = previous.resolution if resolution is None else resolution
        tolerance_at = previous.tolerance_at if tolerance_at is None else tolerance_at
    tolerance = TOLERANCE if tolerance is None else tolerance
    goals = asked(tolerance_at)
    check_numbers(tolerance, resolution, stage, most_agents)
    ground = ground_of(scene, stage, resolution)
    restart = None
    if previous is not None and before is not None:
        check_previous(before.ground.scene.lattice, ground.scene.lattice)
        as_strict = goals == previous.tolerance_at and tolerance <= (previous.tolerance or 0.0)
        restart = before if as_strict and _can_restart(before, ground) else None
    spawner = spawner_of(ground, tolerance, most_agents, aim_of(goals, ground), restart)
    while not spawner.finished and not (spawner.generations and interrupt_requested()):
        spawner.step()
    spawning = spawner.outcome()
    if before is not None and isinstance(spawning, Spawning):
        spawning.retired = _coarsened(before.leaves, spawning.leaves)
    spawning.notes += [note] if note else []
    spawning.notes += [NOTE] if interrupt_requested() else []
    seconds = perf_counter() - start
    result = answer_of(spawning, scene, stage, tolerance, resolution, goals, seconds)
    if spawning.stopped == "agents":
        raise ConvergenceError(
            f"solve: {result.agents} agents leave an error of "
            f"{error_of(spawning):.2g}, and a tolerance of {tolerance:g} needs more than the "
            f"{spawner.most_agents} allowed; take a larger tolerance. The error's `best` holds "
            "the result so far",
            result.residuals,
            result,
        )
    if spawning.stopped == "iteration":
        raise ConvergenceError(
            f"solve: {max(len(result.residuals) - 1, 0)} iterations leave a relative residual "
            f"of {result.residuals[-1]:.2g}; take materials of a smaller contrast, a larger "
            "tolerance, or equal cells (none). The error's `best` holds the result so far",
            result.residuals,
            result,
        )
    return result


def spawner_of(
    ground: PosedBody,
    tolerance: float,
    most_agents: int | None,
    aim: Target | None = None,
    previous: Spawning | None = None,
) -> RefineLoop | BrickLoop | PairLoop:
    """Return the loop that agents spawn in: of two minds in the plane, of bricks in space."""
    if aim is not None:
        return LeafLoop(ground, tolerance, most_agents or MOST_AGENTS, aim, previous)
    loop = BrickLoop if ground.dimension == 3 else PairLoop
    return loop(ground, tolerance, most_agents)


def answer_of(
    spawning: Spawning | BrickAgents | PairAgents,
    scene: Scene,
    stage: int | None,
    tolerance: float,
    resolution: int | None,
    tolerance_at: Asked,
    seconds: float,
) -> ElasticResult:
    """Return the agents of a refinement, finished or not, as a result with its notes."""
    missed = missed_note(spawning, tolerance, resolution)
    spawning.notes += [missed] if missed else []
    shear = spawning.ground.moduli.shear
    contrast = float(shear.max() / shear.min())
    if tolerance_at is not None and contrast >= CONTRAST:
        spawning.notes.append(
            f"materials differ by a factor of {contrast:.1g} in stiffness: where stiff parts touch "
            "at corners only, the estimated error may be far from the true one"
        )
    return ElasticResult(scene, stage, spawning, seconds, tolerance, resolution, tolerance_at)


def missed_note(
    spawning: Spawning | BrickAgents | PairAgents, tolerance: float, resolution: int | None
) -> str:
    """Return a note on an error above the tolerance, "" if there is nothing to be noted."""
    error, stopped = error_of(spawning), spawning.stopped
    if error <= tolerance or stopped in ("agents", "iteration"):
        return ""
    kind = "a proved" if isinstance(spawning, PairAgents) else "an estimated"
    above = f"{kind} error of {error:.2g}, above the tolerance of {tolerance:g}"
    if not stopped:
        return f"looked at after {len(spawning.generations)} steps, which leave {above}"
    if stopped == "blind":
        return f"bounds far above what agents see of their errors leave {above}"
    if stopped == "rounding":
        return f"rounding hides what the two opinions differ in, and leaves {above}"
    if resolution is not None:
        return f"the smallest agents allowed leave {above}; a larger resolution allows smaller ones"
    where = most_at(spawning)
    if stopped == "stalled":
        return f"more agents do not lower it: they leave {above}; most of it lies {where}"
    return f"the smallest agents that can be counted leave {above}; most of it lies {where}"


def error_of(spawning: Spawning | BrickAgents | PairAgents) -> float:
    """Return the error that the tolerance limits."""
    return spawning.aimed.error if isinstance(spawning, Spawning) else spawning.error


def most_at(spawning: Spawning | BrickAgents | PairAgents) -> str:
    """Say where most of the error lies, and why."""
    leaves, ground = spawning.leaves, spawning.ground
    agent, scene = first_largest(spawning.generations[-1].gap), spawning.ground.scene
    metre = scene.lattice.cell_size / ground.cell
    for corner in corner_ends(ground.dimension):
        point = (leaves.lower[agent] + corner * leaves.size[agent]) * metre
        if reason := singular_at(scene, point):
            break
    place = ", ".join(f"{x:.4g}" for x in point)
    return f"at ({place}) m" + (f", where {reason}" if reason else "")


def check_previous(previous: Lattice, lattice: Lattice) -> None:
    """Refuse a previous answer on other cells."""
    if previous != lattice:
        before, now = (
            f"{' x '.join(map(str, one.shape))} cells of {one.cell_size:g} m"
            for one in (previous, lattice)
        )
        raise ParameterError(
            f"previous: its agents stand on {before}, those of the scene on {now}; solve without "
            "it, or on the same cells"
        )


def _spawning_of(previous: ElasticResult) -> Spawning | None:
    """Return the agents of a previous answer; refuse equal cells."""
    if isinstance(previous.found, (BrickAgents, PairAgents)):
        return None  # Generations start anew
    if not isinstance(previous.found, Spawning):
        raise ParameterError(
            "previous: spawning agents continue from agents that have spawned, and its cells are "
            "all equal; leave `previous`, or tolerance and goal, out"
        )
    return previous.found


def _can_restart(previous: Spawning, ground: PosedBody) -> bool:
    """Tell whether the last agents of a previous answer may be the first ones of this."""
    # Elsewhere a new refinement is as quick, and ends with fewer agents.
    before, leaves, scene = previous.ground, previous.leaves, ground.scene
    sides = [scene.side_condition(name) for name in scene.lattice.sides]
    prescribed = any(side.displacement is not None for side in sides)
    return (
        scene.same_body(before.scene)
        and ground.loaded_where(before)
        and not (prescribed and ground.scales != before.scales)
        and int(leaves.size.min()) >= ground.smallest
        and not ground.unevenly_loaded(leaves).any()
    )


def _coarsened(before: LeafCells, now: LeafCells) -> int:
    """Return how many cells lie in a larger one now."""
    at = np.maximum(np.searchsorted(now.code, before.code, side="right") - 1, 0)
    offset = before.lower - now.lower[at]
    inside = np.all((offset >= 0) & (offset < now.size[at, None]), axis=1)
    return int(np.count_nonzero(inside & (now.size[at] > before.size)))
