"""The body that most tests press on."""

from kaju import Scene

PLATE = {
    "body": {"size": [0.2, 0.2], "cells": [20, 20], "thickness": 0.002, "material": "steel"},
    "sides": {"bottom": "rigid"},
    "loads": [{"cell": [10, 19], "force": [0.0, -2.0]}],
}
"""The worked plate, as keywords of a scene."""

PLATE_TEXT = """
[body]
size = [0.2, 0.2]
cells = [20, 20]
material = "steel"
[sides]
bottom = "rigid"
[[loads]]
cell = [10, 19]
force = [0.0, -2.0]
"""
LEGEND = {"#": "steel", "a": "steel", "b": "rubber", ".": "air", "=": "rigid"}
_OF_THE_BODY = {"size", "cell_size", "thickness", "plane", "lattice", "regions", "allow_floating"}
_OF_THE_BODY |= {"material", "gravity"}


def loaded(cells, *loads, **changes):
    """Equal cells on rigid ground under any loads, 10 mm wide unless told; a text is a drawing."""
    drawing = {"body": {"drawing": cells}, "legend": LEGEND}
    parts = drawing if isinstance(cells, str) else {"body": {"cells": cells, "material": "steel"}}
    parts["body"] |= {key: changes.pop(key) for key in _OF_THE_BODY & changes.keys()}
    if "size" not in parts["body"]:
        parts["body"].setdefault("cell_size", 0.01)
    return Scene(**parts | {"sides": {"bottom": "rigid"}, "loads": list(loads)} | changes)


def plate(cells, cell, force=(0.0, -2.0), *, steps=1, side=None, **changes):
    """Equal cells on rigid ground, 10 mm wide unless told, and a force on one of them."""
    load = {"cell": cell, "force": force, "steps": steps} | ({} if side is None else {"side": side})
    return loaded(cells, load, **changes)
