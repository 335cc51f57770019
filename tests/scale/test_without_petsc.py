"""What `solve_petsc` says where PETSc is not installed."""

import sys

import pytest
import scale_work

import kaju


def test_without_petsc_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    with pytest.raises(ImportError, match="apt-get install python3-petsc4py-real") as raised:
        kaju.solve_petsc(scale_work.plate())
    assert isinstance(raised.value, kaju.KajuError)
