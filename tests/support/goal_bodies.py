"""Bodies on which errors of displacement, and of what a tolerance is about, are tested."""

from plates import loaded

STEEL = {"material": "steel"}
GROUND = {"bottom": "rigid"}


def body(cells, *loads, size=(0.2, 0.2), **changes):
    """Equal cells, on rigid ground unless held otherwise."""
    return loaded(cells, *loads, size=list(size), **changes)


def on_top(start, end, force):
    return {"region": {"box": [[start, 0.2], [end, 0.2]]}, "force": force}


def plate(**changes):
    """The worked plate under 2 N over 10 mm of its top; changes of its body, or of the scene."""
    load = {"region": {"box": [[0.1, 0.2], [0.11, 0.2]]}, "force": [0.0, -2.0]}
    usual = {"size": [0.2, 0.2], "thickness": 2e-3, "loads": [load]}
    return loaded(changes.pop("cells", [20, 20]), **usual | changes)


def angle(plane="strain"):
    """An L of 0.8 m on its ground, dragged along its whole top."""
    load = {"region": {"box": [[0, 0.8], [0.4, 0.8]]}, "force": [100.0, 0.0]}
    return loaded("####....\n" * 4 + "########\n" * 4, load, cell_size=0.1, plane=plane)


def pierced(**changes):
    hole = {"material": "air", "disk": {"centre": [0.1, 0.1], "radius": 0.05}}
    return body([16, 16], {"side": "top", "pressure": 1e6}, regions=[hole], **changes)


def cantilever():
    load = {"side": "right", "force": [0.0, -100.0]}
    return body([64, 8], load, size=[0.4, 0.05], sides={"left": "rigid"})


def inclusion():
    soft = {"material": "soft", "box": [[0.05, 0.05], [0.15, 0.15]]}
    materials = {
        "hard": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
        "soft": {"youngs_modulus": 1e8, "poissons_ratio": 0.4},
    }
    changes = {"material": "hard", "materials": materials, "regions": [soft], "plane": "strain"}
    return body([16, 16], on_top(0.05, 0.1, [0.0, -100.0]), **changes)


def rubber():
    materials = {"rubber": {"youngs_modulus": 1e6, "poissons_ratio": 0.4999}}
    changes = {"material": "rubber", "materials": materials, "plane": "strain"}
    return body([16, 16], on_top(0.05, 0.1, [0.0, -100.0]), **changes)


def sheared():
    """Between walls, of which one moves."""
    moved = {"top": {"displacement": [1e-5, -1e-5]}}
    return body([16, 16], plane="strain", sides=GROUND | moved)


def cube():
    load = {"region": {"box": [[0.375, 0.375, 1], [0.625, 0.625, 1]]}, "force": [0, 0, -1.0]}
    return body([8] * 3, load, size=[1.0] * 3)


def beam():
    load = {"side": "right", "force": [0, 0, -1.0]}
    return body([16, 4, 4], load, size=[1.0, 0.25, 0.25], sides={"left": "rigid"})


FLAT = [plate, angle, pierced, cantilever, inclusion, rubber, sheared]
SOLID = [cube, beam]
