"""Every public name shows how it is used, and what it shows is what happens."""

import doctest

import pytest

import kaju

NAMES = [name for name in kaju.__all__ if not name.startswith("_")]


def test_a_name_that_is_none_is_told():
    with pytest.raises(AttributeError, match="no attribute 'Scnee'"):
        _ = kaju.Scnee


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_a_public_name_runs(name):
    found = doctest.DocTestFinder(recurse=False).find(getattr(kaju, name), name, globs={})
    assert any(test.examples for test in found), f"{name} has no example"
    told: list[str] = []
    for test in found:
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=told.append)
    assert not told, "".join(told)
