"""The verb `creep`: a scene in time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kaju.errors import ParameterError

from .commands_run import into_folder
from .console import Console
from .options import Force, Json, Out, Pictures, Quiet, SceneFile, Settings, scene_of

if TYPE_CHECKING:
    from kaju.model.result import Result

Hold = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="For a scene without a history: apply its loads and hold them."
    ),
]
Duration = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="How long; as long as the history unless given."),
]
Step = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Longest time step; unless given it is chosen."),
]


def creep(
    scene: SceneFile,
    out: Out = None,
    settings: Settings = None,
    hold: Hold = None,
    duration: Duration = None,
    step: Step = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let a scene creep under its history: its materials give, flow, and recover.

    Writes summary.json, result.npz and pictures: displacement, stress and energies over time,
    and the body at the end. `kaju animate` makes a film of the folder.
    """
    console, described = Console(as_json, quiet), scene_of(scene, settings)
    if (described.history is None) == (hold is None):
        raise ParameterError(
            "--hold: a scene without [history] needs --hold SECONDS, such as --hold 10"
            if hold is None
            else "--hold: the scene has a [history] of its own, so leave this out"
        )

    def answer() -> Result:
        from kaju.agents.history import History
        from kaju.model.creep import creep as let_creep

        history = History.step().hold(hold) if hold is not None else described.history
        found = let_creep(described, history, duration, step=step)
        console.say(f"the body of the {described.rule.kind} rule in time")
        if not any(material.rheology for material in described.cell_materials):
            console.say("no material has a rheology: all of them are elastic, nothing creeps")
        return found

    into_folder(out or Path(f"{scene.stem}-creep"), console, answer, pictures, force)
