"""Options that several verbs of the command share, and what they mean."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kaju.errors import ParameterError, require
from kaju.files import is_there

if TYPE_CHECKING:
    from kaju.model.scene import Scene


def fraction(word: str | float) -> float:
    """Return a share, such as 0.05 or 5%, or of a default, which is a number."""
    try:
        told = str(word).strip()
        return float(told.removesuffix("%")) / (100.0 if "%" in told else 1.0)
    except ValueError:
        raise typer.BadParameter(f"a share such as 0.01, or 1%, is needed, got {word!r}") from None


def share(help: str) -> Any:
    """Return an option that takes a share."""
    return typer.Option(parser=fraction, metavar="SHARE", help=help)


def folder(help: str) -> Any:
    """Return the option that says where a folder is written."""
    return typer.Option("--out", "-o", metavar="DIR", help=help)


SceneFile = Annotated[
    Path, typer.Argument(metavar="SCENE", help="A scene file (TOML); - is standard input.")
]
Out = Annotated[
    Path | None,
    folder(
        "Folder for the results; unless given it is named after scene and verb, such as "
        "plate-result (run), plate-solved (solve), plate-creep, plate-broken, plate-grown, "
        "plate-compared or kaju-demo."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change the scene, e.g. rule.threshold=0.001."),
]
Pictures = Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")]
Drawn = StrEnum("Drawn", "one all none")
Draw = Annotated[
    Drawn,
    typer.Option("--pictures", help="Draw the one picture that tells the story, all, or none."),
]
DrawNone = Annotated[bool, typer.Option("--no-pictures", help="As --pictures none.")]
Force = Annotated[bool, typer.Option("--force", help="Replace results that are already there.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print the key figures as JSON, and nothing else.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Resolution = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Split every cell into N along each axis.")
]
Goal = Annotated[
    list[str] | None,
    typer.Option(
        "--goal",
        "--at",
        metavar="PLACE",
        help="What the tolerance is about: the deflection of a side such as top (or top,y), of a "
        'point such as 0.1,0.2 (m), or of a region such as {"box": [[0, 0], [0.1, 0.1]]}. Within '
        "true outlines: the largest hoop stress along an outline such as eye, or von Mises stress "
        "(eye,von_mises); or the deflection of a free side, or of a loaded outline (eye,y).",
    ),
]


def goals_of(words: list[str] | None) -> list[Any] | None:
    """Return what ``--goal`` asks for: numbers and regions as such, anything else as a name."""
    found = []
    for word in words or []:
        try:
            found.append(json.loads(word if word.startswith("{") else f"[{word}]"))
        except json.JSONDecodeError:
            found.append(word)
    return found or None


@contextmanager
def scene_of(path: Path, settings: list[str] | None = None) -> Iterator[Scene]:
    """Yield the scene of a file, changed by ``--set KEY=VALUE``; its errors name file and line."""
    from kaju.model.scene import load_scene, named
    from kaju.model.scene.validation import key_path

    described, changes = load_scene(path), {}
    for setting in settings or ():
        key, equals, value = setting.partition("=")
        require(bool(key and equals), f"--set: KEY=VALUE is needed, got {setting!r}")
        changes[key_path(key.strip())] = value.strip()
    changed = described.with_overrides(changes) if changes else described
    rule, anew = described.rule, described.rule.kind != changed.rule.kind
    for key in vars(changed.rule) if anew else ():
        given = getattr(rule, key, None)
        if given != getattr(type(rule), key, None) and f"rule.{key}" not in changes:
            told = f"another kind of rule begins anew, without rule.{key} = {given} of the file"
            typer.echo(f"--set: {told}; set it, too, to keep it", err=True)
    with named(path, path.read_text("utf-8") if path.is_file() else "", changes):
        yield changed


def best_of(stop: KeyboardInterrupt, kind: type[Any]) -> Any:
    """Return what Ctrl-C left of an answer; end the command if it left nothing."""
    best = getattr(stop, "best", None)
    if not isinstance(best, kind):
        typer.echo("interrupted before there was anything to keep", err=True)
        raise typer.Exit(130) from None
    return best


def worked(name: str) -> str:
    """Return the scene of a worked example, plate or bracket, as text."""
    return files("kaju").joinpath(f"{name}.toml").read_text(encoding="utf-8")


def refuse_to_replace(path: Path, force: bool) -> None:
    """Refuse to write over a file unless that is asked for."""
    if is_there(path) and not force:
        raise ParameterError(f"{path}: exists already; take another name, or --force to replace it")
