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
_OF_THE_BODY = {"size", "cell_size", "thickness", "plane", "lattice", "regions", "allow_floating"}


def plate(cells, cell, force=(0.0, -2.0), *, steps=1, side=None, material="steel", **changes):
    """Equal cells on rigid ground, 10 mm wide unless told, and a force on one of them."""
    body = {"cells": cells, "material": material}
    body |= {key: changes.pop(key) for key in _OF_THE_BODY & changes.keys()}
    if "size" not in body:
        body.setdefault("cell_size", 0.01)
    load = {"cell": cell, "force": force, "steps": steps} | ({} if side is None else {"side": side})
    return Scene(**{"body": body, "sides": {"bottom": "rigid"}, "loads": [load]} | changes)
