"""Models and results show themselves in notebooks, without a kernel."""

import base64
import re
from html import unescape
from pathlib import Path

import nbconvert
import nbformat
from nbconvert import HTMLExporter
from page_scenes import Leaky, header_of
from plates import PLATE

import kaju
from kaju import LoadModel, Scene

# Beside the packages, wherever those are: an environment may borrow them from another one.
TEMPLATES = Path(nbconvert.__file__).parents[4] / "share/jupyter"


def page_in(html):
    assert html.startswith("<iframe ")
    return unescape(re.search(r'srcdoc="([^"]*)"', html)[1])


def told(page):
    data = re.search(r'id="kaju-data">([^<]+)<', page)[1]
    return header_of(base64.b64decode(data))


def test_a_result_is_a_page_shut_off_from_the_notebook():
    html = LoadModel(Scene(**PLATE)).run()._repr_html_()
    assert 'sandbox="allow-scripts allow-downloads"' in html
    page = page_in(html)
    assert "default-src 'none'; script-src 'sha256-" in page
    assert told(page)["kind"] == "runnable"


def test_a_model_shows_what_has_happened_and_is_not_run_on():
    model = LoadModel(Scene(**PLATE), material_agent=Leaky)
    for _ in range(3):
        model.step()
    header = told(page_in(model._repr_html_()))
    assert header["kind"] == "recorded"
    assert {name: size for name, _, size in header["columns"]}["offset"] == 4
    assert model.generation == 3


def test_the_page_stays_in_a_saved_notebook_and_its_document(tmp_path, chromium, monkeypatch):
    """No kernel, no network: the notebook is written, read, converted, and looked at."""
    monkeypatch.setenv("JUPYTER_PATH", str(TEMPLATES))
    output = nbformat.v4.new_output(
        "execute_result",
        {"text/html": LoadModel(Scene(**PLATE)).run()._repr_html_(), "text/plain": "…"},
        execution_count=1,
    )
    cell = nbformat.v4.new_code_cell("model.run()", outputs=[output], execution_count=1)
    saved = tmp_path / "lesson.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), saved)
    document, _ = HTMLExporter().from_filename(str(saved))
    shown = tmp_path / "lesson.html"
    shown.write_text(document, encoding="utf-8")
    with chromium.new_context(offline=True) as context:
        context.set_default_timeout(120_000)
        tab = context.new_page()
        tab.goto(shown.as_uri(), wait_until="domcontentloaded")
        frame = tab.frame_locator("iframe[title=kaju]")
        frame.locator(".count").get_by_text("Generation 8 of 8").wait_for()
        frame.get_by_role("button", name="Back").first.click()
        frame.locator(".count").get_by_text("Generation 7 of 8").wait_for()


def test_pictures_and_scenes_show_themselves_in_a_fresh_notebook():
    scene = Scene(**PLATE)
    assert kaju.plot(scene)._repr_png_().startswith(b"\x89PNG")
    assert scene._repr_html_().startswith("<img ")
