"""Files, classes, public names and kinds of results are what they say."""

import ast
import doctest
import inspect
from collections import Counter
from importlib.resources import files
from pathlib import Path

import pytest
from parsed_sources import parsed

import kaju
from kaju.result_kinds import KINDS, fetch


def twice(names):
    return [name for name, count in Counter(names).items() if count > 1]


def test_files_have_names_of_their_own():
    assert twice(path.name for path in parsed() if path.name != "__init__.py") == []


def test_classes_have_names_of_their_own():
    # Agents in the page are kaju's own by name, in a Python that has no kaju.
    page = Path("view", "page", "python")
    own = [tree for path, tree in parsed().items() if not path.is_relative_to(page)]
    nodes = [node for tree in own for node in tree.body]
    classes = [node.name for node in nodes if isinstance(node, ast.ClassDef)]
    assert len(classes) > 200
    assert twice(classes) == []


NAMES = [name for name in kaju.__all__ if not name.startswith("_")]


def test_a_name_that_is_none_is_told():
    with pytest.raises(AttributeError, match="no attribute 'Scnee'"):
        _ = kaju.Scnee


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_a_public_name_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plate.toml").write_text(files("kaju").joinpath("plate.toml").read_text())
    found = doctest.DocTestFinder(recurse=False).find(getattr(kaju, name), name, globs={})
    assert any(test.examples for test in found), f"{name} has no example"
    told: list[str] = []
    for test in found:
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=told.append)
    assert not told, "".join(told)


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
