"""Linear elasticity in the page is `kaju.solve` in JavaScript."""

import numpy as np
from page_scenes import SIDES, described
from plates import plate as pressed
from spawning_bodies import drawn, laws

import kaju
from kaju.errors import SceneError

ANSWER = """
import { elasticAnswer } from "./elastic.js";
const rounded = (field) => Array.from(field, (v) => (Number.isNaN(v) ? null : v));
tell(data.map(({ scene, cells }) => {
  try {
    const a = elasticAnswer(scene, Int8Array.from(cells), scene.loads);
    return { displacement: a.displacement.map(rounded), stress: a.stress.map(rounded),
      subdivision: a.subdivision, iterations: a.iterations };
  } catch (error) { return { error: error.message }; }
}));
"""
MATERIALS = laws((2e11, 0.3), (3e8, 0.45), (5e7, -0.2))


def random_scene(rng):
    shape = tuple(int(n) for n in rng.integers(3, 26, 2))
    kinds = rng.choice([0, 1, 2, 3, 4], size=shape, p=[0.06, 0.6, 0.2, 0.1, 0.04])
    if rng.random() < 0.4:  # blocks, so that some bodies have wide walls
        coarse = rng.choice(
            [0, 1, 2, 4], size=[-(-n // 3) for n in shape], p=[0.12, 0.6, 0.23, 0.05]
        )
        kinds = np.kron(coarse, np.ones((3, 3), int))[: shape[0], : shape[1]]
    if rng.random() < 0.3:
        kinds[:] = 1
    sides = {}
    for name in SIDES[2]:
        choice = rng.random()
        sides[name] = "free"
        if choice < 0.15:
            sides[name] = "roller"
        elif choice < 0.3:
            sides[name] = {"stiffness": float(10.0 ** rng.uniform(9, 13))}
        elif choice < 0.4:
            moved = (1e-6 * rng.normal(size=2)).tolist()
            if choice < 0.35:
                moved[int(name in ("left", "right"))] = "free"
            sides[name] = {"displacement": moved}
        elif choice < 0.5:
            sides[name] = "rigid"
    if rng.random() < 0.8:
        sides[str(rng.choice(["bottom", "left"]))] = "rigid"
    solid = np.argwhere((kinds > 0) & (kinds < 4))
    loads = []
    for cell in solid[rng.choice(len(solid), min(4, len(solid)), replace=False)].tolist():
        force = (rng.normal(size=2) * rng.choice([0.0, 1.0, 100.0], size=2)).tolist()
        load = {"cell": cell, "force": force}
        if rng.random() < 0.8:
            load["side"] = str(rng.choice(SIDES[2]))
        if any(force):
            loads.append(load)
    of = {"plane": str(rng.choice(["stress", "strain"])), "sides": sides}
    return drawn(kinds, MATERIALS, loads, thickness=0.003, allow_floating=True, **of)


def scenes(seed, count):
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        try:
            found.append(random_scene(rng))
        except SceneError:
            continue  # a load on a side of a cell that is no surface
    return found


def compare(scene, answer, within):
    result = kaju.solve(scene)
    assert answer.get("error") is None, answer
    k = result.subdivision
    assert answer["subdivision"] == k
    rim = tuple(n + 2 for n in scene.lattice.shape)
    lower = np.array(result.cells().origin) // k

    def expected(field):
        whole = np.full([k * n for n in rim], np.nan)
        start = np.array(result.cells().origin) + k
        whole[tuple(slice(a, a + n) for a, n in zip(start, field.shape, strict=True))] = field
        return whole.reshape(rim[0], k, rim[1], k).mean(axis=(1, 3))

    assert (lower >= 0).all()
    truth = [expected(result.cells().displacement[..., a]) for a in range(2)]
    stress = [expected(result.cells().stress[..., a, b]) for a, b in ((0, 0), (1, 1), (0, 1))]
    for wanted, given in ((truth, answer["displacement"]), (stress, answer["stress"])):
        scale = max(np.nanmax(np.abs(field)) for field in wanted)
        for field, column in zip(wanted, given, strict=True):
            own = np.array(column, dtype=float).reshape(rim)
            np.testing.assert_array_equal(np.isnan(own), np.isnan(field))
            np.testing.assert_allclose(own, field, rtol=0.0, atol=within * scale)


def test_random_bodies_move_and_bear_as_kaju_says(node):
    """What kaju solves, and what it refuses the page refuses too."""
    given = scenes(7, 34)
    answers = node(ANSWER, [described(scene) for scene in given])
    solved = refused = 0
    for scene, answer in zip(given, answers, strict=True):
        try:
            compare(scene, answer, within=1e-9)
            solved += 1
        except SceneError:
            assert answer.get("error"), "kaju refuses this body"
            refused += 1
    assert solved >= 30
    assert refused >= 1


def plate(cells, **changes):
    body = {"size": [0.2, 0.2], "thickness": 0.002}
    return pressed([cells] * 2, [cells // 2, cells - 1], [0.3, -2.0], side="top", **body | changes)


def test_large_and_nearly_incompressible_bodies_agree(node):
    gum = {"youngs_modulus": 1e6, "poissons_ratio": 0.49}
    given = [plate(90), plate(40, material="gum", plane="strain", materials={"gum": gum})]
    for scene, answer in zip(given, node(ANSWER, list(map(described, given))), strict=True):
        compare(scene, answer, within=1e-9)


def test_a_body_held_by_nothing_is_refused_in_words(node):
    loose = plate(6, sides={"left": "roller", "right": "roller"})
    others = [kaju.load_scene(f"examples/{name}.toml") for name in ("honeycomb", "cube")]
    refused = node(ANSWER, [described(scene) for scene in (loose, *others)])
    for answer, word in zip(refused, ("held by nothing", "squares", "squares"), strict=True):
        assert word in answer["error"]
