"""Programs that the page's tests need: node for its modules, chromium for the page itself."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from live_pages import BrowserPage

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

    def at(self, cell):
        """Where a cell's middle is in the window."""
        self.js("page.draw()")
        box = self.tab.locator("canvas").first.bounding_box()
        x, y = self.js(f"page.view.at(...page.view.centre({list(cell)}))")
        return box["x"] + x, box["y"] + y

    def click(self, cell):
        self.tab.mouse.click(*self.at(cell))


@pytest.fixture
def opened(chromium):
    """Open a page: opened(path, width=..., height=..., dark=..., language=...)."""
    contexts = []

    def open_page(path, **options):
        page = Opened(chromium, Path(path), **options)
        contexts.append(page.context)
        return page

    yield open_page
    for context in contexts:
        context.close()
