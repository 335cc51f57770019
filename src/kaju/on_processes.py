"""`kaju solve --engine petsc` under mpirun: all processes compute, one speaks."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaju.errors import ConvergenceError, KajuError, ResultFileError

if TYPE_CHECKING:
    from kaju.model.scene import Scene

    from .console import Console


def solve_on_processes(scene: Scene, folder: Path, console: Console, **how: Any) -> bool:
    """Solve a scene and write it in pieces, if there are several processes.

    Returns
    -------
    bool
        False, with nothing done, if this process is alone.
    """
    from kaju.model.scale.pieces import PiecedResult
    from kaju.model.scale.solve import communicator, solve_petsc, together

    comm = communicator()
    if comm.Get_size() == 1:
        return False
    speaks = comm.Get_rank() == 0
    try:
        together(comm, lambda: _check_new(folder))
        try:
            result, missed = solve_petsc(scene, **how), None
        except ConvergenceError as error:
            result, missed = error.best, error  # type: ignore[assignment]
        assert isinstance(result, PiecedResult)
        if speaks:
            console.figures(result.summary())
        result.save(folder)
        if speaks:
            console.files(sorted(folder.iterdir()))
        if missed is not None:
            raise missed
    except KajuError:
        if not speaks:
            raise SystemExit(2) from None
        raise
    except Exception:
        # The others may be waiting for a message that this process will never send.
        traceback.print_exc()
        comm.Abort(1)
    return True


def _check_new(folder: Path) -> None:
    if folder.exists():
        raise ResultFileError(f"{folder}: exists already; pieces go into a new folder")
