"""Growth in the page is `kaju.GrowthModel` in JavaScript."""

import numpy as np
import pytest
from page_scenes import described
from plates import plate

import kaju

GROW = """
import { grown } from "./growing.js";
tell(data.map(({ scene, cells }) => {
  try {
    return Array.from(grown(scene, Int16Array.from(cells), scene.loads),
      (step) => ({ ...step, density: Array.from(step.density) }));
  } catch (error) { return { error: error.message }; }
}));
"""
TIME = """
import { grown } from "./growing.js";
const { scene, cells } = data, spent = [];
let before = process.cpuUsage();
for (const _ of grown(scene, Int16Array.from(cells), scene.loads)) {
  const { user, system } = process.cpuUsage(before);
  spent.push((user + system) / 1e3);
  before = process.cpuUsage();
}
tell(spent);
"""


def growing(scene, rule="compliance", **growth):
    told = described(scene)
    usual = {"rule": rule, "volume": 0.4, "radius": 1.8, "steps": 12, "at_rest": 0.0}
    told["scene"]["growth"] = usual | {"tolerance": 1e-10} | growth
    return told


def model(told, scene):
    growth = dict(told["scene"]["growth"])
    radius, steps = growth.pop("radius"), growth.pop("steps")
    return kaju.GrowthModel(scene, filter_radius=radius, most_steps=steps, **growth)


def bridge(nx=20, ny=9):
    """Of two materials with a hole, on a rigid and on a sliding abutment, loaded in two places."""
    kinds = np.ones((nx, ny), dtype=int)
    kinds[nx // 2 : nx // 2 + 3, 3:5] = 0
    kinds[: nx // 3, ny // 2 :] = 2
    kinds[:, 0] = 0
    kinds[:3, 0], kinds[-3:, 0] = 3, 4
    return kaju.Scene(
        body={"array": kinds, "cell_size": 0.05, "thickness": 0.02},
        legend={"0": "air", "1": "steel", "2": "brass", "3": "rigid", "4": "roller"},
        materials={"brass": {"youngs_modulus": 1e11, "poissons_ratio": 0.35}},
        loads=[
            {"cell": [nx // 2, ny - 1], "force": [30.0, -100.0]},
            {"cell": [3, 5], "force": [0.0, -50.0], "side": "left"},
        ],
    )


def clamped(**changes):
    usual = {"sides": {"left": "rigid"}, "plane": "strain"}
    return plate([16, 10], [15, 4], [0.0, -1.0], **usual | changes)


@pytest.mark.parametrize("scene", [bridge(), clamped()], ids=["bridge", "clamped"])
@pytest.mark.parametrize("rule", ["compliance", "remodelling"])
def test_every_step_is_that_of_kaju(node, scene, rule):
    told = growing(scene, rule, steps=12 if rule == "compliance" else 60)
    (steps,) = node(GROW, [told])
    result = model(told, scene).run()
    assert [step["outcome"] for step in steps] == [""] * result.steps + ["end"]
    np.testing.assert_allclose([s["compliance"] for s in steps], result.compliances, rtol=1e-6)
    np.testing.assert_allclose([s["volume"] for s in steps], result.volumes, rtol=1e-6)
    np.testing.assert_allclose([s["change"] for s in steps], result.changes, atol=1e-5)
    np.testing.assert_allclose([s["density"] for s in steps], result.designs, atol=1e-5)


def test_both_come_to_rest_at_the_same_step(node):
    told = growing(clamped(), at_rest=0.05, steps=100)
    (steps,) = node(GROW, [told])
    result = model(told, clamped()).run()
    assert result.outcome.startswith("at rest")
    assert len(steps) == result.steps + 1
    assert steps[-1]["outcome"] == "rest"


def test_loose_equations_lose_hardly_any_compliance(node):
    told = [growing(clamped(), tolerance=t) for t in (1e-2, 1e-10)]
    loose, tight = (steps[-1]["compliance"] for steps in node(GROW, told))
    assert loose == pytest.approx(tight, rel=1e-3)


def test_what_cannot_grow_is_refused_in_words(node):
    moved = clamped(sides={"left": "rigid", "right": {"displacement": [1e-6, 0.0]}}, loads=[])
    scenes = [clamped(loads=[]), moved, clamped(sides={"left": "roller"})]
    refused = [steps["error"] for steps in node(GROW, [growing(scene) for scene in scenes])]
    assert ["without a load" in refused[0], "moved" in refused[1] or "load" in refused[1]] == [1, 1]
    assert "held by nothing" in refused[2]


@pytest.mark.slow
def test_a_step_of_2400_cells_takes_less_than_40_ms(node):
    scene = plate([60, 40], [59, 20], [0.0, -1.0], sides={"left": "rigid"})
    spent = node(TIME, growing(scene, steps=40, tolerance=1e-2))
    assert np.mean(spent[1:]) < 40.0
