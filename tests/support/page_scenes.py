"""Random scenes for the page: squares, hexagons and cubes, both ways to add up."""

import json
import zlib

import numpy as np

from kaju import Coefficients, KajuError, MaterialAgent, PrescribedRule, Scene
from kaju.view.page.data import scene_data

SIDES = {
    2: ["left", "right", "bottom", "top"],
    3: ["left", "right", "front", "back", "bottom", "top"],
}
LEGEND = {"0": "air", "1": "steel", "2": "rubber", "3": "rigid"}


def random_scenes(count, seed, kinds=("square", "square", "hexagon", "cube"), **fixed):
    """Return pairs of a scene and a stage of its loading; the same for the same seed."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        scene = _scene(rng, kinds[len(found) % len(kinds)], fixed)
        if scene is not None:
            found.append((scene, int(rng.integers(1, scene.stages + 1))))
    return found


def _scene(rng, kind, fixed):
    shape = tuple(rng.integers(2, 7, 3)) if kind == "cube" else tuple(rng.integers(3, 16, 2))
    array = rng.choice(4, size=shape, p=[0.1, 0.62, 0.22, 0.06])
    solid = np.argwhere((array == 1) | (array == 2))
    if not len(solid):
        return None
    held = rng.choice(["free", "rigid", "roller"], size=2 * len(shape))
    body = {"array": array, "cell_size": 0.01, "allow_floating": True}
    if len(shape) == 2:
        body |= {"thickness": 0.002, "lattice": kind}
    try:
        return Scene(
            body=body,
            legend=LEGEND,
            sides=dict(zip(SIDES[len(shape)], map(str, held), strict=True)),
            loads=[_load(rng, solid) for _ in range(3)],
            rule=_rule(rng, len(shape), fixed),
        )
    except KajuError:
        return None


def _load(rng, solid):
    force = rng.normal(size=solid.shape[1]) * np.where(rng.random(solid.shape[1]) < 0.3, 0, 3)
    force[0] = force[0] if force.any() else 1.5
    cell = solid[rng.integers(len(solid))]
    said = rng.choice(["push", "pull", "", ""])
    load = {"cell": cell.tolist(), "force": force.tolist(), "steps": int(rng.integers(1, 6))}
    return load | ({"sense": str(said)} if said else {})


def _coefficients(rng, dimension):
    kept, ahead, beside = rng.random(3)
    room = (1.05 - 0.6 * ahead) / (2 * (dimension - 1))
    alpha = (0.2 + 0.5 * kept, 0.6 * ahead, 0.6 * beside * room)
    return {"alpha": tuple(map(float, alpha)), "beta": float(rng.random())}


def _rule(rng, dimension, fixed):
    own = {"rubber": Coefficients(**_coefficients(rng, dimension))} if rng.random() < 0.5 else {}
    settings = {
        "threshold": float(10 ** rng.uniform(-3.5, -1.0)),
        "accumulate": bool(rng.random() < 0.5),
        "sense": bool(rng.random() < 0.5),
        "materials": own,
    }
    return PrescribedRule(**_coefficients(rng, dimension), **settings | fixed)


def described(scene, **others):
    """Return what a script is given of a scene."""
    data, columns = scene_data(scene)
    return {"scene": data, "cells": columns["cells"].ravel().tolist()} | others


def header_of(packed):
    """What the data of a page say before their columns."""
    raw = zlib.decompress(packed)
    return json.loads(raw[4 : 4 + int.from_bytes(raw[:4], "little")])


class Leaky(MaterialAgent):
    """Passes nothing sideways: not the rule's own agent."""

    def pass_on(self, load):
        ahead = load._replace(magnitude=0.8 * load.magnitude)
        if ahead.magnitude > self.model.threshold:
            self.model.hand_over(self, load.direction, ahead)
