"""A file and a class have a name of their own, so that a name says where one is."""

import ast
from collections import Counter

from parsed_sources import parsed


def twice(names):
    return [name for name, count in Counter(names).items() if count > 1]


def test_files_have_names_of_their_own():
    assert twice(path.name for path in parsed() if path.name != "__init__.py") == []


def test_classes_have_names_of_their_own():
    nodes = [node for tree in parsed().values() for node in tree.body]
    classes = [node.name for node in nodes if isinstance(node, ast.ClassDef)]
    assert len(classes) > 300
    assert twice(classes) == []
