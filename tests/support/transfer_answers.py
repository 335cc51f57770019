"""Answers of load transfer: by both engines, cell by cell, and compared as wholes."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest

ENGINES = pytest.mark.parametrize("engine", ["agents", "arrays"])


def of_cells(result, values):
    """Return the values of the agents by the cells where they live."""
    return dict(zip(map(tuple, result.last.cells.tolist()), values, strict=True))


def assert_same(one, other, tolerance=0.0):
    """Compare what two dataclasses hold, and what is held therein; bit for bit unless told."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, (np.ndarray, float)):
            np.testing.assert_allclose(a, b, tolerance, tolerance, err_msg=field.name)
        elif is_dataclass(a):
            assert_same(a, b, tolerance)
        else:
            assert a == b, field.name
