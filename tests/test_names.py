"""Files have names of their own, import in one direction, and nothing below imports the view."""

import ast
from collections import Counter
from pathlib import Path

import networkx as nx
from parsed_sources import parsed


def twice(names):
    return [name for name, count in Counter(names).items() if count > 1]


def module_of(path):
    return ".".join(["kaju", *path.with_suffix("").parts]).removesuffix(".__init__")


def outside_functions(body):
    """Yield statements that run, or are read by type checkers, when a module is imported."""
    for node in body:
        yield node
        if isinstance(node, ast.If | ast.Try):
            yield from outside_functions([*node.body, *node.orelse])


def imported(path, nodes):
    """Yield the modules, or names in them, that are imported, under TYPE_CHECKING as well."""
    package = module_of(path).split(".")[: None if path.name == "__init__.py" else -1]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            home = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{home}.{alias.name}" for alias in node.names)


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


def test_imports_run_in_no_circle():
    modules = {module_of(path) for path in parsed()}
    graph = nx.DiGraph()
    for path, tree in parsed().items():
        for name in imported(path, outside_functions(tree.body)):
            graph.add_edge(module_of(path), name if name in modules else name.rpartition(".")[0])
    graph.remove_node("kaju")  # It names all that is public, and is where that is fetched from.
    assert graph.number_of_edges() > 500
    assert [sorted(c) for c in nx.strongly_connected_components(graph) if len(c) > 1] == []


def test_nothing_below_imports_the_view():
    below = [path for path in parsed() if path.parts[0] in ("agents", "model")]
    reaching = [
        str(path)
        for path in below
        if any(name.startswith("kaju.view") for name in imported(path, ast.walk(parsed()[path])))
    ]
    assert len(below) > 100
    assert reaching == []
