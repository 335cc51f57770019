"""The page in a browser without a network: what it asks for, shows and hands out."""

import itertools

import matplotlib.pyplot as plt
import numpy as np
import pandas
import pytest
from page_scenes import Leaky
from plates import PLATE

import kaju
from kaju import LoadModel, Scene


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "plate.html"
    return kaju.export_page(Scene(**PLATE), path, title="A plate")


def test_the_content_policy_lets_no_other_script_run(opened, plate):
    page = opened(plate)
    page.js(
        "document.body.append(Object.assign(document.createElement('script'), "
        "{ textContent: 'globalThis.intruder = 1' }))"
    )
    assert page.js("globalThis.intruder") is None
    assert page.js("fetch('data:,x').then(() => 'fetched', () => 'refused')") == "refused"
    page.messages.clear()


def test_a_runnable_page_is_small_asks_for_itself_and_gives_the_reference_numbers(opened, plate):
    assert plate.stat().st_size < 260_000
    page = opened(plate)
    assert page.js("[page.run.generation, page.run.agents]") == [8, 34]
    assert page.text(".count") == "Generation 8 of 8"
    assert page.text(".verdict").startswith("Every load ends after at most 8 generations\nBy this ")
    page.press("Play")
    page.tab.wait_for_timeout(300)
    assert page.requests == [plate.as_uri()]
    assert page.tab.title() == "A plate"


def test_clicked_agents_tell_the_numbers_of_the_table(shown):
    """With a finer threshold, and a wall that gives loads back."""
    wall = PLATE | {"sides": {"bottom": "rigid", "right": "rigid"}}
    wall["loads"] = [{"cell": [16, 19], "force": [0.4, -2.0]}]
    scene = Scene(**wall, rule={"kind": "prescribed", "threshold": 0.001})
    result = LoadModel(scene).run()
    page = shown(scene)
    table = result.to_dataframe()
    for row, agent in table.iloc[:: len(table) // 12].iterrows():
        page.click((agent.cell_x, agent.cell_y))
        taken = [agent[f"taken_{name} (N)"] for name in ("-x", "+x", "-y", "+y")]
        along = [0.5 * (taken[n] + taken[n + 1]) for n in (0, 2)]
        expected = [sum(taken), *(t for t in taken if t), sum(along), *(k for k in along if k)]
        expected += [*(p for p in result.last.passed[row] if p), agent["dropped (N)"]]
        assert page.told()[: len(expected)] == pytest.approx(expected, rel=1e-12, abs=1e-15)
        assert f"in generation {agent.spawn_step} by" in page.text(".story")


def saved(page, tmp_path, name):
    """Save something by its name in the menu; return the file."""
    page.tab.get_by_text("Save", exact=True).click()
    with page.tab.expect_download(timeout=120_000) as download:
        page.tab.get_by_role("button", name=name).click()
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_pictures_and_tables_are_taken_away(opened, plate, tmp_path):
    page = opened(plate)
    png = saved(page, tmp_path, "Picture (PNG)")
    assert png.name == "A-plate.png"
    picture = plt.imread(png)
    size = page.js("[page.canvas.height, page.canvas.width]")
    assert list(picture.shape[:2]) == size
    assert (picture[..., 3] == 1.0).all()  # on paper, not on nothing
    table = pandas.read_csv(saved(page, tmp_path, "Agents (CSV)"))
    wanted = LoadModel(Scene(**PLATE)).run().to_dataframe()
    both = ["cell_x", "cell_y"]
    table, wanted = (t.sort_values(both).reset_index(drop=True) for t in (table, wanted))
    for column in (*both, "material", "spawn_step"):
        assert table[column].tolist() == wanted[column].tolist()
    for name in ("taken_-x", "taken_+x", "taken_-y", "taken_+y", "dropped"):
        np.testing.assert_allclose(table[f"{name} (N)"], wanted[f"{name} (N)"], 1e-12, 1e-15)
    np.testing.assert_allclose(table["kept (N)"], 0.5 * wanted.filter(like="taken_").sum(axis=1))


def test_a_changed_scene_is_handed_out_and_runs_alike(opened, plate, tmp_path):
    page = opened(plate)
    x, y = page.at((10, 19))
    page.tab.mouse.move(x, y - 30)  # the arrow above the cell
    page.tab.mouse.down()
    page.tab.mouse.move(*page.at((6, 18)))
    page.tab.mouse.up()
    page.tab.get_by_role("tab", name="Draw").click()
    page.tab.get_by_label("Draw air").check()
    for cell in ((6, 15), (7, 15), (5, 14)):
        page.click(cell)
    page.tab.get_by_label("right").select_option("roller")
    page.until("!page.due")
    scene = kaju.load_scene(saved(page, tmp_path, "Scene (TOML)"))
    assert scene.loads[0].cell == (6, 18)
    assert scene.kinds([[6, 15], [7, 15], [5, 14], [8, 15]]).tolist() == [-1, -1, -1, 0]
    last = LoadModel(scene).run().last
    assert page.js("[page.run.generation, page.run.agents]") == [last.generations, len(last.cells)]
    total = "page.sums.taken.sum.reduce((a, b) => a + b)"
    assert page.js(total) == pytest.approx(last.ledger.taken, rel=1e-12)


SLOW = itertools.product((1280, 420), (False, True), ("en-GB", "de-DE", "ja-JP"))
EVERYBODY = [(1280, False, "ja-JP"), (420, True, "de-DE")]
EVERYBODY += [pytest.param(*window, marks=pytest.mark.slow) for window in SLOW]
HEIGHT = {1280: 720, 420: 800}


@pytest.mark.parametrize(("width", "dark", "language"), EVERYBODY)
def test_the_page_is_open_to_everybody(opened, plate, width, dark, language):
    page = opened(plate, width=width, height=HEIGHT[width], dark=dark, language=language)
    check_every_tab(page, width)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "dark"), [(1280, True), (420, False)])
