"""The folder that a run writes: whole or not at all, and never over something else."""

from __future__ import annotations

import json
import os
import shutil
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from kaju.errors import ResultFileError
from kaju.files import check_writable, hidden_folder, is_there, move_into_place
from kaju.view import PICTURES

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

    def write(self, result: Result, pictures: str) -> list[Path]:
        """Write summary.json, result.npz and "one", "all" or "none" of the pictures.

        Everything is written aside first; the whole folder then takes its place in one step.
        """
        with hidden_folder(self.path, ResultFileError) as scratch:
            result.save(scratch / "result.npz")
            summary = json.dumps(result.summary(), indent=2, allow_nan=False)
            (scratch / "summary.json").write_text(summary + "\n", encoding="utf-8")
            if pictures == "all":
                from kaju.view import plot_all

                plot_all(result, scratch)
            elif pictures == "one":
                from kaju.view import plot
                from kaju.view.picture_files import save

                save(plot(result), scratch / f"{result.pictures[0]}.png")
            names = sorted(file.name for file in scratch.iterdir())
            place = self._move_in(scratch, names)
        if place != self.path:
            raise ResultFileError(
                f"{self.path}: another run has put its results there since this one began; "
                f"this one's are in {place}"
            )
        return [place / name for name in names]

    def _move_in(self, scratch: Path, names: list[str]) -> Path:
        """Let the folder take its place; return which: another if a second run was quicker."""
        if self._replaces is not None and _identity(self.path) == self._replaces:
            for entry in self.path.iterdir():
                if entry.name not in (*names, *OURS):
                    _keep(entry, scratch / entry.name)
            move_into_place(scratch, self.path, replace=True)
            return self.path
        place = self.path
        for number in count(2):
            try:
                move_into_place(scratch, place, replace=False)
                break
            except OSError:
                if not place.exists():
                    raise
            place = self.path.with_name(f"{self.path.name}-{number}")
        return place


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what distinguishes a folder from another of the same name; None if there is none."""
    try:
        about = path.stat()
    except FileNotFoundError:
        return None
    return about.st_dev, about.st_ino


def _keep(entry: Path, copy: Path) -> None:
    """Put a foreign file or folder under a second name, by links where the system can."""
    if entry.is_dir() and not entry.is_symlink():
        shutil.copytree(entry, copy, symlinks=True, copy_function=_link)
    else:
        _link(entry, copy)


def _link(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, target, follow_symlinks=False)
