"""The folder that a run writes: whole or not at all, and never over something else."""

from __future__ import annotations

import json
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
        self.force = force
        if is_there(path) and any(path.iterdir()) and not force:
            raise ResultFileError(
                f"{path}: is not empty; take another folder, "
                "or --force to replace the results in it"
            )
        check_writable(path, ResultFileError)

    def write(self, result: Result, pictures: str) -> list[Path]:
        """Write summary.json, result.npz and "one", "all" or "none" of the pictures.

        Everything is written aside first. A new folder then appears in one step; with `force`
        whole files replace those of their names, one by one.
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
        """Give the files their names; return the folder: another if a second run was quicker."""
        if self.force and is_there(self.path):
            for name in names:
                (scratch / name).replace(self.path / name)
            for name in set(OURS).difference(names):  # of the results that are replaced
                (self.path / name).unlink(missing_ok=True)
            return self.path
        place = self.path
        for number in count(2):
            try:
                move_into_place(scratch, place)
                break
            except OSError:
                if not place.exists():
                    raise
            place = self.path.with_name(f"{self.path.name}-{number}")
        return place