def test_recorded_pages_are_open_to_everybody(opened, tmp_path, width, dark):
    own = LoadModel(Scene(**PLATE), material_agent=Leaky)
    spawned = kaju.SpawningModel(Scene(**PLATE), tolerance=0.3)
    for name, of in {"own": own, "spawned": spawned}.items():
        path = kaju.export_page(of, tmp_path / f"{name}.html", title="Kept", text="What is it?")
        page = opened(path, width=width, height=HEIGHT[width], dark=dark)
        box = page.tab.locator("canvas").first.bounding_box()
        page.tab.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.3 * box["height"])
        check_every_tab(page, width)


CLIPPED = """[...page.root.querySelectorAll('button, select, label, h1, .verdict')]
  .filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth)
  .map((e) => e.outerHTML.slice(0, 80))"""


def check_every_tab(page, width):
    """No violation of WCAG A and AA, nothing clipped, nothing beside the window."""
    for tab in page.tab.get_by_role("tab").all():
        tab.click()
        rules = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
        page.check_open_to_everybody(width, options={"runOnly": rules})
        assert page.js(CLIPPED) == []


def test_the_command_writes_a_page_of_a_scene_and_of_a_result(typed, tmp_path, pytestconfig):
    scene = pytestconfig.rootpath / "examples" / "plate.toml"
    page = tmp_path / "plate.html"
    assert typed("page", scene, "--out", page).exit_code == 0
    assert "<title>Plate</title>" in page.read_text()
    with pytest.raises(kaju.KajuError, match="exists already"):
        typed("page", scene, "--out", page)
    LoadModel(Scene(**PLATE)).run().save(tmp_path / "result.npz")
    assert typed("page", tmp_path, "--out", tmp_path / "r.html").exit_code == 0
    assert f"<title>Load transfer: {tmp_path.name}<" in (tmp_path / "r.html").read_text()


def test_what_cannot_be_a_page_is_refused(tmp_path):
    with pytest.raises(kaju.KajuError, match=r"a page is an \.html file; name it plate\.html"):
        kaju.export_page(Scene(**PLATE), tmp_path / "plate.pdf")
    truth = kaju.Reference(np.zeros((1, 2)), np.zeros((1, 2)))
    wrong = {truth: "of: a scene, a model or a result is needed", LoadModel: r"LoadModel\(scene\)"}
    wrong[kaju.MaterialAgent] = r"give LoadModel\(scene, material_agent=MaterialAgent\)"
    for of, told in wrong.items():
        with pytest.raises(kaju.KajuError, match=told):
            kaju.export_page(of, tmp_path / "plate.html")
    with pytest.raises(kaju.KajuError, match=r"a class, .* give LoadModel\(scene\)"):
        kaju.plot(LoadModel)
    for write in (kaju.export_page, kaju.animate):
        with pytest.raises(kaju.KajuError, match="path: the name of a"):
            write(tmp_path / "page.html", truth)
