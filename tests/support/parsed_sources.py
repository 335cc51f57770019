"""All that kaju is made of, parsed once for whoever looks at it."""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path

import kaju

HOME = Path(kaju.__file__).parent


@cache
def parsed():
    """Return the tree of every file, by its path below the package."""
    rooms = {"": HOME} | {
        room: Path(import_module(f"kaju.{room}").__file__).parent
        for room in ("agents", "model", "view", "cli")
    }
    files = {
        Path(room, path.relative_to(home)): path
        for room, home in rooms.items()
        for path in home.rglob("*.py")
        if "__pycache__" not in path.parts
    }
    assert len(files) > 200
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in files.items()}
