"""The verbs about files: `new`, `check`, `materials`, `animate` and `page`."""

from __future__ import annotations

import json
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from kaju.errors import ParameterError
from kaju.files import atomic_file

from .console import Console
from .options import Force, Json, SceneFile, Settings, refuse_to_replace, scene_of, worked

Language = StrEnum("Language", "en de ja")


def check(scene: SceneFile, settings: Settings = None, as_json: Json = False) -> None:
    """Find mistakes in a scene; if it has a rule, say whether loads will end (exit code 1: no).

    Scenes without one, or with the elastic one, are solved: within true outlines roughly, others on
    their cells.
    """
    console = Console(as_json)
    with scene_of(scene, settings) as described:
        notes = described.notes
        console.say(*(f"note: {note}" for note in notes))
        told: dict[str, Any] = {"stable": True}
        given = "rule" in described.model_fields_set and described.rule.kind != "elastic"
        of_agents = given or described.body.allow_floating or not described.lattice.boxes
        if described.outlined or not of_agents:
            farthest, further = _begin(described)
            notes = (*described.notes_on(farthest), *further)
            console.say(*(f"note: {note}" for note in notes[len(described.notes) :]))
            words = "no mistake was found in the scene; compute it with kaju solve"
            if any("?" in note for note in notes):
                words = "a note asks a question; if all is meant so, compute it with kaju solve"
            console.say(words)
        else:
            from kaju.model.transfer.stability import stability

            found = stability(described)
            radius, bounds = found.spectral_radius, [found.lower, found.upper]
            growth = f"{radius:.4g}" if radius is not None else "{:.4g} to {:.4g}".format(*bounds)
            words, gap = found.verdict, 9 * " "
            console.say(
                f"verdict  {words}",
                f"{gap}of each load at most {found.largest_share:.4g} is passed on in one piece",
                f"{gap}if loads that meet were added: {growth} times as much a generation",
                f"{gap}by the rule, as in kaju run; kaju solve takes the law of elasticity instead",
            )
            told |= {"stable": found.stable, "largest_share": found.largest_share}
            told |= {"spectral_radius": radius, "spectral_radius_bounds": bounds}
    if as_json:
        typer.echo(json.dumps(told | {"verdict": words, "notes": notes}, indent=2))
    raise typer.Exit(0 if told["stable"] else 1)


def _begin(scene: Any) -> tuple[float, list[str]]:
    """Do what an answer begins with; return the largest displacement (m), 0 of waves, and notes."""
    from kaju.model.study.solving import solve

    if getattr(scene.rule, "order", "") == "wave" and not scene.outlined:  # waves may grow
        from kaju.model.elastic.relaxation.elastic_model import ElasticModel

        ElasticModel(scene)
        return 0.0, []
    rough = 0.9 if scene.outlined and scene.lattice.dimension == 2 else None
    answer = solve(scene, rough)
    further = [n for n in answer.caveats if not n.startswith(("error", "tolerance"))]
    return answer.max_displacement, further


def materials() -> None:
    """List the materials that scenes can use by name."""
    from kaju.agents.materials import LIBRARY

    row = "{:12} {:>10} {:>6} {:>16}  {}".format
    typer.echo(row("name", "E (Pa)", "ν", "density (kg/m³)", "source"))
    for one in LIBRARY.values():
        density = "" if one.density is None else f"{one.density:.4g}"
        ratio = f"{one.poissons_ratio:.3g}"
        typer.echo(row(one.name, f"{one.youngs_modulus:.4g}", ratio, density, one.source))


def new(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="The file to write.")],
    bracket: Annotated[bool, typer.Option("--bracket", help="A part, for kaju solve.")] = False,
    force: Force = False,
) -> None:
    """Write a commented scene to start from: a plate for agents to act in, or a bracket."""
    name, verb = ("bracket", "solve") if bracket else ("plate", "run")
    refuse_to_replace(scene, force)
    with atomic_file(scene, ParameterError) as scratch:
        scratch.write_text(worked(name).replace(f"{name}.toml", scene.name), encoding="utf-8")
    typer.echo(f"{scene}: edit it, then: kaju {verb} {scene}")


def animate(
    stored: Annotated[Path, typer.Argument(metavar="RESULT", help="A result, or its folder.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="A .gif, .webp or .mp4 film, a .glb mesh (Blender), a .pvd series (ParaView), or "
            "a folder of frames without background.",
        ),
    ] = None,
    what: Annotated[
        str | None, typer.Option(help="generations, stages, waves, loading, increments, or loads.")
    ] = None,
    frames_per_second: Annotated[
        float | None, typer.Option("--fps", help="Frames per second: 25 in time, 2 of steps.")
    ] = None,
    bare: Annotated[bool, typer.Option("--bare", help="Only the body: no axes, no words.")] = False,
    force: Force = False,
) -> None:
    """Animate a stored run; nothing is computed again."""
    from kaju.model.results.archive import load_result
    from kaju.view.animation import animate as film

    result = load_result(stored)
    folder = stored if stored.is_dir() else stored.parent
    refuse_to_replace(target := out or folder / f"{what or 'film'}.gif", force)
    typer.echo(film(result, target, what=what, fps=frames_per_second, bare=bare))


def page(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A scene (.toml), a result, or its folder.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="The page, an .html file.")
    ] = None,
    title: Annotated[str | None, typer.Option(help="The headline.")] = None,
    language: Annotated[
        Language | None,
        typer.Option(help="Of the page's own words; the reader's own unless given."),
    ] = None,
    python: Annotated[
        bool, typer.Option("--python", help="Readers write agents of their own in it.")
    ] = False,
    settings: Settings = None,
    force: Force = False,
) -> None:
    """Write a page that opens by a double click: no server, no network, no installation."""
    from kaju.model.results.archive import load_result
    from kaju.view.page.export import export_page

    refuse_to_replace(target := out or Path(f"{file.stem}.html"), force)
    is_scene = file.suffix == ".toml"
    if settings and not is_scene:
        raise ParameterError("--set: changes a scene, and this is a stored result; leave --set out")
    of: Any = scene_of(file, settings) if is_scene else nullcontext(load_result(file))
    called = file.stem.replace("-", " ").replace("_", " ").capitalize()
    with of as shown:
        headline = title or (called if is_scene else f"{shown.kind.capitalize()}: {file.stem}")
        told: Any = {"title": headline, "language": language and language.value}
        export_page(shown, target, python=python, **told)
    typer.echo(f"{target}: open it in a browser")
