"""Bodies that grow in the page itself: a load that is moved lets the truss grow elsewhere."""

import tomllib

import numpy as np
import pytest
from plates import plate

import kaju
from kaju.model.growth.growth_rules import Compliance
from kaju.view.page.export import packed_page
from kaju.view.page.packing import unpack

LAST = "Array.from(page.run.designs.at(-1))"


def arm(cells=(24, 12), end=None, **options):
    nx, ny = cells
    clamped = {"sides": {"left": "rigid"}, "thickness": 0.01}
    scene = plate([nx, ny], end or [nx - 1, ny // 2], [0.0, -1.0], **clamped)
    usual = {"volume": 0.4, "filter_radius": 1.5, "most_steps": 12, "at_rest": 0.0}
    return kaju.GrowthModel(scene, **usual | options)


def at_rest(page):
    page.until("!page.due && page.run.atRest")


def test_the_page_grows_what_kaju_grew_and_something_else_elsewhere(shown):
    result = arm().run()
    page = shown(result, title="An arm")
    assert page.text(".mode") == "runs in this page"
    at_rest(page)
    assert page.js("[page.g, page.run.generation]") == [12, 12]
    first = np.array(page.js(LAST))
    np.testing.assert_allclose(first, result.cells, atol=0.05)
    assert page.js("page.run.compliance.at(-1)") == pytest.approx(result.compliance, rel=1e-3)
    assert page.text(".verdict").startswith("After 12 steps: compliance")
    page.tab.keyboard.press("Home")
    assert page.js("page.g") == 0
    grey = page.js("Array.from(page.values().filter((v) => v >= 0))")
    np.testing.assert_allclose(grey, [0.4] * 288, rtol=1e-12)
    page.tab.keyboard.press("End")
    page.js("page.loads.move(page.scene.loads[0], [15, 0])")
    page.until("page.scene.loads[0].cell[0] === 15")
    at_rest(page)
    again = arm(end=[15, 0]).run()
    second = np.array(page.js(LAST))
    assert page.js("page.g") == 12  # who stood at the end sees the end
    np.testing.assert_allclose(second, again.cells, atol=0.05)
    assert np.abs(second - first).max() > 0.5
    page.press("Undo")
    at_rest(page)
    np.testing.assert_allclose(page.js(LAST), first, atol=1e-9)
    page.click([3, 10])
    assert page.told()[0] == pytest.approx(first.reshape(24, 12)[3, 10])


def test_numbers_supports_and_the_rule_are_in_the_hand(shown, tmp_path):
    page = shown(arm().run())
    at_rest(page)
    page.tab.get_by_role("textbox", name="volume").fill("0.2")
    page.tab.keyboard.press("Enter")
    page.until("page.scene.growth.volume === 0.2")
    at_rest(page)
    assert np.mean(page.js(LAST)) == pytest.approx(0.2, rel=1e-9)
    page.tab.get_by_role("combobox", name="Rule").select_option("remodelling")
    page.until("page.scene.growth.rule === 'remodelling'")
    at_rest(page)
    assert page.js("page.run.generation") == 160
    assert page.js("page.run.volume.at(-1)") != pytest.approx(20.0, rel=0.01)
    page.tab.get_by_role("tab", name="Draw").click()
    page.tab.get_by_label("Draw rollers").check()
    page.click([12, 0])
    page.until("page.cells[12 * 12] === -3")
    at_rest(page)
    with page.tab.expect_download() as download:
        page.tab.get_by_label("Save").first.click()
        page.tab.get_by_role("button", name="Scene").click()
    download.value.save_as(tmp_path / "mine.toml")
    assert tomllib.loads((tmp_path / "mine.toml").read_text())["legend"][":"] == "roller"
    assert kaju.load_scene(tmp_path / "mine.toml").rasterise()[12, 0] == -3
    page.tab.get_by_role("combobox", name="left").select_option("free")
    page.until("page.run.error")
    assert "held by nothing" in page.text(".verdict")


@pytest.mark.parametrize(
    "model",
    [
        lambda: arm(rule="stress"),
        lambda: arm(rule=Compliance("sensitivity")),
        lambda: arm(rule=Compliance(penalty=2.0)),
        lambda: arm(start=np.linspace(0.1, 0.7, 288).reshape(24, 12)),
        lambda: arm((60, 46), most_steps=1),
    ],
)
def test_what_the_page_would_grow_otherwise_is_recorded(model):
    header, columns = unpack(packed_page(model()))
    assert header["kind"] == "pictures"
    assert len(columns["value density"]) == len(header["at"]) * len(columns["parts"]) // 4


def test_a_body_that_comes_to_rest_is_let_come_to_rest():
    result = arm(at_rest=0.01, most_steps=100).run()
    header, _ = unpack(packed_page(result))
    assert result.outcome.startswith("at rest")
    growth = {"rule": "compliance", "volume": 0.4, "radius": 1.5, "steps": 100}
    assert header["scene"]["growth"] == growth | {"at_rest": 0.01, "tolerance": 0.01}
