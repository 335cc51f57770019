"""Which of the varied quantities matter: shares of the variance of what was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ResultError

from .job import ERROR
from .points import GRID, salib

if TYPE_CHECKING:
    import pandas

LEAST_POINTS = 65
"""RBD-FAST reads six harmonics in both senses; below this it has nothing to read."""


def sensitivity(table: pandas.DataFrame, measure: str, seed: int = 0) -> pandas.DataFrame:
    """Return how much of the variance of a measure each varied quantity explains.

    Parameters
    ----------
    table : DataFrame
        What `kaju.sweep` or `load_sweep` returned, without failed runs.
    measure : str
        A column of numbers.
    seed : int
        For the resampling that confidence intervals come from.

    Returns
    -------
    DataFrame
        Indexed by quantity. `first`: the share that the quantity explains by itself. After
        ``method="saltelli"`` also `total`, the share that is lost if it does not vary, and
        their half 95 % confidence intervals (`first_conf`, `total_conf`).

    Raises
    ------
    ResultError
        If the table is no whole sweep of numbers that vary.
    MissingExtraError
        If SALib is needed and missing.

    Notes
    -----
    Grids: variance of the means at the values of one quantity over the whole variance (exact
    for the grid). Saltelli's points: Sobol indices (Saltelli et al. 2010,
    doi:10.1016/j.cpc.2009.09.018). Other samples: RBD-FAST (Tarantola et al. 2006,
    doi:10.1016/j.ress.2005.06.003).
    """
    import pandas

    about = about_sweep(table)
    value = _measured(table, measure, about["points"])
    keys = list(about["varied"])
    place = np.column_stack([_codes(table[key]) for key in keys])
    if about["method"] == GRID:
        shares = [_explained(column, value) for column in place.T]
        return pandas.DataFrame({"first": shares}, index=pandas.Index(keys, name="quantity"))
    cube = {"num_vars": len(keys), "names": keys, "bounds": [[0.0, 1.0]] * len(keys)}
    if about["method"] == "saltelli":
        found = salib("analyze.sobol").analyze(cube, value, calc_second_order=False, seed=seed)
        columns = {"first": "S1", "first_conf": "S1_conf", "total": "ST", "total_conf": "ST_conf"}
    else:
        if len(value) < LEAST_POINTS:
            raise ResultError(
                f"table: {len(value)} points are too few to tell shares of the variance; "
                f"take {LEAST_POINTS} or more"
            )
        found = salib("analyze.rbd_fast").analyze(cube, place, value, seed=seed)
        columns = {"first": "S1", "first_conf": "S1_conf"}
    return pandas.DataFrame(
        {name: np.asarray(found[theirs]) for name, theirs in columns.items()},
        index=pandas.Index(keys, name="quantity"),
    )


def about_sweep(table: pandas.DataFrame) -> dict[str, Any]:
    """Return what a sweep's table says of itself; refuse other tables."""
    about: dict[str, Any] | None = table.attrs.get("sweep")
    if about is None:
        raise ResultError("table: is not of a sweep; take what kaju.sweep or load_sweep returned")
    return about


def _measured(table: pandas.DataFrame, measure: str, points: int) -> Floats:
    if measure not in table:
        raise ResultError(
            f"measure: the table has no column {measure!r}: {', '.join(map(str, table))}"
        )
    if len(table) < points or (table[ERROR] != "").any():
        raise ResultError(
            f"table: of {points} runs {len(table)} are there and {int((table[ERROR] != '').sum())} "
            "failed; shares of the variance need all of them"
        )
    try:
        value = table[measure].to_numpy(dtype=np.float64)
    except (TypeError, ValueError):
        raise ResultError(f"measure: {measure!r} is no number everywhere") from None
    if not np.isfinite(value).all() or np.ptp(value) == 0.0:
        raise ResultError(f"measure: {measure!r} does not vary, or is not finite everywhere")
    return value


def _codes(column: Any) -> Floats:
    """Return numbers as they are, other values as their ranks."""
    if column.dtype.kind in "iuf":
        return np.asarray(column, dtype=np.float64)
    return np.unique(column.astype(str), return_inverse=True)[1].astype(np.float64)


def _explained(column: Floats, value: Floats) -> float:
    _, level = np.unique(column, return_inverse=True)
    means = np.bincount(level, value) / np.bincount(level)
    return float(np.var(means[level]) / np.var(value))
