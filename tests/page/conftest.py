"""Programs that the page's tests need: node for its modules, chromium for the page itself."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from browser_pages import BrowserPage

import kaju
import kaju.view.page

PAGE = Path(kaju.view.page.__file__).parent


@pytest.fixture(scope="session")
def node(tmp_path_factory):
    """Run a script beside the page's modules: node(script, data) -> what it printed, as JSON."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not installed (apt-get install nodejs)")
    folder = tmp_path_factory.mktemp("modules")
    for module in [*PAGE.glob("*.js"), *PAGE.glob("*.json")]:
        shutil.copy(module, folder)

    def run(script, data=None):
        (folder / "data.json").write_text(json.dumps(data))
        (folder / "script.js").write_text(
            'import { readFileSync } from "node:fs";\n'
            'const data = JSON.parse(readFileSync(new URL("data.json", import.meta.url)));\n'
            "const tell = (value) => console.log(JSON.stringify(value));\n" + script
        )
        done = subprocess.run(
            [program, folder / "script.js"], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="session")
def chromium():
    """Debian's chromium, headless, without a network."""
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed (apt-get install chromium)")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


class Opened(BrowserPage):
    """An exported page, in a window of some size."""

    def __init__(
        self, browser, path, width=1280, height=720, dark=False, language="en-GB", touch=False
    ):
        super().__init__(
            browser,
            path.as_uri(),
            viewport={"width": width, "height": height},
            color_scheme="dark" if dark else "light",
            locale=language,
            offline=True,
            accept_downloads=True,
            has_touch=touch,
            is_mobile=touch,
        )
        self.until("page?.drawn > 0 && (!page.touchable || page.over)")

    def check_open_to_everybody(self, width, **options):
        """No violation of what axe knows, nothing beside the window."""
        axe = pytest.importorskip("axe_core_python.sync_playwright").Axe()
        found = axe.run(self.tab, **options)["violations"]
        assert [(v["id"], [n["html"] for n in v["nodes"]]) for v in found] == []
        assert self.js("document.documentElement.scrollWidth") <= width


@pytest.fixture
def opened(chromium):
    """Open a page: opened(path, width=..., height=..., dark=..., language=...).

    It asks for nothing but itself and says nothing to the console.
    """
    pages = []

    def open_page(path, **options):
        pages.append((Opened(chromium, Path(path), **options), Path(path).as_uri()))
        return pages[-1][0]

    yield open_page
    for page, _ in pages:
        page.context.close()
    for page, address in pages:
        assert page.messages == []
        assert {request.partition("#")[0] for request in page.requests} == {address}


@pytest.fixture
def shown(opened, tmp_path):
    """Open the page of something: shown(scene or model or result, options of its export)."""
    return lambda of, **options: opened(kaju.export_page(of, tmp_path / "page.html", **options))
