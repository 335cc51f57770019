"""The folder that `kaju run` writes: whole or not at all, and never over something else."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from kaju.errors import ResultFileError
from kaju.view import PICTURES

if TYPE_CHECKING:
    from kaju.model.result import Result


class Folder:
    """A place for results.

    Parameters
    ----------
    path : Path
        The folder; it is made when the results are there.
    force : bool
        Replace the results of an earlier run. Other files in the folder are left alone.

    Raises
    ------
    ResultFileError
        If something is already there and `force` is False.
    """

    def __init__(self, path: Path, force: bool = False) -> None:
        self.path = path
        if path.exists() and not path.is_dir():
            raise ResultFileError(f"{path}: is a file; --out needs a folder")
        if path.exists() and any(path.iterdir()) and not force:
            raise ResultFileError(
                f"{path}: is not empty; take another folder, "
                "or --force to replace the results in it"
            )

    def write(self, result: Result, pictures: bool) -> list[Path]:
        """Write summary.json, result.npz and pictures; return their paths.

        Everything is written aside first, and then moved into place.

        Raises
        ------
        ResultFileError
            If the folder cannot be written.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.path.parent, prefix=".kaju-") as scratch:
                self._fill(Path(scratch), result, pictures)
                return self._move(Path(scratch))
        except OSError as error:
            if isinstance(error, ResultFileError):
                raise
            raise ResultFileError(f"{self.path}: cannot be written: {error.strerror}") from error

    def _fill(self, scratch: Path, result: Result, pictures: bool) -> None:
        result.save(scratch / "result.npz")
        summary = json.dumps(result.summary(), indent=2, allow_nan=False)
        (scratch / "summary.json").write_text(summary + "\n", encoding="utf-8")
        if pictures:
            from kaju.view import plot_all

            plot_all(result, scratch)

    def _move(self, scratch: Path) -> list[Path]:
        self.path.mkdir(exist_ok=True)
        for name in PICTURES:
            (self.path / name).unlink(missing_ok=True)
        return [
            Path(shutil.move(file, self.path / file.name)) for file in sorted(scratch.iterdir())
        ]
