"""All that kaju is made of, parsed once for whoever looks at it."""

import ast
from functools import cache
from pathlib import Path

import kaju

HOME = Path(kaju.__file__).parent


@cache
def parsed():
    """Return the tree of every file, by its path below the package."""
    files = [path for path in HOME.rglob("*.py") if "__pycache__" not in path.parts]
    assert len(files) > 200
    return {path.relative_to(HOME): ast.parse(path.read_text(encoding="utf-8")) for path in files}
