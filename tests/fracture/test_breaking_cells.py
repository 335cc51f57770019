"""Bodies that break cell by cell, and the verb for it."""

import json

import numpy as np
import pytest
from artists import axes_of, drawn

import kaju
from kaju.model.fracture import breaking_bodies


def plate(cells=(12, 12), moved=False, notch=3, **body):
    """Return a plate of 1 m with a notch of some cells from the left, pulled up by its top."""
    size = 1.0 / cells[1]
    scene = kaju.Scene(
        body={"cells": list(cells), "cell_size": size, "material": "steel", **body},
        sides={"bottom": "rigid", **({"top": {"displacement": [0.0, 1e-4]}} if moved else {})},
        loads=[] if moved else [{"side": "top", "force": [0.0, 1e6]}],
    )
    middle = cells[1] // 2
    box = [[0.0, middle * size], [notch * size, (middle + 2) * size]]
    return scene.with_region(box=box) if notch else scene


@pytest.mark.parametrize("moved", [False, True])
def test_what_cells_bear_is_what_solve_says(moved):
    scene = plate(moved=moved)
    broken = kaju.FractureModel(scene, strength=1e8, scatter=0.0).run(1)
    truth = kaju.solve(scene, resolution=1)
    stress = truth.cells(resolution=1).stress[scene.rasterise() >= 0]
    largest = np.linalg.eigvalsh(stress)[:, -1]
    assert broken.load_factor[0] == pytest.approx(1e8 / largest.max(), rel=1e-9)
    assert largest[broken.broken[0]] == pytest.approx(largest.max(), rel=1e-9)
    unbroken = next(broken.replayed([0]))
    assert unbroken.stored == pytest.approx(truth.strain_energy, rel=1e-9)
    np.testing.assert_allclose(unbroken.borne(), largest, rtol=1e-7, atol=1e-9 * largest.max())


def test_every_break_is_what_the_body_left_says():
    broken = kaju.FractureModel(plate(), strength=1e8, scatter=0.4, seed=2).run()
    counts = [0, 1, 4, broken.breaks_resisted]
    for count, body in zip(counts, broken.replayed(counts), strict=True):
        left = broken.state(count)
        assert body.stored == pytest.approx(left.strain_energy, rel=1e-6)
        factor = broken.factor_after(count)
        if count:
            assert factor**2 * body.stored == pytest.approx(broken.stored[count - 1], rel=1e-9)
        share = body.borne() / broken.strengths
        assert np.argmax(share) == broken.broken[count]
        assert 1.0 / share.max() == pytest.approx(broken.load_factor[count], rel=1e-9)
    assert len(drawn(axes_of(broken, "crack", breaks=4), "broken")) == 4


def test_corrected_factors_give_the_same_breaks_as_new_ones(monkeypatch):
    scene = plate((14, 10))
    corrected = kaju.FractureModel(scene, strength=1.0, scatter=0.3, seed=5).run()
    monkeypatch.setattr(breaking_bodies, "CELLS_CORRECTED", 0)
    anew = kaju.FractureModel(scene, strength=1.0, scatter=0.3, seed=5).run()
    assert anew.broken.tolist() == corrected.broken.tolist()
    np.testing.assert_allclose(corrected.load_factor, anew.load_factor, rtol=1e-7)


def test_what_cannot_break_is_named():
    pressed = plate(notch=0).replace(loads=[{"side": "top", "force": [0.0, -1.0]}])
    free = pressed.replace(sides={"bottom": "roller", "left": "roller"})
    assert "pulled" in kaju.FractureModel(free, strength=1.0).run().outcome
    corner = [{"cell": [0, 0], "force": [0.0, 1.0]}]
    for scene, how, told in (
        (plate(gravity=[0.0, -9.81]), {"strength": 1.0}, "gravity"),
        (plate(moved=True).replace(loads=corner), {"strength": 1.0}, "both"),
        (plate().replace(loads=[]), {"strength": 1.0}, "neither"),
        (plate(), {"strength": 1.0, "measure": "force"}, "measure"),
        (plate(), {"strength": [1.0, 2.0]}, "strength"),
        (plate((1, 12), notch=0), {"strength": 1.0}, "one cell wide"),
        (plate(), {}, "strength: is needed for cells"),
        (free.replace(sides={"bottom": "roller"}), {"strength": 1.0}, "hold"),
    ):
        with pytest.raises(kaju.KajuError, match=told):
            kaju.FractureModel(scene, **how)


NOTCHED = """
[body]
lattice = "hexagon"
cell_size = 0.01
cells = [12, 10]
thickness = 0.005
material = "rubber"
[sides]
bottom = "rigid"
top = { displacement = [0.0, 1e-4] }
[[regions]]
box = [[0.0, 0.03], [0.03, 0.045]]
material = "air"
"""


def test_a_notched_body_parts_where_it_is_notched(tmp_path, typed):
    scene = tmp_path / "notched.toml"
    scene.write_text(NOTCHED)
    words = ["break", scene, "--out", tmp_path / "broken", "--strength", 0.1, "--scatter", "20%"]
    told = typed(*words, "--json")
    assert told.exit_code == 0
    figures = json.loads(told.stdout)
    assert figures["outcome"].startswith("parted")
    result = kaju.load_result(tmp_path / "broken")
    assert result.breaks == figures["breaks"] > 10
    ends = result.network.positions[result.network.springs[result.broken]]
    height = ends[:, :, 1].mean()
    assert 0.02 < height < 0.055
    assert sorted(path.name for path in (tmp_path / "broken").iterdir()) == [
        *("crack.png", "result.npz", "summary.json")
    ]
