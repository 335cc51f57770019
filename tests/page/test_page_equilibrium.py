"""The page's twin, ruler and cuts: the numbers are Python's, and both answers are drawn alike."""

import csv
import re

import numpy as np
import pytest
from page_scenes import described, random_scenes
from plates import PLATE

import kaju
from kaju import LoadModel, Scene, solve


@pytest.fixture
def scene():
    return Scene(**PLATE)


@pytest.fixture
def twin(shown, scene):
    page = shown(scene)
    page.press("Elasticity")
    page.until("page.elastic.answer")
    return page


def both(page, show):
    return page.js(
        f"(() => {{ page.look.twin.show = '{show}'; page.draw(); return page.drawnWith; }})()"
    )


def test_both_answers_are_drawn_with_one_quantity_scale_and_magnification(twin):
    names = twin.js("[...page.parts.bar.querySelector('select').options].map((o) => o.value)")
    assert set(names) == {"along", "across", "stress", "move"}
    for shape in ("false", "true"):
        twin.js(f"(page.look.deformed = {shape})")
        for name in names:
            rule, elastic = both(twin, name)
            assert (rule.pop("answer"), elastic.pop("answer")) == ("rule", "elastic")
            assert rule == elastic
            assert rule["quantity"] == name
            told = twin.js("page.twin.line.textContent")
            assert (f"{rule['factor']:,}".replace(",", " ") in told) == (shape == "true")
    twin.press("Side by side")
    rule, elastic = both(twin, "move")
    assert rule["factor"] == elastic["factor"] > 0


def test_loads_beyond_all_bounds_leave_elasticity_its_colours(twin):
    twin.press("Make it blow up")
    twin.until("page.run.grown && page.elastic.answer && (page.draw(), page.drawn)")
    for drawn in both(twin, "along"):
        assert drawn["scale"]["high"] == pytest.approx(2.0, rel=0.1)  # the load, not 50 GN
    for generation in (5, 60):
        twin.js(f"page.seek({generation})")
        high, most = twin.js("[page.scale().high, Math.max(...page.values().map((v) => v || 0))]")
        assert most <= high < 10.0 * most


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True])
def test_both_ways_of_looking_are_open_to_everybody(opened, scene, tmp_path, dark):
    path = kaju.export_page(scene, tmp_path / "plate.html")
    page = opened(path, width=768, dark=dark, language="de-DE")
    for mode in ("twin", "cuts"):
        page.js(f"page.setMode('{mode}')")
        page.until("page.elastic.answer && (page.draw(), page.drawn)")
        page.check_open_to_everybody(768)


def fields(result):
    """Squeezes along and across (N) of every cell of an answer."""
    lattice = result.scene.lattice
    cells = np.argwhere(np.ones(lattice.shape, dtype=bool))
    stress = result.stress_at(lattice.centres(cells))
    area = lattice.cell_size * result.scene.thickness
    return cells, {
        "along": -stress[:, 1, 1] * area,
        "across": -stress[:, 0, 0] * area,
        "stress": np.abs(np.diagonal(stress, axis1=1, axis2=2)).max(axis=1),
    }


def test_the_ruler_reads_what_python_reads(twin, scene):
    rows = {"rule": LoadModel(scene).run(), "elastic": solve(scene)}
    for name, result in rows.items():
        cells, wanted = fields(result)
        for show in ("along", "across", "stress"):
            both(twin, show)
            for axis, at in ((0, 16), (1, 10)):
                twin.js(f"page.look.twin.ruler = {{ axis: {axis}, at: {at} }}")
                twin.js("(page.refresh(), page.draw())")
                data = read_csv(twin)
                column = next(k for k in data[0] if k.startswith(name))
                read = np.array([float(row[column]) for row in data])
                line = cells[:, 1 - axis] == at
                truth = wanted[show][line]
                load = 2.0 / (0.01 * 0.002) if show == "stress" else 2.0
                np.testing.assert_allclose(read, truth, atol=1e-12 * load)
    twin.js("page.look.twin.ruler = { axis: 0, at: 16 }")
    twin.press("Ruler one row on")  # rows count as on the axis
    twin.until("page.ruled.startsWith('Row 17, 2.5 cells from the top')")
    read = "(page.seek({}), page.playing = {}, page.draw(), page.ruled)"
    assert twin.js(read.format(4, "true")) == twin.js(read.format(4, "false"))  # in play too


