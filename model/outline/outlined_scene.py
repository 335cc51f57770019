"""Scenes with true outlines, solved: agents whole, cut by an outline, or none."""

from __future__ import annotations

from math import inf
from time import perf_counter

from kaju.errors import ParameterError, SceneError
from kaju.model.elastic.goals.quantities import AskedFor
from kaju.model.elastic.pair.cut_pair import CutPair
from kaju.model.scene import Scene
from kaju.model.scene.lattice import Lattice

from .outline_loop import OutlineLoop
from .outline_peak import OutlinePeak, peak_asked
from .outline_problem import UnlikeError
from .outline_result import OutlineResult
from .posed_outlines import check_alone, problem_of
from .square_leaves import SquareLeaves

TOLERANCE = 0.01
MOST_AGENTS = 100_000


def solve_outlined(
    scene: Scene,
    tolerance: float | None,
    previous: OutlineResult | None = None,
    tolerance_at: AskedFor | None = None,
) -> OutlineResult:
    """Return the answer to a scene with true outlines, proved to a tolerance; see `kaju.solve`."""
    start = perf_counter()
    goal = peak_asked(scene, tolerance_at)
    if previous is not None:
        tolerance = previous.tolerance if tolerance is None else tolerance
        goal = previous.tolerance_at if tolerance_at is None else goal
    tolerance = TOLERANCE if tolerance is None else tolerance
    problem, edge = problem_of(scene)
    peak = None
    if goal is not None:
        name = str(goal[0].at)
        which = [region.name for region in scene.body.regions].index(name)
        check_alone(problem.body.regions, which, f"goal: {name!r}", "peak")
        peak = OutlinePeak(which, name, problem, edge, tolerance)
    before = None
    if previous is not None:
        _check_cells(previous.scene.lattice, scene.lattice)
        if _serves(previous, scene) and tolerance <= previous.tolerance:
            # of a peak the change is asked for that the last generation made
            again = peak is not None and goal == previous.tolerance_at
            number = -2 if again else -1
            before = previous.leaves[max(number, -len(previous.leaves))]
    rounding = problem.rounding
    left = 0.5 * (2.0 * rounding / (1.0 - rounding)) ** 0.5 if rounding < 1.0 else inf
    if peak is None and len(problem.body.laws) > 1 and left > tolerance:
        raise SceneError(
            f"body.regions: materials this unlike leave an error of {left:.2g} to rounding alone, "
            f"above the tolerance of {tolerance:g}; take a larger one, rigid sides for what is all "
            "but rigid, or air for what is all but air"
        )

    generations: list[tuple[SquareLeaves, tuple[float, float], float]] = []

    def keep(pair: CutPair) -> None:
        generations.append((pair.leaves, pair.bounds, pair.error))

    loop = OutlineLoop(problem, tolerance, MOST_AGENTS, before, peak.aim if peak else None)
    try:
        pair = loop.run(keep)
    except UnlikeError as error:
        raise SceneError(
            f"body.regions: the outlines could not be resolved ({error}); outlines that all but "
            "touch the lines between agents, or are covered by another region, do so: move one "
            "by a little; so do parts of the body that hang on nothing"
        ) from None
    while generations[-1][0] is not pair.leaves:  # a later one knew less
        generations.pop()
    of_peak = None if peak is None else (peak.value, peak.off, peak.error)
    seconds = perf_counter() - start
    how = tolerance, seconds, generations, goal, of_peak, loop.stopped
    return OutlineResult.of(scene, pair, edge, *how)


def _check_cells(before: Lattice, now: Lattice) -> None:
    """Refuse a previous answer on other cells."""
    if before != now:
        old, new = (
            f"{' x '.join(map(str, one.shape))} cells of {one.cell_size:g} m"
            for one in (before, now)
        )
        raise ParameterError(
            f"previous: its agents stand on {old}, those of the scene on {new}; solve without it, "
            "or on the same cells"
        )


def _serves(previous: OutlineResult, scene: Scene) -> bool:
    """Tell whether agents may begin as those of a previous answer ended."""
    places = [
        ({(load.side, load.outline) for load in one.loads}, any(one.body.gravity or ()))
        for one in (previous.scene, scene)
    ]
    return scene.same_body(previous.scene) and places[0] == places[1]
