"""Rooms import one another downwards, files in no circle, and the drawing of them is true."""

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import draw_rooms
import networkx as nx
import pytest

ROOT = Path(__file__).parents[1]
if not (ROOT / "model").is_dir():
    pytest.skip("the rooms are in a checkout, and this is none", allow_module_level=True)
# Imported in functions: optional packages, and what takes long to load and is seldom needed.
SELDOM = (
    "pandas scipy PIL contourpy petsc4py mpi4py skfem numba rich svgpathtools trimesh meshlane "
    "joblib tifffile tomli_w tomllib networkx imageio_ffmpeg pydantic kaju"
)
MODULES = dict(draw_rooms.files())


def in_functions(path):
    """The modules that a file imports within functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    for node in (inner for function in functions for inner in ast.walk(function)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "kaju." * (node.level > 0) + (node.module or "")


def test_files_import_one_another_in_no_circle():
    """Those in functions counted."""
    graph = draw_rooms.graph()
    assert graph.number_of_edges() > 500
    found = [c for c in nx.strongly_connected_components(graph) if len(c) > 1]
    assert found == []


def test_functions_import_what_is_seldom_needed():
    for module, path in MODULES.items():
        if "python" in path.parts:
            continue  # agents in the page
        for name in in_functions(path):
            assert name.partition(".")[0] in SELDOM.split(), f"{module} imports {name}"


def test_nothing_below_imports_the_roof():
    rooms = draw_rooms.rooms()
    assert set(rooms.predecessors("cli")) == set()
    assert set(rooms.predecessors("page")) <= {"cli"}
    assert set(rooms.predecessors("view")) <= {"cli", "page"}


def test_the_drawing_shows_what_is_imported():
    """If not: python docs/draw_rooms.py."""
    rooms = draw_rooms.rooms()
    arrows = {f"{one}-{other}" for one, other in {*draw_rooms.drawn(rooms).edges}}
    drawing = ElementTree.parse(draw_rooms.DRAWING)
    ids = {node.tag.rpartition("}")[2]: set() for node in drawing.iter()}
    for node in drawing.iter():
        ids[node.tag.rpartition("}")[2]].add(node.get("id"))
    upwards = {"-".join(pair) for pair in draw_rooms.upwards(rooms)}
    assert ids["path"] - {None} == arrows | upwards
    assert ids["text"] - {None} == set(rooms)


FOLDERS = sorted(
    path.parent
    for home in ("agents", "cli", "model", "view", "src/kaju")
    for path in (ROOT / home).rglob("__init__.py")
)


@pytest.mark.parametrize("home", FOLDERS, ids=lambda home: str(home.relative_to(ROOT)))
def test_rooms_say_in_few_lines_what_they_do_and_where_to_begin(home):
    about = ast.get_docstring(ast.parse((home / "__init__.py").read_text(encoding="utf-8")))
    assert len(about.splitlines()) <= 14
    named = re.findall(r"`([a-z_]+)`", about.partition("ead ")[2])
    assert named
    assert [name for name in named if not [*home.rglob(f"{name}.py"), *home.glob(name)]] == []
