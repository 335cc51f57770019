"""The folder that a run writes: whole or not at all, and never over something else."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from kaju.errors import ResultFileError
from kaju.files import check_writable, is_there, scratch_folder, take_place
from kaju.view import PICTURES

from .options import Drawn

if TYPE_CHECKING:
    from kaju.model.results.result import Result

OURS = ("summary.json", "result.npz", *PICTURES)


class Folder:
    """A place for results, made or replaced (`force`) when these are there; other files stay."""

    def __init__(self, path: Path, force: bool = False) -> None:
        self.path = path
        if is_there(path) and not path.is_dir():
            raise ResultFileError(f"{path}: is a file; --out needs a folder")
        if Path.cwd().is_relative_to(path.resolve()):
            raise ResultFileError(
                f"{path}: is a folder that you stand in, and results arrive as a whole folder; "
                f"take a new one, such as {path / 'result'}"
            )
        self._replaces = _identity(path) if is_there(path) and any(path.iterdir()) else None
        if self._replaces is not None and not force:
            raise ResultFileError(
                f"{path}: is not empty; take another folder, "
                "or --force to replace the results in it"
            )
        check_writable(path, ResultFileError)

    def write(self, result: Result, pictures: Drawn) -> list[Path]:
        """Write summary.json, result.npz and pictures; return their paths.

        Everything is written aside first; the whole folder then takes its place in one step.
        """
        with scratch_folder(self.path, ResultFileError) as scratch:
            self._fill(scratch, result, pictures)
            names = sorted(file.name for file in scratch.iterdir())
            place = self._arrive(scratch, names)
        if place != self.path:
            raise ResultFileError(
                f"{self.path}: another run has put its results there since this one began; "
                f"this one's are in {place}"
            )
        return [place / name for name in names]

    def _fill(self, scratch: Path, result: Result, pictures: Drawn) -> None:
        result.save(scratch / "result.npz")
        summary = json.dumps(result.summary(), indent=2, allow_nan=False)
        (scratch / "summary.json").write_text(summary + "\n", encoding="utf-8")
        if pictures is Drawn.ALL:
            from kaju.view import plot_all

            plot_all(result, scratch)
        elif pictures is Drawn.ONE:
            from kaju.view import plot
            from kaju.view.picture_files import save

            save(plot(result), scratch / f"{result.pictures[0]}.png")

    @staticmethod
    def story(written: list[Path], result: Result) -> Path:
        """Return which of the files tells the story: the picture to look at first."""
        return next(path for path in written if path.name == f"{result.pictures[0]}.png")

    def _arrive(self, scratch: Path, names: list[str]) -> Path:
        """Let the folder take its place; return which: another if somebody else was quicker."""
        if self._replaces is not None and _identity(self.path) == self._replaces:
            for entry in self.path.iterdir():
                if entry.name not in (*names, *OURS):
                    _keep(entry, scratch / entry.name)
            take_place(scratch, self.path, replace=True)
            return self.path
        for place in self._places():
            try:
                take_place(scratch, place, replace=False)
            except OSError:
                if not place.exists():
                    raise
            else:
                return place
        raise AssertionError  # there are always more names

    def _places(self) -> Iterator[Path]:
        yield self.path
        for number in count(2):
            yield self.path.with_name(f"{self.path.name}-{number}")


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what tells a folder from another of the same name; None if there is none."""
    try:
        about = path.stat()
    except FileNotFoundError:
        return None
    return about.st_dev, about.st_ino


def _keep(entry: Path, copy: Path) -> None:
    """Put a file or folder of somebody else's under a second name, without copying if possible."""
    if entry.is_dir() and not entry.is_symlink():
        shutil.copytree(entry, copy, symlinks=True, copy_function=_link)
    else:
        _link(entry, copy)


def _link(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, target, follow_symlinks=False)
