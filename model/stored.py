"""Results that were stored, of whatever kind."""

from __future__ import annotations

from pathlib import Path

from kaju.errors import ResultFileError
from kaju.model.archive import open_archive
from kaju.model.result import Result


def load_result(path: str | Path) -> Result:
    """Read a result that some result's `save` wrote.

    Parameters
    ----------
    path : path
        An ``.npz`` file, or the folder of a run with ``result.npz`` in it, or one in pieces with
        ``result.pvti``.

    Raises
    ------
    ResultFileError
        If the file is missing, or is no result of kaju's.
    """
    file = Path(path)
    if file.suffix == ".pvti" or (file / "result.pvti").exists():
        from kaju.model.scale.pieces import PiecedResult

        return PiecedResult.load(file)
    if file.is_dir():
        file = file / "result.npz"
    kind = open_archive(file).about["kind"]
    for known in _kinds():
        if kind in known.kinds():
            return known.load(file)
    raise ResultFileError(f"{file}: holds a result of kind {kind!r}, which this kaju cannot read")


def _kinds() -> tuple[type[Result], ...]:
    from kaju.model.creep.body import TransferCreepResult
    from kaju.model.creep.elastic import ElasticCreepResult
    from kaju.model.creep.network import NetworkCreepResult
    from kaju.model.creep.state import CreepResult
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.elastic.settling.run import ElasticRun
    from kaju.model.network import NetworkResult
    from kaju.model.propagation.transfer_result import TransferResult

    static = (TransferResult, ElasticResult, ElasticRun, NetworkResult)
    return *static, CreepResult, NetworkCreepResult, TransferCreepResult, ElasticCreepResult
