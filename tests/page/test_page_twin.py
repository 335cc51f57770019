"""The rule in the page and kaju's are two tellings of one story."""

import numpy as np
import pytest
from page_scenes import described, random_scenes

from kaju import LoadModel, stability

RUN = """
import { Twin, certifying } from "./rule.js";
import { deformation } from "./deformation.js";
import { Sums } from "./history.js";
const last = (steps) => { let one; do one = steps.next(); while (!one.done); return one.value; };
tell(data.map(({ scene, cells, stage }) => {
  const t = new Twin(scene, cells, stage).run(40), { lattice: L, C } = t;
  const at = (log, size) => new Sums(log, size).to(1e9);
  const taken = at(t.taken, L.size * C), moved = deformation(t, taken);
  const keys = []; t.spawn.forEach((s, k) => { if (s && s <= t.generation) keys.push(k); });
  const pick = (a, n) => keys.flatMap((k) => Array.from(a.subarray(k * n, (k + 1) * n)));
  const given = at(t.given, L.size), walls = [];
  given.forEach((x, k) => { if (x) walls.push([k, x]); });
  const rows = [];
  const { offset, index, value } = t.taken;
  for (let g = 0; g < t.generation; g++) for (let i = offset[g]; i < offset[g + 1]; i++)
    rows.push([g + 1, index[i], value[i]]);
  const dropped = at(t.dropped, L.size);
  return { generations: t.generation, keys, spawn: pick(t.spawn, 1), woken: pick(t.woken, 1),
    taken: pick(taken, C), passed: pick(at(t.passed, L.size * L.D), L.D), dropped: pick(dropped, 1),
    walls, rows, pending: t.pending, quiet: t.quiet, ends: t.ended.at(-1) ?? 0,
    displacement: moved.displacement.map((u) => pick(u, 1)),
    pressure: moved.pressure.map((p) => pick(p, 1)),
    alive: t.alive.at(-1) ?? 0, certificate: last(certifying(scene, cells)) };
}));
"""


def at_stage(scene, stage):
    """Run one stage only, stopped as the twin is."""
    model = LoadModel(scene, engine="arrays", allow_unstable=True, max_generations=40)
    model.course._begin_stage(stage)
    while not model.outcome:
        model.step()
    return model.result()


@pytest.fixture(scope="module", params=[40, pytest.param(300, marks=pytest.mark.slow)])
def pairs(node, request):
    scenes = random_scenes(request.param, seed=7)
    mine = node(RUN, [described(scene, stage=stage) for scene, stage in scenes])
    results = [at_stage(scene, stage) for scene, stage in scenes]
    return list(zip(results, mine, strict=True))


def test_the_twin_makes_the_same_agents_take_the_same_loads(pairs):
    for result, twin in pairs:
        scene = result.scene
        last, lattice = result.last, scene.lattice
        key = lattice.key(last.cells)
        order = np.argsort(key)
        assert twin["generations"] == last.generations
        assert twin["keys"] == key[order].tolist()
        assert twin["spawn"] == last.spawn_step[order].tolist()
        assert twin["woken"] == last.woken_by[order].tolist()
        assert twin["alive"] == len(key)
        scale = last.taken.max(initial=1e-300)
        pushed, pulled = last.taken - last.pulled, last.pulled
        taken = np.hstack([pushed, pulled]) if scene.rule.sense else pushed
        for name, values in [("taken", taken), ("passed", last.passed), ("dropped", last.dropped)]:
            expected = values[order].ravel()
            np.testing.assert_allclose(twin[name], expected, rtol=0, atol=1e-12 * scale)
        ledger = last.ledger
        assert twin["pending"] == pytest.approx(ledger.pending, rel=1e-12, abs=1e-12 * scale)
        assert twin["quiet"] == pytest.approx(ledger.dropped, rel=1e-11, abs=1e-12 * scale)

        walls = lattice.key(last.boundary_cells)
        by_key = np.argsort(walls)
        assert [wall for wall, _ in twin["walls"]] == walls[by_key].tolist()
        given = [load for _, load in twin["walls"]]
        np.testing.assert_allclose(given, last.returned[by_key], rtol=1e-12)

        history = last.history
        channel = history.direction + lattice.directions * history.pull
        state = key[history.agent] * taken.shape[1] + channel
        rows = np.lexsort((state, history.generation))
        expected = np.stack([history.generation[rows], state[rows]], axis=1).tolist()
        assert [row[:2] for row in twin["rows"]] == expected
        np.testing.assert_allclose(
            [row[2] for row in twin["rows"]], history.load[rows], rtol=0, atol=1e-12 * scale
        )


def test_the_twin_deforms_as_kaju_does(pairs):
    for result, twin in pairs:
        scene = result.scene
        order = np.argsort(scene.lattice.key(result.last.cells))
        moved = result.displacement[order]
        scale = np.abs(moved).max(initial=1e-300)
        np.testing.assert_allclose(np.transpose(twin["displacement"]), moved, atol=1e-12 * scale)
        if scene.lattice.kind == "hexagon":
            continue
        stress = np.einsum("nii->ni", result.stress)[order]
        scale = np.abs(stress).max(initial=1e-300)
        np.testing.assert_allclose(-np.transpose(twin["pressure"]), stress, atol=1e-12 * scale)


def test_the_certificate_is_that_of_stability(pairs):
    for result, twin in pairs:
        mine, theirs = twin["certificate"], stability(result.scene)
        assert mine["stable"] is theirs.stable
        assert mine["generations"] == theirs.generations
        assert mine["lower"] == pytest.approx(theirs.lower, rel=1e-7)
        assert mine["upper"] == pytest.approx(theirs.upper, rel=1e-7)
        assert mine["largest"] == pytest.approx(theirs.largest_share, rel=1e-15)
