"""The verbs that compute a scene: agents act in `demo`, `run` and `creep`; `solve` answers."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from inspect import Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju.errors import ConvergenceError, KajuError, require
from kaju.stepping import NOTE

from . import options
from .console import Console, Folder

if TYPE_CHECKING:
    from kaju.model.results.result import Result

Say = Callable[..., None]
"""Prints lines for people."""

# What options can be, for the shell to complete.
Measure = StrEnum("Measure", "force stress strain energy")
GrowthRule = StrEnum("GrowthRule", "compliance remodelling stress")


def of_a_scene(ending: str) -> Callable[[Callable[..., Result]], Callable[..., None]]:
    """Let a function of a scene, of what says lines, and of options be a verb, with those of all.

    The verb prints the result's key figures and writes its folder, called by scene and `ending`.
    After Ctrl-C (exit code 130), or a missed tolerance, what there is goes without pictures.
    """

    def verb(do: Callable[..., Result]) -> Callable[..., None]:
        def command(
            scene: options.SceneFile,
            out: options.Out = None,
            settings: options.Settings = None,
            pictures: options.Draw = options.Drawn.one,
            no_pictures: options.DrawNone = False,
            force: options.Force = False,
            as_json: options.Json = False,
            quiet: options.Quiet = False,
            **own: Any,
        ) -> None:
            from kaju.model.results.result import Result

            console, name = Console(as_json, quiet), "scene" if scene.stem == "-" else scene.stem
            drawn = options.Drawn.none if no_pictures else pictures
            try:
                with options.scene_of(scene, settings) as described:
                    try:
                        target = Folder(out or Path(f"{name}-{ending}"), force)
                    except KajuError:
                        if (goal := own.get("goal")) and described.lattice.dimension == 2:
                            from kaju.model.elastic.solve import spawner_of  # its mistake first

                            spawner_of(described, 0.5, None, None, options.goals_of(goal))
                        raise
                    result = do(described, console.say, **own)
            except KeyboardInterrupt as stop:
                best = options.best_of(stop, Result)
                console.figures(best.summary())
                console.say(*target.write(best, "none"))
                typer.echo(f"{NOTE}; it is in {target.path}", err=True)
                raise typer.Exit(130) from None
            except ConvergenceError as error:
                if isinstance(error.best, Result):
                    console.say(*target.write(error.best, "none"))
                raise
            console.figures(result.summary())
            console.say(*target.write(result, drawn))
            if drawn is not options.Drawn.none:
                console.say(f"look first at {target.path / f'{result.pictures[0]}.png'}")

        # Typer reads the options of all and the verb's own from one signature.
        shared = list(signature(command, eval_str=True).parameters.values())[:-1]
        every = [*shared, *list(signature(do, eval_str=True).parameters.values())[2:]]
        command.__name__, command.__doc__ = do.__name__, do.__doc__
        command.__annotations__ = {each.name: each.annotation for each in every}
        command.__signature__ = Signature(every)  # type: ignore[attr-defined]
        return command

    return verb


PRESSED = """\
A steel plate stands on the ground. A force of 2 N presses on one of its 400 cells, at the top.
That cell wakes as an agent: the load squeezes it, and it hands loads on to its neighbours, which
do the same. After {} generations {} cells are awake, and the run ends: all loads that are left are
10 mN or less, too small to wake a cell.
"""
WATCH = """\
Now open this page in a browser: {}
  Press Play to watch the load come in; drag the red arrow by its ring to press elsewhere; click a
  cell to see what it took, and what it hands on. (By this rule, which is chosen, forces do not
  balance: press Elasticity to see how far that is from what the plate really does.)
The same as a film, whose colours tell when a cell woke: {}
"""


def demo(
    out: options.Out = None,
    pictures: options.Pictures = True,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Press on a steel plate; write a page, a picture and a film of how the load finds its way."""
    from kaju.model.scene import Scene
    from kaju.model.transfer.load_transfer import LoadTransfer

    console, place = Console(as_json, quiet), Folder(out or Path("kaju-demo"), force)
    plate = Scene.from_toml(options.worked("plate")).with_overrides({"loads.0.steps": 1})
    result = LoadTransfer(plate).reset().run()
    if as_json:
        console.figures(result.summary())
    files = place.write(result, "one" if pictures else "none")
    console.say(PRESSED.format(result.last.generations, len(result.last.cells)))
    if pictures:
        from kaju.view.animation import animate
        from kaju.view.page.export import export_page

        title = {"en": "A plate under load", "de": "Eine Platte unter Last", "ja": "荷重を受ける板"}
        page = export_page(result, place.path / "plate.html", title=title)
        console.say(WATCH.format(page, animate(result, place.path / "spawning.gif")))
    console.say("Figures, arrays and a picture:", *files)


THE_RULE = """
A load P above γ wakes the cell it reaches:         P
it keeps α₁P, which squeezes it, and hands          ↓
α₂P straight ahead and α₃P along each side.     ┌───────┐
Squeezed, it wants to get wider: the part β   ← │ keeps │ → (1−β)να₁P
of that is free, the rest pushes outwards.      │  α₁P  │
A load that is not above γ ends.                └───────┘
                                          α₃P ↓   ↓ α₂P ↓ α₃P
"""
"""What α, β and γ are, with one labelled cell."""


