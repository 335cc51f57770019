"""Agents take every scene that equal cells take, and bound its energy."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st
from PIL import Image
from spawning_bodies import STEEL, drawn

from kaju import Scene, SpawningModel, solve
from kaju.errors import SceneError, SupportError

SOME_ARE_LOOSE = [HealthCheck.filter_too_much, HealthCheck.too_slow]
LETTERS, COLOURS = ".ab=", [(255, 255, 255), (255, 0, 0), (0, 0, 255), (0, 0, 0)]
FILLING = ("air", "a", "b", "rigid")


def box(rng, extent):
    lower = rng.random(len(extent)) * 0.7
    upper = np.minimum(lower + 0.1 + 0.4 * rng.random(len(extent)), 1.0)
    return [(lower * extent).tolist(), (upper * extent).tolist()]


def body(rng, shape, folder):
    """A body given in any of the ways there are, and what its letters and colours mean."""
    codes = rng.choice(4, p=[0.1, 0.5, 0.35, 0.05], size=[(n + 1) // 2 for n in shape])
    for axis in range(len(shape)):
        codes = codes.repeat(2, axis=axis)
    way = rng.integers(4 if len(shape) == 2 else 2)
    if way == 0:
        return {"array": codes}, {str(i): name for i, name in enumerate(FILLING)}
    if way == 1:
        return {"cells": list(codes.shape), "material": "a"}, {}
    rows = codes.T[::-1]
    if way == 2:
        drawing = "\n".join("".join(LETTERS[code] for code in row) for row in rows)
        return {"drawing": drawing}, dict(zip(LETTERS, FILLING, strict=True))
    path = folder / "body.png"
    Image.fromarray(np.array(COLOURS, dtype=np.uint8)[rows]).save(path)
    names = ["#{:02x}{:02x}{:02x}".format(*colour) for colour in COLOURS]
    return {"image": str(path)}, dict(zip(names, FILLING, strict=True))


def sides(rng, names):
    """The bottom held in some way, other sides now and then."""
    walls = ["rigid", "roller", {"stiffness": 1e9}]
    walls.append({"displacement": (1e-4 * rng.normal(size=len(names) // 2)).tolist()})
    held = {name: walls[rng.integers(4)] for name in names if rng.random() < 0.2}
    return held | {"bottom": walls[rng.choice([0, 2, 3])]}


def loads(rng, shape, extent, names):
    d = len(shape)
    found = []
    for _ in range(3):
        force = (1e3 * rng.normal(size=d)).tolist()
        flat, axis = box(rng, extent), int(rng.integers(d))
        flat[0][axis] = flat[1][axis] = float(rng.integers(shape[axis] + 1)) * extent[0] / shape[0]
        places = [
            {"cell": [int(rng.integers(n)) for n in shape], "force": force},
            {"point": (rng.random(d) * extent).tolist(), "force": force},
            {"region": {"box": box(rng, extent)}, "force": force},
            {"region": {"box": flat}, "pressure": 1e4},
            {"side": names[rng.integers(2 * d)], "force": force},
        ]
        found.append(places[rng.integers(5)] | {"steps": int(rng.integers(1, 4))})
    return found


def region(rng, extent):
    round_one = {"centre": (rng.random(len(extent)) * extent).tolist(), "radius": 0.3 * extent[0]}
    shapes = [{"box": box(rng, extent)}, {"disk" if len(extent) == 2 else "ball": round_one}]
    if len(extent) == 2:
        shapes.append({"polygon": (rng.random((3, 2)) * extent).tolist()})
    return {"material": str(rng.choice(FILLING[:3]))} | shapes[rng.integers(len(shapes))]


@st.composite
def scenes(draw, folder):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    for _ in range(30):
        try:
            return random_scene(rng, folder)
        except (SceneError, SupportError):
            continue
    return reject()


def random_scene(rng, folder):
    d = 2
    names = ["left", "right", "bottom", "top"] if d == 2 else ["left", "right", "front", "back"]
    names += [] if d == 2 else ["bottom", "top"]
    described, legend = body(rng, rng.integers(3, 13 if d == 2 else 7, size=d), folder)
    described |= {"cell_size": float(10.0 ** rng.uniform(-3, 0))}
    if d == 2:
        described |= {"plane": ["stress", "strain"][rng.integers(2)], "thickness": 0.01}
    if rng.random() < 0.5:
        described |= {"gravity": [0.0] * (d - 1) + [-9.81]}
    ratios = [0.3, float(rng.choice([0.3, -0.2, 0.0, 0.49, 0.4999]))]
    stiff = [1e9, float(10.0 ** rng.uniform(7, 11))]
    materials = {
        name: {"youngs_modulus": e, "poissons_ratio": v, "density": 1e3}
        for name, e, v in zip("ab", stiff, ratios, strict=True)
    }
    how = {"legend": legend, "materials": materials, "sides": sides(rng, names)}
    scene = Scene(body=described, **how)
    extent = np.array(scene.lattice.extent)
    with_region = scene.replace(body=dict(scene.body) | {"regions": [region(rng, extent)]})
    return with_region.replace(loads=loads(rng, scene.lattice.shape, extent, names))


def check_same(scene, stage):
    """Bounds of few agents and of more hold one energy; supports bear the loads."""
    try:
        runs = [SpawningModel(scene, t, stage=stage, most_agents=2_000) for t in (0.2, 0.05)]
        coarse, fine = (model.run() for model in runs)
    except (SceneError, SupportError):
        reject()
    (low, high), (lower, upper) = coarse.energy_bounds, fine.energy_bounds
    assert max(low, lower) <= min(high, upper) * (1 + 1e-9)
    (check,) = fine.checks()
    assert check.off < 1e-7


@settings(max_examples=20, suppress_health_check=SOME_ARE_LOOSE)
@given(st.data())
def test_scene_of_any_kind_is_solved_alike(tmp_path_factory, data):
    scene = data.draw(scenes(tmp_path_factory.mktemp("body")))
    check_same(scene, data.draw(st.integers(1, scene.stages)))


@pytest.mark.slow
@settings(max_examples=400, suppress_health_check=SOME_ARE_LOOSE)
@given(st.data())
def test_four_hundred_scenes_are_solved_alike(tmp_path_factory, data):
    scene = data.draw(scenes(tmp_path_factory.mktemp("body")))
    check_same(scene, data.draw(st.integers(1, scene.stages)))


def pinned(cells):
    """A plate held by a square of rigid cells in its middle, with a force at its end."""
    hold = {"material": "rigid", "box": [[1.0, 1.0], [1.0 + cells, 1.0 + cells]]}
    return Scene(
        body={"cells": [4, 4], "cell_size": 1.0, "material": "steel", "regions": [hold]},
        loads=[{"cell": [3, 3], "side": "top", "force": [0.0, -1.0]}],
    )


def test_single_rigid_cell_is_a_pin_until_the_cells_beside_are_halved():
    alone = solve(pinned(1))
    assert any("single rigid cell" in note for note in alone.summary()["notes"])
    for result in (alone, solve(pinned(1), tolerance=0.1)):
        np.testing.assert_allclose(result.reactions["rigid"], [0.0, 1.0], atol=1e-9)
    assert solve(pinned(2)).reactions["rigid"][1] == pytest.approx(1.0)


def test_cells_held_all_round_are_no_loose_part():
    """A part of which supports leave no face free but those between its own cells."""
    load = {"cell": [2, 0], "side": "bottom", "force": [0.0, 1.0]}
    rows = ["=====", "=aa==", "=====", ".aaa."]
    scene = drawn(rows, [STEEL], [load], sides={}, cell_size=0.1)
    result = solve(scene, tolerance=0.2)
    np.testing.assert_allclose(result.reactions["rigid"], [0.0, -1.0], atol=1e-9)
