"""The folder that a run writes: whole or not at all, and never over something else."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaju.errors import ResultFileError
from kaju.files import check_writable, hidden_folder, is_there, move_into_place
from kaju.view import PICTURES

if TYPE_CHECKING:
    from kaju.model.results.result import Result


class Folder:
    """A place for results, made or replaced (`force`) when these are there; other files stay."""

    def __init__(self, path: Path, force: bool = False) -> None:
        self.path, self.force = path, force
        if is_there(path) and not path.is_dir():
            raise ResultFileError(f"{path}: is a file; --out needs a folder")
        if Path.cwd().is_relative_to(path.resolve()):
            raise ResultFileError(
                f"{path}: is the working folder, and results need a folder of their own; take a "
                f"new one, such as {path / 'result'}"
            )
        if is_there(path) and any(path.iterdir()) and not force:
            raise ResultFileError(
                f"{path}: is not empty; take another folder, "
                "or --force to replace the results in it"
            )
        check_writable(path, ResultFileError)

    def fill(self, write: Callable[[Path], object]) -> list[Path]:
        """Let files be written aside, and give them their places; return these.

        A new folder appears in one step; with `force` whole files replace those of their names,
        one by one, and results that are not written again go.
        """
        with hidden_folder(self.path, ResultFileError) as scratch:
            write(scratch)
            names = sorted(file.name for file in scratch.iterdir())
            if self.force and is_there(self.path):
                for name in names:
                    (scratch / name).replace(self.path / name)
                for name in {"summary.json", "result.npz", *PICTURES}.difference(names):
                    (self.path / name).unlink(missing_ok=True)
            else:
                move_into_place(scratch, self.path)
        return [self.path / name for name in names]

    def write(self, result: Result, pictures: str) -> list[Path]:
        """Write summary.json, result.npz and "one", "all" or "none" of the pictures."""

        def parts(scratch: Path) -> None:
            result.save(scratch / "result.npz")
            write_json(scratch / "summary.json", result.summary())
            if pictures == "all":
                from kaju.view import plot_all

                plot_all(result, scratch)
            elif pictures == "one":
                from kaju.view import plot
                from kaju.view.picture_files import save

                save(plot(result), scratch / f"{result.pictures[0]}.png")

        return self.fill(parts)


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write key figures as JSON."""
    path.write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")
