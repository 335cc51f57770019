"""A file and a class have a name of their own, so that a name says where one is."""

import ast
from collections import Counter
from pathlib import Path

import kaju

FILES = [
    path
    for path in Path(kaju.__file__).parent.rglob("*.py")
    if path.name != "__init__.py" and "__pycache__" not in path.parts
]


def twice(names):
    return [name for name, count in Counter(names).items() if count > 1]


def test_files_have_names_of_their_own():
    assert len(FILES) > 200
    assert twice(path.name for path in FILES) == []


def test_classes_have_names_of_their_own():
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in FILES]
    classes = [node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef)]
    assert len(classes) > 300
    assert twice(classes) == []
