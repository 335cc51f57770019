"""Every kind of result is entered once, and what is entered is there."""

import inspect

import pytest

from kaju.result_kinds import KINDS, fetch


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_entered_is_there(kind):
    entry = KINDS[kind]
    assert fetch(entry.result).kind == kind
    for film in map(fetch, entry.films.values()):
        assert film.option in inspect.signature(fetch(entry.pictures[film.picture])).parameters
    for named in (entry.pictures, entry.meshes):
        for function in map(fetch, named.values()):
            assert callable(function)
            assert inspect.signature(function).parameters
    assert entry.page is None or callable(fetch(entry.page))