@of_a_scene("result")
def run(
    scene: Any,
    say: Say,
    allow_unstable: Annotated[
        bool, typer.Option("--allow-unstable", help="Run although the loads will grow.")
    ] = False,
    resolution: options.Resolution = None,
) -> Any:
    """Let the agents of a scene act, by its rule, until no load moves any more.

    Writes summary.json, result.npz and a picture. Of an elastic rule order, share, threshold and
    tolerance are obeyed; for the answer of elasticity itself see `kaju solve`.
    """
    scene = scene if resolution is None else scene.refine(resolution)
    result: Result
    if scene.rule.kind == "elastic":
        from kaju.model.elastic.relaxation.elastic_model import ElasticModel

        result = ElasticModel(scene, allow_unstable=allow_unstable).run()
    else:  # on arrays, which wait for no import of Mesa
        from kaju.model.transfer.load_transfer import LoadTransfer

        result = LoadTransfer(scene, allow_unstable).reset().run()
    say(f"agents of the {scene.rule.kind} rule: {result.outcome}")
    if scene.rule.kind != "elastic":
        say(THE_RULE)
    return result


@of_a_scene("solved")
def solve(
    scene: Any,
    say: Say,
    resolution: options.Resolution = None,
    tolerance: Annotated[
        float | None,
        options.share(
            "Largest error allowed, 0.01 or 1%: of the goal, else a share in the energy norm. With "
            "a goal, and within true outlines, 0.01 unless given. An answer that misses it says so "
            "(tolerance kept: missed); the exit code is 0 all the same."
        ),
    ] = None,
    goal: options.Goal = None,
) -> Any:
    """Solve a scene as linear elasticity, whatever its rule.

    Writes summary.json, result.npz and a picture. Without a tolerance solves the scene's cells, but
    within true outlines agents spawn.
    """
    from kaju.model.study.solving import solve as solve_scene

    found = solve_scene(scene, tolerance, resolution=resolution, goal=options.goals_of(goal))
    rough = f"; estimated error about {100.0 * found.error_estimate:.2g} % in the energy norm"
    say("solved as linear elasticity" + rough * (found.tolerance is None))
    return found


@of_a_scene("creep")
def creep(
    scene: Any,
    say: Say,
    hold: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Apply the loads and hold them, without a history."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="How long; as long as the history unless given."),
    ] = None,
) -> Any:
    """Let a scene creep under its history: its materials give, flow, and recover.

    Writes summary.json, result.npz and a picture: displacement, stress and energies over time.
    `kaju animate` makes a film of the folder.
    """
    told = "--hold: give either --hold SECONDS, such as --hold 10, or a [history] in the scene"
    require((scene.history is None) != (hold is None), told)
    from kaju.agents.elastic_rule import ElasticRule
    from kaju.model.rheology.creeping import creep as let_creep
    from kaju.model.rheology.load_history import History

    history = History.step().hold(hold) if hold is not None else scene.history
    # A rule that nobody wrote is none: the body creeps as an elastic one.
    if "rule" not in scene.model_fields_set and scene.lattice.boxes:
        scene = scene.replace(rule=ElasticRule())
    found = let_creep(scene, history, duration)
    say(f"the body in time, by the {scene.rule.kind} rule")
    if not any(material.rheology for material in scene.cell_materials):
        say("no material has a rheology: all of them are elastic, nothing creeps")
    return found


@of_a_scene("broken")
def break_(
    scene: Any,
    say: Say,
    strength: Annotated[
        float | None,
        typer.Option(
            help="Mean strength: Pa of cells (to be given), N of springs (1 unless given)."
        ),
    ] = None,
    measure: Annotated[
        Measure | None,
        typer.Option(help="What is exceeded: force of springs, stress of cells unless given."),
    ] = None,
    scatter: Annotated[float, options.share("How far strengths scatter.")] = 0.1,
    seed: Annotated[int, typer.Option(help="Seed of the strengths.")] = 0,
    most: Annotated[int | None, typer.Option(min=1, help="End after so many breaks.")] = None,
) -> Any:
    """Load a body until it parts: its cells break, one at a time; of hexagons the springs.

    The scene's loads are scaled to each next break. Writes summary.json, result.npz and a picture
    of the crack. `kaju animate` makes a film of the folder.
    """
    from kaju.model.fracture.fracture_model import FractureModel

    how: dict[str, Any] = {"measure": measure and measure.value, "scatter": scatter}
    result = FractureModel(scene, strength=strength, most_breaks=most, seed=seed, **how).run()
    say(f"{result.breaks} {result.parts}s broke, one at a time; {result.outcome}")
    return result


@of_a_scene("grown")
def grow(
    scene: Any,
    say: Say,
    rule: Annotated[
        GrowthRule, typer.Option(help="How cells grow by what they feel.")
    ] = GrowthRule.compliance,
    volume: Annotated[
        float,
        options.share("Share of the body that is filled: at first, and by compliance throughout."),
    ] = 0.5,
    radius: Annotated[
        float, typer.Option(help="Cells over which compliance averages.", min=0.0)
    ] = 2.4,
    steps: Annotated[int, typer.Option(min=1, help="End after so many steps.")] = 100,
) -> Any:
    """Let a body grow where it carries and fade where it does not.

    Every cell of material has a density, which changes step by step. Writes summary.json,
    result.npz and a picture of the design. `kaju animate` makes a film of the folder.
    """
    from kaju.model.growth.growth_model import GrowthModel

    how: dict[str, Any] = {"rule": rule.value, "filter_radius": radius, "most_steps": steps}
    grown = GrowthModel(scene, volume=volume, **how).run()
    say(f"cells grew by the rule of {rule}; {grown.outcome}")
    return grown
