"""What `engine=` says where PETSc is not installed."""

import sys

import pytest
import scale_work

import kaju


def test_engines_that_are_not_there_are_refused():
    with pytest.raises(ValueError, match=r"engine: None .* or 'petsc', got 'cuda'"):
        kaju.solve(scale_work.plate(), engine="cuda")


def test_without_petsc_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "petsc4py", None)
    with pytest.raises(ImportError, match="apt-get install python3-petsc4py-real") as raised:
        kaju.solve(scale_work.plate(), engine="petsc")
    assert isinstance(raised.value, kaju.KajuError)