def read_csv(page, name="Save CSV"):
    """Return what a button hands out, without the browser's own way of keeping files."""
    page.js(
        "(() => { const url = URL.createObjectURL; page.handed = null;"
        " URL.createObjectURL = (blob) => { blob.text().then((text) => { page.handed = text; });"
        " URL.createObjectURL = url; return url(blob); }; })()"
    )
    page.press(name)
    page.until("page.handed")
    return list(csv.DictReader(page.js("page.handed").splitlines()))


BODIES = {
    "plate": {},
    "from the left": {
        "sides": {"right": "rigid"},
        "loads": [{"cell": [0, 7], "side": "left", "force": [3.0, 0.0]}],
    },
    "hung up": {"sides": {"top": "rigid"}, "loads": [{"cell": [4, 0], "force": [0.0, -1.0]}]},
    "side walls": {"sides": {"bottom": "rigid", "left": "roller", "right": "rigid"}},
    "two loads": {
        "loads": [{"cell": [3, 19], "force": [0.0, -2.0]}, {"cell": [9, 10], "force": [0.5, -1.0]}]
    },
}


@pytest.mark.parametrize("name", BODIES)
def test_cuts_are_those_of_python(name, shown):
    scene = Scene(**PLATE | BODIES[name])
    page = shown(scene)
    page.press("Equilibrium")
    page.until("page.elastic.answer")
    rows = read_csv(page, "CSV")
    numbers = {k: np.array([float(row[k] or "nan") for row in rows]) for k in rows[0]}
    rule, elastic = (a.cuts() for a in (LoadModel(scene).run(), solve(scene)))
    load = abs(rule.load)
    np.testing.assert_allclose(numbers[f"{rule.axis} (m)"], rule.at, rtol=1e-12)
    np.testing.assert_allclose(numbers["rule (N)"], rule.carried, atol=1e-12 * load)
    np.testing.assert_allclose(numbers["needed (N)"], rule.balance, atol=1e-12 * load)
    np.testing.assert_allclose(numbers["elasticity (N)"], elastic.carried, atol=2e-12 * load)


def test_arrows_at_a_cut_are_to_scale_and_a_cell_tells_what_it_bears(shown):
    page = shown(Scene(**PLATE))  # the rule carries 0.6875 N of 2 N in row 16, in row 11 nothing
    page.press("Equilibrium")
    page.until("page.elastic.answer")
    drawn = (
        "Array.from(page.cutCards[0].querySelectorAll('.arrow'), (path) => path.getAttribute('d'))"
    )
    for row, carried in (16, 0.6875), (11, 0.0):
        page.js(f"page.set('row', {row})")
        page.until(f"page.parts.cap.textContent.startsWith('row {row}')")
        shares = [v for v in (2.0, carried, 2.0 - carried) if v]
        ends = [re.match(r"M\d+ ([\d.]+)V([\d.]+)", path).groups() for path in page.js(drawn)]
        lengths = [abs(float(b) - float(a)) for a, b in ends]
        assert lengths == pytest.approx([22.0 * share for share in shares])
    page.click((9, 14))
    page.until("page.parts.cap.textContent.includes('(9, 14): rule 46.88 mN')")


LEDGER = """
import { Twin } from "./rule.js";
tell(data.map(({ scene, cells }) => new Twin(scene, Int16Array.from(cells)).run(60).ledger));
"""


def test_every_newton_along_the_load_is_on_its_way_ended_or_handed_over(node):
    scenes = [scene for scene, _ in random_scenes(40, seed=11)]
    plate, *others = node(LEDGER, [described(scene) for scene in [Scene(**PLATE), *scenes]])
    assert [row["way"] for row in plate["rows"]] == pytest.approx(
        [2.0, 2.0, 2.0, 2.0, 1.875, 1.0, 0.21875, 0.015625, 0.0]
    )
    for ledger in (plate, *others):
        largest = max(abs(v) for row in ledger["rows"] for v in row.values())
        for row in ledger["rows"]:
            total = row["way"] + row["ended"] + row["ground"] - row["made"]
            assert total == pytest.approx(ledger["applied"], abs=1e-12 * largest)
