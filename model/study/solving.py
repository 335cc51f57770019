"""The verb `solve`: how the body of a scene answers its loads as linear elasticity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from kaju.errors import OutOfMemoryError, ParameterError, SupportError, brief, by_name
from kaju.model.elastic.arguments import SMALLEST, check_numbers
from kaju.model.results.archive import from_file
from kaju.model.scene import Scene
from kaju.stepping import interruptible

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike

    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.goals.quantities import AskedFor
    from kaju.model.transfer.load_model import LoadModel


@by_name
def solve(
    scene: Scene | LoadModel | str | Path,
    tolerance: float | None = None,
    *,
    resolution: int | None = None,
    goal: AskedFor | None = None,
    stage: int | None = None,
    previous: ElasticResult | None = None,
    stiffness: ArrayLike | None = None,
) -> ElasticResult:
    """Solve a scene as linear elasticity, whatever its rule is.

    Parameters
    ----------
    scene : Scene, model or path
        What is solved: a scene, the scene of a model, or that in a file. Networks of springs are
        solved by `kaju.model.network.solve`.
    tolerance : float, optional
        Agents spawn until the relative error is below it, in the energy norm or of the `goal`.
        Without one the cells of the scene are solved, or `resolution` times as many along every
        axis; within true outlines in the plane it is 0.01.
    resolution : int, optional
        Into how many cells each cell of the scene is split, along every axis; round shapes become
        rounder. With a tolerance, no agent is smaller than these cells.
    goal : optional
        What the tolerance (0.01 unless given) is about, instead of the energy norm: a `Deflection`,
        a `Stress` or a `Reaction`, or a list of these. Errors are relative to the quantity, or to a
        hundredth of the largest displacement, stress or reaction if that is more; of several the
        largest counts. A point, a region or a side means its `Deflection`; "top,y" that of the top
        along y. Within true outlines it is the `Deflection` of a free side or of an outline on
        which a load acts, or the largest stress along one outline, by its name.
    stage : int, optional
        Stage of loading; by default the last.
    previous : ElasticResult, optional
        An answer to start from, of a scene on the same cells in which something was changed. Its
        tolerance and resolution are kept unless others are given.
    stiffness : array, optional
        Factors of the materials' moduli: one number above 0 for every cell of the scene, indexed as
        in `Scene.from_array`; those of cells without material are ignored. Agents do not spawn, and
        the tolerance is that of the equations: in a loop that changes the stiffness a little each
        time, 0.01 with the `previous` answer is enough.

    Returns
    -------
    ElasticResult
        If agents may not be small enough for the tolerance, its notes say so.

    Raises
    ------
    ParameterError, SceneError, SupportError
        If an argument or the scene breaks a rule, or a part could move without straining.
    ConvergenceError, Interrupted
        If the tolerance needs too many agents, an iteration does not reach it, or after Ctrl-C;
        `best` holds the result so far.
    OutOfMemoryError
        If there is not enough memory.

    Examples
    --------
    >>> import kaju
    >>> answer = kaju.solve(kaju.load_scene("plate.toml"), tolerance=0.05)
    >>> answer.tolerance_kept, answer.error_bound < 0.05
    ('proved', True)
    """
    asked: Any = from_file(scene)
    if hasattr(asked, "step"):  # a model: what it was asked
        asked = getattr(asked, "scene", None) or getattr(asked, "network", asked)
    if not isinstance(asked, Scene):
        raise ParameterError(
            "scene: a Scene, a model of one, or the path of a scene is needed, got "
            f"{brief(asked)}; a network of springs is solved by kaju.model.network.solve"
        )
    options: dict[str, Any] = {"tolerance": tolerance, "resolution": resolution, "goal": goal}
    options |= {"stage": stage, "previous": previous, "stiffness": stiffness}
    given = {name: value for name, value in options.items() if value is not None}
    solver = _solve_outlined if asked.outlined else _solve_scene
    try:
        with asked.misplaced():
            return interruptible(lambda: solver(asked, given))
    except OutOfMemoryError:
        raise
    except SupportError as error:
        if not asked.body.allow_floating:
            raise
        told = "body.allow_floating is for agents that pass loads on by a rule (kaju run) alone"
        raise SupportError(f"{error}; {told}") from None
    except MemoryError as error:
        raise OutOfMemoryError(
            f"solve: {str(error) or 'memory ran out'}; take a smaller resolution, or a larger "
            "tolerance"
        ) from error


def _refuse_others(taken: str, given: Mapping[str, Any], why: str) -> None:
    """Refuse the first option given that is not taken (or not with this value), and say why."""
    for name, value in given.items():
        if not {name, f"{name}={value}"} & set(taken.split()):
            raise ParameterError(why.format(name=name))


def _solve_outlined(scene: Scene, given: dict[str, Any]) -> ElasticResult:
    """Solve a scene within true outlines: agents that spawn in the plane, equal cells in space."""
    why = (
        "{name}: is not taken within true outlines, whose agents %s; leave it out, or take "
        'regions with outline = "cells"'
    )
    from kaju.model.elastic.solve import solve_solid, solve_spawning

    if scene.lattice.dimension == 3:
        how = "are equal cells, as many as `resolution` says"
        _refuse_others("resolution stage=1", given, why % how)
        return solve_solid(scene, given.get("resolution"))
    _refuse_others("tolerance goal stage=1", given, why % "spawn where the tolerance asks for it")
    return solve_spawning(scene, given.get("tolerance"), goal=given.get("goal"))


def _solve_scene(scene: Scene, given: dict[str, Any]) -> ElasticResult:
    """Solve a scene by agents that spawn if there is a tolerance or a goal, else by its cells."""
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.solve import solve_cells, solve_spawning

    tolerance, resolution, stage, goal, previous = map(
        given.get, ("tolerance", "resolution", "stage", "goal", "previous")
    )
    if previous is not None and not isinstance(previous, ElasticResult):
        raise ParameterError(
            f"previous: an ElasticResult is needed to start from, got {type(previous).__name__}"
        )
    check_numbers(tolerance, resolution, stage, least=SMALLEST)
    kept: dict[str, Any] = {"stage": stage, "previous": previous}
    if "stiffness" in given:
        _refuse_others(
            "tolerance resolution previous stage stiffness",
            given,
            "stiffness: needs equal cells, which take no {name}; leave out stiffness or {name}",
        )
        return solve_cells(scene, tolerance, resolution, stiffness=given["stiffness"], **kept)
    if tolerance is None and goal is None:
        return solve_cells(scene, None, resolution, **kept)
    if previous is not None:
        raise ParameterError(
            "previous: agents that spawn always start anew; leave previous out, or leave "
            "tolerance and goal out (equal cells start from the previous answer)"
        )
    return solve_spawning(scene, tolerance, resolution, goal=goal, stage=stage)
