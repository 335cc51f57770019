"""A model half-way, in a file: what was asked, the seed, and how many steps were taken.

Steps are certain: from the same scene, seed and classes they lead to the same numbers, bit for
bit. So a checkpoint holds no inboxes and no multigrid cycle half done; loading it takes the
steps again, and compares the figures that were noted on the way. Nothing in the file is code:
classes of one's own are given again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaju.errors import ParameterError, ResultFileError

from .archive import Archive, open_archive, reading, write_archive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .mesa_model import SteppedModel

_SUBJECT = "subject."
Draws = tuple[dict[str, Any], tuple[int, tuple[int, ...], float | None]]
"""States of a model's two generators of random numbers, before anything was drawn."""


def save(
    model: SteppedModel,
    path: str | Path,
    subject: tuple[dict[str, NDArray[Any]], dict[str, Any]],
    options: Mapping[str, Any],
    own: Mapping[str, Any],
) -> Path:
    """Write a checkpoint; see `SteppedModel.save_checkpoint`.

    Parameters
    ----------
    subject : tuple of arrays and plain values
        The scene or network, taken apart.
    options : mapping
        Plain arguments of the model.
    own : mapping
        Arguments that must be given again, those that are None left out.
    """
    arrays, about = subject
    drawn, state = model.first_draws
    text = {
        "model": type(model).__name__,
        "subject": about,
        "options": dict(options),
        "own": {name: _named(value) for name, value in own.items() if value is not None},
        "rng": [drawn, state],
        "steps": model.steps,
        "figures": model.figures(),
    }
    packed = {_SUBJECT + name: array for name, array in arrays.items()}
    return write_archive(path, "checkpoint", packed, text)


def _named(value: Any) -> str:
    """Return what tells a reader which class or object was used."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_named(part)}" for key, part in sorted(value.items()))
    return str(getattr(value, "__name__", None) or type(value).__name__)


def load(kind: type[SteppedModel], path: str | Path, own: Mapping[str, Any]) -> Any:
    """Return the model of a checkpoint; see `SteppedModel.load_checkpoint`."""
    target = Path(path)
    if not target.exists() and target.suffix != ".npz":
        target = target.with_name(target.name + ".npz")
    archive = open_archive(target, "checkpoint")
    with reading(target):
        model_name = archive.value("model", str)
        if model_name != kind.__name__:
            raise ResultFileError(
                f"{target}: holds a {model_name}; load it with {model_name}.load_checkpoint"
            )
        described = archive.value("subject", dict[str, Any])
        parts = Archive(target, archive.part(_SUBJECT), described)
        subject = kind.checkpoint_subject(parts)
        wanted = archive.value("own", dict[str, str])
        steps, figures = archive.value("steps", int), archive.about["figures"]
    _check_own(target, wanted, own)
    # What goes wrong with classes of one's own is not the file's fault.
    with nullcontext() if own else reading(target):
        model = kind(subject, **archive.value("options", dict[str, Any]), **own)
        model.first_draws = archive.value("rng", Draws)
        model.reset()
        while model.running and model.steps < steps:
            model.step()
    again = json.loads(json.dumps(model.figures()))
    if model.steps != steps or repr(again) != repr(figures):
        raise ResultFileError(
            f"{target}: its {steps} steps led elsewhere this time ({again} instead of {figures}); "
            "agents were changed by hand between steps, draw random numbers that are not the "
            "model's, or are other classes now"
        )
    return model


def _check_own(target: Path, wanted: dict[str, str], given: Mapping[str, Any]) -> None:
    found = {name: _named(value) for name, value in given.items() if value is not None}
    for name in wanted.keys() | found.keys():
        if wanted.get(name) != found.get(name):
            raise ParameterError(
                f"{name}: {target} was made with {wanted.get(name, 'none of your own')}, got "
                f"{found.get(name, 'none')}; give load_checkpoint(path, {name}=...) what the "
                "model was made with"
            )
