"""Files and classes have names of their own."""

import ast
from collections import Counter
from pathlib import Path

from parsed_sources import parsed


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
