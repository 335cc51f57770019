"""Bodies on which errors of displacement, and of what a tolerance is about, are tested."""

from kaju import Scene

STEEL = {"material": "steel"}
GROUND = {"bottom": "rigid"}


def plate(**changes):
    """The worked plate under 2 N over 10 mm of its top; changes of its body, or of the scene."""
    load = {"region": {"box": [[0.1, 0.2], [0.11, 0.2]]}, "force": [0.0, -2.0]}
    body = {"size": [0.2, 0.2], "cells": [20, 20], "thickness": 2e-3, **STEEL}
    body |= {
        key: changes.pop(key) for key in changes.keys() & {"size", "cells", "regions", "plane"}
    }
    return Scene(**{"body": body, "sides": GROUND, "loads": [load]} | changes)


def angle():
    drawing = "####....\n" * 4 + "########\n" * 4
    return Scene(
        body={"cell_size": 0.1, "drawing": drawing, "plane": "strain"},
        legend={"#": "steel", ".": "air"},
        sides=GROUND,
        loads=[{"region": {"box": [[0, 0.8], [0.4, 0.8]]}, "force": [100.0, 0.0]}],
    )


def pierced():
    hole = {"material": "air", "disk": {"centre": [0.1, 0.1], "radius": 0.05}}
    body = {"size": [0.2, 0.2], "cells": [16, 16], "regions": [hole], **STEEL}
    return Scene(body=body, sides=GROUND, loads=[{"side": "top", "pressure": 1e6}])


def cantilever():
    body = {"size": [0.4, 0.05], "cells": [64, 8], **STEEL}
    return Scene(
        body=body, sides={"left": "rigid"}, loads=[{"side": "right", "force": [0.0, -100.0]}]
    )


def inclusion():
    soft = {"material": "soft", "box": [[0.05, 0.05], [0.15, 0.15]]}
    return Scene(
        body={
            "size": [0.2, 0.2], "cells": [16, 16], "plane": "strain", "regions": [soft],
            "material": "hard",
        },
        materials={
            "hard": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
            "soft": {"youngs_modulus": 1e8, "poissons_ratio": 0.4},
        },
        sides=GROUND,
        loads=[{"region": {"box": [[0.05, 0.2], [0.1, 0.2]]}, "force": [0.0, -100.0]}],
    )  # fmt: skip


def rubber():
    body = {"size": [0.2, 0.2], "cells": [16, 16], "plane": "strain", "material": "rubber"}
    return Scene(
        body=body,
        materials={"rubber": {"youngs_modulus": 1e6, "poissons_ratio": 0.4999}},
        sides=GROUND,
        loads=[{"region": {"box": [[0.05, 0.2], [0.1, 0.2]]}, "force": [0.0, -100.0]}],
    )


def sheared():
    """Between walls, of which one moves."""
    body = {"size": [0.2, 0.2], "cells": [16, 16], "plane": "strain", **STEEL}
    return Scene(body=body, sides={**GROUND, "top": {"displacement": [1e-5, -1e-5]}})


def cube():
    load = {"region": {"box": [[0.375, 0.375, 1], [0.625, 0.625, 1]]}, "force": [0, 0, -1.0]}
    return Scene(body={"size": [1.0] * 3, "cells": [8] * 3, **STEEL}, sides=GROUND, loads=[load])


def beam():
    body = {"size": [1.0, 0.25, 0.25], "cells": [16, 4, 4], **STEEL}
    return Scene(
        body=body, sides={"left": "rigid"}, loads=[{"side": "right", "force": [0, 0, -1.0]}]
    )


FLAT = [plate, angle, pierced, cantilever, inclusion, rubber, sheared]
SOLID = [cube, beam]
