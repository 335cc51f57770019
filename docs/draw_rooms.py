"""Draw the rooms of the house, their sizes, and who imports whom, for architecture.md.

An arrow that others imply is left out; a dashed one leads upwards. A test holds the drawing to the
imports.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from html import escape
from pathlib import Path

import networkx as nx

ROOT = Path(__file__).parents[1]
DRAWING = ROOT / "docs" / "pictures" / "rooms.svg"
HOMES = {"agents": "agents", "model": "model", "view": "view", "cli": "cli", "": "src/kaju"}
ORDER = (
    *("ground", "agents", "model", "scene", "results", "network", "transfer", "elastic"),
    *("outline", "solid", "rheology", "growth", "fracture", "scale", "study", "view"),
    *("page", "cli"),
)
"""From the ground to the roof: an arrow that leads upwards is dashed."""


def files() -> Iterator[tuple[str, Path]]:
    """Yield the modules of kaju by their names, and where they are."""
    for package, home in HOMES.items():
        for path in sorted((ROOT / home).rglob("*.py")):
            parts = [*([package] if package else []), *path.relative_to(ROOT / home).parts]
            yield ".".join(["kaju", *parts])[:-3].removesuffix(".__init__"), path


def room_of(module: str) -> str:
    """Return the room that a module is in: the last folder that the drawing names."""
    parts = [*module.split(".")[1:], "", ""]
    if parts[0] == "model":
        return parts[1] if (ROOT / "model" / parts[1]).is_dir() and parts[1] else "model"
    if parts[:2] == ["view", "page"]:
        return "page"
    return parts[0] if parts[0] and parts[0] in HOMES else "ground"


def imports(module: str, path: Path, known: set[str]) -> Iterator[str]:
    """Yield the modules of kaju that a module imports, in functions as well."""
    package = module.split(".")[: None if path.name == "__init__.py" else -1]
    nodes = [ast.parse(path.read_text(encoding="utf-8"))]
    while nodes:
        node = nodes.pop()
        for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        nodes += [] if for_types else ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            home = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                name = f"{home}.{alias.name}"
                if (found := name if name in known else home) in known:
                    yield found


def graph() -> nx.DiGraph:
    """Return who imports whom, files by their modules' names; `kaju` itself names all."""
    modules = dict(files())
    found = nx.DiGraph()
    for module, path in modules.items():
        found.add_node(module, lines=len(path.read_text(encoding="utf-8").splitlines()))
        found.add_edges_from((module, other) for other in imports(module, path, set(modules)))
    found.remove_nodes_from(["kaju", "kaju.__main__"])
    return found


def rooms() -> nx.DiGraph:
    """Return the rooms with their lines, and which of them imports which."""
    found, modules, lines = nx.DiGraph(), graph(), Counter[str]()
    for module, count in modules.nodes(data="lines"):
        lines[room_of(module)] += count
    found.add_nodes_from((room, {"lines": count}) for room, count in lines.items())
    pairs = {(room_of(one), room_of(other)) for one, other in modules.edges}
    found.add_edges_from((one, other) for one, other in pairs if one != other)
    return found


def upwards(whole: nx.DiGraph) -> list[tuple[str, str]]:
    """Return the arrows that lead upwards."""
    return sorted((a, b) for a, b in whole.edges if ORDER.index(a) < ORDER.index(b))


def drawn(whole: nx.DiGraph) -> nx.DiGraph:
    """Return the arrows that lead downwards; those that others imply are left out."""
    down = whole.copy()
    down.remove_edges_from(upwards(whole))
    return nx.transitive_reduction(down)


def svg(whole: nx.DiGraph) -> str:
    """Return the drawing: what imports is above what it imports."""
    arrows = drawn(whole)
    rows = list(nx.topological_generations(arrows.reverse()))
    place, parts = {}, []
    width, step = 150 * max(map(len, rows)), 78
    for height, row in enumerate(rows):
        names = sorted(row, key=lambda room: (-whole.nodes[room]["lines"], room))
        for number, room in enumerate(names):
            x = width * (number + 0.5) / len(names)
            place[room] = x, step * (len(rows) - height) - 44
    for one, other in [*sorted(arrows.edges), *upwards(whole)]:
        (x, y), (u, v) = place[one], place[other]
        side, dash = (17, "") if v > y else (-17, ' stroke-dasharray="4 3"')
        parts.append(
            f'<path id="{one}-{other}" d="M{x:.0f} {y + side:.0f}L{u:.0f} {v - side:.0f}" '
            f'stroke="#777" marker-end="url(#tip)"{dash}/>'
        )
    for room, (x, y) in sorted(place.items()):
        lines = round(whole.nodes[room]["lines"], -2)
        size = 44 + 0.55 * lines**0.5
        name = "src/kaju" if room == "ground" else room
        parts.append(
            f'<rect x="{x - size:.0f}" y="{y - 17:.0f}" width="{2 * size:.0f}" height="34" rx="5" '
            f'fill="#eef3f8" stroke="#345"/><text id="{room}" x="{x:.0f}" y="{y - 2:.0f}">'
            f'{escape(name)}</text><text x="{x:.0f}" y="{y + 11:.0f}" class="lines">'
            f"{lines:,} lines</text>"
        )
    style = "text{font:13px sans-serif;text-anchor:middle}.lines{font-size:10px;fill:#555}"
    tip = (
        '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0L8 4L0 8z" fill="#777"/></marker>'
    )
    box = f'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {step * len(rows)}"'
    head = f"<svg {box}><style>{style}</style><defs>{tip}</defs>"
    return "\n".join([head, *parts, "</svg>", ""])


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    DRAWING.write_text(svg(rooms()), encoding="utf-8")
    print(DRAWING)
